//! How long lights of a scenario show yellow: a number of seconds, or the word "program".

use std::borrow::Cow;
use std::fmt::{self, Display, Formatter};

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Unexpected};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::Value;

const PROGRAM: &str = "program";

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Yellow {
    /// That of the light's own program, in whole seconds. So no controller gains time by a shorter one.
    #[default]
    Program,
    Seconds(u32),
}

impl Display for Yellow {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Yellow::Program => f.write_str("as in the light's own program"),
            Yellow::Seconds(seconds) => write!(f, "{seconds} s"),
        }
    }
}

impl Serialize for Yellow {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Yellow::Program => serializer.serialize_str(PROGRAM),
            Yellow::Seconds(seconds) => serializer.serialize_u32(*seconds),
        }
    }
}

impl<'de> Deserialize<'de> for Yellow {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Yellow, D::Error> {
        match Value::deserialize(deserializer)? {
            Value::String(word) if word == PROGRAM => Ok(Yellow::Program),
            Value::Integer(seconds) if u32::try_from(seconds).is_ok() => Ok(Yellow::Seconds(seconds as u32)),
            other => {
                let wanted = "a whole number of seconds, or \"program\"";
                Err(D::Error::invalid_value(Unexpected::Other(&other.to_string()), &wanted))
            }
        }
    }
}

impl JsonSchema for Yellow {
    fn schema_name() -> Cow<'static, str> {
        "Yellow".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "enum": [PROGRAM] }, { "type": "integer", "minimum": 0 }] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_a_number_or_the_word_and_comes_back_as_it_was_written() {
        for json in ["0", "4", "\"program\""] {
            let yellow: Yellow = serde_json::from_str(json).unwrap();
            assert_eq!(serde_json::to_string(&yellow).unwrap(), json);
        }
        for json in ["-1", "1.5", "\"own\"", "4294967296"] {
            let message = serde_json::from_str::<Yellow>(json).unwrap_err().to_string();
            assert!(message.contains("a whole number of seconds, or \"program\""), "{message}");
        }
    }
}
