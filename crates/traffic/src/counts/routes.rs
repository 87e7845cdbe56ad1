//! The routes that cars may take: the fastest ones between the ends of the net, and for a counted place that none of these passes
//! the fastest one across it.

use std::collections::BTreeSet;

use crate::network::roads::{EdgeNo, Roads};
use crate::scenario::ways::{VehicleClasses, Ways};

const CAR: &str = "passenger";

/// Returns the routes, without an order that means anything. A place that no car can pass has none.
pub(super) fn candidates(roads: &Roads, places: &[&[EdgeNo]]) -> Vec<Vec<EdgeNo>> {
    let classes = VehicleClasses::from([CAR.to_owned()]);
    let mut ways = Ways::new(roads, BTreeSet::new());
    let [entries, exits] = ends(roads);
    let mut found: BTreeSet<Vec<EdgeNo>> = BTreeSet::new();
    for &entry in &entries {
        // Who comes from a dead end wants to go somewhere else.
        let junction = |edge: EdgeNo, end: usize| roads.edge(edge).ends.map(|ends| ends[end]);
        for &exit in exits.iter().filter(|&&exit| exit != entry && junction(exit, 1) != junction(entry, 0)) {
            found.extend(ways.fastest(entry, exit, &classes).filter(|way| is_simple(way)).map(|way| way.to_vec()));
        }
    }
    for place in places {
        if found.iter().any(|route| passes(route, place)) {
            continue;
        }
        let (first, last) = (place[0], place[place.len() - 1]);
        let before: Vec<_> = entries.iter().filter_map(|&entry| ways.fastest(entry, first, &classes)).collect();
        let after: Vec<_> = exits.iter().filter_map(|&exit| ways.fastest(last, exit, &classes)).collect();
        // Where no end is reached, cars begin or end at the place itself.
        let before: Vec<Vec<EdgeNo>> =
            if before.is_empty() { vec![vec![first]] } else { before.iter().map(|way| way.to_vec()).collect() };
        let after: Vec<Vec<EdgeNo>> =
            if after.is_empty() { vec![vec![last]] } else { after.iter().map(|way| way.to_vec()).collect() };
        let whole = |before: &Vec<EdgeNo>, after: &Vec<EdgeNo>| -> Vec<EdgeNo> {
            let skipped = usize::from(first == last);
            before.iter().chain(after.iter().skip(skipped)).copied().collect()
        };
        let all = before.iter().flat_map(|before| after.iter().map(move |after| whole(before, after)));
        let mut all: Vec<Vec<EdgeNo>> = all.filter(|route| is_simple(route)).collect();
        all.sort_by_key(Vec::len);
        found.extend(all.into_iter().take(MOST_ACROSS));
    }
    found.into_iter().collect()
}

/// Largest number of routes that are made for one counted place.
const MOST_ACROSS: usize = 20;

/// Returns the edges on which cars come into the net, and those on which they leave it.
fn ends(roads: &Roads) -> [Vec<EdgeNo>; 2] {
    let for_cars = || {
        roads
            .roads()
            .filter(|(_, edge)| edge.lanes.iter().any(|&lane| roads.lane(lane).classes.has(CAR)))
            .map(|(no, _)| no)
    };
    let lanes = |edge: EdgeNo| roads.edge(edge).lanes.iter().copied();
    let comes = |edge: &EdgeNo| {
        lanes(*edge).flat_map(|lane| roads.links_to(lane)).any(|link| roads.carries_cars(link) && !link.turns_around())
    };
    let goes = |edge: &EdgeNo| {
        lanes(*edge)
            .flat_map(|lane| roads.links_from(lane))
            .any(|link| roads.carries_cars(link) && !link.turns_around())
    };
    [for_cars().filter(|edge| !comes(edge)).collect(), for_cars().filter(|edge| !goes(edge)).collect()]
}

fn is_simple(route: &[EdgeNo]) -> bool {
    route.iter().collect::<BTreeSet<_>>().len() == route.len()
}

fn passes(route: &[EdgeNo], place: &[EdgeNo]) -> bool {
    route.windows(place.len()).any(|piece| piece == place)
}

/// Returns the numbers of the places that a route passes.
pub(super) fn passed(route: &[EdgeNo], places: &[&[EdgeNo]]) -> Vec<usize> {
    (0..places.len()).filter(|&place| passes(route, places[place])).collect()
}

/// Returns whether cars can drive from one edge into another.
pub(super) fn follows(roads: &Roads, from: EdgeNo, to: EdgeNo) -> bool {
    let links = roads.edge(from).lanes.iter().flat_map(|&lane| roads.links_from(lane));
    let mut links = links.filter(|link| roads.carries_cars(link));
    links.any(|link| roads.lane(link.to).edge == to)
}
