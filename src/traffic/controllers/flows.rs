//! The flow on each approach, counted by the way while some rule runs the lights.

use std::cell::RefCell;
use std::collections::HashSet;
use std::rc::Rc;

use anyhow::Result;

use super::control::{HandCoded, LightController, Trials};
use super::intersections::Intersections;
use crate::base::{Ragged, RandomPurpose, Seed};
use crate::sumo::CarId;
use crate::traffic::agents::plan::AgentPlan;

/// Cars that were counted.
pub struct Flows {
    /// Number of cars that came to each approach, one row per light.
    pub cars: Ragged<u32>,
    pub seconds: u32,
}

/// Counts cars on the GS (global simulator) on separate episodes, with the lights under this rule.
pub fn measure(
    plans: &[AgentPlan],
    trials: &dyn Trials,
    episodes: u32,
    by: impl LightController + 'static,
) -> Result<Flows> {
    let approaches: Vec<usize> = plans.iter().map(|plan| plan.region.approaches.len()).collect();
    let flows = Rc::new(RefCell::new(Flows { cars: Ragged::new(approaches), seconds: 0 }));
    let counter = Counter { by: Box::new(by), flows: flows.clone(), seen: Vec::new(), is_first: true };
    let mut gs = trials.load_gs(HandCoded::rule(counter))?;
    let mut actions = vec![0; plans.len()];
    for episode in 0..episodes {
        gs.reset(Seed::new(0).fork(RandomPurpose::Webster).for_episode(episode as usize))?;
        for _ in 0..trials.horizon() {
            gs.step(&actions)?;
        }
        // The rule sees the cars before each step. Asked once more, it sees those after the last one.
        gs.advise(&mut actions);
    }
    drop(gs);
    Ok(Rc::into_inner(flows).expect("the simulator that held the other one is gone").into_inner())
}

/// A rule that counts cars and lets another rule decide.
struct Counter {
    by: Box<dyn LightController>,
    flows: Rc<RefCell<Flows>>,
    /// Cars of this episode, for each approach of all lights.
    seen: Vec<HashSet<CarId>>,
    /// Whether it has not been asked in this episode.
    is_first: bool,
}

impl LightController for Counter {
    fn begin(&mut self, episode: Seed) {
        self.seen.clear();
        self.is_first = true;
        self.by.begin(episode);
    }

    fn act(&mut self, intersections: &Intersections<'_>, targets: &mut [usize]) {
        let mut flows = self.flows.borrow_mut();
        flows.seconds += u32::from(!std::mem::take(&mut self.is_first));
        self.seen.resize_with(intersections.approaches.lanes(), HashSet::new);
        let counts = flows.cars.as_mut_slice().iter_mut().zip(&mut self.seen);
        for ((count, seen), lane) in counts.zip(intersections.approaches.iter()) {
            *count += lane.ids.iter().filter(|&&car| seen.insert(car)).count() as u32;
        }
        self.by.act(intersections, targets);
    }
}
