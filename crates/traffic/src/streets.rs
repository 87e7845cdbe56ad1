//! The streets of a net, for maps of a city.

use crate::Traffic;
use crate::network::roads::Roads;
use dials_core::domain::Result;

/// A road in one direction.
#[derive(Clone, Debug, PartialEq)]
pub struct Street {
    pub edge: String,
    /// Name of the street, if the net has it.
    pub name: Option<String>,
    /// Number of lanes for vehicles.
    pub lanes: usize,
    /// Points of its middle lane, in metres.
    pub shape_m: Vec<[f64; 2]>,
}

impl Traffic {
    /// Returns the roads on which vehicles drive. No simulator is loaded.
    pub fn streets(&self) -> Result<Vec<Street>> {
        Ok(streets(&self.network.roads()?))
    }
}

fn streets(roads: &Roads) -> Vec<Street> {
    let street = |edge: &crate::network::roads::Edge| {
        let lanes: Vec<_> = edge.lanes.iter().map(|&lane| roads.lane(lane)).filter(|it| it.carries_vehicles).collect();
        let middle = lanes.get(lanes.len() / 2)?;
        Some(Street {
            edge: edge.id.clone(),
            name: edge.street.clone(),
            lanes: lanes.len(),
            shape_m: middle.shape.clone(),
        })
    };
    roads.roads().filter_map(|(_, edge)| street(edge)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::roads::example::roads;

    #[test]
    fn every_road_has_its_name_and_its_shape() {
        let net = roads(&[("<edge id='far'", "<edge id='far' name=' High Street '")]);
        let found = streets(&net);
        assert_eq!(found.len(), net.roads().count());
        assert!(found.iter().all(|street| street.lanes > 0), "{found:?}");
        // Most lanes of the example have no shape.
        let far = found.iter().find(|street| street.edge == "far").unwrap();
        assert_eq!(far.shape_m, [[-300.0, 0.0], [-60.0, 0.0]]);
        let named = found.iter().filter_map(|street| Some((&*street.edge, street.name.as_deref()?)));
        assert_eq!(named.collect::<Vec<_>>(), [("far", "High Street")]);
    }
}
