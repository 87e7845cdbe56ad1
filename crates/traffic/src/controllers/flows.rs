//! The flow on each approach, counted by the way while some rule runs the lights.

use std::cell::RefCell;
use std::collections::HashMap;
use std::rc::Rc;

use anyhow::Result;

use super::control::{HandCoded, LightController};
use super::intersections::Intersections;
use crate::Traffic;
use crate::agents::region_plan::Approach;
use dials_core::base::{AgentId, Ragged, RandomPurpose, Seed};
use dials_core::domain::GlobalSimulator;
use libsumo::CarId;

/// Cars that were counted.
pub(crate) struct Flows {
    /// Number of cars that came to each approach, one row per light. A car that changes lanes counts on the lane of the
    /// road on which it was last.
    pub(crate) cars: Ragged<u32>,
    pub(crate) seconds: u32,
}

/// Counts cars on the GS on separate episodes, with the lights under this rule.
pub(super) fn measure(traffic: &Traffic, episodes: u32, by: impl LightController + 'static) -> Result<Flows> {
    let plans = traffic.plans();
    let approaches: Vec<usize> = plans.iter().map(|plan| plan.region.approaches.len()).collect();
    let flows = Rc::new(RefCell::new(Flows { cars: Ragged::new(approaches), seconds: 0 }));
    let counter = Counter {
        by: Box::new(by),
        flows: flows.clone(),
        roads: plans.iter().map(|plan| roads(&plan.region.approaches)).collect(),
        last: HashMap::new(),
        is_first: true,
    };
    let mut gs = traffic.global(traffic.everywhere(HandCoded::rule(counter)))?;
    let mut actions = vec![0; plans.len()];
    for episode in 0..episodes {
        gs.reset(Seed::new(0).fork(RandomPurpose::Webster).for_episode(episode as usize))?;
        for _ in 0..traffic.about().horizon {
            gs.step(&actions)?;
        }
        // The rule sees the cars before each step. Asked once more, it sees those after the last one.
        gs.advise(&mut actions);
    }
    drop(gs);
    Ok(Rc::into_inner(flows).expect("the simulator that held the other one is gone").into_inner())
}

/// Returns the road of each approach: the index of the first approach on the same road.
fn roads(approaches: &[Approach]) -> Vec<usize> {
    let road = |approach: &Approach| approach.lane.rsplit_once('_').map(|(road, _)| road.to_owned());
    approaches
        .iter()
        .map(|approach| approaches.iter().position(|other| road(other) == road(approach)).expect("it is one of them"))
        .collect()
}

/// A car on a road of a light.
type CarOnRoad = (AgentId, usize, CarId);

/// Counts a car on an approach, and no longer on the one of the same road where it was before.
fn count(counts: &mut [u32], last: &mut HashMap<CarOnRoad, usize>, car: CarOnRoad, approach: usize) {
    if let Some(before) = last.insert(car, approach) {
        counts[before] -= 1;
    }
    counts[approach] += 1;
}

/// A rule that counts cars and lets another rule decide.
struct Counter {
    by: Box<dyn LightController>,
    flows: Rc<RefCell<Flows>>,
    /// The road of each approach, for each light.
    roads: Vec<Vec<usize>>,
    /// The approach on which a car of this episode was last.
    last: HashMap<CarOnRoad, usize>,
    /// Whether it has not been asked in this episode.
    is_first: bool,
}

impl LightController for Counter {
    fn begin(&mut self, episode: Seed) {
        self.last.clear();
        self.is_first = true;
        self.by.begin(episode);
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        let mut flows = self.flows.borrow_mut();
        flows.seconds += u32::from(!std::mem::take(&mut self.is_first));
        for at in intersections.iter() {
            let counts = flows.cars.row_mut(at.agent.0);
            for (approach, (lane, &road)) in at.approaches.iter().zip(&self.roads[at.agent.0]).enumerate() {
                lane.ids.iter().for_each(|&car| count(counts, &mut self.last, (at.agent, road, car), approach));
            }
        }
        self.by.act(intersections, targets);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::{crossing, middle};

    #[test]
    fn lanes_side_by_side_are_one_road() {
        assert_eq!(roads(&crossing().region.approaches), [0, 0, 2, 3, 4]);
        assert_eq!(roads(&middle().region.approaches), [0, 1, 2, 3]);
    }

    #[test]
    fn a_car_that_changes_lanes_counts_on_the_last_one() {
        let (mut counts, mut last) = ([0; 3], HashMap::new());
        let mut seen = |car, road, approach| {
            count(&mut counts, &mut last, (AgentId(0), road, CarId(car)), approach);
            counts
        };
        assert_eq!(seen(5, 0, 0), [1, 0, 0]);
        assert_eq!(seen(5, 0, 0), [1, 0, 0]);
        assert_eq!(seen(6, 0, 0), [2, 0, 0]);
        assert_eq!(seen(5, 0, 1), [1, 1, 0]);
        assert_eq!(seen(5, 2, 2), [1, 1, 1], "on another road it counts again");
    }
}
