//! Routes: lists of edges that follow each other.

use anyhow::{Result, ensure};

use super::super::place::Place;
use super::super::streets::Street;
use super::Demand;
use dials_core::outside::excerpt;

impl<'a> Demand<'a> {
    /// Adds a route or a distribution of routes with an id of its own.
    pub(super) fn add_routes(&mut self, place: Place<'a>) -> Result<()> {
        let id = place.needed("id")?;
        let routes = self.routes_in(place)?;
        let is_new = self.routes.insert(id, routes).is_none();
        ensure!(is_new, place.fault("a route of this id is defined twice; remove one of them"));
        Ok(())
    }

    /// Returns the routes of a route or a distribution, which need no id.
    pub(super) fn routes_in(&mut self, place: Place<'a>) -> Result<Vec<Vec<Street>>> {
        if place.element.name == "route" {
            if let Some(id) = place.element.attribute("refId") {
                return self.known_routes(place, "refId", id);
            }
            return Ok(vec![self.streets_in(place, "edges")?]);
        }
        let mut routes = Vec::new();
        for inner in place.element.all("route") {
            let inner = place.within(inner);
            routes.extend(self.routes_in(inner)?);
            // A route of a distribution may be used alone, too.
            if inner.element.attribute("id").is_some() {
                self.add_routes(inner)?;
            }
        }
        for id in place.element.attribute("routes").unwrap_or_default().split_ascii_whitespace() {
            routes.extend(self.known_routes(place, "routes", id)?);
        }
        ensure!(!routes.is_empty(), place.fault("holds no route; add one or remove it"));
        Ok(routes)
    }

    /// Returns the routes of an id that an attribute names.
    pub(super) fn known_routes(&self, place: Place<'a>, key: &str, id: &str) -> Result<Vec<Vec<Street>>> {
        let unknown = || place.fault_in(key, "no route of this id is defined before it; define it or correct the id");
        self.routes.get(id).cloned().ok_or_else(unknown)
    }

    /// Returns an error if vehicles of a class cannot drive along a route.
    pub(super) fn check_connected(&self, place: Place<'a>, route: &[Street], class: Option<&str>) -> Result<()> {
        if let Some(&first) = route.first() {
            self.check_open(place, first, class)?;
        }
        for step in route.windows(2) {
            ensure!(
                self.streets.is_followed(step[0], step[1], class),
                place.fault(format!(
                    "its route goes from edge {} to edge {}, and the net has no such connection{}; correct the route",
                    self.named(step[0]),
                    self.named(step[1]),
                    for_class(class)
                ))
            );
        }
        Ok(())
    }

    /// Returns an error if there is no way along the stations of a trip.
    pub(super) fn check_reachable(
        &mut self,
        place: Place<'a>,
        stations: &[Street],
        class: Option<&'a str>,
    ) -> Result<()> {
        for step in stations.windows(2) {
            let (from, to) = (step[0], step[1]);
            self.check_open(place, from, class)?;
            let streets = self.streets;
            let reached = self.reached.entry((from, class)).or_insert_with(|| streets.reached(from, class));
            ensure!(
                reached.contains(to),
                place.fault(format!(
                    "there is no way from edge {} to edge {}{}; correct the trip",
                    self.named(from),
                    self.named(to),
                    for_class(class)
                ))
            );
        }
        Ok(())
    }

    /// Returns the id of an edge for an error.
    fn named(&self, street: Street) -> String {
        excerpt(self.streets.name(street))
    }

    fn check_open(&self, place: Place<'a>, street: Street, class: Option<&str>) -> Result<()> {
        ensure!(
            self.streets.is_open(street, class),
            place.fault(format!("edge {} has no lane{}; correct the route", self.named(street), for_class(class)))
        );
        Ok(())
    }
}

fn for_class(class: Option<&str>) -> String {
    class.map_or(String::new(), |class| format!(" for the class {}", excerpt(class)))
}
