//! The route file of an episode, where each episode plays one of several.

use std::path::Path;

use crate::network::loadable::Loadable;
use crate::road_network::RoadNetwork;
use crate::scenario::SumoScenario;
use dials_core::base::Seed;
use dials_core::domain::Result;

pub(super) struct RouteFile {
    number: usize,
    /// Number of the file that all episodes play, whatever they draw.
    fixed: Option<usize>,
    /// The scenario with this file alone.
    pub(super) scenario: SumoScenario,
}

impl RouteFile {
    /// Returns the first one. `None`: all episodes play the same.
    pub(super) fn first(network: &RoadNetwork) -> Result<Option<RouteFile>> {
        let there_are_some = network.route_files() > 0;
        let first = || Ok(RouteFile { number: 0, fixed: None, scenario: network.playing(0)? });
        there_are_some.then(first).transpose()
    }

    pub(super) fn fix(&mut self, number: usize) {
        self.fixed = Some(number);
    }

    /// Takes the file that an episode draws. Returns whether it is another one than before.
    pub(super) fn draw(&mut self, network: &RoadNetwork, episode: Seed) -> Result<bool> {
        let Some(number) = self.fixed.or_else(|| network.drawn_by(episode)) else { return Ok(false) };
        if number == self.number {
            return Ok(false);
        }
        self.scenario = network.playing(number)?;
        self.number = number;
        Ok(true)
    }
}

/// Returns what SUMO loads. `programs`: text of a further additional file.
pub(super) fn source(network: &RoadNetwork, file: Option<&RouteFile>, programs: Option<&str>) -> Result<Loadable> {
    let source = network.source(file.map(|file| &file.scenario))?;
    match programs {
        Some(text) => source.with_additional(text, Path::new("PROGRAMS")),
        None => Ok(source),
    }
}
