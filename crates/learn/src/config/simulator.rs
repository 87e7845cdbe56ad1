//! What the policies train on: which simulators, and for local ones, what predicts the influence on them.
//!
//! Configs and the command line have one name for each of the four combinations.

use serde::{Deserialize, Serialize};

/// Simulators that the policies train on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "Name", into = "Name")]
pub enum Simulator {
    /// The global simulator.
    Global,
    /// Local simulators; this predictor supplies the influence sources.
    Local(Predictor),
}

/// Predictor of the influence on a local region.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Predictor {
    /// Approximate influence predictors (AIPs) that are trained every F steps.
    #[default]
    Network,
    /// Random AIPs that are never trained.
    Untrained,
    /// Constant probabilities instead of AIPs, measured on the global simulator (GS) when DIALS would train its AIPs.
    Marginals,
}

impl Simulator {
    /// Returns the name in configs and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Simulator::Local(Predictor::Network) => "dials",
            Simulator::Global => "gs",
            Simulator::Local(Predictor::Untrained) => "untrained-dials",
            Simulator::Local(Predictor::Marginals) => "marginal-dials",
        }
    }

    /// Returns what predicts the influence. On the GS there is nothing to predict: `None`.
    pub fn predictor(self) -> Option<Predictor> {
        match self {
            Simulator::Global => None,
            Simulator::Local(predictor) => Some(predictor),
        }
    }

    /// Returns whether the run collects datasets and fits predictors to them.
    pub fn trains_predictors(self) -> bool {
        self.predictor().is_some_and(Predictor::learns)
    }
}

impl Default for Simulator {
    fn default() -> Self {
        Simulator::Local(Predictor::default())
    }
}

impl Predictor {
    /// Returns whether it is fitted to datasets from the GS.
    pub fn learns(self) -> bool {
        match self {
            Predictor::Network | Predictor::Marginals => true,
            Predictor::Untrained => false,
        }
    }

    /// Returns whether a key of `[aip]` changes anything.
    pub fn reads(self, key: &str) -> bool {
        match self {
            Predictor::Network => true,
            Predictor::Untrained => ["hidden", "recurrent"].contains(&key),
            Predictor::Marginals => ![
                "hidden",
                "recurrent",
                "learning_rate",
                "batch",
                "epochs",
                "patience",
                "weight_decay",
                "correct_marginals",
            ]
            .contains(&key),
        }
    }
}

/// Name of a simulator in a config.
#[derive(Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
enum Name {
    Dials,
    Gs,
    UntrainedDials,
    MarginalDials,
}

impl From<Name> for Simulator {
    fn from(name: Name) -> Self {
        match name {
            Name::Dials => Simulator::Local(Predictor::Network),
            Name::Gs => Simulator::Global,
            Name::UntrainedDials => Simulator::Local(Predictor::Untrained),
            Name::MarginalDials => Simulator::Local(Predictor::Marginals),
        }
    }
}

impl From<Simulator> for Name {
    fn from(simulator: Simulator) -> Self {
        match simulator {
            Simulator::Local(Predictor::Network) => Name::Dials,
            Simulator::Global => Name::Gs,
            Simulator::Local(Predictor::Untrained) => Name::UntrainedDials,
            Simulator::Local(Predictor::Marginals) => Name::MarginalDials,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_four_names_mean_what_they_say_in_a_config() {
        for (name, simulator, learns) in [
            ("gs", Simulator::Global, false),
            ("dials", Simulator::Local(Predictor::Network), true),
            ("untrained-dials", Simulator::Local(Predictor::Untrained), false),
            ("marginal-dials", Simulator::Local(Predictor::Marginals), true),
        ] {
            assert_eq!(serde_json::from_value::<Simulator>(name.into()).unwrap(), simulator);
            assert_eq!(serde_json::to_value(simulator).unwrap(), name);
            assert_eq!((simulator.name(), simulator.trains_predictors()), (name, learns));
        }
    }
}
