//! The JSON schema of a config, for editors. It is made from the fields of the tables and their comments.

use schemars::generate::SchemaSettings;
use schemars::transform::{RecursiveTransform, Transform};
use schemars::{Schema, SchemaGenerator};
use serde_json::{Value, json};

use super::{LoggingConfig, NumericsConfig};
use crate::domains::DomainConfig;
use dials_learn::config::Config;

/// Returns the schema: an object per table of a config.
pub fn schema() -> Value {
    let mut schema = with_comments();
    RecursiveTransform(|schema: &mut Schema| {
        if let Some(text) = schema.get("description").and_then(Value::as_str).map(without_links) {
            schema.insert("description".to_owned(), json!(text));
        }
    })
    .transform(&mut schema);
    schema.to_value()
}

/// Returns the schema with the comments as they are written.
pub(super) fn with_comments() -> Schema {
    let mut generator =
        SchemaGenerator::new(SchemaSettings::draft07().with(|settings| settings.inline_subschemas = true));
    let mut schema = generator.root_schema_for::<Config>();
    let others = [
        ("logging", generator.subschema_for::<LoggingConfig>()),
        ("numerics", generator.subschema_for::<NumericsConfig>()),
    ];
    let domains = DomainConfig::NAMES.iter().copied().zip(DomainConfig::schemas(&mut generator));
    let keys = schema.get_mut("properties").and_then(Value::as_object_mut).expect("a struct has fields");
    keys.extend(domains.chain(others).map(|(name, table)| (name.to_owned(), table.to_value())));
    schema.insert("title".to_owned(), json!("config of dials-traffic"));
    schema.remove("description");
    let one_of: Vec<Value> = DomainConfig::NAMES.iter().map(|name| json!({ "required": [name] })).collect();
    schema.insert("oneOf".to_owned(), json!(one_of));
    RecursiveTransform(without_needless_defaults).transform(&mut schema);
    schema
}

/// Removes the defaults of keys that a config must have, and those of whole tables.
fn without_needless_defaults(schema: &mut Schema) {
    let required: Vec<Value> = schema.get("required").and_then(Value::as_array).cloned().unwrap_or_default();
    for (name, key) in schema.get_mut("properties").and_then(Value::as_object_mut).into_iter().flatten() {
        if let Some(key) = key.as_object_mut()
            && (key.contains_key("properties") || required.iter().any(|other| other == name))
        {
            key.remove("default");
        }
    }
}

/// Returns a text of Markdown with the words of its links only.
fn without_links(text: &str) -> String {
    let (mut found, mut rest) = (String::new(), text);
    while let Some((before, after)) = rest.split_once("](") {
        let (before, words) = before.rsplit_once('[').unwrap_or((before, ""));
        found = found + before + words;
        rest = after.split_once(')').map_or("", |(_, after)| after);
    }
    found + rest
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::{Path, PathBuf};

    /// Returns whether a schema allows a value. It knows what the schema of a config uses.
    fn allows(schema: &Value, value: &Value) -> bool {
        let is_word = |choices: &Value| choices.as_array().is_some_and(|choices| choices.contains(value));
        let any_of = ["anyOf", "oneOf"].into_iter().filter_map(|name| schema[name].as_array());
        let types = match &schema["type"] {
            Value::Array(types) => types.clone(),
            one => vec![one.clone()],
        };
        let is_of = |name: &Value| match name.as_str() {
            Some("string") => value.is_string(),
            Some("integer") => value.is_u64() || value.is_i64(),
            Some("number") => value.is_number(),
            Some("boolean") => value.is_boolean(),
            Some("array") => value.as_array().is_some_and(|all| all.iter().all(|item| allows(&schema["items"], item))),
            Some("object") => {
                let known = |(name, value)| schema["properties"].get(name).is_none_or(|schema| allows(schema, value));
                let closed = schema["additionalProperties"] == json!(false);
                let values = value.as_object();
                values.is_some_and(|values| {
                    values.iter().all(known)
                        && (!closed || values.keys().all(|name| schema["properties"].get(name).is_some()))
                })
            }
            _ => true,
        };
        types.iter().any(is_of)
            && (schema["enum"].is_null() || is_word(&schema["enum"]))
            && (schema["const"].is_null() || schema["const"] == *value)
            && (!schema["properties"].is_null()
                || any_of.into_iter().all(|ways| ways.iter().any(|way| allows(way, value))))
            && schema["minimum"].as_f64().is_none_or(|least| value.as_f64().is_none_or(|number| number >= least))
    }

    fn configs(folder: &Path) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let paths = entries.flat_map(|path| if path.is_dir() { configs(&path) } else { vec![path] });
        paths.filter(|path| path.extension().is_some_and(|ending| ending == "toml")).collect()
    }

    #[test]
    fn every_shipped_config_fits_the_schema_and_a_wrong_one_does_not() {
        let schema = schema();
        let found = configs(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs"));
        assert!(found.len() > 10, "{found:?}");
        for path in found {
            let config: toml::Table = std::fs::read_to_string(&path).unwrap().parse().unwrap();
            let config = json!(config);
            assert!(allows(&schema, &config), "{}", path.display());
            for (table, key, wrong) in [
                ("aip", "retrain", json!("never")),
                ("ppo", "clip", json!("high")),
                ("ppo", "memory", json!(0)),
                ("ppo", "klip", json!(1)),
                ("policy", "hidden", json!(["wide"])),
            ] {
                let mut config = config.clone();
                config[table][key] = wrong;
                assert!(!allows(&schema, &config), "{table}.{key}");
            }
        }
    }

    #[test]
    fn a_description_has_no_links() {
        assert_eq!(without_links("see [this](a.md#b), [128] and [that](c)."), "see this, [128] and that.");
    }
}
