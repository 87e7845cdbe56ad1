//! Trips, vehicles and flows.

use anyhow::{Result, ensure};

use super::super::place::Place;
use super::super::streets::Street;
use super::Demand;
use super::types::refuse_devices;

/// Limits of the numbers of a flow, beyond which they are absurd.
const FLOW: [(&str, f64, f64); 5] = [
    ("number", 0.0, 1e7),
    ("period", 0.01, 1e9),
    ("vehsPerHour", 0.0, 1e6),
    ("perHour", 0.0, 1e6),
    ("probability", 0.0, 1.0),
];

/// Attributes that put persons or containers into a vehicle.
const LOADS: [&str; 2] = ["personNumber", "containerNumber"];

/// Speeds of departure with which a car waits until there is room for it, and is slowed down to fit. Cars with all others
/// are removed if the road does not let them drive so fast. How many that are depends on the lights.
/// Measured on SUMO 1.15 with 500 trips: `desired`, `speedLimit`, `last`, `avg` and 5 m/s lose cars.
const PATIENT: [&str; 2] = ["max", "random"];

/// Attributes that name the beginning of a trip, and its end: an edge, a zone or a junction. Each may be of another kind.
const FROM: [&str; 3] = ["from", "fromTaz", "fromJunction"];
const TO: [&str; 3] = ["to", "toTaz", "toJunction"];

/// Smallest and largest rate of a random period, in vehicles per second.
const RATE: [f64; 2] = [1e-9, 100.0];

/// Returns the mean of a random period such as exp(0.1), in seconds. SUMO's number is the rate, in vehicles per second.
fn mean_period(place: Place<'_>, key: &str) -> Result<f64> {
    let text = place.element.attribute(key).unwrap_or_default();
    let rate = text.strip_prefix("exp(").and_then(|rest| rest.trim_end().strip_suffix(')'));
    let rate = rate.and_then(|rate| rate.trim().parse::<f64>().ok()).filter(|rate| (RATE[0]..=RATE[1]).contains(rate));
    let wrong = || {
        let [least, most] = RATE;
        place.fault_in(key, format!("must be exp(RATE), with a rate from {least} to {most} vehicles per second"))
    };
    Ok(1.0 / rate.ok_or_else(wrong)?)
}

impl<'a> Demand<'a> {
    /// Adds a trip, a vehicle or a flow. Returns the second of its first departure.
    pub(super) fn add_driver(&mut self, place: Place<'a>) -> Result<f64> {
        let id = place.needed("id")?;
        ensure!(
            self.drivers.insert(id),
            place.fault("a vehicle, trip or flow of this id is defined twice; rename one of them")
        );
        for key in LOADS {
            ensure!(
                place.element.attribute(key).is_none_or(|number| number == "0"),
                place.fault_in(key, "this program does not simulate persons and containers; remove it")
            );
        }
        let given = |key: &str| place.element.attribute(key);
        ensure!(
            given("departEdge").is_none_or(|edge| edge == "0"),
            place.fault_in("departEdge", "this program lets cars begin on the first edge of their route; remove it")
        );
        refuse_devices(place)?;
        let class = self.class_of(place)?;
        let (departs_s, vehicles) =
            if place.element.name == "flow" { self.flow(place)? } else { self.departure(place)? };
        let drives = vehicles > 0.0;
        if drives {
            self.expected += vehicles;
            if given("departSpeed").is_some_and(|speed| !PATIENT.contains(&speed) && speed.parse() != Ok(0.0)) {
                self.impatient.add(place);
            }
        } else {
            *self.outside.entry(place.file.to_owned()).or_default() += 1;
        }
        let inner = place.element.children.iter().find(|child| child.name != "param");
        let routes = match (place.element.attribute("route"), inner) {
            _ if place.element.name == "trip" => None,
            (Some(id), _) => Some(self.known_routes(place, "route", id)?),
            (None, Some(inner)) => Some(self.routes_in(place.within(inner))?),
            (None, None) => None,
        };
        if drives {
            self.add_departure(place, routes.as_deref())?;
        }
        let way = match routes {
            Some(routes) if drives => routes.iter().try_for_each(|route| self.check_connected(place, route, class)),
            Some(_) => Ok(()),
            None => {
                let stations = self.stations(place)?;
                if drives { self.check_reachable(place, &stations, class) } else { Ok(()) }
            }
        };
        if let Err(fault) = way {
            if !self.lenient {
                return Err(fault);
            }
            self.lost.add(place);
        }
        Ok(departs_s)
    }

