//! The figures of a player, as lines of CSV files.

use super::{Finding, figures};
use dials_core::outside::csv_name;

pub struct Lines {
    pub header: Vec<String>,
    pub lines: Vec<Vec<String>>,
}

impl Lines {
    /// Adds columns behind that of the controller, with the same value in all lines.
    pub fn with(mut self, columns: &[(&str, String)]) -> Lines {
        for (number, (name, value)) in columns.iter().enumerate() {
            self.header.insert(1 + number, (*name).to_owned());
            self.lines.iter_mut().for_each(|line| line.insert(1 + number, csv_name(value)));
        }
        self
    }
}

/// Returns one line per episode.
pub fn by_episode(finding: &Finding) -> Lines {
    let label = csv_name(&finding.player.label);
    let figures = figures(&finding.episodes);
    let lines = (0..finding.episodes.len()).map(|episode| {
        let values = figures.iter().map(|(_, values)| values[episode].to_string());
        [label.clone(), episode.to_string()].into_iter().chain(values).collect()
    });
    let names = figures.iter().map(|(name, _)| name);
    Lines { header: header(&["controller", "episode"], names), lines: lines.collect() }
}

/// Returns one line per episode and agent.
pub fn by_agent(finding: &Finding) -> Lines {
    let label = csv_name(&finding.player.label);
    let mut lines = Vec::new();
    for (number, episode) in finding.episodes.iter().enumerate() {
        for (agent, of_agent) in episode.returns.iter().enumerate() {
            let values = episode.measures.per_agent.iter().map(|(_, values)| values[agent].to_string());
            let place = [label.clone(), number.to_string(), agent.to_string(), of_agent.to_string()];
            lines.push(place.into_iter().chain(values).collect());
        }
    }
    let names = finding.episodes[0].measures.per_agent.iter().map(|(name, _)| name);
    Lines { header: header(&["controller", "episode", "agent", "return"], names), lines }
}

fn header<'a>(fixed: &[&str], names: impl Iterator<Item = &'a String>) -> Vec<String> {
    fixed.iter().map(|&name| name.to_owned()).chain(names.map(|name| csv_name(name))).collect()
}
