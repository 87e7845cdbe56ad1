//! The table `[traffic]` of a config. There are two ways to fill it: a grid of the paper, or a scenario of the user.

mod detectors;
mod grid;
pub mod python;
mod reward;
mod route_files;
mod scenario;
mod seen_cars;
pub(crate) mod sumo_numbers;
pub(crate) mod sumo_options;
pub mod sumo_time;
pub mod sumocfg;

use std::fmt::{self, Formatter};
use std::path::PathBuf;
use std::sync::{Arc, LazyLock};

use schemars::JsonSchema;
use serde::de::{DeserializeOwned, DeserializeSeed, Deserializer, Error, MapAccess, Visitor};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use dials_core::base::keys_of;
use dials_core::domain::{Domain, DomainTable};

pub use detectors::DetectorFaults;
pub use grid::{ClockOffsets, DSet, EntryRule, TrafficConfig, UntilFirstSwitch};
pub use reward::{Reward, RewardTerm};
pub use route_files::files_called;
pub use scenario::{Actions, DEMAND, Observation, Pedestrians, ScenarioConfig, Yellow};
pub use seen_cars::SeenCars;
pub(crate) use seen_cars::{DETECTORS_ONLY, SHARES, may_be_seen};

/// Traffic lights, on a grid of the paper, which `network` and `local_network` name, or on a scenario of yours, which
/// `scenario` names. A key of the other way is an error.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(untagged)]
pub enum TrafficTable {
    Grid(TrafficConfig),
    Scenario(ScenarioConfig),
}

impl TrafficTable {
    fn table(&self) -> &dyn DomainTable {
        match self {
            TrafficTable::Grid(table) => table,
            TrafficTable::Scenario(table) => table,
        }
    }

    fn table_mut(&mut self) -> &mut dyn DomainTable {
        match self {
            TrafficTable::Grid(table) => table,
            TrafficTable::Scenario(table) => table,
        }
    }
}

impl TrafficTable {
    /// Returns the keys that name functions of Python: the reward and the observation.
    pub fn functions_mut(&mut self) -> [&mut Option<String>; 2] {
        match self {
            TrafficTable::Grid(table) => [&mut table.python_reward, &mut table.python_observation],
            TrafficTable::Scenario(table) => [&mut table.python_reward, &mut table.python_observation],
        }
    }
}

impl DomainTable for TrafficTable {
    fn horizon(&self) -> usize {
        self.table().horizon()
    }

    fn local_horizon(&self) -> usize {
        self.table().local_horizon()
    }

    fn shows_sets(&self) -> bool {
        self.table().shows_sets()
    }

    fn check(&self) -> anyhow::Result<()> {
        self.table().check()
    }

    fn paths(&mut self) -> Vec<(&'static str, &mut PathBuf)> {
        self.table_mut().paths()
    }

    fn local_keys(&self) -> &'static [&'static str] {
        self.table().local_keys()
    }

    fn defaults(&self) -> &'static str {
        self.table().defaults()
    }

    fn complete(&mut self) -> anyhow::Result<()> {
        self.table_mut().complete()
    }

    fn open(&self) -> anyhow::Result<Arc<dyn Domain>> {
        self.table().open()
    }
}

impl<'de> Deserialize<'de> for TrafficTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<TrafficTable, D::Error> {
        deserializer.deserialize_struct("TrafficTable", &KEYS.all, EitherWay)
    }
}

struct Keys {
    grid: &'static [&'static str],
    scenario: &'static [&'static str],
    all: Vec<&'static str>,
}

static KEYS: LazyLock<Keys> = LazyLock::new(|| {
    let (grid, scenario) = (keys_of::<TrafficConfig>(&[]), keys_of::<ScenarioConfig>(&[]));
    let all = grid.iter().chain(scenario.iter().filter(|key| !grid.contains(key)));
    Keys { grid, scenario, all: all.copied().collect() }
});

/// Reads the table key by key. Which way it is filled shows at the end, but a wrong value is an error at its key.
struct EitherWay;

impl<'de> Visitor<'de> for EitherWay {
    type Value = TrafficTable;

    fn expecting(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("a table")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<TrafficTable, M::Error> {
        let mut given = Table::new();
        while let Some(key) = map.next_key::<String>()? {
            let value = map.next_value_seed(ValueOf { key: &key })?;
            python::add(&mut given, key, value);
        }
        let foreign = |ours: &[&str]| given.keys().find(|key| !ours.contains(&key.as_str()));
        let refused = |key: &str, why: &str| M::Error::custom(format!("traffic.{key} {why}; remove one of them"));
        if given.contains_key("scenario") {
            return match foreign(KEYS.scenario) {
                Some(key) => Err(refused(key, "is for a grid, but the table names a .sumocfg by `scenario`")),
                None => read(given).map(TrafficTable::Scenario),
            };
        }
        let missing = ["network", "local_network"].into_iter().find(|&key| !given.contains_key(key));
        match (missing, foreign(KEYS.grid)) {
            (Some("network"), _) if !given.contains_key("local_network") => Err(M::Error::custom(
                "[traffic] names nothing to simulate: add `scenario` with the path of a .sumocfg, or `network` and \
                 `local_network` for a grid",
            )),
            (_, Some(key)) => Err(refused(key, "is for a scenario, but the table names a grid by `network`")),
            (Some(key), None) => {
                Err(M::Error::custom(format!("missing field `{key}`: a grid needs `network` and `local_network`")))
            }
            (None, None) => read(given).map(TrafficTable::Grid),
        }
    }
}

fn read<T: DeserializeOwned, E: Error>(table: Table) -> Result<T, E> {
    table.try_into().map_err(|error: toml::de::Error| E::custom(error.message()))
}

/// Reads the value of a key that one of the two ways has, and checks its type.
struct ValueOf<'a> {
    key: &'a str,
}

impl<'de> DeserializeSeed<'de> for ValueOf<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        let value = Value::deserialize(deserializer)?;
        if python::function(self.key, &value).is_some() {
            return Ok(value);
        }
        let alone = Table::from_iter([(self.key.to_owned(), value.clone())]);
        if KEYS.grid.contains(&self.key) {
            read::<TrafficConfig, _>(alone)?;
        } else if KEYS.scenario.contains(&self.key) {
            read::<ScenarioConfig, _>(alone)?;
        } else {
            return Err(D::Error::unknown_field(self.key, &KEYS.all));
        }
        Ok(value)
    }
}
