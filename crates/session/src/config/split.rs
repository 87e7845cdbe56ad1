//! Gives every key of the file to its owner: the tables of domains and of this crate here, all others to learning.

use std::fmt::{self, Formatter};
use std::sync::LazyLock;

use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeSeed, Deserializer, Error, IntoDeserializer, MapAccess, Visitor};

use super::RunConfig;
use crate::domains::DomainConfig;
use dials_core::base::keys_of;
use dials_learn::config::Config;

static KEYS: LazyLock<Vec<&str>> =
    LazyLock::new(|| [keys_of::<Config>(&[]), DomainConfig::NAMES, &["logging", "numerics"]].concat());

impl<'de> Deserialize<'de> for RunConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<RunConfig, D::Error> {
        deserializer.deserialize_struct("RunConfig", &KEYS, File)
    }
}

struct File;

impl<'de> Visitor<'de> for File {
    type Value = RunConfig;

    fn expecting(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("a table")
    }

    fn visit_map<M: MapAccess<'de>>(self, map: M) -> Result<RunConfig, M::Error> {
        let mut config = RunConfig::default();
        let of_learning = OfLearning { map, config: &mut config };
        let learning = Config::deserialize(MapAccessDeserializer::new(of_learning))?;
        Ok(RunConfig { learning, ..config })
    }
}

/// The keys of learning. The others are read on the way, into `config`.
struct OfLearning<'a, M> {
    map: M,
    config: &'a mut RunConfig,
}

impl<'de, M: MapAccess<'de>> MapAccess<'de> for OfLearning<'_, M> {
    type Error = M::Error;

    fn next_key_seed<K: DeserializeSeed<'de>>(&mut self, seed: K) -> Result<Option<K::Value>, M::Error> {
        while let Some(key) = self.map.next_key_seed(Key)? {
            match key {
                "logging" => self.config.logging = self.map.next_value()?,
                "numerics" => self.config.numerics = self.map.next_value()?,
                table if DomainConfig::NAMES.contains(&table) => {
                    let domain = DomainConfig::read(table, &mut self.map)?;
                    if let Some(other) = self.config.domain.replace(domain) {
                        let tables = format!("[{}] and [{table}]", other.name());
                        return Err(M::Error::custom(format!(
                            "{tables}: a run has one domain; remove one of these tables"
                        )));
                    }
                }
                key => return seed.deserialize(key.into_deserializer()).map(Some),
            }
        }
        Ok(None)
    }

    fn next_value_seed<T: DeserializeSeed<'de>>(&mut self, seed: T) -> Result<T::Value, M::Error> {
        self.map.next_value_seed(seed)
    }
}

/// Reads a key that somebody owns.
struct Key;

impl<'de> DeserializeSeed<'de> for Key {
    type Value = &'static str;

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<&'static str, D::Error> {
        let name = String::deserialize(deserializer)?;
        KEYS.iter().copied().find(|&key| key == name).ok_or_else(|| D::Error::unknown_field(&name, &KEYS))
    }
}
