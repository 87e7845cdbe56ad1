//! Which elements the files of a scenario may hold.
//!
//! What only measures is left out, with a note. Everything else that this program does not know is refused: it may change
//! traffic in a way that local simulators do not have, or SUMO skips it, as a typing error.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Result, bail};

use super::ROUTE_FILES;
use super::place::Place;
use crate::network::roads::attributes::tag;
use crate::network::tree::Element;
use dials_core::outside::Printable;

/// Elements that measure something and write it to a file.
const MEASURES: [&str; 12] = [
    "edgeData",
    "laneData",
    "inductionLoop",
    "e1Detector",
    "instantInductionLoop",
    "laneAreaDetector",
    "e2Detector",
    "entryExitDetector",
    "e3Detector",
    "vTypeProbe",
    "routeProbe",
    "timedEvent",
];

/// Elements that may stand in the root of a net.
const IN_A_NET: &[&str] = &[
    "location",
    "type",
    "edge",
    "tlLogic",
    "junction",
    "connection",
    "roundabout",
    "prohibition",
    "param",
    // Areas in the picture.
    "poly",
];

/// Elements that may stand in the root of other files.
const IN_OTHERS: &[&str] = &[
    "vType",
    "vTypeDistribution",
    "route",
    "routeDistribution",
    "vehicle",
    "trip",
    "flow",
    "taz",
    "tlLogic",
    "param",
    "location",
    "poly",
    "poi",
];

/// Returns the elements that may stand in another one.
fn known_in(element: &str) -> &'static [&'static str] {
    match element {
        "vTypeDistribution" => &["vType", "param"],
        "routeDistribution" => &["route", "param"],
        "vehicle" | "flow" => &["route", "routeDistribution", "param"],
        "taz" => &["tazSource", "tazSink", "param"],
        "tlLogic" => &["phase", "param"],
        _ => &["param"],
    }
}

/// Elements that SUMO reads in additional files, and skips in route files without a word.
const SKIPPED_IN_ROUTES: [&str; 2] = ["taz", "tlLogic"];

/// What was left out of the files.
#[derive(Debug, Default)]
pub(super) struct Left {
    /// Numbers by file and kind.
    counts: BTreeMap<(String, String), usize>,
    ids: BTreeSet<String>,
}

impl Left {
    /// Returns a sentence for each file and kind.
    pub(super) fn sentences(&self) -> impl Iterator<Item = String> {
        self.counts.iter().map(|((file, kind), count)| {
            format!("{file}: {count} x <{kind}>: this program measures and writes by itself")
        })
    }

    /// Returns an error if a light in this file asks a detector that was left out.
    pub(crate) fn check_not_needed(&self, file: &Path, root: &Element) -> Result<()> {
        for light in root.all("tlLogic") {
            let asked =
                light.all("param").find(|param| param.attribute("value").is_some_and(|id| self.ids.contains(id)));
            if let Some(param) = asked {
                let place = Place { file, element: light };
                let what = param.attribute("value").unwrap_or_default();
                bail!(
                    "{place}: asks the detector {}, and this program leaves detectors out; remove the parameter, and \
                     SUMO places detectors of its own",
                    Printable(what)
                );
            }
        }
        Ok(())
    }
}

/// Takes out what only measures, and refuses what must not be there. Returns whether anything was taken out.
///
/// `option` is the one of SUMO's options that names the file.
pub(super) fn clean(option: &str, file: &Path, root: &mut Element, left: &mut Left) -> Result<bool> {
    let before = root.children.len();
    root.children.retain(|child| {
        let measures = MEASURES.contains(&&*child.name);
        if measures {
            *left.counts.entry((file.display().to_string(), child.name.clone())).or_default() += 1;
            left.ids.extend(child.attribute("id").map(str::to_owned));
        }
        !measures
    });
    let is_net = root.name == "net";
    check_known(file, root, if is_net { IN_A_NET } else { IN_OTHERS })?;
    if !is_net {
        root.children.iter().try_for_each(|child| refuse_unknown_in(file, child))?;
    }
    // A net in the place of demand is another mistake, with an error of its own.
    if option == ROUTE_FILES
        && !is_net
        && let Some(child) = root.children.iter().find(|child| SKIPPED_IN_ROUTES.contains(&&*child.name))
    {
        bail!(Place { file, element: child }.fault("SUMO skips it in a route file; move it to an additional file"));
    }
    Ok(root.children.len() < before)
}

fn refuse_unknown_in(file: &Path, element: &Element) -> Result<()> {
    check_known(file, element, known_in(&element.name))?;
    element.children.iter().try_for_each(|child| refuse_unknown_in(file, child))
}

fn check_known(file: &Path, element: &Element, known: &[&str]) -> Result<()> {
    // Parameters of a car-following model may stand in an element of their own.
    let of_a_model = |child: &Element| element.name == "vType" && child.name.starts_with("carFollowing-");
    match element.children.iter().find(|child| !known.contains(&&*child.name) && !of_a_model(child)) {
        Some(child) => bail!(
            "{}: {} in {}: this program does not simulate it; remove it",
            file.display(),
            tag(child),
            tag(element)
        ),
        None => Ok(()),
    }
}
