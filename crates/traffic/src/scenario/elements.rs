//! Which elements the files of a scenario may hold.
//!
//! What only measures is left out, and the user is told. What changes traffic in a way that this program does not know
//! is refused by its name. SUMO skips elements that it does not know; a typing error there must not go unseen.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Result, bail};

use super::ROUTE_FILES;
use super::place::Place;
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

/// Elements that this program does not simulate, and what they are.
const UNSUPPORTED: [(&str, &str); 30] = [
    ("person", "persons"),
    ("personFlow", "persons"),
    ("personTrip", "persons"),
    ("walk", "persons"),
    ("ride", "persons"),
    ("container", "containers"),
    ("containerFlow", "containers"),
    ("transport", "containers"),
    ("tranship", "containers"),
    ("stop", "stops"),
    ("busStop", "stops"),
    ("trainStop", "stops"),
    ("ptLine", "public transport lines"),
    ("containerStop", "stops"),
    ("chargingStation", "charging stations"),
    ("parkingArea", "parking areas"),
    ("parkingSpace", "parking areas"),
    ("access", "stops"),
    ("rerouter", "rerouters"),
    ("calibrator", "calibrators"),
    ("variableSpeedSign", "changing speed limits"),
    ("closingReroute", "rerouters"),
    ("WAUT", "switches between programs"),
    ("wautSwitch", "switches between programs"),
    ("wautJunction", "switches between programs"),
    ("overheadWireSegment", "overhead wires"),
    ("overheadWireClamp", "overhead wires"),
    ("tractionSubstation", "overhead wires"),
    ("railSignalConstraints", "trains"),
    ("insertionOrder", "trains"),
];

/// Elements that may stand in the root of a net.
const IN_A_NET: [&str; 10] = [
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

/// Elements that may stand in the root of other files, and in them.
const IN_OTHERS: [(&str, &[&str]); 13] = [
    ("vType", &["param"]),
    ("vTypeDistribution", &["vType", "param"]),
    ("route", &["param"]),
    ("routeDistribution", &["route", "param"]),
    ("vehicle", &["route", "routeDistribution", "param"]),
    ("trip", &["param"]),
    ("flow", &["route", "routeDistribution", "param"]),
    ("taz", &["tazSource", "tazSink", "param"]),
    ("tlLogic", &["phase", "param"]),
    ("param", &[]),
    ("location", &[]),
    ("poly", &["param"]),
    ("poi", &["param"]),
];

/// Elements that SUMO reads in additional files, and skips in route files without a word.
const SKIPPED_IN_ROUTES: [&str; 2] = ["taz", "tlLogic"];

/// What was left out of the files.
#[derive(Debug, Default)]
pub struct Left {
    /// Numbers by file and kind.
    counts: BTreeMap<(String, String), usize>,
    ids: BTreeSet<String>,
}

impl Left {
    /// Returns a sentence for each file and kind.
    pub fn told(&self) -> impl Iterator<Item = String> {
        self.counts.iter().map(|((file, kind), count)| {
            format!("{file}: {count} x <{kind}>: this program measures and writes by itself")
        })
    }

    /// Returns an error if a light in this file asks a detector that was left out.
    pub fn check_not_needed(&self, file: &Path, root: &Element) -> Result<()> {
        for light in root.all("tlLogic") {
            let asked =
                light.all("param").find(|param| param.attribute("value").is_some_and(|id| self.ids.contains(id)));
            if let Some(param) = asked {
                let place = Place::new(file, light);
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
pub fn clean(option: &str, file: &Path, root: &mut Element, left: &mut Left) -> Result<bool> {
    let before = root.children.len();
    root.children.retain(|child| {
        let measures = MEASURES.contains(&&*child.name);
        if measures {
            *left.counts.entry((file.display().to_string(), child.name.clone())).or_default() += 1;
            left.ids.extend(child.attribute("id").map(str::to_owned));
        }
        !measures
    });
    refuse_unsupported(file, root)?;
    refuse_unknown(file, root)?;
    // A net in the place of demand is another mistake, with an error of its own.
    if option == ROUTE_FILES && root.name != "net" {
        refuse_skipped(file, root)?;
    }
    Ok(root.children.len() < before)
}

fn refuse_unsupported(file: &Path, element: &Element) -> Result<()> {
    for child in &element.children {
        if let Some((_, what)) = UNSUPPORTED.iter().find(|(name, _)| *name == child.name) {
            let inside = match element.attribute("id") {
                Some(_) => format!(
                    " in <{}",
                    Place::new(file, element).to_string().split_once(": <").map_or("", |(_, tag)| tag)
                ),
                None => String::new(),
            };
            bail!("{}{inside}: this program does not simulate {what}; remove it", Place::new(file, child));
        }
        refuse_unsupported(file, child)?;
    }
    Ok(())
}

fn refuse_skipped(file: &Path, root: &Element) -> Result<()> {
    match root.children.iter().find(|child| SKIPPED_IN_ROUTES.contains(&&*child.name)) {
        Some(child) => {
            Err(Place::new(file, child).fault("SUMO skips it in a route file; move it to an additional file"))
        }
        None => Ok(()),
    }
}

fn refuse_unknown(file: &Path, root: &Element) -> Result<()> {
    let unknown = |child| Place::new(file, child).fault("is no element that this program knows here; remove it");
    for child in &root.children {
        if root.name == "net" {
            if !IN_A_NET.contains(&&*child.name) {
                return Err(unknown(child));
            }
            continue;
        }
        let Some((_, inside)) = IN_OTHERS.iter().find(|(name, _)| *name == child.name) else {
            return Err(unknown(child));
        };
        for inner in &child.children {
            // Parameters of a car-following model may stand in an element of their own.
            let of_a_model = child.name == "vType" && inner.name.starts_with("carFollowing-");
            if !inside.contains(&&*inner.name) && !of_a_model {
                return Err(unknown(inner));
            }
        }
    }
    Ok(())
}
