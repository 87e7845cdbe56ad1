//! The table `[aip]`.

use anyhow::{Result, ensure};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Config;
use super::check::{check_batch, check_hidden, check_recurrent, inner_share, not_negative, positive};

/// The approximate influence predictors (AIPs).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AipConfig {
    /// Width of a GRU before the hidden layers. If left out, the AIP has no memory. Warehouse: 64. Not for scenarios:
    /// there it learns from whole episodes, and local simulators begin at drawn seconds, where its memory is empty.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(extend("source" = "P"))]
    pub recurrent: Option<usize>,
    /// Widths of the hidden layers, with ReLU; `[]` for none. Warehouse: `[64]`.
    #[schemars(extend("source" = "P"))]
    pub hidden: Vec<usize>,
    /// When the AIPs are trained again after their first training, which is at step 0: all of them or none.
    #[schemars(extend("source" = "P"))]
    pub retrain: Retrain,
    /// Timesteps per agent between two trainings of the AIPs (F), for `aip.retrain = "every"`; at least `ppo.memory`. The
    /// default is the paper's best for traffic. Scenarios: 54K.
    ///
    /// DEVIATION 12: our configs of the warehouse have 500K and not 4M, the paper's best there: AIPs that only know how
    /// random robots move are no better than constants.
    #[schemars(range(min = 1), extend("source" = "P"))]
    pub retrain_every_steps: u64,
    /// Threshold in percent for `aip.retrain = "drift"`. The AIPs' loss on new episodes is divided by the loss of the best
    /// constants. The AIPs are retrained when this share has grown by more than the threshold since their last training.
    pub drift_threshold: f64,
    /// Number of GS (global simulator) steps per dataset, rounded up to whole episodes, at least two: one is held out. A run
    /// shorter than that collects only as many steps as it has, if they fill a batch.
    #[schemars(range(min = 1, max = 10_000_000), extend("source" = "P"))]
    pub dataset_steps: usize,
    /// The first dataset, at step 0, has this share of the steps. Its policies are untrained, so what it teaches is soon wrong.
    /// Scenarios: 0.4.
    pub first_dataset_share: f64,
    /// Share of the episodes, the last ones, that only measure the loss. They also decide when `aip.patience` is over, and
    /// which sources keep their constants. Scenarios: 0.2.
    pub held_out: f64,
    /// Learning rate of the AIPs.
    #[schemars(extend("source" = "P"))]
    pub learning_rate: f64,
    /// Number of samples per agent and gradient step; with a GRU, of whole episodes. Warehouse: 32.
    #[schemars(range(min = 1), extend("source" = "P"))]
    pub batch: usize,
    /// Number of passes over the dataset per training. Warehouse: 300. Scenarios: 15.
    #[schemars(
        range(min = 1, max = 100_000),
        extend("source" = "P", "advice" = "for AIPs that are never trained: predictor = \"untrained\"")
    )]
    pub epochs: usize,
    /// Number of epochs without a lower loss on the held-out episodes after which the training of an agent's AIP ends. The
    /// AIP then has the parameters of its best epoch. If left out, all epochs are trained and the last one counts.
    ///
    /// DEVIATION 26: the paper's AIPs learn for 100 or 300 epochs. Our configs have a patience of 3 and a higher learning rate.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(range(min = 1, max = 100_000))]
    pub patience: Option<usize>,
    /// Share by which each gradient step makes the weights smaller, divided by the learning rate. Biases stay.
    /// Scenarios: 0.1.
    pub weight_decay: f64,
    /// Whether an AIP corrects the marginals: its outputs are added to their logits. A source whose AIP is not better
    /// than its marginals on the held-out episodes keeps the marginals. Scenarios: true.
    ///
    /// DEVIATION 16: the paper's AIPs know nothing of marginals. Where cars are rare, as on real maps, they are worse
    /// than marginals.
    pub correct_marginals: bool,
}

/// When AIPs are trained again: all of them or none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Retrain {
    /// Every F timesteps per agent, as in the paper.
    #[default]
    Every,
    /// Never.
    Once,
    /// After evaluations that find that the AIPs' loss on new episodes of the GS has grown. The AIPs then determine F.
    Drift,
}

impl Default for AipConfig {
    fn default() -> Self {
        AipConfig {
            recurrent: None,
            hidden: vec![128, 128],
            retrain: Retrain::Every,
            retrain_every_steps: 1_000_000,
            drift_threshold: 1.5,
            dataset_steps: 10_000,
            first_dataset_share: 1.0,
            held_out: 0.1,
            learning_rate: 1e-4,
            batch: 128,
            epochs: 100,
            patience: None,
            weight_decay: 0.0,
            correct_marginals: false,
        }
    }
}

/// Checks the table, and what depends on it.
pub(super) fn check(config: &Config) -> Result<()> {
    let aip = &config.aip;
    check_hidden("aip.hidden", &aip.hidden, 0)?;
    check_recurrent("aip.recurrent", aip.recurrent)?;
    positive("aip.learning_rate", aip.learning_rate, "the paper uses 1e-4")?;
    not_negative("aip.weight_decay", aip.weight_decay, "0 is the default")?;
    ensure!(
        aip.weight_decay * aip.learning_rate < 1.0,
        "aip.weight_decay = {}: multiplied by aip.learning_rate = {} it must be less than 1",
        aip.weight_decay,
        aip.learning_rate
    );
    not_negative("aip.drift_threshold", aip.drift_threshold, "percent of the loss; 1.5 is the default")?;
    ensure!(
        !(config.trains_predictors() && aip.retrain == Retrain::Drift) || config.evaluation.aip_loss_episodes > 0,
        "aip.retrain = \"drift\": needs the loss of the AIPs at evaluations; set evaluation.aip_loss_episodes, to 4 \
         for traffic or 20 for the warehouse"
    );
    ensure!(
        aip.first_dataset_share > 0.0 && aip.first_dataset_share <= 1.0,
        "aip.first_dataset_share = {}: must be greater than 0, and at most 1",
        aip.first_dataset_share
    );
    inner_share("aip.held_out", aip.held_out)
}

/// Returns whether this number of episodes fills a batch.
pub(super) fn fill_a_batch(config: &Config, episodes: usize, horizon: usize) -> bool {
    let aip = &config.aip;
    check_batch("aip.batch", aip.batch, (episodes, horizon), aip.held_out, aip.recurrent.is_some(), "a dataset").is_ok()
}

/// Checks that the episodes of a dataset fill a batch.
pub(super) fn check_datasets(config: &Config, horizon: usize) -> Result<()> {
    let aip = &config.aip;
    if !config.trains_predictors() || !config.predictor().kind().reads("batch") {
        return Ok(());
    }
    let episodes = config.first_dataset_episodes(horizon);
    check_batch("aip.batch", aip.batch, (episodes, horizon), aip.held_out, aip.recurrent.is_some(), "a dataset")
}
