//! A predictor outside of this program: it learns and samples in a Python process, and everything else is as for AIPs.
//!
//! - [`OutsidePredictor`]: what the other process does. [`install`] makes it known.
//! - The coordinator of a run lets it learn, from the datasets of all agents at once, and keeps its state for checkpoints.
//! - Every worker asks for the sources of its own rows. Each row brings numbers of its own dice, one per source, with which
//!   our predictors would draw. So neither workers nor a kill of the run change what is drawn.
//!
//! What agents have learnt is in the other process. In the table of AIPs each has a zero.

use std::ops::Range;
use std::sync::{Mutex, MutexGuard, OnceLock};

use anyhow::{Context, ensure};
use rand::Rng;

use super::train::{effect, fresh, split};
use super::{
    AipLoss, CrossEntropies, Dataset, FreshLoss, InfluencePredictor, Lesson, PredictorKind, TrainablePredictor,
};
use crate::config::AipConfig;
use dials_core::base::{AgentId, Dice, Rows, Seed, Stopwatch, Work};
use dials_core::domain::{Kinds, RegionSpec, Result, SourceSpec};
use stacknets::Layout;

/// Losses of every agent, for each source that it has: before a training and after it, on the training samples and on the
/// held-out ones.
pub type Losses = [[Vec<CrossEntropies>; 2]; 2];

/// What the other process does. Errors are those of its code, or say that it has ended.
pub trait OutsidePredictor: Send {
    /// Returns who samples for the rows of some agents of one kind, which are ordered by agent, then by copy.
    fn rows(&self, agents: &[AgentId], spec: &RegionSpec) -> Result<Box<dyn OutsideRows>>;

    /// Learns from the first `training` samples of the datasets, one per agent of the run.
    fn fit(&mut self, datasets: &[Dataset], training: usize) -> Result<Losses>;

    /// Returns the losses of every agent on its dataset, for each source that it has.
    fn losses(&mut self, datasets: &[Dataset]) -> Result<Vec<CrossEntropies>>;

    /// Returns what it must keep. Only it can read it.
    fn state(&mut self) -> Result<Vec<u8>>;

    /// Takes back what [`OutsidePredictor::state`] has returned.
    fn load(&mut self, state: &[u8]) -> Result<()>;
}

/// Some rows, in the other process.
pub trait OutsideRows: Send {
    /// Episodes begin in all rows, of which each agent has this number. What was learnt since the last call counts from now on.
    fn begin(&mut self, copies: usize) -> Result<()>;

    /// Episodes begin in these rows.
    fn forget(&mut self, rows: &[usize]) -> Result<()>;

    /// Shows the d-sets of a decision whose sources are already known.
    fn watch(&mut self, d_set: &Rows<f32>) -> Result<()>;

    /// Returns the sources of every row. `uniform`: a number from 0 to 1 for each.
    fn sample(&mut self, d_set: &Rows<f32>, uniform: &Rows<f32>) -> Result<Vec<u8>>;
}

/// A process has one, because one Python process started it.
static INSTALLED: OnceLock<Mutex<Box<dyn OutsidePredictor>>> = OnceLock::new();

/// Makes the predictor of this process known. Only the first call counts.
pub fn install(predictor: Box<dyn OutsidePredictor>) {
    INSTALLED.get_or_init(|| Mutex::new(predictor));
}

fn installed() -> Result<MutexGuard<'static, Box<dyn OutsidePredictor>>> {
    let installed = INSTALLED.get().context(
        "predictor = \"outside\": it is in a Python process; only dials_traffic.train(...) and dials_traffic.dials(...) can use it",
    )?;
    // What a panic has left is of no use, and the run ends with that panic.
    Ok(installed.lock().unwrap_or_else(|poisoned| poisoned.into_inner()))
}

/// Lets it go on from the state of a checkpoint, if it has learnt anything by then.
pub(crate) fn load(state: &[u8]) -> Result<()> {
    if state.is_empty() { Ok(()) } else { installed()?.load(state) }
}

/// Trains it on the datasets, one per agent of the run. Returns the losses, and its new state.
pub(crate) fn train(kinds: &Kinds, datasets: &[Dataset], config: &AipConfig) -> Result<(Vec<AipLoss>, Vec<u8>)> {
    let mut predictor = installed()?;
    let (training, _) = split(&datasets[0], config.held_out);
    let losses = predictor.fit(datasets, training)?;
    let of_agent = |(agent, dataset): (usize, &Dataset)| {
        let of_agent = |losses: &[Vec<CrossEntropies>; 2]| [losses[0][agent].clone(), losses[1][agent].clone()];
        let losses = [of_agent(&losses[0]), of_agent(&losses[1])];
        effect(sources(kinds, agent), dataset, training, losses, Vec::new())
    };
    let losses = datasets.iter().enumerate().map(of_agent).collect();
    let state = predictor.state()?;
    ensure!(!state.is_empty(), "the predictor in Python has no state");
    Ok((losses, state))
}

/// Measures its loss on the datasets, one per agent of the run.
pub(crate) fn measure(kinds: &Kinds, datasets: &[Dataset]) -> Result<Vec<FreshLoss>> {
    let losses = installed()?.losses(datasets)?;
    let of_agents = losses.into_iter().zip(datasets).enumerate();
    Ok(of_agents.map(|(agent, (loss, dataset))| fresh(sources(kinds, agent), dataset, loss)).collect())
}

fn sources(kinds: &Kinds, agent: usize) -> &SourceSpec {
    &kinds.of(AgentId(agent)).spec.sources
}

/// The kind of predictors in a Python process.
pub(super) struct InPython;

