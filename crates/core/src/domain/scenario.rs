//! What a run simulates, in words and numbers. It is written into `run.json` when a run starts, so readers of the run
//! need no domain.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::base::counted;

/// Longest name of a scenario, in letters.
const LONGEST_NAME: usize = 40;

/// The scenario that a run simulates.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Scenario {
    #[serde(flatten)]
    pub id: ScenarioId,
    /// What its user calls it, a plain word for titles. `None`: it is called by its domain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Places of the agents; `None` if they are not in rows.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub map: Option<Map>,
    /// Rules by which agents see and are rewarded; `None` if the domain names none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rules: Option<Rules>,
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
    pub agents: usize,
    pub episode: Episode,
    /// Checksum of the files that the GS simulates, if there are any and they are known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub checksum: Option<String>,
    /// Name of the rules, if they are not the usual ones of the first version of the environment. [`Scenario`] writes its
    /// own `rules` beside it.
    #[serde(default, rename = "scored_by", skip_serializing_if = "Option::is_none")]
    pub rules: Option<String>,
}

/// The rules by which agents see and are rewarded.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Rules {
    /// Version of the environment. It counts up when the same actions have other results than before.
    pub environment: u32,
    /// What an agent is rewarded for, in words.
    pub reward: String,
    /// What an agent sees, in words.
    pub observation: String,
}

