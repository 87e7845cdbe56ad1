//! Trained policies of a run: their weights, and the decisions of all agents in episodes that the Python process plays.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use dials_core::base::{AgentId, Ragged, Seed};
use dials_core::domain::{Action, Controller, Domain, JointPercept};
use dials_learn::evaluation::episode_seed;
use dials_learn::policy::{JointPolicy, JointPolicyController, PolicyStack, Selection};
use dials_session::config::RunConfig;
use dials_session::directory::{TrainedRun, open_unchanged, open_with};
use dials_session::domains::open_untried;
use serde_json::{Value, json};
use stacknets::{LARGEST_PARAMETER, Layout};

use crate::agent;
use crate::memory::{Memory, Section};
use crate::request::{PoliciesRequest, ResetRequest};
use crate::wire::Refused;

/// The policies of a run directory, with the memory in which weights, observations and actions are handed over.
pub(crate) struct Policies {
    config: RunConfig,
    domain: Arc<dyn Domain>,
    still_trained_at: Option<u64>,
    selection: Selection,
    /// Who decides. `None`: there are no weights yet.
    controller: Option<JointPolicyController>,
    percept: JointPercept,
    actions: Vec<Action>,
    under_way: bool,
    memory: Memory,
    parameters: Section,
    obs: Section,
    masks: Section,
}

impl Policies {
    pub(crate) fn open(path: &Path, request: &PoliciesRequest, mut memory: Memory) -> Result<Policies> {
        let (selection, read) = match request {
            PoliciesRequest::Read => (Selection::Sampled, Some(open_with(path, open_untried)?)),
            PoliciesRequest::Act { greedy: true } => (Selection::Greedy, None),
            PoliciesRequest::Act { greedy: false } => (Selection::Sampled, None),
        };
        let (config, domain, policies, still_trained_at) = match read {
            Some(TrainedRun { config, domain, policies, still_trained_at, .. }) => {
                (config, domain, policies, still_trained_at)
            }
            None => {
                let (config, domain) = open_unchanged(path, open_untried)?;
                let policies = blank(&config, &*domain);
                (config, domain, policies, None)
            }
        };
        let percept = JointPercept::new(domain.kinds());
        let parameters = memory.section::<f32>("parameters", policies.as_slice().len(), "f4");
        memory.put(&parameters, policies.as_slice());
        let obs = memory.section::<f32>("obs", percept.obs.as_slice().len(), "f4");
        let masks = memory.section::<bool>("masks", percept.masks.as_slice().len(), "b1");
        let agents = domain.agents();
        let memory = memory.finish(agents)?;
        memory.show()?;
        Ok(Policies {
            config,
            domain,
            still_trained_at,
            selection,
            controller: None,
            percept,
            actions: vec![0; agents],
            under_way: false,
            memory,
            parameters,
            obs,
            masks,
        })
    }

    pub(crate) fn describe(&self) -> Value {
        let kinds = self.domain.kinds();
        let names = self.domain.names();
        let agents = names.iter().zip(AgentId::all(names.len())).map(|(name, id)| {
            let kind = kinds.of(id);
            // Shapes begin with the number of agents, which is one.
            let layout = layout(&self.config, &*self.domain, id);
            let tensors = layout.blocks(1).map(|(name, shape, _)| json!([name, &shape[1..]]));
            let task = self.domain.task(id);
            let mut about = agent::describe(name, kind);
            about.insert("tensors".to_owned(), json!(tensors.collect::<Vec<_>>()));
            about.insert("columns".to_owned(), json!(task.observation));
            about.insert("actions".to_owned(), json!(task.actions));
            about
        });
        json!({
            "agents": agents.collect::<Vec<_>>(),
            "horizon": kinds.horizon(),
            "still_trained_at": self.still_trained_at,
            "memory": self.memory.describe(),
        })
    }

    /// Takes the weights that the Python process has put into the memory.
    pub(crate) fn take(&mut self) -> Result<()> {
        let mut policies = blank(&self.config, &*self.domain);
        self.memory.read(&self.parameters, policies.as_mut_slice())?;
        if let Some(wrong) =
            policies.as_slice().iter().find(|value| !value.is_finite() || value.abs() > LARGEST_PARAMETER)
        {
            return Err(
                Refused(format!("weights: {wrong:e} is not a finite number up to {LARGEST_PARAMETER:e}")).into()
            );
        }
        let kinds = self.domain.kinds();
        self.controller = Some(JointPolicyController::new(kinds, &self.config.learning, &policies, self.selection));
        Ok(())
    }

    /// Begins the episode of `evaluate` with this seed, number `episode`.
    pub(crate) fn reset(&mut self, request: &ResetRequest) -> Result<()> {
        let controller = self.controller.as_mut().context("there are no weights yet")?;
        controller.begin(episode_seed(Seed::new(request.seed), request.episode));
        self.under_way = true;
        Ok(())
    }

    /// Decides for all agents, from the observations and masks in the memory.
    pub(crate) fn step(&mut self) -> Result<()> {
        ensure!(self.under_way, "there is no episode under way; call begin() first");
        let controller = self.controller.as_mut().context("there are no weights yet")?;
        self.memory.read(&self.obs, self.percept.obs.as_mut_slice())?;
        let mut allowed = vec![0_u8; self.percept.masks.as_slice().len()];
        self.memory.read(&self.masks, &mut allowed)?;
        self.percept.masks.as_mut_slice().iter_mut().zip(allowed).for_each(|(to, from)| *to = from != 0);
        controller.act(&self.percept, &mut self.actions)?;
        self.memory.write_actions(&self.actions)
    }
}

fn layout(config: &RunConfig, domain: &dyn Domain, agent: AgentId) -> Layout {
    PolicyStack::shape(&domain.kinds().of(agent).spec, &config.learning.policy).layout()
}

/// Returns policies of the right widths, all of zeros.
fn blank(config: &RunConfig, domain: &dyn Domain) -> JointPolicy {
    Ragged::new(AgentId::all(domain.agents()).into_iter().map(|agent| layout(config, domain, agent).width()))
}
