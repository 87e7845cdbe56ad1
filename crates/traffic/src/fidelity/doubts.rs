//! Whether an LS can be trusted, the limits for that, and what spoils it, read off the recorded episode on the GS.

use std::ops::Range;

use super::LightFidelity;
use super::agreement::Agreement;
use super::truth::Truth;
use crate::Traffic;
use crate::agents::border_plan::{BorderPlan, EntryPlace};
use crate::inflow::is_blocked;
use dials_core::base::{AgentId, counted};
use dials_core::domain::Result;

/// Length below which a road is short, in metres: a car is through in a few seconds, and chooses its lane before.
const SHORT_M: f64 = 30.0;
/// Length below which a car of SUMO's usual type, with the gap before it, has no room on a road, in metres. SUMO holds it before
/// the light while somebody behind that road gives way, and an LS knows nobody there.
const ROOM_M: f64 = 7.5;
/// How far behind its beginning the last car of a full exit stands at most, in metres: another one does not fit in.
const FULL_M: f64 = 15.0;
const JAMMED_MPS: f64 = 1.0;

/// Least precision and recall with true entries. If cars dawdle: as a share of what two LSs have.
pub const LEAST_TRUE: f64 = 0.8;
/// The same with sampled entries.
pub const LEAST_SAMPLED: f64 = 0.7;
/// Least precision and recall of two LSs with other random numbers. Below it they are no measure for a third one.
const LEAST_OTHER: f64 = 0.6;
/// Least and most cells that the LS has for one of the GS, with sampled entries.
const CELLS: [f64; 2] = [0.85, 1.15];
/// Least and most cars that cross the stop lines in the LS for one in the GS, with sampled entries.
const PASSED: [f64; 2] = [0.9, 1.1];
/// Least number of cars that cross the stop lines in the GS. Of fewer, a single one is more than [`PASSED`] allows.
const LEAST_PASSED: u64 = 10;
/// Largest share of the seconds in which cars stand at green because their exit is full.
const MOST_SPILLBACK: f64 = 0.03;
/// Mean speed on the approaches of the GS below which they are jammed, in metres per second.
const JAMMED_APPROACH_MPS: f64 = 2.0;
/// Largest share of the cars whose trip ends on a road of the region. SUMO forgets where a car is to arrive when it is put
/// somewhere.
const MOST_ENDS: f64 = 0.05;
/// Largest share of the cars that come in by short roads, and of those that leave by roads without room for a car.
const MOST_SHORT: f64 = 0.25;
/// Largest share of the cars that find no room at the border, and wait there or are left out.
const MOST_WITHOUT_ROOM: f64 = 0.1;

/// Returns why the LS of a light should not be trusted, a line. `None`: it is like the GS.
pub fn doubt(found: &LightFidelity) -> Option<String> {
    let passed = found.sampled_entries.sums[0].passed;
    if passed < LEAST_PASSED {
        return Some(format!(
            "it cannot be judged: {} passed in the GS in these seconds (at least {LEAST_PASSED} are needed); take others \
             with --from and --seconds",
            counted(passed as usize, "car")
        ));
    }
    let [precision, recall] = of_other(found);
    let alike = precision.min(recall);
    if alike < LEAST_OTHER {
        return Some(format!(
            "it cannot be judged: two LSs with other random numbers agree to {alike:.2} only (at least {LEAST_OTHER:.2} is \
             needed); take the random numbers out with --sigma 0"
        ));
    }
    let symptoms = symptoms(found);
    if symptoms.is_empty() {
        return None;
    }
    Some(format!("{}. Why: {}", symptoms.join("; "), causes(found)))
}

