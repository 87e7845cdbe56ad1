//! Pictures of a traffic episode as SVG: one file and one function per picture.
//!
//! - `space_time`: the cars of one corridor over time. `signal_timing`: the lights over time.
//! - `queues`: standing cars over time. `returns_map`: the return of every agent on a map.
//! - `regions_map`: a road network with the local regions of its lights. `net_map`: what maps of networks share.
//!
//! Those of an episode are drawn from a [`dials_core::domain::road_trace`]. Nothing here knows which simulator made it.

mod net_map;
mod queues;
mod regions_map;
mod returns_map;
mod signal_timing;
mod space_time;

use std::ops::Range;

use anyhow::Result;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};

use crate::drawing::{
    Area, BLUE, BoundedAxis, GREEN, INK, ORANGE, PURPLE, SKY, Svg, anchored, draw_mesh, ends_of, ink_over, pen, px,
    shade, shade_of, shortened, text, text_width, widened, write, write_at,
};

pub use queues::queues;
pub use regions_map::{MapRegion, RegionsMap, regions_map};
pub use returns_map::{means_on_map, returns_map};
pub use signal_timing::signal_timing;
pub use space_time::space_time;

/// What was played. Every picture shows it under its title.
pub struct About {
    pub subject: String,
    pub seed: u64,
}

impl About {
    fn of_episode(&self) -> String {
        format!("{}, first episode of seed {}", self.subject, self.seed)
    }
}

type Chart<'a, 'b> = ChartContext<'a, SVGBackend<'b>, Cartesian2d<BoundedAxis, BoundedAxis>>;

/// Colour of text and lines that should not catch the eye, such as the second line of a title.
const FAINT: RGBColor = RGBColor(110, 110, 110);
const PALE: RGBColor = RGBColor(232, 232, 232);

const MARGIN: i32 = 18;
/// Height of the title and the line under it, in pixels.
const HEAD: i32 = 64;

/// Returns the width of a picture with a time axis, in pixels. An hour needs more room than minutes.
fn width_for(seconds: &Range<usize>) -> i32 {
    seconds.len().clamp(1100, 2400) as i32
}

fn time_axis(seconds: &Range<usize>) -> BoundedAxis {
    BoundedAxis::from(seconds.start as f64..seconds.end as f64)
}

/// Draws a picture of this width and height in pixels: a head, and below it what `draw` draws.
fn picture(
    (width, height): (i32, i32),
    title: &str,
    about: &str,
    draw: impl FnOnce(&Area<'_>) -> Result<()>,
) -> Result<Svg> {
    Svg::draw(width as u32, height as u32, |root| {
        write(root, title, (px(MARGIN), px(14)), 15)?;
        root.draw_text(about, &text(11, FAINT), (px(MARGIN), px(40)))?;
        draw(&root.margin(px(HEAD), px(MARGIN), px(MARGIN), px(MARGIN)))
    })
}

/// Draws the axes of a chart. `values`: label of the vertical axis. `seconds`: whether to label the time axis.
fn draw_axes(chart: &mut Chart<'_, '_>, values: &str, value_labels: usize, seconds: bool) -> Result<()> {
    draw_mesh(
        chart
            .configure_mesh()
            .disable_x_mesh()
            .x_labels(if seconds { 11 } else { 0 })
            .x_desc(if seconds { "time (s)" } else { "" })
            .x_label_formatter(&|second| format!("{second:.0}"))
            .y_labels(value_labels)
            .y_desc(values)
            .y_label_formatter(&|value| format!("{value:.0}")),
        11.0,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::base::Rows;
    use dials_core::domain::road_trace::{Aspect, Corridor, CorridorLight, Layout, RoadTrace, Shown};

    /// Two intersections side by side for four seconds.
    fn trace() -> RoadTrace {
        let crossing = |name: &str, begin_m, aspects: [Aspect; 4]| CorridorLight {
            name: name.to_owned(),
            begin_m,
            end_m: begin_m + 10.0,
            aspects: aspects.to_vec(),
        };
        let (green, yellow, red) = (Aspect::Green, Aspect::Yellow, Aspect::Red);
        RoadTrace {
            seconds: 0..4,
            layout: Layout::Grid { rows: 1, columns: 2 },
            names: vec!["a".to_owned(), "b".to_owned()],
            greens: ["green for the main road", "green for the others"].map(str::to_owned).to_vec(),
            lights: vec![
                vec![Shown::Green(0), Shown::Green(0), Shown::Yellow, Shown::Green(1)],
                vec![Shown::Green(1); 4],
            ],
            approaches: Vec::new(),
            corridors: vec![Corridor {
                name: "the main road".to_owned(),
                from: "bridge".to_owned(),
                to: "harbour".to_owned(),
                length_m: 220.0,
                crossings: vec![
                    crossing("a", 100.0, [green, green, yellow, red]),
                    crossing("b", 150.0, [red, red, red, red]),
                ],
                cars: vec![vec![(1.0, 5.0), (2.0, 12.0)]],
            }],
        }
    }

    fn about() -> About {
        About { subject: "controller x".to_owned(), seed: 7 }
    }

    /// Counts the shapes that are filled with a colour.
    fn filled(svg: &str, RGBColor(red, green, blue): RGBColor) -> usize {
        svg.matches(&format!("fill=\"#{red:02X}{green:02X}{blue:02X}\"")).count()
    }

    #[test]
    fn a_bar_lasts_as_long_as_a_light_shows_the_same() {
        let svg = signal_timing(&trace(), &about()).unwrap().file();
        // Two seconds of green make one bar. Each colour is in the legend once.
        let yellow = filled(&svg, ORANGE);
        assert_eq!((filled(&svg, BLUE), filled(&svg, RGBColor(170, 214, 240)), yellow), (2, 3, 2));
        assert!(svg.contains("green for the main road") && svg.contains("first episode of seed 7"), "{svg}");
    }

    #[test]
    fn a_corridor_is_drawn_from_its_own_ends_with_a_bar_per_light() {
        let trace = trace();
        let svg = space_time(&trace.corridors[0], &trace.seconds, &about()).unwrap().file();
        assert!(svg.contains("Space and time: the main road, from bridge to harbour"), "{svg}");
        assert!(svg.contains("distance from the bridge end (m)"), "{svg}");
        // Three red shapes: one at the end of `a`, one for all of `b`, and one in the legend.
        assert_eq!(filled(&svg, RGBColor(178, 24, 43)), 3);
    }

    #[test]
    fn the_map_has_the_mean_return_of_every_intersection() {
        let returns = Rows::from_vec(vec![1.0, 10.0, 2.0, 30.0], 2);
        let svg = returns_map(&trace(), &returns, &about()).unwrap().file();
        assert!([">\n1.50\n", ">\n20.00\n"].iter().all(|value| svg.contains(value)), "{svg}");
        assert!(svg.contains("Return per agent on a grid of 1x2: 10.75 on average"), "{svg}");
    }
}
