//! Simulators with a reward or an observation of the user's own: whatever computes it sees all roads at once.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::light_figures::{LightPlace, LightsEpisode};
use super::roads::{RoadTables, RoadsNow};
use super::{
    Action, Beginning, GlobalSimulator, InfluenceSample, JointPercept, JointTransition, Kinds, LocalSimulator,
    Measures, Percept, RegionSpec, Result, Scene, Transition,
};
use crate::base::{AgentId, Phase, Rows, Seed, Stopwatch};

/// Rewards and observations of all rows of one simulator, computed elsewhere.
pub trait OwnRows {
    /// Begins episodes in these rows; the others go on. Writes the observations of these rows into `obs`, `[rows, width]`, if it
    /// has an observation.
    fn begin(&mut self, now: &RoadsNow, rows: &[usize], obs: &mut [f32]) -> Result<()>;

    /// Writes rewards `[rows]` and observations `[rows, width]` after a step, those that it has. `stepped`: the time that the
    /// simulator took for the step.
    fn step(&mut self, now: &RoadsNow, stepped: Duration, rewards: &mut [f32], obs: &mut [f32]) -> Result<()>;
}

/// Where [`OwnRows`] come from: the process of the user.
pub trait OwnSource: Send + Sync {
    /// Returns the number of columns of an observation of this name.
    fn width(&self, tables: &RoadTables, observation: &str) -> Result<usize>;

    /// Opens reward and observation of a simulator. `rows`: the agent of each row.
    fn open(&self, tables: &RoadTables, rows: &[AgentId], functions: &OwnFunctions) -> Result<Box<dyn OwnRows>>;
}

/// Names of the user's functions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct OwnFunctions {
    pub reward: Option<String>,
    /// Name and number of columns.
    pub observation: Option<(String, usize)>,
}

/// What GS and LS have in common.
struct Beside {
    own: Box<dyn OwnRows>,
    /// Whether there is an own observation.
    sees: bool,
    now: RoadsNow,
    watch: Stopwatch,
}

impl Beside {
    fn new(own: Box<dyn OwnRows>, sees: bool, has_roads: bool) -> Beside {
        assert!(has_roads, "a domain with own functions has roads");
        Beside { own, sees, now: RoadsNow::default(), watch: Stopwatch::default() }
    }

    /// Computes rewards and observations after a step. `stepped`: the time that it took; `look`: writes the roads.
    fn step(
        &mut self,
        stepped: Duration,
        look: impl FnOnce(&mut RoadsNow),
        rewards: &mut [f32],
        obs: &mut [f32],
    ) -> Result<()> {
        let begun = Instant::now();
        look(&mut self.now);
        self.own.step(&self.now, stepped, rewards, obs)?;
        self.watch.note(Phase::Reading, begun.elapsed());
        Ok(())
    }

    /// Adds the time that this took to that of the simulator.
    fn add_to(&mut self, mut watch: Stopwatch) -> Stopwatch {
        watch.add(&self.watch.take());
        watch
    }
}

/// A GS with own rewards or observations.
pub struct OwnGlobal {
    simulator: Box<dyn GlobalSimulator>,
    beside: Beside,
    kinds: Arc<Kinds>,
    all: Vec<usize>,
    last: JointTransition,
}

impl OwnGlobal {
    /// `kinds`: those of the domain, with the width of the own observation if there is one (`sees`).
    pub fn new(
        mut simulator: Box<dyn GlobalSimulator>,
        own: Box<dyn OwnRows>,
        kinds: Arc<Kinds>,
        sees: bool,
    ) -> Result<OwnGlobal> {
        Ok(OwnGlobal {
            beside: Beside::new(own, sees, simulator.watch_roads()?),
            last: JointTransition::new(&kinds),
            all: (0..kinds.agents()).collect(),
            simulator,
            kinds,
        })
    }
}

fn copy(percept: &JointPercept, sees: bool, last: &mut JointPercept) {
    if !sees {
        last.obs.copy_from(&percept.obs);
    }
    last.d_set.copy_from(&percept.d_set);
    last.masks.copy_from(&percept.masks);
}

