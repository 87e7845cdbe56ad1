//! Traffic as a domain: what the training, the evaluation and the command line ask of it.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{bail, ensure};

use crate::any_light::AnyLight;
use crate::controllers::{self, ANY_LIGHT, HandCoded};
use crate::prepared::Prepared;
use crate::road_network::{Changes, Files};
use crate::sim::control::SignalControl;
use crate::sim::local_forest::rows_of;
use crate::sim::tally::{P_SWITCH, WAIT_AT_RED};
use crate::sim::visit_tables::VisitTables;
use crate::{Traffic, light, task, watched};
use dials_core::base::{AgentId, Seed};
use dials_core::domain::roads::RoadTables;
use dials_core::domain::{
    Baseline, BuiltInControl, Domain, GlobalSimulator, Kind, Kinds, LocalSimulator, Measures, Result, RoughCosts,
    Scenario, StartingPolicy, Task,
};

impl Domain for Traffic {
    fn kinds(&self) -> &Kinds {
        self.own.kinds().unwrap_or(&self.plan.kinds)
    }

    fn agent_name(&self, agent: AgentId) -> String {
        self.plan.agents[agent.0].light.clone()
    }

    fn road_tables(&self) -> Result<Option<RoadTables>> {
        let roads = self.network.roads()?;
        Ok(Some(watched::tables(&self.plan, &roads, self.network.travellers().as_ref())))
    }

    fn task(&self, agent: AgentId) -> Task {
        let mut task = task::task(&self.plan, agent);
        self.own.describe(&mut task);
        task
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        self.with_own_rows(Box::new(self.global(SignalControl::Agents)?))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        let rows: Vec<AgentId> = rows_of(regions, copies, seed).into_iter().map(|(agent, _)| agent).collect();
        self.with_own_local(Box::new(self.load_local(regions, copies, seed)?), &rows)
    }

