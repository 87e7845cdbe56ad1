//! The observation of an agent, the d-set of its AIP on a grid, and figures for its reward. Pure.

use super::agents::phase_plan::Shown;
use super::agents::plan::AgentPlan;
use super::agents::region::{self, CELL_M};
use super::agents::region_plan::RegionPlan;
use super::agents::sensor::{CarColumns, LightColumns};
use super::cars_at::CarsAt;
use super::lane_sets::Seen;
use super::reward::PERSONS;
use crate::config::DSet;
use crate::sim::others::OthersNow;
use crate::sim::readings::Readings;
use dials_core::domain::Action;

/// Seconds after which an observation no longer shows that time goes on.
const LONGEST_AGE_S: f32 = 60.0;

/// What a light shows, for how many seconds, and the number of seconds since the episode began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LightView {
    pub(crate) shown: Shown,
    pub(crate) shown_steps: u32,
    pub(crate) age: usize,
    /// What its clock has counted: `age`, and the steps by which the clock is ahead.
    pub(crate) clock: usize,
}

/// Writes the observation: cars, light and clock, as the agent's sensor says. Columns beyond them become 0.
pub(crate) fn observe(plan: &AgentPlan, cars: CarsAt<'_>, light: LightView, obs: &mut [f32]) {
    obs.fill(0.0);
    let (bits, others) = obs.split_at_mut(plan.sensor.car_columns());
    match &plan.sensor.cars {
        CarColumns::Cells(cells) => occupy(plan, cars, cells, bits),
        CarColumns::QueueAndDensity(_) => {
            for ((approach, lane), pair) in plan.region.approaches.iter().zip(cars.iter()).zip(bits.chunks_exact_mut(2))
            {
                let room = (approach.length_m / JAM_M).max(1.0);
                pair[0] = (lane.halting() as f64 / room).min(1.0) as f32;
                pair[1] = (lane.len() as f64 / room).min(1.0) as f32;
            }
        }
        // What they have seen since the last decision: `observe_detectors`.
        CarColumns::Detectors(_) => {}
        // All at once: `observe_sets`.
        CarColumns::Sets(_) => return,
    }
    let (shown, others) = others.split_at_mut(plan.sensor.light.columns());
    show(plan.sensor.light, light, shown);
    if plan.sensor.clock > 0 {
        others[light.clock % plan.sensor.clock] = 1.0;
    }
}

/// Writes what the detectors have seen into the columns of cars, if the agent sees detectors.
pub(crate) fn observe_detectors(plan: &AgentPlan, readings: &Readings, obs: &mut [f32]) {
    if matches!(plan.sensor.cars, CarColumns::Detectors(_)) {
        readings.write(&mut obs[..plan.sensor.car_columns()]);
    }
}

/// Writes lanes and greens as sets, if the agent sees sets.
pub(crate) fn observe_sets(plan: &AgentPlan, seen: &Seen<'_>, obs: &mut [f32]) {
    if let Some(sets) = plan.sensor.sets() {
        sets.observe(plan, seen, &mut obs[..sets.columns()]);
    }
}

/// Writes buses, trams and persons into the columns behind all others, if the agent sees them. `people`: who stands at each crossing.
pub(crate) fn observe_others(plan: &AgentPlan, others: &OthersNow, people: &[u32], obs: &mut [f32]) {
    if !plan.sensor.sees_others {
        return;
    }
    let columns = &mut obs[plan.sensor.clock_columns().end..];
    let vehicles = others.buses.iter().chain(&others.trams).map(|&count| count as f32);
    let persons = people.iter().map(|&count| count as f32 / PERSONS as f32);
    columns.iter_mut().zip(vehicles.chain(persons)).for_each(|(column, value)| *column = value);
}

/// Length of road that a standing car of a usual type fills, in metres.
pub(super) const JAM_M: f64 = 7.5;

/// Marks the cells in which cars are, from the end of each lane on. `cells`: how many each approach has.
pub(super) fn occupy(plan: &AgentPlan, cars: CarsAt<'_>, cells: &[usize], bits: &mut [f32]) {
    let mut rest = bits;
    for ((approach, lane), &cells) in plan.region.approaches.iter().zip(cars.iter()).zip(cells) {
        let bits = rest.split_off_mut(..cells).expect("as many bits as all approaches have cells");
        for &position in lane.positions_m {
            let cell = ((approach.length_m - position) / CELL_M) as usize;
            if let Some(bit) = bits.get_mut(cell) {
                *bit = 1.0;
            }
        }
    }
}

