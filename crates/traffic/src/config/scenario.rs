//! The table `[traffic]` for a scenario: a .sumocfg of the user instead of a grid of ours.

use std::borrow::Cow;
use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Error, Unexpected};
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::Value;

use super::detectors::DetectorFaults;
use super::grid::is_default;
use super::python::Functions;
use super::reward::Reward;
use super::route_files;
use super::seen_cars::SeenCars;
use super::sumocfg::{MOST_SECONDS, Sumocfg};
use crate::Traffic;
use crate::agents::derive::crossings::Walking;
use crate::scenario::end;
use dials_core::domain::{Domain, DomainTable};

/// A scenario of yours: a .sumocfg of SUMO with its net, route files and additional files. Every light of it that has
/// something to choose learns. Its agents choose a green every `decision_s` seconds; yellow comes by itself.
///
/// A config that names a scenario has other defaults than the paper's, those of
/// [`scenario_defaults.toml`](../crates/traffic/src/config/scenario_defaults.toml): they fit 300 episodes of an hour. They
/// replace the defaults of this page, key by key. Only `aip.patience` stays out if the config names `aip.epochs`.
///
/// A .sumocfg stands for a config that names nothing else, wherever the command line takes a config. `--set` works as for a
/// config. What of a .sumocfg is simulated: see [networks](networks.md#what-of-a-sumocfg-is-simulated).
///
/// `train` and `bench` first cut the local simulators of all lights, and load them once. Lights that cannot be cut are
/// named, with the reasons. `--simulator gs` trains on the whole network and needs none; nor do `baseline` and `evaluate`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
#[schemars(title = "for a scenario", extend("required" = ["scenario"]))]
pub struct ScenarioConfig {
    /// Path of the .sumocfg, relative to the config file.
    pub scenario: PathBuf,
    /// Route files of which each episode plays one, instead of those of the .sumocfg. Paths are relative to the config file. In
    /// the name of a file `*` stands for any letters and `?` for one: `["town_*.rou.xml"]`. The seed of an episode draws its file,
    /// so all controllers meet the same files. See [networks](networks.md#other-routes-in-every-episode).
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub routes: Vec<PathBuf>,
    /// Path of a file that overrides what is derived from the net: which lights learn, greens, approaches, yellow. It
    /// is relative to the config file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub agents: Option<PathBuf>,
    /// File of `export` from which policies start with `policy.start = "any-light"`, instead of from the policy of this program. It
    /// is relative to the config file. A run keeps a copy.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub any_light: Option<PathBuf>,
    /// Second at which an episode begins. If left out, `<begin>` of the .sumocfg, or 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub begin_s: Option<u64>,
    /// Second at which an episode ends. If left out, `<end>` of the .sumocfg. If that names none either, ten minutes after the
    /// last departure, or later if the last vehicle needs longer on free roads; in whole minutes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end_s: Option<u64>,
    /// Whether `end_s` follows from the departures.
    #[serde(skip)]
    #[schemars(skip)]
    pub end_is_derived: bool,
    /// Number of seconds at the beginning of an episode that the figures of `evaluate` and `baseline` leave out. Trips count if the
    /// car wanted to enter later: travel time, delay, stops, emissions, and the figures of lights. Queues, speeds and the waiting of
    /// persons are those of the seconds after it. Rewards, returns and the counts of the whole net are of the whole episode.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = 0))]
    pub warm_up_s: u64,
    /// Factor by which there are more vehicles than the files say: 1.2 is 20 % more. It multiplies SUMO's option `scale`, which
    /// counts for `<person>` elements, too.
    #[serde(skip_serializing_if = "is_one")]
    #[schemars(extend("default" = 1.0))]
    pub demand: f64,
    /// Ids of edges that are closed for everything that drives on roads. Cars with a route across them get another one, and those
    /// that cannot get to their destination are left out. A note says how many these are.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub closed: Vec<String>,
    /// Number of seconds of a decision, which is a step of the domain. The horizon is the number of whole decisions from
    /// begin to end. Hand-coded controllers decide every second. If it is less than 5, defaults that count decisions last as many
    /// seconds as with 5.
    pub decision_s: u32,
    /// Least number of seconds of a green.
    pub min_green_s: u32,
    /// Whether greens also last at least as long as the phases of the light's own program say (`minDur`).
    pub program_min_green: bool,
    /// Whether people on foot get across: greens with a walk signal last long enough, and their walk signals end early enough.
    pub pedestrians: Pedestrians,
    /// Walking speed in metres per second for the shortest green of a crossing: 3.5 ft/s in MUTCD 2009 and HCM 2010.
    pub walking_speed_mps: f64,
    /// Number of seconds in which people on foot may start to cross, before the time for walking. MUTCD 2009: 7, and 4 where
    /// few people walk.
    pub walk_s: f64,
    /// Whether agents leave out the greens that send cars across one that is [trapped](networks.md#trapped-cars) within the junction.
    pub mind_trapped: bool,
    /// What an agent chooses from.
    pub actions: Actions,
    /// Program that counts for lights that have one of this name (`programID`), such as that of the night. If left out, the last
    /// one counts, which SUMO runs. `program` in the file of `agents` chooses for one light.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub program: Option<String>,
    /// Number of seconds of yellow between two greens, for what loses green. `"program"`: as many as in the light's own
    /// program, so that no controller gains time by a shorter yellow; 3 if it shows none.
    pub yellow_s: Yellow,
    /// Distance in metres that an agent sees upstream of its stop lines.
    pub approach_m: f64,
    /// What an agent sees of the cars on its approaches.
    pub observation: Observation,
    /// Share of the cars that agents see with `observation = "lanes"`, drawn car by car in every episode. Each stands for one over the
    /// share. This models traffic in which only some cars report where they are. 0: no car is seen, only what
    /// [detectors](networks.md#detectors) count. Masks and rewards see all cars. Not in local simulators. With a list of shares, every
    /// light draws one of them in every episode: `[1, 0.5, 0.1]`.
    #[serde(skip_serializing_if = "is_default")]
    #[schemars(extend("default" = 1.0))]
    pub seen_cars: SeenCars,
    /// Faults of the detectors, if agents see detectors.
    #[serde(skip_serializing_if = "is_default")]
    pub detector_faults: DetectorFaults,
    /// What an agent is rewarded for, as on a grid. Keep returns within a few units: a value moves by at most `ppo.clip` in
    /// an update. With a weight of 1, `"queue"` and `"wait"` got agents stuck on RESCO's map cologne1. The default comes
    /// from six runs there, one seed each, so it is no proof that other rewards are worse. Returns of
    /// `"diff-waiting-time"` only say what waits at the end of the episode, so they mislead; compare delays instead.
    pub reward: Reward,
    /// Name of a function of Python that computes the reward instead. `reward = "python:NAME"` is the same. See
    /// [Python](python.md#your-own-reward-and-observation).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub python_reward: Option<String>,
    /// The same for the observation, written as NAME, or as NAME[WIDTH] where the number of columns is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub python_observation: Option<String>,
    /// Number of decisions of an episode of the local simulators, at most those from begin to end.
    ///
    /// DEVIATION 17: an episode of the local simulators begins at a drawn second of the demand.
    pub local_horizon: usize,
}

