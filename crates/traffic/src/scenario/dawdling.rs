//! How much the cars of a scenario dawdle: the attribute `sigma` of vehicle types, from 0 (never) to 1.

use std::sync::Arc;

use anyhow::Result;

use super::SumoScenario;
use super::own_types::{OWN_TYPES, USUAL_TYPE};
use crate::network::tree::Element;

/// Element of a vehicle type, and its attribute.
const TYPE: &str = "vType";
const SIGMA: &str = "sigma";
/// Classes of SUMO's own types, beside cars, that dawdle unless a file says otherwise.
const DAWDLING: [&str; 2] = ["bicycle", "taxi"];
/// Beginning of elements within a type that also have its attributes, and overrule them.
const MODEL: &str = "carFollowing";

impl SumoScenario {
    /// Returns the same scenario, in which all types of cars dawdle as much as `sigma` says.
    ///
    /// Errors: a route file of which each episode plays one cannot be read any more.
    pub fn dawdling(mut self, sigma: f64) -> Result<SumoScenario> {
        if self.drawn.is_some() {
            return self.drawn_dawdling(sigma);
        }
        let own = |(id, class): (&str, Option<&str>)| {
            let attributes = [("id", id)].into_iter().chain(class.map(|class| ("vClass", class)));
            let attributes = attributes.map(|(key, value)| (key.to_owned(), value.to_owned())).collect();
            Element { name: TYPE.to_owned(), attributes, children: Vec::new() }
        };
        let mut missing: Vec<Element> = self.own_types_without_element().into_iter().map(own).collect();
        let mut set = |element: &mut Element| {
            let models = element.children.iter_mut().filter(|child| child.name.starts_with(MODEL));
            models.for_each(|model| model.attributes.retain(|(key, _)| key != SIGMA));
            element.attributes.retain(|(key, _)| key != SIGMA);
            element.attributes.push((SIGMA.to_owned(), sigma.to_string()));
        };
        for file in self.additional.iter_mut().chain(&mut self.routes) {
            file.content = Arc::new(file.content.changed(|root| {
                // The first file gets them all.
                root.children.splice(0..0, missing.drain(..));
                types(root, &mut set);
            }));
        }
        Ok(self)
    }

    /// Returns SUMO's own types that cars have here and that no file defines, with their classes.
    fn own_types_without_element(&self) -> Vec<(&'static str, Option<&'static str>)> {
        let mut found = Vec::new();
        self.additional().chain(self.routes()).for_each(|root| collect(root, &mut found));
        let is_used = |id: &str| self.additional().chain(self.routes()).any(|root| has_type(root, id));
        let dawdling = OWN_TYPES.into_iter().filter(|(_, class)| DAWDLING.contains(class));
        let own = dawdling.filter(|(id, _)| is_used(id)).map(|(id, class)| (id, Some(class)));
        let own = [(USUAL_TYPE, None)].into_iter().chain(own);
        own.filter(|(id, _)| found.iter().all(|kind| kind.attribute("id") != Some(id))).collect()
    }

    /// Returns whether a type of cars may dawdle, as SUMO's own one does.
    pub fn dawdles(&self) -> bool {
        if let Some(drawn) = &self.drawn {
            return drawn.dawdles;
        }
        let roots = self.additional().chain(self.routes());
        let mut found = Vec::new();
        roots.for_each(|root| collect(root, &mut found));
        let is_zero = |sigma: &str| sigma.parse::<f64>().is_ok_and(|sigma| sigma == 0.0);
        let never = |kind: &&Element| {
            let models = kind.children.iter().filter(|child| child.name.starts_with(MODEL));
            let mut of_models = models.filter_map(|model| model.attribute(SIGMA));
            kind.attribute(SIGMA).is_some_and(is_zero) && of_models.all(is_zero)
        };
        !self.own_types_without_element().is_empty() || !found.iter().all(never)
    }
}

/// Calls `each` for all vehicle types in an element, also those in distributions.
fn types(element: &mut Element, each: &mut impl FnMut(&mut Element)) {
    for child in &mut element.children {
        if child.name == TYPE { each(child) } else { types(child, each) }
    }
}

fn has_type(element: &Element, id: &str) -> bool {
    let names = |child: &Element| {
        let of_distribution = child.attribute("vTypes").unwrap_or_default();
        child.attribute("type") == Some(id) || of_distribution.split_whitespace().any(|kind| kind == id)
    };
    element.children.iter().any(|child| names(child) || has_type(child, id))
}

fn collect<'a>(element: &'a Element, found: &mut Vec<&'a Element>) {
    for child in &element.children {
        if child.name == TYPE { found.push(child) } else { collect(child, found) }
    }
}
