//! The d-set of a scenario's light: what its AIP sees, all from within the region. The same on the GS and on an LS.
//!
//! Its columns, in this order:
//! 1. the part of the episode, one-hot, a quarter of an hour each; then the share of the episode that is over;
//! 2. the light, as in the observation;
//! 3. cars on stretches of the approaches and exits, from the lane's end on;
//! 4. room at the beginning of each entry lane: the distance to its last car;
//! 5. arrivals at each entry in the last decision, in 10 s, 30 s and 60 s;
//! 6. whether each exit was blocked in the last decision.
//!
//! All of them are from 0 to 1.

use super::agents::border_plan::{BorderPlan, EntryPlace};
use super::agents::plan::AgentPlan;
use super::agents::sensor::LightColumns;
use super::cars_at::CarsAt;
use super::inflow::{History, REMEMBERED_S};
use super::observe::{self, JAM_M, LightView};

const STRETCH_M: f64 = 10.0;
const EXIT_SEEN_M: f64 = 60.0;
/// Room beyond which it does not matter, in metres.
const MOST_ROOM_M: f64 = 50.0;
/// Seconds over which arrivals are counted, besides the last decision.
const WINDOWS_S: [usize; 3] = [10, 30, REMEMBERED_S];
/// Least number of seconds from one car to the next on a lane: arrivals are counted as shares of as many.
const HEADWAY_S: f32 = 2.0;

/// The parts of an episode, within which constant predictors are constant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Parts {
    pub(crate) count: usize,
    pub(crate) episode_s: usize,
}

impl Parts {
    /// Length of a part in seconds, if there are not too many.
    const PART_S: usize = 900;
    const MOST: usize = 24;

    pub(crate) fn of(episode_s: usize) -> Parts {
        Parts { count: episode_s.div_ceil(Parts::PART_S).clamp(1, Parts::MOST), episode_s }
    }

    /// Returns the part in which a second of the episode lies. The end belongs to the last one.
    pub(crate) fn part(self, second: usize) -> usize {
        (second * self.count / self.episode_s.max(1)).min(self.count - 1)
    }
}

#[derive(Clone, Debug, PartialEq)]
pub struct DSetPlan {
    parts: Parts,
    light: LightColumns,
    seen: Vec<SeenLane>,
    windows_s: Vec<usize>,
}

#[derive(Clone, Debug, PartialEq)]
struct SeenLane {
    lane: usize,
    stretches: usize,
}

impl DSetPlan {
    /// Makes the d-set of an agent that sees cars up to `approach_m` before its stop lines.
    pub(crate) fn of(plan: &AgentPlan, border: &BorderPlan, approach_m: f64, parts: Parts) -> DSetPlan {
        let stretches = |seen_m: f64| (seen_m / STRETCH_M).ceil() as usize;
        let approaches = plan.region.approaches.iter().map(|approach| {
            let lane = border.lanes.iter().position(|lane| lane.lane == approach.lane);
            let lane = lane.expect("approaches are lanes of the region");
            SeenLane { lane, stretches: stretches(approach.length_m.min(approach_m - approach.ahead_m)) }
        });
        let exits = border
            .exits
            .iter()
            .map(|&lane| SeenLane { lane, stretches: stretches(border.lanes[lane].length_m.min(EXIT_SEEN_M)) });
        let windows_s = [border.decision_s].into_iter().chain(WINDOWS_S).collect();
        DSetPlan { parts, light: plan.sensor.light, seen: approaches.chain(exits).collect(), windows_s }
    }

    /// Returns the number of parts of an episode. The first columns are their one-hot.
    pub(crate) fn parts(&self) -> usize {
        self.parts.count
    }

    pub fn columns(&self, border: &BorderPlan) -> Vec<String> {
        let mut names: Vec<String> = (0..self.parts.count).map(|part| format!("part of the episode[{part}]")).collect();
        names.push("share of the episode".to_owned());
        names.extend(self.light.names());
        names.extend(self.seen.iter().flat_map(|seen| {
            let lane = &border.lanes[seen.lane].lane;
            (0..seen.stretches).map(move |stretch| format!("cars {lane}[{stretch}]"))
        }));
        names.extend(entry_lanes(border).map(|lane| format!("room {}", border.lanes[lane].lane)));
        names.extend((0..border.entries.len()).flat_map(|entry| {
            let name = border.entry_name(entry);
            self.windows_s.iter().map(move |window| format!("arrivals {name} in {window} s"))
        }));
        names.extend(border.exits.iter().map(|&lane| format!("blocked {}", border.lanes[lane].lane)));
        names
    }

    pub fn width(&self, border: &BorderPlan) -> usize {
        self.columns(border).len()
    }

