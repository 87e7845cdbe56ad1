//! Scenarios and configs of a map by the rules of a protocol, in the folder of the benchmark.
//!
//! Every map has two scenarios. `maps/NAME.sumocfg` is what policies train on, `maps/protocol/NAME.sumocfg` what everybody is
//! measured on. They name the user's own files, so nothing is copied.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::copies::MapCopy;
use super::{Wanted, absolute};
use crate::cli::RescoProtocol;
use crate::run::experiment::KNOWLEDGE;
use dials_core::domain::RoughCosts;
use dials_report::resco::published::Map;
use dials_session::config::{RunConfig, load};
use dials_session::domains;
use dials_session::experiment::file::Experiment;
use dials_traffic::config::{ScenarioConfig, sumocfg};
use dials_traffic::controllers::ANY_LIGHT;

const MAPS: &str = "maps";
const PROTOCOL: &str = "protocol";
const TELEPORT: &str = "time-to-teleport";
const NO_TELEPORTS: &str = "-1";

/// Rules by which all are measured.
pub(super) struct Protocol {
    pub(super) name: &'static str,
    pub(super) rules: Vec<String>,
    which: RescoProtocol,
}

impl Protocol {
    pub(super) fn of(which: RescoProtocol) -> Protocol {
        let (name, rules): (_, &[&str]) = match which {
            RescoProtocol::Resco2021 => (
                "resco2021",
                &[
                    "Protocol `resco2021`: episodes are RESCO's hours, without warm-up, each with a random seed of its own. \
                     Agents choose any green of the light every 10 s, of which the first 3 s are yellow if the green changes \
                     (arterial4x4: 5 s and 2 s). Cars never teleport.",
                    "Policies train with SUMO's default, by which a car that has stood for 300 s is moved past the jam. Without \
                     it the first policies, which are random, jam whole hours. Last policies are measured without teleports, \
                     as all others are.",
                    "The hand-coded controllers but max-wave decide every second; max-wave decides when agents do. any-light decides \
                     every 2 s, greedy; it was trained on none of these maps.",
                ],
            ),
            RescoProtocol::Ours => (
                "ours",
                &[
                    "Protocol `ours`: agents choose every 5 s. Yellow and least greens are those of the light's own program. \
                     Teleports are as in the map's .sumocfg, or SUMO's default of 300 s. Hand-coded controllers decide every \
                     second, and max-wave every 10 s. any-light is greedy; it was trained on none of these maps.",
                    "Published figures are by another protocol, so they are only a rough guide here.",
                ],
            ),
        };
        Protocol { name, rules: rules.iter().map(|&rule| rule.to_owned()).collect(), which }
    }

    /// Returns the keys of `[traffic]` for a map.
    fn keys(&self, map: &Map) -> String {
        match self.which {
            RescoProtocol::Resco2021 => format!(
                "decision_s = {}\nyellow_s = {}\nmin_green_s = {}\nprogram_min_green = false\n",
                map.decision_s,
                map.yellow_s,
                map.decision_s - map.yellow_s
            ),
            RescoProtocol::Ours => format!("decision_s = {}\n", self.decision_s(map)),
        }
    }

    fn decision_s(&self, map: &Map) -> u64 {
        match self.which {
            RescoProtocol::Resco2021 => map.decision_s.into(),
            RescoProtocol::Ours => ScenarioConfig::default().decision_s.into(),
        }
    }

    /// Returns begin and end of an episode. RESCO's protocol says them; the map's own count in ours.
    fn window_s(&self, copy: &MapCopy) -> [u64; 2] {
        match self.which {
            RescoProtocol::Resco2021 => copy.map.window_s,
            RescoProtocol::Ours => copy.window_s.unwrap_or(copy.map.window_s),
        }
    }

    /// Returns the hand-coded controllers, by the names that the page shows.
    fn controllers(&self, map: &Map) -> Vec<(&'static str, String)> {
        let wave = match self.which {
            RescoProtocol::Resco2021 => format!("max-wave:every={}", map.decision_s),
            RescoProtocol::Ours => "max-wave".to_owned(),
        };
        let named = ["program", "actuated", "gap-out", "max-pressure"].map(|name| (name, name.to_owned()));
        named.into_iter().chain([("max-wave", wave), (ANY_LIGHT, format!("{ANY_LIGHT}:choice=greedy"))]).collect()
    }
}

