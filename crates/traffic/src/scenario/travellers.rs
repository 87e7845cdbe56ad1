//! Who travels in a scenario: the classes of its vehicles, whether there are persons, and whether SUMO may remove somebody.

use std::collections::{BTreeMap, BTreeSet};

use super::SumoScenario;
use super::departing::{VEHICLES, each};
use super::own_types::{OWN_TYPES, USUAL_CLASS, USUAL_TYPE};
use crate::config::sumo_time::seconds;
use crate::network::tree::Element;

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Travellers {
    /// Class of each vehicle type.
    pub(crate) class_of: BTreeMap<String, String>,
    /// Classes of the vehicles, in their order.
    pub(crate) classes: Vec<String>,
    pub(crate) has_persons: bool,
    /// Seconds that a vehicle may wait to enter, before SUMO removes it. `None`: SUMO removes nobody for that, or counts them
    /// together with others.
    pub(crate) removed_after_s: Option<f64>,
}

impl SumoScenario {
    pub(crate) fn travellers(&self) -> Travellers {
        if let Some(drawn) = &self.drawn {
            return drawn.travellers.clone();
        }
        let mut found = Travellers::default();
        let mut members: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
        let mut used: BTreeSet<&str> = BTreeSet::new();
        found.class_of.extend(OWN_TYPES.map(|(id, class)| (id.to_owned(), class.to_owned())));
        for root in self.additional().chain(self.routes()) {
            for departing in each(root) {
                let element = departing.element;
                match &*element.name {
                    "vType" => found.add_type(element),
                    "vTypeDistribution" => {
                        element.all("vType").for_each(|kind| found.add_type(kind));
                        let inner = element.all("vType").filter_map(|kind| kind.attribute("id"));
                        let named = element.words("vTypes");
                        members.insert(element.id(), inner.chain(named).collect());
                    }
                    name if VEHICLES.contains(&name) => {
                        used.insert(element.attribute("type").unwrap_or(USUAL_TYPE));
                    }
                    name => found.has_persons |= name.starts_with("person"),
                }
            }
        }
        let kinds = used.into_iter().flat_map(|kind| members.get(kind).cloned().unwrap_or_else(|| vec![kind]));
        let classes: BTreeSet<&str> =
            kinds.map(|kind| found.class_of.get(kind).map_or(USUAL_CLASS, String::as_str)).collect();
        found.classes = classes.into_iter().map(str::to_owned).collect();
        let delay_s =
            self.option("max-depart-delay").and_then(|text| seconds(text).ok()).filter(|delay_s| *delay_s >= 0.0);
        // SUMO counts vehicles that it leaves out for another reason together with these.
        let has_others = self.option(super::SCALE).is_some()
            || self.demand != 1.0
            || self.option("ignore-route-errors").is_some()
            || found.has_persons;
        let removed_after_s = delay_s.or(self.departures.some_may_vanish.then_some(0.0));
        found.removed_after_s = removed_after_s.filter(|_| !has_others);
        found
    }
}

impl Travellers {
    /// Returns who travels with either of two route files.
    pub(super) fn and(mut self, other: Travellers) -> Travellers {
        self.class_of.extend(other.class_of);
        let classes: BTreeSet<String> = self.classes.into_iter().chain(other.classes).collect();
        let has_persons = self.has_persons || other.has_persons;
        Travellers {
            class_of: self.class_of,
            classes: classes.into_iter().collect(),
            has_persons,
            removed_after_s: self.removed_after_s.or(other.removed_after_s).filter(|_| !has_persons),
        }
    }

    fn add_type(&mut self, kind: &Element) {
        let class = kind.attribute("vClass").unwrap_or(USUAL_CLASS);
        self.class_of.insert(kind.id().to_owned(), class.to_owned());
    }
}