    /// Writes the d-set. Columns beyond its width become 0. `cars`: those on all lanes of the border, in its order. The
    /// age of the light is the second of the episode.
    pub(crate) fn write(
        &self,
        border: &BorderPlan,
        cars: CarsAt<'_>,
        light: LightView,
        history: &History,
        d_set: &mut [f32],
    ) {
        d_set.fill(0.0);
        let mut columns = d_set;
        let mut take = |count: usize| columns.split_off_mut(..count).expect("as wide as the widest d-set");
        take(self.parts.count)[self.parts.part(light.age)] = 1.0;
        take(1)[0] = light.age as f32 / self.parts.episode_s.max(1) as f32;
        observe::show(self.light, light, take(self.light.columns()));
        for seen in &self.seen {
            let stretches = take(seen.stretches);
            let length_m = border.lanes[seen.lane].length_m;
            for position_m in cars.lane(seen.lane).positions_m {
                let stretch = ((length_m - position_m).max(0.0) / STRETCH_M) as usize;
                if let Some(share) = stretches.get_mut(stretch) {
                    *share = (*share + (JAM_M / STRETCH_M) as f32).min(1.0);
                }
            }
        }
        for lane in entry_lanes(border) {
            let room_m = cars.lane(lane).positions_m.first().copied().unwrap_or(MOST_ROOM_M);
            take(1)[0] = (room_m / MOST_ROOM_M).clamp(0.0, 1.0) as f32;
        }
        for entry in 0..border.entries.len() {
            for &window_s in &self.windows_s {
                let most = (window_s.min(REMEMBERED_S) as f32 / HEADWAY_S).max(1.0);
                take(1)[0] = (history.arrivals(entry, window_s) as f32 / most).min(1.0);
            }
        }
        for exit in 0..border.exits.len() {
            take(1)[0] = f32::from(u8::from(history.blocked[exit]));
        }
    }
}

/// Returns the lanes that are entries, as indices into the lanes of the border.
fn entry_lanes(border: &BorderPlan) -> impl Iterator<Item = usize> {
    border.entries.iter().filter_map(|entry| match entry.place {
        EntryPlace::Lane(lane) => Some(lane),
        EntryPlace::Road(_) => None,
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::agents::derive::border::Seconds;
    use crate::agents::derive::overrides::Overrides;
    use crate::agents::derive::{Rules, derive};
    use crate::agents::phase_plan::Shown;
    use crate::agents::plan::Border;
    use crate::network::roads::example::{LIGHT_AT_U, roads};
    use libsumo::{CarId, CarTable};

    /// Returns the border of the light J on a net with some texts replaced. Two lanes of the road `near` lead to J, cars
    /// depart on `north`, another light is before J, and an episode has half an hour.
    pub(crate) fn border_of(changes: &[(&str, &str)]) -> Border {
        let roads = roads(&[&LIGHT_AT_U, changes].concat());
        let derived = derive(&roads, &Rules::default(), &Overrides::default()).unwrap();
        let departs_on = BTreeSet::from([roads.edge_named("north").unwrap()]);
        derived.borders(&roads, &departs_on, 150.0, Seconds { decision: 5, episode: 1800 }).remove(0)
    }

    #[test]
    fn every_column_has_its_place_and_its_name() {
        let Border { plan, d_set } = border_of(&[]);
        // Lanes of J's region: near_0, near_1, north_0, out_0, back_0. Entries: the first two, and `north`. Exit: back_0.
        let names = d_set.columns(&plan);
        assert_eq!((names.len(), d_set.width(&plan), d_set.parts()), (47, 47, 2));
        let mut cars = vec![Vec::new(); plan.lanes.len()];
        // 50 m long: 5 m and 12 m before the end, two cars in the fifth stretch, the last one 2.5 m behind the border.
        cars[0] = vec![(CarId(1), 2.5, 0.0), (CarId(2), 9.0, 0.0), (CarId(3), 38.0, 5.0), (CarId(4), 45.0, 5.0)];
        cars[4] = vec![(CarId(5), 49.0, 0.0)];
        let mut history = History::new(&plan);
        let mut sources = vec![0; plan.sources()];
        sources[plan.arrival(0, 4)] = 1;
        sources[plan.arrival(0, 1)] = 1;
        sources[plan.blocked(0, plan.parts() - 1)] = 1;
        history.note(&plan, &sources);
        let table = CarTable::of(cars);
        let light = LightView { shown: Shown::Between { from: 0, to: 1 }, shown_steps: 3, age: 900, clock: 900 };
        let mut row = vec![9.0; 50];
        d_set.write(&plan, CarsAt::all(&table), light, &history, &mut row);
        let found: Vec<(&str, f32)> = names
            .iter()
            .zip(&row)
            .filter(|(_, value)| **value != 0.0)
            .map(|(name, &value)| (name.as_str(), value))
            .collect();
        let expected = [
            ("part of the episode[1]", 1.0),
            ("share of the episode", 0.5),
            ("green[1]", 1.0),
            ("between greens", 1.0),
            ("time since change", 0.05),
            ("cars near_0[0]", 0.75),
            ("cars near_0[1]", 0.75),
            ("cars near_0[4]", 1.0), // two cars of 7.5 m on 10 m
            ("cars back_0[0]", 0.75),
            ("room near_0", 0.05),
            ("room near_1", 1.0),
            ("arrivals near_0 in 5 s", 0.8), // 2 of 2.5
            ("arrivals near_0 in 10 s", 0.4),
            ("arrivals near_0 in 30 s", 2.0 / 15.0),
            ("arrivals near_0 in 60 s", 2.0 / 30.0),
            ("blocked back_0", 1.0),
        ];
        assert_eq!(found, expected);
        assert!(row[47..].iter().all(|&value| value == 0.0), "what wider d-sets need");
    }

    #[test]
    fn an_hour_has_four_parts_and_a_day_has_24() {
        let hour = Parts::of(3600);
        let parts: Vec<usize> = [0, 899, 900, 3599, 3600].map(|second| hour.part(second)).into();
        assert_eq!((hour.count, parts), (4, vec![0, 0, 1, 3, 3]));
        let day = Parts::of(86_400);
        assert_eq!((day.count, day.part(3599), day.part(3600)), (24, 0, 1));
        assert_eq!((Parts::of(300).count, Parts::of(0).count), (1, 1));
    }
}
