//! What spoils the LS of a light, read off the recorded episode on the GS.

use std::ops::Range;

use super::truth::Truth;
use crate::Traffic;
use crate::agents::border_plan::{BorderPlan, EntryPlace};
use crate::inflow::is_blocked;
use dials_core::base::AgentId;
use dials_core::domain::Result;

/// Length below which a road is short, in metres: a car is through in a few seconds, and chooses its lane before.
pub(crate) const SHORT_M: f64 = 30.0;
/// How far behind its beginning the last car of a full exit stands at most, in metres: another one does not fit in.
const FULL_M: f64 = 15.0;
/// Speed below which a car on an exit is in a jam, in metres per second.
const JAMMED_MPS: f64 = 1.0;

/// What spoils an LS.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Causes {
    /// Share of the seconds in which cars stand at green because their exit is full.
    pub spillback: f64,
    /// Share of the cars that come in by a road shorter than [`SHORT_M`].
    pub short_entries: f64,
}

impl Causes {
    /// Finds them for a light in a window of the recorded episode.
    pub(crate) fn of(truth: &Truth, traffic: &Traffic, agent: AgentId, window: &Range<usize>) -> Result<Causes> {
        let border = traffic.plan.borders.get(agent.0).map(|border| &border.plan);
        Ok(Causes {
            spillback: spillback(truth, traffic, agent, window)?,
            short_entries: border.map_or(0.0, |border| short_entries(truth, border, agent, window)),
        })
    }
}

fn spillback(truth: &Truth, traffic: &Traffic, agent: AgentId, window: &Range<usize>) -> Result<f64> {
    let region = &traffic.plan.agents[agent.0].region;
    let lanes = region.approaches.iter().map(|approach| &approach.lane);
    let lanes = lanes.chain(region.exits.iter().map(|exit| &exit.lane));
    let mut seconds = 0;
    let steps = truth.recording.steps.iter().zip(truth.on_lanes(lanes.map(String::as_str))?);
    for (step, cars) in steps.skip(window.start).take(window.len()) {
        let letters = step.signals[agent.0].as_str().as_bytes();
        let is_held = |from: usize, to: usize| {
            let (approach, exit) = (&region.approaches[from], cars.lane(region.approaches.len() + to));
            let last = exit.iter().next();
            let is_full = last.is_some_and(|car| car.position_m < FULL_M && car.speed_mps < JAMMED_MPS);
            is_full && is_blocked(cars.lane(from), approach.length_m)
        };
        let green = region.links.iter().filter(|link| matches!(letters[link.letter], b'G' | b'g'));
        seconds += usize::from(green.into_iter().any(|link| is_held(link.from, link.to)));
    }
    Ok(seconds as f64 / window.len().max(1) as f64)
}

fn short_entries(truth: &Truth, border: &BorderPlan, agent: AgentId, window: &Range<usize>) -> f64 {
    let Some(visits) = &truth.visits else { return 0.0 };
    let visits = visits.of_agents[agent.0].iter().filter(|visit| window.contains(&visit.second));
    let is_short = visits.filter_map(|visit| match border.entries[visit.entry?].place {
        EntryPlace::Lane(lane) => Some(border.lanes[lane].length_m < SHORT_M),
        // A car that departs inside does not come in by a road.
        EntryPlace::Road(_) => Some(false),
    });
    let is_short: Vec<bool> = is_short.collect();
    is_short.iter().filter(|&&is_short| is_short).count() as f64 / is_short.len().max(1) as f64
}
