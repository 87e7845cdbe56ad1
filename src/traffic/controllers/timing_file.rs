//! Timings that the tuner found, kept in a file that says what they were tuned on.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::fixed_time::Timing;
use crate::traffic::grid::Grid;

/// A TOML file, for people and for `fixed-time:file=PATH`. All times are steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingFile {
    /// Green for the cars from south and north, and from west and east; the same at all intersections.
    pub vertical: u32,
    pub horizontal: u32,
    /// How long after the beginning of an episode a vertical green begins, agent by agent.
    pub offsets: Vec<u32>,
    /// On the episodes of the tuning.
    pub mean_return: f64,
    pub tuned_on: TunedOn,
}

/// What timings depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TunedOn {
    /// Its name; the folder may be another one tomorrow.
    pub network: String,
    /// CRC-32 of its net and its routes.
    pub network_crc32: String,
    pub horizon: usize,
    pub episodes: usize,
    /// As text, since TOML's numbers end at 2^63.
    pub seed: String,
}

impl TimingFile {
    pub fn read(path: &Path) -> Result<TimingFile> {
        let text = std::fs::read_to_string(path).with_context(|| format!("{}: cannot be read", path.display()))?;
        toml::from_str(&text).with_context(|| format!("{}: is no file of tuned timings", path.display()))
    }

    pub fn to_toml(&self) -> Result<String> {
        Ok(format!(
            "# Fixed-time timings, in steps; play them with: --controller fixed-time:file=FILE\n{}",
            toml::to_string(self)?
        ))
    }

    /// One timing per intersection of `grid`.
    pub fn timings(&self, grid: Grid) -> Result<Vec<Timing>> {
        let TimingFile { vertical, horizontal, offsets, tuned_on, .. } = self;
        ensure!(
            offsets.len() == grid.agents().len(),
            "timings for the {} intersections of {} do not fit a grid of {grid}",
            offsets.len(),
            tuned_on.network
        );
        ensure!(*vertical >= 1 && *horizontal >= 1, "timings without green");
        Ok(offsets.iter().map(|&offset| Timing { vertical: *vertical, horizontal: *horizontal, offset }).collect())
    }
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
            mean_return: 205.25,
            tuned_on: TunedOn {
                network: "grid_2x2".into(),
                network_crc32: "00c0ffee".into(),
                horizon: 300,
                episodes: 10,
                seed: u64::MAX.to_string(),
            },
        };
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        std::fs::write(&path, file.to_toml().unwrap()).unwrap();
        let read = TimingFile::read(&path).unwrap();
        assert_eq!(read, file);
        let timings = read.timings(Grid::new(2, 2).unwrap()).unwrap();
        assert_eq!(timings[1], Timing { vertical: 9, horizontal: 11, offset: 13 });
        let error = read.timings(Grid::new(2, 3).unwrap()).unwrap_err().to_string();
        assert_eq!(error, "timings for the 4 intersections of grid_2x2 do not fit a grid of 2x3");
        std::fs::write(&path, "vertical = 9").unwrap();
        assert!(TimingFile::read(&path).unwrap_err().to_string().ends_with("is no file of tuned timings"));
    }
}
