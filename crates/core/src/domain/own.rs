//! Simulators with a reward or an observation of the user's own: whatever computes it sees all roads at once.

use super::light_figures::{LightPlace, LightsEpisode};
use super::roads::{RoadTables, RoadsNow};
use super::{
    Action, Beginning, GlobalSimulator, InfluenceSample, JointPercept, JointTransition, Kinds, LocalSimulator,
    Measures, Percept, RegionSpec, Result, Scene, Transition,
};
use crate::base::{AgentId, Rows, Stopwatch};
use crate::base::{Phase, Seed};
use std::sync::Arc;
use std::time::{Duration, Instant};

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

/// A GS with own rewards or observations.
pub struct OwnGlobal {
    simulator: Box<dyn GlobalSimulator>,
    own: Box<dyn OwnRows>,
    sees: bool,
    kinds: Arc<Kinds>,
    all: Vec<usize>,
    last: JointTransition,
    now: RoadsNow,
    watch: Stopwatch,
}

impl OwnGlobal {
    /// `kinds`: those of the domain, with the width of the own observation if there is one (`sees`).
    pub fn new(
        mut simulator: Box<dyn GlobalSimulator>,
        own: Box<dyn OwnRows>,
        kinds: Arc<Kinds>,
        sees: bool,
    ) -> Result<OwnGlobal> {
        let has_roads = simulator.watch_roads()?;
        assert!(has_roads, "a domain with own functions has roads");
        Ok(OwnGlobal {
            last: JointTransition::new(&kinds),
            all: (0..kinds.agents()).collect(),
            simulator,
            own,
            sees,
            kinds,
            now: RoadsNow::default(),
            watch: Stopwatch::default(),
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
        copy(self.simulator.reset(episode)?, self.sees, &mut self.last.percept);
        self.simulator.roads(&mut self.now);
        self.own.begin(&self.now, &self.all, self.last.percept.obs.as_mut_slice())?;
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        let begun = Instant::now();
        let JointTransition { percept, rewards } = self.simulator.step(actions)?;
        self.last.rewards.copy_from_slice(rewards);
        copy(percept, self.sees, &mut self.last.percept);
        let stepped = begun.elapsed();
        let begun = Instant::now();
        self.simulator.roads(&mut self.now);
        self.own.step(&self.now, stepped, &mut self.last.rewards, self.last.percept.obs.as_mut_slice())?;
        self.watch.note(Phase::Reading, begun.elapsed());
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
        let mut watch = self.simulator.take_watch();
        watch.add(&self.watch.take());
        watch
    }
}

/// An LS with own rewards or observations.
pub struct OwnLocal {
    simulator: Box<dyn LocalSimulator>,
    own: Box<dyn OwnRows>,
    sees: bool,
    spec: RegionSpec,
    last: Transition,
    now: RoadsNow,
    watch: Stopwatch,
}

impl OwnLocal {
    /// `width`: that of the own observation, if there is one.
    pub fn new(
        mut simulator: Box<dyn LocalSimulator>,
        own: Box<dyn OwnRows>,
        width: Option<usize>,
    ) -> Result<OwnLocal> {
        let has_roads = simulator.watch_roads()?;
        assert!(has_roads, "a domain with own functions has roads");
        let usual = simulator.spec();
        let spec = RegionSpec { obs_dim: width.unwrap_or(usual.obs_dim), ..usual.clone() };
        Ok(OwnLocal {
            last: Transition::new(simulator.rows(), &spec),
            spec,
            simulator,
            own,
            sees: width.is_some(),
            now: RoadsNow::default(),
            watch: Stopwatch::default(),
        })
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
        copy_rows(self.simulator.reset(begin)?, self.sees, &mut self.last.percept);
        self.simulator.roads(&mut self.now);
        let rows: Vec<usize> = begin.iter().map(|beginning| beginning.row).collect();
        self.own.begin(&self.now, &rows, self.last.percept.obs.as_mut_slice())?;
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        let begun = Instant::now();
        let Transition { percept, rewards } = self.simulator.step(actions, sources)?;
        self.last.rewards.copy_from_slice(rewards);
        copy_rows(percept, self.sees, &mut self.last.percept);
        let stepped = begun.elapsed();
        let begun = Instant::now();
        self.simulator.roads(&mut self.now);
        self.own.step(&self.now, stepped, &mut self.last.rewards, self.last.percept.obs.as_mut_slice())?;
        self.watch.note(Phase::Reading, begun.elapsed());
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
        let mut watch = self.simulator.take_watch();
        watch.add(&self.watch.take());
        watch
    }
}
