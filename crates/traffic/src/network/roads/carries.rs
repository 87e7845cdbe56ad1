//! Which lanes are for cars, and which are for vehicles of any kind.

use crate::network::tree::Element;

/// Vehicle classes that an agent sees. Footpaths, cycle tracks and rails have neither.
const CARS: [&str; 2] = ["passenger", "bus"];

/// Classes of SUMO that drive on roads. The others are people on foot, rails and ships.
///
/// Source: SUMO 1.15, `src/utils/common/SUMOVehicleClass.cpp`.
const ON_ROADS: &str = "passenger bus bicycle moped motorcycle private emergency authority army vip hov taxi coach \
                        delivery truck trailer evehicle custom1 custom2";

/// Class of vehicles that no lane keeps out.
const EVERYWHERE: &str = "ignoring";

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Classes {
    listed: Vec<String>,
    /// Whether those that are listed may use it, or all others.
    listed_may: bool,
}

impl Classes {
    /// Returns those of a lane. `allow` wins over `disallow`; without both, everybody may.
    ///
    /// Source: SUMO 1.15, `parseVehicleClasses` in `src/utils/common/SUMOVehicleClass.cpp`.
    pub(crate) fn of(lane: &Element) -> Classes {
        let listed = |key: &str| -> Option<Vec<String>> {
            Some(lane.attribute(key)?.split_whitespace().map(str::to_owned).collect())
        };
        match listed("allow").filter(|allowed| !allowed.is_empty()) {
            Some(allowed) => Classes { listed: allowed, listed_may: true },
            None => Classes { listed: listed("disallow").unwrap_or_default(), listed_may: false },
        }
    }

    pub(crate) fn has(&self, class: &str) -> bool {
        let is_listed = self.listed.iter().any(|other| other == class || other == "all");
        class == EVERYWHERE || is_listed == self.listed_may
    }

    pub(crate) fn has_cars(&self) -> bool {
        CARS.iter().any(|class| self.has(class))
    }

    /// Returns whether some vehicle that drives on roads is among them, such as a bicycle.
    pub(crate) fn has_vehicles(&self) -> bool {
        ON_ROADS.split(' ').any(|class| self.has(class))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    #[test]
    fn cycle_paths_are_for_vehicles_but_not_for_cars_and_bus_lanes_are_for_both() {
        for (attributes, [cars, vehicles]) in [
            ("", [true, true]),
            ("allow=''", [true, true]),
            ("allow='all'", [true, true]),
            ("allow='bus taxi'", [true, true]),
            ("allow='passenger' disallow='all'", [true, true]),
            ("disallow='tram rail'", [true, true]),
            ("disallow='passenger'", [true, true]),
            ("disallow='passenger bus'", [false, true]),
            ("allow='delivery'", [false, true]),
            ("allow='bicycle'", [false, true]),
            ("allow='bicycle pedestrian'", [false, true]),
            ("allow='pedestrian'", [false, false]),
            ("allow='rail_urban tram'", [false, false]),
            ("disallow='all'", [false, false]),
        ] {
            let lane = parse(&format!("<lane {attributes}/>")).unwrap();
            let classes = Classes::of(&lane);
            assert_eq!([classes.has_cars(), classes.has_vehicles()], [cars, vehicles], "{attributes}");
            assert!(classes.has(EVERYWHERE), "{attributes}");
        }
    }
}