fn symptoms(found: &LightFidelity) -> Vec<String> {
    let mut symptoms = Vec::new();
    for (entries, cells, least) in [
        ("true entries", found.true_entries.cells, LEAST_TRUE),
        ("sampled entries", found.sampled_entries.cells, LEAST_SAMPLED),
    ] {
        for (name, value, least) in too_low(found, cells, least) {
            symptoms.push(format!("{name} {value:.2} with {entries} (at least {least:.2} is fine)"));
        }
    }
    let [gs, ls] = found.sampled_entries.sums;
    let passed = if gs.passed == ls.passed { 1.0 } else { ls.passed as f64 / gs.passed.max(1) as f64 };
    for (what, ratio, [least, most]) in
        [("cells with cars", found.sampled_entries.cells.occupancy_ratio(), CELLS), ("cars that pass", passed, PASSED)]
    {
        if !(least..=most).contains(&ratio) {
            symptoms.push(format!("{what}: {ratio:.2} times as many as in the GS ({least} to {most} is fine)"));
        }
    }
    symptoms
}

fn causes(found: &LightFidelity) -> String {
    let ls = found.sampled_entries.sums[1];
    let [spillback, short_entries, waited, dropped] =
        [found.causes.spillback, found.causes.short_entries, ls.waited_share(), ls.dropped_share()];
    let percent = |share: f64| format!("{:.0} %", 100.0 * share);
    let mut causes = Vec::new();
    if spillback > MOST_SPILLBACK {
        let seconds = percent(spillback);
        causes.push(format!("spillback: cars stood at green before a full exit in {seconds} of the seconds"));
    }
    if short_entries > MOST_SHORT {
        let cars = percent(short_entries);
        causes.push(format!("short edges: {cars} of the cars came in by a road shorter than {SHORT_M} m"));
    }
    if found.causes.short_exits > MOST_SHORT {
        let cars = percent(found.causes.short_exits);
        causes.push(format!(
            "short exits: {cars} of the cars left by a road shorter than {ROOM_M} m, without room for one, and what holds them \
             behind it is not in its LS"
        ));
    }
    if found.causes.ends > MOST_ENDS {
        let cars = percent(found.causes.ends);
        causes.push(format!(
            "trips end on its roads, of {cars} of the cars: with true entries, and only there, these drive on to the road's end"
        ));
    }
    if waited > MOST_WITHOUT_ROOM {
        causes.push(format!("{} of the cars waited at the border for room", percent(waited)));
    }
    if dropped > MOST_WITHOUT_ROOM {
        causes.push(format!("{} of the cars found no room at the border and were left out", percent(dropped)));
    }
    let speed_mps = found.true_entries.sums[0].mean_speed_mps();
    if speed_mps < JAMMED_APPROACH_MPS {
        causes.push(format!("a jam: its cars drive at {speed_mps:.1} m/s, and in a jam small differences add up"));
    }
    let lost = found.true_entries.sums[1].lost;
    if lost > 0 {
        causes.push(format!("{lost} cars left their way, as SUMO moves cars past a jam"));
    }
    if causes.is_empty() {
        let by_rule = too_low(found, found.true_entries.cells, LEAST_TRUE).is_empty();
        let rule = "the entry rule: with true entries this LS is like the GS";
        causes.push(if by_rule { rule } else { "no cause was found" }.to_owned());
    }
    causes.join("; ")
}

/// Returns precision and recall where they are too low: name, value, and what it should be.
fn too_low(found: &LightFidelity, cells: Agreement, least: f64) -> Vec<(&'static str, f64, f64)> {
    let values = ["precision", "recall"].into_iter().zip(both(cells)).zip(of_other(found));
    let values = values.map(|((name, value), best)| (name, value, least * best));
    values.filter(|(_, value, least)| value < least).collect()
}

/// Returns precision and recall of two LSs with other random numbers. If nothing is random: 1.
fn of_other(found: &LightFidelity) -> [f64; 2] {
    found.other_seed.map_or([1.0; 2], |other| both(other.cells))
}

