//! The board as numbers: CSV with a line per measurement, and JSON.

use anyhow::{Context, Result};
use serde_json::{Value, json};

use super::published::Published;
use super::results::{About, MapResults, Measurement, RunResult};
use dials_core::base::statistics::Spread;

const HEADER: [&str; 13] = [
    "map",
    "player",
    "kind",
    "seed",
    "actions",
    "delay_s",
    "half_width_95_s",
    "median_s",
    "travel_time_s",
    "teleports",
    "measured_episodes",
    "cpu_s",
    "training_episodes",
];

/// One line per controller, per run and way of acting, and per published figure.
pub(super) fn csv(maps: &[MapResults]) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(HEADER)?;
    for of_map in maps {
        let map = of_map.map.name;
        for (name, found) in &of_map.controllers {
            writer.write_record(line([map, name, "controller", "", ""], found, ["", ""].map(str::to_owned)))?;
        }
        for method in &of_map.methods {
            for run in &method.runs {
                let seed = run.seed.to_string();
                for (actions, found) in both(run) {
                    let cost = [number(run.cpu_s), run.episodes.to_string()];
                    writer.write_record(line([map, &method.method, "last policy", &seed, actions], found, cost))?;
                }
            }
        }
        for Published { player, kind, delay_s } in of_map.map.published {
            let kind = format!("published, {}", kind.words());
            let delay = delay_s.to_string();
            writer.write_record([map, *player, kind.as_str(), "", "", delay.as_str(), "", "", "", "", "", "", ""])?;
        }
    }
    String::from_utf8(writer.into_inner().context("a CSV file in memory")?).context("a CSV file of text")
}

fn line(place: [&str; 5], found: &Measurement, cost: [String; 2]) -> Vec<String> {
    let figures = [
        found.delay_s.to_string(),
        number(found.half_width_s),
        number(found.median_s),
        number(found.travel_time_s),
        number(found.teleports),
        found.episodes.to_string(),
    ];
    place.map(str::to_owned).into_iter().chain(figures).chain(cost).collect()
}

fn number(value: Option<f64>) -> String {
    value.map_or(String::new(), |value| value.to_string())
}

fn both(run: &RunResult) -> impl Iterator<Item = (&'static str, &Measurement)> {
    let greedy = run.greedy.iter().map(|found| ("greedy", found));
    greedy.chain(run.sampled.iter().map(|found| ("sampled", found)))
}

pub(super) fn json(about: &About, maps: &[MapResults]) -> String {
    let object = json!({
        "protocol": about.protocol,
        "episodes": about.episodes,
        "measured_episodes": about.measured_episodes,
        "seeds": about.seeds,
        "sumo_version": about.sumo,
        "command": about.command,
        "absent": about.absent,
        "maps": maps.iter().map(of_map).collect::<Vec<_>>(),
    });
    format!("{object:#}\n")
}

fn of_map(of_map: &MapResults) -> Value {
    let controllers = of_map.controllers.iter().map(|(name, found)| with(measured(found), "controller", json!(name)));
    let methods = of_map.methods.iter().map(|method| {
        let runs = method.runs.iter().map(|run| {
            json!({
                "seed": run.seed,
                "greedy": run.greedy.as_ref().map(measured),
                "sampled": run.sampled.as_ref().map(measured),
                "cpu_s": run.cpu_s,
                "episodes": run.episodes,
            })
        });
        json!({
            "method": method.method,
            "greedy": method.delay(true).map(spread),
            "sampled": method.delay(false).map(spread),
            "cpu_s": method.cpu_s(),
            "runs": runs.collect::<Vec<_>>(),
        })
    });
    let published = of_map.map.published.iter().map(
        |Published { player, kind, delay_s }| json!({ "player": player, "kind": kind.words(), "delay_s": delay_s }),
    );
    json!({
        "map": of_map.map.name,
        "lights": of_map.lights,
        "controllers": controllers.collect::<Vec<_>>(),
        "methods": methods.collect::<Vec<_>>(),
        "published": published.collect::<Vec<_>>(),
        "missing": of_map.missing,
        "notes": of_map.notes,
    })
}

fn measured(found: &Measurement) -> Value {
    json!({
        "delay_s": found.delay_s,
        "half_width_95_s": found.half_width_s,
        "median_delay_s": found.median_s,
        "travel_time_s": found.travel_time_s,
        "teleports": found.teleports,
        "stuck_agents": found.stuck_agents,
        "episodes": found.episodes,
    })
}

fn with(mut object: Value, key: &str, value: Value) -> Value {
    object[key] = value;
    object
}

fn spread(delay: Spread) -> Value {
    let interval = delay.interval.map(|ends| [ends.low, ends.high]);
    json!({ "seeds": delay.runs(), "mean_delay_s": delay.mean, "interval_95_s": interval, "delays_s": delay.values })
}
