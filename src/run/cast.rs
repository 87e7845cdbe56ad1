//! The players of the episode that `replay` records: a controller, trained policies, or one agent's local simulator.

use anyhow::{Context, Result, bail};

use super::subject::{Subject, agent_called};
use crate::cli;
use dials_core::base::{AgentId, RandomPurpose, Seed, Stopwatch};
use dials_core::domain::Domain;
use dials_learn::environments::Environment;
use dials_learn::environments::ials::Ials;
use dials_learn::evaluation::{episode_seed, play};
use dials_learn::policy::{JointPolicyController, Selection, StackController};
use dials_learn::predictors::TrainablePredictor;
use dials_learn::state::stream::{AgentStream, RowStream};
use dials_session::config::{RunConfig, load};
use dials_session::directory;
use dials_session::domains;
use dials_session::outputs::check_seconds;
use dials_traffic::Traffic;
use dials_traffic::sim::recording::{Recording, Tape};

/// An episode that is ready to be played: checked and loaded.
pub(super) struct ReplayedEpisode {
    tape: Tape,
    traffic: Traffic,
    /// Seed of all its evaluation episodes, of which this is the first one.
    run: u64,
    cast: Cast,
}

/// The players of an episode.
enum Cast {
    /// A hand-coded controller on the whole grid.
    Baseline(String),
    /// The trained policies on the whole grid.
    Policies(JointPolicyController),
    /// The policy of one agent in its local simulator, with cars from its approximate influence predictor (AIP).
    Local { agent: AgentId, policy: StackController, aip: Box<dyn TrainablePredictor> },
}

impl ReplayedEpisode {
    pub(super) fn choose(args: &cli::ReplayArgs) -> Result<ReplayedEpisode> {
        let tape = Tape::default();
        let subject = &args.subject;
        let with = |config: &RunConfig, cast: Cast| -> Result<ReplayedEpisode> {
            let run = args.episode_seed.unwrap_or(config.learning.evaluation.seed);
            let traffic =
                domains::open_recorded(config, &tape).context("only episodes that SUMO simulates can be replayed")?;
            let length_s = if args.local.is_some() { traffic.local_seconds() } else { traffic.seconds() };
            args.seconds.iter().try_for_each(|seconds| check_seconds(seconds, length_s))?;
            Ok(ReplayedEpisode { tape: tape.clone(), traffic, run, cast })
        };
        if let Some(controller) = &args.controller {
            let config = if subject.is_dir() {
                directory::open_unchanged(subject, domains::open)?.0
            } else {
                load(subject, &[])?
            };
            domains::check(&config)?;
            let episode = with(&config, Cast::Baseline(controller.clone()))?;
            Subject::Controller(controller.clone()).check(&episode.traffic)?;
            return Ok(episode);
        }
        if subject.is_file() {
            bail!("{}: a config has no policies; add --controller, or name a run directory", subject.display());
        }
        let run = directory::open(subject)?;
        run.note_still_trained(subject);
        let selection = if args.greedy { Selection::Greedy } else { Selection::Sampled };
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

    /// Returns the seed whose first episode this is.
    pub(super) fn seed_of_episodes(&self) -> u64 {
        self.run
    }

    /// Plays the episode and returns its recording.
    pub(super) fn play(self) -> Result<Recording> {
        let seed = episode_seed(Seed::new(self.run), 0);
        match self.cast {
            Cast::Baseline(name) => {
                let mut baseline = self.traffic.baseline(&name)?;
                play(&mut *baseline.simulator, &mut *baseline.controller, seed)?;
            }
            Cast::Policies(mut policies) => {
                let mut simulator = self.traffic.global_simulator()?;
                play(&mut *simulator, &mut policies, seed)?;
            }
            Cast::Local { agent, mut policy, mut aip } => {
                let simulator = self.traffic.local_simulator(&[agent], 1, seed)?;
                let dice = seed.fork(RandomPurpose::Influence).for_agent(agent).dice();
                let stream = AgentStream { rows: vec![RowStream::begin(dice)] };
                let mut ials = Ials::resume(simulator, &mut *aip, &[stream], false, &mut || ())?;
                policy.begin(seed.for_agent(agent), &AgentId::all(1));
                for _ in 0..self.traffic.kinds().of(agent).spec.local_horizon {
                    let actions = policy.act(&ials.percepts()[0]);
                    ials.step(&[actions], &mut Stopwatch::default())?;
                }
            }
        }
        self.tape.take().context("the simulator recorded nothing")
    }
}
