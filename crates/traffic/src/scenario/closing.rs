//! Edges that are closed for everything that drives on roads: what SUMO gets instead of the net and of the routes across them.
//!
//! A car with a route across a closed edge gets the fastest one on free roads from its first edge to its last, by its stops.
//! SUMO finds the ways of trips itself, on the net with the closed edges. A car that cannot get to its destination is left
//! out, and counted. So is a stop on a closed edge. Agents, greens and observations are those of the open net.
//!
//! # Why not otherwise
//!
//! **Why not a `<rerouter>` of SUMO?** Versions from 1.15 to 1.28 differ in what they do with a car whose destination it
//! closes: some let it drive through. Here all of them get the same cars, and all controllers do.

use std::collections::{BTreeSet, HashMap};
use std::fmt::{self, Display, Formatter};
use std::rc::Rc;

use anyhow::{Result, anyhow, ensure};

use super::departing::{VEHICLES, each};
use super::stops::PLACES;
use super::ways::{VehicleClasses, Ways};
use crate::network::roads::{EdgeNo, Roads};
use crate::network::tree::Element;
use dials_core::base::counted;
use dials_core::outside::{did_you_mean, excerpt};

/// Classes that do not drive on roads. A lane that they have stays open for them.
const APART: [&str; 9] =
    ["pedestrian", "tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car", "ship"];

const CAR: &str = "passenger";
/// Types that SUMO has by itself for other classes.
const OWN_TYPES: [(&str, &str); 4] = [
    ("DEFAULT_BIKETYPE", "bicycle"),
    ("DEFAULT_RAILTYPE", "rail"),
    ("DEFAULT_TAXITYPE", "taxi"),
    ("DEFAULT_CONTAINERTYPE", "pedestrian"),
];

/// What becomes of the vehicles of an episode if edges are closed. Of flows the expected number counts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Detours {
    /// Vehicles of the files, before `scale` and `demand`.
    pub vehicles: f64,
    /// Those with a route across a closed edge, which have another one.
    pub rerouted: f64,
    /// Those that cannot get to their destination, and are left out.
    pub without_way: f64,
    /// Trips among the rest. They have no route in the files: SUMO finds their ways on the roads that are open.
    pub trips: f64,
    /// Stops on closed edges, which are left out.
    pub stops_left_out: usize,
}

impl Display for Detours {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Detours { vehicles, rerouted, without_way, trips, stops_left_out } = self;
        write!(
            f,
            "of {vehicles:.0} vehicles in the files {rerouted:.0} get another route; {without_way:.0} cannot get to their \
             destination and are left out"
        )?;
        if *trips > 0.0 {
            write!(f, "; {trips:.0} are trips, whose ways SUMO finds on the open roads")?;
        }
        match stops_left_out {
            0 => Ok(()),
            stops => write!(f, "; {} on closed edges left out", counted(*stops, "stop")),
        }
    }
}

/// The files that SUMO gets.
#[derive(Clone, Debug)]
pub(super) struct Closed {
    pub(super) net: Element,
    pub(super) additional: Vec<Element>,
    pub(super) routes: Vec<Element>,
    pub(super) detours: Detours,
}

/// The files of a scenario as they were read.
pub(super) struct Files<'a> {
    pub(super) net: &'a Element,
    pub(super) additional: Vec<&'a Element>,
    pub(super) routes: Vec<&'a Element>,
    /// Begin and end of an episode.
    pub(super) window_s: (f64, f64),
}

/// What becomes of a route.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fate {
    Same,
    Detour,
    NoWay,
}

/// Closes edges, by their ids. An error names the one that the net does not have.
pub(super) fn close(files: &Files<'_>, roads: &Roads, ids: &[String]) -> Result<Closed> {
    let edges = ids.iter().map(|id| edge_called(roads, id)).collect::<Result<BTreeSet<EdgeNo>>>()?;
    let mut closing = Closing {
        roads,
        ways: Ways::new(roads, edges.clone()),
        open: Ways::new(roads, BTreeSet::new()),
        classes: classes_of_types(files),
        members: HashMap::new(),
        users: HashMap::new(),
        stops_by: HashMap::new(),
        places: places(files),
        fates: HashMap::new(),
        window_s: files.window_s,
        detours: Detours::default(),
    };
    let roots = || files.additional.iter().chain(&files.routes).copied();
    roots().for_each(|root| closing.note_users(root));
    let mut change = |roots: &[&Element]| -> Vec<Element> { roots.iter().map(|root| closing.file(root)).collect() };
    let (additional, routes) = (change(&files.additional), change(&files.routes));
    let detours = closing.detours;
    ensure!(
        detours.vehicles == 0.0 || detours.without_way < detours.vehicles,
        "{}: no vehicle can get to its destination any more; close other edges",
        ids.join(",")
    );
    Ok(Closed { net: closed_net(files.net, roads, &edges), additional, routes, detours })
}

