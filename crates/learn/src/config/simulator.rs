//! What the policies train on: which simulators, and for local ones, what predicts the influence on them.

use schemars::JsonSchema;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

use super::Config;
use crate::predictors::Predictor;

/// Simulators that the policies train on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum Simulator {
    /// The global simulator.
    #[serde(rename = "gs")]
    Global,
    /// Local simulators; a predictor supplies the influence sources.
    #[default]
    #[serde(rename = "local")]
    Local,
}

/// A way of training in one word: both keys, as the command line, experiments and the names of runs write them.
#[derive(Clone, Copy, Debug)]
pub struct ShortForm {
    pub name: &'static str,
    /// What the policies train on, in words.
    pub help: &'static str,
    pub(crate) simulator: Simulator,
    /// Predictor of local simulators. On the GS there is nothing to predict: `None`.
    pub predictor: Option<Predictor>,
}

/// Returns all short forms: the first predictor's, the global simulator's, and those of the other predictors.
pub fn short_forms() -> Vec<ShortForm> {
    let local = |&(predictor, name, help): &(Predictor, &'static str, &'static str)| ShortForm {
        name,
        help,
        simulator: Simulator::Local,
        predictor: Some(predictor),
    };
    let mut forms: Vec<ShortForm> = Predictor::ALL.iter().map(local).collect();
    let help = "the global simulator";
    forms.insert(1, ShortForm { name: "gs", help, simulator: Simulator::Global, predictor: None });
    forms
}

impl ShortForm {
    pub fn called(name: &str) -> Option<ShortForm> {
        short_forms().into_iter().find(|form| form.name == name)
    }

    /// Lets a config train in this way.
    pub fn choose(&self, config: &mut Config) {
        config.simulator = self.simulator;
        config.predictor = self.predictor.unwrap_or(config.predictor);
    }

    /// Returns whether the run collects datasets and fits predictors to them.
    pub fn trains_predictors(&self) -> bool {
        self.predictor.is_some_and(|predictor| predictor.kind().learns())
    }

    /// Returns the keys that a config has instead, a line each.
    pub fn keys(&self) -> String {
        let word = |value: serde_json::Result<String>| value.expect("a word is JSON");
        let predictor = self.predictor.map(|predictor| word(serde_json::to_string(&predictor)));
        let predictor = predictor.map_or(String::new(), |predictor| format!("predictor = {predictor}\n"));
        format!("simulator = {}\n{predictor}", word(serde_json::to_string(&self.simulator)))
    }
}

impl<'de> Deserialize<'de> for ShortForm {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<ShortForm, D::Error> {
        let name = String::deserialize(deserializer)?;
        ShortForm::called(&name).ok_or_else(|| {
            let known = short_forms().iter().map(|form| format!("`{}`", form.name)).collect::<Vec<_>>().join(", ");
            D::Error::custom(format!("unknown variant `{name}`, expected one of {known}"))
        })
    }
}

/// Number of local simulators per block, and the least in a lane of a larger one. The cars of a larger forest leave the cache
/// between two steps. Measured on traffic, SUMO costs the same per intersection with 8 and 16, 10 % more with 32, 15 % more with 64
/// and 60 % more with 128.
pub(crate) const ROWS_PER_BLOCK: usize = 16;

/// Returns in how many lanes this number of local simulators is played at most. Fewer in each are quicker than the messages to
/// their process.
pub(crate) fn most_lanes(rows: usize) -> usize {
    (rows / ROWS_PER_BLOCK).max(1)
}

impl Config {
    pub fn short_form(&self) -> ShortForm {
        let predictor = self.predictor_in_use();
        let same = |form: &ShortForm| form.simulator == self.simulator && form.predictor == predictor;
        short_forms().into_iter().find(same).expect("every predictor has a short form")
    }

    /// Returns what predicts the influence. On the GS there is nothing to predict: `None`.
    pub fn predictor_in_use(&self) -> Option<Predictor> {
        (self.simulator == Simulator::Local).then_some(self.predictor)
    }

    /// Returns whether the run collects datasets and fits predictors to them.
    pub fn trains_predictors(&self) -> bool {
        self.short_form().trains_predictors()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_the_gs_no_predictor_is_read() {
        for predictor in ["aip", "marginals", "untrained"] {
            let config: Config = toml::from_str(&format!("simulator = 'gs'\npredictor = '{predictor}'")).unwrap();
            assert_eq!((config.short_form().name, config.predictor()), ("gs", Predictor::Network), "it is not read");
        }
    }
}
