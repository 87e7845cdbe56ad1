//! What `evaluate` and `baseline` measured in a city: `city.json`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use serde::Deserialize;
use serde_json::Value;

use super::CITY;
use dials_core::domain::Rules;
use dials_core::outside::read_text;

/// Largest file. The net of a large city has some ten mebibytes.
const LARGEST: u64 = 256 << 20;

/// Contents of `city.json`.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct City {
    pub(crate) name: Option<String>,
    pub(crate) seed: u64,
    pub(crate) sumo_version: Option<String>,
    pub(crate) episodes: usize,
    pub(crate) rules: Option<Rules>,
    pub(crate) left_out: Vec<String>,
    pub(crate) warnings: Vec<String>,
    /// The table of the domain in the config.
    pub(crate) settings: Value,
    /// Players, the one that all others are compared with first. At least one.
    pub(crate) players: Vec<CityPlayer>,
    pub(crate) streets: Vec<CityStreet>,
}

#[derive(Clone, Debug, Deserialize)]
pub(crate) struct CityPlayer {
    pub(crate) label: String,
    /// Whether it has policies.
    pub(crate) learned: bool,
    /// Whether it is a plan that `plan` wrote.
    #[serde(default)]
    pub(crate) plan: bool,
    pub(crate) figures: BTreeMap<String, Figure>,
    /// Differences from the first player.
    pub(crate) differences: Option<BTreeMap<String, Figure>>,
    pub(crate) lost_time: Option<BTreeMap<String, f64>>,
    pub(crate) lights: Vec<CityLight>,
}

/// A mean with the half-width of its 95 % interval.
#[derive(Clone, Copy, Debug, Deserialize)]
pub(crate) struct Figure {
    pub(crate) mean: f64,
    pub(crate) half_width_95: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
pub(crate) struct CityLight {
    pub(crate) id: String,
    pub(crate) name: String,
    pub(crate) place_m: [f64; 2],
    #[serde(flatten)]
    pub(crate) figures: PartFigures,
    pub(crate) approaches: Vec<CityApproach>,
}

#[derive(Clone, Debug, Deserialize)]
pub(crate) struct CityApproach {
    pub(crate) edge: String,
    pub(crate) street: Option<String>,
    #[serde(flatten)]
    pub(crate) figures: PartFigures,
}

/// Figures of a light or an approach. Without cars some are missing.
#[derive(Clone, Debug, Deserialize)]
pub(crate) struct PartFigures {
    pub(crate) cars: f64,
    pub(crate) delay_s: Option<f64>,
    pub(crate) stops_per_car: Option<f64>,
    pub(crate) queue_p95_cars: Option<f64>,
    pub(crate) level_of_service: Option<String>,
    #[serde(default)]
    pub(crate) difference: BTreeMap<String, Option<Figure>>,
}

impl CityPlayer {
    /// Returns the delay per car of the whole city, in seconds.
    pub(crate) fn delay_s(&self) -> Option<Figure> {
        self.figures.get("delay_s").copied()
    }
}

impl PartFigures {
    /// Returns by how much the delay is higher than with the first player.
    pub(crate) fn delay_difference(&self) -> Option<Figure> {
        self.difference.get("delay_s").copied().flatten()
    }
}

#[derive(Clone, Debug, Deserialize)]
pub(crate) struct CityStreet {
    pub(crate) edge: String,
    pub(crate) lanes: usize,
    pub(crate) shape_m: Vec<[f64; 2]>,
}

impl City {
    /// Reads the file in a folder. If there is none: `None`.
    fn in_folder(folder: &Path) -> Result<Option<City>> {
        let path = folder.join(CITY);
        if !path.is_file() {
            return Ok(None);
        }
        let of_path = || path.display().to_string();
        let text = read_text(&path, LARGEST).with_context(of_path)?;
        let city: City = serde_json::from_str(&text)
            .with_context(|| format!("{}: is not a file of this program; make it again with --csv", of_path()))?;
        anyhow::ensure!(!city.players.is_empty(), "{}: names no controller; make it again with --csv", of_path());
        Ok(Some(city))
    }

    pub(crate) fn title(&self) -> String {
        self.name.clone().unwrap_or_else(|| "traffic".to_owned())
    }

    /// Leaves out the files in the names of players, where no two get the same name by it: paths say nothing to a reader.
    pub(crate) fn leave_out_files(&mut self) {
        let short: Vec<String> = self.players.iter().map(|player| without_file(&player.label)).collect();
        for (number, player) in self.players.iter_mut().enumerate() {
            if short.iter().filter(|&other| *other == short[number]).count() == 1 {
                player.label.clone_from(&short[number]);
            }
        }
    }
}

/// Returns a controller's name without its parameter `file`.
fn without_file(label: &str) -> String {
    let Some((name, parameters)) = label.split_once(':') else { return label.to_owned() };
    let kept: Vec<&str> = parameters.split(',').filter(|parameter| !parameter.starts_with("file=")).collect();
    if kept.is_empty() { name.to_owned() } else { format!("{name}:{}", kept.join(",")) }
}

/// Returns the cities in these folders and in the folders in them, each with its folder.
pub(crate) fn find(folders: &[PathBuf]) -> Result<Vec<(PathBuf, City)>> {
    let mut found = Vec::new();
    for folder in folders {
        let mut places = vec![folder.clone()];
        if let Ok(entries) = folder.read_dir() {
            let mut inside: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
            inside.sort();
            places.extend(inside.into_iter().filter(|path| path.is_dir()));
        }
        for place in places {
            found.extend(City::in_folder(&place)?.map(|city| (place.clone(), city)));
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn files_are_left_out_of_names_unless_two_would_be_the_same() {
        let players =
            ["program", "plan of fixed-time:file=a/b.toml", "any-light:file=x,choice=greedy", "f:file=1", "f:file=2"];
        let players = players.map(|label| json!({ "label": label, "learned": false, "figures": {}, "lights": [] }));
        let city = json!({ "seed": 0, "episodes": 1, "left_out": [], "warnings": [], "settings": {}, "streets": [],
                           "players": players });
        let mut city: City = serde_json::from_value(city).unwrap();
        city.leave_out_files();
        let labels: Vec<&str> = city.players.iter().map(|player| &*player.label).collect();
        assert_eq!(labels, ["program", "plan of fixed-time", "any-light:choice=greedy", "f:file=1", "f:file=2"]);
    }
}