/// What an agent sees of the cars on its approaches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Observation {
    /// A bit for each cell of 10 m.
    #[default]
    Cells,
    /// The queue and the density of each lane.
    Queues,
    /// Cells, and behind all else: buses on each approach, trams on each track of their own, and persons who wait at each
    /// crossing, in tens. Local simulators have no trams and no persons.
    #[serde(rename = "cells+buses")]
    CellsAndBuses,
    /// Detectors in the road, as in the street: on each lane before a stop line one over the last 12 m, and one 60 m before
    /// it. Of each the count and the occupancy since the last decision, and the time since a car. See
    /// [networks](networks.md#detectors).
    Detectors,
    /// What is known of each lane and of each green, for one policy that fits lights of any shape: see
    /// [any light](any-light.md). Not on grids.
    Lanes,
}

/// What people on foot do to greens.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Pedestrians {
    /// A green with a walk signal lasts `walk_s` and the length of its longest crossing over `walking_speed_mps` at least. The
    /// walk signal ends so early that people are across when others get green.
    #[default]
    MinGreen,
    /// Crossings make no green longer, and walk signals end with the green of cars.
    Off,
}

/// What an agent chooses from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Actions {
    /// Any green of its light.
    #[default]
    Greens,
    /// To keep the green, or to go to the next one in the order of the light's program.
    FixedOrder,
    /// Any pair of a phase of ring 1 and one of ring 2 on the same side of the barrier, as of a NEMA controller. Rings are
    /// those of a program of type `NEMA`, or follow from a junction of four arms with left-turn lanes.
    RingBarrier,
}

