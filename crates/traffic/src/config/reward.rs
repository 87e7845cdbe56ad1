//! The reward of a light: a name, or a weighted sum of named terms.

use std::borrow::Cow;
use std::collections::BTreeMap;

use anyhow::{Result, ensure};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Deserializer, Error, Unexpected};
use serde::{Deserialize, Serialize, Serializer};
use toml::Value;

/// What a light can be rewarded for. All of it is measured on its own approaches and exits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RewardTerm {
    /// Mean of the cars' speed as a share of the limit of their lanes; 0 without cars.
    MeanSpeed,
    /// The same of the cars that have left the light and are on its exits.
    ExitSpeed,
    /// Minus the number of standing cars, in tens.
    Queue,
    /// Minus the square root of the number of standing cars before the light and on its exits. A jam does not outweigh what many other
    /// lights do, and a car that only moves into the next queue is no gain. So it suits a policy that many lights share.
    RootQueue,
    /// Minus the time that the cars on the approaches lose against their limits, in tens of cars: a standing car counts
    /// 1, a car at half the limit counts 0.5.
    LostTime,
    /// Minus the pressure, in tens of cars: those that come minus those that leave.
    Pressure,
    /// Minus the time for which the cars on the approaches have stood there, in units of 100 s, at most 10.
    Wait,
    /// That time before the decision minus the time after it, in units of 100 s.
    DiffWaitingTime,
    /// Minus the time that buses and trams before the light lose against their limits: one that stands counts 1.
    BusDelay,
    /// Minus the number of persons who wait at the light's crossings, in tens. Local simulators have none.
    PersonWait,
    /// Minus the number of cars that came to a stand on the approaches since the decision, in tens.
    Stops,
    /// The number of cars that left the approaches since the decision, in tens. Where too many cars come, the queue stays long with any
    /// green, and this reward still differs from green to green.
    Passed,
    /// Minus the CO2 that the cars on the approaches emitted since the decision, in units of 100 g, by the emission classes of their
    /// types (SUMO's HBEFA). It takes CPU time: SUMO computes it for every car in every second.
    Co2,
}

impl RewardTerm {
    /// Returns what the term is, as docs/environments.md explains it.
    pub(crate) fn words(self) -> &'static str {
        match self {
            RewardTerm::MeanSpeed => "mean speed of the cars on the approaches, as a share of the limit",
            RewardTerm::ExitSpeed => "mean speed of the cars on the exits, as a share of the limit",
            RewardTerm::Queue => "minus the standing cars on the approaches, in tens",
            RewardTerm::RootQueue => "minus the square root of the standing cars on the approaches and exits",
            RewardTerm::LostTime => {
                "minus the seconds that the cars on the approaches lose in a second against the limits, in tens"
            }
            RewardTerm::Pressure => "the cars on the exits minus those on the approaches, in tens",
            RewardTerm::Wait => {
                "minus the seconds that the cars on the approaches have stood there, in hundreds, at least -10"
            }
            RewardTerm::BusDelay => "minus the seconds that buses and trams lose in a second against the limits",
            RewardTerm::PersonWait => "minus the persons who wait at the crossings, in tens",
            RewardTerm::Stops => "minus the cars that came to a stand on the approaches since the decision, in tens",
            RewardTerm::Passed => "the cars that left the approaches since the decision, in tens",
            RewardTerm::Co2 => "minus the CO2 that the cars on the approaches emitted since the decision, in 100 g",
            RewardTerm::DiffWaitingTime => {
                "the seconds of `wait` before the decision minus those after it, in hundreds"
            }
        }
    }
}

/// Weights of terms, at least one.
// It is written as the name of a term if that is the only one and has the weight 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Reward(BTreeMap<RewardTerm, f64>);

/// Largest weight. A larger one must be a typing error.
const MOST_WEIGHT: f64 = 1e6;

impl Reward {
    /// Returns the terms with their weights, in the order of [`RewardTerm`].
    pub(crate) fn terms(&self) -> impl Iterator<Item = (RewardTerm, f64)> {
        self.0.iter().map(|(&term, &weight)| (term, weight))
    }

