//! Domains: the traits between simulators and learning.
//!
//! A [`Domain`] makes simulators. The [`GlobalSimulator`] (GS) moves the whole system. A [`LocalSimulator`] (LS) moves
//! many local regions in lockstep, each driven by the influence sources that it gets. Simulators never see a tensor or
//! anything of learning: they use [`Rows`] and [`Ragged`]. Learning never sees a car or a robot: it knows the
//! [`RegionSpec`].
//!
//! Agents of equal shape form a [`Kind`]; a domain lists its [`Kinds`]. A local simulator has rows of one kind. The GS
//! has one row per agent, as wide as its kind needs. What simulators show is a [`Percept`].
//!
//! A new domain implements the three traits and passes `conformance` of the crate `dials-testkit`, which also has the
//! smallest domains. Pictures of episodes are drawn from a [`Scene`] or a [`road_trace`].

mod kinds;
pub mod light_figures;
pub mod own;
mod percept;
pub mod road_trace;
pub mod roads;
mod rough_costs;
pub mod sampling;
mod scenario;
mod scene;
pub mod signal_sheet;
mod spec;
mod table;

use std::path::{Path, PathBuf};

use anyhow::bail;
use serde::{Deserialize, Serialize};

use crate::base::{AgentId, Ragged, Rows, Seed, Stopwatch};

use light_figures::{LightPlace, LightsEpisode};
use roads::{RoadTables, RoadsNow};

pub use kinds::{Kind, Kinds, Place};
pub use percept::{JointPercept, JointTransition, Percept, Transition};
pub use rough_costs::RoughCosts;
pub use scenario::{Episode, FirstRow, Map, Rules, Scenario, ScenarioId};
pub use scene::{Colour, Scene};
pub use spec::{Action, RegionSpec, SourceSpec, StartingPolicy, Task, logits_of};
pub use stacknets::Sets;
pub use table::DomainTable;

/// Result of a simulator. Its failures have many reasons (SUMO, files), and no caller distinguishes them.
pub type Result<T> = anyhow::Result<T>;

/// One sample `(l_t, u_t)` of every agent's dataset `D_i`: the d-set (the variables that influence predictors see) at a
/// decision, and the influence sources during the step after it.
#[derive(Clone, Copy, Debug)]
pub struct InfluenceSample<'a> {
    /// D-sets, one row per agent: `[d_set_dim]` of its kind.
    pub d_set: &'a Ragged<f32>,
    /// Influence sources, one row per agent: `[sources]` of its kind.
    pub sources: &'a Ragged<u8>,
}

/// The global simulator: `s' ~ T(. | s, a)` for all agents at once, one row per agent.
///
/// It knows no horizon: the caller ends the episode by `reset`. An episode depends on its seed and the joint actions
/// alone.
pub trait GlobalSimulator {
    /// Returns the kinds of the domain.
    fn kinds(&self) -> &Kinds;

    fn agents(&self) -> usize {
        self.kinds().agents()
    }

    /// Begins an episode. Everything random in it follows from `episode`.
    fn reset(&mut self, episode: Seed) -> Result<&JointPercept>;

    /// Makes one step under the joint action, `[agents]`.
    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition>;

    /// Makes d-sets and influence samples true from the next reset on. Until then a simulator for which they cost
    /// much may leave them zero.
    fn observe_influence(&mut self) -> Result<()> {
        Ok(())
    }

    /// Returns the sample of the last step. The GS must align the pair: an LS in the same local state that gets these
    /// sources makes the same transition.
    fn influence_sample(&self) -> InfluenceSample<'_>;

    /// Writes what hand-coded control inside the simulator would do now into `actions`, `[agents]`. The next step then
    /// carries out the actions that it is given. Returns whether there is such control and it can be asked; if not,
    /// nothing changes.
    fn advise(&mut self, _actions: &mut [Action]) -> bool {
        false
    }

    /// Writes what the agents did in the last step. `actions` holds the actions that the step was given, `[agents]`. They
    /// are replaced where hand-coded control inside the simulator decided. `None`: no action would have changed
    /// anything.
    fn carried_out(&self, _actions: &mut [Option<Action>]) {}