/// Returns the road of a net that is called so.
pub(crate) fn edge_called(roads: &Roads, id: &str) -> Result<EdgeNo> {
    let is_road = |edge: &EdgeNo| roads.edge(*edge).ends.is_some();
    roads.edge_named(id).filter(is_road).ok_or_else(|| {
        let near = did_you_mean(id, roads.roads().map(|(_, edge)| &*edge.id));
        anyhow!("the net has no edge `{}`{near}; sumo-gui shows the ids of edges", excerpt(id))
    })
}

fn closed_net(net: &Element, roads: &Roads, closed: &BTreeSet<EdgeNo>) -> Element {
    let mut net = net.clone();
    let is_closed = |edge: &Element| edge.attribute("id").and_then(|id| roads.edge_named(id));
    let edges = net.children.iter_mut().filter(|edge| edge.name == "edge");
    let edges = edges.filter(|edge| is_closed(edge).is_some_and(|edge| closed.contains(&edge)));
    for lane in edges.flat_map(|edge| &mut edge.children) {
        let Some(known) = lane.attribute("id").and_then(|id| roads.lane_named(id)).map(|lane| roads.lane(lane)) else {
            continue;
        };
        if !known.carries_vehicles {
            continue;
        }
        let open: Vec<&str> = APART.into_iter().filter(|class| known.classes.has(class)).collect();
        // Before, a lane that named nobody was for all classes. It does not become a track.
        let is_listed = lane.attribute("allow").is_some_and(|allowed| !allowed.is_empty() && allowed != "all");
        lane.attributes.retain(|(key, _)| key != "allow" && key != "disallow");
        let (key, value) = match is_listed && !open.is_empty() {
            true => ("allow", open.join(" ")),
            false => ("disallow", "all".to_owned()),
        };
        lane.attributes.push((key.to_owned(), value));
    }
    net
}

/// Returns the classes of each type. A distribution has those of all its types.
fn classes_of_types(files: &Files<'_>) -> HashMap<String, VehicleClasses> {
    let own = OWN_TYPES.map(|(id, class)| (id.to_owned(), VehicleClasses::from([class.to_owned()])));
    let mut classes = HashMap::from(own);
    for element in files.additional.iter().chain(&files.routes).flat_map(|root| &root.children) {
        let types: Vec<&Element> = match &*element.name {
            "vType" => vec![element],
            "vTypeDistribution" => element.all("vType").collect(),
            _ => continue,
        };
        for kind in &types {
            let class = kind.attribute("vClass").unwrap_or(CAR).to_owned();
            classes.insert(id(kind).to_owned(), VehicleClasses::from([class]));
        }
        if element.name == "vTypeDistribution" {
            let inner = types.iter().map(|kind| id(kind)).chain(words(element, "vTypes"));
            let all = inner.filter_map(|kind| classes.get(kind)).flatten().cloned().collect();
            classes.insert(id(element).to_owned(), all);
        }
    }
    classes
}

/// Returns the edges of places where vehicles stop, by kind and id.
fn places(files: &Files<'_>) -> HashMap<(String, String), String> {
    let roots = [files.net].into_iter().chain(files.additional.iter().copied()).chain(files.routes.iter().copied());
    let places =
        roots.flat_map(|root| &root.children).filter(|place| PLACES.iter().any(|(name, _)| place.name == *name));
    places
        .filter_map(|place| Some(((place.name.clone(), id(place).to_owned()), place.attribute("lane")?.to_owned())))
        .collect()
}

struct Closing<'a> {
    roads: &'a Roads,
    ways: Ways<'a>,
    /// Ways on the open net.
    open: Ways<'a>,
    classes: HashMap<String, VehicleClasses>,
    /// Names of the routes of each distribution.
    members: HashMap<String, Vec<String>>,
    /// Classes of the vehicles that have each route by its name, and the edges of their own stops.
    users: HashMap<String, VehicleClasses>,
    stops_by: HashMap<String, BTreeSet<EdgeNo>>,
    places: HashMap<(String, String), String>,
    /// What became of routes with a name.
    fates: HashMap<String, Fate>,
    window_s: (f64, f64),
    detours: Detours,
}

