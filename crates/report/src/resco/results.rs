//! What a benchmark measured, read from what `baseline --json` prints.

use serde_json::Value;

use super::published::Map;
use dials_core::base::statistics::Spread;

/// The figures of a controller or of a policy over some episodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Measurement {
    /// Mean over episodes, and half of its 95 % interval, in seconds per car.
    pub delay_s: f64,
    pub half_width_s: Option<f64>,
    /// Delay of the median episode: what is usual, where some episodes jam.
    pub median_s: Option<f64>,
    pub travel_time_s: Option<f64>,
    /// Mean number of cars per episode that were moved past a jam.
    pub teleports: Option<f64>,
    pub stuck_agents: Option<u64>,
    pub episodes: u64,
}

impl Measurement {
    /// Reads the object of one player. Returns `None` if it lacks a figure that must be there.
    pub fn of(player: &Value) -> Option<Measurement> {
        let number = |key: &str| player.get(key).and_then(Value::as_f64);
        let delay_of = |object: &str| player.get(object).and_then(|all| all.get("delay_s")).and_then(Value::as_f64);
        Some(Measurement {
            delay_s: number("delay_s")?,
            half_width_s: delay_of("half_width_95"),
            median_s: delay_of("episode_median"),
            travel_time_s: number("travel_time_s"),
            teleports: number("teleports"),
            stuck_agents: player.get("stuck_agents").and_then(Value::as_u64),
            episodes: player.get("episodes").and_then(Value::as_u64)?,
        })
    }
}

/// The last policies of a run, and what they cost.
#[derive(Clone, Debug)]
pub struct RunResult {
    pub seed: u64,
    pub greedy: Option<Measurement>,
    pub sampled: Option<Measurement>,
    /// CPU time of all processes, evaluations during training among it.
    pub cpu_s: Option<f64>,
    /// Number of episodes whose time the policies were trained for.
    pub episodes: f64,
}

#[derive(Clone, Debug)]
pub struct MethodResults {
    /// Short form, such as `gs-shared`.
    pub method: String,
    pub runs: Vec<RunResult>,
}

impl MethodResults {
    /// Returns the spread of the delay over seeds. `greedy`: of the most probable actions, otherwise of sampled ones.
    pub fn delay(&self, greedy: bool) -> Option<Spread> {
        let delays: Vec<f64> = self.measured(greedy).map(|found| found.delay_s).collect();
        Spread::of(&delays)
    }

    /// Returns the mean over seeds of the median episode's delay.
    pub fn median_s(&self, greedy: bool) -> Option<f64> {
        let medians: Vec<f64> = self.measured(greedy).filter_map(|found| found.median_s).collect();
        Spread::of(&medians).map(|spread| spread.mean)
    }

    fn measured(&self, greedy: bool) -> impl Iterator<Item = &Measurement> {
        self.runs.iter().filter_map(move |run| if greedy { run.greedy.as_ref() } else { run.sampled.as_ref() })
    }

    /// Returns the mean CPU time of a run in seconds.
    pub fn cpu_s(&self) -> Option<f64> {
        let all: Vec<f64> = self.runs.iter().filter_map(|run| run.cpu_s).collect();
        Spread::of(&all).map(|spread| spread.mean)
    }
}

#[derive(Clone, Debug)]
pub struct MapResults {
    pub map: &'static Map,
    pub lights: usize,
    /// Hand-coded controllers by the name that the page shows.
    pub controllers: Vec<(String, Measurement)>,
    pub methods: Vec<MethodResults>,
    /// Names of what was asked for and is not there.
    pub missing: Vec<String>,
    /// What a reader must know of this copy of the map.
    pub notes: Vec<String>,
}

impl MapResults {
    pub fn controller(&self, name: &str) -> Option<&Measurement> {
        self.controllers.iter().find(|(own, _)| own == name).map(|(_, found)| found)
    }
}

/// What holds for all maps.
#[derive(Clone, Debug)]
pub struct About {
    /// Name of the protocol, and what it says, a sentence each.
    pub protocol: String,
    pub rules: Vec<String>,
    /// Number of training episodes per run, and of episodes that are played to measure.
    pub episodes: u64,
    pub measured_episodes: u64,
    pub seeds: Vec<u64>,
    /// Command that makes all this again.
    pub command: String,
    pub sumo: String,
    /// Maps of RESCO that the user's copy lacks.
    pub absent: Vec<String>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_player_is_read_from_what_baseline_prints_and_one_episode_has_no_interval() {
        let player = json!({ "delay_s": 40.5, "episodes": 1, "half_width_95": { "delay_s": null }, "teleports": 2.0,
                             "episode_median": { "delay_s": 39.0 } });
        let found = Measurement::of(&player).unwrap();
        assert_eq!((found.delay_s, found.half_width_s, found.teleports), (40.5, None, Some(2.0)));
        assert_eq!(found.median_s, Some(39.0));
        assert_eq!(Measurement::of(&json!({ "episodes": 1 })), None);
    }
}