    /// Returns other figures of the episode so far.
    fn measures(&mut self) -> Result<Measures> {
        Ok(Measures::default())
    }

    /// Makes [`GlobalSimulator::measures`] return all that the domain knows, at any cost, from the next reset on.
    /// Calling it then ends the episode: only a reset may follow.
    fn measure_in_full(&mut self) -> Result<()> {
        Ok(())
    }

    /// Makes [`GlobalSimulator::light_figures`] return something from the next reset on, together with
    /// [`GlobalSimulator::measure_in_full`]. Returns the lights. A domain without lights: `None`.
    fn measure_lights(&mut self) -> Result<Option<Vec<LightPlace>>> {
        Ok(None)
    }

    /// Returns the figures of the lights of the episode that [`GlobalSimulator::measures`] has ended, if they are measured.
    fn light_figures(&mut self) -> Option<LightsEpisode> {
        None
    }

    /// Makes [`GlobalSimulator::measures`] return emissions as well from the next reset on, together with
    /// [`GlobalSimulator::measure_in_full`]. Returns whether the domain has any.
    fn measure_emissions(&mut self) -> Result<bool> {
        Ok(false)
    }

    /// Makes [`GlobalSimulator::roads`] write something from the next reset on. Returns whether the domain has roads.
    fn watch_roads(&mut self) -> Result<bool> {
        Ok(false)
    }

    /// Writes what is on the roads of every agent now, one row per agent. Nothing unless they are watched.
    fn roads(&self, now: &mut RoadsNow) {
        now.clear();
    }

    /// Makes [`GlobalSimulator::scene`] return pictures from the next reset on, if the domain draws them only on demand.
    fn watch_scene(&mut self) -> Result<()> {
        Ok(())
    }

    /// Returns a picture of the state, if the domain draws one.
    fn scene(&self) -> Option<Scene> {
        None
    }

    /// Returns how long its steps took since the last call, split into insertion, its own step and reading. Time that
    /// is not split counts as its own step.
    fn take_watch(&mut self) -> Stopwatch {
        Stopwatch::default()
    }
}

/// An episode to begin in a row of a local simulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Beginning {
    pub row: usize,
    /// Number of the episode in this row, from 0.
    pub episode: u64,
}

impl Beginning {
    /// Returns the first episodes of these rows.
    pub fn first(rows: impl IntoIterator<Item = usize>) -> Vec<Beginning> {
        rows.into_iter().map(|row| Beginning { row, episode: 0 }).collect()
    }
}

/// The local simulators of many regions of one kind in lockstep: `x' ~ T_i(. | x, u, a)`, one row per (agent, copy).
///
/// It ends no episode: the caller does, by `reset`, after [`RegionSpec::local_horizon`] steps.
///
/// A row depends on its region and copy, the seed of the simulator and the number of the episode. It also depends on
/// the actions and sources since the episode began, but not on other rows or earlier episodes. So training can
/// stop anywhere and continue in a new simulator that is driven to the same state. `conformance` checks this.
pub trait LocalSimulator {
    /// Returns the spec of its kind.
    fn spec(&self) -> &RegionSpec;
    fn rows(&self) -> usize;

    /// Begins these episodes, each in its row, and leaves the other rows as they are.
    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept>;

    /// Makes one step of every row. `actions`: `[rows]`; `sources`: `[rows, sources]`.
    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition>;

    /// Makes [`LocalSimulator::roads`] write something from the next reset on. Returns whether the domain has roads.
    fn watch_roads(&mut self) -> Result<bool> {
        Ok(false)
    }

    /// Writes what is on the roads of every row now. Nothing unless they are watched.
    fn roads(&self, now: &mut RoadsNow) {
        now.clear();
    }

    /// Returns totals since the simulator was made, such as influences that could not be applied.
    fn counters(&self) -> Vec<(String, u64)> {
        Vec::new()
    }

    /// Returns how long its steps took, like [`GlobalSimulator::take_watch`].
    fn take_watch(&mut self) -> Stopwatch {
        Stopwatch::default()
    }
}

