//! Intersections made by hand, for the tests of the controllers.

use std::sync::Arc;

use super::intersections::Intersection;
use crate::agents::phase_plan::{Choice, Interval, PhasePlan, Shown};
use crate::agents::plan::AgentPlan;
use crate::agents::region_plan::{Approach, Exit, Link, RegionPlan};
use crate::agents::sensor::{CarColumns, LightColumns, Sensor};
use crate::cars_at::CarsAt;
use crate::config::{DSet, TrafficConfig};
use crate::paper_grid::grid::Grid;
use crate::paper_grid::plans::plans;
use dials_core::base::AgentId;
use libsumo::{CarId, CarTable, SignalState};

/// Greens of [`crossing`]. Letters: west to east, west to north, south to north, south to west, east to west.
pub(crate) const GREENS: [&str; 4] = ["GrrrG", "rGrrr", "rrGrr", "rgrGr"];

/// Returns a light with four greens. Approaches:
/// - 0 and 1 from the west, straight on and to the left,
/// - 2 from the south, straight on and to the left on one lane,
/// - 3 from the east, 10 m long, and 4 upstream of it.
///
/// Exits: 0 to the east, 1 to the north, 2 to the west; the last one leaves the net.
pub(crate) fn crossing() -> AgentPlan {
    let approach = |lane: &str, length_m, ahead_m, links: &[usize]| Approach {
        lane: lane.to_owned(),
        length_m,
        speed_limit_mps: 10.0,
        ahead_m,
        links: links.to_vec(),
    };
    let exit = |lane: &str, leaves_the_net| Exit {
        lane: lane.to_owned(),
        length_m: 100.0,
        speed_limit_mps: 10.0,
        leaves_the_net,
    };
    let link = |letter, from, to| Link { letter, from, to, inside: Vec::new(), crosses: Vec::new() };
    AgentPlan {
        light: "crossing".to_owned(),
        place_m: [0.0, 0.0],
        others: Default::default(),
        region: RegionPlan {
            approaches: vec![
                approach("west_0", 100.0, 0.0, &[0]),
                approach("west_1", 100.0, 0.0, &[1]),
                approach("south_0", 50.0, 0.0, &[2, 3]),
                approach("east_0", 10.0, 0.0, &[4]),
                approach("far_east_0", 60.0, 10.0, &[4]),
            ],
            exits: vec![exit("to_east_0", false), exit("to_north_0", false), exit("to_west_0", true)],
            links: vec![link(0, 0, 0), link(1, 1, 1), link(2, 2, 1), link(3, 2, 2), link(4, 3, 2)],
        },
        phases: Arc::new(phases(&GREENS, Choice::Target)),
        sensor: Sensor {
            cars: CarColumns::QueueAndDensity(5),
            light: LightColumns::TargetAndAge(GREENS.len()),
            clock: 0,
            clock_ahead: 0,
            sees_others: false,
            d_set: DSet::Cells,
        },
    }
}

/// Returns a light whose changes take three steps of yellow and one of red.
pub(crate) fn phases(greens: &[&str], choice: Choice) -> PhasePlan {
    let state = |letters: &str| SignalState::new(letters).expect("letters of a light");
    let clearing = |from: usize, to: usize| {
        let lost = |(from, to): (char, char)| if "gG".contains(from) && to == 'r' { 'y' } else { from };
        let yellow: String = greens[from].chars().zip(greens[to].chars()).map(lost).collect();
        let red = yellow.replace('y', "r");
        vec![Interval { state: state(&yellow), steps: 3 }, Interval { state: state(&red), steps: 1 }]
    };
    PhasePlan::new(greens.iter().map(|letters| state(letters)).collect(), choice, 5, clearing)
}

/// Returns the middle light of three in a row of the paper's grid. Green 0 is for the cars from south and north.
pub(crate) fn middle() -> AgentPlan {
    grid(1, 3).swap_remove(1)
}

pub(crate) fn grid(rows: usize, cols: usize) -> Vec<AgentPlan> {
    plans(Grid::new(rows, cols).expect("a grid"), &TrafficConfig::new("", ""))
}

/// What makes an [`Intersection`]: the cars on each approach and on each exit, the rearmost first.
pub(crate) struct At<'a> {
    plan: &'a AgentPlan,
    shown: Shown,
    shown_steps: u32,
    approaches: Vec<Vec<(CarId, f64, f64)>>,
    exits: Vec<Vec<(CarId, f64, f64)>>,
}

impl<'a> At<'a> {
    pub(crate) fn new(plan: &'a AgentPlan, shown: Shown) -> At<'a> {
        let nobody = |lanes: usize| vec![Vec::new(); lanes];
        let (approaches, exits) = (nobody(plan.region.approaches.len()), nobody(plan.region.exits.len()));
        At { plan, shown, shown_steps: 10, approaches, exits }
    }

    pub(crate) fn since(mut self, steps: u32) -> At<'a> {
        self.shown_steps = steps;
        self
    }

    /// Puts cars on an approach: distance to the end of the lane in metres, speed in m/s.
    pub(crate) fn cars(mut self, approach: usize, placed: &[(f64, f64)]) -> At<'a> {
        let length_m = self.plan.region.approaches[approach].length_m;
        let mut placed: Vec<(f64, f64)> =
            placed.iter().map(|&(to_end_m, speed)| (length_m - to_end_m, speed)).collect();
        // As SUMO gives them: the rearmost first.
        placed.sort_by(|one, other| one.0.total_cmp(&other.0));
        self.approaches[approach] = cars(&placed);
        self
    }

    pub(crate) fn queue(self, approach: usize, count: usize) -> At<'a> {
        self.row(approach, count, 0.0)
    }

    /// Puts cars with this speed on an approach, one behind the other from the stop line on.
    pub(crate) fn row(self, approach: usize, count: usize, mps: f64) -> At<'a> {
        let placed: Vec<(f64, f64)> = (0..count).map(|car| (7.5 * car as f64, mps)).collect();
        self.cars(approach, &placed)
    }

    pub(crate) fn exit(mut self, exit: usize, count: usize, mps: f64) -> At<'a> {
        self.exits[exit] = cars(&vec![(5.0, mps); count]);
        self
    }

    /// The memory of the cars lives as long as the test.
    pub(crate) fn build(self) -> Intersection<'a> {
        let At { plan, shown, shown_steps, approaches, exits } = self;
        let [approaches, exits] =
            [approaches, exits].map(|lanes| CarsAt::all(Box::leak(Box::new(CarTable::of(lanes)))));
        Intersection { plan, agent: AgentId(0), shown, shown_steps, approaches, exits }
    }
}

/// Returns cars at these positions with these speeds.
fn cars(placed: &[(f64, f64)]) -> Vec<(CarId, f64, f64)> {
    placed.iter().zip(0..).map(|(&(position_m, speed_mps), number)| (CarId(number), position_m, speed_mps)).collect()
}
