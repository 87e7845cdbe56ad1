//! What a worker may say. The coordinator puts answers together by their sizes, so it checks these first: a worker that
//! says what cannot be right is lost, like one that dies.

use std::time::Duration;

use anyhow::{Result, ensure};

use super::message::{Answer, Order, WorkerReport};
use dials_core::base::AgentId;
use dials_core::domain::Measures;
use dials_learn::evaluation::EpisodeReport;
use dials_learn::influence::Dataset;
use dials_learn::policy::Demonstrations;
use dials_learn::training::answers::{PolicyTraining, WorkerLoad};
use dials_learn::training::fits::Fit;
use dials_learn::training::state::AgentsState;

/// Longest time that a worker may report, about ten years.
const LONGEST: Duration = Duration::from_secs(10 * 365 * 24 * 3600);
/// Largest memory that a worker may report.
const LARGEST_KIB: u64 = 1 << 50;

/// The answer that an order must get.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Expected {
    /// The order only prepares the next one.
    Ready,
    /// State at the beginning of a run.
    State,
    Demonstrations {
        episodes: usize,
    },
    Imitated,
    Datasets {
        episodes: usize,
    },
    AipsTrained,
    AipsMeasured,
    /// Agents that were trained up to this step.
    PoliciesTrained {
        end: u64,
    },
    Reports {
        episodes: usize,
    },
}

impl Expected {
    pub fn of(order: &Order) -> Expected {
        match order {
            Order::Begin { .. } | Order::Restore(_) | Order::TakePolicies(_) => Expected::Ready,
            Order::TellState => Expected::State,
            Order::Demonstrate { episodes, .. } => Expected::Demonstrations { episodes: episodes.len() },
            Order::Imitate { .. } => Expected::Imitated,
            Order::Collect { episodes, .. } => Expected::Datasets { episodes: episodes.len() },
            Order::TrainAips { .. } => Expected::AipsTrained,
            Order::MeasureAips { .. } => Expected::AipsMeasured,
            Order::TrainPolicies { period } => Expected::PoliciesTrained { end: period.end },
            Order::Evaluate { episodes } => Expected::Reports { episodes: episodes.len() },
        }
    }
}

/// The agents of one worker, by which its words are checked.
pub struct Speaker<'a>(pub Fit<'a>);