impl GlobalSimulator for OwnGlobal {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        let Beside { own, sees, now, .. } = &mut self.beside;
        copy(self.simulator.reset(episode)?, *sees, &mut self.last.percept);
        self.simulator.roads(now);
        own.begin(now, &self.all, self.last.percept.obs.as_mut_slice())?;
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        let begun = Instant::now();
        let JointTransition { percept, rewards } = self.simulator.step(actions)?;
        self.last.rewards.copy_from_slice(rewards);
        copy(percept, self.beside.sees, &mut self.last.percept);
        let (stepped, look) = (begun.elapsed(), |now: &mut RoadsNow| self.simulator.roads(now));
        self.beside.step(stepped, look, &mut self.last.rewards, self.last.percept.obs.as_mut_slice())?;
        Ok(&self.last)
    }

    fn observe_influence(&mut self) -> Result<()> {
        self.simulator.observe_influence()
    }

    fn influence_sample(&self) -> InfluenceSample<'_> {
        self.simulator.influence_sample()
    }

    fn advise(&mut self, actions: &mut [Action]) -> bool {
        self.simulator.advise(actions)
    }

    fn carried_out(&self, actions: &mut [Option<Action>]) {
        self.simulator.carried_out(actions);
    }

    fn measures(&mut self) -> Result<Measures> {
        self.simulator.measures()
    }

    fn measure_in_full(&mut self) -> Result<()> {
        self.simulator.measure_in_full()
    }

    fn measure_lights(&mut self) -> Result<Option<Vec<LightPlace>>> {
        self.simulator.measure_lights()
    }

    fn light_figures(&mut self) -> Option<LightsEpisode> {
        self.simulator.light_figures()
    }

    fn measure_emissions(&mut self) -> Result<bool> {
        self.simulator.measure_emissions()
    }

    fn watch_roads(&mut self) -> Result<bool> {
        self.simulator.watch_roads()
    }

    fn roads(&self, now: &mut RoadsNow) {
        self.simulator.roads(now);
    }

    fn watch_scene(&mut self) -> Result<()> {
        self.simulator.watch_scene()
    }

    fn scene(&self) -> Option<Scene> {
        self.simulator.scene()
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.beside.add_to(self.simulator.take_watch())
    }
}

/// An LS with own rewards or observations.
pub struct OwnLocal {
    simulator: Box<dyn LocalSimulator>,
    beside: Beside,
    spec: RegionSpec,
    last: Transition,
}

impl OwnLocal {
    /// `width`: that of the own observation, if there is one.
    pub fn new(
        mut simulator: Box<dyn LocalSimulator>,
        own: Box<dyn OwnRows>,
        width: Option<usize>,
    ) -> Result<OwnLocal> {
        let beside = Beside::new(own, width.is_some(), simulator.watch_roads()?);
        let usual = simulator.spec();
        let spec = RegionSpec { obs_dim: width.unwrap_or(usual.obs_dim), ..usual.clone() };
        Ok(OwnLocal { beside, last: Transition::new(simulator.rows(), &spec), spec, simulator })
    }
}

fn copy_rows(percept: &Percept, sees: bool, last: &mut Percept) {
    if !sees {
        last.obs.clone_from(&percept.obs);
    }
    last.d_set.clone_from(&percept.d_set);
    last.masks.clone_from(&percept.masks);
}

impl LocalSimulator for OwnLocal {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.simulator.rows()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        let Beside { own, sees, now, .. } = &mut self.beside;
        copy_rows(self.simulator.reset(begin)?, *sees, &mut self.last.percept);
        self.simulator.roads(now);
        let rows: Vec<usize> = begin.iter().map(|beginning| beginning.row).collect();
        own.begin(now, &rows, self.last.percept.obs.as_mut_slice())?;
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        let begun = Instant::now();
        let Transition { percept, rewards } = self.simulator.step(actions, sources)?;
        self.last.rewards.copy_from_slice(rewards);
        copy_rows(percept, self.beside.sees, &mut self.last.percept);
        let (stepped, look) = (begun.elapsed(), |now: &mut RoadsNow| self.simulator.roads(now));
        self.beside.step(stepped, look, &mut self.last.rewards, self.last.percept.obs.as_mut_slice())?;
        Ok(&self.last)
    }

    fn watch_roads(&mut self) -> Result<bool> {
        self.simulator.watch_roads()
    }

    fn roads(&self, now: &mut RoadsNow) {
        self.simulator.roads(now);
    }

    fn counters(&self) -> Vec<(String, u64)> {
        self.simulator.counters()
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.beside.add_to(self.simulator.take_watch())
    }
}
