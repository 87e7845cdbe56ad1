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

    /// Returns what a schema says of a key, in whichever way the table is filled.
    fn of_key<'a>(schema: &'a Value, key: &str) -> Option<&'a Value> {
        let ways = schema["anyOf"].as_array().into_iter().flatten();
        std::iter::once(schema).chain(ways).find_map(|way| way["properties"].get(key))
    }

    fn is_of_type(schema: &Value, value: &Value) -> bool {
        let of_type = match schema["type"].as_str().or_else(|| schema["type"][0].as_str()) {
            Some("integer") => value.is_u64(),
            Some("number") => value.is_number(),
            Some("boolean") => value.is_boolean(),
            Some("array") => {
                value.as_array().is_some_and(|all| all.iter().all(|item| is_of_type(&schema["items"], item)))
            }
            Some("object") => value.is_object(),
            _ => value.is_string(),
        };
        let words = ["oneOf", "enum"].into_iter().filter_map(|name| schema[name].as_array()).flatten();
        let words: Vec<&Value> = words.map(|word| word.get("const").unwrap_or(word)).collect();
        of_type && (words.is_empty() || words.contains(&value))
            || schema["anyOf"].as_array().is_some_and(|ways| ways.iter().any(|way| is_of_type(way, value)))
    }

    fn configs(folder: &Path) -> Vec<PathBuf> {
        let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
        let paths = entries.flat_map(|path| if path.is_dir() { configs(&path) } else { vec![path] });
        paths.filter(|path| path.extension().is_some_and(|ending| ending == "toml")).collect()
    }

    #[test]
    fn every_shipped_config_fits_the_schema_and_a_wrong_value_does_not() {
        let schema = schema();
        let found = configs(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs"));
        assert!(found.len() > 10, "{found:?}");
        for path in found {
            let config: toml::Table = std::fs::read_to_string(&path).unwrap().parse().unwrap();
            for (key, value) in json!(config).as_object().unwrap() {
                let property = of_key(&schema, key).unwrap_or_else(|| panic!("{}: {key}", path.display()));
                let inner = value.as_object().into_iter().flatten();
                let inner = inner.map(|(name, value)| (of_key(property, name).unwrap_or(&Value::Null), value));
                for (property, value) in inner.chain((!value.is_object()).then_some((property, value))) {
                    assert!(property.is_object() && is_of_type(property, value), "{}: {key}: {value}", path.display());
                }
            }
        }
        let retrain = of_key(of_key(&schema, "aip").unwrap(), "retrain").unwrap();
        assert!(is_of_type(retrain, &json!("drift")) && !is_of_type(retrain, &json!("never")));
        assert!(!is_of_type(of_key(&schema, "seed").unwrap(), &json!("one")));
    }

    #[test]
    fn a_description_has_no_links() {
        assert_eq!(without_links("see [this](a.md#b), [128] and [that](c)."), "see this, [128] and that.");
    }
}
