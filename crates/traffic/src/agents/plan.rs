//! The plans of agents: their lights, local regions and sensors. Simulators and controllers follow them.

use std::sync::Arc;

use super::border_plan::BorderPlan;
use super::others_plan::OthersPlan;
use super::phase_plan::PhasePlan;
use super::region_plan::RegionPlan;
use super::sensor::{CarColumns, Sensor};
use crate::config::{DetectorFaults, Reward, SeenCars};
use crate::d_set::DSetPlan;
use dials_core::domain::Kinds;

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct JointPlan {
    pub(crate) agents: Vec<AgentPlan>,
    /// Borders of the regions and the d-sets of the AIPs. Empty on the paper's grids: there the approaches are the
    /// influence sources, and the observations hold the d-sets.
    pub(crate) borders: Vec<Border>,
    pub(crate) kinds: Kinds,
    /// Number of steps of SUMO, seconds, from one decision of the agents to the next.
    pub(crate) decision_steps: usize,
    pub(crate) reward: Reward,
    /// Faults of the detectors, if agents see detectors.
    pub(crate) faults: DetectorFaults,
    /// Share of the cars that agents see which see lanes.
    pub(crate) seen_cars: SeenCars,
    /// Deceleration in metres per second squared above which braking is an emergency. `None` if cars of several types
    /// drive: then only the stops are counted that SUMO calls emergencies.
    pub(crate) emergency_decel_mps2: Option<f64>,
}

/// Where traffic from outside reaches a region, and what its AIP sees.
#[derive(Clone, Debug, PartialEq)]
pub struct Border {
    pub plan: BorderPlan,
    pub d_set: DSetPlan,
}

#[derive(Clone, Debug, PartialEq)]
pub struct AgentPlan {
    pub light: String,
    /// Place of the intersection in the net's coordinates, in metres.
    pub place_m: [f64; 2],
    pub region: RegionPlan,
    /// Who else comes to the light. Nobody on a grid.
    pub others: OthersPlan,
    pub phases: Arc<PhasePlan>,
    pub sensor: Sensor,
}

impl JointPlan {
    /// Returns whether its agents see lanes and greens as sets: all of them or none.
    pub(crate) fn sees_sets(&self) -> bool {
        self.agents.first().is_some_and(|agent| agent.sensor.sets().is_some())
    }

    /// Returns whether its agents see detectors: all of them or none.
    pub(crate) fn sees_detectors(&self) -> bool {
        self.agents.first().is_some_and(|agent| match agent.sensor.cars {
            CarColumns::Detectors(_) => true,
            CarColumns::Sets(_) => self.seen_cars.may_be_none(),
            CarColumns::Cells(_) | CarColumns::QueueAndDensity(_) => false,
        })
    }
}

impl AgentPlan {
    /// Returns the number of columns of its observation.
    pub fn width(&self) -> usize {
        self.sensor.width(&self.region, &self.others)
    }

    /// Returns the name of every column of its observation.
    pub fn columns(&self) -> Vec<String> {
        self.sensor.columns(&self.region, &self.others)
    }

    /// Returns the share of an approach's links that have green: cars on a lane may want any of its links.
    pub(crate) fn share(&self, green: usize, approach: usize) -> f64 {
        let links = &self.region.approaches[approach].links;
        let served = links.iter().filter(|&&link| self.opens(green, link)).count();
        // An approach without links leads nowhere that a light could open.
        served as f64 / links.len().max(1) as f64
    }

    /// Returns the share of an approach's links that have green with priority.
    pub(crate) fn share_with_priority(&self, green: usize, approach: usize) -> f64 {
        let links = &self.region.approaches[approach].links;
        let first = links.iter().filter(|&&link| self.letter(green, link) == b'G').count();
        first as f64 / links.len().max(1) as f64
    }

    pub(crate) fn serves(&self, green: usize, approach: usize) -> bool {
        self.region.approaches[approach].links.iter().any(|&link| self.opens(green, link))
    }

    pub fn served(&self, green: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.region.approaches.len()).filter(move |&approach| self.serves(green, approach))
    }

    pub(crate) fn opens(&self, green: usize, link: usize) -> bool {
        self.letter(green, link).eq_ignore_ascii_case(&b'g')
    }

    /// Returns the greens in which people may begin to walk over a crossing of [`OthersPlan::crossings`].
    pub fn walked_in(&self, crossing: usize) -> Vec<usize> {
        let letters = &self.others.crossings[crossing].letters;
        let lets_walk = |green: &usize| {
            let state = self.phases.greens()[*green].as_str().as_bytes();
            letters.iter().filter_map(|&letter| state.get(letter)).any(|letter| letter.eq_ignore_ascii_case(&b'g'))
        };
        (0..self.greens()).filter(lets_walk).collect()
    }

    /// Returns whether a link has green and no green serves it better: `G`, or `g` if it never has `G`.
    pub(crate) fn serves_best(&self, green: usize, link: usize) -> bool {
        let has_priority = |green: usize| self.letter(green, link) == b'G';
        has_priority(green) || self.letter(green, link) == b'g' && !(0..self.greens()).any(has_priority)
    }

    pub(crate) fn greens(&self) -> usize {
        self.phases.greens().len()
    }

    fn letter(&self, green: usize, link: usize) -> u8 {
        self.phases.greens()[green].as_str().as_bytes()[self.region.links[link].letter]
    }
}