const LONGEST_S: u32 = 300;
const WALKING_SPEED_MPS: std::ops::RangeInclusive<f64> = 0.2..=3.0;
const WALK_S: std::ops::RangeInclusive<f64> = 0.0..=60.0;
const APPROACH_M: std::ops::RangeInclusive<f64> = 10.0..=1000.0;
/// Factors that `traffic.demand` may be.
pub const DEMAND: std::ops::RangeInclusive<f64> = 0.01..=100.0;
/// Largest number of decisions of an episode, as in the check of a horizon.
const MOST_DECISIONS: u64 = 1_000_000;

fn is_one(factor: &f64) -> bool {
    *factor == 1.0
}

impl Default for ScenarioConfig {
    fn default() -> Self {
        ScenarioConfig::new("")
    }
}

impl ScenarioConfig {
    pub fn new(scenario: impl Into<PathBuf>) -> ScenarioConfig {
        ScenarioConfig {
            scenario: scenario.into(),
            routes: Vec::new(),
            agents: None,
            any_light: None,
            begin_s: None,
            end_s: None,
            end_is_derived: false,
            warm_up_s: 0,
            demand: 1.0,
            closed: Vec::new(),
            decision_s: 5,
            min_green_s: 5,
            program_min_green: true,
            pedestrians: Pedestrians::default(),
            walking_speed_mps: Walking::default().speed_mps,
            walk_s: Walking::default().walk_s,
            mind_trapped: true,
            actions: Actions::default(),
            program: None,
            yellow_s: Yellow::Program,
            approach_m: 150.0,
            observation: Observation::default(),
            seen_cars: SeenCars::default(),
            detector_faults: DetectorFaults::default(),
            reward: Reward::default(),
            python_reward: None,
            python_observation: None,
            local_horizon: 120,
        }
    }

    /// Returns the settings of a .sumocfg that is taken as it is.
    pub fn of_file(scenario: &Path) -> Result<ScenarioConfig> {
        let mut config = ScenarioConfig::new(scenario);
        config.complete()?;
        config.check()?;
        Ok(config)
    }

    /// Returns how people on foot cross; `None`: their crossings make no green longer.
    pub(crate) fn walking(&self) -> Option<Walking> {
        let walking = Walking { speed_mps: self.walking_speed_mps, walk_s: self.walk_s };
        (self.pedestrians == Pedestrians::MinGreen).then_some(walking)
    }

    /// Returns the files of which each episode plays one, for each path of `routes`.
    pub(crate) fn route_files(&self) -> Result<Vec<Vec<PathBuf>>> {
        route_files::all(&self.routes).context("traffic.routes")
    }

    /// Returns the seconds at which an episode begins and ends. An error names the key of the one that is missing.
    pub(crate) fn window_s(&self) -> Result<(u64, u64)> {
        let missing = |key: &str| format!("traffic.{key}: is missing here and in the .sumocfg; set it to a second");
        Ok((self.begin_s.with_context(|| missing("begin_s"))?, self.end_s.with_context(|| missing("end_s"))?))
    }

    /// Returns a note about an end that the .sumocfg does not name.
    pub(crate) fn about_the_end(&self) -> Option<String> {
        let end = self.end_s.filter(|_| self.end_is_derived)?;
        Some(format!(
            "{}: the episode ends at {end} s, because no end is named and the last vehicle departs before; traffic.end_s sets another one",
            self.scenario.display()
        ))
    }

    /// Returns why these settings have no local simulators, if they have none.
    pub(crate) fn cannot_be_local(&self) -> Option<String> {
        (!self.seen_cars.are_all())
            .then(|| "traffic.seen_cars: which cars are seen is drawn by their names in the network".to_owned())
    }

    /// Returns a note about the seconds after the last whole decision, if there are any.
    pub(crate) fn unplayed(&self) -> Option<String> {
        let (begin, end) = self.window_s().expect("a checked config has both");
        let seconds = (end - begin) % u64::from(self.decision_s);
        let decision = self.decision_s;
        (seconds > 0)
            .then(|| format!("the last {seconds} s before {end} s are left out, because a decision takes {decision} s"))
    }
}

impl ScenarioConfig {
    pub(crate) fn functions(&self) -> Functions<'_> {
        Functions { reward: self.python_reward.as_deref(), observation: self.python_observation.as_deref() }
    }
}

