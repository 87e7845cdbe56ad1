//! Looks of methods, the same in all charts of a report: colour, dash and marker.

use std::collections::BTreeMap;

use anyhow::Result;
use plotters::coord::CoordTranslate;
use plotters::element::DashedPathElement;
use plotters::prelude::*;

use crate::drawing::{BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILLION, pen, px};

const COLOURS: [RGBColor; 6] = [BLUE, ORANGE, GREEN, PURPLE, VERMILLION, SKY];
const DASHES: [Dash; 3] = [Dash::Solid, Dash::Dashed, Dash::Dotted];
const MARKERS: [Marker; 5] = [Marker::Circle, Marker::Square, Marker::Triangle, Marker::Diamond, Marker::Cross];

/// Methods with a colour of their own, the first word of their labels.
const METHODS: [&str; 4] = ["DIALS", "GS", "untrained-DIALS", "marginal-DIALS"];
/// What may stand behind that word, each with a dash and a marker of its own. The first one is like a bare word.
const USUAL: [&str; 9] = ["F=1M", "F=500K", "F=4M", "F=100K", "F=50K", "F=2M", "F=200K", "once", "on drift"];
const VARIANTS: usize = DASHES.len() * MARKERS.len();

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dash {
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
pub(crate) enum Marker {
    Circle,
    Square,
    Triangle,
    Diamond,
    Cross,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Look {
    pub(crate) colour: RGBColor,
    pub(crate) dash: Dash,
    pub(crate) marker: Marker,
}

impl Look {
    pub(crate) const FIRST: Look = Look { colour: COLOURS[0], dash: Dash::Solid, marker: Marker::Circle };

    /// Variant 0 has the plain colour. Variants of one shade have other dashes, as far as there are any.
    fn number(colour: usize, variant: usize) -> Look {
        let (plain, variant) = (COLOURS[colour % COLOURS.len()], variant % VARIANTS);
        let shade = match variant % DASHES.len() {
            0 => plain,
            1 => mixed(plain, WHITE, 0.4),
            _ => mixed(plain, BLACK, 0.3),
        };
        // 3 shades and 5 markers have no common divisor, so all combinations come once.
        let place = colour + variant;
        let dash = place + variant / DASHES.len();
        Look { colour: shade, dash: DASHES[dash % DASHES.len()], marker: MARKERS[place % MARKERS.len()] }
    }

    /// Returns the colour and the variant of a label. They depend on nothing else, so they are the same in every report.
    fn of(label: &str) -> (usize, usize) {
        let (word, rest) = label.split_at(label.find([' ', ',']).unwrap_or(label.len()));
        let hash = crc32fast::hash(label.as_bytes()) as usize;
        let colour = METHODS.iter().position(|&method| method == word);
        let variant = match rest.strip_prefix(' ').unwrap_or(rest) {
            "" => 0,
            rest => {
                USUAL.iter().position(|&usual| usual == rest).unwrap_or(USUAL.len() + hash % (VARIANTS - USUAL.len()))
            }
        };
        (colour.unwrap_or(METHODS.len() + hash % (COLOURS.len() - METHODS.len())), variant)
    }
}

fn mixed(colour: RGBColor, other: RGBColor, share: f64) -> RGBColor {
    let mixed = |one: u8, other: u8| (f64::from(one) + share * (f64::from(other) - f64::from(one))).round() as u8;
    RGBColor(mixed(colour.0, other.0), mixed(colour.1, other.1), mixed(colour.2, other.2))
}

pub(crate) struct Looks(BTreeMap<String, Look>);

impl Looks {
    /// The look depends on the label alone, unless an earlier label has it: then the next free one follows.
    pub(crate) fn new<'a>(labels: impl Iterator<Item = &'a str>) -> Self {
        let mut looks: BTreeMap<String, Look> = BTreeMap::new();
        for label in labels {
            if looks.contains_key(label) {
                continue;
            }
            let (colour, variant) = Look::of(label);
            let colours = colour..colour + COLOURS.len();
            let mut places =
                colours.flat_map(|colour| (variant..variant + VARIANTS).map(move |variant| (colour, variant)));
            let free = places.find_map(|(colour, variant)| {
                Some(Look::number(colour, variant)).filter(|look| looks.values().all(|taken| taken != look))
            });
            looks.insert(label.to_owned(), free.unwrap_or(Look::number(colour, variant)));
        }
        Looks(looks)
    }

    pub(crate) fn of(&self, label: &str) -> Look {
        self.0[label]
    }
}

/// Draws a line through points, `width` pixels wide.
pub(super) fn stroke<CT: CoordTranslate>(
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

/// `size`: in pixels. Our means are filled; single seeds and the paper's values are hollow.
pub(super) fn mark<CT: CoordTranslate>(
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
    fn ninety_labels_all_look_different_and_more_are_drawn_too() {
        let labels: Vec<String> = (0..100).map(|number| format!("DIALS F=1M, ppo.epochs={number}")).collect();
        let looks = Looks::new(labels.iter().map(String::as_str));
        // As bars, which have no dashes.
        let as_bar = |label: &String| (looks.of(label).colour, looks.of(label).marker);
        for (index, label) in labels.iter().enumerate().take(90) {
            let alike = labels[..index].iter().find(|other| as_bar(other) == as_bar(label));
            assert_eq!(alike, None, "{label}");
        }
        let shades = [BLUE, mixed(BLUE, WHITE, 0.4), mixed(BLUE, BLACK, 0.3)];
        assert!(shades.contains(&looks.of(&labels[3]).colour), "variants have a shade of their method's colour");
    }

    #[test]
    fn a_method_looks_the_same_in_every_report_whatever_the_company() {
        let labels = ["DIALS F=500K", "DIALS F=1M", "GS", "GS, ppo.clip=0.2", "DIALS once", "untrained-DIALS", "ants"];
        let together = Looks::new(labels.into_iter());
        for label in labels {
            assert_eq!(Looks::new([label].into_iter()).of(label), together.of(label), "{label}");
        }
        assert_eq!(together.of("DIALS F=1M"), Look::FIRST);
        assert_eq!(together.of("GS"), Look::number(1, 0));
    }

    #[test]
    fn usual_methods_never_look_alike() {
        let labels = METHODS.iter().flat_map(|word| USUAL.map(|rest| format!("{word} {rest}")));
        let looks: Vec<Look> =
            labels.map(|label| Look::of(&label)).map(|(colour, variant)| Look::number(colour, variant)).collect();
        for (index, look) in looks.iter().enumerate() {
            // Between its markers only the shade and the dash of a line are seen.
            let alike = |other: &Look| (other.colour, other.dash) == (look.colour, look.dash);
            assert!(!looks[..index].iter().any(alike), "{index}: {look:?}");
        }
    }
}
