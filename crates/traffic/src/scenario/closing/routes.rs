//! What becomes of each vehicle, route and stop of a scenario when edges are closed.

use std::collections::{BTreeSet, HashMap};
use std::rc::Rc;

use super::super::departing::{VEHICLES, each};
use super::super::own_types::USUAL_CLASS;
use super::super::stops::PLACES;
use super::super::ways::{VehicleClasses, Ways};
use super::Detours;
use crate::network::roads::{EdgeNo, Roads};
use crate::network::tree::Element;

/// What becomes of a route.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Fate {
    Same,
    Detour,
    NoWay,
}

/// The routes of a scenario, as they are changed one after another.
pub(super) struct Closing<'a> {
    pub(super) roads: &'a Roads,
    pub(super) ways: Ways<'a>,
    /// Ways on the open net.
    pub(super) open: Ways<'a>,
    pub(super) classes: HashMap<String, VehicleClasses>,
    /// Names of the routes of each distribution.
    pub(super) members: HashMap<String, Vec<String>>,
    /// Classes of the vehicles that have each route by its name, and the edges of their own stops.
    pub(super) users: HashMap<String, VehicleClasses>,
    pub(super) stops_by: HashMap<String, BTreeSet<EdgeNo>>,
    pub(super) places: HashMap<(String, String), String>,
    /// What became of routes with a name.
    pub(super) fates: HashMap<String, Fate>,
    pub(super) window_s: (f64, f64),
    pub(super) detours: Detours,
}

