//! Heat maps of agents on their grid: a panel per run, a cell per agent, shaded by its return; a cross: stuck.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use crate::drawing::{
    Area, SCALE, Svg, anchored, ends_of, ink_over, pen, px, shade_of, shortened, text, text_width, widened, write,
    write_at,
};
use crate::words::figure;

const PANEL: u32 = 128;
const GAP: u32 = 16;
const ROW_LABEL: u32 = 22;
const PANEL_LABEL: u32 = 18;
const TITLE: u32 = 30;
const KEY: u32 = 46;
const MARGIN: u32 = 12;
/// Largest number of panels side by side.
const MOST_COLUMNS: usize = 6;
/// Largest number of characters of a row's label.
const LONGEST_LABEL: usize = 110;
/// Smallest side, in pixels, of a cell with a number in it.
const NUMBER_FROM: f64 = 22.0;

/// Agents in rows, seen from above, with the top row first.
pub(crate) struct Panel {
    pub(crate) label: String,
    /// Value of each agent, and whether it is stuck.
    pub(crate) rows: Vec<Vec<(f64, bool)>>,
}

pub(crate) struct HeatMap {
    pub(crate) title: String,
    /// Label and panels of each row.
    pub(crate) groups: Vec<(String, Vec<Panel>)>,
}

impl HeatMap {
    pub(crate) fn draw(&self) -> Result<Svg> {
        let most = self.groups.iter().map(|(_, panels)| panels.len()).max().unwrap_or(1);
        let columns = most.clamp(1, MOST_COLUMNS) as u32;
        let lines = |panels: &[Panel]| panels.len().div_ceil(MOST_COLUMNS) as u32;
        let line_height = PANEL_LABEL + PANEL + GAP;
        let height: u32 = self.groups.iter().map(|(_, panels)| ROW_LABEL + lines(panels) * line_height).sum();
        let labels =
            self.groups.iter().map(|(label, _)| text_width(&shortened(label, LONGEST_LABEL), 13.0) as u32 / SCALE);
        let width = (columns * (PANEL + GAP)).max(labels.max().unwrap_or(0)).max(416) + 2 * MARGIN;
        let (low, high) = self.range();
        Svg::draw(width, TITLE + height + KEY, |root| {
            write(root, &self.title, (px(MARGIN), px(8)), 15)?;
            let mut top = TITLE;
            for (label, panels) in &self.groups {
                write(root, &shortened(label, LONGEST_LABEL), (px(MARGIN), px(top + 2)), 13)?;
                top += ROW_LABEL;
                for (index, panel) in panels.iter().enumerate() {
                    let (line, column) = (index / MOST_COLUMNS, index % MOST_COLUMNS);
                    let left = MARGIN + column as u32 * (PANEL + GAP);
                    self.draw_panel(root, panel, (left, top + line as u32 * line_height), (low, high))?;
                }
                top += lines(panels) * line_height;
            }
            self.draw_key(root, top, (low, high))
        })
    }

    fn draw_panel(&self, root: &Area, panel: &Panel, (left, top): (u32, u32), range: (f64, f64)) -> Result<()> {
        write(root, &panel.label, (px(left), px(top)), 11)?;
        let columns = panel.rows.iter().map(Vec::len).max().unwrap_or(1);
        let side = f64::from(PANEL) / panel.rows.len().max(columns) as f64;
        for (row, cells) in panel.rows.iter().enumerate() {
            for (column, &cell) in cells.iter().enumerate() {
                let x = f64::from(left) + column as f64 * side;
                let y = f64::from(top + PANEL_LABEL) + row as f64 * side;
                self.draw_cell(root, cell, (x, y, side), range)?;
            }
        }
        Ok(())
    }

    fn draw_cell(
        &self,
        root: &Area,
        (value, stuck): (f64, bool),
        (x, y, side): (f64, f64, f64),
        range: (f64, f64),
    ) -> Result<()> {
        let [a, b] = [(px(x + 0.5), px(y + 0.5)), (px(x + side - 0.5), px(y + side - 0.5))];
        let shade = shade_of(value, range);
        root.draw(&Rectangle::new([a, b], shade.filled()))?;
        let over = ink_over(shade);
        if stuck {
            for line in [[a, b], [(a.0, b.1), (b.0, a.1)]] {
                root.draw(&PathElement::new(line, pen(over, 1.6)))?;
            }
        }
        if side >= NUMBER_FROM {
            let size = (side * 0.26).min(13.0);
            let (x, y) = (px(x + side / 2.0), px(y + side / 2.0));
            let words = figure(value);
            if stuck {
                let (wide, tall) = (text_width(&words, size) / 2 + px(1), px(size * 0.6));
                root.draw(&Rectangle::new([(x - wide, y - tall), (x + wide, y + tall)], shade.filled()))?;
            }
            root.draw_text(&words, &anchored(text(size, over), HPos::Center, VPos::Center), (x, y))?;
        }
        Ok(())
    }

    fn draw_key(&self, root: &Area, top: u32, (low, high): (f64, f64)) -> Result<()> {
        const STEPS: usize = 60;
        let (left, width, top) = (f64::from(MARGIN), 180.0, f64::from(top));
        for step in 0..STEPS {
            let value = low + (high - low) * step as f64 / (STEPS - 1) as f64;
            let x = left + width * step as f64 / STEPS as f64;
            let corners = [(px(x), px(top)), (px(x + width / STEPS as f64) + 1, px(top + 12.0))];
            root.draw(&Rectangle::new(corners, shade_of(value, (low, high)).filled()))?;
        }
        for (value, x, anchor) in [(low, left, HPos::Left), (high, left + width, HPos::Right)] {
            write_at(root, &figure(value), (px(x), px(top + 16.0)), 11, (anchor, VPos::Top))?;
        }
        write_at(
            root,
            "mean return; cross: stuck",
            (px(left + width + 10.0), px(top + 6.0)),
            11,
            (HPos::Left, VPos::Center),
        )
    }

    fn range(&self) -> (f64, f64) {
        let panels = self.groups.iter().flat_map(|(_, panels)| panels);
        widened(ends_of(panels.flat_map(|panel| panel.rows.iter().flatten().map(|(value, _)| *value))))
    }
}