impl DomainTable for ScenarioConfig {
    fn horizon(&self) -> usize {
        let (begin, end) = self.window_s().expect("a checked config has both");
        ((end - begin) / u64::from(self.decision_s)) as usize
    }

    fn local_horizon(&self) -> usize {
        self.local_horizon.min(self.horizon())
    }

    fn shows_sets(&self) -> bool {
        self.observation == Observation::Lanes && self.python_observation.is_none()
    }

    fn check(&self) -> Result<()> {
        let yellow = match self.yellow_s {
            Yellow::Seconds(seconds) => Some((0, "yellow_s", seconds)),
            Yellow::Program => None,
        };
        let given = [(1, "decision_s", self.decision_s), (1, "min_green_s", self.min_green_s)];
        for (least, key, value) in given.into_iter().chain(yellow) {
            ensure!(
                (least..=LONGEST_S).contains(&value),
                "traffic.{key} = {value}: must be from {least} to {LONGEST_S} seconds"
            );
        }
        let approach = self.approach_m;
        ensure!(APPROACH_M.contains(&approach), "traffic.approach_m = {approach}: must be from 10 to 1000 metres");
        let (speed, walk) = (self.walking_speed_mps, self.walk_s);
        ensure!(
            WALKING_SPEED_MPS.contains(&speed),
            "traffic.walking_speed_mps = {speed}: must be from 0.2 to 3 metres per second"
        );
        ensure!(WALK_S.contains(&walk), "traffic.walk_s = {walk}: must be from 0 to 60 seconds");
        ensure!(self.local_horizon >= 1, "traffic.local_horizon = 0: must be at least 1 decision; 120 is the default");
        self.reward.check()?;
        self.functions().check()?;
        let demand = self.demand;
        ensure!(
            DEMAND.contains(&demand),
            "traffic.demand = {demand}: must be from {} to {}; 1 is the demand of the files",
            DEMAND.start(),
            DEMAND.end()
        );
        let sees_detectors = self.observation == Observation::Detectors || self.seen_cars.may_be_none();
        self.detector_faults.check(sees_detectors)?;
        self.seen_cars.check()?;
        ensure!(
            self.seen_cars.are_all() || self.observation == Observation::Lanes,
            "traffic.seen_cars: only agents that see lanes miss cars; add observation = \"lanes\""
        );
        ensure!(
            self.observation != Observation::Lanes || self.actions != Actions::FixedOrder,
            "traffic.observation = \"lanes\": policies choose a green, so it does not go with traffic.actions = \"fixed-order\""
        );
        let (begin, end) = self.window_s()?;
        ensure!(end <= MOST_SECONDS, "traffic.end_s = {end}: must be at most {MOST_SECONDS}");
        ensure!(
            begin < end,
            "traffic.begin_s = {begin}: must be before traffic.end_s = {end}; where a config names neither, they are \
             <begin> and <end> of the .sumocfg"
        );
        let warm_up = self.warm_up_s;
        ensure!(
            warm_up < end - begin,
            "traffic.warm_up_s = {warm_up}: must be less than the {} s of an episode",
            end - begin
        );
        let decisions = (end - begin) / u64::from(self.decision_s);
        ensure!(
            (1..=MOST_DECISIONS).contains(&decisions),
            "traffic.decision_s = {}: from {begin} to {end} s there are {decisions} decisions, but there must be from \
             1 to {MOST_DECISIONS}",
            self.decision_s
        );
        Ok(())
    }

    fn paths(&mut self) -> Vec<(&'static str, &mut PathBuf)> {
        let agents = self.agents.as_mut().map(|path| ("agents", path));
        let routes = self.routes.iter_mut().map(|path| ("routes", path));
        let any_light = self.any_light.as_mut().map(|path| ("any_light", path));
        [("scenario", &mut self.scenario)].into_iter().chain(agents).chain(routes).chain(any_light).collect()
    }

