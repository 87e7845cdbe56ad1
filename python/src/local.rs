//! Local simulators of some agents, driven by influence predictors: Algorithm 3, with the decisions made in Python.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result, bail, ensure};
use dials_core::base::{AgentId, Dice, Rows, Stopwatch};
use dials_core::domain::own::OwnLocal;
use dials_core::domain::roads::RoadTables;
use dials_core::domain::{Action, Domain, Percept, RegionSpec};
use dials_learn::config::{AipTraining, Period, Predictor, Simulator};
use dials_learn::environments::Experience;
use dials_learn::environments::ials::Ials;
use dials_learn::observer::Silent;
use dials_learn::predictors::{InfluencePredictor, TrainablePredictor};
use dials_learn::state::stream::{AgentStream, Part};
use dials_learn::steps::Step;
use dials_learn::steps::collect::Collect;
use dials_learn::steps::collect::Purpose;
use dials_learn::steps::train_aips::TrainAips;
use dials_learn::worker::Worker;
use dials_learn::worker::block::{initial_aips, training_episodes};
use dials_session::config::RunConfig;
use dials_session::directory;
use dials_session::domains::open_untried;
use serde_json::{Value, json};
use stacknets::Threads;

use crate::memory::{Memory, Section, free_bytes};
use crate::request::{LocalRequest, NO_ROADS, Opened, OwnNames, PredictorRequest, ResetRequest};
use crate::roads::{RoadMemory, Tap, Tapped};
use crate::wire::Refused;

/// The local simulators of some agents of one kind: rows ordered by agent, then by copy.
pub(crate) struct Local {
    config: RunConfig,
    domain: Arc<dyn Domain>,
    agents: Vec<AgentId>,
    names: Vec<String>,
    predictor: Box<dyn InfluencePredictor>,
    view: View,
    roads: Option<Roads>,
    own: OwnNames,
}

/// What a function of the user sees of the roads.
struct Roads {
    memory: RoadMemory,
    tables: RoadTables,
    tapped: Rc<RefCell<Tapped>>,
}

/// What the Python process sees.
struct View {
    memory: Memory,
    obs: Section,
    masks: Section,
    rewards: Section,
    ends: Section,
    last_obs: Section,
    last_masks: Section,
    predictor: Option<PredictorMemory>,
    actions: Vec<Action>,
    n_actions: usize,
}

/// What a predictor in the Python process sees, and the sources that it gives.
struct PredictorMemory {
    d_set: Section,
    sources: Section,
    /// Number of classes of each source.
    classes: Vec<u8>,
    /// Sources of the next step, `[rows, sources]`.
    given: Arc<Mutex<Vec<u8>>>,
}

/// Hands on the sources that the Python process has given.
struct Given(Arc<Mutex<Vec<u8>>>);

impl InfluencePredictor for Given {
    fn begin(&mut self, _rows: usize) -> Result<()> {
        Ok(())
    }

    fn forget(&mut self, _rows: &[usize]) -> Result<()> {
        Ok(())
    }

    fn watch(&mut self, _d_set: &Rows<f32>) -> Result<()> {
        Ok(())
    }

    fn sample(&mut self, _d_set: &Rows<f32>, _dice: &mut [Dice], sources: &mut Rows<u8>) -> Result<()> {
        sources.as_mut_slice().copy_from_slice(&self.0.lock().unwrap_or_else(PoisonError::into_inner));
        Ok(())
    }
}

/// Local simulators with episodes under way.
pub(crate) struct Running<'a> {
    ials: Ials<'a>,
    view: &'a mut View,
    roads: &'a mut Option<Roads>,
}