/// Writes what a light shows into these columns, which are zeros.
pub(super) fn show(columns: LightColumns, light: LightView, bits: &mut [f32]) {
    match columns {
        LightColumns::FourStates => {
            let state = match light.shown {
                Shown::Green(0) => 3,
                Shown::Green(_) => 0,
                Shown::Between { from: 0, .. } => 2,
                Shown::Between { .. } => 1,
            };
            bits[state] = 1.0;
        }
        LightColumns::WithLanes => {}
        LightColumns::TargetAndAge(greens) => {
            bits[light.shown.target()] = 1.0;
            bits[greens] = f32::from(u8::from(!light.shown.is_green()));
            bits[greens + 1] = (light.shown_steps as f32 / LONGEST_AGE_S).min(1.0);
        }
    }
}

/// Writes which actions a light may take: those for greens that it may show, as `allows` says of each, and that send nobody across a
/// trapped car. `inside`: the cars on [`AgentPlan::lanes_inside`].
pub(crate) fn mask(
    plan: &AgentPlan,
    shown: Shown,
    inside: CarsAt<'_>,
    allows: impl Fn(usize) -> bool,
    mask: &mut [bool],
) {
    if mask.is_empty() {
        return;
    }
    let asked = (0..plan.phases.actions()).map(|action| plan.phases.asked_for(shown, action as Action));
    let mut greens = vec![false; plan.greens()];
    asked.clone().for_each(|green| greens[green] = allows(green));
    plan.mind_trapped(inside, shown, &mut greens);
    mask.fill(false);
    mask.iter_mut().zip(asked).for_each(|(allowed, green)| *allowed = greens[green]);
}

/// Writes the d-set of a grid: the cells in which cars are, the arrivals or the light if the plan says so, and the clock if
/// the observation has one. The AIP sees cells also where the agent sees queues or detectors.
///
/// DEVIATION 9: the arrivals (`d_set = "cells+arrivals"`). The cells do not show a car that has just entered, but an
/// arrival in the next step is then very unlikely. With the arrivals, the AIP's cross-entropy falls by 4 %.
pub(crate) fn d_separate(plan: &AgentPlan, cars: CarsAt<'_>, obs: &[f32], arrivals: &[u8], d_set: &mut [f32]) {
    d_set.fill(0.0);
    let (cells, others) = d_set.split_at_mut(region::OCCUPANCY);
    match &plan.sensor.cars {
        CarColumns::Cells(_) => cells.copy_from_slice(&obs[..cells.len()]),
        CarColumns::QueueAndDensity(_) | CarColumns::Detectors(_) | CarColumns::Sets(_) => {
            occupy(plan, cars, &[region::CELLS; region::EDGES], cells);
        }
    }
    let clock = match plan.sensor.d_set {
        DSet::Cells => others,
        DSet::CellsAndArrivals => {
            let (bits, clock) = others.split_at_mut(plan.region.approaches.len());
            bits.iter_mut().zip(arrivals).for_each(|(bit, &arrived)| *bit = f32::from(arrived));
            clock
        }
        DSet::CellsAndLight => {
            let columns = plan.sensor.light_columns();
            let (light, clock) = others.split_at_mut(columns.len());
            light.copy_from_slice(&obs[columns]);
            clock
        }
    };
    let columns = plan.sensor.clock_columns();
    clock[..columns.len()].copy_from_slice(&obs[columns]);
}

/// Returns the mean speed of the cars on the approaches as a share of the limit; 0 without cars.
pub(crate) fn mean_speed(region: &RegionPlan, cars: CarsAt<'_>) -> f32 {
    let count = cars.cars();
    if count == 0 {
        return 0.0;
    }
    // Speeds as if all lanes had the limit of the first one: where they have, nothing is rounded.
    let limit = region.approaches[0].speed_limit_mps;
    let lanes = region.approaches.iter().zip(cars.iter());
    let speeds: f64 = lanes
        .flat_map(|(approach, lane)| lane.speeds_mps.iter().map(|speed| speed * (limit / approach.speed_limit_mps)))
        .sum();
    (speeds / count as f64 / limit) as f32
}

/// Returns the mean speed of the cars on the exits, as a share of the limits of their lanes; 0 without cars.
pub(crate) fn exit_speed(region: &RegionPlan, exits: CarsAt<'_>) -> f64 {
    let lanes = region.exits.iter().zip(exits.iter());
    let shares = lanes.flat_map(|(exit, lane)| lane.speeds_mps.iter().map(|speed| speed / exit.speed_limit_mps));
    shares.sum::<f64>() / exits.cars().max(1) as f64
}

