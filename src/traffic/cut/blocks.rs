//! Many different local nets side by side in one SUMO net, each on lane numbers of its own.
//!
//! SUMO numbers lanes in the order of loading. With the option `--thread-rngs` of R it has R random generators. Lane n
//! draws from generator n modulo R, which is seeded with `--seed` plus that remainder. So the seed of a lane is its
//! number plus a constant, as long as R is at least the number of lanes.
//!
//! A block is a local net with so many dummy lanes that all blocks of a scenario have the same number of lanes. Block k
//! of the scenario always has the lane seeds from `seed + k * lanes` on, whatever else is loaded. So a region behaves
//! alike, to the bit, alone and in any company, also where cars dawdle at random. (Dummy lanes cost nothing per step.
//! A generator takes 5 kB.)
//!
//! Only lanes have generators of their own. Whatever SUMO draws from another one depends on the company. So speed
//! factors and types of cars must come from outside, and lanes and positions of departures must be given.

use anyhow::{Result, ensure};

use super::local_net::{LocalNet, Parts, net_text};
use crate::traffic::network::xml::{Xml, leaf, nest};

/// The blocks of all regions of a scenario.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Blocks {
    /// Number of lanes of each block.
    lanes: usize,
}

/// One row of a forest.
#[derive(Clone, Copy, Debug)]
pub struct Row<'a> {
    pub net: &'a LocalNet,
    /// Number of the block among all blocks of the scenario. With C copies of each agent, copy c of agent a has block
    /// a * C + c.
    pub block: usize,
}

/// A forest as SUMO loads it.
#[derive(Clone, Debug)]
pub struct MixedForest {
    /// Text of the net.
    pub net: String,
    /// Options of SUMO's random generators.
    pub options: [String; 4],
}

impl Blocks {
    /// Returns the blocks of a scenario. `nets`: the local nets of all its agents, also of those that are simulated
    /// elsewhere.
    pub fn of<'a>(nets: impl IntoIterator<Item = &'a LocalNet>) -> Blocks {
        Blocks { lanes: nets.into_iter().map(|net| net.lanes().count()).max().unwrap_or(0) }
    }

    /// Makes a forest of some of the blocks. Names have the row's prefix: see [`prefix`].
    ///
    /// Errors: the rows are not consecutive blocks in ascending order; a net has too many lanes; the seeds are beyond
    /// SUMO's.
    pub fn forest(self, rows: &[Row<'_>], seed: u32) -> Result<MixedForest> {
        ensure!(!rows.is_empty(), "a forest of 0 regions: needs at least one");
        let first = rows[0].block;
        for (row, Row { net, block }) in rows.iter().enumerate() {
            ensure!(*block == first + row, "row {row} of the forest is block {block}, but must be {}", first + row);
            let lanes = net.lanes().count();
            ensure!(
                lanes <= self.lanes,
                "the region of light `{}` has {lanes} lanes, but blocks have {}",
                net.light,
                self.lanes
            );
        }
        let lanes = rows.len() * self.lanes;
        // SUMO counts seeds up in a signed integer.
        let first_seed = seed as usize + first * self.lanes;
        ensure!(
            first_seed + lanes <= i32::MAX as usize,
            "the lanes of blocks {first} to {} have seeds beyond {}; use a smaller seed, or fewer copies",
            first + rows.len() - 1,
            i32::MAX
        );
        let options = ["--thread-rngs", &lanes.to_string(), "--seed", &first_seed.to_string()].map(str::to_owned);
        Ok(MixedForest { net: self.net(rows), options })
    }

    fn net(self, rows: &[Row<'_>]) -> String {
        net_text(rows[0].net, |xml| {
            // SUMO wants all edges before the lights, the lights before the junctions, and so on.
            for kind in 0..Parts::KINDS {
                for row in rows {
                    let prefix = prefix(row.block);
                    row.net.write_kind(xml, kind, &prefix)?;
                    self.pad(xml, kind, row, &prefix)?;
                }
            }
            Ok(())
        })
    }

    /// Writes the dummy lanes of a row, which lead from nowhere to nowhere.
    fn pad(self, xml: &mut Xml, kind: usize, row: &Row<'_>, prefix: &str) -> std::io::Result<()> {
        let missing = self.lanes - row.net.lanes().count();
        let [edge, from, to] = ["edge", "from", "to"].map(|what| format!("{prefix}+dummy.{what}"));
        let lanes = || (0..missing).map(|index| (index, format!("{edge}_{index}")));
        match kind {
            _ if missing == 0 => Ok(()),
            Parts::EDGES => nest(xml, "edge", [("id", &edge), ("from", &from), ("to", &to)], |xml| {
                lanes().try_for_each(|(index, id)| {
                    let index = index.to_string();
                    let place = [("speed", "1"), ("length", "1"), ("shape", "0,0 1,0")];
                    leaf(xml, "lane", [("id", &*id), ("index", &*index)].into_iter().chain(place))
                })
            }),
            Parts::JUNCTIONS => {
                let ending = lanes().map(|(_, id)| id).collect::<Vec<_>>().join(" ");
                [(&from, "0", ""), (&to, "1", &*ending)].into_iter().try_for_each(|(id, x, incoming)| {
                    let place = [("type", "dead_end"), ("x", x), ("y", "0")];
                    let lanes = [("incLanes", incoming), ("intLanes", "")];
                    leaf(xml, "junction", [("id", id.as_str())].into_iter().chain(place).chain(lanes))
                })
            }
            _ => Ok(()),
        }
    }
}

/// Returns the prefix of all names of a block.
pub fn prefix(block: usize) -> String {
    format!("b{block}.")
}