/// Named figures of an episode, other than the return.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Measures {
    /// Figures with one value per agent.
    pub per_agent: Vec<(String, Vec<f64>)>,
    /// Figures with one value for the whole system.
    pub system: Vec<(String, f64)>,
}

/// Decides for all agents of a GS: a joint policy or a hand-coded baseline.
pub trait Controller {
    /// Returns whether it decides itself, and leaves nothing to hand-coded control inside the simulator.
    fn decides(&self) -> bool {
        true
    }

    /// Begins an episode. Everything random in the decisions follows from `episode`.
    fn begin(&mut self, episode: Seed);

    /// Decides, one action per agent.
    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> Result<()>;
}

/// A hand-coded controller with the GS that it runs on.
pub struct Baseline {
    pub simulator: Box<dyn GlobalSimulator>,
    pub controller: Box<dyn Controller>,
}

/// A controller that leaves everything to hand-coded control inside the simulator.
pub struct BuiltInControl;

impl Controller for BuiltInControl {
    fn decides(&self) -> bool {
        false
    }

    fn begin(&mut self, _episode: Seed) {}

    fn act(&mut self, _percept: &JointPercept, actions: &mut [Action]) -> Result<()> {
        actions.fill(0);
        Ok(())
    }
}

/// A networked system of agents with local regions.
pub trait Domain: Send + Sync {
    fn kinds(&self) -> &Kinds;

    fn agents(&self) -> usize {
        self.kinds().agents()
    }

    /// Returns the name of an agent, such as that of its light.
    fn agent_name(&self, agent: AgentId) -> String {
        agent.0.to_string()
    }

    /// Returns the names of all agents, in order. No two are equal, and none is a number.
    fn names(&self) -> Vec<String> {
        let name = |agent: AgentId| match self.agent_name(agent) {
            name if name == agent.0.to_string() => format!("agent_{name}"),
            name => name,
        };
        AgentId::all(self.agents()).into_iter().map(name).collect()
    }

    /// Returns number and name of an agent, such as `agent 3 (r1c1)`.
    fn agent_title(&self, agent: AgentId) -> String {
        match self.agent_name(agent) {
            name if name == agent.0.to_string() => format!("agent {name}"),
            name => format!("agent {} ({name})", agent.0),
        }
    }

    /// Finds an agent by its number or its name. `None`: there is none.
    fn agent_called(&self, word: &str) -> Option<AgentId> {
        let mut agents = AgentId::all(self.agents()).into_iter();
        match word.parse() {
            Ok(number) if number < self.agents() => Some(AgentId(number)),
            _ => agents.find(|&agent| self.agent_name(agent) == word),
        }
    }

    /// Returns the roads of all agents. `None`: this domain has none.
    fn road_tables(&self) -> Result<Option<RoadTables>> {
        Ok(None)
    }

    /// Returns what an agent sees, does and is rewarded for, in words.
    fn task(&self, agent: AgentId) -> Task {
        Task::of_shape(&self.kinds().of(agent).spec)
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>>;

    /// Makes local simulators of `regions`, `copies` of each: rows ordered by region, then copy. All regions are of one
    /// kind.
    fn local_simulator(&self, regions: &[AgentId], copies: usize, seed: Seed) -> Result<Box<dyn LocalSimulator>>;

    /// Returns the names that [`Domain::baseline`] takes, for help and error messages.
    fn baselines(&self) -> &'static [&'static str] {
        &[]
    }

    /// Makes a hand-coded controller by name. An unknown name is an error that lists the known ones.
    fn baseline(&self, name: &str) -> Result<Baseline> {
        anyhow::bail!("controller `{name}`: this domain has none")
    }

    /// Returns an error if [`Domain::baseline`] would not know the name.
    fn check_baseline(&self, name: &str) -> Result<()> {
        self.baseline(name).map(drop)
    }

    /// Returns the CRC-32 of the file that a hand-coded controller reads. If it reads none: `None`.
    fn baseline_checksum(&self, _name: &str) -> Result<Option<u32>> {
        Ok(None)
    }

    /// Makes a GS in which a hand-coded controller decides for these agents, whatever their actions say.
    fn with_background(&self, name: &str, _agents: &[AgentId]) -> Result<Box<dyn GlobalSimulator>> {
        bail!("controller `{name}`: this domain has no hand-coded control for some of its agents")
    }

