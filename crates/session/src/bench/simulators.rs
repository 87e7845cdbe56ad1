//! What the simulators cost by themselves, in core-microseconds per agent and step of the simulator. For traffic that is a
//! light, or the local region of one, for a second.

use serde_json::{Value, json};

use super::costs::per_unit;
use super::measure::{Measured, Orders};
use crate::config::RunConfig;
use dials_core::base::Phase;
use dials_core::domain::Kinds;
use dials_learn::config::Simulator;

/// Unit of all costs of steps, for people and programs.
pub(crate) const UNIT: &str = "core-microseconds per agent and step of the simulator";

/// Our work around a simulator's own step.
const AROUND: [Phase; 2] = [Phase::Insertion, Phase::Reading];
/// All work on a sample of training that is not the simulator's.
const LEARNING: [Phase; 6] =
    [Phase::Acting, Phase::AipSampling, Phase::Bookkeeping, Phase::Forward, Phase::Backward, Phase::Adam];

/// Cost of one step of a simulator for one agent, in core-microseconds. Making simulators and beginning episodes is not
/// in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct StepCost {
    /// Inside the simulator's own step.
    pub(crate) own_us: f64,
    /// Around it: setting lights, letting cars in, reading.
    pub(crate) around_us: f64,
}

/// Costs of the simulators of a run, and of learning for comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct SimulatorCosts {
    /// Number of the simulator's steps in a timestep.
    pub(crate) steps_per_timestep: usize,
    /// The GS (global simulator) in evaluations.
    pub(crate) gs: StepCost,
    /// The GS while datasets are collected: it also observes the influence on the local regions.
    pub(crate) gs_collecting: Option<StepCost>,
    /// What the policies train on.
    pub(crate) training: StepCost,
    pub(crate) trains_on_gs: bool,
    /// Everything else in training, per agent and timestep.
    pub(crate) learning_us: f64,
}

impl SimulatorCosts {
    /// `steps_per_timestep`: number of the simulator's steps in a timestep.
    pub(crate) fn of(
        config: &RunConfig,
        kinds: &Kinds,
        steps_per_timestep: usize,
        measured: &Measured,
    ) -> SimulatorCosts {
        let steps = steps_per_timestep as f64;
        // An episode of each worker is that many steps of agents.
        let of_episode = (measured.workers * kinds.horizon() * kinds.agents()) as f64 * steps;
        let cost = |orders: &Orders, steps_per_unit: f64| StepCost {
            own_us: per_unit(orders, Phase::SimulatorStep) / steps_per_unit,
            around_us: AROUND.iter().map(|&phase| per_unit(orders, phase)).sum::<f64>() / steps_per_unit,
        };
        let collection = &measured.collection;
        SimulatorCosts {
            steps_per_timestep,
            gs: cost(&measured.evaluation, of_episode),
            gs_collecting: (collection.count > 0).then(|| cost(collection, of_episode)),
            training: cost(&measured.training, steps),
            trains_on_gs: config.learning.simulator == Simulator::Global,
            learning_us: LEARNING.iter().map(|&phase| per_unit(&measured.training, phase)).sum(),
        }
    }

    /// Returns the name of each simulator with its cost.
    pub(crate) fn named(&self) -> Vec<(&'static str, StepCost)> {
        let trained = if self.trains_on_gs { "GS in training" } else { "LS in training" };
        let collecting = self.gs_collecting.map(|cost| ("GS in collection", cost));
        [("GS in evaluation", self.gs)].into_iter().chain(collecting).chain([(trained, self.training)]).collect()
    }

    pub(crate) fn json(&self) -> Value {
        let cost = |cost: StepCost| json!({ "step_us": cost.own_us, "around_us": cost.around_us });
        let on = |is_it: bool| is_it.then(|| cost(self.training));
        json!({
            "unit": UNIT,
            "steps_per_timestep": self.steps_per_timestep,
            "gs_in_evaluation": cost(self.gs),
            "gs_in_collection": self.gs_collecting.map(cost),
            "gs_in_training": on(self.trains_on_gs),
            "ls_in_training": on(!self.trains_on_gs),
            "learning_us_per_agent_step": self.learning_us,
        })
    }
}
