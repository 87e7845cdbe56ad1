//! Plans from the names of controllers whose timings are known beforehand, and the search for better ones.

use anyhow::{Context, Result, ensure};

use super::coordinate::Coordination;
use super::day::{DayPlan, Period};
use super::periods::{SLICE_S, periods, sum};
use crate::Traffic;
use crate::agents::plan::AgentPlan;
use crate::controllers::search::{Judge, net};
use crate::controllers::timing_file::Score;
use crate::controllers::webster::timing;
use crate::controllers::{self, ClockLights, ClockPlan, HandCoded, Timed, Timing, Webster};
use crate::sim::control::SignalControl;
use crate::tuning::{TuningProgress, delay_s};
use dials_core::domain::GlobalSimulator;

/// Returns the plan of a controller. `None`: it looks at the traffic, so what it shows has to be watched.
///
/// Webster's plan has a period for each change of the demand. Leeway of coordinated lights is left out, because no plan
/// has any. A green that is shorter than the light's minimum has that.
pub fn timed(traffic: &Traffic, controller: &str) -> Result<Option<DayPlan>> {
    let (plans, window_s) = (traffic.plans(), traffic.window_s());
    let Some(timed) = controllers::timed(controller, plans)? else { return Ok(None) };
    Ok(Some(match timed {
        Timed::Timings(timings) => {
            let timings = plans.iter().zip(&timings).map(|(plan, timing)| with_least_greens(plan, timing)).collect();
            DayPlan::of_all_day(timings, window_s)
        }
        Timed::Coordinated => DayPlan::of_all_day(Coordination::measure(traffic)?.timings(plans), window_s),
        Timed::Webster(webster) => of_webster(traffic, &webster)?,
    }))
}

fn with_least_greens(plan: &AgentPlan, timing: &Timing) -> Timing {
    let least = plan.phases.min_green_steps();
    let lengths =
        timing.greens().iter().zip(least).map(|(&green, &least)| if green > 0 { green.max(least) } else { 0 });
    timing.with_lengths(&plan.phases, &plan.phases.fitted(&lengths.collect::<Vec<_>>()))
}

/// Returns Webster's timings of each period. All periods show the greens that the whole demand needs.
fn of_webster(traffic: &Traffic, webster: &Webster) -> Result<DayPlan> {
    let plans = traffic.plans();
    let slices = webster.flows(traffic, SLICE_S)?;
    let all = webster.ratios_of(plans, &sum(&slices, &(0..slices.len())));
    let (begin_s, end_s) = traffic.window_s();
    let of_period = |slices_of: std::ops::Range<usize>| {
        let ratios = webster.ratios_like(plans, &all, &sum(&slices, &slices_of));
        Period {
            begin_s: begin_s + (slices_of.start * SLICE_S) as u64,
            timings: plans.iter().zip(&ratios).map(|(plan, ratios)| timing(plan, ratios)).collect(),
        }
    };
    Ok(DayPlan { periods: periods(&slices).into_iter().map(of_period).collect(), end_s })
}

/// Searches for better timings, from those of a plan on: it changes one light after the other a little. Returns the best
/// plan found. All plans play the same episodes, none of which is an evaluation episode.
pub fn tune(
    traffic: &Traffic,
    plan: &DayPlan,
    episodes: usize,
    seed: u64,
    report: &mut dyn FnMut(TuningProgress),
) -> Result<DayPlan> {
    ensure!(
        plan.periods.len() == 1,
        "--tune: this plan has {} periods, and only one can be tuned; shorten the window with --begin and --end, or leave \
         --tune out",
        plan.periods.len()
    );
    let mut gs = traffic.global(SignalControl::Agents)?;
    gs.measure_in_full()?;
    let mut earned = |plan: &ClockPlan, episode: usize| {
        gs.hand_over(traffic.everywhere(HandCoded::rule(ClockLights::new(plan.clone()))));
        Ok(-delay_s(&mut gs, seed, episode, traffic.network.horizon)?)
    };
    let mut report = |played, at_most, best: f64| {
        report(TuningProgress { played, at_most, best: Score::DelaySeconds(-best) });
    };
    let judge = Judge::new(episodes, &mut earned, &mut report);
    let timings = plan.periods[0].timings.clone();
    let (found, _) = net::improve(traffic.plans(), timings, judge).context("the search for better timings stopped")?;
    Ok(DayPlan::of_all_day(found.timings, traffic.window_s()))
}
