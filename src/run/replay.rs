//! `replay`: writes one episode as a folder that SUMO plays; on request opens it in sumo-gui or films it.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, Result, bail, ensure};

use super::events::EventFiles;
use super::plot::draw_recording;
use super::subject::{Subject, agent_called, selection};
use crate::cli;
use crate::film::{self, Format, Replay, Shape, check_screen, watch};
use dials_core::base::{AgentId, RandomPurpose, Seed, Stopwatch, counted};
use dials_core::domain::{Domain, GlobalSimulator};
use dials_core::outside::{folder_of, quoted, temporary_dir};
use dials_learn::environments::ials::Ials;
use dials_learn::evaluation::{episode_seed, play};
use dials_learn::policy::{JointPolicyController, StackController};
use dials_learn::predictors::TrainablePredictor;
use dials_learn::state::stream::{AgentStream, Part, RowStream};
use dials_report::plot::About;
use dials_session::config::{RunConfig, load};
use dials_session::error::{self, Error};
use dials_session::outputs::{check_apart, check_can_be_made, check_free, check_not_a_run, check_seconds};
use dials_session::places::{self, Existing};
use dials_session::terminal::{Wish, answer, stop_on_signals, warn};
use dials_session::{directory, domains};
use dials_traffic::Traffic;
use dials_traffic::sim::recording::{Recording, Tape};
use dials_traffic::sim::replay::{self, SPEED_COLOURS, Snapshot, view};

pub(crate) fn replay(args: &cli::ReplayArgs) -> dials_session::error::Result<()> {
    let existing = Existing::of_named(args.force);
    if !args.subject.exists() {
        // An error about the outputs would only be the next one.
        ReplayedEpisode::choose(args).map_err(Error::Usage)?;
    }
    check_not_a_run("--out", &args.out).map_err(Error::Usage)?;
    let dir = places::place(&args.out, existing).map_err(Error::Usage)?;
    replay::check_place(&dir).map_err(Error::Usage)?;
    let places = [
        ("--out", Some(&*args.out)),
        ("--video", args.video.as_deref()),
        ("--plot", args.plot.as_deref()),
        ("--events", args.events.as_deref()),
    ];
    check_apart(&places).map_err(Error::Usage)?;
    args.plot.iter().try_for_each(|plot| check_free(plot, "--plot", existing)).map_err(Error::Usage)?;
    check_seconds_are_shown(args).map_err(Error::Usage)?;
    // Not only when the episode has been played.
    places.iter().filter_map(|(_, path)| *path).try_for_each(check_can_be_made).map_err(Error::Usage)?;
    let video = args.video.as_deref().map(|file| Video::asked_for(file, existing)).transpose().map_err(Error::Usage)?;
    if args.gui {
        check_screen().map_err(Error::Usage)?;
    }
    let mut episode = ReplayedEpisode::choose(args).map_err(Error::Usage)?;
    let mut events = episode.events.take();
    let about = About { subject: subject(args), seed: episode.run };
    let recording = episode.play(events.is_some()).map_err(Error::Run)?;
    if let Some(events) = &mut events {
        events.append().map_err(Error::Run)?;
        events.note_written();
    }
    places::make(&dir, existing, |staged| {
        replay::write(&recording, staged.path())?;
        replay::check(&recording, staged.path())
    })
    .map_err(Error::Run)?;
    let config = replay::config_in(&dir);
    answer(format_args!(
        "written to {}: {}, {}; SUMO replays it to the last bit\nwatch it with: sumo-gui -c {}",
        dir.display(),
        counted(recording.steps.len(), "second"),
        counted(recording.entries.len(), "car"),
        quoted(&config)
    ))
    .map_err(Error::Run)?;
    if let Some(plot) = &args.plot {
        draw_recording(&recording, args.seconds.clone(), &about, (plot, existing)).map_err(Error::Run)?;
    }
    if let Some(video) = video {
        let steps = args.seconds.clone().unwrap_or(0..recording.steps.len());
        let snapshots = |pictures: &[PathBuf]| {
            let snapshot = |(step, file): (usize, &PathBuf)| Snapshot { file: file.clone(), step };
            view(&recording.roads, 0, &steps.clone().zip(pictures).map(snapshot).collect::<Vec<_>>())
        };
        let shape = match recording.roads.grid() {
            Some(grid) => Shape::Grid { columns: grid.cols(), rows: grid.rows() },
            None => {
                let [wide_m, tall_m] = recording.roads.extent_m();
                Shape::Map { wide_m, tall_m }
            }
        };
        let begin_s = recording.roads.begin_s();
        let (title, speeds) = (&*about.subject, &SPEED_COLOURS[..]);
        let settings = &snapshots;
        video.make(&Replay { title, speeds, config: &config, begin_s, steps: steps.clone(), shape, settings })?;
        answer(format_args!("wrote the film {}", video.file.display())).map_err(Error::Run)?;
    }
    if args.gui { watch(&config).map_err(Error::Run) } else { Ok(()) }
}

