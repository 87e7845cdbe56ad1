//! Tuning of lights that go by the clock on the GS (global simulator): the search, with SUMO to score the candidates.

use anyhow::Result;

use super::Traffic;
use super::controllers::search::{self, Ranked, Search};
use super::controllers::timing_file::{TimingFile, TunedOn};
use super::controllers::{COORDINATED, ClockPlan, Coordinated, HandCoded, Leeway};
use super::light::KEEP;
use super::sim::control::SignalControl;
use super::sim::global::GlobalTraffic;
use crate::base::{RandomPurpose, Seed};
use crate::domain::GlobalSimulator;
use crate::sumo::Simulation;

impl TunedOn {
    /// Returns what a tuning of `controller` on `traffic` would depend on.
    pub fn of(traffic: &Traffic, controller: &str, episodes: usize, seed: u64) -> Result<TunedOn> {
        let name = traffic.network.files.net.file_name().unwrap_or_default().to_string_lossy();
        Ok(TunedOn {
            controller: controller.to_owned(),
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

/// Searches for the timings of `controller` with the greatest mean return; `seed`: of the episodes. All candidates play
/// the same episodes, none of which is an evaluation episode.
pub fn tune(traffic: &Traffic, wanted: TunedOn, seed: u64, report: &mut dyn FnMut(Ranked)) -> Result<TimingFile> {
    let mut gs = traffic.global(SignalControl::Agents)?;
    let horizon = traffic.config.horizon;
    let mut score = |plan: &ClockPlan, episode: usize| {
        // Without leeway these are fixed-time lights.
        gs.hand_over(traffic.everywhere(HandCoded::rule(Coordinated::new(plan.clone()))));
        play(&mut gs, Seed::new(seed).fork(RandomPurpose::Tuning).for_episode(episode), horizon)
    };
    let leeway = (wanted.controller == COORDINATED).then(Leeway::default);
    let search = Search { grid: traffic.grid, episodes: wanted.episodes, leeway, score: &mut score, report };
    let (ClockPlan { timings, leeway }, mean_return) = search.run()?;
    Ok(TimingFile {
        vertical: timings[0].vertical,
        horizontal: timings[0].horizontal,
        offsets: timings.iter().map(|timing| timing.offset).collect(),
        early: leeway.early,
        late: leeway.late,
        mean_return,
        tuned_on: wanted,
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
