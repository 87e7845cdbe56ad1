//! The JSON schema of a config, for editors. It is made from the tables of docs/configuration.md, which a test holds to
//! the keys, the defaults and the meanings that the program knows.

use serde_json::{Map, Value, json};

const PAGE: &str = include_str!("../../../../docs/configuration.md");

/// Keys whose type no default shows, because they have none or are required. Others of these that are in neither list are
/// whole numbers.
const WORDS: [&str; 5] =
    ["policy.imitate", "traffic.agents", "traffic.local_network", "traffic.network", "traffic.scenario"];
/// Such keys whose value is any number.
const NUMBERS: [&str; 1] = ["ppo.max_gradient_norm"];

/// Key whose value is a name, or weights of names.
const REWARD: &str = "traffic.reward";
/// Key whose value is a word, or whole seconds.
const YELLOW: &str = "traffic.yellow_s";

/// Returns the schema: an object per table of a config.
pub fn schema() -> Value {
    let mut keys = Map::new();
    let mut tables: Map<String, Value> = Map::new();
    for (key, default, meaning) in rows() {
        let property = property(key, default, meaning);
        match key.split_once('.') {
            None => drop(keys.insert(key.to_owned(), property)),
            Some((table, name)) => {
                let of_table = tables.entry(table).or_insert_with(|| json!({}));
                of_table.as_object_mut().expect("it was made as one").insert(name.to_owned(), property);
            }
        }
    }
    for (name, properties) in tables {
        keys.insert(name, json!({ "type": "object", "additionalProperties": false, "properties": properties }));
    }
    json!({
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": "config of dials-traffic",
        "type": "object",
        "additionalProperties": false,
        "oneOf": [{ "required": ["traffic"] }, { "required": ["warehouse"] }],
        "properties": keys,
    })
}

/// Returns key, default and meaning of every row.
fn rows() -> impl Iterator<Item = (&'static str, &'static str, &'static str)> {
    PAGE.lines().filter_map(|line| {
        let (key, rest) = line.strip_prefix("| `")?.split_once("` | ")?;
        let (default, rest) = rest.split_once(" | ")?;
        let (meaning, _) = rest.rsplit_once(" |")?.0.rsplit_once(" |")?;
        Some((key, default.trim_matches('`'), meaning))
    })
}

fn property(key: &str, default: &str, meaning: &str) -> Value {
    let value: Option<toml::Value> =
        format!("value = {default}").parse::<toml::Table>().ok().and_then(|mut table| table.remove("value"));
    let mut property = match &value {
        None if WORDS.contains(&key) => json!({ "type": "string" }),
        None if NUMBERS.contains(&key) => json!({ "type": "number" }),
        None | Some(toml::Value::Integer(_)) => json!({ "type": "integer" }),
        Some(toml::Value::Float(_)) => json!({ "type": "number" }),
        Some(toml::Value::Boolean(_)) => json!({ "type": "boolean" }),
        Some(toml::Value::Array(_)) => json!({ "type": "array", "items": { "type": "integer", "minimum": 1 } }),
        Some(toml::Value::String(_)) if key == YELLOW => {
            json!({ "anyOf": [{ "enum": choices(meaning, default) }, { "type": "integer", "minimum": 0 }] })
        }
        Some(toml::Value::String(_)) if key != REWARD => json!({ "enum": choices(meaning, default) }),
        Some(_) => {
            let names = choices(meaning, default);
            json!({ "anyOf": [{ "enum": names }, { "type": "object", "propertyNames": { "enum": names },
                                                    "additionalProperties": { "type": "number" } }] })
        }
    };
    let object = property.as_object_mut().expect("all of them are objects");
    object.insert("description".to_owned(), json!(without_links(meaning)));
    if let Some(value) = value {
        object.insert("default".to_owned(), json!(value));
    }
    property
}

