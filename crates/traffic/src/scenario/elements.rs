//! Which elements the files of a scenario may hold.
//!
//! What only measures is left out, with a note. Everything else that this program does not know is refused: it may change
//! traffic in a way that local simulators do not have, or SUMO skips it, as a typing error.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Result, bail, ensure};

use super::ROUTE_FILES;
use crate::network::other_files::names_an_output;
use crate::network::roads::attributes::tag;
use crate::network::tree::Element;
use dials_core::outside::{Printable, excerpt};

const MEASURES: &str = "edgeData laneData inductionLoop e1Detector instantInductionLoop laneAreaDetector e2Detector \
                        entryExitDetector e3Detector vTypeProbe routeProbe timedEvent";

/// Elements that may stand in the root of a net. The last one is an area in the picture.
const IN_A_NET: &str = "location type edge tlLogic junction connection roundabout prohibition param poly";

const IN_OTHERS: &str =
    "vType vTypeDistribution route routeDistribution vehicle trip flow taz tlLogic param location poly poi";

/// Elements that SUMO reads in additional files, and skips in route files without a word.
const SKIPPED_IN_ROUTES: &str = "taz tlLogic";

fn known_in(element: &str) -> &'static str {
    match element {
        "vTypeDistribution" => "vType param",
        "routeDistribution" => "route param",
        "vehicle" | "flow" => "route routeDistribution param",
        "taz" => "tazSource tazSink param",
        "tlLogic" => "phase param",
        _ => "param",
    }
}

fn is_one_of(names: &str, element: &Element) -> bool {
    names.split(' ').any(|name| name == element.name)
}

#[derive(Debug, Default)]
pub(super) struct Left {
    counts: BTreeMap<(String, String), usize>,
    ids: BTreeSet<String>,
}

impl Left {
    pub(super) fn sentences(&self) -> impl Iterator<Item = String> {
        self.counts.iter().map(|((file, kind), count)| {
            format!("{file}: {count} x <{kind}>: this program measures and writes by itself")
        })
    }

    /// Returns an error if a light in this file asks a detector that was left out.
    pub(super) fn check_not_needed(&self, file: &Path, root: &Element) -> Result<()> {
        for light in root.all("tlLogic") {
            let mut asked = light.all("param").filter_map(|param| param.attribute("value"));
            if let Some(detector) = asked.find(|id| self.ids.contains(*id)) {
                bail!(
                    "{}: {}: asks the detector {}, and this program leaves detectors out; remove the parameter, and \
                     SUMO places detectors of its own",
                    file.display(),
                    tag(light),
                    Printable(detector)
                );
            }
        }
        Ok(())
    }
}

/// Takes out what only measures, and refuses what must not be there. Returns whether anything was taken out. `option`:
/// the one of SUMO's that names the file.
pub(super) fn clean(option: &str, file: &Path, root: &mut Element, left: &mut Left) -> Result<bool> {
    let before = root.children.len();
    root.children.retain(|child| {
        let measures = is_one_of(MEASURES, child);
        if measures {
            *left.counts.entry((file.display().to_string(), child.name.clone())).or_default() += 1;
            left.ids.extend(child.attribute("id").map(str::to_owned));
        }
        !measures
    });
    let writes = leave_outputs_out(file, root, left);
    let is_changed = writes || root.children.len() < before;
    if root.name == "net" {
        check_known(file, root, IN_A_NET)?;
        return Ok(is_changed);
    }
    check_known(file, root, IN_OTHERS)?;
    root.children.iter().try_for_each(|child| check_within(file, child))?;
    let is_skipped = |child: &&Element| option == ROUTE_FILES && is_one_of(SKIPPED_IN_ROUTES, child);
    if let Some(child) = root.children.iter().find(is_skipped) {
        bail!("{}: {}: SUMO skips it in a route file; move it to an additional file", file.display(), tag(child));
    }
    Ok(is_changed)
}

/// Takes out parameters that only say where something is written. Returns whether there were some.
fn leave_outputs_out(file: &Path, element: &mut Element, left: &mut Left) -> bool {
    let before = element.children.len();
    element.children.retain(|child| {
        let key = child.attribute("key").filter(|key| child.name == "param" && names_an_output(key));
        if let Some(key) = key {
            let kind = format!("param key=\"{}\"", excerpt(key));
            *left.counts.entry((file.display().to_string(), kind)).or_default() += 1;
        }
        key.is_none()
    });
    let is_shorter = element.children.len() < before;
    element.children.iter_mut().fold(is_shorter, |changed, child| leave_outputs_out(file, child, left) || changed)
}

fn check_within(file: &Path, element: &Element) -> Result<()> {
    check_known(file, element, known_in(&element.name))?;
    element.children.iter().try_for_each(|child| check_within(file, child))
}

fn check_known(file: &Path, element: &Element, known: &str) -> Result<()> {
    // Parameters of a car-following model may stand in an element of their own.
    let of_a_model = |child: &Element| element.name == "vType" && child.name.starts_with("carFollowing-");
    for child in &element.children {
        ensure!(
            is_one_of(known, child) || of_a_model(child),
            "{}: {} in {}: this program does not simulate it; remove it",
            file.display(),
            tag(child),
            tag(element)
        );
    }
    Ok(())
}
