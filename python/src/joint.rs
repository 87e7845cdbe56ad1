//! All agents of a config on the global simulator (GS).

use std::collections::BTreeSet;
use std::os::unix::ffi::OsStrExt;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use dials_core::base::{AgentId, Seed};
use dials_core::domain::roads::RoadsNow;
use dials_core::domain::{Action, GlobalSimulator, JointPercept, RegionSpec};
use dials_learn::evaluation::episode_seed;
use dials_session::domains::traffic;
use dials_session::places::{self, Existing};
use dials_traffic::sim::recording::Tape;
use dials_traffic::sim::replay;
use serde_json::{Value, json};

use crate::agent;
use crate::memory::{Memory, Section};
use crate::request::{JointRequest, KeepRequest, NO_ROADS, Opened, OwnNames, ResetRequest};
use crate::roads::RoadMemory;
use crate::wire::{self, DRAW, KEEP, LOOK, MEASURE, RESET, STEP};

/// Pixels per unit of a picture.
const SCALE: usize = 16;

/// The GS with the memory that it shows itself in.
pub(crate) struct Joint {
    opened: Opened,
    simulator: Box<dyn GlobalSimulator>,
    /// Agents for which a hand-coded controller decides.
    hand_coded: Vec<AgentId>,
    memory: Memory,
    sections: Sections,
    actions: Vec<Action>,
    under_way: bool,
    /// The last episode, if episodes are recorded.
    tape: Option<Tape>,
    /// What is on the roads, if a function of the user sees it.
    roads: Option<(RoadMemory, RoadsNow)>,
}

struct Sections {
    /// Observations, agent after agent.
    obs: Section,
    /// Allowed actions, agent after agent; nothing for agents without masks.
    masks: Section,
    rewards: Section,
}

impl Joint {
    pub(crate) fn open(mut opened: Opened, request: JointRequest, mut memory: Memory) -> Result<Joint> {
        let tape = request.records.then(Tape::default);
        if let Some(tape) = &tape {
            let traffic = traffic(&opened.config)?.context("record: only traffic can be recorded")?;
            opened.domain = Arc::new(traffic.record_on(tape));
        }
        let mut hand_coded = Vec::new();
        let controllers: Vec<&String> = request.controller_for.values().collect::<BTreeSet<_>>().into_iter().collect();
        for name in request.controller_for.keys() {
            hand_coded.push(opened.agent(name)?);
        }
        hand_coded.sort_unstable();
        let domain = &opened.domain;
        let mut simulator = match controllers[..] {
            [] => domain.global_simulator()?,
            [controller] => domain.with_background(controller, &hand_coded)?,
            [one, other, ..] => {
                bail!("controller_for: `{one}` and `{other}`: all these agents need the same controller")
            }
        };
        ensure!(
            hand_coded.len() < opened.names.len(),
            "controller_for: names all agents; leave one out, or use `dials-traffic baseline`"
        );
        if request.draws {
            simulator.watch_scene()?;
            ensure!(simulator.scene().is_some(), "render_mode: this domain draws no pictures");
        }
        if request.full_metrics {
            simulator.measure_in_full()?;
        }
        let watches_roads = request.watches_roads || opened.own != OwnNames::default();
        ensure!(!watches_roads || simulator.watch_roads()?, NO_ROADS);
        let sum = |width: fn(&RegionSpec) -> usize| domain.kinds().specs().map(width).sum();
        let agents = opened.names.len();
        let sections = Sections {
            obs: memory.section::<f32>("obs", sum(|spec| spec.obs_dim), "f4"),
            masks: memory.section::<bool>("masks", sum(mask_width), "b1"),
            rewards: memory.section::<f32>("rewards", agents, "f4"),
        };
        let memory = memory.finish(agents)?;
        let roads = if watches_roads { Some((memory.behind()?, RoadsNow::default())) } else { None };
        Ok(Joint {
            roads,
            simulator,
            hand_coded,
            memory,
            sections,
            actions: vec![0; agents],
            under_way: false,
            tape,
            opened,
        })
    }
}

/// Returns the number of bits that say which actions an agent may take.
fn mask_width(spec: &RegionSpec) -> usize {
    if spec.masks { spec.n_actions } else { 0 }
}

impl Sections {
    fn put(&self, memory: &mut Memory, percept: &JointPercept) {
        memory.put(&self.obs, percept.obs.as_slice());
        memory.put(&self.masks, percept.masks.as_slice());
    }
}

