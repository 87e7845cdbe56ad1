//! Cars for arrivals: of which type they are and which way they go, as recorded visits say.

use std::collections::BTreeMap;

use rand::seq::IndexedRandom;

use super::visits::{Visit, Visits};
use crate::agents::border_plan::BorderPlan;
use crate::agents::plan::Border;
use crate::d_set::Parts;
use crate::scenario::own_types::{USUAL_CLASS, USUAL_TYPE};
use dials_core::base::Dice;

/// Recorded visits by agent, entry and part of the episode. A draw is one of them: type and way go together.
#[derive(Clone, Debug)]
pub struct VisitTables {
    visits: Visits,
    parts: Parts,
    /// Places in the list of the agent, `[agents][entries][parts]`.
    places: Vec<Vec<Vec<Vec<usize>>>>,
    /// Places of visits by other entries on the same road, `[agents][entries]`; empty for an entry with visits of its own.
    beside: Vec<Vec<Vec<usize>>>,
    /// Vehicle type that most visits have, and its class; those of SUMO's own cars if there are no visits.
    usual: (String, String),
}

impl VisitTables {
    /// Sorts the visits of a whole episode. It leaves out those without an entry or a way, and those of vehicles that may
    /// not use the lane of their entry: they came by a lane beside it.
    pub(crate) fn new(visits: Visits, borders: &[Border]) -> VisitTables {
        let parts = Parts::of(visits.seconds);
        let mut places: Vec<Vec<Vec<Vec<usize>>>> =
            borders.iter().map(|border| vec![vec![Vec::new(); parts.count]; border.plan.entries.len()]).collect();
        let mut near = Vec::with_capacity(borders.len());
        for ((places, of_agent), border) in places.iter_mut().zip(&visits.of_agents).zip(borders) {
            let may_enter = |entry: usize, visit: &Visit| {
                border.plan.lane_of_entry(entry, &visits.driver(visit).vehicle_class).is_some()
            };
            for (place, visit) in of_agent.iter().enumerate().filter(|(_, visit)| !visit.way.is_empty()) {
                if let Some(entry) = visit.entry.filter(|&entry| may_enter(entry, visit)) {
                    places[entry][parts.part(visit.second)].push(place);
                }
            }
            near.push(beside(&border.plan, places, |entry, place| may_enter(entry, &of_agent[place])));
        }
        VisitTables { usual: usual(&visits), visits, parts, places, beside: near }
    }

    /// Draws the visit of a car that arrives at an entry in a second of the episode: one of the same part of the episode.
    /// If there is none: one of another part, or one of another lane of the same road; else `None`.
    pub fn draw(&self, agent: usize, entry: usize, second: usize, dice: &mut Dice) -> Option<&Visit> {
        let of_entry = &self.places[agent][entry];
        let now = of_entry[self.parts.part(second)].choose(dice).copied();
        let ever = || of_entry.concat().choose(dice).copied();
        let drawn = now.or_else(ever).or_else(|| self.beside[agent][entry].choose(dice).copied());
        drawn.map(|place| &self.visits.of_agents[agent][place])
    }

    /// Returns the vehicle type of a car of which nothing is known, and its class.
    pub(super) fn usual(&self) -> (&str, &str) {
        (&self.usual.0, &self.usual.1)
    }

    pub fn visits(&self) -> &Visits {
        &self.visits
    }
}

/// Returns for each entry without visits those by other entries on its road whose vehicles `may_enter` there.
fn beside(plan: &BorderPlan, places: &[Vec<Vec<usize>>], may_enter: impl Fn(usize, usize) -> bool) -> Vec<Vec<usize>> {
    let others = |entry: usize| -> Vec<usize> {
        let is_near = |other: &usize| plan.road_of_entry(*other) == plan.road_of_entry(entry);
        let near = (0..places.len()).filter(is_near).flat_map(|other| places[other].concat());
        near.filter(|&place| may_enter(entry, place)).collect()
    };
    let has_own = |entry: usize| places[entry].iter().any(|of_part| !of_part.is_empty());
    (0..places.len()).map(|entry| if has_own(entry) { Vec::new() } else { others(entry) }).collect()
}

