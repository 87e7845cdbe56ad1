//! Vehicle types and their classes.

use std::collections::HashMap;

use anyhow::{Result, bail, ensure};

use super::super::place::Place;
use super::Demand;
use crate::config::sumocfg::refused_parameter;
use dials_core::outside::excerpt;

/// Types that SUMO knows by itself, with their classes. A file may define them anew.
const PREDEFINED: [(&str, &str); 6] = [
    ("DEFAULT_VEHTYPE", "passenger"),
    ("DEFAULT_PEDTYPE", "pedestrian"),
    ("DEFAULT_BIKETYPE", "bicycle"),
    ("DEFAULT_TAXITYPE", "taxi"),
    ("DEFAULT_RAILTYPE", "rail"),
    ("DEFAULT_CONTAINERTYPE", "container"),
];

/// Classes of what does not drive on roads.
const NOT_ON_ROADS: [&str; 8] =
    ["tram", "rail_urban", "rail", "rail_electric", "rail_fast", "ship", "pedestrian", "container"];

/// Numbers of a type and the limits beyond which they are absurd.
const NUMBERS: [(&str, f64, f64); 10] = [
    ("length", 0.1, 200.0),
    ("minGap", 0.0, 100.0),
    ("width", 0.1, 20.0),
    ("maxSpeed", 0.1, 300.0),
    ("accel", 0.01, 100.0),
    ("decel", 0.01, 100.0),
    ("sigma", 0.0, 1.0),
    ("tau", 0.0, 100.0),
    ("speedDev", 0.0, 10.0),
    ("probability", 0.0, 1e9),
];

/// Class of a type that names none.
const DEFAULT_CLASS: &str = "passenger";

pub fn predefined<'a>() -> HashMap<&'a str, Option<&'a str>> {
    PREDEFINED.into_iter().map(|(id, class)| (id, Some(class))).collect()
}

/// Returns an error if a parameter of a type, vehicle or flow gives it a device that is refused as an option, too.
pub(super) fn refuse_devices(place: Place<'_>) -> Result<()> {
    for parameter in place.element.all("param") {
        let attribute = |key: &str| parameter.attribute(key).unwrap_or_default();
        if let Some(why) = refused_parameter(attribute("key"), attribute("value")) {
            bail!(place.fault(format!("<param key=\"{}\">: {why}; remove it", excerpt(attribute("key")))));
        }
    }
    Ok(())
}

impl<'a> Demand<'a> {
    pub(super) fn add_type(&mut self, place: Place<'a>) -> Result<()> {
        for (key, least, most) in NUMBERS {
            place.number(key, least, most)?;
        }
        refuse_devices(place)?;
        let class = place.element.attribute("vClass").unwrap_or(DEFAULT_CLASS);
        self.add_class(place, Some(class))
    }

    pub(super) fn add_types(&mut self, place: Place<'a>) -> Result<()> {
        let mut classes = Vec::new();
        for inner in place.element.all("vType") {
            let inner = place.within(inner);
            self.add_type(inner)?;
            classes.push(self.types[inner.needed("id")?]);
        }
        for id in place.element.attribute("vTypes").unwrap_or_default().split_ascii_whitespace() {
            let class = self.types.get(id).copied();
            classes.push(
                class.ok_or_else(|| place.fault(format!("vTypes: no type {} is defined before it", excerpt(id))))?,
            );
        }
        ensure!(!classes.is_empty(), place.fault("holds no type; add one or remove it"));
        let first = classes[0];
        let strange = classes.iter().flatten().find(|class| NOT_ON_ROADS.contains(class)).copied();
        self.add_class(place, strange.or(first.filter(|_| classes.iter().all(|class| *class == first))))
    }

    fn add_class(&mut self, place: Place<'a>, class: Option<&'a str>) -> Result<()> {
        let id = place.needed("id")?;
        let is_new = self.types.insert(id, class).is_none();
        let is_predefined = PREDEFINED.iter().any(|(predefined, _)| *predefined == id);
        ensure!(is_new || is_predefined, place.fault("a type of this id is defined twice; remove one of them"));
        Ok(())
    }

    /// Returns the class of a vehicle. One that does not drive on roads is an error.
    pub(super) fn class_of(&self, place: Place<'a>) -> Result<Option<&'a str>> {
        let id = place.element.attribute("type").unwrap_or(PREDEFINED[0].0);
        let class = self.types.get(id).copied();
        let class = class.ok_or_else(|| {
            place.fault_in(
                "type",
                "no type of this id is defined before it; define it in this file or an additional file",
            )
        })?;
        if let Some(strange) = class.filter(|class| NOT_ON_ROADS.contains(class)) {
            return Err(
                place.fault_in("type", format!("its class is {strange}, and this program simulates roads; remove it"))
            );
        }
        Ok(class)
    }
}
