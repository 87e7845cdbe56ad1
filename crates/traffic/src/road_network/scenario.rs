//! A scenario of the user, with an agent for each light that can learn.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use anyhow::Context;

use super::{Changes, Files, RoadNetwork};
use crate::agents::derive::border::Seconds;
use crate::agents::derive::keeping::sentences;
use crate::agents::derive::padding::{InfluencePadding, Padding};
use crate::agents::derive::warnings::warnings;
use crate::agents::derive::{Agent, Derived, Rules, derive};
use crate::agents::plan::{AgentPlan, Border, JointPlan};
use crate::any_light::AnyLight;
use crate::config::{Reward, ScenarioConfig};
use crate::controllers::actuated;
use crate::cut::local_net::LocalNet;
use crate::cut::names::free_name;
use crate::cut::of_scenario::{cut_all, types_of};
use crate::lane_sets;
use crate::network::loadable::Loadable;
use crate::scenario::SumoScenario;
use crate::sim::local_forest::{LocalParts, driving_options};
use dials_core::domain::{DomainTable, Kinds, RegionSpec, Result, RoughCosts, SourceSpec};

/// Name of the copy that a run keeps.
const KEPT_POLICY: &str = "any_light.safetensors";

/// Share of switches per second of green below which an agent may be stuck: its greens last for more than five minutes on
/// average. Own programs and trained agents are at 0.02 to 0.1. A light that changes as often as it may is at 0.14, which may be right
/// where few cars come.
const STUCK_BELOW: f64 = 1.0 / 300.0;

/// Seconds for which somebody must have stood at its red, too, in the mean of the episodes. A light that keeps its green while nobody
/// waits is right. After 300 s SUMO takes a car away that stands, unless the scenario says otherwise.
const STUCK_WAIT_S: f64 = 240.0;

fn is_stuck(changes: Changes) -> bool {
    changes.p_switch < STUCK_BELOW && changes.longest_wait_s > STUCK_WAIT_S
}

pub(crate) struct ScenarioFiles {
    pub(crate) files: SumoScenario,
    derived: Derived,
    local: OnceLock<Arc<LocalParts>>,
    /// Policy from which new ones start, if the config names a file.
    pub(crate) any_light: Option<AnyLight>,
}

/// Derives the agents of a scenario that was read. An error names file, element and the way out. The agents are of one
/// kind, as wide as the widest of them needs.
pub(crate) fn open(files: SumoScenario, config: &ScenarioConfig) -> Result<(RoadNetwork, JointPlan)> {
    let place = || files.path().display().to_string();
    let roads = files.roads()?;
    let overrides = files.overrides()?;
    let derived = derive(&roads, &Rules::of(config), &overrides).with_context(place)?;
    derived.check_learning(&roads).with_context(place)?;
    let borders = derived.borders(&roads, &files.departs_on(&roads), config.approach_m, Seconds::of(config));
    let refuses_actuated = derived.agents.iter().find_map(|Agent { program, .. }| {
        let states: Vec<_> = program.phases.iter().map(|phase| &phase.state).collect();
        let [one, other] = roads.waiting_for_each_other(&program.light, &states)?;
        Some(format!(
            "{}: SUMO refuses the programs that the controller `actuated` needs here: light `{}` gives `g` to the \
             letters {one} and {other} at once, whose cars yield to each other; choose another controller",
            place(),
            program.light
        ))
    });
    let mut agents = derived.plans();
    lane_sets::make_room(&mut agents);
    let sources = borders.iter().map(|border| border.plan.sources()).collect();
    let plan = JointPlan {
        kinds: Kinds::one(agents.len(), spec(&agents, &borders, config)).with_sources(sources),
        agents,
        borders,
        decision_steps: config.decision_s as usize,
        reward: config.reward.clone(),
        faults: config.detector_faults,
        seen_cars: config.seen_cars.clone(),
        emergency_decel_mps2: None,
    };
    let any_light = config.any_light.as_deref().map(AnyLight::read).transpose().context("traffic.any_light")?;
    let other_view = any_light.as_ref().and_then(|policy| policy.other_view(config));
    let keeps = sentences(&derived.keeping).into_iter().map(|(sentence, _)| sentence);
    let network = RoadNetwork {
        horizon: config.horizon(),
        warm_up_s: config.warm_up_s,
        refuses_actuated,
        rough_costs: rough_costs(f64::from(config.decision_s)),
        unusual_reward: (config.reward != Reward::default()).then(|| config.reward.name()),
        strange_files: vec![files.path().to_owned()],
        left_out: files.notes().left_out.iter().cloned().chain(keeps).collect(),
        warnings: files.guessed_programs().into_iter().chain(warnings(&roads)).chain(other_view).collect(),
        switch_bias: 0.0,
        is_random: files.dawdles(),
        is_stuck,
        rival: "program",
        files: Files::Scenario(Box::new(ScenarioFiles { files, derived, local: OnceLock::new(), any_light })),
    };
    Ok((network, plan))
}

