//! The forest: many single-intersection regions side by side in one SUMO net, because SUMO allows one simulation per
//! process. One step of many regions also costs less than many steps of one.
//!
//! A forest is the text of the local net, once per region, with other ids: region 3's light is `f3.r0c0`. All regions
//! keep the *same coordinates*. They do not see each other, because no road joins them. SUMO's arithmetic on positions
//! rounds alike in all of them, so each is bit-identical to the local net simulated alone. (At other coordinates,
//! speeds differ in the last digit, and the difference grows.)

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::local_net::side_by_side;
use super::names::prefixed;
use crate::network::contents::Network;
use crate::network::files::NetworkFiles;
use crate::paper_grid::grid::{self, Grid};
use crate::paper_grid::recognise::recognise_local;
use dials_core::base::AgentId;
use dials_core::outside::write_together;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ForestFiles {
    pub net: PathBuf,
    /// File of the vehicle type, once, and of four routes per region.
    pub routes: PathBuf,
}

/// One intersection of a forest, numbered from 0. Its arrays are by the side where cars come in or go out: west, south,
/// east, north.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Region(pub usize);

const ONLY: AgentId = AgentId(0);

impl Region {
    pub fn incoming_lanes(self) -> [String; 4] {
        Grid::SINGLE.incoming_edges(ONLY).map(|edge| self.rename(&grid::lane(&edge)))
    }

    pub fn internal_lanes(self) -> [String; 4] {
        Grid::SINGLE.internal_lanes(ONLY).map(|lane| self.rename(&lane))
    }

    pub fn outgoing_lanes(self) -> [String; 4] {
        Grid::SINGLE.outgoing_edges(ONLY).map(|edge| self.rename(&grid::lane(&edge)))
    }

    pub fn light(self) -> String {
        self.rename(&Grid::SINGLE.light(ONLY))
    }

    pub fn routes(self) -> [String; 4] {
        let routes: Vec<String> = Grid::SINGLE.boundary_routes().iter().map(|route| self.rename(&route.id)).collect();
        routes.try_into().expect("a single intersection has four routes")
    }

    fn rename(self, id: &str) -> String {
        prefixed(&self.prefix(), id)
    }

    pub(crate) fn prefix(self) -> String {
        format!("f{}.", self.0)
    }
}

pub(crate) struct Forest {
    pub(crate) net: String,
    pub(crate) routes: String,
}

impl Forest {
    /// Makes a forest of `regions` copies of a local network. Takes milliseconds, because netconvert is not needed.
    pub(crate) fn of(local: &Network, regions: usize) -> Forest {
        let copies = |root| {
            let rows: Vec<_> = (0..regions).map(|region| (Region(region).prefix(), root)).collect();
            side_by_side(&rows, |_, _| Ok(()))
        };
        Forest { net: copies(&local.net.root), routes: copies(&local.routes.root) }
    }
}

/// Writes a forest of `regions` copies of the `local` network into `dir`, to be looked at or played by plain SUMO.
pub fn write_forest(local: &NetworkFiles, regions: usize, dir: &Path) -> Result<ForestFiles> {
    ensure!(regions >= 1, "{}: a forest of 0 regions: needs at least one", dir.display());
    local.check()?;
    let forest = Forest::of(&recognise_local(local)?.network, regions);
    let prefix = dir.join(format!("forest_{regions}"));
    let NetworkFiles { net, routes, .. } = NetworkFiles::of(&prefix);
    write_together(dir, &[(net.clone(), forest.net.into_bytes()), (routes.clone(), forest.routes.into_bytes())])?;
    Ok(ForestFiles { net, routes })
}
