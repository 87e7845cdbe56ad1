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
pub fn with_comments() -> Schema {
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

#[test]
fn a_description_has_no_links() {
    assert_eq!(without_links("see [this](a.md#b), [128] and [that](c)."), "see this, [128] and that.");
}