/// Returns the quoted words of a meaning, with the default first.
fn choices(meaning: &str, default: &str) -> Vec<String> {
    let mut words: Vec<String> = Vec::new();
    let written = meaning.split('`').skip(1).step_by(2);
    for word in std::iter::once(default).chain(written) {
        let word = word.rsplit_once(" = ").map_or(word, |(_, value)| value);
        if let Some(word) = word.strip_prefix('"').and_then(|word| word.strip_suffix('"'))
            && !words.iter().any(|known| known == word)
        {
            words.push(word.to_owned());
        }
    }
    words
}

/// Returns a text of Markdown with the words of its links only.
fn without_links(text: &str) -> String {
    let mut parts = text.split("](");
    let first = parts.next().unwrap_or_default().to_owned();
    let text = parts.fold(first, |text, part| text + part.split_once(')').map_or("", |(_, after)| after));
    text.replace('[', "")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::{Path, PathBuf};

    fn allows(property: &Value, value: &toml::Value) -> bool {
        if let Some(choices) = property.get("anyOf").and_then(Value::as_array) {
            return choices.iter().any(|choice| allows(choice, value));
        }
        if let Some(choices) = property.get("enum").and_then(Value::as_array) {
            return choices.contains(&json!(value));
        }
        match property["type"].as_str() {
            Some("string") => value.is_str(),
            Some("integer") => value.is_integer(),
            Some("number") => value.is_float() || value.is_integer(),
            Some("boolean") => value.is_bool(),
            Some("array") => value.is_array(),
            Some("object") => value.is_table(),
            other => panic!("{other:?}"),
        }
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
            for (key, value) in &config {
                let property = &schema["properties"][key];
                assert!(allows(property, value), "{}: {key} = {value}", path.display());
                for (name, value) in value.as_table().into_iter().flatten() {
                    assert!(allows(&property["properties"][name], value), "{}: {key}.{name}", path.display());
                }
            }
        }
        let retrain = &schema["properties"]["aip"]["properties"]["retrain"];
        assert_eq!(retrain["enum"], json!(["every", "once", "drift"]));
        assert!(!allows(retrain, &"never".into()) && !allows(&schema["properties"]["seed"], &"one".into()));
    }

    #[test]
    fn a_description_has_no_links_and_a_default_is_a_value() {
        let clip = &schema()["properties"]["ppo"]["properties"]["clip"];
        assert_eq!((clip["default"].clone(), clip["type"].clone()), (json!(0.1), json!("number")));
        let limit = &schema()["properties"]["ppo"]["properties"]["max_gradient_norm"];
        assert!(allows(limit, &0.5.into()) && limit["default"].is_null(), "{limit}");
        let imitate = schema()["properties"]["policy"]["properties"]["imitate"]["description"].to_string();
        assert!(imitate.contains("a controller, with parameters") && !imitate.contains("]("), "{imitate}");
    }

    #[test]
    fn the_choices_of_a_key_are_those_of_the_program() {
        for (key, choices) in [
            ("simulator", "local gs"),
            ("predictor", "aip marginals untrained"),
            ("ppo.time_limit", "terminal bootstrap"),
            ("traffic.d_set", "cells cells+arrivals cells+light"),
            ("traffic.entry", "reference max"),
            ("traffic.clock_offsets", "none checkerboard"),
            ("traffic.until_first_switch", "agent program"),
            ("traffic.observation", "cells queues"),
            ("numerics.vector_width", "widest 256-bit"),
        ] {
            let at = format!("/properties/{}", key.replace('.', "/properties/"));
            let choices: Vec<&str> = choices.split(' ').collect();
            assert_eq!(schema().pointer(&at).unwrap()["enum"], json!(choices), "{key}");
        }
        let reward = schema().pointer("/properties/traffic/properties/reward").unwrap().clone();
        let names = json!(["mean-speed", "exit-speed", "queue", "lost-time", "pressure", "wait", "diff-waiting-time"]);
        assert_eq!([&reward["anyOf"][0]["enum"], &reward["anyOf"][1]["propertyNames"]["enum"]], [&names; 2]);
    }
}
