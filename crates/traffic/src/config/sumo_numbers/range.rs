//! How large a number may be.

use super::{Kind, OPTION};

pub(super) const NOT_FINITE: &str = "must be a finite number";

/// Largest size of a number without a unit or with one of metres, and of a time. Every sum of some of them is exact enough, and
/// SUMO's times end at 9.2e15 s.
const LARGEST: f64 = 1e12;
const LONGEST_S: f64 = 1e15;

/// Narrower ranges: the element or [`OPTION`], the name, and the range, each with its reason. `*` stands for any element.
const RANGES: &[(&str, &str, f64, f64)] = &[
    // SUMO makes this number of copies of each vehicle at once. The number of all vehicles is limited as well.
    (OPTION, "scale", -1e5, 1e5),
    ("vType", "scale", -1e5, 1e5),
    // SUMO keeps this number of past speeds of each edge.
    (OPTION, "device.rerouting.adaptation-steps", -1e6, 1e5),
    // SUMO makes a shape with this number of points for each way across a walking area.
    (OPTION, "pedestrian.striping.walkingarea-detail", -1e6, 1e4),
    // SUMO draws a factor until it is from 0.2 to 2: with a large deviation it never is.
    (OPTION, "default.speeddev", -1e3, 1e3),
    ("*", "speedDev", -1e3, 1e3),
    // SUMO counts the steps of a driver until its next action in 32 bits.
    (OPTION, "default.action-step-length", -1e6, 1e5),
    ("vType", "actionStepLength", -1e6, 1e5),
    // With 1e5 s and more an assertion of SUMO 1.15 breaks at the first start; with 5e4 s it plays.
    ("vType", "startupDelay", -1e6, 5e4),
    // SUMO makes each of these places.
    ("parkingArea", "roadsideCapacity", -1e6, 1e5),
    // SUMO writes a route down as often as it is repeated. How long it becomes is limited as well.
    ("route", "repeat", -1e6, 1e7),
];

/// Attributes that may be infinite: SUMO then takes the limit of the road.
const UNLIMITED: [&str; 2] = ["maxSpeed", "desiredMaxSpeed"];

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    least: f64,
    most: f64,
    may_be_infinite: bool,
}

impl Range {
    pub(super) fn of(element: &str, name: &str, kind: Kind) -> Range {
        let narrow = RANGES.iter().find(|(of, known, ..)| [element, "*"].contains(of) && *known == name);
        let largest = match kind {
            // SUMO itself says when it is larger.
            Kind::Int => i32::MAX.into(),
            Kind::Float => LARGEST,
            Kind::Time => LONGEST_S,
        };
        let (least, most) = narrow.map_or((-largest, largest), |&(.., least, most)| (least, most));
        Range { least, most, may_be_infinite: element != OPTION && UNLIMITED.contains(&name) }
    }

    /// Returns the range of an argument of a distribution.
    pub(super) fn of_argument() -> Range {
        Range { least: -LARGEST, most: LARGEST, may_be_infinite: false }
    }

    /// Returns what is wrong with a number, if anything.
    pub(super) fn why_not(self, value: f64) -> Option<String> {
        let Range { least, most, may_be_infinite } = self;
        match value {
            value if value == f64::INFINITY && may_be_infinite => None,
            value if !value.is_finite() => Some(NOT_FINITE.to_owned()),
            value if (least..=most).contains(&value) => None,
            _ => Some(format!("must be from {least} to {most}")),
        }
    }
}
