//! The numbers among SUMO's options and the attributes of its files, and which of them this program lets through.
//!
//! SUMO reads `nan`, `inf` and 1e308 as numbers like any other. Then it dies of an assertion in the middle of an episode, never
//! comes back, or lets no car in, and an episode without cars has the best possible return. So every number must be finite
//! and of a size that means something. A few have narrower ranges, each with its reason ([`RANGES`]).
//!
//! **What is judged here is size alone.** Whether a value fits, such as a negative length, is SUMO's to say. What is no
//! number passes: words such as `max`, and all that is not in the table. So nothing is refused that SUMO plays as it should.
//!
//! `table.txt` says which names are numbers. `make.py` makes it from SUMO's own lists.

mod range;
mod reading;

use std::collections::HashMap;
use std::sync::LazyLock;

use anyhow::{Result, anyhow};

use crate::network::roads::attributes::wrong;
use dials_core::outside::excerpt;
use dials_core::outside::tree::Element;
use range::Range;
use reading::{Number, numbers_in};

/// What a line of the table says: options, or attributes of an element, and their kind.
const TABLE: &str = include_str!("table.txt");
/// Name of the options in the table. No element of SUMO has it.
const OPTION: &str = "option";
const TYPE: &str = "vType";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Int,
    Float,
    /// Seconds, or a clock.
    Time,
}

type Numbers = HashMap<&'static str, HashMap<&'static str, Kind>>;

static NUMBERS: LazyLock<Numbers> = LazyLock::new(|| read(TABLE));

fn read(table: &'static str) -> Numbers {
    let mut found = Numbers::new();
    let (mut of, mut kind) = ("", Kind::Float);
    for line in table.lines().filter(|line| !line.starts_with('#')) {
        let names = match line.split_once(": ") {
            Some((head, names)) => {
                let (element, word) = head.split_once(' ').expect("a line begins with two words");
                kind = match word {
                    "int" => Kind::Int,
                    "time" => Kind::Time,
                    _ => Kind::Float,
                };
                of = element;
                names
            }
            None => line,
        };
        found.entry(of).or_default().extend(names.split_whitespace().map(|name| (name, kind)));
    }
    found
}

fn kind_of(of: &str, name: &str) -> Option<Kind> {
    NUMBERS.get(of)?.get(name).copied()
}

/// Checks the value of an option. The error goes on a sentence about it: `is nan, which ...`.
pub(super) fn check_option(name: &str, value: &str) -> Result<()> {
    let Some(kind) = kind_of(OPTION, name) else { return Ok(()) };
    match why_not(OPTION, name, kind, value) {
        None => Ok(()),
        Some(why) => Err(anyhow!("is `{}`: {why}; correct it", excerpt(value))),
    }
}

/// Checks all numbers below the root element of a file.
pub(crate) fn check_elements(root: &Element) -> Result<()> {
    root.children.iter().try_for_each(|element| {
        check_element(element)?;
        check_elements(element)
    })
}

fn check_element(element: &Element) -> Result<()> {
    // What stands in carFollowing-... may stand in the type itself.
    let name = if element.name.starts_with("carFollowing-") { TYPE } else { &element.name };
    if name == "param" {
        return check_parameter(element);
    }
    // Most elements of a net have none.
    let Some(numbers) = NUMBERS.get(name) else { return Ok(()) };
    for (key, value) in &element.attributes {
        if let Some(why) = numbers.get(&**key).and_then(|&kind| why_not(name, key, kind, value)) {
            return Err(wrong(element, key, &format!("{why}; correct it")));
        }
    }
    Ok(())
}

/// Checks a parameter. It has the name of an option of a device, or of an attribute of a type.
fn check_parameter(element: &Element) -> Result<()> {
    let (Some(key), Some(value)) = (element.attribute("key"), element.attribute("value")) else { return Ok(()) };
    let known = [OPTION, TYPE].into_iter().find_map(|of| Some((of, kind_of(of, key)?)));
    match known.and_then(|(of, kind)| why_not(of, key, kind, value)) {
        None => Ok(()),
        Some(why) => Err(anyhow!("<param key=\"{}\">: value=\"{}\": {why}; correct it", excerpt(key), excerpt(value))),
    }
}

