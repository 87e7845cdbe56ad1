//! Looks of methods, the same in all charts of a report: colour, dash and marker.

use std::collections::BTreeMap;

use anyhow::Result;
use plotters::coord::CoordTranslate;
use plotters::element::DashedPathElement;
use plotters::prelude::*;

use crate::drawing::{BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION, pen, px};

const COLOURS: [RGBColor; 6] = [BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY];

/// Methods with a look of their own, the first word of their labels.
const METHODS: [&str; 4] = ["DIALS", "GS", "untrained-DIALS", "marginal-DIALS"];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dash {
    Solid,
    Dashed,
    Dotted,
    /// Only for levels from the paper; our lines never have it.
    Long,
    /// These two are for levels only, to tell controllers apart.
    Short,
    Sparse,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Marker {
    Circle,
    Square,
    Triangle,
    Diamond,
    Cross,
}

/// Colour, dash and marker.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Look {
    pub colour: RGBColor,
    pub dash: Dash,
    pub marker: Marker,
}

impl Look {
    pub const FIRST: Look = Look { colour: COLOURS[0], dash: Dash::Solid, marker: Marker::Circle };

    /// Returns a look by its number. The first 18 differ in colour or dash, the first 30 if markers count too.
    fn number(index: usize) -> Look {
        const DASHES: [Dash; 3] = [Dash::Solid, Dash::Dashed, Dash::Dotted];
        const MARKERS: [Marker; 5] = [Marker::Circle, Marker::Square, Marker::Triangle, Marker::Diamond, Marker::Cross];
        Look { colour: COLOURS[index % 6], dash: DASHES[(index + index / 6) % 3], marker: MARKERS[index % 5] }
    }
}

/// The look of each label of a report, the same in all its charts.
pub struct Looks(BTreeMap<String, Look>);

impl Looks {
    /// Gives a look to each label. A repeated label keeps its first look.
    ///
    /// The first label of each of [`METHODS`] has the look of its method, in every report. The others get the looks that
    /// are left, in order.
    pub fn new<'a>(labels: impl Iterator<Item = &'a str>) -> Self {
        let mut looks = BTreeMap::new();
        let mut taken = [false; METHODS.len()];
        let mut left = METHODS.len()..;
        for label in labels {
            if looks.contains_key(label) {
                continue;
            }
            let word = label.split([' ', ',']).next().unwrap_or_default();
            let method = METHODS.iter().position(|&method| method == word).filter(|&method| !taken[method]);
            method.into_iter().for_each(|method| taken[method] = true);
            let number = method.or_else(|| left.next()).expect("numbers never end");
            looks.insert(label.to_owned(), Look::number(number));
        }
        Looks(looks)
    }

    pub fn of(&self, label: &str) -> Look {
        self.0[label]
    }
}

/// Draws a line through points, `width` pixels wide.
pub fn stroke<CT: CoordTranslate>(
    area: &DrawingArea<SVGBackend<'_>, CT>,
    points: Vec<CT::From>,
    look: (RGBAColor, Dash),
    width: f64,
) -> Result<()>
where
    CT::From: Clone + 'static,
{
    let style = pen(look.0, width);
    match look.1 {
        Dash::Solid => area.draw(&PathElement::new(points, style)),
        Dash::Dashed => area.draw(&DashedPathElement::new(points, px(7.0), px(4.0), style)),
        Dash::Long => area.draw(&DashedPathElement::new(points, px(14.0), px(3.0), style)),
        Dash::Short => area.draw(&DashedPathElement::new(points, px(4.0), px(2.0), style)),
        Dash::Sparse => area.draw(&DashedPathElement::new(points, px(5.0), px(9.0), style)),
        Dash::Dotted => area.draw(&DashedPathElement::new(points, px(1.6), px(2.6), style)),
    }?;
    Ok(())
}

/// Draws a marker around a place, `size` pixels wide. Our means are filled; single seeds and the paper's values are
/// hollow.
pub fn mark<CT: CoordTranslate>(
    area: &DrawingArea<SVGBackend<'_>, CT>,
    at: CT::From,
    look: Look,
    size: f64,
    filled: bool,
) -> Result<()>
where
    CT::From: Clone,
{
    let half = px(size / 2.0);
    let outline = pen(look.colour, 1.4);
    let style = if filled { look.colour.filled() } else { outline };
    let corners = |corners: &[(f64, f64)]| -> Vec<(i32, i32)> {
        corners.iter().map(|(x, y)| ((x * f64::from(half)) as i32, (y * f64::from(half)) as i32)).collect()
    };
    let shape = match look.marker {
        Marker::Circle => {
            let circle = EmptyElement::at(at) + Circle::new((0, 0), half, style);
            return Ok(area.draw(&circle)?);
        }
        Marker::Cross => {
            let thick = pen(look.colour, 1.8);
            let cross = EmptyElement::at(at)
                + PathElement::new(corners(&[(-0.9, -0.9), (0.9, 0.9)]), thick)
                + PathElement::new(corners(&[(-0.9, 0.9), (0.9, -0.9)]), thick);
            return Ok(area.draw(&cross)?);
        }
        Marker::Square => corners(&[(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9), (-0.9, -0.9), (0.9, -0.9)]),
        Marker::Triangle => corners(&[(0.0, -1.1), (1.05, 0.8), (-1.05, 0.8), (0.0, -1.1), (1.05, 0.8)]),
        Marker::Diamond => corners(&[(0.0, -1.2), (1.0, 0.0), (0.0, 1.2), (-1.0, 0.0), (0.0, -1.2), (1.0, 0.0)]),
    };
    match filled {
        true => area.draw(&(EmptyElement::at(at) + Polygon::new(shape, style))),
        false => area.draw(&(EmptyElement::at(at) + PathElement::new(shape, style))),
    }?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thirty_methods_all_look_different() {
        let looks: Vec<Look> = (0..30).map(Look::number).collect();
        for (index, look) in looks.iter().enumerate() {
            assert!(!looks[..index].contains(look), "{index}: {look:?}");
            let as_line = |look: &Look| (look.colour, look.dash);
            let same_line = looks[..index].iter().any(|other| as_line(other) == as_line(look));
            assert!(index >= 18 || !same_line, "{index}: {look:?}");
        }
    }

    #[test]
    fn a_label_looks_the_same_wherever_it_comes() {
        let looks = Looks::new(["GS", "DIALS F=1M", "GS", "DIALS F=2M", "GS, ppo.clip=0.2"].into_iter());
        assert_eq!([looks.of("DIALS F=1M"), looks.of("GS")], [0, 1].map(Look::number));
        assert_eq!([looks.of("DIALS F=2M"), looks.of("GS, ppo.clip=0.2")], [4, 5].map(Look::number));
        let other = Looks::new(["untrained-DIALS", "DIALS F=62.5K"].into_iter());
        assert_eq!(other.of("DIALS F=62.5K"), looks.of("DIALS F=1M"), "in another report, too");
        assert_eq!(other.of("untrained-DIALS"), Look::number(2));
    }
}
