//! The legend of a chart: entries with a sample and a label.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use super::look::{Dash, Look, mark, stroke};
use crate::drawing::{Area, ink_over, px, write_at};
use dials_core::base::wrapped;

const SIZE: f64 = 12.0;
const LINE_HEIGHT: f64 = 16.0;
const WRAP: usize = 29;

/// Sample before a label.
#[derive(Clone, Copy)]
pub(super) enum LegendSample {
    Curve(Look),
    /// A line across the chart.
    Level(RGBColor, Dash),
    Mark(Look),
    Hollow(Look),
    Bar(Look),
    Nothing,
}

pub(super) struct LegendEntry {
    pub(crate) sample: LegendSample,
    pub(crate) label: String,
}

impl LegendEntry {
    pub(super) fn new(sample: LegendSample, label: &str) -> LegendEntry {
        LegendEntry { sample, label: label.to_owned() }
    }

    /// Returns the entry of a note under the others; `None` for an empty one.
    pub(super) fn of_note(note: &str) -> Option<LegendEntry> {
        (!note.is_empty()).then(|| LegendEntry::new(LegendSample::Nothing, note))
    }
}

pub(super) fn draw(area: &Area, entries: &[LegendEntry]) -> Result<()> {
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
            LegendSample::Mark(look) => mark(area, (middle, y), look, 9.0, true)?,
            LegendSample::Hollow(look) => mark(area, (middle, y), look, 9.0, false)?,
            LegendSample::Bar(look) => {
                let corners = [(left + px(6.0), y - px(6.0)), (right - px(6.0), y + px(6.0))];
                area.draw(&Rectangle::new(corners, look.colour.filled()))?;
                let over = ink_over(look.colour);
                mark(area, (middle, y), Look { colour: over, ..look }, 7.0, true)?;
            }
            LegendSample::Nothing => {}
        }
        for line in in_lines(&entry.label, WRAP) {
            write_at(area, &line, (px(40.0), y), SIZE, (HPos::Left, VPos::Center))?;
            y += px(LINE_HEIGHT);
        }
        y += px(5.0);
    }
    Ok(())
}

/// Returns the height of the entries in pixels.
pub(super) fn height(entries: &[LegendEntry]) -> u32 {
    let lines: usize = entries.iter().map(|entry| in_lines(&entry.label, WRAP).len()).sum();
    (lines as f64 * LINE_HEIGHT + entries.len() as f64 * 5.0 + 20.0) as u32
}

/// Most lines of a label. What is missing then is in the tables of the report.
const MOST_LINES: usize = 5;

/// Breaks a label into a few lines of at most `characters` characters: at blanks, and within longer words.
pub(super) fn in_lines(label: &str, characters: usize) -> Vec<String> {
    let words: Vec<String> = label.split(' ').map(|word| cut(word, characters)).collect();
    let mut lines = wrapped(&words.join(" "), characters);
    if lines.len() > MOST_LINES {
        lines.truncate(MOST_LINES);
        let last = &mut lines[MOST_LINES - 1];
        *last = last.chars().take(characters - 4).collect::<String>() + " ...";
    }
    lines
}

/// Puts blanks into a word that is too long, after its punctuation if it has some.
fn cut(word: &str, characters: usize) -> String {
    let (mut text, mut rest) = (String::new(), word);
    while let Some((limit, _)) = rest.char_indices().nth(characters) {
        let end = rest[..limit].rfind(['.', '=', ',', '_', '-', '/']).map_or(limit, |place| place + 1);
        text += &rest[..end];
        text.push(' ');
        rest = &rest[end..];
    }
    text + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_label_is_wider_or_longer_than_its_place() {
        assert_eq!(in_lines("DIALS F=1M (3 runs)", 29), ["DIALS F=1M (3 runs)"]);
        assert_eq!(
            in_lines("GS, local_simulators.copies_of_each=1, ppo.clip=0.2", 29),
            ["GS,", "local_simulators.copies_of_", "each=1, ppo.clip=0.2"]
        );
        let many: Vec<String> = (0..40).map(|number| format!("ü{number}{}", "x".repeat(number))).collect();
        let lines = in_lines(&many.join(", "), 29);
        assert!(lines.len() == MOST_LINES && lines[MOST_LINES - 1].ends_with(" ..."), "{lines:?}");
        assert!(lines.iter().all(|line| line.chars().count() <= 29), "{lines:?}");
    }
}
