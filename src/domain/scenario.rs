//! What a run simulates, in words and numbers. It is written into `run.json` when a run starts, so readers of the run
//! need no domain.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// The scenario that a run simulates.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Scenario {
    #[serde(flatten)]
    pub id: ScenarioId,
    /// Places of the agents; `None` if they are not in rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<Map>,
    /// Checksums of files that may differ between runs of the scenario, by the keys of the config that name them. They
    /// are part of how a run trains.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub files: BTreeMap<String, String>,
}

/// The identity of a scenario: the values that must be equal for returns to be comparable.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ScenarioId {
    /// Name of the domain, one lower-case word.
    pub domain: String,
    /// Number of agents.
    pub agents: usize,
    pub episode: Episode,
    /// Checksum of the files that the GS (global simulator) simulates, if there are any and they are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checksum: Option<String>,
}

/// The length of an episode.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct Episode {
    pub length: usize,
    /// Unit of the length, in the plural.
    pub unit: String,
}

/// A map of agents in rows. Agents are numbered row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Map {
    pub rows: usize,
    pub columns: usize,
    pub first_row: FirstRow,
}

/// The side of a map where the row of agent 0 is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FirstRow {
    Top,
    Bottom,
}

impl Scenario {
    /// Makes the scenario of a domain without map and files. `horizon`: steps of an episode.
    pub fn new(domain: &str, agents: usize, horizon: usize) -> Scenario {
        let episode = Episode { length: horizon, unit: "steps".to_owned() };
        let id = ScenarioId { domain: domain.to_owned(), agents, episode, checksum: None };
        Scenario { id, map: None, files: BTreeMap::new() }
    }

    pub fn with_map(self, map: Map) -> Scenario {
        Scenario { map: Some(map), ..self }
    }

    /// Adds the CRC-32 of what the GS simulates.
    pub fn with_checksum(self, checksum: u32) -> Scenario {
        Scenario { id: ScenarioId { checksum: Some(in_hex(checksum)), ..self.id }, ..self }
    }

    /// Adds the CRC-32 of the files that keys of the config name.
    pub fn with_files(self, files: impl IntoIterator<Item = (String, u32)>) -> Scenario {
        let files = files.into_iter().map(|(key, checksum)| (key, in_hex(checksum)));
        Scenario { files: files.collect(), ..self }
    }
}

fn in_hex(checksum: u32) -> String {
    format!("{checksum:08x}")
}

impl ScenarioId {
    /// Returns a title, such as `traffic, 4 agents`.
    pub fn title(&self) -> String {
        format!("{}, {} agents", self.domain, self.agents)
    }

    /// Returns the title, with what distinguishes it from other scenarios with the same number of agents.
    pub fn title_among<'a>(&self, scenarios: impl Iterator<Item = &'a ScenarioId> + Clone) -> String {
        let alike = scenarios.filter(|other| (&other.domain, other.agents) == (&self.domain, self.agents));
        let mut title = self.title();
        if alike.clone().any(|other| other.episode != self.episode) {
            title += &format!(", {} {}", self.episode.length, self.episode.unit);
        }
        if alike.clone().any(|other| other.checksum != self.checksum) {
            title += &format!(", checksum {}", self.checksum.as_deref().unwrap_or("unknown"));
        }
        title
    }

    /// Returns a word that no other scenario has, such as `traffic-4-300-1a2b3c4d`.
    pub fn word(&self) -> String {
        let checksum = self.checksum.as_ref().map_or(String::new(), |checksum| format!("-{checksum}"));
        format!("{}-{}-{}{checksum}", self.domain, self.agents, self.episode.length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenarios_of_as_many_agents_are_told_apart_by_what_differs() {
        let scenario = |horizon, checksum: Option<u32>| {
            let scenario = Scenario::new("traffic", 4, horizon);
            checksum.map_or(scenario.clone(), |checksum| scenario.with_checksum(checksum)).id
        };
        let titles = |scenarios: &[ScenarioId]| -> Vec<String> {
            scenarios.iter().map(|scenario| scenario.title_among(scenarios.iter())).collect()
        };
        assert_eq!(titles(&[scenario(300, Some(1))]), ["traffic, 4 agents"]);
        assert_eq!(
            titles(&[scenario(300, Some(1)), scenario(100, Some(1))]),
            ["traffic, 4 agents, 300 steps", "traffic, 4 agents, 100 steps"]
        );
        assert_eq!(
            titles(&[scenario(300, Some(0x1a)), scenario(300, None)]),
            ["traffic, 4 agents, checksum 0000001a", "traffic, 4 agents, checksum unknown"]
        );
    }

    #[test]
    fn scenarios_have_words() {
        let scenario = Scenario::new("warehouse", 25, 100);
        assert_eq!(scenario.id.word(), "warehouse-25-100");
        assert_eq!(scenario.with_checksum(0x1a).id.word(), "warehouse-25-100-0000001a");
    }

    #[test]
    fn a_scenario_is_one_flat_object_in_json() {
        let map = Map { rows: 1, columns: 3, first_row: FirstRow::Bottom };
        let scenario = Scenario::new("ants", 3, 50).with_map(map).with_checksum(0x1a);
        let scenario = scenario.with_files([("ants.hill".to_owned(), 0x2b)]);
        let json = serde_json::json!({
            "domain": "ants",
            "agents": 3,
            "episode": { "length": 50, "unit": "steps" },
            "checksum": "0000001a",
            "map": { "rows": 1, "columns": 3, "first_row": "bottom" },
            "files": { "ants.hill": "0000002b" },
        });
        assert_eq!(serde_json::to_value(&scenario).unwrap(), json);
        assert_eq!(serde_json::from_value::<Scenario>(json).unwrap(), scenario);
    }
}