fn check_seconds_are_shown(args: &cli::ReplayArgs) -> Result<()> {
    ensure!(
        args.seconds.is_none() || args.video.is_some() || args.plot.is_some(),
        "--seconds: is for --video and --plot, and a replay always has the whole episode; add one of them"
    );
    Ok(())
}

fn subject(args: &cli::ReplayArgs) -> String {
    let name = args.subject.display();
    match (&args.controller, &args.local) {
        (Some(controller), _) => format!("controller {controller} on {name}"),
        (None, Some(agent)) => format!("agent {agent} of {name} in its local simulator"),
        (None, None) => format!("policies of {name}"),
    }
}

/// An episode that is ready to be played: checked and loaded.
struct ReplayedEpisode {
    tape: Tape,
    traffic: Traffic,
    /// Seed of all its evaluation episodes, of which this is the first one.
    run: u64,
    cast: Cast,
    /// Files of `--events`.
    events: Option<EventFiles>,
}

enum Cast {
    Baseline(String),
    /// The trained policies on the whole grid.
    Policies(JointPolicyController),
    /// The policy of one agent in its local simulator, with cars from its approximate influence predictor (AIP).
    Local {
        agent: AgentId,
        policy: StackController,
        aip: Box<dyn TrainablePredictor>,
    },
}

impl ReplayedEpisode {
    fn choose(args: &cli::ReplayArgs) -> Result<ReplayedEpisode> {
        let tape = Tape::default();
        let subject = &args.subject;
        let with = |config: &RunConfig, cast: Cast| -> Result<ReplayedEpisode> {
            let run = args.episode_seed.unwrap_or(config.learning.evaluation.seed);
            let traffic =
                domains::open_recorded(config, &tape).context("only episodes that SUMO simulates can be replayed")?;
            let length_s = if args.local.is_some() { traffic.local_seconds() } else { traffic.seconds() };
            args.seconds.iter().try_for_each(|seconds| check_seconds(seconds, length_s))?;
            let existing = Existing::of_named(args.force);
            let events = EventFiles::asked_for(args.events.as_deref(), existing, config)?.map(|(_, events)| events);
            let traffic = match &events {
                Some(events) => traffic.log_events(&events.log),
                None => traffic,
            };
            Ok(ReplayedEpisode { tape: tape.clone(), traffic, run, cast, events })
        };
        if let Some(controller) = &args.controller {
            let config = if subject.is_dir() {
                directory::open_unchanged(subject, domains::find)?.0
            } else {
                load(subject, &args.settings.all())?
            };
            let episode = with(&config, Cast::Baseline(controller.clone()))?;
            let subject = Subject::Controller(controller.clone());
            subject.check(&episode.traffic)?;
            subject.warn(&episode.traffic)?;
            return Ok(episode);
        }
        if subject.is_file() {
            bail!("{}: a config has no policies; add --controller, or name a run directory", subject.display());
        }
        let run = directory::open(subject)?;
        run.note_still_trained(subject);
        let selection = selection(args.greedy);
        let cast = match &args.local {
            None => Cast::Policies(run.controller(selection)),
            Some(word) => {
                let agent = agent_called(&*run.domain, word, "--local")?;
                let (spec, policy) = (&run.domain.kinds().of(agent).spec, run.policies.pick([agent.0]).into_rows());
                let policy = StackController::new(spec, &run.config.learning, &policy, selection);
                Cast::Local { agent, policy, aip: directory::read_aips(subject, &run.config, &*run.domain, &[agent])? }
            }
        };
        with(&run.config, cast)
    }

