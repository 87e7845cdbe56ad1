//! The table `[traffic]` for a grid.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::ensure;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::detectors::DetectorFaults;
use super::python::Functions;
use super::reward::{Reward, RewardTerm};
use super::scenario::Observation;
use crate::Traffic;
use crate::reward::{needs_others, needs_people};
use dials_core::domain::{Domain, DomainTable, Result};

/// A grid of the paper. All streets have one lane in each direction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(title = "for a grid", extend("required" = ["network", "local_network"]))]
pub struct TrafficConfig {
    /// Grid that the GS simulates: its path without `.net.xml`, relative to the config file.
    pub network: PathBuf,
    /// Single intersection that an LS simulates: its path in the same form.
    pub local_network: PathBuf,
    /// Number of steps (seconds) of an episode.
    #[schemars(extend("source" = "P"))]
    pub horizon: usize,
    /// What an agent sees of the cars on its approaches.
    ///
    /// DEVIATION 18: other observations than the paper's, if the config asks for them.
    #[schemars(extend("source" = "P, C"))]
    pub observation: Observation,
    /// Faults of the detectors, if agents see detectors.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = DetectorFaults::default()))]
    pub detector_faults: DetectorFaults,
    /// What an agent is rewarded for: a name, or weights of several: `{ queue = 0.5, wait = 0.5 }`. See
    /// [environments](environments.md#rewards).
    ///
    /// DEVIATION 18: other rewards than the paper's, if the config asks for them.
    #[schemars(extend("source" = "P"))]
    pub reward: Reward,
    /// Name of a function of Python that computes the reward instead. `reward = "python:NAME"` is the same. See
    /// [Python](python.md#your-own-reward-and-observation).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub python_reward: Option<String>,
    /// The same for the observation, written as NAME, or as NAME[WIDTH] where the number of columns is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub python_observation: Option<String>,
    /// What an AIP sees.
    ///
    /// DEVIATION 9: our configs have `"cells+arrivals"`.
    #[schemars(extend("source" = "P, C"))]
    pub d_set: DSet,
    /// Number of steps after which a clock begins again that agents and AIPs see, one input per step. If left out, they
    /// see none. A fixed-time light of 10 + 3 + 10 + 3 steps has 26.
    ///
    /// DEVIATION 13: the paper's agents see no clock. With one they can agree on green waves.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clock: Option<usize>,
    /// By how much the clocks that lights see differ from each other.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = ClockOffsets::None))]
    pub clock_offsets: ClockOffsets,
    /// How a car enters an LS.
    ///
    /// DEVIATION 10: our configs have `"max"`.
    #[schemars(extend("source" = "C"))]
    pub entry: EntryRule,
    /// Value that is added to the initial bias of the logit of "switch".
    ///
    /// DEVIATION 11: our configs have -2.5.
    pub initial_switch_bias: f32,
    /// What controls a light in an episode until its agent's first switch. See DEVIATION 2: the authors' code has about
    /// `"program"`.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = UntilFirstSwitch::Agent))]
    pub until_first_switch: UntilFirstSwitch,
    /// Number of steps at the beginning of an episode that the figures of `evaluate` and `baseline` leave out, as for a
    /// scenario.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = 0))]
    pub warm_up_s: u64,
}

impl Default for TrafficConfig {
    fn default() -> Self {
        TrafficConfig::new("", "")
    }
}

impl TrafficConfig {
    pub fn new(network: impl Into<PathBuf>, local_network: impl Into<PathBuf>) -> TrafficConfig {
        TrafficConfig {
            network: network.into(),
            local_network: local_network.into(),
            horizon: 300,
            observation: Observation::default(),
            detector_faults: DetectorFaults::default(),
            reward: Reward::from(RewardTerm::MeanSpeed),
            python_reward: None,
            python_observation: None,
            d_set: DSet::default(),
            clock: None,
            clock_offsets: ClockOffsets::default(),
            entry: EntryRule::default(),
            initial_switch_bias: 0.0,
            until_first_switch: UntilFirstSwitch::default(),
            warm_up_s: 0,
        }
    }
}

