//! Heat maps of agents on their grid: a panel per run, a cell per agent, shaded by its return. Stuck agents have a
//! cross.

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use crate::drawing::{self, Area, INK, SCALE, Svg, ink_over, pen, px, shortened, text, text_width, widened};

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

pub(crate) struct Cell {
    pub(crate) value: f64,
    pub(crate) stuck: bool,
}

/// Agents in rows, seen from above, with the top row first.
pub(crate) struct Panel {
    pub(crate) label: String,
    pub(crate) rows: Vec<Vec<Cell>>,
}

pub(crate) struct HeatMap {
    pub(crate) title: String,
    /// Meaning of the shades.
    pub(crate) key: String,
    pub(crate) format: fn(f64) -> String,
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
            let title = Text::new(self.title.clone(), (px(MARGIN), px(8.0)), text(15.0, INK));
            root.draw(&title)?;
            let mut top = TITLE;
            for (label, panels) in &self.groups {
                let at = (px(MARGIN), px(f64::from(top) + 2.0));
                root.draw(&Text::new(shortened(label, LONGEST_LABEL), at, text(13.0, INK)))?;
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
        let at = (px(left), px(top));
        root.draw(&Text::new(panel.label.clone(), at, text(11.0, INK)))?;
        let columns = panel.rows.iter().map(Vec::len).max().unwrap_or(1);
        let side = f64::from(PANEL) / panel.rows.len().max(columns) as f64;
        for (row, cells) in panel.rows.iter().enumerate() {
            for (column, cell) in cells.iter().enumerate() {
                let x = f64::from(left) + column as f64 * side;
                let y = f64::from(top + PANEL_LABEL) + row as f64 * side;
                let corners = [(px(x + 0.5), px(y + 0.5)), (px(x + side - 0.5), px(y + side - 0.5))];
                let shade = shade(cell.value, range);
                root.draw(&Rectangle::new(corners, shade.filled()))?;
                let over = ink_over(shade);
                if cell.stuck {
                    let style = pen(over, 1.6);
                    let (a, b) = (corners[0], corners[1]);
                    for line in [[a, b], [(a.0, b.1), (b.0, a.1)]] {
                        root.draw(&PathElement::new(line, style))?;
                    }
                }
                if side >= NUMBER_FROM {
                    let size = (side * 0.26).min(13.0);
                    let style = text(size, over).pos(Pos::new(HPos::Center, VPos::Center));
                    let middle = (px(x + side / 2.0), px(y + side / 2.0));
                    if cell.stuck {
                        let (wide, tall) = (text_width(&(self.format)(cell.value), size) / 2 + px(1.0), px(size * 0.6));
                        let behind = [(middle.0 - wide, middle.1 - tall), (middle.0 + wide, middle.1 + tall)];
                        root.draw(&Rectangle::new(behind, shade.filled()))?;
                    }
                    root.draw(&Text::new((self.format)(cell.value), middle, style))?;
                }
            }
        }
        Ok(())
    }

    /// Draws the scale of shades with its values.
    fn draw_key(&self, root: &Area, top: u32, (low, high): (f64, f64)) -> Result<()> {
        const STEPS: usize = 60;
        let (left, width, top) = (f64::from(MARGIN), 180.0, f64::from(top));
        for step in 0..STEPS {
            let value = low + (high - low) * step as f64 / (STEPS - 1) as f64;
            let x = left + width * step as f64 / STEPS as f64;
            let corners = [(px(x), px(top)), (px(x + width / STEPS as f64) + 1, px(top + 12.0))];
            root.draw(&Rectangle::new(corners, shade(value, (low, high)).filled()))?;
        }
        for (value, x, anchor) in [(low, left, HPos::Left), (high, left + width, HPos::Right)] {
            let style = text(11.0, INK).pos(Pos::new(anchor, VPos::Top));
            root.draw(&Text::new((self.format)(value), (px(x), px(top + 16.0)), style))?;
        }
        let style = text(11.0, INK).pos(Pos::new(HPos::Left, VPos::Center));
        root.draw(&Text::new(self.key.clone(), (px(left + width + 10.0), px(top + 6.0)), style))?;
        Ok(())
    }

    fn range(&self) -> (f64, f64) {
        let panels = self.groups.iter().flat_map(|(_, panels)| panels);
        let values = panels.flat_map(|panel| panel.rows.iter().flatten().map(|cell| cell.value));
        let (low, high) =
            values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        widened(low, high)
    }
}

/// Returns the shade of a value: the higher, the darker.
fn shade(value: f64, (low, high): (f64, f64)) -> RGBColor {
    drawing::shade(if high > low { (value - low) / (high - low) } else { 0.5 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn higher_returns_are_darker() {
        let shades: Vec<RGBColor> = (0..=10).map(|value| shade(f64::from(value), (0.0, 10.0))).collect();
        assert!(shades.windows(2).all(|pair| drawing::luminance(pair[0]) > drawing::luminance(pair[1])), "{shades:?}");
    }
}
