//! Fixed time: every light follows a clock, whatever the traffic.

use std::path::Path;

use anyhow::{Result, ensure};

use super::arguments::Arguments;
use super::control::LightController;
use super::timing::Timing;
use super::timing_file::TimingFile;
use crate::base::Seed;
use crate::domain::Action;
use crate::traffic::agents::phases::Light;
use crate::traffic::controllers::intersections::Intersections;
use crate::traffic::light::{KEEP, SWITCH};
use crate::traffic::paper_grid::grid::Grid;

/// Steps of green, if the parameters do not say.
const GREEN: u32 = 10;

/// Fixed-time lights: one timing per intersection. Every episode begins with vertical green; if the clock says
/// otherwise, the light turns yellow at once.
pub struct FixedTime {
    timings: Vec<Timing>,
    step: u32,
}

impl FixedTime {
    pub fn new(timings: Vec<Timing>) -> Self {
        FixedTime { timings, step: 0 }
    }
}

impl LightController for FixedTime {
    fn begin(&mut self, _episode: Seed) {
        self.step = 0;
    }

    fn act(&mut self, intersections: &Intersections<'_>, actions: &mut [Action]) {
        for ((action, intersection), timing) in actions.iter_mut().zip(intersections.iter()).zip(&self.timings) {
            *action = match (intersection.light(), timing.is_vertical(self.step)) {
                (Light::VerticalGreen, false) | (Light::HorizontalGreen, true) => SWITCH,
                _ => KEEP,
            };
        }
        self.step += 1;
    }
}

/// Returns the timings for these parameters: `green`, or `vertical` and `horizontal`, and `offsets`; or a `file` that
/// the tuner wrote.
///
/// `offsets` are `none`, `checkerboard` (half a cycle for every other intersection) or one per agent, such as
/// `0-13-13-0`.
pub fn timings(arguments: &mut Arguments<'_>, grid: Grid) -> Result<Vec<Timing>> {
    if let Some(file) = arguments.take("file")? {
        return Ok(TimingFile::plan(Path::new(file), super::FIXED_TIME, grid)?.timings);
    }
    clock(arguments, grid, "none")
}

/// Returns the timings for `green`, `vertical`, `horizontal` and `offsets`; `usual`: the offsets, if they do not say.
pub fn clock(arguments: &mut Arguments<'_>, grid: Grid, usual: &'static str) -> Result<Vec<Timing>> {
    let green = arguments.steps("green", GREEN)?;
    let (vertical, horizontal) = (arguments.steps("vertical", green)?, arguments.steps("horizontal", green)?);
    let timing = Timing { vertical, horizontal, offset: 0 };
    let offsets = offsets(arguments, grid, timing.cycle(), usual)?;
    Ok(offsets.into_iter().map(|offset| Timing { offset, ..timing }).collect())
}

fn offsets(arguments: &mut Arguments<'_>, grid: Grid, cycle: u32, usual: &str) -> Result<Vec<u32>> {
    let agents = grid.agents();
    match arguments.take("offsets")?.unwrap_or(usual) {
        "none" => Ok(vec![0; agents.len()]),
        "checkerboard" => {
            let places = agents.into_iter().map(|agent| grid.place(agent));
            Ok(places.map(|(row, col)| if (row + col).is_multiple_of(2) { 0 } else { cycle / 2 }).collect())
        }
        list => {
            let offsets: Option<Vec<u32>> = list.split('-').map(|offset| offset.parse().ok()).collect();
            let why = format!("offsets = {list}: must be none, checkerboard or steps such as 0-13-13-0");
            let offsets = offsets.ok_or_else(|| arguments.refuse(why))?;
            ensure!(
                offsets.len() == agents.len(),
                arguments.refuse(format!("{} offsets for {} intersections", offsets.len(), agents.len()))
            );
            Ok(offsets)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asked_for(text: &str) -> Result<Vec<Timing>> {
        let mut arguments = Arguments::of(text);
        timings(&mut arguments, Grid::new(2, 2).unwrap())
    }

    #[test]
    fn greens_and_offsets_are_those_asked_for() {
        let timing = |vertical, horizontal, offset| Timing { vertical, horizontal, offset };
        assert_eq!(asked_for("fixed-time").unwrap(), [timing(10, 10, 0); 4]);
        // A cycle of 12 + 8 + 6 = 26.
        let [even, odd] = [timing(12, 8, 0), timing(12, 8, 13)];
        let found = asked_for("fixed-time:vertical=12,horizontal=8,offsets=checkerboard").unwrap();
        assert_eq!(found, [even, odd, odd, even]);
        let found = asked_for("fixed-time:green=7,offsets=0-1-2-3").unwrap();
        assert_eq!(found, [0, 1, 2, 3].map(|offset| timing(7, 7, offset)));
    }

    #[test]
    fn bad_timings_are_refused() {
        let error = |text: &str| asked_for(text).unwrap_err().to_string();
        assert!(error("fixed-time:green=0").ends_with("green = 0: must be a whole number from 1 to 3600"));
        assert!(error("fixed-time:offsets=left").ends_with("must be none, checkerboard or steps such as 0-13-13-0"));
        assert!(error("fixed-time:offsets=1-2").ends_with("2 offsets for 4 intersections"));
        assert!(error("fixed-time:file=no/such.toml").starts_with("no/such.toml: cannot be read"));
    }
}