    /// Adds the edges on which a vehicle may depart. `routes`: those that it may take; a trip has none.
    fn add_departure(&mut self, place: Place<'a>, routes: Option<&[Vec<Street>]>) -> Result<()> {
        let given = |key: &str| place.element.attribute(key);
        let streets: Vec<Street> = match (routes, given("from"), given("fromTaz"), given("fromJunction")) {
            (Some(routes), ..) => routes.iter().filter_map(|route| route.first().copied()).collect(),
            (None, Some(_), ..) => vec![self.street(place, "from")?],
            (None, None, Some(zone), _) => self.zones.get(zone).cloned().unwrap_or_default(),
            (None, None, None, junction) => {
                self.departures.junctions.extend(junction.map(str::to_owned));
                Vec::new()
            }
        };
        let names = streets.into_iter().map(|street| self.streets.name(street).to_owned());
        self.departures.edges.extend(names);
        Ok(())
    }

    /// Returns when a vehicle or trip departs, and 1 if this is within an episode.
    fn departure(&self, place: Place<'a>) -> Result<(f64, f64)> {
        let text = place.needed("depart")?;
        ensure!(
            !["triggered", "containerTriggered", "split"].contains(&text),
            place.fault_in("depart", "this program does not simulate persons and trains; set a second")
        );
        let departs_s = place.time("depart")?.expect("it is there");
        let (begin, end) = self.window_s;
        Ok((departs_s, if (begin..end).contains(&departs_s) { 1.0 } else { 0.0 }))
    }

    /// Returns when a flow begins, and the expected number of its vehicles within an episode.
    fn flow(&self, place: Place<'a>) -> Result<(f64, f64)> {
        let (begin, end) = self.window_s;
        let begins = place.time("begin")?.unwrap_or(begin);
        let ends = place.time("end")?.unwrap_or(end);
        ensure!(ends >= begins, place.fault_in("end", format!("is before its begin, {begins} s; correct one of them")));
        let mut numbers = Vec::new();
        for (key, least, most) in FLOW {
            let is_random =
                key == "period" && place.element.attribute(key).is_some_and(|text| text.starts_with("exp("));
            numbers.push(if is_random { Some(mean_period(place, key)?) } else { place.number(key, least, most)? });
        }
        let [number, period, per_hour, per_hour_too, probability] = numbers[..] else {
            unreachable!("as many as keys")
        };
        let shared = (ends.min(end) - begins.max(begin)).max(0.0);
        let rate =
            per_hour.or(per_hour_too).map(|rate| rate / 3600.0).or(period.map(|period| 1.0 / period)).or(probability);
        let vehicles = match (number, rate) {
            (None, None) => {
                return Err(place.fault("has none of number, period, vehsPerHour, perHour and probability; add one"));
            }
            (Some(number), None) if ends > begins => number * shared / (ends - begins),
            (Some(number), None) => {
                if (begin..end).contains(&begins) {
                    number
                } else {
                    0.0
                }
            }
            (number, Some(rate)) => (rate * shared).min(number.unwrap_or(f64::INFINITY)),
        };
        Ok((begins, vehicles))
    }

    /// Returns the edges that a trip must come by, from the first to the last. From or to a zone there are none.
    fn stations(&self, place: Place<'a>) -> Result<Vec<Street>> {
        let given = |keys: [&str; 3]| keys.iter().position(|key| place.element.attribute(key).is_some());
        let (from, to) = (given(FROM), given(TO));
        let Some(either) = from.or(to) else {
            let needs = if place.element.name == "vehicle" { "a route" } else { "a route, or from and to" };
            return Err(place.fault(format!("has no way to go: it needs {needs}; add it or remove the element")));
        };
        if place.element.name == "vehicle" {
            return Err(place.fault("has no route; write <trip> where SUMO should find the way"));
        }
        // What is missing is asked for in the way in which the other end is named.
        let [from, to] = [FROM[from.unwrap_or(either)], TO[to.unwrap_or(either)]];
        let ends = [self.end(place, from)?, self.end(place, to)?];
        let [Some(begin), Some(end)] = ends else { return Ok(Vec::new()) };
        let mut stations = vec![begin];
        if place.element.attribute("via").is_some_and(|via| !via.is_empty()) {
            stations.extend(self.streets_in(place, "via")?);
        }
        stations.push(end);
        Ok(stations)
    }

    /// Returns the edge at an end of a trip; `None` if it is a zone or a junction, which must be known.
    fn end(&self, place: Place<'a>, key: &str) -> Result<Option<Street>> {
        if key.ends_with("Taz") {
            let known = self.zones.contains_key(place.needed(key)?);
            ensure!(known, place.fault_in(key, "no <taz> of this id is defined before it"));
            return Ok(None);
        }
        if key.ends_with("Junction") {
            let known = self.streets.has_junction(place.needed(key)?);
            ensure!(known, place.fault_in(key, "the net has no such junction"));
            ensure!(
                self.has_zones_of_junctions,
                place.fault_in(key, "SUMO needs <junction-taz value=\"true\"/> in the .sumocfg for it; add it")
            );
            return Ok(None);
        }
        self.street(place, key).map(Some)
    }

    fn street(&self, place: Place<'a>, key: &str) -> Result<Street> {
        let unknown = || place.fault_in(key, "the net has no such edge; correct it or remove the element");
        self.streets.find(place.needed(key)?).ok_or_else(unknown)
    }
}