impl PredictorKind for InPython {
    fn learns(&self) -> bool {
        true
    }

    fn reads(&self, key: &str) -> bool {
        ["dataset_steps", "first_dataset_share", "held_out", "retrain", "retrain_every_steps", "drift_threshold"]
            .contains(&key)
    }

    fn make(&self, agents: &[AgentId], spec: &RegionSpec, _: &AipConfig, _: Seed) -> Box<dyn TrainablePredictor> {
        Box::new(OfAgents {
            agents: agents.to_vec(),
            spec: spec.clone(),
            rows: None,
            uniform: Rows::new(0, spec.sources.count()),
        })
    }

    fn layout(&self, _spec: &RegionSpec, _config: &AipConfig) -> Layout {
        Layout::new(vec![("outside".to_owned(), vec![1])])
    }

    fn sampling_flops(&self, _spec: &RegionSpec, _config: &AipConfig) -> f64 {
        0.0
    }
}

/// The predictor of some agents of one kind.
struct OfAgents {
    agents: Vec<AgentId>,
    spec: RegionSpec,
    /// Those for which it samples, once there are some.
    rows: Option<Box<dyn OutsideRows>>,
    uniform: Rows<f32>,
}

impl OfAgents {
    fn rows(&mut self) -> &mut dyn OutsideRows {
        &mut **self.rows.as_mut().expect("`begin` came first")
    }
}

impl InfluencePredictor for OfAgents {
    fn begin(&mut self, rows: usize) -> Result<()> {
        if self.rows.is_none() {
            self.rows = Some(installed()?.rows(&self.agents, &self.spec)?);
        }
        self.uniform = Rows::new(rows, self.spec.sources.count());
        let copies = rows / self.agents.len();
        self.rows().begin(copies)
    }

    fn forget(&mut self, rows: &[usize]) -> Result<()> {
        self.rows().forget(rows)
    }

    fn watch(&mut self, d_set: &Rows<f32>) -> Result<()> {
        self.rows().watch(d_set)
    }

    fn sample(&mut self, d_set: &Rows<f32>, dice: &mut [Dice], sources: &mut Rows<u8>) -> Result<()> {
        let count = self.spec.sources.count();
        for (numbers, dice) in self.uniform.as_mut_slice().chunks_exact_mut(count).zip(dice) {
            numbers.iter_mut().for_each(|number| *number = dice.random());
        }
        let rows = self.rows.as_mut().expect("`begin` came first");
        let drawn = rows.sample(d_set, &self.uniform)?;
        ensure!(drawn.len() == sources.as_slice().len(), "the predictor returned {} sources", drawn.len());
        // The simulator indexes by them.
        let known = drawn.iter().zip(self.spec.sources.classes.iter().cycle()).all(|(class, classes)| class < classes);
        ensure!(known, "the predictor returned a class that its source does not have");
        sources.as_mut_slice().copy_from_slice(&drawn);
        Ok(())
    }
}

impl TrainablePredictor for OfAgents {
    fn sources(&self) -> &SourceSpec {
        &self.spec.sources
    }

    fn values(&self) -> Rows<f32> {
        Rows::new(self.agents.len(), 1)
    }

    fn load(&mut self, _values: &Rows<f32>) {}

    fn learn(&mut self, _lesson: Lesson<'_>, _dice: &mut [Dice], _work: Work<'_, f64>) {
        unreachable!("the coordinator lets it learn: `train`");
    }

    fn losses(&self, _datasets: &[Dataset], _samples: Range<usize>, _watch: &mut Stopwatch) -> Vec<CrossEntropies> {
        unreachable!("the coordinator measures it: `measure`");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::{dice, region};

    /// Says what it was asked, and returns these sources.
    struct Given(Vec<u8>);

    impl OutsideRows for Given {
        fn begin(&mut self, copies: usize) -> Result<()> {
            ensure!(copies == 2);
            Ok(())
        }

        fn forget(&mut self, _rows: &[usize]) -> Result<()> {
            Ok(())
        }

        fn watch(&mut self, _d_set: &Rows<f32>) -> Result<()> {
            Ok(())
        }

        fn sample(&mut self, _d_set: &Rows<f32>, uniform: &Rows<f32>) -> Result<Vec<u8>> {
            // Each row draws from its own dice, source by source.
            let own: Vec<f32> = dice(2).iter_mut().flat_map(|dice| [dice.random(), dice.random()]).collect();
            ensure!(uniform.as_slice() == own, "{uniform:?}");
            Ok(self.0.clone())
        }
    }

    #[test]
    fn rows_draw_from_their_own_dice_and_sources_that_do_not_exist_are_refused() {
        let spec = region(1, 1, SourceSpec { classes: vec![2, 3], parts: 0 }, 4);
        let sample = |given: Vec<u8>| {
            let mut of_agent = OfAgents {
                agents: vec![AgentId(0)],
                spec: spec.clone(),
                rows: Some(Box::new(Given(given))),
                uniform: Rows::new(0, 2),
            };
            of_agent.begin(2)?;
            let mut sources = Rows::new(2, 2);
            of_agent.sample(&Rows::new(2, 1), &mut dice(2), &mut sources)?;
            Ok(sources.as_slice().to_vec())
        };
        assert_eq!(sample(vec![1, 2, 0, 1]).unwrap(), [1, 2, 0, 1]);
        let error = |given| sample(given).map_err(|error: anyhow::Error| error.to_string()).unwrap_err();
        assert_eq!(error(vec![2, 2, 0, 1]), "the predictor returned a class that its source does not have");
        assert_eq!(error(vec![1, 2]), "the predictor returned 2 sources");
    }
}
