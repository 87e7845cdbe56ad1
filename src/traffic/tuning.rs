//! Tuning of fixed-time lights on the GS (global simulator): the search, with SUMO to score the candidates.

use anyhow::Result;

use super::Traffic;
use super::controllers::search::{self, Ranked, Search};
use super::controllers::timing_file::{TimingFile, TunedOn};
use super::controllers::{FixedTime, HandCoded, Timing};
use super::light::KEEP;
use super::sim::control::SignalControl;
use super::sim::global::GlobalTraffic;
use crate::base::{RandomPurpose, Seed};
use crate::domain::GlobalSimulator;
use crate::sumo::Simulation;

impl TunedOn {
    /// Returns what a tuning on `traffic` would depend on.
    pub fn of(traffic: &Traffic, episodes: usize, seed: u64) -> Result<TunedOn> {
        let name = traffic.network.files.net.file_name().unwrap_or_default().to_string_lossy();
        Ok(TunedOn {
            network: name.strip_suffix(".net.xml").unwrap_or(&name).to_owned(),
            network_crc32: format!("{:08x}", traffic.network.checksum()),
            horizon: traffic.config.horizon,
            episodes,
            seed: seed.to_string(),
            search_version: search::VERSION,
            sumo_version: Simulation::version()?,
        })
    }
}

/// Searches for the timings with the greatest mean return. All candidates play the same episodes, none of which is an
/// evaluation episode.
pub fn tune(traffic: &Traffic, episodes: usize, seed: u64, report: &mut dyn FnMut(Ranked)) -> Result<TimingFile> {
    let mut gs = traffic.global(SignalControl::Agents)?;
    let horizon = traffic.config.horizon;
    let mut score = |timings: &[Timing], episode: usize| {
        gs.hand_over(traffic.everywhere(HandCoded::rule(FixedTime::new(timings.to_vec()))));
        play(&mut gs, Seed::new(seed).fork(RandomPurpose::Tuning).for_episode(episode), horizon)
    };
    let search = Search { grid: traffic.grid, episodes, score: &mut score, report };
    let (timings, mean_return) = search.run()?;
    Ok(TimingFile {
        vertical: timings[0].vertical,
        horizontal: timings[0].horizontal,
        offsets: timings.iter().map(|timing| timing.offset).collect(),
        mean_return,
        tuned_on: TunedOn::of(traffic, episodes, seed)?,
    })
}

/// Returns the mean return of an agent in one episode.
fn play(gs: &mut GlobalTraffic, episode: Seed, horizon: usize) -> Result<f64> {
    gs.reset(episode)?;
    let keep = vec![KEEP; gs.agents()];
    let mut sum = 0.0;
    for _ in 0..horizon {
        sum += gs.step(&keep)?.rewards.iter().map(|&reward| f64::from(reward)).sum::<f64>();
    }
    Ok(sum / keep.len() as f64)
}
