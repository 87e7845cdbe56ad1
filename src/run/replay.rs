//! `replay`: one episode as a folder that SUMO plays, on a screen if there is one, as a film if somebody asks for it.

use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, anyhow, bail, ensure};

use super::directory::{self, Existing};
use super::domain;
use super::subject::Subject;
use super::terminal::{answer, on_the_path, quoted};
use super::video::{SUMO_GUI, Video};
use crate::base::{AgentId, Seed, Stopwatch};
use crate::cli;
use crate::config::{Config, SimulatorKind, load};
use crate::domain::Domain;
use crate::error::Error;
use crate::evaluation::{episode_seed, play};
use crate::influence::TrainablePredictor;
use crate::policy::{JointPolicyController, Selection, StackController};
use crate::traffic::Traffic;
use crate::traffic::recording::{Recording, Tape};
use crate::traffic::replay;
use crate::training::block::initial_aips;
use crate::training::environment::Environment;
use crate::training::files;
use crate::training::ials::Ials;
use crate::training::joint_layout::JointLayout;
use crate::training::stream::{AgentStream, RowStream};

pub fn replay(args: &cli::Replay) -> crate::error::Result<()> {
    let existing = if args.force { Existing::MoveAside } else { Existing::Refuse };
    let dir = directory::place(&args.out, existing).map_err(Error::Usage)?;
    directory::check_apart(&[("--out", Some(&args.out)), ("--video", args.video.as_deref())]).map_err(Error::Usage)?;
    let video = args.video.as_deref().map(|file| Video::asked_for(file, existing)).transpose().map_err(Error::Usage)?;
    if args.gui {
        check_screen().map_err(Error::Usage)?;
    }
    let episode = Episode::choose(args).map_err(Error::Usage)?;
    let recording = episode.play().map_err(Error::Run)?;
    directory::make(&dir, existing, |staged| {
        replay::write(&recording, staged)?;
        replay::check(&recording, staged)
    })
    .map_err(Error::Run)?;
    let config = replay::config_in(&dir);
    answer(format_args!(
        "written to {}: {} steps, {} cars; SUMO plays it as it was, to the last bit\nwatch it with: sumo-gui -c {}",
        dir.display(),
        recording.steps.len(),
        recording.entries.len(),
        quoted(&config)
    ))
    .map_err(Error::Run)?;
    if let Some(video) = video {
        video.make(&recording, &config)?;
        answer(format_args!("filmed {}", video.file().display())).map_err(Error::Run)?;
    }
    if args.gui { watch(&config).map_err(Error::Run) } else { Ok(()) }
}

/// What is to be played, checked and loaded.
struct Episode {
    tape: Tape,
    traffic: Traffic,
    seed: Seed,
    cast: Cast,
}

/// Who plays it.
enum Cast {
    /// The whole grid under a hand-coded controller.
    Baseline(String),
    /// The whole grid under the trained policies.
    Policies(JointPolicyController),
    /// The local simulator of one agent under its policy, with cars from its AIP.
    Local { agent: AgentId, policy: StackController, aip: Box<dyn TrainablePredictor> },
}

impl Episode {
    fn choose(args: &cli::Replay) -> Result<Episode> {
        let tape = Tape::default();
        let subject = &args.subject;
        let with = |config: &Config, cast: Cast| -> Result<Episode> {
            let seed = episode_seed(Seed::new(args.episode_seed.unwrap_or(config.evaluation.seed)), 0);
            let traffic = domain::open_recorded(config, &tape).context("only what SUMO simulates can be replayed")?;
            Ok(Episode { tape: tape.clone(), traffic, seed, cast })
        };
        if let Some(controller) = &args.controller {
            let path = if subject.is_dir() { subject.join(files::CONFIG) } else { subject.clone() };
            let config = load(&path, &[])?;
            domain::check(&config)?;
            let episode = with(&config, Cast::Baseline(controller.clone()))?;
            Subject::Controller(controller.clone()).check(&episode.traffic)?;
            return Ok(episode);
        }
        if subject.is_file() {
            bail!("{}: a config has no policies; name a --controller, or a run directory", subject.display());
        }
        let run = directory::open(subject)?;
        let selection = if args.greedy { Selection::Greedy } else { Selection::Sampled };
        let cast = match args.local {
            None => Cast::Policies(run.controller(selection)),
            Some(agent) => {
                let agents = run.domain.agents();
                ensure!(agent < agents, "--local {agent}: this run has the agents 0 to {}", agents - 1);
                let agent = AgentId(agent);
                let (spec, policy) = (&run.domain.kinds().of(agent).spec, run.policies.pick([agent.0]).into_rows());
                let policy = StackController::new(spec, &run.config.policy, &policy, selection);
                Cast::Local { agent, policy, aip: aip_of(agent, &*run.domain, &run.config, subject)? }
            }
        };
        with(&run.config, cast)
    }