fn usual(visits: &Visits) -> (String, String) {
    let mut counts: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    for driver in visits.all().map(|visit| visits.driver(visit)) {
        *counts.entry((&driver.vehicle_type, &driver.vehicle_class)).or_default() += 1;
    }
    let (name, class) =
        counts.into_iter().max_by_key(|(_, count)| *count).map_or((USUAL_TYPE, USUAL_CLASS), |(usual, _)| usual);
    (name.to_owned(), class.to_owned())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::d_set::tests::border_of;
    use crate::sim::visits::Driver;
    use dials_core::base::Seed;

    /// Makes tables of visits to the light J on a net with some texts replaced: (second, entry, type).
    fn tables_of(changes: &[(&str, &str)], visits: &[(usize, Option<usize>, &str)]) -> VisitTables {
        let visit = |(driver, &(second, entry, _)): (usize, &(usize, Option<usize>, &str))| Visit {
            second,
            entry,
            way: vec!["near".to_owned(), "out".to_owned()],
            driver,
            ..Visit::default()
        };
        let driver = |(.., vehicle_type): &(usize, Option<usize>, &str)| Driver {
            vehicle_type: (*vehicle_type).to_owned(),
            vehicle_class: if *vehicle_type == "bus" { "bus" } else { "passenger" }.to_owned(),
            ..Driver::default()
        };
        let of_agents = vec![visits.iter().enumerate().map(visit).collect()];
        let drivers = visits.iter().map(driver).collect();
        VisitTables::new(Visits { of_agents, drivers, seconds: 1800 }, &[border_of(changes)])
    }

    #[test]
    fn a_car_is_drawn_from_its_quarter_else_from_its_lane_else_from_its_road() {
        // Parts: 0 to 899 s and from 900 s on.
        let visits = [(10, Some(0), "car"), (20, Some(0), "bus"), (1000, Some(0), "truck"), (30, None, "car")];
        let tables = tables_of(&[], &visits);
        let mut dice = Seed::new(1).dice();
        let mut drawn = |entry: usize, second: usize| -> BTreeSet<String> {
            let drawn = (0..50).filter_map(|_| tables.draw(0, entry, second, &mut dice));
            drawn.map(|visit| tables.visits().driver(visit).vehicle_type.clone()).collect()
        };
        let set = |names: &[&str]| names.iter().map(|&name| name.to_owned()).collect::<BTreeSet<_>>();
        assert_eq!(drawn(0, 500), set(&["car", "bus"]));
        assert_eq!(drawn(0, 1799), set(&["truck"]));
        assert_eq!(drawn(1, 500), set(&["car", "bus", "truck"]), "nobody was seen on the other lane of the road");
        assert!(drawn(2, 500).is_empty(), "nobody departed on `north`");
        assert_eq!(tables.usual(), ("car", "passenger"));
        let early = tables_of(&[], &[(10, Some(1), "bus")]);
        let drawn = early.draw(0, 1, 1700, &mut dice).map(|visit| visit.second);
        assert_eq!(drawn, Some(10), "in a quarter without cars those of the others come");
    }

    #[test]
    fn nobody_is_drawn_who_may_not_use_the_lane_of_the_entry() {
        const LANE: &str = r#"<lane id="near_1" index="1""#;
        let bus_lane = [(LANE, &*format!("{LANE} allow=\"bus\""))];
        let mut dice = Seed::new(1).dice();
        // A passenger car passed the bus lane within a second, beside it. Two others came by the lane beside.
        let tables = tables_of(&bus_lane, &[(10, Some(1), "car"), (20, Some(0), "car"), (30, Some(0), "car")]);
        assert!(tables.draw(0, 1, 500, &mut dice).is_none());
        let tables = tables_of(&bus_lane, &[(10, Some(1), "car"), (20, Some(0), "car"), (30, Some(0), "bus")]);
        (0..20).for_each(|_| assert_eq!(tables.draw(0, 1, 500, &mut dice).unwrap().second, 30));
    }
}