fn both(cells: Agreement) -> [f64; 2] {
    [cells.precision(), cells.recall()]
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Causes {
    /// Share of the seconds in which cars stand at green because their exit is full.
    pub spillback: f64,
    /// Share of the cars that come in by a road shorter than [`SHORT_M`].
    pub short_entries: f64,
    /// Share of the cars that leave by a road shorter than [`ROOM_M`].
    pub short_exits: f64,
    /// Share of the cars whose trip ends before the end of a road of the region.
    pub ends: f64,
}

impl Causes {
    pub(crate) fn of(truth: &Truth, traffic: &Traffic, agent: AgentId, window: &Range<usize>) -> Result<Causes> {
        let border = traffic.plan.borders.get(agent.0).map(|border| &border.plan);
        Ok(Causes {
            spillback: spillback(truth, traffic, agent, window)?,
            short_entries: border.map_or(0.0, |border| short_entries(truth, border, agent, window)),
            short_exits: border.map_or(0.0, |border| short_exits(truth, border, agent, window)),
            ends: ends(truth, agent, window),
        })
    }
}

fn spillback(truth: &Truth, traffic: &Traffic, agent: AgentId, window: &Range<usize>) -> Result<f64> {
    let region = &traffic.plan.agents[agent.0].region;
    let lanes = region.approaches.iter().map(|approach| &approach.lane);
    let lanes = lanes.chain(region.exits.iter().map(|exit| &exit.lane));
    let mut seconds = 0;
    let steps = truth.recording.steps.iter().zip(truth.on_lanes(lanes.map(String::as_str))?);
    for (step, cars) in steps.skip(window.start).take(window.len()) {
        let letters = step.signals[agent.0].as_str().as_bytes();
        let is_held = |from: usize, to: usize| {
            let (approach, exit) = (&region.approaches[from], cars.lane(region.approaches.len() + to));
            let last = exit.iter().next();
            let is_full = last.is_some_and(|car| car.position_m < FULL_M && car.speed_mps < JAMMED_MPS);
            is_full && is_blocked(cars.lane(from), approach.length_m)
        };
        let green = region.links.iter().filter(|link| matches!(letters[link.letter], b'G' | b'g'));
        seconds += usize::from(green.into_iter().any(|link| is_held(link.from, link.to)));
    }
    Ok(seconds as f64 / window.len().max(1) as f64)
}

fn ends(truth: &Truth, agent: AgentId, window: &Range<usize>) -> f64 {
    let Some(visits) = &truth.visits else { return 0.0 };
    let visits = visits.of_agents[agent.0].iter().filter(|visit| window.contains(&visit.second));
    share_of(visits.map(|visit| visit.end_m.is_some()))
}

fn short_entries(truth: &Truth, border: &BorderPlan, agent: AgentId, window: &Range<usize>) -> f64 {
    let Some(visits) = &truth.visits else { return 0.0 };
    let visits = visits.of_agents[agent.0].iter().filter(|visit| window.contains(&visit.second));
    let is_short = visits.filter_map(|visit| match border.entries[visit.entry?].place {
        EntryPlace::Lane(lane) => Some(border.lanes[lane].length_m < SHORT_M),
        // A car that departs inside does not come in by a road.
        EntryPlace::Road(_) => Some(false),
    });
    share_of(is_short)
}

fn short_exits(truth: &Truth, border: &BorderPlan, agent: AgentId, window: &Range<usize>) -> f64 {
    let Some(visits) = &truth.visits else { return 0.0 };
    let visits = visits.of_agents[agent.0].iter().filter(|visit| window.contains(&visit.second));
    let leave = visits.filter(|visit| !visit.next_roads.is_empty()).filter_map(|visit| visit.way.last());
    share_of(leave.map(|road| {
        let mut exits = border.exits.iter().filter(|&&lane| border.is_on_road(lane, road));
        exits.any(|&lane| border.lanes[lane].length_m < ROOM_M)
    }))
}

fn share_of(which: impl Iterator<Item = bool>) -> f64 {
    let (mut those, mut all) = (0, 0);
    for is_one in which {
        those += u32::from(is_one);
        all += 1;
    }
    f64::from(those) / f64::from(all.max(1))
}

#[cfg(test)]
mod tests {
    use super::super::agreement::{Comparison, Sums};
    use super::*;

    fn comparison(first: u64, second: u64, both: u64) -> Comparison {
        let cars = Sums { car_seconds: 1000, speed_sum_mps: 5000.0, ..Sums::default() };
        let sums = Sums { seconds: 600, passed: 100, came: 100, ..cars };
        Comparison { cells: Agreement { first, second, both }, sums: [sums; 2] }
    }

    fn light() -> LightFidelity {
        LightFidelity {
            agent: AgentId(0),
            light: "a".to_owned(),
            true_entries: comparison(100, 100, 90),
            sampled_entries: comparison(100, 100, 80),
            other_seed: None,
            causes: Causes::default(),
        }
    }

    #[test]
    fn a_light_like_the_global_one_raises_no_doubt_whatever_might_spoil_it() {
        let causes = Causes { spillback: 0.5, short_entries: 1.0, short_exits: 1.0, ends: 1.0 };
        assert_eq!(doubt(&LightFidelity { causes, ..light() }), None);
    }

    #[test]
    fn a_light_that_differs_is_named_with_the_causes_beyond_their_limits() {
        let mut found =
            LightFidelity { causes: Causes { spillback: 0.12, short_entries: 0.2, ..Causes::default() }, ..light() };
        found.true_entries = comparison(100, 80, 75);
        found.sampled_entries = comparison(100, 80, 75);
        found.sampled_entries.sums[1].passed = 130;
        found.sampled_entries.sums[1].waited = 11;
        assert_eq!(
            doubt(&found).unwrap(),
            "recall 0.75 with true entries (at least 0.80 is fine); cells with cars: 0.80 times as many as in the GS \
             (0.85 to 1.15 is fine); cars that pass: 1.30 times as many as in the GS (0.9 to 1.1 is fine). Why: \
             spillback: cars stood at green before a full exit in 12 % of the seconds; 11 % of the cars waited at the \
             border for room"
        );
    }

    #[test]
    fn each_cause_has_its_limit() {
        let apart = LightFidelity { true_entries: comparison(100, 100, 70), ..light() };
        let dropped = |cars| {
            let mut found = apart.clone();
            found.sampled_entries.sums[1].dropped = cars;
            found
        };
        let other_seed = |both| LightFidelity { other_seed: Some(comparison(100, 100, both)), ..apart.clone() };
        let passed = |passed| {
            let mut found = apart.clone();
            found.sampled_entries.sums[0].passed = passed;
            found
        };
        let short_exits = |short_exits| {
            let causes = Causes { short_exits, ..Causes::default() };
            LightFidelity { causes, ..apart.clone() }
        };
        let mut jammed = apart.clone();
        jammed.true_entries.sums[0].speed_sum_mps = 1900.0;
        let by_rule = LightFidelity { sampled_entries: comparison(100, 100, 60), ..light() };
        for (found, why) in [
            (jammed, "Why: a jam: its cars drive at 1.9 m/s, and in a jam small differences add up"),
            (short_exits(0.25), "Why: no cause was found"),
            (
                short_exits(0.26),
                "Why: short exits: 26 % of the cars left by a road shorter than 7.5 m, without room for one, and what holds \
                 them behind it is not in its LS",
            ),
            (dropped(10), "Why: no cause was found"),
            (dropped(11), "Why: 11 % of the cars found no room at the border and were left out"),
            (by_rule, "Why: the entry rule: with true entries this LS is like the GS"),
            // 0.7 is more than 0.8 of 0.5, but two LSs that agree to 0.5 only show nothing.
            (passed(9), "(at least 10 are needed); take others with --from and --seconds"),
            (passed(10), "Why: no cause was found"),
            (other_seed(50), "(at least 0.60 is needed); take the random numbers out with --sigma 0"),
        ] {
            let message = doubt(&found).unwrap();
            assert!(message.ends_with(why), "{message}");
        }
        assert!(doubt(&passed(1)).unwrap().starts_with("it cannot be judged: 1 car passed in the GS"));
        // 0.7 is 82 % of 0.85.
        assert_eq!(doubt(&other_seed(85)), None);
    }
}