impl Rules {
    /// Lists in what these rules and `others` differ, two texts each. `places`: what to call the two.
    pub fn differences(&self, others: &Rules, places: [&str; 2]) -> Vec<String> {
        let versions = [self, others].map(|rules| rules.environment.to_string());
        [
            ("version of the environment", [&versions[0], &versions[1]]),
            ("reward", [&self.reward, &others.reward]),
            ("observation", [&self.observation, &others.observation]),
        ]
        .into_iter()
        .filter(|(_, values)| values[0] != values[1])
        .flat_map(|(what, values)| [0, 1].map(|side| format!("{what} in {}: {}", places[side], values[side])))
        .collect()
    }
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
        let id = ScenarioId { domain: domain.to_owned(), agents, episode, checksum: None, rules: None };
        Scenario { id, name: None, map: None, rules: None, files: BTreeMap::new() }
    }

    /// Adds a name. Letters that are not plain become `_`; a name without plain letters is left out.
    pub fn with_name(self, name: &str) -> Scenario {
        let plain = |letter: char| letter.is_ascii_alphanumeric() || "-_".contains(letter);
        let name: String = name.chars().map(|letter| if plain(letter) { letter } else { '_' }).collect();
        let name = name.trim_start_matches(['-', '_']);
        let name = &name[..name.len().min(LONGEST_NAME)];
        Scenario { name: (!name.is_empty()).then(|| name.to_owned()), ..self }
    }

    pub fn with_map(self, map: Map) -> Scenario {
        Scenario { map: Some(map), ..self }
    }

    /// Adds the CRC-32 of what the GS simulates.
    pub fn with_checksum(self, checksum: u32) -> Scenario {
        Scenario { id: ScenarioId { checksum: Some(in_hex(checksum)), ..self.id }, ..self }
    }

    /// Adds the rules. `unusual`: name of the reward, if it is another one than the domain's usual one.
    pub fn with_rules(self, rules: Rules, unusual: Option<String>) -> Scenario {
        let version = (rules.environment > 1).then(|| format!("v{}", rules.environment));
        let words: Vec<String> = version.into_iter().chain(unusual).collect();
        let name = (!words.is_empty()).then(|| words.join("-"));
        Scenario { rules: Some(rules), id: ScenarioId { rules: name, ..self.id }, ..self }
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
    /// Returns a title, such as `traffic, 4 agents`, or `town, 20 agents` for a scenario with a name.
    pub fn title(&self, name: Option<&str>) -> String {
        format!("{}, {}", name.unwrap_or(&self.domain), counted(self.agents, "agent"))
    }

    /// Returns the title, with what distinguishes it from other scenarios with the same title. These come with their
    /// names.
    pub fn title_among<'a>(
        &self,
        name: Option<&str>,
        scenarios: impl Iterator<Item = (&'a ScenarioId, Option<&'a str>)> + Clone,
    ) -> String {
        let mut title = self.title(name);
        let plain = title.clone();
        let alike = scenarios.filter(|(other, name)| other.title(*name) == plain).map(|(other, _)| other);
        if alike.clone().any(|other| other.episode != self.episode) {
            title += &format!(", {} {}", self.episode.length, self.episode.unit);
        }
        if alike.clone().any(|other| other.checksum != self.checksum) {
            title += &format!(", checksum {}", self.checksum.as_deref().unwrap_or("unknown"));
        }
        if alike.clone().any(|other| other.rules != self.rules) {
            title += &format!(", rules {}", self.rules.as_deref().unwrap_or("usual"));
        }
        title
    }

    /// Returns a word that no other scenario has, such as `traffic-4-300-1a2b3c4d`.
    pub fn word(&self) -> String {
        let checksum = self.checksum.as_ref().map_or(String::new(), |checksum| format!("-{checksum}"));
        let rules = self.rules.as_ref().map_or(String::new(), |rules| format!("-{rules}"));
        format!("{}-{}-{}{checksum}{rules}", self.domain, self.agents, self.episode.length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn traffic(horizon: usize) -> Scenario {
        Scenario::new("traffic", 4, horizon)
    }

    fn with_rules(environment: u32, reward: &str, unusual: Option<&str>) -> Scenario {
        let rules = Rules { environment, reward: reward.to_owned(), observation: "cells".to_owned() };
        traffic(300).with_rules(rules, unusual.map(str::to_owned))
    }

    #[test]
    fn scenarios_are_distinguished_by_what_differs() {
        let marked = |horizon, checksum| traffic(horizon).with_checksum(checksum).id;
        let by_queue = with_rules(1, "queue", Some("queue")).id;
        for (one, other, titles) in [
            (marked(300, 1), marked(300, 1), ["traffic, 4 agents"; 2]),
            (marked(300, 1), marked(100, 1), ["traffic, 4 agents, 300 steps", "traffic, 4 agents, 100 steps"]),
            (
                marked(300, 0x1a),
                traffic(300).id,
                ["traffic, 4 agents, checksum 0000001a", "traffic, 4 agents, checksum unknown"],
            ),
            (traffic(300).id, by_queue, ["traffic, 4 agents, rules usual", "traffic, 4 agents, rules queue"]),
        ] {
            let all = [&one, &other].map(|id| (id, None));
            assert_eq!([&one, &other].map(|id| id.title_among(None, all.into_iter())), titles);
        }
    }

    #[test]
    fn a_scenario_with_a_name_is_called_by_it() {
        let [town, ring] = [1, 2].map(|checksum| traffic(300).with_checksum(checksum).id);
        let all = [(&town, Some("town")), (&ring, None)].into_iter();
        assert_eq!(town.title_among(Some("town"), all.clone()), "town, 4 agents");
        assert_eq!(ring.title_among(None, all), "traffic, 4 agents");
        let twice = [(&town, Some("town")), (&ring, Some("town"))].into_iter();
        assert_eq!(ring.title_among(Some("town"), twice), "town, 4 agents, checksum 00000002");
        let named = |name: &str| traffic(300).with_name(name).name;
        assert_eq!(named("my town (1)").unwrap(), "my_town__1_");
        assert_eq!(["", "...", "\u{57ce}"].map(named), [None, None, None]);
        assert_eq!(named(&"long".repeat(30)).unwrap().len(), 40);
    }

    #[test]
    fn other_rules_are_another_scenario_and_the_usual_ones_are_not_named() {
        assert_eq!(with_rules(1, "speed", None).id, traffic(300).id, "as in runs that recorded no rules");
        let words =
            [with_rules(1, "queue", Some("queue")), with_rules(2, "speed", None), traffic(300).with_checksum(0x1a)];
        let expected = ["traffic-4-300-queue", "traffic-4-300-v2", "traffic-4-300-0000001a"];
        assert_eq!(words.map(|scenario| scenario.id.word()), expected);
        let [one, other] = [with_rules(2, "speed", None), with_rules(1, "queue", None)].map(|all| all.rules.unwrap());
        let versions = ["version of the environment in A: 2", "version of the environment in B: 1"];
        let rewards = ["reward in A: speed", "reward in B: queue"];
        assert_eq!(one.differences(&other, ["A", "B"]), [versions, rewards].concat());
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
        for scenario in [scenario, with_rules(1, "queues", Some("queue"))] {
            let text = serde_json::to_string(&scenario).unwrap();
            assert_eq!(serde_json::from_str::<Scenario>(&text).unwrap(), scenario, "{text}");
        }
    }
}