impl Local {
    pub(crate) fn open(opened: Opened, request: LocalRequest, memory: Memory) -> Result<Local> {
        let names = if request.agents.is_empty() { &opened.names } else { &request.agents };
        let agents = opened.agents_of_one_kind(names)?;
        let Opened { mut config, domain, names, own } = opened;
        ensure!(request.copies > 0, "copies: 0, but an agent has at least one local simulator");
        let most = most_copies(&domain.kinds().of(agents[0]).spec, agents.len());
        if request.copies > most {
            let text =
                format!("copies {}: there is memory for at most {most} of {} agents", request.copies, agents.len());
            return Err(Refused(text).into());
        }
        config.learning.local_simulators.copies = request.copies;
        config.learning.local_simulators.stagger = request.stagger;
        let mut given = None;
        let predictor: Box<dyn InfluencePredictor> = match request.predictor {
            PredictorRequest::Run(path) => {
                let (of_run, domain_of_run) = directory::open_unchanged(&path, open_untried)?;
                ensure!(
                    domain_of_run.names() == names,
                    "{}: is a run of other agents; its AIPs predict what comes to those alone",
                    path.display()
                );
                let predictor = directory::read_aips(&path, &of_run, &*domain, &agents)?;
                config.learning.simulator = of_run.learning.simulator;
                config.learning.predictor = of_run.learning.predictor;
                config.learning.aip = of_run.learning.aip;
                predictor
            }
            PredictorRequest::Untrained => {
                (config.learning.simulator, config.learning.predictor) = (Simulator::Local, Predictor::Untrained);
                initial_aips(&*domain, &config.learning, &agents)
            }
            PredictorRequest::Marginals => {
                (config.learning.simulator, config.learning.predictor) = (Simulator::Local, Predictor::Marginals);
                fitted(&domain, &config, &agents)?
            }
            PredictorRequest::Own => {
                let sources = given.insert(Arc::default());
                Box::new(Given(Arc::clone(sources)))
            }
        };
        let view = View::new(memory, &*domain, &agents, request.copies, given)?;
        let roads = if request.watches_roads || own != OwnNames::default() {
            let tables = domain.road_tables()?.context(NO_ROADS)?;
            Some(Roads { memory: view.memory.behind()?, tables, tapped: Rc::default() })
        } else {
            None
        };
        let names = agents.iter().map(|agent| names[agent.0].clone()).collect();
        Ok(Local { config, domain, agents, names, predictor, view, roads, own })
    }

    pub(crate) fn describe(&self) -> Value {
        let kind = self.domain.kinds().of(self.agents[0]);
        json!({
            "agents": self.names,
            "rows": self.view.actions.len(),
            "obs_dim": kind.spec.obs_dim,
            "n_actions": kind.spec.n_actions,
            "masks": kind.spec.masks,
            "horizon": kind.spec.local_horizon,
            "d_set_dim": kind.spec.d_set_dim,
            "classes": kind.spec.sources.classes,
            "memory": self.view.memory.describe(),
            "agent_numbers": self.agents.iter().map(|agent| agent.0).collect::<Vec<_>>(),
            "roads": self.roads.as_ref().map(|roads| &roads.tables),
            "own": self.own,
        })
    }

    /// Makes new simulators, in which the first episodes of a seed begin: those of a run with this `seed`.
    pub(crate) fn reset(&mut self, request: &ResetRequest) -> Result<Running<'_>> {
        let Local { config, domain, agents, predictor, view, roads, .. } = self;
        config.learning.seed = request.seed;
        let mut simulators =
            domain.local_simulator(agents, config.learning.copies(), training_episodes(&config.learning))?;
        if let Some(roads) = roads {
            simulators = Box::new(OwnLocal::new(simulators, Box::new(Tap(roads.tapped.clone())), None)?);
        }
        let streams: Vec<AgentStream> =
            agents.iter().map(|&agent| AgentStream::begin(&config.learning, agent)).collect();
        let (stagger, copies) = (config.learning.local_simulators.stagger, config.learning.copies());
        let all = Part { agents: 0..agents.len(), copies: 0..copies };
        let ials = Ials::resume(simulators, &mut **predictor, all, &streams, stagger, &mut || ())?;
        view.put(ials.percept());
        view.memory.show()?;
        Ok(Running { ials, view, roads })
    }
}

/// Memory of a row beside its tables, in bytes: less than any simulator needs.
const LEAST_PER_ROW: usize = 4096;

/// Returns the number of copies of each agent that fit into the free memory at best. The simulators may need far more.
/// This refuses what cannot be: the allocator would end the process without a reason that helps.
fn most_copies(spec: &RegionSpec, agents: usize) -> usize {
    // Tables from before and after the end of an episode. Each is there twice: as the image and as shared memory.
    let per_row = 4 * (spec.obs_dim * size_of::<f32>() + spec.n_actions) + LEAST_PER_ROW;
    (free_bytes() / per_row / agents).max(1)
}

/// Fits predictors of `agents` to episodes on the global simulator, in which policies that were not trained act. That is
/// what a run does before its first step.
fn fitted(domain: &Arc<dyn Domain>, config: &RunConfig, agents: &[AgentId]) -> Result<Box<dyn TrainablePredictor>> {
    let all = AgentId::all(domain.agents());
    let mut worker = Worker::new(domain.clone(), &config.learning, all, &Threads::one());
    let purpose = Purpose::Training { steps: 0 };
    let episodes = purpose.episodes(&config.learning, domain.kinds().horizon());
    worker.take_policies(worker.policies());
    let datasets = Collect { purpose, episodes: 0..episodes }.run(&mut worker, &Silent)?;
    let period = Period { start: 0, end: 0, average: false, evaluate: false, train_aips: AipTraining::Yes };
    let (_, aips) = TrainAips { datasets, period }.run(&mut worker, &Silent)?;
    let mut predictor = initial_aips(&**domain, &config.learning, agents);
    predictor.load(&aips.pick(agents.iter().map(|agent| agent.0)).into_rows());
    Ok(predictor)
}

