//! A map with the return of every agent: squares for a grid, the roads themselves for any other network.

use anyhow::Result;

use super::net_map::{MapLight, Sheet};
use super::*;
use dials_core::base::statistics::mean;
use dials_core::base::{Rows, decimals};
use dials_core::domain::road_trace::{Layout, RoadMap, RoadTrace};

/// Length of the map's longer side in pixels, unless its squares would become too small or too large.
const MAP: i32 = 420;
/// Width of the colour scale beside the map, in pixels.
const SCALE: i32 = 110;
/// Least width of the picture, so that the title fits, in pixels.
const LEAST_WIDTH: i32 = 640;

struct Returns {
    means: Vec<f64>,
    /// Range of the colours.
    ends: (f64, f64),
}

impl Returns {
    /// Computes the means of `[episodes, agents]`.
    fn of(returns: &Rows<f64>) -> Returns {
        let of_agent = |agent: usize| mean(&returns.iter().map(|episode| episode[agent]).collect::<Vec<_>>());
        Returns::of_means((0..returns.width()).map(of_agent).collect())
    }

    fn of_means(means: Vec<f64>) -> Returns {
        let ends = widened(ends_of(means.iter().copied()));
        Returns { means, ends }
    }

    /// Returns a value with as many decimals as the largest return needs.
    fn written(&self, value: f64) -> String {
        let digits = decimals(self.ends.0.abs().max(self.ends.1.abs()), None);
        format!("{value:.digits$}")
    }
}

/// Draws the mean return of every agent at its place on the roads of `trace`. `returns`: `[episodes, agents]`.
pub fn returns_map(trace: &RoadTrace, returns: &Rows<f64>, about: &About) -> Result<Svg> {
    let episodes = returns.len();
    let returns = Returns::of(returns);
    let title = format!("Return per agent on {}: {} on average", trace.place(), returns.written(mean(&returns.means)));
    let plural = if episodes == 1 { "" } else { "s" };
    let line = format!("{}, mean over {episodes} episode{plural} of seed {}", about.subject, about.seed);
    match &trace.layout {
        Layout::Grid { rows, columns } => draw_grid(&trace.names, (*rows, *columns), &returns, &title, &line),
        Layout::Map(map) => returns_on_net(map, &trace.names, &returns, &title, &line),
    }
}

/// Draws these mean returns of the agents `names` at the places of their lights. `line`: what they are of.
pub fn means_on_map(map: &RoadMap, names: &[String], means: &[f64], line: &str) -> Result<Svg> {
    let returns = Returns::of_means(means.to_vec());
    let title = format!("Return per agent: {} on average", returns.written(mean(&returns.means)));
    returns_on_net(map, names, &returns, &title, line)
}

/// Draws the lights on the roads, each in the shade of its return. The list at the right has the numbers.
fn returns_on_net(map: &RoadMap, names: &[String], returns: &Returns, title: &str, about: &str) -> Result<Svg> {
    let lights = names.iter().zip(&map.lights_m).zip(&returns.means).map(|((name, &place_m), &mean)| MapLight {
        name,
        place_m,
        colour: shade_of(mean, returns.ends),
        value: Some(returns.written(mean)),
    });
    let sheet = Sheet::around(&map.lanes, &map.junctions, lights.collect());
    let (width, height) = sheet.size();
    picture((width + SCALE, height), title, about, |area| {
        sheet.draw(area, || Ok(()))?;
        draw_scale(area, px(sheet.right() + 24), px(sheet.tall.min(300)), returns)?;
        area.draw_text("sum of rewards over an episode", &text(10, FAINT), (px(300), px(sheet.tall + 8)))?;
        Ok(())
    })
}

fn draw_grid(
    names: &[String],
    (rows, columns): (usize, usize),
    returns: &Returns,
    title: &str,
    line: &str,
) -> Result<Svg> {
    let (tall, cols) = (rows as i32, columns as i32);
    let side = (MAP / tall.max(cols)).clamp(66, 130);
    let width = (2 * MARGIN + cols * side + SCALE).max(LEAST_WIDTH);
    let height = HEAD + MARGIN + tall * side + 30;
    picture((width, height), title, line, |area| {
        let middle = |style| anchored(style, HPos::Center, VPos::Center);
        let cell = px(side);
        for (agent, (name, &mean)) in names.iter().zip(&returns.means).enumerate() {
            let (row, col) = (agent / columns, agent % columns);
            let (x, y) = (col as i32 * cell, (rows - 1 - row) as i32 * cell); // north is up
            let shade = shade_of(mean, returns.ends);
            area.draw(&Rectangle::new([(x, y), (x + cell - px(3), y + cell - px(3))], shade.filled()))?;
            let ink = ink_over(shade);
            let centre = (x + cell / 2 - px(1), y + cell / 2 - px(1));
            let value = returns.written(mean);
            area.draw_text(&value, &middle(text(15, ink)), (centre.0, centre.1 - px(8)))?;
            area.draw_text(name, &middle(text(10, ink)), (centre.0, centre.1 + px(14)))?;
        }
        draw_scale(area, cols * cell + px(16), tall * cell - px(3), returns)?;
        let note = "sum of rewards over an episode; north is up";
        area.draw_text(note, &text(10, FAINT), (0, tall * cell + px(8)))?;
        Ok(())
    })
}

fn draw_scale(area: &Area<'_>, x: i32, height: i32, returns: &Returns) -> Result<()> {
    let (low, high) = returns.ends;
    for y in (0..height).step_by(px(1) as usize) {
        let share = 1.0 - f64::from(y) / f64::from(height - 1);
        area.draw(&Rectangle::new([(x, y), (x + px(16), y + px(1))], shade(share).filled()))?;
    }
    for share in [0.0, 0.5, 1.0] {
        let y = ((1.0 - share) * f64::from(height - 1)) as i32;
        let at = (x + px(24), y.clamp(px(6), height - px(6)));
        write_at(area, &returns.written(low + share * (high - low)), at, 11, (HPos::Left, VPos::Center))?;
    }
    Ok(())
}
