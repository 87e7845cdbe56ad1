//! How far the local simulators (LS) of the lights are like the global simulator (GS), measured.
//!
//! The GS plays one episode under random greens. The LS of each light then plays it again: the same greens, the same
//! blocked exits, and the cars that came to its region, of the same types and ways. It does so twice. With *true entries*
//! every car begins exactly where and as fast as it was seen first. With *sampled entries* it comes as cars come in
//! training: by the entry rule, at the true second and on the true lane. Where the two simulators have cars is compared,
//! second by second, in cells of 10 m of the approaches.
//!
//! - [`truth`]: the episode on the GS. `on_scenario`, `on_grid`: the LS plays it again.
//! - [`seen`]: what is compared of a light. [`agreement`]: how far two of them agree.
//! - `causes`: what spoils an LS. [`doubts`]: whether it can be trusted, and the limits.

pub mod agreement;
mod causes;
pub mod doubts;
mod on_grid;
mod on_scenario;
pub(crate) mod seen;
pub mod truth;

use std::ops::Range;
use std::sync::Arc;

use super::Traffic;
use crate::sim::local_forest::LocalParts;
use crate::sim::visit_tables::VisitTables;
use agreement::Comparison;
pub use causes::Causes;
use dials_core::base::AgentId;
use dials_core::domain::Result;
use truth::Truth;

/// What was measured of one light.
#[derive(Clone, Debug, PartialEq)]
pub struct LightFidelity {
    pub agent: AgentId,
    /// SUMO's name of the light.
    pub light: String,
    /// GS and LS if cars begin exactly as they were seen first.
    pub true_entries: Comparison,
    /// GS and LS if cars come in as in training.
    pub sampled_entries: Comparison,
    /// Two LSs with true entries and other random numbers of SUMO. `None`: nothing is random.
    pub other_seed: Option<Comparison>,
    pub causes: Causes,
}

/// How cars come into an LS.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Entering {
    /// Each exactly where and as fast as it was seen first.
    Truly,
    /// By the rule of the training.
    ByRule,
}

/// Measures lights one after the other.
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
        let scenario = traffic.ground.local_parts()?.map(|parts| (parts, visits()));
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
        let other_seed = match self.traffic.about().is_random {
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
}
