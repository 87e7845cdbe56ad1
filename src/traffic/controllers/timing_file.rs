//! Timings that the tuner found, in a file that says what they were tuned on.

use std::path::Path;

use anyhow::{Context, Result, anyhow, ensure};
use serde::{Deserialize, Serialize};

use super::arguments::GREENS;
use super::timing::{ClockPlan, Leeway, Timing};
use crate::outside::{Printable, read_text};
use crate::traffic::paper_grid::grid::Grid;

/// Advice if a file does not help.
const WAY_OUT: &str = "`dials-traffic baseline CONFIG --controller NAME --tune` makes one that fits";

/// Largest file. Offsets of 10 000 intersections have 50 kB.
const MOST_BYTES: u64 = 1 << 20;

/// A TOML file, for readers and for `fixed-time:file=PATH` or `coordinated:file=PATH`. All times are in steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingFile {
    /// Green for the cars from south and north, and from west and east; the same at all intersections.
    pub vertical: u32,
    pub horizontal: u32,
    /// Number of steps from the beginning of an episode to the beginning of a vertical green, for each agent.
    pub offsets: Vec<u32>,
    /// Leeway of `coordinated`: 0 for `fixed-time`.
    #[serde(default)]
    pub early: u32,
    #[serde(default)]
    pub late: u32,
    /// Mean return on the episodes of the tuning.
    pub mean_return: f64,
    pub tuned_on: TunedOn,
}

/// Everything that timings depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TunedOn {
    /// Name of the controller: `fixed-time` or `coordinated`.
    pub controller: String,
    /// Name of the network, without its folder, because the folder can change.
    pub network: String,
    /// CRC-32 of the net and the routes.
    pub network_crc32: String,
    pub horizon: usize,
    pub episodes: usize,
    /// Seed as text, because TOML's numbers end at 2^63.
    pub seed: String,
    /// [`super::search::VERSION`] of the search.
    pub search_version: u32,
    pub sumo_version: String,
}

impl TimingFile {
    pub fn read(path: &Path) -> Result<TimingFile> {
        let place = path.display();
        let text = read_text(path, MOST_BYTES).with_context(|| format!("{place}: cannot be read; {WAY_OUT}"))?;
        let foreign = || format!("{place}: is not a file of tuned timings of this version; {WAY_OUT}");
        let file: TimingFile =
            toml::from_str(&text).map_err(|error| anyhow!(reason(&error, &text))).with_context(foreign)?;
        for (name, green) in [("vertical", file.vertical), ("horizontal", file.horizontal)] {
            ensure!(GREENS.contains(&green), "{place}: {name} = {green}: must be from 1 to 3600 steps; {WAY_OUT}");
        }
        for (name, steps) in [("early", file.early), ("late", file.late)] {
            let most = Leeway::MOST;
            ensure!(steps <= most, "{place}: {name} = {steps}: must be at most {most} steps; {WAY_OUT}");
        }
        let mean = file.mean_return;
        ensure!(mean.is_finite(), "{place}: mean_return = {mean}: must be a finite number; {WAY_OUT}");
        Ok(file)
    }

    pub fn to_toml(&self) -> Result<String> {
        Ok(format!(
            "# Timings of lights, in steps; play them with: --controller {}:file=FILE\n{}",
            self.tuned_on.controller,
            toml::to_string(self)?
        ))
    }

    /// Reads what a controller follows at the intersections of `grid` from a file that was tuned for it.
    pub fn plan(path: &Path, controller: &str, grid: Grid) -> Result<ClockPlan> {
        let TimingFile { vertical, horizontal, offsets, early, late, tuned_on, .. } = TimingFile::read(path)?;
        let place = path.display();
        ensure!(
            tuned_on.controller == controller,
            "{place}: has timings of {}, not of {controller}; {WAY_OUT}",
            tuned_on.controller
        );
        ensure!(
            offsets.len() == grid.agents().len(),
            "{place}: timings for the {} intersections of {} do not fit a grid of {grid}; {WAY_OUT}",
            offsets.len(),
            tuned_on.network
        );
        let timings = offsets.into_iter().map(|offset| Timing { vertical, horizontal, offset }).collect();
        Ok(ClockPlan { timings, leeway: Leeway { early, late } })
    }
}

