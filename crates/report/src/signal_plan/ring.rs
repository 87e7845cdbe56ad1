//! The ring diagram of a program: its phases in their order, and what each approach sees, over a cycle.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use crate::drawing::{Area, GREEN, INK, ORANGE, Svg, anchored, pen, px, text, write, write_at};
use dials_core::base::wrapped;
use dials_core::domain::signal_sheet::{Aspect, ProgramSheet, SignalGroup};

/// Sizes in pixels.
const WIDTH: i32 = 760;
const MARGIN: i32 = 14;
const RING: i32 = 26;
const BAR: i32 = 12;
const LINE: i32 = 15;
const GAP: i32 = 8;
const AXIS: i32 = 24;
const RED_LINE: i32 = 3;

/// Letters of a name that fit into a line.
const COLUMNS: usize = 100;
/// Least width of a phase, in pixels, that has room for its number and its length.
const ROOM: f64 = 46.0;
const ROOM_FOR_A_NUMBER: f64 = 14.0;
/// Least distance between two numbers of the axis, in pixels.
const APART: f64 = 24.0;

const YIELDING: RGBColor = RGBColor(0x8f, 0xd6, 0xbf);
const RED: RGBColor = RGBColor(0xb2, 0x18, 0x2b);

/// Draws a program over one cycle. Every name stands above its bar, whole.
pub(super) fn ring(program: &ProgramSheet) -> Result<Svg> {
    let names: Vec<Vec<String>> = program.groups.iter().map(|group| wrapped(&group.name, COLUMNS)).collect();
    let of_groups: i32 = names.iter().map(|lines| lines.len() as i32 * LINE + BAR + GAP).sum();
    let height = 2 * MARGIN + RING + GAP + of_groups + AXIS;
    Svg::draw(WIDTH as u32, height as u32, |area| {
        let scale = Scale { cycle_s: f64::from(program.cycle_s.max(1)) };
        let mut begin = 0;
        let mut borders = vec![0];
        let mut y = MARGIN;
        for (number, phase) in program.phases.iter().enumerate() {
            let mut bar = |seconds: u32, colour: RGBColor| {
                let drawn = scale.bar(area, (begin, seconds), (y, RING), colour);
                begin += seconds;
                drawn
            };
            bar(phase.green_s, GREEN)?;
            bar(phase.yellow_s, ORANGE)?;
            bar(phase.all_red_s, RED)?;
            let green_px = scale.px(phase.green_s);
            let words = match green_px {
                ..ROOM_FOR_A_NUMBER => String::new(),
                ..ROOM => (number + 1).to_string(),
                _ => format!("{}: {} s", number + 1, phase.green_s),
            };
            let middle = scale.at(begin - phase.split_s()) + px(green_px / 2.0);
            let style = anchored(text(12, WHITE), HPos::Center, VPos::Center);
            area.draw_text(&words, &style, (middle, px(y + RING / 2)))?;
            borders.push(begin);
        }
        y += RING + GAP;
        let (top, mut bottom) = (MARGIN, y);
        for (group, lines) in program.groups.iter().zip(&names) {
            for line in lines {
                write(area, line, (px(MARGIN), px(y)), 11)?;
                y += LINE;
            }
            row(area, &scale, group, y)?;
            y += BAR;
            bottom = y;
            y += GAP;
        }
        axis(area, &scale, &borders, (top, bottom), y)
    })
}

/// Draws what the colours mean.
pub(super) fn legend() -> Result<Svg> {
    const WORDS: [(&str, Aspect); 4] = [
        ("green", Aspect::Green),
        ("green that yields", Aspect::YieldingGreen),
        ("yellow", Aspect::Yellow),
        ("red", Aspect::Red),
    ];
    Svg::draw(WIDTH as u32, (BAR + 2 * MARGIN) as u32, |area| {
        let scale = Scale { cycle_s: f64::from(WIDTH - 2 * MARGIN) };
        for (number, (words, aspect)) in WORDS.into_iter().enumerate() {
            let begin = 170 * number as u32;
            bar_of(area, &scale, aspect, (begin, 28), MARGIN)?;
            let place = (scale.at(begin + 36), px(MARGIN + BAR / 2));
            write_at(area, words, place, 12, (HPos::Left, VPos::Center))?;
        }
        Ok(())
    })
}

struct Scale {
    cycle_s: f64,
}

impl Scale {
    fn px(&self, seconds: u32) -> f64 {
        f64::from(seconds) / self.cycle_s * f64::from(WIDTH - 2 * MARGIN)
    }

    /// Returns the place of a second, in units.
    fn at(&self, second: u32) -> i32 {
        px(f64::from(MARGIN) + self.px(second))
    }

    /// Draws a bar: its first second and its length, and its top and its height in pixels.
    fn bar(
        &self,
        area: &Area,
        (begin, seconds): (u32, u32),
        (top, height): (i32, i32),
        colour: RGBColor,
    ) -> Result<()> {
        let corners = [(self.at(begin), px(top)), (self.at(begin + seconds), px(top + height))];
        Ok(area.draw(&Rectangle::new(corners, colour.filled()))?)
    }
}

fn row(area: &Area, scale: &Scale, group: &SignalGroup, top: i32) -> Result<()> {
    let mut begin = 0;
    for &(aspect, seconds) in &group.bars {
        bar_of(area, scale, aspect, (begin, seconds), top)?;
        begin += seconds;
    }
    Ok(())
}

/// Draws red as a thin line, so that greens also stand out when printed in grey.
fn bar_of(area: &Area, scale: &Scale, aspect: Aspect, seconds: (u32, u32), top: i32) -> Result<()> {
    let (colour, height) = match aspect {
        Aspect::Green => (GREEN, BAR),
        Aspect::YieldingGreen => (YIELDING, BAR),
        Aspect::Yellow => (ORANGE, BAR),
        Aspect::Red => (RED, RED_LINE),
    };
    scale.bar(area, seconds, (top + (BAR - height) / 2, height), colour)
}

/// Draws a line and the second at which each phase begins, and the end of the cycle.
fn axis(area: &Area, scale: &Scale, borders: &[u32], (top, bottom): (i32, i32), y: i32) -> Result<()> {
    let mut last = f64::NEG_INFINITY;
    let end = scale.px(borders[borders.len() - 1]);
    for (number, &second) in borders.iter().enumerate() {
        let x = scale.at(second);
        area.draw(&PathElement::new(vec![(x, px(top)), (x, px(bottom))], pen(INK.mix(0.35), 1)))?;
        let place = scale.px(second);
        let is_end = number + 1 == borders.len();
        if place - last < APART || !is_end && end - place < APART {
            continue;
        }
        last = place;
        let (words, side) = match (number, is_end) {
            (0, _) => (second.to_string(), HPos::Left),
            (_, true) => (format!("{second} s"), HPos::Right),
            _ => (second.to_string(), HPos::Center),
        };
        write_at(area, &words, (x, px(y)), 11, (side, VPos::Top))?;
    }
    Ok(())
}