    /// Returns a word of letters, digits and hyphens that no other reward has.
    pub(crate) fn name(&self) -> String {
        match serde_json::to_value(self) {
            Ok(serde_json::Value::String(name)) => name,
            weights => format!("weights-{:08x}", crc32fast::hash(weights.unwrap_or_default().to_string().as_bytes())),
        }
    }

    pub(super) fn check(&self) -> Result<()> {
        ensure!(
            self.0.values().any(|&weight| weight != 0.0),
            "traffic.reward: has no weight other than 0; name a reward, such as \"queue\""
        );
        for (term, weight) in &self.0 {
            let name = serde_json::to_value(term)?;
            let name = name.as_str().expect("a term is written as its name");
            ensure!(
                weight.abs() <= MOST_WEIGHT,
                "traffic.reward.{name} = {weight}: must be from -{MOST_WEIGHT} to {MOST_WEIGHT}"
            );
        }
        Ok(())
    }
}

impl From<RewardTerm> for Reward {
    fn from(term: RewardTerm) -> Reward {
        Reward(BTreeMap::from([(term, 1.0)]))
    }
}

/// The default of scenarios is the queue: what it sums up to is the time that cars stand. The weight keeps returns
/// within a few units, because a value moves by at most the clip range in an update.
impl Default for Reward {
    fn default() -> Reward {
        Reward(BTreeMap::from([(RewardTerm::Queue, 0.1)]))
    }
}

impl Serialize for Reward {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0.first_key_value() {
            Some((term, 1.0)) if self.0.len() == 1 => term.serialize(serializer),
            _ => self.0.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for Reward {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Reward, D::Error> {
        const WANTED: &str = "the name of a reward, or a table of weights such as { queue = 0.5, wait = 0.5 }";
        let reward = match Value::deserialize(deserializer)? {
            name @ Value::String(_) => name.try_into::<RewardTerm>().map(Reward::from),
            weights @ Value::Table(_) => weights.try_into().map(Reward),
            other => return Err(D::Error::invalid_type(Unexpected::Other(&other.to_string()), &WANTED)),
        };
        reward.map_err(|error| D::Error::custom(error.message()))
    }
}

impl JsonSchema for Reward {
    fn schema_name() -> Cow<'static, str> {
        "Reward".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let term = generator.subschema_for::<RewardTerm>();
        let weights =
            json_schema!({ "type": "object", "propertyNames": term, "additionalProperties": { "type": "number" } });
        json_schema!({ "anyOf": [term, weights] })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(json: &str) -> Result<Reward, String> {
        serde_json::from_str(json).map_err(|error| error.to_string())
    }

    #[test]
    fn a_weight_of_one_is_the_term_itself_and_every_reward_has_a_word_of_its_own() {
        assert_eq!(read("{\"queue\":0.1}").unwrap(), Reward::default());
        assert_eq!(read("{\"wait\":1.0}").unwrap(), Reward::from(RewardTerm::Wait));
        assert_eq!(read("\"wait\"").unwrap().name(), "wait");
        let names = ["{\"queue\":0.1}", "{\"queue\":0.2}"].map(|json| read(json).unwrap().name());
        assert!(names[0].starts_with("weights-") && names[0] != names[1], "{names:?}");
    }

    #[test]
    fn what_is_no_reward_is_refused() {
        assert!(
            read("{\"speed\":1}").unwrap_err().starts_with("unknown variant `speed`, expected one of `mean-speed`, ")
        );
        assert!(read("3").unwrap_err().contains("expected the name of a reward, or a table of weights"));
        let refused = |json: &str| read(json).unwrap().check().unwrap_err().to_string();
        assert!(refused("{\"wait\":0}").contains("has no weight other than 0"));
        assert_eq!(refused("{\"wait\":1e7}"), "traffic.reward.wait = 10000000: must be from -1000000 to 1000000");
    }
}
