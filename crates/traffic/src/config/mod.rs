//! The table `[traffic]` of a config. There are two ways to fill it: a grid of the paper, or a scenario of the user.
//!
//! - `grid`, `scenario`: the keys of the two ways; `reward`: what agents are rewarded for; `yellow`: of scenarios.
//! - [`sumocfg`], `sumo_options`, [`sumo_time`]: a .sumocfg read, and which of its options this program carries over.

mod grid;
mod reward;
mod scenario;
mod sumo_options;
pub mod sumo_time;
pub mod sumocfg;
mod yellow;

use std::fmt::{self, Formatter};
use std::path::PathBuf;
use std::sync::Arc;

use serde::de::value::Error as NoError;
use serde::de::{DeserializeOwned, DeserializeSeed, Deserializer, Error, MapAccess, Visitor};
use serde::{Deserialize, Serialize, forward_to_deserialize_any};
use toml::{Table, Value};

use dials_core::domain::{Domain, DomainTable};

pub use grid::{ClockOffsets, DSet, EntryRule, TrafficConfig, UntilFirstSwitch};
pub use reward::{Reward, RewardTerm};
pub use scenario::{Observation, ScenarioConfig};
pub use yellow::Yellow;

/// The table `[traffic]`.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum TrafficTable {
    /// A grid of the paper.
    Grid(TrafficConfig),
    /// A scenario of the user.
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

impl DomainTable for TrafficTable {
    fn horizon(&self) -> usize {
        self.table().horizon()
    }

    fn local_horizon(&self) -> usize {
        self.table().local_horizon()
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
        deserializer
            .deserialize_map(EitherWay { grid: keys_of::<TrafficConfig>(), scenario: keys_of::<ScenarioConfig>() })
    }
}

/// Reads the table key by key. Which way it is filled shows at the end, but a wrong value is an error at its key.
struct EitherWay {
    grid: &'static [&'static str],
    scenario: &'static [&'static str],
}

impl<'de> Visitor<'de> for EitherWay {
    type Value = TrafficTable;

    fn expecting(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("a table")
    }

    fn visit_map<M: MapAccess<'de>>(self, mut map: M) -> Result<TrafficTable, M::Error> {
        let mut given = Table::new();
        while let Some(key) = map.next_key_seed(Key(&self))? {
            let value = map.next_value_seed(ValueOf { key, way: &self })?;
            given.insert(key.to_owned(), value);
        }
        let foreign = |ours: &[&str]| given.keys().find(|key| !ours.contains(&key.as_str()));
        let refused = |key: &str, why: &str| M::Error::custom(format!("traffic.{key} {why}; remove one of them"));
        if given.contains_key("scenario") {
            return match foreign(self.scenario) {
                Some(key) => Err(refused(key, "is for a grid, but the table names a .sumocfg by `scenario`")),
                None => read(given).map(TrafficTable::Scenario),
            };
        }
        let missing = ["network", "local_network"].into_iter().find(|&key| !given.contains_key(key));
        match (missing, foreign(self.grid)) {
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

/// Reads a key that one of the two ways has.
struct Key<'a>(&'a EitherWay);

impl<'de> DeserializeSeed<'de> for Key<'_> {
    type Value = &'static str;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<&'static str, D::Error> {
        let name = String::deserialize(deserializer)?;
        let mut keys = self.0.grid.iter().chain(self.0.scenario);
        keys.clone().copied().find(|&key| key == name).ok_or_else(|| {
            let allowed: Vec<String> = keys.by_ref().map(|key| format!("`{key}`")).collect();
            D::Error::custom(format!("unknown field `{name}`, expected one of {}", allowed.join(", ")))
        })
    }
}

/// Reads the value of a key, and checks its type.
struct ValueOf<'a> {
    key: &'static str,
    way: &'a EitherWay,
}

impl<'de> DeserializeSeed<'de> for ValueOf<'_> {
    type Value = Value;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        let value = Value::deserialize(deserializer)?;
        let alone = Table::from_iter([(self.key.to_owned(), value.clone())]);
        if self.way.grid.contains(&self.key) {
            read::<TrafficConfig, _>(alone)?;
        } else {
            read::<ScenarioConfig, _>(alone)?;
        }
        Ok(value)
    }
}

/// Returns the keys that a struct of serde reads.
fn keys_of<T: DeserializeOwned>() -> &'static [&'static str] {
    let mut keys: &[&str] = &[];
    // The struct asks for its fields and gets none.
    let _ = T::deserialize(Asked(&mut keys));
    keys
}

struct Asked<'a>(&'a mut &'static [&'static str]);

impl<'de> Deserializer<'de> for Asked<'_> {
    type Error = NoError;

    fn deserialize_any<V: Visitor<'de>>(self, _: V) -> Result<V::Value, NoError> {
        Err(NoError::custom("only a struct has keys"))
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, NoError> {
        *self.0 = fields;
        self.deserialize_any(visitor)
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit unit_struct newtype_struct
        seq tuple tuple_struct map enum identifier ignored_any
    }
}