impl Speaker<'_> {
    /// Returns an error if a report cannot be right. `expected`: what its open order must be answered by, if it has one.
    pub fn check(&self, report: &WorkerReport, expected: Option<Expected>) -> Result<()> {
        match report {
            WorkerReport::Failed { .. } => Ok(()),
            WorkerReport::Trained { steps } => {
                let end = match expected {
                    Some(Expected::PoliciesTrained { end }) => end,
                    _ => anyhow::bail!("it trained without an order to"),
                };
                let most = self.0.config.update_at_or_after(end);
                ensure!(*steps <= most, "it trained for {steps} steps, of at most {most}");
                Ok(())
            }
            WorkerReport::Busy { share, .. } => {
                ensure!((0.0..1.01).contains(share), "it has done {share} of its work");
                Ok(())
            }
            WorkerReport::Done { answer, load, .. } => {
                check_load(load)?;
                match &**answer {
                    // A worker that has begun or was restored says so, too.
                    Answer::Ready => Ok(()),
                    answer => self.check_answer(answer, expected),
                }
            }
        }
    }

    fn check_answer(&self, answer: &Answer, expected: Option<Expected>) -> Result<()> {
        match (answer, expected) {
            (Answer::State(state), Some(Expected::State)) => self.check_state(state, 0),
            (Answer::Demonstrated(demonstrations), Some(Expected::Demonstrations { episodes })) => {
                self.check_demonstrations(demonstrations, episodes)
            }
            (Answer::Imitated { losses, policies }, Some(Expected::Imitated)) => {
                ensure!(losses.len() == self.0.agents.len(), "{} of its agents have imitated", losses.len());
                self.0.check_policies("policies", policies)
            }
            (Answer::Collected(datasets), Some(Expected::Datasets { episodes })) => {
                self.check_datasets(datasets, episodes)
            }
            (Answer::AipsTrained { losses, aips }, Some(Expected::AipsTrained)) => {
                self.check_losses(losses.iter().map(|loss| {
                    let lengths = loss.training.iter().chain(&loss.held_out).chain([&loss.marginals]).map(Vec::len);
                    lengths.chain([loss.frequencies.len()]).collect()
                }))?;
                self.0.check_aips("aips", aips)
            }
            (Answer::AipsMeasured(losses), Some(Expected::AipsMeasured)) => {
                self.check_losses(losses.iter().map(|loss| vec![loss.predictor.len(), loss.marginals.len()]))
            }
            (Answer::PoliciesTrained { training, state }, Some(Expected::PoliciesTrained { end })) => {
                self.check_training(training)?;
                self.check_state(state, self.0.config.update_at_or_after(end))
            }
            (Answer::Evaluated(reports), Some(Expected::Reports { episodes })) => self.check_reports(reports, episodes),
            (_, None) => anyhow::bail!("it answered without an order"),
            (_, Some(_)) => anyhow::bail!("it answered another order than the one it has"),
        }
    }

    fn check_state(&self, state: &AgentsState, steps: u64) -> Result<()> {
        ensure!(state.steps == steps, "its agents are at step {}, not at {steps}", state.steps);
        self.0.check(state)
    }

    /// Checks the datasets of all agents, not only those of the worker.
    fn check_datasets(&self, datasets: &[Dataset], episodes: usize) -> Result<()> {
        let agents = self.0.kinds.agents();
        ensure!(datasets.len() == agents, "it made {} datasets, not {agents}", datasets.len());
        for (agent, (dataset, spec)) in datasets.iter().zip(self.0.kinds.specs()).enumerate() {
            let Dataset { d_sets, sources, horizon, own_sources } = dataset;
            let samples = episodes * spec.horizon;
            let shapes = (d_sets.width(), sources.width(), *horizon, *own_sources);
            let own = self.0.kinds.sources(AgentId(agent));
            ensure!(
                shapes == (spec.d_set_dim, spec.sources.count(), spec.horizon, own)
                    && d_sets.len() == samples
                    && sources.len() == samples,
                "the dataset of agent {agent} does not have {samples} samples of its region"
            );
            let known = |row: &[u8]| row.iter().zip(&spec.sources.classes).all(|(class, classes)| class < classes);
            ensure!(sources.iter().all(known), "the dataset of agent {agent} has unknown influence sources");
        }
        Ok(())
    }

    /// Checks the demonstrations of all agents, not only those of the worker.
    fn check_demonstrations(&self, demonstrations: &[Demonstrations], episodes: usize) -> Result<()> {
        let agents = self.0.kinds.agents();
        ensure!(demonstrations.len() == agents, "it made demonstrations of {} agents", demonstrations.len());
        for (agent, (made, spec)) in demonstrations.iter().zip(self.0.kinds.specs()).enumerate() {
            let samples = episodes * spec.horizon;
            ensure!(
                made.fits(spec, samples),
                "the demonstrations of agent {agent} do not have {samples} samples of its region"
            );
        }
        Ok(())
    }

    /// Checks the numbers of losses of every agent: one per influence source that it has.
    fn check_losses(&self, losses: impl ExactSizeIterator<Item = Vec<usize>>) -> Result<()> {
        ensure!(losses.len() == self.0.agents.len(), "it measured the AIPs of {} agents", losses.len());
        let fits = |(agent, lengths): (usize, Vec<usize>)| {
            let own = self.0.kinds.sources(AgentId(agent));
            lengths.into_iter().all(|count| count == own)
        };
        ensure!(
            self.0.agents.clone().zip(losses).all(fits),
            "it measured other influence sources than its agents have"
        );
        Ok(())
    }

    fn check_training(&self, training: &PolicyTraining) -> Result<()> {
        ensure!(training.agents.len() == self.0.agents.len(), "it trained {} agents", training.agents.len());
        Ok(())
    }

    fn check_reports(&self, reports: &[EpisodeReport], episodes: usize) -> Result<()> {
        ensure!(reports.len() == episodes, "it played {} episodes, not {episodes}", reports.len());
        let agents = self.0.kinds.agents();
        for EpisodeReport { returns, measures } in reports {
            ensure!(
                returns.len() == agents && measures.per_agent.iter().all(|(_, values)| values.len() == agents),
                "its episodes are not of {agents} agents"
            );
            ensure!(returns.iter().all(|value| value.is_finite()), "a return is not a finite number");
            ensure!(same_names(&reports[0], measures), "its episodes have different measures");
        }
        Ok(())
    }
}

/// Returns whether an episode has the measures of another one.
pub fn same_names(first: &EpisodeReport, other: &Measures) -> bool {
    let Measures { per_agent, system } = &first.measures;
    per_agent.iter().map(|(name, _)| name).eq(other.per_agent.iter().map(|(name, _)| name))
        && system.iter().map(|(name, _)| name).eq(other.system.iter().map(|(name, _)| name))
}

fn check_load(load: &WorkerLoad) -> Result<()> {
    let WorkerLoad { timesheet, footprint } = load;
    ensure!(timesheet.longest() <= LONGEST, "it worked for {:?}", timesheet.longest());
    let largest = footprint.peak_rss_kib.max(footprint.pss_kib);
    ensure!(largest <= LARGEST_KIB, "it uses {largest} KiB of memory");
    Ok(())
}
