//! The legend of a chart: entries with a sample and a label.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::look::{Dash, Look, mark, stroke};
use crate::base::wrapped;
use crate::drawing::{Area, INK, ink_over, px, text};

const SIZE: f64 = 12.0;
const LINE_HEIGHT: f64 = 16.0;
/// Largest number of characters in a line.
const WRAP: usize = 29;

/// Sample before a label.
#[derive(Clone, Copy)]
pub enum LegendSample {
    /// A curve with its markers.
    Curve(Look),
    /// A line across the chart.
    Level(RGBColor, Dash),
    /// A hollow marker.
    Hollow(Look),
    /// A bar with its marker.
    Bar(Look),
    Nothing,
}

pub struct LegendEntry {
    pub sample: LegendSample,
    pub label: String,
}

/// Draws entries from the top of an area.
pub fn draw(area: &Area, entries: &[LegendEntry]) -> Result<()> {
    let mut y = px(10.0);
    for entry in entries {
        let (left, right, middle) = (px(4.0), px(32.0), px(18.0));
        match entry.sample {
            LegendSample::Curve(look) => {
                stroke(area, vec![(left, y), (right, y)], (look.colour.to_rgba(), look.dash), 2.0)?;
                mark(area, (middle, y), look, 8.0, true)?;
            }
            LegendSample::Level(colour, dash) => {
                stroke(area, vec![(left, y), (right, y)], (colour.to_rgba(), dash), 1.5)?;
            }
            LegendSample::Hollow(look) => mark(area, (middle, y), look, 9.0, false)?,
            LegendSample::Bar(look) => {
                let corners = [(left + px(6.0), y - px(6.0)), (right - px(6.0), y + px(6.0))];
                area.draw(&Rectangle::new(corners, look.colour.filled()))?;
                let over = ink_over(look.colour);
                mark(area, (middle, y), Look { colour: over, ..look }, 7.0, true)?;
            }
            LegendSample::Nothing => {}
        }
        for line in wrapped(&entry.label, WRAP) {
            let style = text(SIZE, INK).pos(Pos::new(HPos::Left, VPos::Center));
            area.draw(&Text::new(line, (px(40.0), y), style))?;
            y += px(LINE_HEIGHT);
        }
        y += px(5.0);
    }
    Ok(())
}

/// Returns the height of the entries in pixels.
pub fn height(entries: &[LegendEntry]) -> u32 {
    let lines: usize = entries.iter().map(|entry| wrapped(&entry.label, WRAP).len()).sum();
    (lines as f64 * LINE_HEIGHT + entries.len() as f64 * 5.0 + 20.0) as u32
}