/// Returns the seconds that the cars on the approaches lose in a second, against the limits of their lanes. A car that is
/// faster than the limit loses nothing.
pub(crate) fn cars_lost(region: &RegionPlan, cars: CarsAt<'_>) -> f64 {
    let lanes = region.approaches.iter().zip(cars.iter());
    let lost = lanes.flat_map(|(approach, lane)| {
        lane.speeds_mps.iter().map(|speed| (1.0 - speed / approach.speed_limit_mps).max(0.0))
    });
    lost.sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{Observation, TrafficConfig};
    use crate::paper_grid::grid::Grid;
    use crate::paper_grid::plans::plans;
    use libsumo::{CarId, CarTable};

    /// Cars on one lane, the rearmost first: position and speed.
    type Lane<'a> = &'a [(f64, f64)];

    const NOBODY: [Lane<'static>; 4] = [&[]; 4];
    const VERTICAL_GREEN: Shown = Shown::Green(0);
    const VERTICAL_YELLOW: Shown = Shown::Between { from: 0, to: 1 };

    fn table(lanes: [Lane<'_>; 4]) -> CarTable {
        CarTable::of(lanes.map(|lane| lane.iter().map(|&(position, speed)| (CarId(0), position, speed)).collect()))
    }

    fn config(clock: Option<usize>, d_set: DSet) -> TrafficConfig {
        TrafficConfig { clock, d_set, ..TrafficConfig::new("", "") }
    }

    /// Returns the columns of the observation and of the d-set that are not 0. Both are wider than any of them needs.
    fn ones(
        config: &TrafficConfig,
        lanes: [Lane<'_>; 4],
        shown: Shown,
        age: usize,
        arrivals: [u8; 4],
    ) -> [Vec<usize>; 2] {
        let (plan, cars) = (plans(Grid::SINGLE, config).remove(0), table(lanes));
        let (mut obs, mut d_set) = ([9.0; 50], [9.0; 50]);
        observe(&plan, CarsAt::all(&cars), LightView { shown, shown_steps: 1, age, clock: age }, &mut obs);
        d_separate(&plan, CarsAt::all(&cars), &obs, &arrivals, &mut d_set);
        [obs, d_set].map(|row| (0..row.len()).filter(|&column| row[column] != 0.0).collect())
    }

    #[test]
    fn cells_count_from_the_stop_line_lane_by_lane() {
        // From the west 10.1 m, 5 m and 0 m before the line: cells 1, 0, 0. From the north 89.9 m and 50 m: 8 and 5.
        let lanes: [Lane<'_>; 4] = [&[(89.9, 1.0), (95.0, 1.0), (100.0, 1.0)], &[], &[], &[(10.1, 1.0), (50.0, 1.0)]];
        let [obs, d_set] = ones(&config(None, DSet::Cells), lanes, VERTICAL_YELLOW, 0, [1; 4]);
        assert_eq!(obs, [0, 1, 27 + 5, 27 + 8, 36 + 2]);
        assert_eq!(d_set, [0, 1, 27 + 5, 27 + 8]);
    }

    #[test]
    fn a_car_on_the_entry_cell_is_neither_observed_nor_in_the_cells_of_the_d_set() {
        let entered =
            |d_set| ones(&config(Some(5), d_set), [&[(6.0, 9.5)], &[], &[], &[]], VERTICAL_GREEN, 8, [1, 0, 0, 0]);
        assert_eq!(entered(DSet::CellsAndArrivals), [[39, 43], [36, 43]], "but its arrival is");
        assert_eq!(entered(DSet::Cells), [vec![39, 43], vec![39]]);
    }

    #[test]
    fn the_light_stands_between_the_cells_and_the_clock_of_the_d_set() {
        for observation in [Observation::Cells, Observation::Queues] {
            let config = TrafficConfig { observation, ..config(Some(5), DSet::CellsAndLight) };
            let [_, d_set] = ones(&config, [&[(95.0, 1.0)], &[], &[], &[]], VERTICAL_YELLOW, 3, [1; 4]);
            assert_eq!(d_set, [0, 36 + 2, 40 + 3]);
        }
    }

    #[test]
    fn the_mean_speed_is_a_share_of_the_limit_of_each_lane() {
        let mut region = plans(Grid::SINGLE, &config(None, DSet::Cells)).remove(0).region;
        let mean = |region: &RegionPlan, lanes| mean_speed(region, CarsAt::all(&table(lanes)));
        assert_eq!(mean(&region, NOBODY), 0.0);
        // A car at half of its own limit of 20 m/s counts like one at 5 m/s.
        region.approaches[2].speed_limit_mps = 20.0;
        assert!((mean(&region, [&[(5.0, 5.0)], &[], &[(80.0, 10.0)], &[]]) - 0.5).abs() < 1e-7);
    }
}