    fn play(self) -> Result<Recording> {
        match self.cast {
            Cast::Baseline(name) => {
                let mut baseline = self.traffic.baseline(&name)?;
                play(&mut *baseline.simulator, &mut *baseline.controller, self.seed)?;
            }
            Cast::Policies(mut policies) => {
                let mut simulator = self.traffic.global_simulator()?;
                play(&mut *simulator, &mut policies, self.seed)?;
            }
            Cast::Local { agent, mut policy, mut aip } => {
                let simulator = self.traffic.local_simulator(&[agent], 1, self.seed)?;
                let dice = self.seed.fork("influence").for_agent(agent).dice();
                let stream =
                    AgentStream { minibatches: dice.clone(), rows: vec![RowStream::begin(dice.clone(), dice, &[])] };
                let mut ials = Ials::resume(simulator, &mut *aip, &[stream], false)?;
                policy.begin(self.seed.for_agent(agent), &AgentId::all(1));
                for _ in 0..self.traffic.kinds().horizon() {
                    let actions = policy.act(&ials.percepts()[0]);
                    ials.step(&[actions], &mut Stopwatch::default())?;
                }
            }
        }
        self.tape.take().context("the simulator recorded nothing")
    }
}

/// The AIP of an agent as the run left it.
fn aip_of(agent: AgentId, domain: &dyn Domain, config: &Config, run_dir: &Path) -> Result<Box<dyn TrainablePredictor>> {
    let mut aip = initial_aips(domain, config, &[agent]);
    match config.simulator {
        // Never trained, so never written either.
        SimulatorKind::UntrainedDials => Ok(aip),
        SimulatorKind::Gs => {
            Err(anyhow!("{}: was trained on the GS and has no AIPs to drive a local simulator with", run_dir.display()))
        }
        SimulatorKind::Dials | SimulatorKind::MarginalDials => {
            let layout = JointLayout::of_aips(domain.kinds(), config.simulator, &config.aip);
            let aips = layout.read(&run_dir.join(files::AIPS))?;
            aip.load(&aips.pick([agent.0]).into_rows());
            Ok(aip)
        }
    }
}

/// An error with the way out if sumo-gui could not be opened.
fn check_screen() -> Result<()> {
    ensure!(on_the_path(SUMO_GUI).is_some(), "--gui: sumo-gui is not on the PATH: install Debian's package sumo");
    let display = std::env::var_os("DISPLAY").filter(|display| !display.is_empty());
    ensure!(
        display.is_some(),
        "--gui: there is no screen here (DISPLAY is not set); make a film with --video, or take the folder to a machine \
         that has one: it needs nothing but SUMO"
    );
    Ok(())
}

/// Opens sumo-gui and waits until it is closed.
fn watch(config: &Path) -> Result<()> {
    let status = Command::new(SUMO_GUI)
        .arg("-c")
        .arg(config)
        .arg("--start")
        .status()
        .context("sumo-gui could not be started")?;
    ensure!(
        status.success(),
        "sumo-gui ended with {status}; the folder is whole, open it with: sumo-gui -c {}",
        quoted(config)
    );
    Ok(())
}
