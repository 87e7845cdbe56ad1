//! The players of the episode that `replay` records: a controller, trained policies, or one agent's local simulator.

use std::path::Path;

use anyhow::{Context, Result, bail};

use super::directory;
use super::domain;
use super::outputs::check_seconds;
use super::subject::{Subject, agent_called};
use crate::base::{AgentId, RandomPurpose, Seed, Stopwatch};
use crate::cli;
use crate::config::{Config, load};
use crate::domain::Domain;
use crate::evaluation::{episode_seed, play};
use crate::influence::TrainablePredictor;
use crate::policy::{JointPolicyController, Selection, StackController};
use crate::records::files;
use crate::records::joint_layout::JointLayout;
use crate::traffic::Traffic;
use crate::traffic::sim::recording::{Recording, Tape};
use crate::training::block::initial_aips;
use crate::training::environment::Environment;
use crate::training::ials::Ials;
use crate::training::stream::{AgentStream, RowStream};

/// An episode that is ready to be played: checked and loaded.
pub struct ReplayedEpisode {
    tape: Tape,
    traffic: Traffic,
    seed: Seed,
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
    pub fn choose(args: &cli::ReplayArgs) -> Result<ReplayedEpisode> {
        let tape = Tape::default();
        let subject = &args.subject;
        let with = |config: &Config, cast: Cast| -> Result<ReplayedEpisode> {
            let seed = episode_seed(Seed::new(args.episode_seed.unwrap_or(config.evaluation.seed)), 0);
            let traffic =
                domain::open_recorded(config, &tape).context("only episodes that SUMO simulates can be replayed")?;
            args.seconds.iter().try_for_each(|seconds| check_seconds(seconds, traffic.seconds()))?;
            Ok(ReplayedEpisode { tape: tape.clone(), traffic, seed, cast })
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
            bail!("{}: a config has no policies; add --controller, or name a run directory", subject.display());
        }
        let run = directory::open(subject)?;
        let selection = if args.greedy { Selection::Greedy } else { Selection::Sampled };
        let cast = match &args.local {
            None => Cast::Policies(run.controller(selection)),
            Some(word) => {
                let agent = agent_called(&*run.domain, word, "--local")?;
                let (spec, policy) = (&run.domain.kinds().of(agent).spec, run.policies.pick([agent.0]).into_rows());
                let policy = StackController::new(spec, &run.config.policy, &policy, selection);
                Cast::Local { agent, policy, aip: aip_of(agent, &*run.domain, &run.config, subject)? }
            }
        };
        with(&run.config, cast)
    }

    /// Plays the episode and returns its recording.
    pub fn play(self) -> Result<Recording> {
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
                let dice = self.seed.fork(RandomPurpose::Influence).for_agent(agent).dice();
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

/// Reads the AIP of an agent from a run directory.
fn aip_of(agent: AgentId, domain: &dyn Domain, config: &Config, run_dir: &Path) -> Result<Box<dyn TrainablePredictor>> {
    let choice = config.simulator.predictor().with_context(|| {
        format!(
            "{}: was trained on the GS and has no AIPs, so its local simulators cannot be replayed",
            run_dir.display()
        )
    })?;
    let mut aip = initial_aips(domain, config, &[agent]);
    // A predictor that is never trained is never written.
    if choice.learns() {
        let layout = JointLayout::of_aips(domain.kinds(), choice, &config.aip);
        let aips = layout.read(&run_dir.join(files::AIPS))?;
        aip.load(&aips.pick([agent.0]).into_rows());
    }
    Ok(aip)
}