    fn baselines(&self) -> &'static [&'static str] {
        controllers::NAMES
    }

    fn baseline(&self, name: &str) -> Result<Baseline> {
        // Hand-coded control sees more than an observation shows, so it lives in the simulator.
        let simulator = self.with_background(name, &AgentId::all(self.agents()))?;
        Ok(Baseline { simulator, controller: Box::new(BuiltInControl) })
    }

    fn check_baseline(&self, name: &str) -> Result<()> {
        controllers::recipe(name, self.plans()).map(drop)
    }

    fn baseline_warnings(&self, name: &str) -> Result<Vec<String>> {
        controllers::warnings(name, self.plans())
    }

    fn baseline_checksum(&self, name: &str) -> Result<Option<u32>> {
        controllers::checksum(name)
    }

    fn with_background(&self, name: &str, agents: &[AgentId]) -> Result<Box<dyn GlobalSimulator>> {
        let by = self.hand_coded(name)?;
        if let HandCoded::Programs(_) = by {
            ensure!(
                agents.len() == self.agents(),
                "--background {name}: a plan runs all lights, for SUMO switches its programs"
            );
        }
        self.with_own_rows(Box::new(self.global(SignalControl::HandCoded { by, agents: agents.to_vec() })?))
    }

    fn starting_policy(&self, name: &str) -> Result<StartingPolicy> {
        ensure!(name == ANY_LIGHT, "there is no policy `{name}` to start from; write \"{ANY_LIGHT}\"");
        let own = match &self.network.files {
            Files::Scenario(files) => files.any_light.as_ref(),
            Files::Grid(_) => None,
        };
        let shipped = || Ok(AnyLight::shipped(!self.plan.seen_cars.are_all())?.to_start());
        own.map_or_else(shipped, |policy| Ok(policy.to_start()))
    }

    fn initial_action_bias(&self, kind: &Kind) -> Vec<f32> {
        let mut biases = vec![0.0; kind.spec.n_actions];
        if let Some(bias) = biases.get_mut(usize::from(light::SWITCH)) {
            *bias = self.network.switch_bias;
        }
        biases
    }

    fn scenario(&self) -> Result<Scenario> {
        let scenario = self.network.described(self.agents());
        let mut rules = task::rules(&self.plan);
        self.own.describe_rules(&mut rules);
        // A word of letters, digits and hyphens: reports name files after it.
        let word = |name: &str| name.replace(|c: char| !c.is_ascii_alphanumeric(), "-");
        let of_python = self.own.reward().map(|name| format!("python-{}", word(name)));
        Ok(scenario.with_rules(rules, of_python.or(self.network.unusual_reward.clone())))
    }

    fn default_simulator(&self) -> Option<&'static str> {
        Some(match &self.network.files {
            Files::Grid(_) => "configs of the paper's grids train on local simulators, as the paper does",
            Files::Scenario(_) => {
                "a scenario trains on the global simulator (gs) unless its config says otherwise: with the shipped scenarios \
                 that is as good as DIALS (n = 3) and needs no predictors"
            }
        })
    }

    fn rival(&self) -> Option<&'static str> {
        Some(self.network.rival)
    }

    /// For a grid it takes tens of milliseconds; SUMO is closed again.
    fn try_out(&self) -> Result<Vec<String>> {
        self.try_all()
    }

    fn try_local(&self) -> Result<()> {
        self.try_empty_local()
    }

    fn strange_files(&self) -> Vec<PathBuf> {
        self.network.strange_files.clone()
    }

    fn left_out(&self) -> Vec<String> {
        self.network.left_out.clone()
    }

    fn warnings(&self) -> Vec<String> {
        self.network.warnings.clone()
    }

    fn without_locally(&self) -> Vec<String> {
        match &self.network.files {
            Files::Grid(_) => Vec::new(),
            Files::Scenario(files) => files.files.notes().without_locally.clone(),
        }
    }

    fn check_place(&self, folder: &Path) -> Result<()> {
        self.network.check_place(folder)
    }

    fn keep_files(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        self.network.keep_files(folder)
    }

    fn prepare(&self, kept: Option<&[u8]>) -> Result<Option<Vec<u8>>> {
        let Files::Scenario(files) = &self.network.files else { return Ok(None) };
        if let Some(kept) = kept
            && self.take_prepared(kept).is_ok()
        {
            return Ok(Some(kept.to_vec()));
        }
        let (parts, tables) = (files.local_parts()?, self.visits()?);
        let made_from = files.made_from(&self.plan)?;
        Prepared { made_from, nets: Cow::Borrowed(&parts.nets), visits: Cow::Borrowed(tables.visits()) }
            .to_bytes()
            .map(Some)
    }

    fn take_prepared(&self, prepared: &[u8]) -> Result<()> {
        let Files::Scenario(files) = &self.network.files else { bail!("a grid needs nothing that was prepared") };
        let Prepared { made_from, nets, visits } = Prepared::from_bytes(prepared)?;
        ensure!(made_from == files.made_from(&self.plan)?, "they are of other files or settings");
        files.take_cuts(nets.into_owned());
        self.visits.get_or_init(|| Arc::new(VisitTables::new(visits.into_owned(), &self.plan.borders)));
        Ok(())
    }

    fn simulator_steps_per_timestep(&self) -> usize {
        self.plan.decision_steps
    }

    fn foreign_simulator(&self) -> Option<&'static str> {
        Some("SUMO")
    }

    fn rough_costs(&self) -> RoughCosts {
        self.network.rough_costs
    }

    fn stuck(&self, kind: &Kind, measures: &Measures) -> Vec<bool> {
        let figure =
            |wanted: &str| measures.per_agent.iter().find(|(name, _)| name == wanted).map(|(_, values)| values);
        let shares = figure(P_SWITCH).expect("the traffic GS measures it");
        let longest_s = figure(WAIT_AT_RED);
        assert_eq!(longest_s.is_none(), self.plan.borders.is_empty(), "the GS of a scenario measures it");
        let is_stuck = |agent: &AgentId| {
            let longest_wait_s = longest_s.map_or(0.0, |longest_s| longest_s[agent.0]);
            (self.network.is_stuck)(Changes { p_switch: shares[agent.0], longest_wait_s })
        };
        kind.agents.iter().map(is_stuck).collect()
    }
}
