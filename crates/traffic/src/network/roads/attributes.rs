//! Numbers and names out of an element. Every error names the element, its id and the attribute.

use std::str::FromStr;

use anyhow::{Error, Result, anyhow};

use crate::config::sumo_time::seconds;
use crate::network::tree::Element;
use dials_core::outside::excerpt;

/// Returns the tag of an element with what identifies it, such as `<lane id="a_0">`.
pub(crate) fn tag(element: &Element) -> String {
    let keys = match element.name.as_str() {
        "connection" => &["from", "fromLane", "to", "toLane"][..],
        "request" => &["index"],
        "phase" => &["state"],
        _ => &["id"],
    };
    let known = keys.iter().filter_map(|key| Some(format!(" {key}=\"{}\"", excerpt(element.attribute(key)?))));
    format!("<{}{}>", excerpt(&element.name), known.collect::<String>())
}

pub(crate) fn wrong(element: &Element, name: &str, why: &str) -> Error {
    match element.attribute(name) {
        Some(value) => anyhow!("{}: {name}=\"{}\": {why}", tag(element), excerpt(value)),
        None => anyhow!("{}: has no attribute {name}; {why}", tag(element)),
    }
}

pub(crate) fn text<'a>(element: &'a Element, name: &str) -> Result<&'a str> {
    element.attribute(name).ok_or_else(|| wrong(element, name, "every net of netconvert has it"))
}

/// Returns a number that must be there, finite and at least `least`.
pub(crate) fn number(element: &Element, name: &str, least: f64) -> Result<f64> {
    let value = f64::from_str(text(element, name)?).ok().filter(|value| value.is_finite() && *value >= least);
    let limit = if least.is_finite() { format!(" of at least {least}") } else { String::new() };
    value.ok_or_else(|| wrong(element, name, &format!("must be a number{limit}")))
}

/// Returns a time in seconds that must be there, at least `least`. SUMO also reads a clock, such as 00:00:30.
pub(crate) fn time(element: &Element, name: &str, least: f64) -> Result<f64> {
    let text = text(element, name)?;
    if !text.contains(':') {
        return number(element, name, least);
    }
    let time = seconds(text).ok().filter(|time| *time >= least);
    time.ok_or_else(|| wrong(element, name, "must be a time such as 30 or 00:00:30"))
}

pub(crate) fn time_if_there(element: &Element, name: &str, least: f64) -> Result<Option<f64>> {
    element.attribute(name).map(|_| time(element, name, least)).transpose()
}

pub(crate) fn count(element: &Element, name: &str) -> Result<usize> {
    text(element, name)?.parse().map_err(|_| wrong(element, name, "must be a whole number of at least 0"))
}
