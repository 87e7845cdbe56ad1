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

mod routes;

use std::collections::{BTreeSet, HashMap};
use std::fmt::{self, Display, Formatter};

use anyhow::{Result, ensure};

use super::own_types::{OWN_TYPES, USUAL_CLASS};
use super::stops::PLACES;
use super::ways::{VehicleClasses, Ways};
use crate::network::roads::{EdgeNo, Roads};
use crate::network::tree::Element;
use dials_core::base::counted;
use routes::Closing;

/// Classes that do not drive on roads. A lane that they have stays open for them.
const APART: [&str; 9] =
    ["pedestrian", "tram", "rail_urban", "rail", "rail_electric", "rail_fast", "subway", "cable_car", "ship"];

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

impl Detours {
    /// Returns the sum over two route files.
    pub(super) fn plus(&self, other: &Detours) -> Detours {
        Detours {
            vehicles: self.vehicles + other.vehicles,
            rerouted: self.rerouted + other.rerouted,
            without_way: self.without_way + other.without_way,
            trips: self.trips + other.trips,
            stops_left_out: self.stops_left_out + other.stops_left_out,
        }
    }
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

/// Closes edges, by their ids. An error names the one that the net does not have.
pub(super) fn close(files: &Files<'_>, roads: &Roads, ids: &[String]) -> Result<Closed> {
    let edges = ids.iter().map(|id| roads.edge_called(id)).collect::<Result<BTreeSet<EdgeNo>>>()?;
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
            let class = kind.attribute("vClass").unwrap_or(USUAL_CLASS).to_owned();
            classes.insert(kind.id().to_owned(), VehicleClasses::from([class]));
        }
        if element.name == "vTypeDistribution" {
            let inner = types.iter().map(|kind| kind.id()).chain(element.words("vTypes"));
            let all = inner.filter_map(|kind| classes.get(kind)).flatten().cloned().collect();
            classes.insert(element.id().to_owned(), all);
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
        .filter_map(|place| Some(((place.name.clone(), place.id().to_owned()), place.attribute("lane")?.to_owned())))
        .collect()
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
        assert_eq!(kept.iter().map(Element::id).collect::<Vec<_>>(), ["other"]);
        assert_eq!((detours.vehicles, detours.rerouted, detours.without_way, detours.trips), (13.0, 0.0, 12.0, 0.0));
        let (_, detours) = closed(&["near"], "<trip id='t' depart='5' from='far' to='out'/>").unwrap();
        assert_eq!(detours.trips, 1.0);
        assert!(detours.to_string().ends_with("; 1 are trips, whose ways SUMO finds on the open roads"), "{detours}");
        let error = closed(&["near", "bypass"], flow).unwrap_err().to_string();
        assert!(error.starts_with("near,bypass: no vehicle can get to its destination"), "{error}");
    }

    #[test]
    fn who_begins_and_ends_on_a_closed_edge_is_left_out() {
        let short = "<vehicle id='v' depart='0'><route edges='near'/></vehicle>";
        let (kept, detours) = closed(&["near"], &format!("{short}{OTHER}")).unwrap();
        assert_eq!(kept.iter().map(Element::id).collect::<Vec<_>>(), ["other"]);
        assert_eq!((detours.without_way, detours.rerouted), (1.0, 0.0));
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
        let side = closed.net.all("edge").find(|edge| edge.id() == "side").unwrap();
        assert_eq!(side.children[0].attribute("allow"), Some("pedestrian"));
        assert_eq!(side.children[1].attribute("disallow"), Some("all"));
        let error = close(&files, &roads, &["near1".to_owned()]).unwrap_err().to_string();
        assert_eq!(error, "the net has no edge `near1` (did you mean `near`?); sumo-gui shows the ids of edges");
    }
}
