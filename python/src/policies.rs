//! Trained policies of a run: their weights, and the decisions of all agents in episodes that the Python process plays.

use std::path::Path;

use anyhow::{Result, ensure};
use dials_core::base::{AgentId, Seed};
use dials_core::domain::{Action, Controller, JointPercept};
use dials_learn::evaluation::episode_seed;
use dials_learn::policy::{JointPolicyController, PolicyStack, Selection};
use dials_session::directory::{TrainedRun, open_with};
use dials_session::domains::open_tried;
use serde_json::{Value, json};

use crate::agent;
use crate::memory::{Memory, Section};
use crate::request::{PoliciesRequest, ResetRequest};

/// The policies of a run directory, with the memory in which observations and actions are handed over.
pub(crate) struct Policies {
    run: TrainedRun,
    controller: JointPolicyController,
    percept: JointPercept,
    actions: Vec<Action>,
    under_way: bool,
    memory: Memory,
    obs: Section,
    masks: Section,
}

impl Policies {
    pub(crate) fn open(path: &Path, request: &PoliciesRequest, mut memory: Memory) -> Result<Policies> {
        let run = open_with(path, open_tried)?;
        let selection = if request.greedy { Selection::Greedy } else { Selection::Sampled };
        let percept = JointPercept::new(run.domain.kinds());
        let parameters = run.policies.as_slice();
        let section = memory.section::<f32>("parameters", parameters.len(), "f4");
        memory.put(&section, parameters);
        let obs = memory.section::<f32>("obs", percept.obs.as_slice().len(), "f4");
        let masks = memory.section::<bool>("masks", percept.masks.as_slice().len(), "b1");
        let agents = run.domain.agents();
        let memory = memory.finish(agents)?;
        memory.show()?;
        let controller = run.controller(selection);
        Ok(Policies { controller, percept, actions: vec![0; agents], under_way: false, memory, obs, masks, run })
    }

    pub(crate) fn describe(&self) -> Value {
        let kinds = self.run.domain.kinds();
        let names = self.run.domain.names();
        let agents = names.iter().zip(AgentId::all(names.len())).map(|(name, id)| {
            let kind = kinds.of(id);
            let layout = PolicyStack::shape(&kind.spec, &self.run.config.learning.policy).layout();
            // Shapes begin with the number of agents, which is one.
            let tensors = layout.blocks(1).map(|(name, shape, _)| json!([name, &shape[1..]]));
            let mut about = agent::describe(name, kind);
            about.insert("tensors".to_owned(), json!(tensors.collect::<Vec<_>>()));
            about
        });
        json!({
            "agents": agents.collect::<Vec<_>>(),
            "horizon": kinds.horizon(),
            "still_trained_at": self.run.still_trained_at,
            "memory": self.memory.describe(),
        })
    }

    /// Begins the episode of `evaluate` with this seed, number `episode`.
    pub(crate) fn reset(&mut self, request: &ResetRequest) -> Result<()> {
        self.controller.begin(episode_seed(Seed::new(request.seed), request.episode));
        self.under_way = true;
        Ok(())
    }

    /// Decides for all agents, from the observations and masks in the memory.
    pub(crate) fn step(&mut self) -> Result<()> {
        ensure!(self.under_way, "there is no episode under way; call begin() first");
        self.memory.read(&self.obs, self.percept.obs.as_mut_slice())?;
        let mut allowed = vec![0_u8; self.percept.masks.as_slice().len()];
        self.memory.read(&self.masks, &mut allowed)?;
        self.percept.masks.as_mut_slice().iter_mut().zip(allowed).for_each(|(to, from)| *to = from != 0);
        self.controller.act(&self.percept, &mut self.actions)?;
        self.memory.write_actions(&self.actions)
    }
}
