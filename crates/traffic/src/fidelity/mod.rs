//! How far the local simulators (LS) of the lights are like the global simulator (GS), measured.
//!
//! The GS plays one episode under random greens. The LS of each light then plays it again: the same greens, the same
//! blocked exits, and the cars that came to its region, of the same types and ways. It does so twice. With *true entries*
//! every car begins exactly where and as fast as it was seen first. With *sampled entries* it comes as cars come in
//! training: by the entry rule, at the true second and on the true lane. Where the two simulators have cars is compared,
//! second by second, in cells of 10 m of the approaches.

pub mod agreement;
pub mod doubts;
mod on_scenario;
pub mod truth;

use std::ops::Range;
use std::sync::Arc;

use super::Traffic;
use super::road_network::Files;
use crate::agents::region::EDGES;
use crate::inflow::has_arrival;
use crate::sim::local::Placement;
use crate::sim::local_forest::LocalParts;
use crate::sim::visit_tables::VisitTables;
use agreement::{Comparison, Seen};
use dials_core::base::{AgentId, Rows};
use dials_core::domain::{Beginning, LocalSimulator, Result};
pub use doubts::Causes;
use libsumo::{CarTable, DepartSpeed};
use truth::Truth;

#[derive(Clone, Debug, PartialEq)]
pub struct LightFidelity {
    pub agent: AgentId,
    pub light: String,
    /// GS and LS if cars begin exactly as they were seen first.
    pub true_entries: Comparison,
    /// GS and LS if cars come in as in training.
    pub sampled_entries: Comparison,
    /// Two LSs with true entries and other random numbers of SUMO. `None`: nothing is random.
    pub other_seed: Option<Comparison>,
    pub causes: Causes,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Entering {
    Truly,
    ByRule,
}

pub struct Fidelity<'a> {
    traffic: &'a Traffic,
    truth: &'a Truth,
    window: Range<usize>,
    /// What the LSs of a scenario are made of, and the recorded visits.
    scenario: Option<(Arc<LocalParts>, VisitTables)>,
}

impl<'a> Fidelity<'a> {
    /// Prepares to compare the seconds `window` of a recorded episode. Nothing of it is simulated yet.
    pub fn new(traffic: &'a Traffic, truth: &'a Truth, window: Range<usize>) -> Result<Fidelity<'a>> {
        let visits = || VisitTables::new(truth.visits.clone().unwrap_or_default(), &traffic.plan.borders);
        let scenario = match &traffic.network.files {
            Files::Scenario(files) => Some((files.local_parts()?, visits())),
            Files::Grid(_) => None,
        };
        Ok(Fidelity { traffic, truth, window, scenario })
    }

    /// Measures a light. SUMO must not be loaded elsewhere in this process.
    pub fn measure(&self, agent: AgentId) -> Result<LightFidelity> {
        let plan = &self.traffic.plan.agents[agent.0];
        let of_gs = self.truth.seen(plan, &self.window)?;
        let seed = self.truth.seed.for_agent(agent);
        let play = |entering, copy| match &self.scenario {
            Some((parts, tables)) => self.play_on_scenario((parts, tables), agent, entering, seed.for_copy(copy)),
            None => self.play_on_grid(agent, entering),
        };
        let true_entries = play(Entering::Truly, 0)?;
        let sampled_entries = play(Entering::ByRule, 0)?;
        let other_seed = match self.traffic.network.is_random {
            true => Some(Comparison::of(&true_entries, &play(Entering::Truly, 1)?)),
            false => None,
        };
        Ok(LightFidelity {
            agent,
            light: plan.light.clone(),
            causes: Causes::of(self.truth, self.traffic, agent, &self.window)?,
            true_entries: Comparison::of(&of_gs, &true_entries),
            sampled_entries: Comparison::of(&of_gs, &sampled_entries),
            other_seed,
        })
    }

    /// Plays the whole recording at a light of a grid. Nothing in it is random.
    fn play_on_grid(&self, agent: AgentId, entering: Entering) -> Result<Seen> {
        let plan = &self.traffic.plan.agents[agent.0];
        let mut ls = self.traffic.local(1)?;
        ls.reset(&Beginning::first([0]))?;
        let mut seen = Seen::new(plan, self.window.clone());
        let mut before = CarTable::of(vec![Vec::new(); EDGES]);
        let recorded = self.truth.actions.iter().zip(&self.truth.sources).zip(self.truth.on_approaches(plan)?);
        for ((actions, sources), now) in recorded {
            let actions = &actions[agent.0..=agent.0];
            match entering {
                Entering::ByRule => ls.step(actions, &Rows::from_vec(sources.row(agent.0).to_vec(), EDGES))?,
                Entering::Truly => ls.step_with(actions, &[placements(&now, &before)])?,
            };
            seen.note(plan, ls.cars_on(0), &[], 0); // Trips end behind the intersection.
            before = now;
        }
        let counted = ls.counters();
        [seen.sums.came, seen.sums.dropped] = [counted[0].1, counted[1].1];
        Ok(seen)
    }
}

/// Returns where and how fast a car came to each edge between two reads.
fn placements(now: &CarTable, before: &CarTable) -> [Option<Placement>; EDGES] {
    std::array::from_fn(|edge| {
        let [now, before] = [now, before].map(|cars| cars.lane(edge));
        let car = now.iter().next().filter(|_| has_arrival(now, before));
        car.map(|car| Placement { position_m: car.position_m, speed: DepartSpeed::Fixed(car.speed_mps) })
    })
}
