//! Gives every key of the file to its owner: the tables of domains and of this crate here, all others to learning.

use std::fmt::{self, Formatter};
use std::sync::LazyLock;

use serde::de::{DeserializeSeed, Deserializer, Error, IntoDeserializer, MapAccess, Visitor};
use serde::{Deserialize, forward_to_deserialize_any};

use super::RunConfig;
use crate::domains::DomainConfig;
use dials_core::base::keys_of;
use dials_learn::config::Config;

impl<'de> Deserialize<'de> for RunConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<RunConfig, D::Error> {
        let mut config = RunConfig::default();
        let learning = Config::deserialize(Split { deserializer, config: &mut config })?;
        Ok(RunConfig { learning, ..config })
    }
}

/// The keys of the file.
static KEYS: LazyLock<Vec<&str>> =
    LazyLock::new(|| [keys_of::<Config>(&[]), DomainConfig::NAMES, &["logging", "numerics"]].concat());

/// What [`Config`] reads, from a file that also has tables of others. These go to `config`.
struct Split<'a, D> {
    deserializer: D,
    config: &'a mut RunConfig,
}

impl<'de, D: Deserializer<'de>> Deserializer<'de> for Split<'_, D> {
    type Error = D::Error;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, D::Error> {
        self.deserialize_struct("", &[], visitor)
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        _: &'static str,
        fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, D::Error> {
        self.deserializer.deserialize_struct("RunConfig", &KEYS, Tables { fields, visitor, config: self.config })
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 u8 u16 u32 u64 f32 f64 char str string bytes byte_buf option unit unit_struct newtype_struct
        seq tuple tuple_struct map enum identifier ignored_any
    }
}

/// Reads the file. `fields`: the keys of learning.
struct Tables<'a, V> {
    fields: &'static [&'static str],
    visitor: V,
    config: &'a mut RunConfig,
}

impl<'de, V: Visitor<'de>> Visitor<'de> for Tables<'_, V> {
    type Value = V::Value;

    fn expecting(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str("a table")
    }

    fn visit_map<M: MapAccess<'de>>(self, map: M) -> Result<V::Value, M::Error> {
        self.visitor.visit_map(OfLearning { fields: self.fields, map, config: self.config })
    }
}

/// The keys of learning. The others are read on the way.
struct OfLearning<'a, M> {
    fields: &'static [&'static str],
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
                key if self.fields.contains(&key) => return seed.deserialize(key.into_deserializer()).map(Some),
                table => {
                    let domain = DomainConfig::read(table, &mut self.map)?;
                    if let Some(other) = self.config.domain.replace(domain) {
                        let tables = format!("[{}] and [{table}]", other.name());
                        return Err(M::Error::custom(format!(
                            "{tables}: a run has one domain; remove one of these tables"
                        )));
                    }
                }
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