    fn defaults(&self) -> &'static str {
        include_str!("scenario_defaults.toml")
    }

    /// Reads the times that the config does not name from the .sumocfg.
    fn complete(&mut self) -> Result<()> {
        if self.begin_s.is_some() && self.end_s.is_some() {
            return Ok(());
        }
        let mut file = Sumocfg::read(&self.scenario)?;
        if !self.routes.is_empty() {
            file.routes = self.route_files()?.concat();
        }
        file.begin_s = *self.begin_s.get_or_insert(file.begin_s);
        // SUMO's tools write an end after many years where they mean none.
        let longest_s = MOST_DECISIONS * u64::from(self.decision_s);
        let named = file.end_s.filter(|end| end.saturating_sub(file.begin_s) <= longest_s);
        self.end_is_derived = self.end_s.is_none() && named.is_none();
        self.end_s = self.end_s.or(named);
        if self.end_is_derived {
            self.end_s = Some(end::of(&file).with_context(|| self.scenario.display().to_string())?);
        }
        Ok(())
    }

    fn open(&self) -> Result<Arc<dyn Domain>> {
        Ok(Arc::new(Traffic::open_scenario(self)?))
    }
}

const PROGRAM: &str = "program";

/// How long lights of a scenario show yellow.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Yellow {
    /// That of the light's own program, in whole seconds. So no controller gains time by a shorter one.
    #[default]
    Program,
    Seconds(u32),
}

impl Display for Yellow {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Yellow::Program => f.write_str("as in the light's own program"),
            Yellow::Seconds(seconds) => write!(f, "{seconds} s"),
        }
    }
}

impl Serialize for Yellow {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Yellow::Program => serializer.serialize_str(PROGRAM),
            Yellow::Seconds(seconds) => serializer.serialize_u32(*seconds),
        }
    }
}

impl<'de> Deserialize<'de> for Yellow {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Yellow, D::Error> {
        match Value::deserialize(deserializer)? {
            Value::String(word) if word == PROGRAM => Ok(Yellow::Program),
            Value::Integer(seconds) if u32::try_from(seconds).is_ok() => Ok(Yellow::Seconds(seconds as u32)),
            other => {
                let wanted = "a whole number of seconds, or \"program\"";
                Err(D::Error::invalid_value(Unexpected::Other(&other.to_string()), &wanted))
            }
        }
    }
}

impl JsonSchema for Yellow {
    fn schema_name() -> Cow<'static, str> {
        "Yellow".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "enum": [PROGRAM] }, { "type": "integer", "minimum": 0 }] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(change: impl Fn(&mut ScenarioConfig)) -> String {
        let mut config =
            ScenarioConfig { begin_s: Some(25_200), end_s: Some(28_800), ..ScenarioConfig::new("a.sumocfg") };
        change(&mut config);
        config.check().map_or_else(|error| error.to_string(), |()| format!("{} decisions", config.horizon()))
    }

    #[test]
    fn the_horizon_is_the_whole_decisions_from_begin_to_end() {
        assert_eq!(checked(|_| {}), "720 decisions");
        // 3600 / 7 = 514.3
        assert_eq!(checked(|config| config.decision_s = 7), "514 decisions");
        assert_eq!(checked(|config| config.end_s = Some(25_205)), "1 decisions");
    }

    #[test]
    fn settings_that_make_no_sense_are_refused() {
        let yellow = checked(|config| config.yellow_s = Yellow::Seconds(301));
        assert_eq!(yellow, "traffic.yellow_s = 301: must be from 0 to 300 seconds");
        for approach in [9.0, 1001.0, f64::NAN] {
            let message = checked(|config| config.approach_m = approach);
            assert_eq!(message, format!("traffic.approach_m = {approach}: must be from 10 to 1000 metres"));
        }
        assert_eq!(
            checked(|config| config.seen_cars = SeenCars::Share(0.005)),
            "traffic.seen_cars = 0.005: must be from 0.01 to 1, or 0 for detectors only"
        );
        assert!(
            checked(|config| config.seen_cars = SeenCars::Share(0.5)).contains("only agents that see lanes miss cars")
        );
        assert!(checked(|config| config.end_s = Some(25_204)).contains("there are 0 decisions"));
        assert!(checked(|config| config.end_s = Some(u64::MAX)).contains("must be at most"));
    }

    #[test]
    fn yellow_is_a_number_or_the_word_and_comes_back_as_it_was_written() {
        for json in ["0", "4", "\"program\""] {
            let yellow: Yellow = serde_json::from_str(json).unwrap();
            assert_eq!(serde_json::to_string(&yellow).unwrap(), json);
        }
        for json in ["-1", "1.5", "\"own\"", "4294967296"] {
            let message = serde_json::from_str::<Yellow>(json).unwrap_err().to_string();
            assert!(message.contains("a whole number of seconds, or \"program\""), "{message}");
        }
    }
}