/// Returns what is wrong with a value of this kind, if anything. `of`: the element, or [`OPTION`].
fn why_not(of: &str, name: &str, kind: Kind, text: &str) -> Option<String> {
    let range = Range::of(of, name, kind);
    let numbers = numbers_in(text);
    let outside = numbers.iter().find_map(|number| match number {
        Number::Plain(value) => range.why_not(*value),
        Number::Argument(value) => Range::of_argument().why_not(*value),
        // `normc(1,0.1,0.2,inf)` has no upper bound.
        Number::Bound(value) => value.is_nan().then(|| range::NOT_FINITE.to_owned()),
    });
    outside.or_else(|| reading::never_drawn(text))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::outside::tree::parse;

    fn error(elements: &str) -> String {
        let root = parse(&format!("<routes>{elements}</routes>")).unwrap();
        check_elements(&root).map_or_else(|error| error.to_string(), |()| "passes".to_owned())
    }

    #[test]
    fn the_table_knows_the_kinds_of_options_and_attributes() {
        for (of, name, kind) in [
            ("option", "scale", Some(Kind::Float)),
            ("option", "device.rerouting.adaptation-steps", Some(Kind::Int)),
            ("option", "time-to-teleport", Some(Kind::Time)),
            ("option", "eager-insert", None),
            ("vType", "jmSigmaMinor", Some(Kind::Float)),
            ("vType", "lcStrategic", Some(Kind::Float)),
            ("vType", "vClass", None),
            ("flow", "period", Some(Kind::Time)),
            ("route", "repeat", Some(Kind::Int)),
            ("stop", "duration", Some(Kind::Time)),
            ("trip", "id", None),
        ] {
            assert_eq!(kind_of(of, name), kind, "{of} {name}");
        }
    }

    #[test]
    fn words_and_numbers_of_an_ordinary_size_pass() {
        for element in [
            "<vType id='nan' speedFactor='normc(1,0.1,0.2,2)' sigma='0.5' maxSpeed='inf' impatience='off'/>",
            "<vType id='a' speedFactor='norm(1,0.1)' speedDev='0' tau='1.0' actionStepLength='2' scale='1.5'/>",
            "<vType id='a' speedFactor='normc(1,0,1,1)' emissionClass='nan'><carFollowing-IDM delta='4'/></vType>",
            "<vType id='a' speedFactor='normc(1,0.1,0.2,inf)' lcStrategic='-1' jmTimegapMinor='1e6'/>",
            "<flow id='a' period='exp(0.5)' begin='00:10:00' end='1e10' departPos='random' departSpeed='max'/>",
            "<flow id='a' period='poisson(0.1)' begin='triggered' number='100000' arrivalPos='-1'/>",
            "<trip id='a' depart='triggered' departPos='random_free' arrivalSpeed='current'/>",
            "<stop lane='a' until='1:00:00:00' duration='1e9'/>",
            "<route id='a' edges='a b' repeat='100' cycleTime='60'/>",
            "<vehicle id='a' depart='now'/><person id='a' depart='split' speedFactor='1'/>",
            "<param key='color' value='nan'/><param key='device.rerouting.period' value='60'/>",
        ] {
            assert_eq!(error(element), "passes", "{element}");
        }
        for (name, value) in [
            ("scale", "1.5"),
            ("time-to-teleport", "-1"),
            ("max-num-vehicles", "2147483647"),
            ("weights.random-factor", "1"),
            ("device.rerouting.adaptation-steps", "180"),
            ("default.speeddev", "0.1"),
            ("default.carfollowmodel", "nan"),
            ("no-such-option", "nan"),
        ] {
            assert!(check_option(name, value).is_ok(), "{name} {value}");
        }
    }

    #[test]
    fn numbers_without_a_size_are_refused_with_their_place() {
        for (element, message) in [
            ("<vType id='a' speedFactor='nan'/>", "<vType id=\"a\">: speedFactor=\"nan\": must be a finite number"),
            ("<vType id='a' jmSigmaMinor='NaN(1)'/>", "jmSigmaMinor=\"NaN(1)\": must be a finite number"),
            ("<vType id='a' tau='-infinity'/>", "tau=\"-infinity\": must be a finite number"),
            ("<vType id='a' minGap='0x1p900'/>", "minGap=\"0x1p900\": must be from -"),
            ("<vType id='a' speedFactor='normc(1,nan,0,2)'/>", "must be a finite number"),
            ("<vType id='a' speedFactor='normc(1,0.1,nan,2)'/>", "must be a finite number"),
            ("<vType id='a' speedFactor='normc(1,0.1,1,1)'/>", "draws a number until it is from 1 to 1"),
            ("<vType id='a' speedFactor='normc(1,0.1,30)'/>", "draws a number until it is from 30 to inf"),
            ("<vTypeDistribution id='d'><vType id='a' decel='1e308'/></vTypeDistribution>", "decel=\"1e308\": must be"),
            ("<vType id='a'><carFollowing-IDM delta='nan'/></vType>", "<carFollowing-IDM>: delta=\"nan\""),
            (
                "<vType id='a'><param key='lcStrategic' value='nan'/></vType>",
                "<param key=\"lcStrategic\">: value=\"nan\"",
            ),
            (
                "<vehicle id='a' depart='0'><param key='device.rerouting.period' value='inf'/></vehicle>",
                "value=\"inf\"",
            ),
            ("<flow id='a' period='exp(nan)'/>", "must be a finite number"),
            ("<flow id='a' vehsPerHour='1e300'/>", "must be from"),
            ("<trip id='a' depart='00:nan:00'/>", "must be a finite number"),
            ("<routeDistribution id='a' probabilities='0.5 nan'/>", "must be a finite number"),
            ("<route id='a' edges='b' repeat='300000000'/>", "must be from"),
        ] {
            assert!(error(element).contains(message), "{element}: {}", error(element));
            assert!(error(element).ends_with("; correct it"), "{element}: {}", error(element));
        }
        for (name, value) in [
            ("weights.minor-penalty", "nan"),
            ("scale", "nan"),
            ("scale", "1e9"),
            ("default.speeddev", "1e308"),
            ("device.rerouting.adaptation-steps", "2147483647"),
            ("time-to-teleport", "nan"),
        ] {
            assert!(check_option(name, value).is_err(), "{name} {value}");
        }
    }
}
