//! What a city's report says of the traffic that was played, the settings, and the meaning of its figures.

use serde_json::Value;

use super::read::City;
use dials_core::base::counted;

/// What a figure means, and how it was measured.
const MEANING: [&str; 6] = [
    "Delay: time that a car loses by driving slower than it would alone (SUMO's timeLoss), and by waiting to enter the net.",
    "Delay at a light: the time that a car loses on an approach and in the junction. An approach begins at the light before, or where \
     cars last had to yield to other cars. The time to gain speed behind the junction counts for the next road.",
    "Level of service: the letter of the Highway Capacity Manual for the delay at a light: A to 10 s, B to 20, C to 35, D to 55, E to \
     80, then F.",
    "Queue: number of standing cars on the worst approach, all lanes, exceeded in 5 % of the seconds.",
    "\u{b1}: half of a 95 % interval over episodes (Student's t). Differences are taken episode by episode on the same traffic.",
    "Cars that are still on their way at the end count with the time that they have lost by then.",
];

/// Returns a setting of the traffic.
fn setting(city: &City, key: &str) -> Option<Value> {
    city.settings.get("traffic")?.get(key).cloned()
}

/// Returns sentences about the traffic that was played, and what played it.
pub(super) fn traffic(city: &City) -> Vec<String> {
    let setting = |key| setting(city, key);
    let mut lines = Vec::new();
    if let (Some(begin), Some(end)) = (setting("begin_s"), setting("end_s")) {
        lines.push(format!("An episode is from {begin} s to {end} s of the scenario's clock."));
    }
    if let Some(warm_up) = setting("warm_up_s").filter(|seconds| *seconds != 0) {
        lines.push(format!("Cars that want to enter in the first {warm_up} s are not counted (traffic.warm_up_s)."));
    }
    lines.push(format!(
        "{} with random numbers of seed {}; every controller plays the same ones.",
        counted(city.episodes, "episode"),
        city.seed
    ));
    if let Some(sumo) = &city.sumo_version {
        lines.push(format!("Simulated with {sumo}."));
    }
    lines
}

/// Returns the times, the seed and the simulator in one line, for a slide.
pub(super) fn in_short(city: &City) -> String {
    let setting = |key| setting(city, key);
    let mut words = Vec::new();
    if let (Some(begin), Some(end)) = (setting("begin_s"), setting("end_s")) {
        words.push(format!("{begin} s to {end} s of the scenario's clock"));
    }
    words.extend(setting("warm_up_s").filter(|seconds| *seconds != 0).map(|warm_up| format!("warm-up {warm_up} s")));
    words.push(format!("seed {}", city.seed));
    words.extend(city.sumo_version.clone());
    format!("{}.", words.join("; "))
}

/// Returns a setting in words.
fn in_words(value: &Value) -> String {
    match value.as_str() {
        Some("program") => "those of each light's own program".to_owned(),
        Some(word) => word.to_owned(),
        None => value.to_string(),
    }
}

/// Returns what was assumed, and what the figures mean, a sentence each.
pub(super) fn assumed(city: &City) -> Vec<String> {
    let setting = |key| setting(city, key);
    let mut lines = traffic(city);
    let has_policies = city.players.iter().any(|player| player.learned);
    for (key, words) in [
        ("decision_s", "Seconds between two decisions of a policy"),
        ("min_green_s", "Least seconds of a green, longer where people on foot need more"),
        ("yellow_s", "Seconds of yellow"),
    ] {
        // Without a policy nothing is decided at these times.
        let counts = key != "decision_s" || has_policies;
        lines.extend(setting(key).filter(|_| counts).map(|value| format!("{words}: {}.", in_words(&value))));
    }
    let rules = city.rules.as_ref().filter(|_| has_policies);
    lines.extend(rules.map(|rules| format!("Policies are rewarded for: {}.", rules.reward)));
    lines.extend(MEANING.map(str::to_owned));
    lines.extend(city.left_out.iter().chain(&city.warnings).map(|line| format!("Note: {line}")));
    lines
}