    /// `logs`: whether the episode goes into an event log, which SUMO completes when it is measured.
    fn play(self, logs: bool) -> Result<Recording> {
        let measured = |simulator: &mut dyn GlobalSimulator| if logs { simulator.measure_in_full() } else { Ok(()) };
        let seed = episode_seed(Seed::new(self.run), 0);
        match self.cast {
            Cast::Baseline(name) => {
                let mut baseline = self.traffic.baseline(&name)?;
                measured(&mut *baseline.simulator)?;
                play(&mut *baseline.simulator, &mut *baseline.controller, seed)?;
            }
            Cast::Policies(mut policies) => {
                let mut simulator = self.traffic.global_simulator()?;
                measured(&mut *simulator)?;
                play(&mut *simulator, &mut policies, seed)?;
            }
            Cast::Local { agent, mut policy, mut aip } => {
                let simulator = self.traffic.local_simulator(&[agent], 1, seed)?;
                let dice = seed.fork(RandomPurpose::Influence).for_agent(agent).dice();
                let stream = AgentStream { rows: vec![RowStream::begin(dice)] };
                let whole = Part { agents: 0..1, copies: 0..1 };
                let mut ials = Ials::resume(simulator, &mut *aip, whole, &[stream], false, &mut || ())?;
                policy.begin(seed.for_agent(agent), &AgentId::all(1));
                for _ in 0..self.traffic.kinds().of(agent).spec.local_horizon {
                    let actions = policy.act(ials.percept());
                    ials.decide(&actions, &mut Stopwatch::default())?;
                }
            }
        }
        self.tape.take().context("the simulator recorded nothing")
    }
}

/// A film that can be made: its tools and its folder were checked.
struct Video {
    file: PathBuf,
    format: Format,
    existing: Existing,
}

impl Video {
    fn asked_for(file: &Path, existing: Existing) -> Result<Video> {
        let format =
            Format::of(file).with_context(|| format!("--video {}: must end in .gif or .mp4", file.display()))?;
        format.check_tools()?;
        check_free(file, "--video", existing)?;
        let folder = folder_of(file);
        ensure!(folder.is_dir(), "{}: there is no such directory for the film; make it first", folder.display());
        Ok(Video { file: file.to_owned(), format, existing })
    }

    /// Films a replay. Ctrl-C stops this and leaves no file behind.
    fn make(&self, replay: &Replay) -> error::Result<()> {
        let room = temporary_dir().context("the pictures have no place").map_err(Error::Run)?;
        let last_words = format!("stopped; {} was not made", self.file.display());
        let (pictures, words) = (room.path().to_owned(), last_words.clone());
        let stop = stop_on_signals(move |wish| {
            if wish == Wish::StopNow {
                warn(&words);
                // The process ends without its destructors.
                let _ = fs::remove_dir_all(&pictures);
            }
        });
        let stop = stop.map_err(Error::Run)?;
        match self.film(replay, room.path(), &stop) {
            Err(_) if stop.load(Ordering::Relaxed) => Err(Error::Interrupted(last_words)),
            done => done.map_err(Error::Run),
        }
    }

    fn film(&self, replay: &Replay, room: &Path, stop: &AtomicBool) -> Result<()> {
        let pictures = film::take(replay, room, stop)?;
        places::make_file(&self.file, self.existing, |beside| film::join(&pictures, self.format, beside, stop))
    }
}