impl View {
    /// `given`: where the sources of a predictor in the Python process go, if there is one.
    fn new(
        mut memory: Memory,
        domain: &dyn Domain,
        agents: &[AgentId],
        copies: usize,
        given: Option<Arc<Mutex<Vec<u8>>>>,
    ) -> Result<View> {
        let spec = &domain.kinds().of(agents[0]).spec;
        let rows = agents.len().checked_mul(copies).context("copies: too many")?;
        let masks = if spec.masks { rows * spec.n_actions } else { 0 };
        let view = View {
            obs: memory.section::<f32>("obs", rows * spec.obs_dim, "f4"),
            masks: memory.section::<bool>("masks", masks, "b1"),
            rewards: memory.section::<f32>("rewards", rows, "f4"),
            ends: memory.section::<bool>("ends", rows, "b1"),
            last_obs: memory.section::<f32>("last_obs", rows * spec.obs_dim, "f4"),
            last_masks: memory.section::<bool>("last_masks", masks, "b1"),
            predictor: given.map(|given| PredictorMemory {
                d_set: memory.section::<f32>("d_set", rows * spec.d_set_dim, "f4"),
                sources: memory.section::<u8>("sources", rows * spec.sources.count(), "u1"),
                classes: spec.sources.classes.clone(),
                given,
            }),
            actions: vec![0; rows],
            n_actions: spec.n_actions,
            memory,
        };
        Ok(View { memory: view.memory.finish(rows)?, ..view })
    }

    fn put(&mut self, percept: &Percept) {
        self.memory.put(&self.obs, percept.obs.as_slice());
        if let Some(masks) = &percept.masks {
            self.memory.put(&self.masks, masks.as_slice());
        }
        if let Some(predictor) = &self.predictor {
            self.memory.put(&predictor.d_set, percept.d_set.as_slice());
        }
    }

    /// Takes the sources of the next step from the memory, if the Python process predicts them.
    fn take_sources(&mut self) -> Result<()> {
        let Some(PredictorMemory { sources, classes, given, .. }) = &self.predictor else { return Ok(()) };
        let mut values = vec![0; self.actions.len() * classes.len()];
        self.memory.read(sources, &mut values)?;
        let known = values.iter().zip(classes.iter().cycle()).all(|(value, classes)| value < classes);
        ensure!(known, "an influence source has a class that it does not have");
        *given.lock().unwrap_or_else(PoisonError::into_inner) = values;
        Ok(())
    }

    fn put_experience(&mut self, experience: &Experience) {
        self.memory.put(&self.rewards, &experience.rewards);
        self.memory.put(&self.ends, &experience.ends);
        if experience.ends.contains(&true) {
            self.memory.put(&self.last_obs, experience.last_obs.as_slice());
            if let Some(masks) = &experience.last_masks {
                self.memory.put(&self.last_masks, masks.as_slice());
            }
        }
    }
}

impl Running<'_> {
    /// Makes one step of every row. Where an episode ends, the next one begins.
    pub(crate) fn step(&mut self) -> Result<Vec<u8>> {
        let Running { ials, view, .. } = self;
        view.memory.read_actions(&mut view.actions)?;
        if let Some((row, action)) =
            view.actions.iter().enumerate().find(|(_, action)| usize::from(**action) >= view.n_actions)
        {
            bail!("row {row}: action {action}; its actions are 0 to {}", view.n_actions - 1);
        }
        view.take_sources()?;
        ials.decide(&view.actions, &mut Stopwatch::default())?;
        let experience = ials.experience();
        view.put_experience(experience);
        view.put(ials.percept());
        view.memory.show()?;
        self.show_roads()
    }

    /// Shows what is on the roads, if a function of the user sees it.
    pub(crate) fn show_roads(&mut self) -> Result<Vec<u8>> {
        let Some(Roads { memory, tapped, .. }) = self.roads else { return Ok(Vec::new()) };
        let Tapped { now, begun } = &*tapped.borrow();
        memory.show(now, begun.as_ref())
    }

    /// Returns totals since the simulators were made, such as influences that could not be applied.
    pub(crate) fn counters(&self) -> Value {
        self.ials
            .counters()
            .into_iter()
            .map(|(name, count)| (name.to_owned(), json!(count)))
            .collect::<serde_json::Map<_, _>>()
            .into()
    }
}
