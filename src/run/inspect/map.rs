//! The map of a network with the regions of its agents.

use anyhow::Result;

use super::Inspected;
use dials_core::domain::road_trace::Line;
use dials_report::drawing::Svg;
use dials_report::plot::{MapRegion, RegionsMap, regions_map};
use dials_traffic::network::roads::LaneNo;

pub(super) fn drawn(inspected: &Inspected) -> Result<Svg> {
    let Inspected { net, roads, derived, .. } = inspected;
    let line = |lane: LaneNo| -> Line { roads.lane(lane).shape.clone() };
    let regions = derived.agents.iter().map(|agent| {
        let edges = agent.region.edges(roads);
        let within = |lane: &LaneNo| edges.contains(&roads.lane(*lane).edge);
        MapRegion {
            name: agent.plan.light.clone(),
            place_m: agent.plan.place_m,
            approaches: agent.region.ahead_m.keys().map(|&lane| line(lane)).collect(),
            lanes: roads.lanes_of_cars().filter(within).map(line).collect(),
        }
    });
    let keeping = derived.keeping.iter().flat_map(|kept| roads.junctions_of(&kept.light));
    regions_map(&RegionsMap {
        subject: net.file_name().unwrap_or(net.as_os_str()).to_string_lossy().into_owned(),
        junctions: roads.junctions.iter().map(|junction| junction.shape.clone()).collect(),
        lanes: roads.lanes_of_cars().map(line).collect(),
        regions: regions.collect(),
        keeping: keeping.map(|junction| roads.junction(junction).place_m).collect(),
    })
}