/// A map that is ready to be trained and measured on.
pub(super) struct Prepared {
    pub(super) map: &'static Map,
    pub(super) lights: usize,
    pub(super) horizon: usize,
    /// Config by which everybody is measured, and the word of its scenario.
    pub(super) measured_on: PathBuf,
    pub(super) scenario: String,
    pub(super) rough_costs: RoughCosts,
    /// Hand-coded controllers that can run its lights, by the names that the page shows.
    pub(super) controllers: Vec<(&'static str, String)>,
    /// Runs to train; `None` if none are asked for.
    pub(super) experiment: Option<Experiment>,
    pub(super) experiment_file: PathBuf,
    pub(super) notes: Vec<String>,
}

impl Prepared {
    /// Writes the files of a map, and reads them as every command does. An error says what is wrong with the map.
    pub(super) fn make(copy: &MapCopy, wanted: &Wanted<'_>, out: &Path) -> Result<Prepared> {
        let (map, protocol) = (copy.map, wanted.protocol);
        let maps = out.join(MAPS);
        let measured = maps.join(PROTOCOL);
        fs::create_dir_all(&measured).with_context(|| format!("{}: cannot be made", measured.display()))?;
        let mut notes = copy.notes.clone();
        let window_s = protocol.window_s(copy);
        if let Some(own) = copy.window_s.filter(|own| *own != window_s) {
            let [[from, to], [begin, end]] = [window_s, own];
            notes.push(format!("Its .sumocfg plays {begin} to {end} s; the protocol plays {from} to {to} s."));
        }
        let teleports = |value: &str| -> Vec<(String, String)> {
            let others = copy.options.iter().filter(|(name, _)| name != TELEPORT).cloned();
            others.chain([(TELEPORT.to_owned(), value.to_owned())]).collect()
        };
        let own = copy.options.iter().find(|(name, _)| name == TELEPORT).map_or("300", |(_, value)| value);
        let strict = protocol.which == RescoProtocol::Resco2021;
        // A copy may say -1 itself, and then the first policies would jam.
        let in_training = if strict && own.starts_with('-') { "300" } else { own };
        let file = format!("{}.sumocfg", map.name);
        write(&maps.join(&file), &sumocfg(copy, window_s, &teleports(in_training))?)?;
        write(&measured.join(&file), &sumocfg(copy, window_s, &teleports(if strict { NO_TELEPORTS } else { own }))?)?;
        let horizon = (window_s[1] - window_s[0]) / protocol.decision_s(map);
        let config = config(copy, wanted, horizon)?;
        let named = |folder: &Path| folder.join(format!("{}.toml", map.name));
        write(&named(&maps), &config)?;
        let measured_on = named(&measured);
        write(&measured_on, &config)?;
        let played: RunConfig = load(&measured_on, &[])?;
        let domain = domains::find(&played)?;
        let lights = domain.agents();
        let mut controllers = Vec::new();
        for (name, text) in protocol.controllers(map) {
            // On some nets SUMO refuses actuated lights. Nothing is simulated to find that out.
            match domain.baseline(&text) {
                Ok(_) => controllers.push((name, text)),
                Err(error) => notes.push(format!("`{name}` is left out. {error:#}")),
            }
        }
        let experiment_file = maps.join(format!("{}.experiment.toml", map.name));
        let experiment = match experiment(map, wanted, lights) {
            None => None,
            Some(text) => {
                write(&experiment_file, &text)?;
                Some(Experiment::read(&experiment_file, &KNOWLEDGE)?)
            }
        };
        Ok(Prepared {
            map,
            lights,
            horizon: horizon as usize,
            measured_on,
            scenario: domain.scenario()?.id.word(),
            rough_costs: domain.rough_costs(),
            controllers,
            experiment,
            experiment_file,
            notes,
        })
    }
}

/// Returns the config of a map: the defaults of scenarios, for this number of episodes.
fn config(copy: &MapCopy, wanted: &Wanted<'_>, horizon: u64) -> Result<String> {
    let routes = match &copy.demands {
        Some(files) => format!("routes = [{}]\n", in_toml(&absolute(files)?)?),
        None => String::new(),
    };
    let total = wanted.episodes.saturating_mul(horizon);
    let [begin, end] = wanted.protocol.window_s(copy);
    Ok(format!(
        "# Written by `benchmark resco`, which writes it again at every call.\n\
         total_steps = {total}\n\n\
         [traffic]\nscenario = \"{name}.sumocfg\"\n{routes}begin_s = {begin}\nend_s = {end}\n{keys}\n\
         [evaluation]\nevery_steps = {every}\nepisodes = 2\nfinal_episodes = 2\n",
        name = copy.map.name,
        keys = wanted.protocol.keys(copy.map),
        every = (total / 2).max(LEAST_PERIOD),
    ))
}

/// Returns a path as text of a config.
fn in_toml(path: &Path) -> Result<String> {
    let text = path.to_str().with_context(|| format!("{}: is not UTF-8; rename it", path.display()))?;
    Ok(toml::Value::String(text.to_owned()).to_string())
}

/// Variant of a method whose lights share a policy.
pub(super) const SHARED: &str = "shared";

/// Least number of steps between two evaluations: at least `ppo.memory` of the defaults of scenarios.
const LEAST_PERIOD: u64 = 600;

/// Returns the file of the experiment with the runs of a map, or `None` if there are none.
fn experiment(map: &Map, wanted: &Wanted<'_>, lights: usize) -> Option<String> {
    let mut text = "# Written by `benchmark resco`, which writes it again at every call.\n".to_owned();
    let mut grids = 0;
    for method in wanted.methods {
        let (simulator, variant) = method.split_once('-').map_or((*method, None), |(one, two)| (one, Some(two)));
        // A light alone has nobody to share with.
        if variant == Some(SHARED) && lights == 1 {
            continue;
        }
        grids += 1;
        text += &format!(
            "\n[[grid]]\nconfigs = [\"{}.toml\"]\nsimulators = [\"{simulator}\"]\nseeds = {:?}\n",
            map.name, wanted.seeds
        );
        if let Some(variant) = variant {
            let set = match variant {
                SHARED => "policy.share=kind",
                ANY_LIGHT => "policy.start=any-light",
                other => unreachable!("the command line takes no method with -{other}"),
            };
            text += &format!("set = [\"{set}\"]\nname = \"{variant}\"\n");
        }
    }
    (grids > 0).then_some(text)
}

fn write(path: &Path, text: &str) -> Result<()> {
    // What is there and right keeps its time of change.
    if fs::read_to_string(path).is_ok_and(|there| there == text) {
        return Ok(());
    }
    fs::write(path, text).with_context(|| format!("{}: cannot be written", path.display()))
}

/// Returns a .sumocfg that names the user's files.
fn sumocfg(copy: &MapCopy, window_s: [u64; 2], options: &[(String, String)]) -> Result<String> {
    let whole = |paths: &[PathBuf]| paths.iter().map(|path| absolute(path)).collect::<Result<Vec<_>>>();
    sumocfg::text(&absolute(&copy.net)?, &whole(&copy.routes)?, &whole(&copy.additional)?, window_s, options)
}
