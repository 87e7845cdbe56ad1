//! Many different local nets side by side in one SUMO net.
//!
//! SUMO numbers lanes in the order of loading. With the option `--thread-rngs` of R it has R random generators, and lane
//! n draws from generator n modulo R. Here R is the number of lanes, so each lane has a generator of its own. Who seeds
//! the generators of a region ([`libsumo::Simulation::seed_lanes`]) decides all that is random on its lanes. So a
//! region behaves alike, to the bit, alone and in any company, also where cars dawdle at random. (A generator takes
//! 5 kB.)
//!
//! Only lanes have generators of their own. Whatever SUMO draws from another one depends on the company. So speed
//! factors and types of cars must come from outside, and lanes and positions of departures must be given.
//!
//! One more thing is common to all cars. How far behind itself a car looks when it enters follows from the largest speed
//! factor and the smallest deceleration of all cars that have entered so far (SUMO 1.15: `MSLane::getMaximumBrakeDist`).
//! So a forest has one more road, [`APART`], that leads from nowhere to nowhere. There the cars with these values enter
//! first. And SUMO may not look for a way for any car: see `sim/local_routes.rs`.
//!
//! # Why not otherwise
//!
//! - With one generator for all lanes, SUMO's default, a car that dawdles in one row would change what the cars of the
//!   next row do. Then results would depend on the number of workers.
//! - No number of generators gives each row one of its own, because the lanes of a row have consecutive numbers.
//! - If cars never dawdled (`sigma = 0`), they would drive otherwise than in the GS.
//! - One process per region takes 70 MB and a message per step. A forest of 50 regions steps all of them in one call.

use std::io;

use super::local_net::{LocalNet, side_by_side};
use super::names::free_name;
use crate::network::xml::{Xml, leaf, nest};

/// Name of the road apart from all nets, and of the route on it. No prefix begins like this.
pub(crate) const APART: &str = "apart";

/// A forest as SUMO loads it. Its rows are numbered from 0.
#[derive(Clone, Debug)]
pub struct MixedForest {
    pub net: String,
    /// Number of the first lane of each row, and the number of all lanes of rows.
    pub first_lane: Vec<u32>,
}

impl MixedForest {
    /// Makes a forest of these nets, at least one. Names have the row's prefix: see [`prefix`].
    pub fn of(nets: &[&LocalNet]) -> MixedForest {
        let rows: Vec<_> = nets.iter().enumerate().map(|(row, net)| (prefix(row), net.root())).collect();
        let net = side_by_side(&rows, |xml, kind| write_apart(xml, kind, APART, [[0.0, 0.0], [1000.0, 0.0]]));
        let mut first_lane = vec![0];
        for net in nets {
            let lanes = u32::try_from(net.lanes().count()).expect("far fewer lanes than 2^32");
            first_lane.push(first_lane[first_lane.len() - 1] + lanes);
        }
        MixedForest { net, first_lane }
    }

    /// Returns the option with which each lane has a random generator of its own.
    pub fn option(&self) -> [String; 2] {
        let of_rows = self.first_lane.last().expect("the number of all lanes of rows");
        ["--thread-rngs".to_owned(), (of_rows + 1).to_string()]
    }
}

/// One local net under its own names, with the road apart. Its lanes have the same numbers as those of a first row.
#[derive(Clone, Debug)]
pub(crate) struct Alone {
    pub(crate) net: String,
    pub(crate) apart: String,
    pub(crate) lanes: usize,
}

impl Alone {
    /// Makes the net. `place_m`: where the road apart is drawn, as a point.
    pub(crate) fn of(net: &LocalNet, place_m: [f64; 2]) -> Alone {
        let apart = free_name(APART, |name| net.root.all("edge").any(|edge| edge.attribute("id") == Some(name)));
        let [x, y] = place_m;
        let ends_m = [[x, y], [x + 1.0, y]];
        let text = side_by_side(&[(String::new(), net.root())], |xml, kind| write_apart(xml, kind, &apart, ends_m));
        Alone { net: text, apart, lanes: net.lanes().count() + 1 }
    }
}

/// Writes the road apart, for vehicles of all classes. `ends_m`: where its ends are drawn.
fn write_apart(xml: &mut Xml, kind: &str, name: &str, ends_m: [[f64; 2]; 2]) -> io::Result<()> {
    let lane = format!("{name}_0");
    let [from, to] = ["from", "to"].map(|end| format!("{name}.{end}"));
    match kind {
        "edge" => nest(xml, "edge", [("id", name), ("from", &from), ("to", &to)], |xml| {
            let shape = ends_m.map(|[x, y]| format!("{x},{y}")).join(" ");
            let place = [("index", "0"), ("speed", "10"), ("length", "1000"), ("shape", &*shape)];
            leaf(xml, "lane", [("id", &*lane)].into_iter().chain(place))
        }),
        "junction" => [(&from, ""), (&to, &*lane)].into_iter().zip(ends_m).try_for_each(|((id, incoming), end)| {
            let [x, y] = end.map(|place_m| place_m.to_string());
            let place = [("type", "dead_end"), ("x", &*x), ("y", &*y), ("incLanes", incoming), ("intLanes", "")];
            leaf(xml, "junction", [("id", id.as_str())].into_iter().chain(place))
        }),
        _ => Ok(()),
    }
}

pub fn prefix(row: usize) -> String {
    format!("b{row}.")
}
