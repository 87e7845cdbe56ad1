//! The two ways to fill the table `[traffic]`: a grid of ours, or a scenario of the user.

use std::path::PathBuf;

use serde::de::{Deserializer, Error};
use serde::{Deserialize, Serialize};

use super::reward::Reward;
use super::{ClockOffsets, DSet, EntryRule, Observation, ScenarioConfig, TrafficConfig, UntilFirstSwitch, Yellow};

/// The table as it is read and written.
#[derive(Serialize)]
#[serde(untagged)]
pub(super) enum TrafficTable {
    Grid(TrafficConfig),
    Scenario(ScenarioConfig),
}

/// All keys of both ways.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Keys {
    network: Option<PathBuf>,
    local_network: Option<PathBuf>,
    horizon: Option<usize>,
    d_set: Option<DSet>,
    clock: Option<usize>,
    clock_offsets: Option<ClockOffsets>,
    entry: Option<EntryRule>,
    initial_switch_bias: Option<f32>,
    until_first_switch: Option<UntilFirstSwitch>,
    scenario: Option<PathBuf>,
    agents: Option<PathBuf>,
    begin_s: Option<u64>,
    end_s: Option<u64>,
    decision_s: Option<u32>,
    min_green_s: Option<u32>,
    yellow_s: Option<Yellow>,
    approach_m: Option<f64>,
    observation: Option<Observation>,
    reward: Option<Reward>,
    local_horizon: Option<usize>,
}

impl<'de> Deserialize<'de> for TrafficTable {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<TrafficTable, D::Error> {
        let keys = Keys::deserialize(deserializer)?;
        keys.table().map_err(D::Error::custom)
    }
}

impl Keys {
    fn table(self) -> Result<TrafficTable, String> {
        match (self.scenario.is_some(), &self.network, &self.local_network) {
            (true, ..) => self.scenario_table().map(TrafficTable::Scenario),
            (false, None, None) => {
                Err("[traffic] names nothing to simulate: add `scenario` with the path of a .sumocfg, \
                                        or `network` and `local_network` for a grid"
                    .to_owned())
            }
            _ => self.grid_table().map(TrafficTable::Grid),
        }
    }

    fn grid_table(self) -> Result<TrafficConfig, String> {
        let foreign = [
            ("agents", self.agents.is_some()),
            ("begin_s", self.begin_s.is_some()),
            ("end_s", self.end_s.is_some()),
            ("decision_s", self.decision_s.is_some()),
            ("min_green_s", self.min_green_s.is_some()),
            ("yellow_s", self.yellow_s.is_some()),
            ("approach_m", self.approach_m.is_some()),
            ("local_horizon", self.local_horizon.is_some()),
        ];
        refuse(&foreign, "is for a scenario, but the table names a grid by `network`; remove one of them")?;
        let missing = |key: &str| format!("missing field `{key}`: a grid needs `network` and `local_network`");
        let network = self.network.ok_or_else(|| missing("network"))?;
        let defaults = TrafficConfig::new(network, self.local_network.ok_or_else(|| missing("local_network"))?);
        Ok(TrafficConfig {
            horizon: self.horizon.unwrap_or(defaults.horizon),
            observation: self.observation.unwrap_or(defaults.observation),
            reward: self.reward.unwrap_or(defaults.reward),
            d_set: self.d_set.unwrap_or(defaults.d_set),
            clock: self.clock,
            clock_offsets: self.clock_offsets.unwrap_or_default(),
            entry: self.entry.unwrap_or(defaults.entry),
            initial_switch_bias: self.initial_switch_bias.unwrap_or(defaults.initial_switch_bias),
            until_first_switch: self.until_first_switch.unwrap_or_default(),
            ..defaults
        })
    }

    fn scenario_table(self) -> Result<ScenarioConfig, String> {
        let foreign = [
            ("network", self.network.is_some()),
            ("local_network", self.local_network.is_some()),
            ("horizon", self.horizon.is_some()),
            ("d_set", self.d_set.is_some()),
            ("clock", self.clock.is_some()),
            ("clock_offsets", self.clock_offsets.is_some()),
            ("entry", self.entry.is_some()),
            ("initial_switch_bias", self.initial_switch_bias.is_some()),
            ("until_first_switch", self.until_first_switch.is_some()),
        ];
        refuse(&foreign, "is for a grid, but the table names a .sumocfg by `scenario`; remove one of them")?;
        let defaults = ScenarioConfig::new(self.scenario.expect("this way has the key"));
        Ok(ScenarioConfig {
            agents: self.agents,
            begin_s: self.begin_s,
            end_s: self.end_s,
            decision_s: self.decision_s.unwrap_or(defaults.decision_s),
            min_green_s: self.min_green_s.unwrap_or(defaults.min_green_s),
            yellow_s: self.yellow_s.unwrap_or(defaults.yellow_s),
            approach_m: self.approach_m.unwrap_or(defaults.approach_m),
            observation: self.observation.unwrap_or(defaults.observation),
            reward: self.reward.unwrap_or(defaults.reward),
            local_horizon: self.local_horizon.unwrap_or(defaults.local_horizon),
            ..defaults
        })
    }
}

/// Returns an error that names the first key that is given.
fn refuse(foreign: &[(&str, bool)], why: &str) -> Result<(), String> {
    match foreign.iter().find(|(_, given)| *given) {
        Some((key, _)) => Err(format!("traffic.{key} {why}")),
        None => Ok(()),
    }
}
