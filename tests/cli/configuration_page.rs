//! docs/configuration.md is made from the schema, a row per key. Only its head is written by hand.

use std::fs;
use std::path::Path;

use dials_core::base::keys_of;
use dials_session::config::RunConfig;
use dials_session::config::schema::with_comments;
use serde_json::{Map, Value};

/// First heading of the part that is made.
const FIRST: &str = "## The run";

fn page() -> String {
    let schema = with_comments().to_value();
    let tables = keys_of::<RunConfig>(&[]).iter().copied().filter(|key| is_table(&schema["properties"][key]));
    let one_of = schema["oneOf"].as_array().expect("a config has one domain");
    let is_domain = |key: &str| one_of.iter().any(|domain| domain["required"][0] == key);
    let (domains, others): (Vec<&str>, Vec<&str>) = tables.partition(|key| is_domain(key));
    let mut page = format!("{FIRST}\n{}", rows("", &schema, keys_of::<RunConfig>(&[])));
    for name in domains.into_iter().chain(others) {
        let table = &schema["properties"][name];
        page += &format!("\n## `[{name}]`\n{}", section(name, table));
        for way in table["anyOf"].as_array().into_iter().flatten() {
            let title = way["title"].as_str().expect("each way to fill a table has a title");
            page += &format!("\n## `[{name}]` {title}\n{}", section(name, way));
        }
    }
    page
}

fn is_table(schema: &Value) -> bool {
    schema["properties"].is_object() || schema["anyOf"][0]["properties"].is_object()
}

/// Returns the words about a table, and its rows.
fn section(name: &'static str, table: &Value) -> String {
    let words = table["description"].as_str().unwrap_or_default();
    let words: Vec<String> = words.split("\n\n").map(|paragraph| format!("\n{paragraph}\n")).collect();
    words.concat() + &rows(&format!("{name}."), table, keys_of::<RunConfig>(&[name]))
}

/// Returns a row for each key that is not a table itself. `order`: the keys in their order, and others.
fn rows(prefix: &str, table: &Value, order: &[&str]) -> String {
    let keys = order.iter().filter_map(|&key| Some((key, table["properties"].get(key)?)));
    let required = |key: &str| table["required"].as_array().is_some_and(|all| all.iter().any(|other| other == key));
    let row = |(key, schema): (&str, &Value)| {
        let default = match schema.get("default") {
            _ if required(key) => "required".to_owned(),
            None => "none".to_owned(),
            Some(default) => as_toml(default),
        };
        let (meaning, departures) = meaning(schema);
        let papers = schema["source"].as_str().map(|source| format!(" [{source}]"));
        let departures = departures.iter().map(|number| format!(" [D {number}]"));
        let sources: Vec<String> = papers.into_iter().chain(departures).collect();
        format!("| `{prefix}{key}` | {} | {default} | {meaning} |{} |\n", kind(schema), sources.join(";"))
    };
    let rows: String = keys.filter(|(_, schema)| !is_table(schema)).map(row).collect();
    if rows.is_empty() {
        rows
    } else {
        format!("\n| key | type | default | meaning | source |\n|---|---|---|---|---|\n{rows}")
    }
}

fn as_toml(value: &Value) -> String {
    let text = toml::Value::try_from(value).expect("a default is a value of a config").to_string();
    if value.is_string() || value.is_object() { format!("`{text}`") } else { text }
}

fn kind(schema: &Value) -> String {
    if let Some(ways) = schema["anyOf"].as_array() {
        return ways.iter().map(kind).collect::<Vec<String>>().join(" or ");
    }
    let name = schema["type"].as_str().or_else(|| schema["type"][0].as_str());
    match name {
        Some("array") => format!("list of {}s", kind(&schema["items"])),
        Some("object") => "table".to_owned(),
        Some("string") => "text".to_owned(),
        Some(name) => name.to_owned(),
        None => "word".to_owned(),
    }
}

/// Returns the meaning of a key with its words, and the departures from the paper in it.
fn meaning(schema: &Value) -> (String, Vec<String>) {
    let mut meaning = schema["description"].as_str().expect("every key has a comment").to_owned();
    for word in words_of(schema) {
        meaning +=
            &format!(" `{}`: {}", word["const"], word["description"].as_str().expect("every word has a comment"));
    }
    let numbers = meaning.split("DEVIATION ").skip(1).map(|rest| rest.split(':').next().unwrap_or_default().to_owned());
    let numbers = numbers.collect();
    let meaning = meaning.split_whitespace().collect::<Vec<&str>>().join(" ");
    (meaning.replace("See DEVIATION", "See departure").replace("DEVIATION", "Departure"), numbers)
}

/// Returns the words that a key may have, if they are explained.
fn words_of(schema: &Value) -> impl Iterator<Item = &Map<String, Value>> {
    let choices = schema["oneOf"].as_array().or_else(|| schema["anyOf"][0]["oneOf"].as_array());
    choices.into_iter().flatten().filter_map(Value::as_object)
}

#[test]
fn the_page_is_the_one_that_the_code_makes() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/configuration.md");
    let committed = fs::read_to_string(&path).unwrap();
    let (head, _) = committed.split_once(FIRST).expect("the head ends there");
    let made = format!("{head}{}", page());
    if std::env::var_os("UPDATE").is_some() {
        return fs::write(&path, &made).unwrap();
    }
    let differs = committed.lines().zip(made.lines()).find(|(old, new)| old != new);
    assert!(committed == made, "write docs/configuration.md again with UPDATE=1; the first line: {differs:?}");
}