impl Closing<'_> {
    fn classes_of(&self, driver: &Element) -> VehicleClasses {
        let known = driver.attribute("type").and_then(|kind| self.classes.get(kind)).filter(|all| !all.is_empty());
        known.cloned().unwrap_or_else(|| VehicleClasses::from([CAR.to_owned()]))
    }

    /// Notes who has the routes with a name.
    fn note_users(&mut self, root: &Element) {
        for departing in each(root) {
            let element = departing.element;
            if element.name == "routeDistribution" {
                let inner = element.all("route").flat_map(|route| [route.attribute("refId"), route.attribute("id")]);
                let all = inner.flatten().chain(words(element, "routes")).map(str::to_owned).collect();
                self.members.insert(id(element).to_owned(), all);
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

    fn file(&mut self, root: &Element) -> Element {
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
                    let classes = self.users.get(id(child)).cloned();
                    let stops = self.stops_by.get(id(child)).cloned().unwrap_or_default();
                    let fate = self.route(&mut changed, &classes.unwrap_or_default(), &stops);
                    self.fates.insert(id(child).to_owned(), fate);
                    fate != Fate::NoWay
                }
                "routeDistribution" => {
                    let classes = self.users.get(id(child)).cloned().unwrap_or_default();
                    let stops = self.stops_by.get(id(child)).cloned().unwrap_or_default();
                    let fate = self.distribution(&mut changed, &classes, &stops);
                    self.fates.insert(id(child).to_owned(), fate);
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
        zone.children.retain(|child| !is_end(&child.name) || is_open(id(child)));
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
        let via: Vec<&str> = words(trip, "via").collect();
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
        let edges = words(route, "edges").map(|edge| self.roads.edge_named(edge)).collect::<Option<Vec<EdgeNo>>>();
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
        let car = VehicleClasses::from([CAR.to_owned()]);
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
        let named: Vec<String> = words(element, "routes").map(str::to_owned).collect();
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

fn id(element: &Element) -> &str {
    element.attribute("id").unwrap_or_default()
}

fn words<'a>(element: &'a Element, key: &str) -> impl Iterator<Item = &'a str> {
    element.attribute(key).unwrap_or_default().split_ascii_whitespace()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::roads::example::changed;
    use crate::network::tree::parse;

    /// Roads from `far` to `out` on two ways: by `near`, and by `bypass`, which takes 5 s longer.
    fn net() -> Element {
        let edge = "<edge id='bypass' from='U' to='J'><lane id='bypass_0' index='0' speed='10' length='100'/></edge>\
                    <tlLogic id='J'";
        let ways = "<connection from='far' fromLane='0' to='bypass' toLane='0' dir='s'/>\
                    <connection from='bypass' fromLane='0' to='out' toLane='0' dir='s'/></net>";
        let net = changed(&[("<tlLogic id='J'", edge), ("</net>", ways)]);
        parse(&net.replace('\'', "\"")).unwrap()
    }

    /// Closes these edges. Returns the elements that stay of the demand, without types, and what became of the vehicles.
    fn closed(ids: &[&str], demand: &str) -> Result<(Vec<Element>, Detours)> {
        let (net, routes) = (net(), parse(&format!("<routes>{demand}</routes>")).unwrap());
        let files = Files { net: &net, additional: Vec::new(), routes: vec![&routes], window_s: (0.0, 100.0) };
        let ids: Vec<String> = ids.iter().map(|id| (*id).to_owned()).collect();
        let closed = close(&files, &Roads::read(&net).unwrap(), &ids)?;
        let kept = closed.routes[0].children.iter().filter(|child| child.name != "vType").cloned();
        Ok((kept.collect(), closed.detours))
    }

    /// Returns the edges of the routes that stay.
    fn routes(ids: &[&str], demand: &str) -> Vec<String> {
        let (kept, _) = closed(ids, demand).unwrap();
        let inner = kept.iter().flat_map(|child| [child].into_iter().chain(&child.children));
        inner.filter_map(|element| element.attribute("edges")).map(str::to_owned).collect()
    }

    const OTHER: &str = "<vehicle id='other' depart='0'><route edges='north back west'/></vehicle>";

    #[test]
    fn a_route_across_a_closed_edge_goes_around_it() {
        let car = "<vehicle id='v' depart='0'><route edges='far near out'/></vehicle>";
        assert_eq!(routes(&["bypass"], car), ["far near out"]);
        assert_eq!(routes(&["near"], car), ["far bypass out"]);
        let named = "<route id='r' edges='far near out'/><vehicle id='v' depart='0' route='r' departEdge='1'/>";
        assert_eq!(routes(&["near"], named), ["far bypass out"]);
        let (kept, detours) = closed(&["near"], &format!("{named}{OTHER}")).unwrap();
        assert_eq!(kept[1].attribute("departEdge"), None, "it counts edges of the route that it had");
        let expected = Detours { vehicles: 2.0, rerouted: 1.0, without_way: 0.0, trips: 0.0, stops_left_out: 0 };
        assert_eq!(detours, expected);
    }

    #[test]
    fn vehicles_that_cannot_get_to_their_destination_are_left_out_and_counted() {
        // 10 in the 100 s of an episode.
        let flow = "<flow id='f' begin='0' end='100' number='10'><route edges='far near out'/></flow>";
        let trips = "<trip id='t' depart='5' from='far' to='out'/><trip id='u' depart='5' from='side' to='west'/>";
        let (kept, detours) = closed(&["near", "bypass"], &format!("{flow}{OTHER}{trips}")).unwrap();
        // From `side` there is no way to `west` but by `near`.
        assert_eq!(kept.iter().map(id).collect::<Vec<_>>(), ["other"]);
        assert_eq!((detours.vehicles, detours.rerouted, detours.without_way, detours.trips), (13.0, 0.0, 12.0, 0.0));
        let (_, detours) = closed(&["near"], "<trip id='t' depart='5' from='far' to='out'/>").unwrap();
        assert_eq!(detours.trips, 1.0);
        assert!(detours.to_string().ends_with("; 1 are trips, whose ways SUMO finds on the open roads"), "{detours}");
        let error = closed(&["near", "bypass"], flow).unwrap_err().to_string();
        assert!(error.starts_with("near,bypass: no vehicle can get to its destination"), "{error}");
    }

    #[test]
    fn a_bus_goes_by_its_stops_and_leaves_out_those_on_closed_edges() {
        let bus = |stop: &str| {
            format!(
                "<vehicle id='b' depart='0'><route edges='far near out'/><stop lane='{stop}_0' duration='9'/></vehicle>"
            )
        };
        let (kept, detours) = closed(&["near"], &bus("near")).unwrap();
        assert_eq!((kept[0].all("stop").count(), detours.stops_left_out, detours.rerouted), (0, 1, 1.0));
        let (kept, detours) = closed(&["near"], &bus("out")).unwrap();
        assert_eq!((kept[0].all("stop").count(), detours.stops_left_out, detours.rerouted), (1, 0, 1.0));
    }

    #[test]
    fn a_detour_has_lanes_for_its_vehicles() {
        let only_buses = |class: &str| {
            let net = xml_with_bypass_for("bus");
            let demand = format!(
                "<routes><vType id='k' vClass='{class}'/><vehicle id='v' type='k' depart='0'><route edges='far near out'/>\
                 </vehicle>{OTHER}</routes>"
            );
            let routes = parse(&demand).unwrap();
            let files = Files { net: &net, additional: Vec::new(), routes: vec![&routes], window_s: (0.0, 100.0) };
            close(&files, &Roads::read(&net).unwrap(), &["near".to_owned()]).unwrap().detours
        };
        assert_eq!([only_buses("bus").rerouted, only_buses("passenger").rerouted], [1.0, 0.0]);
        assert_eq!(only_buses("passenger").without_way, 1.0);
    }

    fn xml_with_bypass_for(class: &str) -> Element {
        let mut net = net();
        let bypass = net.children.iter_mut().find(|edge| edge.attribute("id") == Some("bypass")).unwrap();
        bypass.children[0].attributes.push(("allow".to_owned(), class.to_owned()));
        net
    }

    #[test]
    fn a_route_of_a_distribution_without_a_way_leaves_its_cars_to_the_others() {
        let demand = "<routeDistribution id='d'><route id='a' edges='far near out' probability='0.5'/>\
                      <route id='b' edges='north out' probability='0.5'/></routeDistribution>\
                      <vehicle id='v' depart='0' route='d'/>";
        assert_eq!(routes(&["near", "bypass"], demand), ["north out"]);
    }

    #[test]
    fn closed_lanes_stay_open_on_foot_and_a_misspelt_edge_is_an_error() {
        let (net, routes) = (net(), parse("<routes/>").unwrap());
        let files = Files { net: &net, additional: Vec::new(), routes: vec![&routes], window_s: (0.0, 100.0) };
        let roads = Roads::read(&net).unwrap();
        let closed = close(&files, &roads, &["side".to_owned()]).unwrap();
        let side = closed.net.all("edge").find(|edge| id(edge) == "side").unwrap();
        assert_eq!(side.children[0].attribute("allow"), Some("pedestrian"));
        assert_eq!(side.children[1].attribute("disallow"), Some("all"));
        let error = close(&files, &roads, &["near1".to_owned()]).unwrap_err().to_string();
        assert_eq!(error, "the net has no edge `near1` (did you mean `near`?); sumo-gui shows the ids of edges");
    }
}
