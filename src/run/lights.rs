//! The figures of lights that `evaluate` and `baseline` write: JSON, `lights.csv`, `city.json` and a table.

use anyhow::{Result, ensure};
use serde_json::{Map, Value, json};

use super::plan::PLAN;
use crate::cli::OutputArgs;
use dials_core::base::Seed;
use dials_core::base::statistics::Interval;
use dials_core::domain::light_figures::{LightPlace, LightsEpisode};
use dials_core::domain::{Controller, Domain, GlobalSimulator};
use dials_learn::evaluation::csv::Lines;
use dials_learn::evaluation::{EpisodeReport, Finding, episode_seed, play};
use dials_report::lights::{Played, csv, json as in_json, table};
use dials_session::config::RunConfig;
use dials_session::domains;

pub(super) use dials_report::city::{CITY, VARIANTS};

pub(super) const LIGHTS: &str = "lights.csv";

/// What was measured at the lights, player by player.
pub(super) struct LightFigures {
    /// Whether figures of lights are written at all, and whether they are printed as a table.
    is_wanted: bool,
    prints: bool,
    places: Vec<LightPlace>,
    /// Episodes of each player.
    played: Vec<Vec<LightsEpisode>>,
}

impl LightFigures {
    /// `compares`: whether several players are compared. Errors: the options ask for what the domain does not have.
    pub(super) fn asked_for(domain: &dyn Domain, output: &OutputArgs, compares: bool) -> Result<LightFigures> {
        let has_lights = has_lights(domain)?;
        for (option, is_given) in [("--per-light", output.per_light), ("--emissions", output.emissions)] {
            ensure!(has_lights || !is_given, "{option}: only traffic has that; leave the option out");
        }
        let has_lights = has_lights && !output.without_lights;
        let is_wanted = has_lights && (output.per_light || output.json || output.csv.is_some() || compares);
        let prints = has_lights && (output.per_light || compares);
        Ok(LightFigures { is_wanted, prints, places: Vec::new(), played: Vec::new() })
    }

    /// Measures lights for [`LightFigures::city`], and prints nothing.
    pub(super) fn for_a_city() -> LightFigures {
        LightFigures { is_wanted: true, prints: false, places: Vec::new(), played: Vec::new() }
    }

    /// Forgets all players but the first ones.
    pub(super) fn keep(&mut self, players: usize) {
        self.played.truncate(players);
    }

    /// Plays an episode of this number and notes what happened at each light.
    pub(super) fn play(
        &mut self,
        simulator: &mut dyn GlobalSimulator,
        controller: &mut dyn Controller,
        seed: u64,
        episode: usize,
    ) -> Result<EpisodeReport> {
        let played = play(simulator, controller, episode_seed(Seed::new(seed), episode))?;
        self.note(simulator);
        Ok(played)
    }

    /// Makes a simulator measure what is asked for, and begins with the next player.
    pub(super) fn begin(&mut self, simulator: &mut dyn GlobalSimulator, with_emissions: bool) -> Result<()> {
        simulator.measure_in_full()?;
        if with_emissions {
            simulator.measure_emissions()?;
        }
        if self.is_wanted
            && let Some(places) = simulator.measure_lights()?
        {
            self.places = places;
        }
        self.played.push(Vec::new());
        Ok(())
    }

    /// Notes the episode that a simulator has ended.
    fn note(&mut self, simulator: &mut dyn GlobalSimulator) {
        let played = self.played.last_mut().expect("a player has begun");
        played.extend(simulator.light_figures());
    }

    fn has_any(&self) -> bool {
        !self.places.is_empty() && self.played.iter().all(|episodes| !episodes.is_empty())
    }

