//! When vehicles and persons depart: once, or as a flow.

use crate::config::sumo_time::seconds;
use crate::network::tree::Element;

/// How long a flow goes on that has neither an end nor a number. SUMO lets it go on for ever.
const ENDLESS_FLOW_S: f64 = 3600.0;

const ONES: [&str; 4] = ["vehicle", "trip", "person", "container"];
pub(super) const FLOWS: [&str; 3] = ["flow", "personFlow", "containerFlow"];
pub(super) const VEHICLES: [&str; 3] = ["vehicle", "trip", "flow"];

/// An element of a file. Those that depart know when.
#[derive(Clone, Copy, Debug)]
pub(super) struct Departing<'a> {
    pub(super) element: &'a Element,
    /// The interval around it, which gives flows their begin and end.
    within: Option<&'a Element>,
}

/// Returns the elements of a file, those in intervals among them.
pub(super) fn each(root: &Element) -> impl Iterator<Item = Departing<'_>> {
    root.children.iter().flat_map(|child| {
        let (elements, within) = match &*child.name {
            "interval" => (&child.children[..], Some(child)),
            _ => (std::slice::from_ref(child), None),
        };
        elements.iter().map(move |element| Departing { element, within })
    })
}

impl Departing<'_> {
    pub(super) fn departs(&self) -> bool {
        ONES.contains(&&*self.element.name) || self.is_flow()
    }

    fn is_flow(&self) -> bool {
        FLOWS.contains(&&*self.element.name)
    }

    /// Returns whether random numbers decide when, or whether, vehicles of a flow depart.
    pub(super) fn is_random(&self) -> bool {
        let is_drawn = |period: &str| period.contains('(');
        self.is_flow()
            && (self.element.attribute("probability").is_some()
                || self.element.attribute("period").is_some_and(is_drawn))
    }

    fn number_of(&self, key: &str) -> Option<f64> {
        self.element.attribute(key)?.trim().parse().ok()
    }

    /// Returns the second of a key of a flow, or of the interval around it. `None`: neither has one that can be read.
    fn second(&self, key: &str) -> Option<f64> {
        seconds(self.element.attribute(key).or_else(|| self.within?.attribute(key))?).ok()
    }

    /// Returns when the first one departs. `None`: when something else happens, or SUMO cannot read it. `begin_s`: that of the
    /// scenario.
    pub(super) fn first_s(&self, begin_s: f64) -> Option<f64> {
        if self.is_flow() {
            let is_given = |element: &Element| element.attribute("begin").is_some();
            let is_given = is_given(self.element) || self.within.is_some_and(is_given);
            return if is_given { self.second("begin") } else { Some(begin_s) };
        }
        seconds(self.element.attribute("depart")?).ok()
    }

    /// Returns when the last one departs. `None`: when something else happens.
    pub(super) fn last_s(&self, begin_s: f64) -> Option<f64> {
        let first_s = self.first_s(begin_s);
        if !self.is_flow() {
            return first_s;
        }
        let begins_s = first_s.unwrap_or(begin_s);
        let of_number = || Some(begins_s + self.number_of("number")? / vehicles_per_s(self.element)?);
        let last_s = self.second("end").or_else(of_number).unwrap_or(begins_s + ENDLESS_FLOW_S);
        last_s.is_finite().then_some(last_s)
    }

    /// Returns how many depart in an episode, from its begin to its end: the expected number of a flow. What cannot be read
    /// counts as one, because SUMO will say it. `first_s`: when the first one departs.
    pub(super) fn number(&self, first_s: f64, (begin, end): (f64, f64)) -> f64 {
        if !self.is_flow() {
            return f64::from((begin..end).contains(&first_s));
        }
        let ends_s = self.second("end").unwrap_or(end);
        let shared_s = (ends_s.min(end) - first_s.max(begin)).max(0.0);
        match (self.number_of("number"), vehicles_per_s(self.element).or_else(|| self.number_of("probability"))) {
            (None, None) => 1.0,
            (Some(number), None) if ends_s > first_s => number * shared_s / (ends_s - first_s),
            (Some(number), None) => number * f64::from((begin..end).contains(&first_s)),
            (number, Some(rate)) => (rate * shared_s).min(number.unwrap_or(f64::INFINITY)),
        }
    }
}

/// Returns the rate of a flow that names one, or a period.
fn vehicles_per_s(flow: &Element) -> Option<f64> {
    let number = |key: &str| flow.attribute(key)?.trim().parse::<f64>().ok();
    let per_hour = ["vehsPerHour", "perHour", "personsPerHour", "containersPerHour"].into_iter().find_map(number);
    // The number of a random period is its rate.
    let random = || flow.attribute("period")?.trim().strip_prefix("exp(")?.strip_suffix(')')?.trim().parse().ok();
    per_hour.map(|rate| rate / 3600.0).or_else(|| number("period").map(|period| 1.0 / period)).or_else(random)
}