/// The d-set (d-separating set) of the traffic domain.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum DSet {
    /// The 36 cells of an observation of cells.
    #[default]
    #[serde(rename = "cells")]
    Cells,
    /// The same bits and 4 more: did a car enter this edge in the last step?
    #[serde(rename = "cells+arrivals")]
    CellsAndArrivals,
    /// The same bits and the light, as the observation shows it.
    #[serde(rename = "cells+light")]
    CellsAndLight,
}

/// By how much the clocks that lights see differ from each other.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ClockOffsets {
    /// Not at all.
    #[default]
    None,
    /// Every other light is half a cycle behind, so neighbours never see the same second. Then one policy for all lights
    /// can make neighbours switch at different times.
    Checkerboard,
}

/// How a car enters a local traffic simulator.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum EntryRule {
    /// At 6 m with 9.5 m/s, or with 3 m/s if more than 8 cars are on the edge.
    #[default]
    Reference,
    /// At 5 m, as fast as is safe.
    Max,
}

/// What controls a light in an episode until its agent's first switch.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum UntilFirstSwitch {
    /// The agent: a light that it never switches stays as it is.
    #[default]
    Agent,
    /// A fixed-time program of 42 steps of green and 3 of yellow: the one that netconvert gives such a light.
    Program,
}

pub(super) fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}

/// The longest clock, in steps: each is an input of the networks.
const MAX_CLOCK: usize = 300;

impl TrafficConfig {
    pub(crate) fn functions(&self) -> Functions<'_> {
        Functions { reward: self.python_reward.as_deref(), observation: self.python_observation.as_deref() }
    }
}

impl DomainTable for TrafficConfig {
    fn horizon(&self) -> usize {
        self.horizon
    }

    fn check(&self) -> Result<()> {
        self.reward.check()?;
        self.functions().check()?;
        self.detector_faults.check(self.observation == Observation::Detectors)?;
        ensure!(
            self.observation != Observation::Lanes,
            "traffic.observation = \"lanes\": policies choose a green, but lights of a grid keep or switch; use a scenario"
        );
        ensure!(
            self.observation != Observation::CellsAndBuses
                && !needs_others(&self.reward)
                && !needs_people(&self.reward),
            "traffic.observation and traffic.reward: a grid has neither buses nor persons; use a scenario for these"
        );
        let (warm_up, horizon) = (self.warm_up_s, self.horizon);
        ensure!(
            warm_up < horizon as u64,
            "traffic.warm_up_s = {warm_up}: must be less than traffic.horizon = {horizon}"
        );
        let bias = self.initial_switch_bias;
        ensure!(bias.is_finite(), "traffic.initial_switch_bias = {bias}: must be a finite number");
        if let Some(clock) = self.clock {
            ensure!((2..=MAX_CLOCK).contains(&clock), "traffic.clock = {clock}: must be from 2 to {MAX_CLOCK} steps");
        }
        ensure!(
            self.clock.is_some() || is_default(&self.clock_offsets),
            "traffic.clock_offsets needs a clock: add traffic.clock, such as 26"
        );
        Ok(())
    }

    fn paths(&mut self) -> Vec<(&'static str, &mut PathBuf)> {
        vec![("network", &mut self.network), ("local_network", &mut self.local_network)]
    }

    fn local_keys(&self) -> &'static [&'static str] {
        &["local_network", "d_set", "entry"]
    }

    fn open(&self) -> Result<Arc<dyn Domain>> {
        Ok(Arc::new(Traffic::open(self)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::RewardTerm;

    #[test]
    fn a_grid_rewards_nobody_for_buses_or_persons() {
        for term in [RewardTerm::BusDelay, RewardTerm::PersonWait] {
            let config = TrafficConfig { reward: Reward::from(term), ..TrafficConfig::new("", "") };
            let error = config.check().unwrap_err().to_string();
            assert!(error.contains("a grid has neither buses nor persons"), "{error}");
        }
    }
}