impl Closing<'_> {
    fn classes_of(&self, driver: &Element) -> VehicleClasses {
        let known = driver.attribute("type").and_then(|kind| self.classes.get(kind)).filter(|all| !all.is_empty());
        known.cloned().unwrap_or_else(|| VehicleClasses::from([USUAL_CLASS.to_owned()]))
    }

    /// Notes who has the routes with a name.
    pub(super) fn note_users(&mut self, root: &Element) {
        for departing in each(root) {
            let element = departing.element;
            if element.name == "routeDistribution" {
                let inner = element.all("route").flat_map(|route| [route.attribute("refId"), route.attribute("id")]);
                let all = inner.flatten().chain(element.words("routes")).map(str::to_owned).collect();
                self.members.insert(element.id().to_owned(), all);
            }
            let Some(route) = element.attribute("route").filter(|_| VEHICLES.contains(&&*element.name)) else {
                continue;
            };
            let (classes, stops) = (self.classes_of(element), self.edges_of_stops(element));
            let within = self.members.get(route).into_iter().flatten().map(String::as_str);
            for route in [route].into_iter().chain(within) {
                self.users.entry(route.to_owned()).or_default().extend(classes.iter().cloned());
                self.stops_by.entry(route.to_owned()).or_default().extend(&stops);
            }
        }
    }

    fn edge_of_stop(&self, stop: &Element) -> Option<EdgeNo> {
        let named = PLACES.iter().find_map(|(name, key)| {
            self.places.get(&((*name).to_owned(), stop.attribute(key)?.to_owned())).map(String::as_str)
        });
        let lane = stop.attribute("lane").or(named).and_then(|lane| self.roads.lane_named(lane));
        let of_lane = lane.map(|lane| self.roads.lane(lane).edge);
        of_lane.or_else(|| self.roads.edge_named(stop.attribute("edge")?))
    }

    fn edges_of_stops(&self, element: &Element) -> BTreeSet<EdgeNo> {
        element.all("stop").filter_map(|stop| self.edge_of_stop(stop)).collect()
    }

    pub(super) fn file(&mut self, root: &Element) -> Element {
        let drivers: HashMap<*const Element, f64> = each(root)
            .filter(|departing| VEHICLES.contains(&&*departing.element.name))
            .map(|departing| {
                let first_s = departing.first_s(self.window_s.0).unwrap_or(self.window_s.0);
                (std::ptr::from_ref(departing.element), departing.number(first_s, self.window_s))
            })
            .collect();
        self.children(root, &drivers)
    }

    /// Returns an element with those of its children that stay. `drivers`: numbers of vehicles by element.
    fn children(&mut self, parent: &Element, drivers: &HashMap<*const Element, f64>) -> Element {
        let mut kept = Element { children: Vec::new(), ..parent.clone() };
        for child in &parent.children {
            let mut changed = child.clone();
            let stays = match &*child.name {
                "interval" => {
                    changed = self.children(child, drivers);
                    true
                }
                "taz" => {
                    self.zone(&mut changed);
                    true
                }
                "route" => {
                    let classes = self.users.get(child.id()).cloned();
                    let stops = self.stops_by.get(child.id()).cloned().unwrap_or_default();
                    let fate = self.route(&mut changed, &classes.unwrap_or_default(), &stops);
                    self.fates.insert(child.id().to_owned(), fate);
                    fate != Fate::NoWay
                }
                "routeDistribution" => {
                    let classes = self.users.get(child.id()).cloned().unwrap_or_default();
                    let stops = self.stops_by.get(child.id()).cloned().unwrap_or_default();
                    let fate = self.distribution(&mut changed, &classes, &stops);
                    self.fates.insert(child.id().to_owned(), fate);
                    fate != Fate::NoWay
                }
                _ => match drivers.get(&std::ptr::from_ref(child)) {
                    Some(&count) => self.driver(&mut changed, count),
                    None => true,
                },
            };
            if stays {
                kept.children.push(changed);
            }
        }
        kept
    }

    fn zone(&self, zone: &mut Element) {
        let is_open = |edge: &str| self.roads.edge_named(edge).is_none_or(|edge| !self.ways.is_closed(edge));
        for (_, edges) in zone.attributes.iter_mut().filter(|(key, _)| key == "edges") {
            *edges = edges.split_whitespace().filter(|edge| is_open(edge)).collect::<Vec<_>>().join(" ");
        }
        let is_end = |name: &str| ["tazSource", "tazSink"].contains(&name);
        zone.children.retain(|child| !is_end(&child.name) || is_open(child.id()));
    }

    /// Changes a vehicle, a trip or a flow. Returns whether it stays.
    fn driver(&mut self, driver: &mut Element, count: f64) -> bool {
        self.detours.vehicles += count;
        let classes = self.classes_of(driver);
        let stops = self.edges_of_stops(driver);
        let named = driver.attribute("route").and_then(|route| self.fates.get(route)).copied();
        let fate = match (named, driver.children.iter_mut().find(|child| child.name.starts_with("route"))) {
            (Some(fate), _) => fate,
            (None, Some(inner)) if inner.name == "route" => self.route(inner, &classes, &stops),
            (None, Some(inner)) => self.distribution(inner, &classes, &stops),
            (None, None) => {
                let fate = self.trip(driver, &classes);
                let is_trip = driver.attribute("route").is_none() && fate != Fate::NoWay;
                self.detours.trips += if is_trip { count } else { 0.0 };
                fate
            }
        };
        self.leave_out_stops(driver);
        match fate {
            Fate::Same => {}
            Fate::Detour => {
                self.detours.rerouted += count;
                // They count edges of the route that it had.
                driver.attributes.retain(|(key, _)| key != "departEdge" && key != "arrivalEdge");
            }
            Fate::NoWay => self.detours.without_way += count,
        }
        fate != Fate::NoWay
    }

    /// Returns whether a trip has a way. SUMO judges a trip that had none on the open net.
    fn trip(&mut self, trip: &mut Element, classes: &VehicleClasses) -> Fate {
        let (roads, ways) = (self.roads, &mut self.ways);
        for (_, via) in trip.attributes.iter_mut().filter(|(key, _)| key == "via") {
            let is_open = |edge: &&str| roads.edge_named(edge).is_none_or(|edge| !ways.is_closed(edge));
            *via = via.split_whitespace().filter(is_open).collect::<Vec<_>>().join(" ");
        }
        let [from, to] = ["from", "to"].map(|key| trip.attribute(key).map(str::to_owned));
        let (Some(from), Some(to)) = (from, to) else { return Fate::Same };
        let via: Vec<&str> = trip.words("via").collect();
        let edges = [&*from].into_iter().chain(via).chain([&*to]).map(|edge| roads.edge_named(edge));
        let Some(edges) = edges.collect::<Option<Vec<EdgeNo>>>() else { return Fate::Same };
        let reaches = |ways: &mut Ways<'_>| edges.windows(2).all(|pair| ways.reaches(pair[0], pair[1], classes));
        if reaches(ways) || !reaches(&mut self.open) { Fate::Same } else { Fate::NoWay }
    }

    /// Changes a route. `stops`: edges of its vehicles' own stops.
    fn route(&mut self, route: &mut Element, classes: &VehicleClasses, stops: &BTreeSet<EdgeNo>) -> Fate {
        if let Some(known) = route.attribute("refId") {
            return self.fates.get(known).copied().unwrap_or(Fate::Same);
        }
        let stops: BTreeSet<EdgeNo> = &self.edges_of_stops(route) | stops;
        self.leave_out_stops(route);
        let edges = route.words("edges").map(|edge| self.roads.edge_named(edge)).collect::<Option<Vec<EdgeNo>>>();
        // SUMO reports unknown edges.
        let Some(edges) = edges.filter(|edges| edges.iter().any(|&edge| self.ways.is_closed(edge))) else {
            return Fate::Same;
        };
        let Some(way) = self.detour(&edges, &stops, classes) else { return Fate::NoWay };
        let ids: Vec<&str> = way.iter().map(|&edge| &*self.roads.edge(edge).id).collect();
        route.attributes.iter_mut().filter(|(key, _)| key == "edges").for_each(|(_, edges)| *edges = ids.join(" "));
        Fate::Detour
    }

    /// Returns the way of a route around the closed edges, by its stops. `None`: there is none.
    fn detour(&mut self, edges: &[EdgeNo], stops: &BTreeSet<EdgeNo>, classes: &VehicleClasses) -> Option<Vec<EdgeNo>> {
        let &[first, ref middle @ .., last] = edges else {
            // Its only edge is closed.
            return None;
        };
        // A route that no vehicle has is for cars.
        let car = VehicleClasses::from([USUAL_CLASS.to_owned()]);
        let classes = if classes.is_empty() { &car } else { classes };
        let between = middle.iter().filter(|&&edge| stops.contains(&edge) && !self.ways.is_closed(edge));
        let places: Vec<EdgeNo> = [first].into_iter().chain(between.copied()).chain([last]).collect();
        let mut way = vec![first];
        for pair in places.windows(2) {
            let piece: Rc<Vec<EdgeNo>> = self.ways.fastest(pair[0], pair[1], classes)?;
            way.extend(&piece[1..]);
        }
        Some(way)
    }

    /// Changes the routes of a distribution. Those without a way are left out, and their cars take the others.
    fn distribution(&mut self, element: &mut Element, classes: &VehicleClasses, stops: &BTreeSet<EdgeNo>) -> Fate {
        let mut fates = Vec::new();
        let mut kept = Vec::new();
        for mut route in std::mem::take(&mut element.children) {
            if route.name != "route" {
                kept.push(route);
                continue;
            }
            let fate = self.route(&mut route, classes, stops);
            fates.push(fate);
            if fate != Fate::NoWay {
                kept.push(route);
            }
        }
        element.children = kept;
        let named: Vec<String> = element.words("routes").map(str::to_owned).collect();
        let of_named: Vec<Fate> =
            named.iter().map(|route| self.fates.get(route).copied().unwrap_or(Fate::Same)).collect();
        for (_, value) in element.attributes.iter_mut().filter(|(key, _)| ["routes", "probabilities"].contains(&&**key))
        {
            let pairs = value.split_whitespace().zip(&of_named).filter(|(_, fate)| **fate != Fate::NoWay);
            *value = pairs.map(|(word, _)| word).collect::<Vec<_>>().join(" ");
        }
        fates.extend(of_named);
        if fates.iter().all(|fate| *fate == Fate::Same) {
            Fate::Same
        } else if fates.iter().all(|fate| *fate == Fate::NoWay) {
            Fate::NoWay
        } else {
            Fate::Detour
        }
    }

    fn leave_out_stops(&mut self, element: &mut Element) {
        let is_open = |stop: &Element| self.edge_of_stop(stop).is_none_or(|edge| !self.ways.is_closed(edge));
        let before = element.children.len();
        let open: Vec<bool> = element.children.iter().map(|child| child.name != "stop" || is_open(child)).collect();
        let mut open = open.into_iter();
        element.children.retain(|_| open.next() == Some(true));
        self.detours.stops_left_out += before - element.children.len();
    }
}
