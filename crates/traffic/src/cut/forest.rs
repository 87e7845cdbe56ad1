//! The forest: many single-intersection regions side by side in one SUMO net, because SUMO allows one simulation per
//! process. One step of many regions also costs less than many steps of one.
//!
//! A forest is the text of the local net, once per region, with other ids: region 3's light is `f3.r0c0`. All regions
//! keep the *same coordinates*. They do not see each other, because no road joins them. SUMO's arithmetic on positions
//! rounds alike in all of them, so each is bit-identical to the local net simulated alone. (At other coordinates,
//! speeds differ in the last digit, and the difference grows.)

use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};

use super::names::{prefixed, write};
use crate::network::contents::Network;
use crate::network::files::NetworkFiles;
use crate::network::tree::Element;
use crate::network::xml::document_with;
use crate::paper_grid::grid::{self, Grid};
use crate::paper_grid::recognise::recognise_local;
use dials_core::base::AgentId;
use dials_core::outside::write_together;

/// Paths of the files of a forest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ForestFiles {
    pub net: PathBuf,
    /// File of the vehicle type, once, and of four routes per region.
    pub routes: PathBuf,
}

/// One intersection of a forest, numbered from 0. Its methods return the names of its lanes, routes and so on.
///
/// All arrays: west, south, east, north.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Region(pub usize);

/// The only agent of a local net.
const ONLY: AgentId = AgentId(0);

impl Region {
    /// Returns the lanes that lead to the intersection, `[from west, from south, from east, from north]`.
    pub fn incoming_lanes(self) -> [String; 4] {
        Grid::SINGLE.incoming_edges(ONLY).map(|edge| self.rename(&grid::lane(&edge)))
    }

    /// Returns the lanes inside the intersection, by the side that their cars come from.
    pub fn internal_lanes(self) -> [String; 4] {
        Grid::SINGLE.internal_lanes(ONLY).map(|lane| self.rename(&lane))
    }

    /// Returns the lanes that leave the intersection, `[to west, to south, to east, to north]`.
    pub fn outgoing_lanes(self) -> [String; 4] {
        Grid::SINGLE.outgoing_edges(ONLY).map(|edge| self.rename(&grid::lane(&edge)))
    }

    pub fn light(self) -> String {
        self.rename(&Grid::SINGLE.light(ONLY))
    }

    /// Returns the routes by the side that they begin on.
    pub fn routes(self) -> [String; 4] {
        let routes: Vec<String> = Grid::SINGLE.boundary_routes().iter().map(|route| self.rename(&route.id)).collect();
        routes.try_into().expect("a single intersection has four routes")
    }

    /// Returns the name in this region of something in the local net.
    fn rename(self, id: &str) -> String {
        prefixed(&self.prefix(), id)
    }

    /// Returns what stands before the names of this region.
    pub(crate) fn prefix(self) -> String {
        format!("f{}.", self.0)
    }
}

/// Texts of the files of a forest: the net and the routes.
pub(crate) struct Forest {
    pub(crate) net: String,
    pub(crate) routes: String,
}

impl Forest {
    /// Makes a forest of `regions` copies of a local network. Takes milliseconds, because netconvert is not needed.
    pub(crate) fn of(local: &Network, regions: usize) -> Forest {
        Forest { net: replicate(&local.net.root, regions), routes: replicate(&local.routes.root, regions) }
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

/// Returns the text of a file of the local net, once per region.
fn replicate(local: &Element, regions: usize) -> String {
    document_with(&local.name, local.attributes.iter().map(|(key, value)| (key, value)), |xml| {
        // SUMO wants all edges before the lights, the lights before the junctions, and so on. So the regions go side by
        // side within each kind.
        for same_kind in local.children.chunk_by(|a, b| a.name == b.name) {
            let copies = if is_shared(&same_kind[0]) { 1 } else { regions };
            for region in (0..copies).map(Region) {
                let prefix = region.prefix();
                same_kind.iter().try_for_each(|element| write(xml, element, &prefix))?;
            }
        }
        Ok(())
    })
}

/// Returns whether all regions have this element in common: the place of the net and the vehicle type.
fn is_shared(element: &Element) -> bool {
    matches!(element.name.as_str(), "location" | "vType")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_a_region_are_those_of_the_local_net_with_its_number() {
        let region = Region(3);
        assert_eq!(region.light(), "f3.r0c0");
        assert_eq!(region.incoming_lanes(), ["f3.w0_r0c0_0", "f3.s0_r0c0_0", "f3.e0_r0c0_0", "f3.n0_r0c0_0"]);
        assert_eq!(region.outgoing_lanes(), ["f3.r0c0_w0_0", "f3.r0c0_s0_0", "f3.r0c0_e0_0", "f3.r0c0_n0_0"]);
        assert_eq!(region.internal_lanes(), [":f3.r0c0_3_0", ":f3.r0c0_2_0", ":f3.r0c0_1_0", ":f3.r0c0_0_0"]);
        assert_eq!(region.routes(), ["f3.w0_to_e0", "f3.s0_to_n0", "f3.e0_to_w0", "f3.n0_to_s0"]);
    }
}
