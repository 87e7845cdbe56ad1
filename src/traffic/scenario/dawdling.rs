//! How much the cars of a scenario dawdle: the attribute `sigma` of vehicle types, from 0 (never) to 1.

use std::sync::Arc;

use super::{File, SumoScenario};
use crate::traffic::network::tree::Element;

/// Element of a vehicle type, its attributes, and the type of cars that name none.
const TYPE: &str = "vType";
const SIGMA: &str = "sigma";
const USUAL: &str = "DEFAULT_VEHTYPE";

impl SumoScenario {
    /// Returns the same scenario, in which all types of cars dawdle as much as `sigma` says.
    pub fn dawdling(mut self, sigma: f64) -> SumoScenario {
        let mut has_usual = false;
        let mut set = |element: &mut Element| {
            has_usual |= element.attribute("id") == Some(USUAL);
            element.attributes.retain(|(key, _)| key != SIGMA);
            element.attributes.push((SIGMA.to_owned(), sigma.to_string()));
        };
        for file in self.additional.iter_mut().chain(&mut self.routes) {
            change(file, |root| types(root, &mut set));
        }
        if !has_usual && let Some(first) = self.additional.iter_mut().chain(&mut self.routes).next() {
            let attributes = [("id", USUAL.to_owned()), (SIGMA, sigma.to_string())];
            let attributes = attributes.map(|(key, value)| (key.to_owned(), value)).to_vec();
            let usual = Element { name: TYPE.to_owned(), attributes, children: Vec::new() };
            change(first, |root| root.children.insert(0, usual));
        }
        self
    }

    /// Returns whether a type of cars may dawdle, as SUMO's own one does.
    pub fn dawdles(&self) -> bool {
        let roots = self.additional().chain(self.routes());
        let mut found = Vec::new();
        roots.for_each(|root| collect(root, &mut found));
        let never = |kind: &&Element| {
            kind.attribute(SIGMA).and_then(|sigma| sigma.parse::<f64>().ok()).is_some_and(|sigma| sigma == 0.0)
        };
        let usual_never = found.iter().any(|kind| kind.attribute("id") == Some(USUAL) && never(kind));
        !usual_never || !found.iter().all(never)
    }
}

/// Changes what a file holds.
fn change(file: &mut File, change: impl FnOnce(&mut Element)) {
    file.content = Arc::new(file.content.changed(change));
}

/// Calls `each` for all vehicle types in an element, also those in distributions.
fn types(element: &mut Element, each: &mut impl FnMut(&mut Element)) {
    for child in &mut element.children {
        if child.name == TYPE { each(child) } else { types(child, each) }
    }
}

fn collect<'a>(element: &'a Element, found: &mut Vec<&'a Element>) {
    for child in &element.children {
        if child.name == TYPE { found.push(child) } else { collect(child, found) }
    }
}
