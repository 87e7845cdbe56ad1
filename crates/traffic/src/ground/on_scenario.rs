//! A scenario of the user, with an agent for each light that can learn.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use anyhow::{Context, anyhow, bail};

use super::{About, Ground};
use crate::agents::derive::border::Seconds;
use crate::agents::derive::keeping::sentences;
use crate::agents::derive::overrides::Overrides;
use crate::agents::derive::padding::{InfluencePadding, Padding};
use crate::agents::derive::{Agent, CarsSeen, Derived, Rules, derive};
use crate::agents::plan::{AgentPlan, Border, JointPlan};
use crate::config::{Observation, Reward, ScenarioConfig};
use crate::controllers::actuated;
use crate::cut::names::free_name;
use crate::cut::of_scenario::{cut_all, types_of};
use crate::network::files::for_sumo;
use crate::network::loadable::Loadable;
use crate::network::roads::Roads;
use crate::scenario::SumoScenario;
use crate::scenario::kept::KEPT;
use crate::sim::local::LocalTraffic;
use crate::sim::local_forest::{LocalParts, driving_options};
use crate::sim::recorded_roads::RecordedRoads;
use crate::sim::recording::Tape;
use crate::sim::trace::route::Route;
use dials_core::domain::{DomainTable, Kinds, RegionSpec, Result, RoughCosts, Scenario, SourceSpec};
use dials_core::outside::quoted;

/// Share of switches per second of green below which an agent is stuck: its greens last for more than five minutes on
/// average, so others wait for longer than any program makes them. Own programs and trained agents are at 0.02 to 0.1.
/// A light that changes as often as it may is at 0.14, which may be right where few cars come.
const STUCK_BELOW: f64 = 1.0 / 300.0;

/// A scenario with the agents that were derived from it.
pub(crate) struct OnScenario {
    about: About,
    files: SumoScenario,
    derived: Derived,
    /// Borders of the agents' regions.
    borders: Vec<Border>,
    config: ScenarioConfig,
    /// What local simulators are made of, once they were.
    local: OnceLock<Arc<LocalParts>>,
}

impl OnScenario {
    /// Reads a scenario and derives its agents. An error names file, element and the way out.
    pub(crate) fn open(config: &ScenarioConfig) -> Result<OnScenario> {
        OnScenario::of(SumoScenario::read(config)?, config)
    }

    /// Derives the agents of a scenario that was read.
    pub(crate) fn of(files: SumoScenario, config: &ScenarioConfig) -> Result<OnScenario> {
        let place = || files.path().display().to_string();
        let roads = files.roads()?;
        let overrides = match files.agents() {
            None => Overrides::default(),
            Some((path, text)) => Overrides::parse(text).map_err(|error| anyhow!("{}: {error:#}", path.display()))?,
        };
        let derived = derive(&roads, &rules(config), &overrides).with_context(place)?;
        let seconds = Seconds::of(config);
        let borders = derived.borders(&roads, &files.departs_on(&roads), config.approach_m, seconds);
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
        let keeps = sentences(&derived.keeping).into_iter().map(|(sentence, _)| sentence);
        let about = About {
            grid: None,
            horizon: config.horizon(),
            refuses_actuated,
            cannot_be_simulated: format!(
                "{}: SUMO cannot simulate this scenario; try it with: sumo -c {}",
                place(),
                quoted(files.path())
            ),
            rough_costs: rough_costs(f64::from(config.decision_s)),
            unusual_reward: (config.reward != Reward::default()).then(|| config.reward.name()),
            strange_files: vec![files.path().to_owned()],
            left_out: files.left_out().iter().cloned().chain(keeps).collect(),
            switch_bias: 0.0,
            is_random: files.dawdles(),
            is_stuck: |p_switch| p_switch < STUCK_BELOW,
            rival: "program",
        };
        Ok(OnScenario { about, files, derived, borders, config: config.clone(), local: OnceLock::new() })
    }

    /// Returns the plan of its agents. They are of one kind, as wide as the widest of them needs.
    pub(crate) fn joint_plan(&self) -> JointPlan {
        let agents = self.derived.plans();
        let sources = self.borders.iter().map(|border| border.plan.sources()).collect();
        let kinds = Kinds::one(agents.len(), self.spec(&agents)).with_sources(sources);
        JointPlan {
            agents,
            borders: self.borders.clone(),
            kinds,
            decision_steps: self.config.decision_s as usize,
            reward: self.config.reward.clone(),
            emergency_decel_mps2: None,
        }
    }

