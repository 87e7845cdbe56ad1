//! What learners report of their updates, by name. The names are columns of `training.csv`.

use serde::{Deserialize, Serialize};

/// Figures of one update, or their means over several.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Metrics {
    /// Figures with a value per agent, such as losses.
    pub of_agents: Vec<(String, Vec<f64>)>,
    /// Settings that were the same for all agents, such as the learning rate.
    pub settings: Vec<(String, f64)>,
}

impl Metrics {
    /// Returns the means over some updates, with the settings of the last one. Without updates: `empty`.
    pub(crate) fn mean(updates: &[Metrics], empty: Metrics) -> Metrics {
        let Some(last) = updates.last() else { return empty };
        let weight = 1.0 / updates.len() as f64;
        let mut mean = Metrics { settings: last.settings.clone(), ..empty };
        for update in updates {
            for ((_, sums), (_, values)) in mean.of_agents.iter_mut().zip(&update.of_agents) {
                sums.iter_mut().zip(values).for_each(|(sum, value)| *sum += weight * value);
            }
        }
        mean
    }

    pub(crate) fn extend(&mut self, other: Metrics) {
        for ((_, values), (_, others)) in self.of_agents.iter_mut().zip(other.of_agents) {
            values.extend(others);
        }
    }

    /// Returns the names of the figures, then of the settings.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let figures = self.of_agents.iter().map(|(name, _)| name.as_str());
        figures.chain(self.settings.iter().map(|(name, _)| name.as_str()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn losses(values: &[f64], rate: f64) -> Metrics {
        Metrics { of_agents: vec![("loss".into(), values.to_vec())], settings: vec![("rate".into(), rate)] }
    }

    #[test]
    fn means_are_over_updates_and_the_settings_are_those_of_the_last_one() {
        let mean = Metrics::mean(&[losses(&[1.0, 4.0], 0.2), losses(&[3.0, 0.0], 0.1)], losses(&[0.0; 2], 0.0));
        assert_eq!(mean, losses(&[2.0, 2.0], 0.1));
        assert_eq!(Metrics::mean(&[], losses(&[0.0; 2], 0.3)), losses(&[0.0; 2], 0.3));
    }

    #[test]
    fn the_agents_of_several_learners_are_joined() {
        let mut both = losses(&[1.0, 3.0], 0.1);
        both.extend(losses(&[2.0], 0.1));
        assert_eq!(both, losses(&[1.0, 3.0, 2.0], 0.1));
        assert_eq!(both.names().collect::<Vec<_>>(), ["loss", "rate"]);
    }
}
