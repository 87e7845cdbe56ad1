//! Where vehicles of a scenario stop on their way, for local simulators.

use std::collections::HashMap;

use serde::{Deserialize, Serialize};

use super::SumoScenario;
use super::departing::{VEHICLES, each};
use crate::config::sumo_time::seconds;
use crate::network::roads::Roads;
use crate::network::tree::Element;

/// Elements at which vehicles stop, with the attribute of a `<stop>` that names one.
pub(super) const PLACES: [(&str, &str); 5] = [
    ("busStop", "busStop"),
    ("trainStop", "trainStop"),
    ("containerStop", "containerStop"),
    ("chargingStation", "chargingStation"),
    ("parkingArea", "parkingArea"),
];

/// Longest stop. A longer one is for ever, as far as an episode is concerned.
const LONGEST_S: f64 = 86_400.0;

/// A stop on a lane, for as long as it says. A timetable (`until`) means nothing in a local simulator.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub(crate) struct Stop {
    pub(crate) lane: String,
    /// Last position on the lane, in centimetres.
    pub(crate) end_cm: u32,
    pub(crate) duration_s: u32,
    /// Whether the lane stays free meanwhile.
    pub(crate) parks: bool,
}

/// Stops by vehicle or flow.
#[derive(Clone, Debug, Default)]
pub(crate) struct Stops(HashMap<String, Vec<Stop>>);

impl Stops {
    /// Returns the stops of a vehicle. That of a flow has the flow's name, a dot and a number.
    pub(crate) fn of(&self, vehicle: &str) -> &[Stop] {
        let of_flow = || vehicle.rsplit_once('.').and_then(|(flow, _)| self.0.get(flow));
        self.0.get(vehicle).or_else(of_flow).map_or(&[], Vec::as_slice)
    }
}

impl SumoScenario {
    pub(crate) fn stops(&self, roads: &Roads) -> Stops {
        let mut places: HashMap<&str, &Element> = HashMap::new();
        let roots = || [self.net()].into_iter().chain(self.additional()).chain(self.routes());
        for element in roots().flat_map(|root| &root.children) {
            if let Some(id) = element.attribute("id").filter(|_| PLACES.iter().any(|(name, _)| element.name == *name)) {
                places.insert(id, element);
            }
        }
        let stop = |stop: &Element| -> Option<Stop> {
            let named = PLACES.iter().find_map(|(_, key)| places.get(stop.attribute(key)?).copied());
            let attribute = |key: &str| stop.attribute(key).or_else(|| named?.attribute(key));
            let lane = attribute("lane")?;
            let length_m = roads.lane(roads.lane_named(lane)?).length_m;
            let end_m = attribute("endPos").and_then(|text| text.parse::<f64>().ok()).unwrap_or(length_m);
            let end_m = if end_m < 0.0 { length_m + end_m } else { end_m };
            let is_area = stop.attribute("parkingArea").is_some();
            Some(Stop {
                lane: lane.to_owned(),
                end_cm: (end_m.clamp(0.1, length_m) * 100.0) as u32,
                duration_s: seconds(stop.attribute("duration")?).ok()?.clamp(0.0, LONGEST_S) as u32,
                parks: is_area || stop.attribute("parking").is_some_and(|parking| ["true", "1"].contains(&parking)),
            })
        };
        let of = |element: &Element| -> Vec<Stop> { element.all("stop").filter_map(stop).collect() };
        let mut of_routes: HashMap<&str, Vec<Stop>> = HashMap::new();
        let mut all = HashMap::new();
        for departing in self.additional().chain(self.routes()).flat_map(each) {
            let element = departing.element;
            let Some(id) = element.attribute("id") else { continue };
            if element.name == "route" {
                of_routes.insert(id, of(element));
            } else if VEHICLES.contains(&&*element.name) {
                let own = element.all("route").flat_map(of);
                let named =
                    element.attribute("route").and_then(|route| of_routes.get(route)).cloned().unwrap_or_default();
                let stops: Vec<Stop> = named.into_iter().chain(own).chain(of(element)).collect();
                if !stops.is_empty() {
                    all.insert(id.to_owned(), stops);
                }
            }
        }
        Stops(all)
    }
}