fn spec(agents: &[AgentPlan], borders: &[Border], config: &ScenarioConfig) -> RegionSpec {
    let Padding { columns, actions, .. } = Padding::of(agents.iter());
    let influence = InfluencePadding::of(borders.iter());
    RegionSpec {
        obs_dim: columns,
        d_set_dim: influence.columns,
        n_actions: actions,
        sets: agents.first().and_then(|agent| agent.sensor.sets()).map(|it| it.sets),
        masks: true,
        sources: SourceSpec { parts: influence.parts, ..SourceSpec::bits(influence.sources) },
        horizon: config.horizon(),
        local_horizon: config.local_horizon(),
    }
}

/// Measured with runs on the shipped town and on RESCO's maps, with decisions of 5 s. Between these maps a second of a
/// light differs by a factor of four: lights have from 4 to 20 lanes, and jams cost time.
fn rough_costs(decision_s: f64) -> RoughCosts {
    const LEARNING_S: f64 = 15e-6;
    RoughCosts {
        training_s: LEARNING_S + decision_s * 40e-6,
        training_on_gs_s: LEARNING_S + decision_s * 30e-6,
        influence_s: decision_s * 13e-6,
        evaluation_s: decision_s * 60e-6,
        process_mb: 120.0,
        agent_mb: 4.0,
    }
}

impl ScenarioFiles {
    /// Makes a folder with copies of all files that a config names. Returns their paths in it, in the order of the config's keys.
    pub(super) fn keep_in(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        let mut kept = self.files.keep_in(folder)?;
        if let Some(policy) = &self.any_light {
            policy.write(&folder.join(KEPT_POLICY))?;
            kept.push(PathBuf::from(KEPT_POLICY));
        }
        Ok(kept)
    }

    pub(super) fn name(&self) -> &str {
        self.files.path().file_stem().and_then(|name| name.to_str()).unwrap_or_default()
    }

    /// `playing`: the scenario with the route file of an episode, if there are several.
    pub(super) fn source(&self, playing: Option<&SumoScenario>) -> Result<Loadable> {
        let agents = self.derived.agents.iter();
        let lights = agents.map(|agent| (&agent.program, agent.plan.phases.cars(), agent.limits_of_phases()));
        let roots = [self.files.net()].into_iter().chain(self.files.additional());
        let taken: HashSet<&str> =
            roots.flat_map(|root| root.all("tlLogic")).filter_map(|light| light.attribute("programID")).collect();
        let program = free_name(actuated::PROGRAM, |name| taken.contains(name));
        playing.unwrap_or(&self.files).for_sumo(&actuated::programs(&program, lights), &program)
    }

    /// Returns what local simulators are made of. The first call cuts them out.
    pub(crate) fn local_parts(&self) -> Result<Arc<LocalParts>> {
        if let Some(known) = self.local.get() {
            return Ok(known.clone());
        }
        self.files.check_local()?;
        Ok(self.take_cuts(cut_all(&self.files, &self.derived)?))
    }

    /// Takes the nets of all agents that were cut out before.
    pub(crate) fn take_cuts(&self, nets: Vec<LocalNet>) -> Arc<LocalParts> {
        let parts = || LocalParts {
            nets,
            types: types_of(&self.files),
            steps_per_s: self.files.steps_per_s(),
            may_have_devices: self.files.may_have_devices(),
            options: driving_options(self.files.options()),
            name: self.files.path().display().to_string(),
        };
        self.local.get_or_init(|| Arc::new(parts())).clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_light_is_stuck_if_it_hardly_changes_and_somebody_waits() {
        let stuck = |p_switch, longest_wait_s| is_stuck(Changes { p_switch, longest_wait_s });
        assert!(stuck(0.001, 300.0));
        assert!(!stuck(0.001, 60.0), "it rests while nobody waits for long");
        assert!(!stuck(0.02, 900.0), "it changes, but a jam holds a car");
    }
}