    fn of(&self, player: usize) -> Played<'_> {
        Played { places: &self.places, episodes: &self.played[player] }
    }

    /// Returns the player from which a player's differences are taken; the first one has none.
    fn reference(&self, player: usize) -> Option<Played<'_>> {
        (player > 0).then(|| self.of(0))
    }

    /// Adds the keys `lights` and `lost_time` to the objects of the players.
    pub(super) fn add_to(&self, object: &mut Map<String, Value>) {
        if !self.has_any() {
            return;
        }
        let add = |object: &mut Map<String, Value>, player: usize| {
            object.insert("lost_time".into(), in_json::lost_time(&self.of(player)));
            object.insert("lights".into(), in_json::lights(&self.of(player), self.reference(player).as_ref()));
        };
        match object.get_mut("controllers").and_then(Value::as_array_mut) {
            Some(players) => {
                let objects = players.iter_mut().filter_map(Value::as_object_mut).enumerate();
                objects.for_each(|(player, object)| add(object, player));
            }
            None => add(object, 0),
        }
    }

    /// Returns the lines of the last player for `lights.csv`.
    pub(super) fn lines(&self, label: &str) -> Lines {
        Lines { header: csv::header(), lines: self.lines_of(self.played.len() - 1, label) }
    }

    /// Returns the contents of `lights.csv` with all players.
    pub(super) fn csv(&self, findings: &[Finding]) -> Result<String> {
        let lines = findings.iter().enumerate();
        let lines: Vec<_> = lines.flat_map(|(player, finding)| self.lines_of(player, &finding.player.label)).collect();
        csv::text(&lines)
    }

    fn lines_of(&self, player: usize, label: &str) -> Vec<Vec<String>> {
        match self.has_any() {
            true => csv::lines(label, &self.of(player), self.reference(player).as_ref()),
            false => Vec::new(),
        }
    }

    /// Returns the table for a terminal, if it is wanted.
    pub(super) fn table(&self, findings: &[Finding]) -> Option<String> {
        let labels: Vec<String> = findings.iter().map(|finding| finding.player.label.clone()).collect();
        let players: Vec<Played<'_>> = (0..self.played.len()).map(|player| self.of(player)).collect();
        (self.prints && self.has_any()).then(|| table::table(&players, &labels))
    }

    /// Returns the contents of `city.json`. `seed`: that of the traffic.
    pub(super) fn city(
        &self,
        config: &RunConfig,
        domain: &dyn Domain,
        findings: &[Finding],
        seed: u64,
    ) -> Result<Value> {
        let traffic = domains::traffic(config)?;
        let streets = traffic.map(|traffic| traffic.streets()).transpose()?.unwrap_or_default();
        let streets = streets.into_iter().map(|street| {
            let rounded = |metres: f64| (metres * 10.0).round() / 10.0;
            let shape: Vec<[f64; 2]> = street.shape_m.iter().map(|place| place.map(rounded)).collect();
            json!({ "edge": street.edge, "street": street.name, "lanes": street.lanes, "shape_m": shape })
        });
        let scenario = domain.scenario()?;
        let sumo = domains::sumo(config)?;
        let reference = dials_learn::evaluation::figures(&findings[0].episodes);
        let players = findings.iter().enumerate().map(|(player, finding)| {
            let figures = |(name, values): (String, Vec<f64>)| (name, json!(Interval::of(&values)));
            let own = dials_learn::evaluation::figures(&finding.episodes);
            let differences = (player > 0).then(|| {
                let pairs = own.iter().zip(&reference).map(|((name, own), (_, reference))| {
                    (name.clone(), json!(Interval::of_differences(own, reference)))
                });
                pairs.collect::<Map<String, Value>>()
            });
            json!({
                "label": finding.player.label,
                "learned": finding.player.policies.is_some(),
                "plan": finding.player.keys.iter().any(|(key, _)| *key == PLAN),
                "figures": own.into_iter().map(figures).collect::<Map<String, Value>>(),
                "differences": differences,
                "lost_time": if self.has_any() { in_json::lost_time(&self.of(player)) } else { Value::Null },
                "lights": match self.has_any() {
                    true => in_json::lights(&self.of(player), self.reference(player).as_ref()),
                    false => json!([]),
                },
            })
        });
        let mut city = Map::new();
        city.insert("name".into(), json!(scenario.name));
        city.insert("scenario".into(), json!(scenario.id.word()));
        city.insert("seed".into(), json!(seed));
        city.insert("sumo_version".into(), json!(sumo.map(|sumo| &sumo.name)));
        city.insert("episodes".into(), json!(findings[0].episodes.len()));
        city.insert("rules".into(), json!(scenario.rules));
        city.insert("left_out".into(), json!(domain.left_out()));
        city.insert("warnings".into(), json!(domain.warnings()));
        city.insert("settings".into(), serde_json::to_value(&config.domain)?);
        city.insert("players".into(), players.collect());
        city.insert("streets".into(), streets.collect());
        Ok(Value::Object(city))
    }
}

/// Returns whether a domain has lights: whether it is traffic.
pub(super) fn has_lights(domain: &dyn Domain) -> Result<bool> {
    Ok(domain.scenario()?.id.domain == "traffic")
}
