//! Lines in the coordinates of a net.

use anyhow::Result;

use super::Place;
use super::attributes::wrong;
use crate::network::tree::Element;

/// Returns the points of the attribute `shape`. Without the attribute there are none. Heights are left out.
pub(super) fn shape(element: &Element) -> Result<Vec<Place>> {
    let written = element.attribute("shape").unwrap_or_default();
    let points: Option<Vec<Place>> = written.split_whitespace().map(point).collect();
    points.ok_or_else(|| wrong(element, "shape", "must be points such as `0.5,10 20,30`"))
}

fn point(written: &str) -> Option<Place> {
    let numbers: Vec<f64> = written.split(',').map(|number| number.parse().ok()).collect::<Option<_>>()?;
    let finite = numbers.iter().all(|number: &f64| number.is_finite());
    match numbers[..] {
        [x, y] | [x, y, _] if finite => Some([x, y]),
        _ => None,
    }
}
