//! The ways of cars through the lights of a net.
//!
//! An approach of a light begins with the edge that ends there. It goes on upstream as long as nothing but this light makes a car
//! wait: over connections on which cars need not yield, up to the light before. So a car on a side street that waits to turn into
//! the approach is not delayed by the light.

use std::collections::HashMap;

use crate::network::roads::{EdgeNo, Roads};
use dials_core::domain::light_figures::{ApproachPlace, LightPlace, MovementPlace};

/// Number of a movement in [`Ways::movements`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MovementNo(pub(crate) usize);

/// Where a movement is among the lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Movement {
    pub(crate) light: usize,
    /// Number of the approach among those of the light, and of the movement among those of the approach.
    pub(crate) approach: usize,
    pub(crate) movement: usize,
    /// Number of the approach among all.
    pub(crate) queue: usize,
}

/// The light ahead of a car: the place on its route of the edge that ends there, and its movement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Ahead {
    pub(crate) place: usize,
    pub(crate) movement: MovementNo,
}

/// A way from an edge to the next one.
#[derive(Clone, Copy, Debug)]
struct Passage {
    movement: Option<MovementNo>,
    has_priority: bool,
}

/// All ways through the lights of a net.
#[derive(Debug, Default)]
pub(crate) struct Ways {
    pub(crate) lights: Vec<LightPlace>,
    pub(crate) movements: Vec<Movement>,
    pub(crate) approaches: usize,
    passages: HashMap<[EdgeNo; 2], Passage>,
    edges: HashMap<String, EdgeNo>,
}

/// A route, with the light ahead at each of its edges.
#[derive(Debug, Default)]
pub(crate) struct Route {
    pub(crate) edges: Vec<EdgeNo>,
    pub(crate) ahead: Vec<Option<Ahead>>,
    /// Movement from each edge to the next one.
    pub(crate) through: Vec<Option<MovementNo>>,
}

impl Ways {
    /// `lights`: their names, in the order of the figures.
    pub(crate) fn of(roads: &Roads, lights: &[String]) -> Ways {
        let mut ways = Ways::default();
        for connection in &roads.connections {
            let key = [connection.from, connection.to].map(|lane| roads.lane(lane).edge);
            if key.iter().all(|&edge| roads.edge(edge).ends.is_some()) {
                let has_priority = connection.has_priority;
                let passage = ways.passages.entry(key).or_insert(Passage { movement: None, has_priority });
                passage.has_priority &= has_priority;
            }
        }
        for light in lights {
            ways.add_light(roads, light);
        }
        ways.edges = roads.roads().map(|(number, edge)| (edge.id.clone(), number)).collect();
        ways
    }

    fn add_light(&mut self, roads: &Roads, light: &str) {
        let drives = |lane| roads.lane(lane).carries_vehicles && roads.is_road(lane);
        let links = roads.of_light(light).filter(|link| drives(link.from) && drives(link.to));
        let mut place =
            LightPlace { id: light.to_owned(), streets: Vec::new(), place_m: [0.0; 2], approaches: Vec::new() };
        let mut from: Vec<EdgeNo> = Vec::new();
        let mut stop_lines: Vec<&[f64; 2]> = Vec::new();
        for link in links {
            let [edge, to] = [link.from, link.to].map(|lane| roads.lane(lane).edge);
            stop_lines.extend(roads.lane(link.from).shape.last());
            let passage = self.passages.get_mut(&[edge, to]).expect("a passage of each connection of roads");
            if passage.movement.is_some() {
                continue;
            }
            let number = from.iter().position(|&known| known == edge).unwrap_or_else(|| {
                let street = roads.edge(edge).street.clone();
                let lanes = roads.edge(edge).lanes.iter().filter(|&&lane| roads.lane(lane).carries_vehicles).count();
                let edge_name = roads.edge(edge).id.clone();
                place.approaches.push(ApproachPlace { edge: edge_name, street, lanes, movements: Vec::new() });
                from.push(edge);
                from.len() - 1
            });
            let approach = &mut place.approaches[number];
            let movement = Movement {
                light: self.lights.len(),
                approach: number,
                movement: approach.movements.len(),
                queue: self.approaches + number,
            };
            passage.movement = Some(MovementNo(self.movements.len()));
            self.movements.push(movement);
            let behind = roads.edge(to);
            approach.movements.push(MovementPlace { edge: behind.id.clone(), street: behind.street.clone() });
        }
        if place.approaches.is_empty() {
            return;
        }
        let count = stop_lines.len().max(1) as f64;
        place.place_m = [0, 1].map(|axis| stop_lines.iter().map(|place| place[axis]).sum::<f64>() / count);
        let behind = place.approaches.iter().flat_map(|approach| &approach.movements).map(|to| &to.street);
        for street in place.approaches.iter().map(|approach| &approach.street).chain(behind).flatten() {
            if !place.streets.contains(street) {
                place.streets.push(street.clone());
            }
        }
        self.approaches += from.len();
        self.lights.push(place);
    }

    /// Returns a route with the lights on it. An edge that the net does not have ends it.
    pub(crate) fn route(&self, names: &[String]) -> Route {
        let edges: Vec<EdgeNo> = names.iter().map_while(|name| self.edges.get(name).copied()).collect();
        let passage = |place: usize| self.passages.get(&[edges[place], *edges.get(place + 1)?]);
        let mut ahead = vec![None; edges.len()];
        let mut through = vec![None; edges.len()];
        for place in (0..edges.len()).rev() {
            let Some(passage) = passage(place) else { continue };
            through[place] = passage.movement;
            ahead[place] = match passage.movement {
                Some(movement) => Some(Ahead { place, movement }),
                None if passage.has_priority => ahead[place + 1],
                None => None,
            };
        }
        Route { edges, ahead, through }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::roads::example::roads;

    fn names(edges: &[&str]) -> Vec<String> {
        edges.iter().map(|&edge| edge.to_owned()).collect()
    }

    #[test]
    fn a_light_has_its_approaches_and_movements_and_an_unknown_edge_ends_a_route() {
        let roads = roads(&[]);
        let ways = Ways::of(&roads, &names(&["J", "nobody"]));
        let [light] = &ways.lights[..] else { panic!("one light has approaches: {:?}", ways.lights) };
        assert_eq!(light.approaches.len(), ways.approaches);
        let movements: usize = light.approaches.iter().map(|approach| approach.movements.len()).sum();
        assert_eq!(movements, ways.movements.len());
        let first = &light.approaches[0];
        let route = ways.route(&names(&[&first.edge, &first.movements[0].edge, "nowhere"]));
        assert_eq!(route.edges.len(), 2);
        assert_eq!(route.ahead, [Some(Ahead { place: 0, movement: MovementNo(0) }), None]);
    }
}