    /// Returns what somebody should know who plays this controller here, a sentence each.
    fn baseline_warnings(&self, _name: &str) -> Result<Vec<String>> {
        Ok(Vec::new())
    }

    /// Returns the policy of this name from which policies of this domain may start.
    fn starting_policy(&self, name: &str) -> Result<StartingPolicy> {
        bail!("there is no policy `{name}` to start from in this domain; remove the key")
    }

    /// Returns what to add to the output biases of a new policy of this kind, per action: a prior on behaviour.
    fn initial_action_bias(&self, kind: &Kind) -> Vec<f32> {
        vec![0.0; kind.spec.n_actions]
    }

    /// Returns whether each agent of a kind, in the order of the kind, is stuck in a degenerate behaviour. `measures`:
    /// those of all agents, as means over the episodes of an evaluation.
    fn stuck(&self, kind: &Kind, _measures: &Measures) -> Vec<bool> {
        vec![false; kind.agents.len()]
    }

    /// Describes what is simulated, for `run.json` and its readers.
    fn scenario(&self) -> Result<Scenario>;

    /// Returns which simulator configs of this domain train on unless they say otherwise, and why, for a person.
    fn default_simulator(&self) -> Option<&'static str> {
        None
    }

    /// Returns the hand-coded controller to compare a run with, one of [`Domain::baselines`].
    fn rival(&self) -> Option<&'static str> {
        None
    }

    /// Returns the number of steps that the simulators make in a timestep (traffic: the seconds of a decision).
    fn simulator_steps_per_timestep(&self) -> usize {
        1
    }

    /// Prepares what takes long and is the same in all processes that make local simulators: bytes that
    /// [`Domain::take_prepared`] reads. If there is no such thing: `None`. `kept`: such bytes of an earlier process. Nothing is
    /// prepared again if they are made from the same files and settings.
    fn prepare(&self, _kept: Option<&[u8]>) -> Result<Option<Vec<u8>>> {
        Ok(None)
    }

    /// Takes what a domain prepared in another process. If it was made from other files or settings: an error.
    fn take_prepared(&self, _prepared: &[u8]) -> Result<()> {
        Ok(())
    }

    /// Tries the domain's files in its simulator. Called in a process of its own, before any other simulator loads them.
    /// Returns what the simulator warns of.
    fn try_out(&self) -> Result<Vec<String>> {
        Ok(Vec::new())
    }

    /// Makes the local simulators of all agents once, if each differs from the others, so that an error about
    /// what cannot be simulated alone comes early.
    fn try_local(&self) -> Result<()> {
        Ok(())
    }

    /// Returns the files that the simulator loads and may not survive. With any, another process tries the domain out first.
    fn strange_files(&self) -> Vec<PathBuf> {
        Vec::new()
    }

    /// Lists what of the domain's files is not simulated, a sentence each.
    fn left_out(&self) -> Vec<String> {
        Vec::new()
    }

    /// Lists what somebody should know of the domain's files before he compares figures, a sentence each.
    fn warnings(&self) -> Vec<String> {
        Vec::new()
    }

    /// Lists what of the domain's files the global simulator has and local simulators do without, a sentence each.
    fn without_locally(&self) -> Vec<String> {
        Vec::new()
    }

    /// Returns an error if the domain's files could not be loaded from `folder`, which need not exist yet.
    fn check_place(&self, _folder: &Path) -> Result<()> {
        Ok(())
    }

    /// Makes `folder` and copies the domain's files into it. Returns their paths in it, in the order of the config's
    /// keys that name them. A domain without files makes nothing.
    fn keep_files(&self, _folder: &Path) -> Result<Vec<PathBuf>> {
        Ok(Vec::new())
    }

    /// Returns the name of the external program that makes the steps of this domain's simulators, if there is one. Its
    /// time cannot be avoided.
    fn foreign_simulator(&self) -> Option<&'static str> {
        None
    }

    /// Returns rough costs of a run, for use without measurements.
    fn rough_costs(&self) -> RoughCosts {
        RoughCosts::default()
    }
}