/// Returns where and why a text is not TOML, without the line itself, which may be endless.
fn reason(error: &toml::de::Error, text: &str) -> String {
    const MOST: usize = 300;
    let before = error.span().and_then(|span| text.get(..span.start));
    let line = before.map_or(String::new(), |before| format!("line {}: ", before.matches('\n').count() + 1));
    let message: String = error.message().chars().take(MOST).collect();
    format!("{line}{}", Printable(message))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn timings_come_back_from_their_file() {
        let file = TimingFile {
            vertical: 9,
            horizontal: 11,
            offsets: vec![0, 13, 13, 0],
            early: 3,
            late: 1,
            mean_return: 205.25,
            tuned_on: TunedOn {
                controller: "coordinated".into(),
                network: "grid_2x2".into(),
                network_crc32: "00c0ffee".into(),
                horizon: 300,
                episodes: 10,
                seed: u64::MAX.to_string(),
                search_version: 1,
                sumo_version: "1.15.0".into(),
            },
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        std::fs::write(&path, file.to_toml().unwrap()).unwrap();
        let read = TimingFile::read(&path).unwrap();
        assert_eq!(read, file);
        let grid = Grid::new(2, 2).unwrap();
        let plan = TimingFile::plan(&path, "coordinated", grid).unwrap();
        assert_eq!(plan.timings[1], Timing { vertical: 9, horizontal: 11, offset: 13 });
        assert_eq!(plan.leeway, Leeway { early: 3, late: 1 });
        let error = TimingFile::plan(&path, "fixed-time", grid).unwrap_err().to_string();
        assert!(error.contains("has timings of coordinated, not of fixed-time"), "{error}");
    }

    #[test]
    fn what_is_wrong_with_a_file_is_told_with_its_path_and_the_way_out() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        let error = |text: &str| {
            std::fs::write(&path, text).unwrap();
            let error = TimingFile::plan(&path, "fixed-time", Grid::new(2, 3).unwrap()).unwrap_err().to_string();
            let told = error.strip_prefix(&format!("{}: ", path.display())).unwrap_or_else(|| panic!("{error}"));
            told.strip_suffix(&format!("; {WAY_OUT}")).unwrap_or_else(|| panic!("{error}")).to_owned()
        };
        let timings = |vertical: u32, tuned_on: &str| {
            format!(
                "vertical = {vertical}\nhorizontal = 1\noffsets = [0, 0, 0, 0]\nmean_return = 1.0\n[tuned_on]\n{tuned_on}"
            )
        };
        let on =
            "controller = 'fixed-time'\nnetwork = 'n'\nnetwork_crc32 = '0'\nhorizon = 300\nepisodes = 10\nseed = '1'\n";
        let on_all = format!("{on}search_version = 1\nsumo_version = '1.15.0'\n");
        assert_eq!(error(&timings(9, &on_all)), "timings for the 4 intersections of n do not fit a grid of 2x3");
        assert_eq!(error(&timings(9, on)), "is not a file of tuned timings of this version");
        // With 1 and the yellows of 6, the cycle would be 2^32, which is 0.
        assert_eq!(error(&timings(u32::MAX - 6, &on_all)), "vertical = 4294967289: must be from 1 to 3600 steps");
        assert_eq!(error(&timings(0, &on_all)), "vertical = 0: must be from 1 to 3600 steps");
        for (bad, word) in [("nan", "NaN"), ("-inf", "-inf")] {
            let told = error(&timings(9, &on_all).replace("1.0", bad));
            assert_eq!(told, format!("mean_return = {word}: must be a finite number"));
        }
    }
}