impl Joint {
    pub(crate) fn describe(&self) -> Value {
        let kinds = self.opened.domain.kinds();
        let agents = self.opened.names.iter().zip(AgentId::all(self.opened.names.len())).map(|(name, id)| {
            let mut about = agent::describe(name, kinds.of(id));
            about.insert("hand_coded".to_owned(), json!(self.hand_coded.contains(&id)));
            about
        });
        json!({
            "agents": agents.collect::<Vec<_>>(),
            "horizon": kinds.horizon(),
            "memory": self.memory.describe(),
            "own": self.opened.own,
        })
    }

    /// Does what is ordered and returns the answer's payload.
    pub(crate) fn obey(&mut self, tag: u8, payload: &[u8]) -> Result<Vec<u8>> {
        match tag {
            STEP => self.step().and_then(|()| self.show_roads()),
            RESET => self.reset(&wire::read(payload)?).and_then(|()| self.show_roads()),
            MEASURE => Ok(self.measure()?.to_string().into_bytes()),
            DRAW => self.draw(),
            LOOK => self.look(),
            KEEP => self.keep(&wire::read(payload)?),
            other => bail!("there is no order {other}"),
        }
    }

    /// Begins an episode: that of `evaluate` with this seed, number `episode`.
    fn reset(&mut self, request: &ResetRequest) -> Result<()> {
        // The tape has room for one episode.
        self.tape.iter().for_each(|tape| drop(tape.take()));
        let percept = self.simulator.reset(episode_seed(Seed::new(request.seed), request.episode))?;
        self.sections.put(&mut self.memory, percept);
        self.memory.put(&self.sections.rewards, &vec![0.0_f32; self.actions.len()]);
        self.under_way = true;
        self.memory.show()
    }

    fn step(&mut self) -> Result<()> {
        ensure!(self.under_way, "there is no episode under way; call reset() first");
        self.memory.read_actions(&mut self.actions)?;
        for ((action, spec), name) in
            self.actions.iter().zip(self.opened.domain.kinds().specs()).zip(&self.opened.names)
        {
            ensure!(
                usize::from(*action) < spec.n_actions,
                "agent `{name}`: action {action}; its actions are 0 to {}",
                spec.n_actions - 1
            );
        }
        let transition = self.simulator.step(&self.actions)?;
        self.sections.put(&mut self.memory, &transition.percept);
        self.memory.put(&self.sections.rewards, &transition.rewards);
        self.memory.show()
    }

    /// Returns the figures of the episode so far. With full metrics, the episode ends with them.
    fn measure(&mut self) -> Result<Value> {
        let measures = self.simulator.measures()?;
        let per_agent: serde_json::Map<_, _> =
            measures.per_agent.into_iter().map(|(name, values)| (name, json!(values))).collect();
        let system: serde_json::Map<_, _> =
            measures.system.into_iter().map(|(name, value)| (name, json!(value))).collect();
        Ok(json!({ "per_agent": per_agent, "system": system }))
    }

    /// Shows what is on the roads, if a function of the user sees it.
    fn show_roads(&mut self) -> Result<Vec<u8>> {
        let Some((memory, now)) = &mut self.roads else { return Ok(Vec::new()) };
        self.simulator.roads(now);
        memory.show(now, None)
    }

    /// Returns the roads of all agents as they always are, as JSON.
    fn look(&self) -> Result<Vec<u8>> {
        let tables = self.opened.domain.road_tables()?.context(NO_ROADS)?;
        Ok(serde_json::to_vec(&tables)?)
    }

    /// Returns width and height, four bytes each, and the pixels, three bytes each, row after row.
    fn draw(&self) -> Result<Vec<u8>> {
        let Some(scene) = self.simulator.scene() else {
            bail!("render_mode: pictures were not asked for when the environment was made")
        };
        let (width, height, pixels) = scene.to_pixels(SCALE);
        let mut bytes = [width as u32, height as u32].map(u32::to_le_bytes).concat();
        bytes.extend(pixels.iter().flat_map(|colour| colour.0));
        Ok(bytes)
    }

    /// Writes the recorded episode into a new folder. Returns the path of the file that sumo-gui opens.
    fn keep(&self, request: &KeepRequest) -> Result<Vec<u8>> {
        let tape = self.tape.as_ref().context("save_replay: make the environment with record=True")?;
        let recording = tape.take().context("save_replay: this episode was saved already")?;
        let folder = &request.folder;
        // SUMO does not play it here: this process holds a simulation.
        let kept = replay::check_place(folder).and_then(|()| {
            places::make(folder, Existing::Refuse, |staged| replay::write(&recording, staged.path())).map(drop)
        });
        if kept.is_err() {
            tape.put_back(recording); // Another folder may do.
        }
        kept?;
        Ok(replay::config_in(folder).as_os_str().as_bytes().to_vec())
    }
}
