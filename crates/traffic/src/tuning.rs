//! Tuning of lights that go by the clock on the GS: the search, with SUMO to score the candidates.

use anyhow::{Context, Result};

use super::Traffic;
use super::controllers::search::{Judge, grid, net};
use super::controllers::timing_file::{Score, TimingFile, TunedOn};
use super::controllers::{COORDINATED, ClockLights, ClockPlan, HandCoded, Leeway, Webster};
use super::light::KEEP;
use super::sim::control::SignalControl;
use super::sim::global::GlobalTraffic;
use dials_core::base::{RandomPurpose, Seed};
use dials_core::domain::GlobalSimulator;
use libsumo::Simulation;

impl TunedOn {
    pub fn of(traffic: &Traffic, controller: &str, episodes: usize, seed: u64) -> Result<TunedOn> {
        let (network, checksum) = traffic.network.identity();
        Ok(TunedOn {
            controller: controller.to_owned(),
            network,
            network_crc32: format!("{checksum:08x}"),
            horizon: traffic.network.horizon,
            episodes,
            seed: seed.to_string(),
            search_version: if traffic.grid().is_some() { grid::VERSION } else { net::VERSION },
            sumo_version: Simulation::version()?.to_owned(),
        })
    }
}

pub struct TuningProgress {
    /// Number of episodes played, and the most that there can be.
    pub played: usize,
    pub at_most: usize,
    pub best: Score,
}

/// Searches for the best timings of `controller`: those with the greatest mean return of an agent on a grid, and with
/// the least mean delay of a car on other nets. `seed`: of the episodes. All candidates play the same episodes, none of
/// which is an evaluation episode.
pub fn tune(
    traffic: &Traffic,
    wanted: TunedOn,
    seed: u64,
    report: &mut dyn FnMut(TuningProgress),
) -> Result<TimingFile> {
    let plans = traffic.plans();
    let grid = traffic.grid();
    // Measured before the GS of the search is loaded, because SUMO allows one simulation per process.
    let ratios = if grid.is_some() { Vec::new() } else { Webster::default().ratios(traffic)? };
    let mut gs = traffic.global(SignalControl::Agents)?;
    if grid.is_none() {
        gs.measure_in_full()?;
    }
    let horizon = traffic.network.horizon;
    let mut earned = |plan: &ClockPlan, episode: usize| {
        gs.hand_over(traffic.everywhere(HandCoded::rule(ClockLights::new(plan.clone()))));
        if grid.is_none() {
            return Ok(-delay_s(&mut gs, seed, episode, horizon)?);
        }
        let rewards = play(&mut gs, Seed::new(seed).fork(RandomPurpose::Tuning).for_episode(episode), horizon)?;
        Ok(rewards / plans.len() as f64)
    };
    let score = |best: f64| if grid.is_some() { Score::Return(best) } else { Score::DelaySeconds(-best) };
    let mut report = |played, at_most, best| report(TuningProgress { played, at_most, best: score(best) });
    let leeway = (wanted.controller == COORDINATED).then(Leeway::default);
    let judge = Judge::new(wanted.episodes, &mut earned, &mut report);
    let (found, mean) = match grid {
        Some(of) => {
            let shape = grid::Shape { rows: of.rows(), cols: of.cols(), phases: &plans[0].phases };
            grid::search(shape, leeway, judge)?
        }
        None => net::search(plans, &ratios, leeway, judge)?,
    };
    Ok(TimingFile::new(plans, &found, score(mean), wanted))
}

/// Plays an episode of the tuning. Returns the mean delay of a car in seconds.
pub(crate) fn delay_s(gs: &mut GlobalTraffic, seed: u64, episode: usize, horizon: usize) -> Result<f64> {
    play(gs, Seed::new(seed).fork(RandomPurpose::Tuning).for_episode(episode), horizon)?;
    let measures = gs.measures()?.system;
    let delay = measures.iter().find(|(name, _)| name == "delay_s");
    delay.map(|&(_, seconds)| seconds).context("the GS does not measure the delay")
}

fn play(gs: &mut GlobalTraffic, episode: Seed, horizon: usize) -> Result<f64> {
    gs.reset(episode)?;
    let keep = vec![KEEP; gs.agents()];
    let mut sum = 0.0;
    for _ in 0..horizon {
        sum += gs.step(&keep)?.rewards.iter().map(|&reward| f64::from(reward)).sum::<f64>();
    }
    Ok(sum)
}
