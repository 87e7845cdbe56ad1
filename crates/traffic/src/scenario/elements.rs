//! What becomes of the elements of a scenario's files. What only measures, writes or decorates is left out, with a note. All
//! else goes to SUMO as it stands.

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::path::Path;
use std::sync::LazyLock;

use super::reading::ROUTE_FILES;
use crate::network::other_files::{NOWHERE, names_a_file, reads_emissions};
use crate::network::tree::Element;
use dials_core::outside::excerpt;

const MEASURES: &str = "edgeData laneData inductionLoop e1Detector instantInductionLoop laneAreaDetector e2Detector \
                        entryExitDetector e3Detector vTypeProbe routeProbe timedEvent edgeProbe laneProbe";

/// Attributes that name a picture, or a file that is written.
const DECORATES: [&str; 3] = ["imgFile", "osgFile", "output"];

/// Root of a file with settings of sumo-gui.
const VIEW: &str = "viewsettings";

/// Elements that SUMO reads in additional files, and skips in route files without a word.
const SKIPPED_IN_ROUTES: &str = "taz tlLogic WAUT wautJunction rerouter calibrator variableSpeedSign busStop trainStop \
                                 containerStop chargingStation parkingArea";

/// All elements that SUMO 1.28 reads in nets, additional files and route files, and those that editors leave there.
const KNOWN: &str = "location type restriction edge lane neigh stopOffset tlLogic phase condition assignment function junction request \
     connection crossing roundabout prohibition param poly poi vType vTypeDistribution route routeDistribution vehicle trip \
     flow interval person personFlow container containerFlow walk ride personTrip tranship transport stop taz tazSource \
     tazSink busStop trainStop containerStop chargingStation parkingArea parkingSpace space access overheadWireSegment \
     overheadWireClamp overheadWire tractionSubstation rerouter closingReroute closingLaneReroute routeProbReroute \
     destProbReroute parkingAreaReroute stationReroute viaProbReroute variableSpeedSign step calibrator WAUT wautSwitch \
     wautJunction railSignalConstraints predecessor insertionPredecessor foeInsertion insertionOrder bidiPredecessor split \
     detEntry detExit e3Detector via delay viewport include transition cell jupedsim deadlock";

static KNOWN_NAMES: LazyLock<HashSet<&str>> = LazyLock::new(|| KNOWN.split_whitespace().collect());

fn is_one_of(names: &str, element: &Element) -> bool {
    names.split_whitespace().any(|name| name == element.name)
}

/// Adds the names that lights and calibrators ask for, among which may be detectors.
pub(super) fn asked_for(root: &Element, found: &mut BTreeSet<String>) {
    for element in &root.children {
        if element.name == "tlLogic" {
            words_below(element, found);
        }
        found.extend(element.attribute("routeProbe").or_else(|| element.attribute("probe")).map(str::to_owned));
    }
}

/// Adds all words of an element's attributes: detectors stand in parameters, phases and expressions, such as `z:LOOP > 3`.
fn words_below(element: &Element, found: &mut BTreeSet<String>) {
    for (_, text) in &element.attributes {
        found.insert(text.clone());
        for word in text.split(|letter: char| !is_of_name(letter)) {
            found.insert(word.to_owned());
            found.extend(word.split_once(':').map(|(_, name)| name.to_owned()));
        }
    }
    element.children.iter().for_each(|child| words_below(child, found));
}

fn is_of_name(letter: char) -> bool {
    letter.is_alphanumeric() || "_-#.:".contains(letter)
}

/// What was taken out, counted by file and kind.
#[derive(Debug, Default)]
pub(super) struct Left {
    counts: BTreeMap<(String, String, &'static str), usize>,
}

const BY_ITSELF: &str = "this program measures and writes by itself";
const PICTURE: &str = "it is only for pictures, or for outputs";
const NOT_MEASURED: &str = "emissions are not measured";
const SKIPPED: &str = "SUMO skips it in a route file; move it to an additional file";
const UNKNOWN: &str = "SUMO does not know this element";

impl Left {
    pub(super) fn sentences(&self) -> impl Iterator<Item = String> {
        self.counts.iter().map(|((file, kind, why), count)| format!("{file}: {count} x {kind}: {why}"))
    }

    fn count(&mut self, file: &Path, kind: String, why: &'static str) {
        *self.counts.entry((file.display().to_string(), kind, why)).or_default() += 1;
    }
}

/// Takes out what is not needed, and notes what SUMO would skip. Returns whether anything was taken out. `option`: the one of
/// SUMO's that names the file. `asked`: names of detectors that must stay; they write nowhere.
pub(super) fn clean(option: &str, file: &Path, root: &mut Element, asked: &BTreeSet<String>, left: &mut Left) -> bool {
    let before = root.children.len();
    if root.name == VIEW {
        root.children.clear();
        left.count(file, format!("<{VIEW}>"), PICTURE);
    }
    for child in &root.children {
        if option == ROUTE_FILES && is_one_of(SKIPPED_IN_ROUTES, child) {
            left.count(file, format!("<{}>", excerpt(&child.name)), SKIPPED);
        }
    }
    let is_changed = root.children.len() < before;
    clean_below(file, root, asked, left) || is_changed
}

/// Takes out detectors, and parameters and attributes that say where something is written, or how it looks. Returns whether
/// there were some. SUMO reads detectors wherever they stand.
fn clean_below(file: &Path, element: &mut Element, asked: &BTreeSet<String>, left: &mut Left) -> bool {
    let before = (element.children.len(), element.attributes.len());
    let mut has_asked = false;
    element.children.retain_mut(|child| {
        if !is_one_of(MEASURES, child) {
            return true;
        }
        let is_asked = child.attribute("id").is_some_and(|id| asked.contains(id));
        if is_asked {
            has_asked = true;
            child.attributes.retain(|(key, _)| key != "file" && key != "output");
            child.attributes.push(("file".to_owned(), NOWHERE.to_owned()));
        } else {
            left.count(file, format!("<{}>", child.name), BY_ITSELF);
        }
        is_asked
    });
    element.children.retain(|child| {
        let key = child.attribute("key").filter(|key| child.name == "param" && names_a_file(key));
        if let Some(key) = key {
            left.count(file, format!("<param key=\"{}\">", excerpt(key)), BY_ITSELF);
        }
        key.is_none()
    });
    let name = &element.name;
    element.attributes.retain(|(key, value)| {
        let why = match &**key {
            key if DECORATES.contains(&key) => PICTURE,
            "emissionClass" if reads_emissions(value) => NOT_MEASURED,
            _ => return true,
        };
        left.count(file, format!("{key} of <{}>", excerpt(name)), why);
        false
    });
    let is_changed = has_asked || (element.children.len(), element.attributes.len()) != before;
    element.children.iter_mut().fold(is_changed, |changed, child| {
        if !KNOWN_NAMES.contains(&*child.name) && !child.name.starts_with("carFollowing-") {
            left.count(file, format!("<{}>", excerpt(&child.name)), UNKNOWN);
        }
        clean_below(file, child, asked, left) || changed
    })
}
