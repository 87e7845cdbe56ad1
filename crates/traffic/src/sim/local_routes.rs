//! Routes of cars through the local net of a light: their way through the region, and copies of the next roads behind its
//! exit.

use std::collections::HashMap;

use super::visit_tables::VisitTables;
use super::visits::Visit;
use crate::agents::border_plan::BorderPlan;
use crate::cut::local_net::{LocalNet, Way};
use crate::scenario::stops::Stop;

#[derive(Clone, Debug, Default)]
pub(crate) struct LocalRoutes {
    pub(crate) routes: Vec<LocalRoute>,
    /// Number of each route.
    numbers: HashMap<Key, usize>,
    /// Number of the route of a car of which nothing is known, by entry.
    pub(super) defaults: Vec<usize>,
}

/// Roads in the region and behind it, where the trip ends in metres, and stops.
type Key = (Vec<String>, Vec<String>, Option<u32>, Vec<Stop>);

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct LocalRoute {
    pub(crate) edges: Vec<String>,
    /// Position on the last edge at which a car has arrived. `None`: its end.
    pub(crate) end_m: Option<f64>,
    pub(crate) stops: Vec<Stop>,
}

impl LocalRoutes {
    pub(super) fn of(agent: usize, border: &BorderPlan, net: &LocalNet, tables: &VisitTables) -> LocalRoutes {
        let mut routes = LocalRoutes::default();
        let recorded = tables.visits().of_agents[agent].iter().filter(|visit| !visit.way.is_empty());
        for visit in recorded {
            routes.add(net, key(visit));
        }
        for entry in &border.entries {
            let ends_outside =
                |road: &String| border.roads.iter().any(|other| other.road == *road && other.ends_outside);
            let last = entry.default_way.iter().position(ends_outside);
            let inside = last.map_or(entry.default_way.len(), |last| last + 1);
            let (way, behind) = entry.default_way.split_at(inside);
            let number = routes.add(net, (way.to_vec(), behind.to_vec(), None, Vec::new()));
            routes.defaults.push(number);
        }
        routes
    }

    pub(crate) fn number(&self, visit: &Visit) -> usize {
        self.numbers[&key(visit)]
    }

    fn add(&mut self, net: &LocalNet, key: Key) -> usize {
        let number = self.routes.len();
        let known = *self.numbers.entry(key.clone()).or_insert(number);
        if known < number {
            return known;
        }
        let (way, next_roads, end_m, stops) = &key;
        let exit = net.exits.iter().find(|exit| Some(&exit.edge) == way.last());
        // The way behind the exit that goes along with the car longest.
        let together = |way: &&Way| way.edges.iter().zip(next_roads).take_while(|(one, other)| one == other).count();
        let ways = exit.iter().flat_map(|exit| &exit.ways).filter(|way| together(way) > 0);
        let behind = ways.rev().max_by_key(together);
        let copies = behind.map_or(&[][..], |way| &way.copies);
        let mut edges = [&way[..], copies].concat();
        if let [from, to] = &edges[..]
            && !net.leads(from, to)
        {
            // A car on this way never gets to its last road. SUMO takes a route of just two unconnected roads for a trip,
            // and looks for a way (1.15: `libsumo::Vehicle::add`). From then on it also looks at the room on the whole
            // lane before any car enters, in all rows. So the company of such a row would change the others.
            edges.push(to.clone());
        }
        self.routes.push(LocalRoute {
            edges,
            end_m: end_m.map(f64::from).or(behind.map(|way| way.end_m)),
            stops: stops.clone(),
        });
        number
    }
}

fn key(visit: &Visit) -> Key {
    (visit.way.clone(), visit.next_roads.clone(), visit.end_m, visit.stops.clone())
}
