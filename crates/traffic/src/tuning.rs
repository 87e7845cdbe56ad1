//! Tuning of lights that go by the clock on the GS (global simulator): the search, with SUMO to score the candidates.

use anyhow::{Context, Result};

use super::Traffic;
use super::controllers::search::{Judge, Ranked, grid, net};
use super::controllers::timing_file::{Score, TimingFile, TunedOn};
use super::controllers::{COORDINATED, ClockPlan, Coordinated, HandCoded, Leeway, TimingPlan};
use super::light::KEEP;
use super::sim::control::SignalControl;
use super::sim::global::GlobalTraffic;
use dials_core::base::{RandomPurpose, Seed};
use dials_core::domain::GlobalSimulator;
use libsumo::Simulation;

impl TunedOn {
    /// Returns what a tuning of `controller` on `traffic` would depend on.
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
            sumo_version: Simulation::version()?,
        })
    }
}

/// Progress of a tuning.
pub struct Standing {
    /// Number of episodes played, and the most that there can be.
    pub played: usize,
    pub at_most: usize,
    pub best: Score,
}

/// Searches for the best timings of `controller`: those with the greatest mean return on a grid, and with the least mean
/// delay on other nets. `seed`: of the episodes. All candidates play the same episodes, none of which is an evaluation
/// episode.
pub fn tune(traffic: &Traffic, wanted: TunedOn, seed: u64, report: &mut dyn FnMut(Standing)) -> Result<TimingFile> {
    let plans = traffic.plans();
    let by = Objective::of_a_grid(traffic.grid().is_some());
    // Measured before the GS of the search is loaded, because SUMO allows one simulation per process.
    let ratios = match by {
        Objective::Return => Vec::new(),
        Objective::Delay => TimingPlan::default().ratios(plans, traffic)?,
    };
    let mut gs = traffic.global(SignalControl::Agents)?;
    if by == Objective::Delay {
        gs.measure_in_full()?;
    }
    let horizon = traffic.network.horizon;
    let mut score = |plan: &ClockPlan, episode: usize| {
        // Without leeway these are fixed-time lights.
        gs.hand_over(traffic.everywhere(HandCoded::rule(Coordinated::new(plan.clone()))));
        by.play(&mut gs, Seed::new(seed).fork(RandomPurpose::Tuning).for_episode(episode), horizon)
    };
    let mut report = |Ranked { played, at_most, best }| report(Standing { played, at_most, best: by.score(best) });
    let leeway = (wanted.controller == COORDINATED).then(Leeway::default);
    let judge = Judge { episodes: wanted.episodes, score: &mut score, report: &mut report };
    let (found, mean) = match traffic.grid() {
        Some(of) => {
            let shape = grid::Shape { rows: of.rows(), cols: of.cols(), phases: &plans[0].phases };
            grid::Search { grid: shape, leeway, judge }.run()?
        }
        None => net::Search { plans, ratios: &ratios, leeway, judge }.run()?,
    };
    Ok(TimingFile::new(plans, &found, by.score(mean), wanted))
}

/// What a search looks for. The greater, the better.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Objective {
    /// Mean return of an agent.
    Return,
    /// Mean delay of a car, which counts as negative.
    Delay,
}

impl Objective {
    fn of_a_grid(is_grid: bool) -> Objective {
        if is_grid { Objective::Return } else { Objective::Delay }
    }

    /// Returns the score that was maximised, as people read it.
    fn score(self, best: f64) -> Score {
        match self {
            Objective::Return => Score::Return(best),
            Objective::Delay => Score::DelaySeconds(-best),
        }
    }

    /// Returns what an episode earns.
    fn play(self, gs: &mut GlobalTraffic, episode: Seed, horizon: usize) -> Result<f64> {
        gs.reset(episode)?;
        let keep = vec![KEEP; gs.agents()];
        let mut sum = 0.0;
        for _ in 0..horizon {
            sum += gs.step(&keep)?.rewards.iter().map(|&reward| f64::from(reward)).sum::<f64>();
        }
        match self {
            Objective::Return => Ok(sum / keep.len() as f64),
            Objective::Delay => {
                let measures = gs.measures()?.system;
                let delay = measures.iter().find(|(name, _)| name == "delay_s");
                delay.map(|(_, seconds)| -seconds).context("the GS does not measure the delay")
            }
        }
    }
}