    fn spec(&self, agents: &[AgentPlan]) -> RegionSpec {
        let Padding { columns, actions, .. } = Padding::of(agents.iter());
        let influence = InfluencePadding::of(self.borders.iter());
        RegionSpec {
            obs_dim: columns,
            d_set_dim: influence.columns,
            n_actions: actions,
            masks: true,
            sources: SourceSpec { parts: influence.parts, ..SourceSpec::bits(influence.sources) },
            horizon: self.config.horizon(),
            local_horizon: self.config.local_horizon(),
        }
    }
}

/// Measured with runs on the shipped town and on RESCO's maps, with decisions of 5 s. Between these maps a second of a
/// light differs by a factor of four: lights have from 4 to 20 lanes, and jams cost time.
fn rough_costs(decision_s: f64) -> RoughCosts {
    const LEARNING_S: f64 = 15e-6;
    RoughCosts {
        training_s: LEARNING_S + decision_s * 40e-6,
        training_on_gs_s: LEARNING_S + decision_s * 45e-6,
        influence_s: decision_s * 13e-6,
        evaluation_s: decision_s * 60e-6,
        process_mb: 120.0,
        agent_mb: 4.0,
    }
}

/// Returns what the config says of all lights.
fn rules(config: &ScenarioConfig) -> Rules {
    let cars = match config.observation {
        Observation::Cells => CarsSeen::Cells,
        Observation::Queues => CarsSeen::Queues,
    };
    Rules { approach_m: config.approach_m, yellow: config.yellow_s, min_green_s: config.min_green_s, cars }
}

impl Ground for OnScenario {
    fn about(&self) -> &About {
        &self.about
    }

    fn source(&self) -> Result<Loadable> {
        let agents = self.derived.agents.iter();
        let lights = agents.map(|Agent { plan, program, .. }| (program, plan.phases.cars()));
        let roots = [self.files.net()].into_iter().chain(self.files.additional());
        let taken: HashSet<&str> =
            roots.flat_map(|root| root.all("tlLogic")).filter_map(|light| light.attribute("programID")).collect();
        let program = free_name(actuated::PROGRAM, |name| taken.contains(name));
        self.files.for_sumo(&actuated::programs(&program, lights), &program)
    }

    fn roads(&self) -> Result<Roads> {
        self.files.roads()
    }

    fn recorded(&self) -> Result<RecordedRoads> {
        RecordedRoads::of_scenario(&self.files, self.derived.plans())
    }

    fn route(&self, edges: &str) -> Result<Route> {
        Route::read(edges, &self.files.roads()?).with_context(|| self.files.net_path().display().to_string())
    }

    fn local(&self, _rows: usize, _tape: Option<&Tape>) -> Result<LocalTraffic> {
        bail!(
            "{}: the local simulators of a scenario differ from light to light; make them by `local_simulator`",
            self.files.path().display()
        )
    }

    fn local_parts(&self) -> Result<Option<Arc<LocalParts>>> {
        if let Some(known) = self.local.get() {
            return Ok(Some(known.clone()));
        }
        let parts = Arc::new(LocalParts {
            nets: cut_all(&self.files, &self.derived)?,
            types: types_of(&self.files),
            options: driving_options(self.files.options()),
            name: self.files.path().display().to_string(),
        });
        Ok(Some(self.local.get_or_init(|| parts).clone()))
    }

    fn try_local(&self) -> Result<()> {
        Ok(())
    }

    fn scenario(&self, agents: usize) -> Result<Scenario> {
        let scenario = Scenario::new("traffic", agents, self.about.horizon).with_checksum(self.files.checksum());
        let name = self.files.path().file_stem().unwrap_or_default().to_string_lossy();
        // A copy in a run directory has lost the name.
        Ok(if name == KEPT { scenario } else { scenario.with_name(&name) })
    }

    fn identity(&self) -> (String, u32) {
        let name = self.files.path().file_stem().unwrap_or_default().to_string_lossy();
        (name.into_owned(), self.files.checksum())
    }

    fn check_place(&self, folder: &Path) -> Result<()> {
        for_sumo(folder).map(drop)
    }

    fn keep_files(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        self.files.keep_in(folder)
    }
}
