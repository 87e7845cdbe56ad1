//! The figures of `check` as a table for people.

use super::Checked;
use dials_core::base::for_terminal;
use dials_core::outside::Printable;
use dials_traffic::fidelity::LightFidelity;
use dials_traffic::fidelity::agreement::Comparison;
use dials_traffic::fidelity::doubts::{LEAST_SAMPLED, LEAST_TRUE, doubt};

/// Largest number of lights that have a line each. Of more, the worst are shown.
const MOST_LINES: usize = 40;
/// Number of lights that are named as the worst.
const WORST: usize = 3;
/// Longest name in the table, in characters.
const NAME: usize = 11;

/// Returns the whole text.
pub(super) fn described(checked: &Checked) -> String {
    let Checked { window, sigma, lights, all, on_grid, .. } = checked;
    let (on_grid, is_random) = (*on_grid, all.other_seed.is_some());
    let dawdling = sigma.map_or(String::new(), |sigma| format!(", sigma {sigma}"));
    let without_room = if on_grid { "left out" } else { "waiting" };
    let mut lines = vec![
        for_terminal(&format!(
            "local simulators (LS) beside the global one (GS): random greens, seconds {} to {} of the episode{dawdling}",
            window.start, window.end
        )),
        for_terminal(&format!(
            "precision and recall of the LS's cells of 10 m with cars, and its number of cells / the GS's; \
             {without_room}: cars without room at the border"
        )),
        String::new(),
    ];
    lines.extend(head(is_random, on_grid));
    let worst = worst(lights);
    let shown = if lights.len() > MOST_LINES { worst[..MOST_LINES].to_vec() } else { lights.iter().collect() };
    lines.extend(shown.iter().map(|light| line(light, on_grid)));
    if lights.len() > 1 {
        lines.push(line(all, on_grid));
        if shown.len() < lights.len() {
            let (shown, all) = (shown.len(), lights.len());
            lines.push(format!("\nthese are the {shown} least alike of {all} lights; --json has all"));
        }
        let names: Vec<String> = worst.iter().take(WORST).map(|light| Printable(&light.light).to_string()).collect();
        lines.push(for_terminal(&format!("\nleast alike with sampled entries: {}", names.join(", "))));
    }
    lines.push(String::new());
    let warnings: Vec<String> = lights.iter().filter_map(warning).collect();
    if warnings.is_empty() {
        lines.push(verdict(lights.len(), is_random));
    } else {
        lines.extend(warnings);
    }
    lines.join("\n")
}

/// Returns what follows if there is no doubt about any light. If cars dawdle at random, that is less.
fn verdict(lights: usize, is_random: bool) -> String {
    let these = if lights == 1 { "this local simulator".to_owned() } else { format!("all {lights} local simulators") };
    if !is_random {
        return format!("{these} can be trusted");
    }
    let [exact, sampled] = [LEAST_TRUE, LEAST_SAMPLED].map(|share| format!("{:.0} %", 100.0 * share));
    let is = if lights == 1 { "is" } else { "are" };
    let compared = format!(
        "{these} {is} nearly as like the GS as two LSs with other random numbers are to each other: at least {exact} of \
         that with true entries, {sampled} with sampled ones"
    );
    let limits = "random numbers hide smaller faults; --sigma 0 takes them out and says what can be trusted";
    [compared, limits.to_owned()].map(|line| for_terminal(&line)).join("\n")
}

fn warning(light: &LightFidelity) -> Option<String> {
    let (doubt, light) = (doubt(light)?, Printable(&light.light));
    Some(for_terminal(&format!("warning: light {light}: do not trust its LS: {doubt}")))
}

/// Returns the lights, the least alike first.
fn worst(lights: &[LightFidelity]) -> Vec<&LightFidelity> {
    let likeness = |light: &LightFidelity| {
        let cells = light.sampled_entries.cells;
        cells.precision().min(cells.recall())
    };
    let mut sorted: Vec<&LightFidelity> = lights.iter().collect();
    sorted.sort_by(|one, other| likeness(one).total_cmp(&likeness(other)));
    sorted
}

/// Returns the name of a light, shortened if it is long.
fn name(light: &str) -> String {
    let name = Printable(light).to_string();
    if name.chars().count() <= NAME {
        return name;
    }
    name.chars().take(NAME - 2).chain("..".chars()).collect()
}

fn head(is_random: bool, on_grid: bool) -> [String; 2] {
    let [group, column] = if is_random { ["   two", "   LSs"] } else { [""; 2] };
    let [without, room] = if on_grid { [" left", "  out"] } else { ["wait-", "  ing"] };
    [
        format!("{:NAME$}      true entries  sampled entries{group} speed m/s    passed/h {without}", ""),
        format!("{:NAME$}  prec. rec. cells prec. rec. cells{column}   GS   LS    GS    LS {room}", "light"),
    ]
}

fn line(light: &LightFidelity, on_grid: bool) -> String {
    let cells = |of: Comparison| {
        let cells = of.cells;
        format!("{:6.2} {:4.2} {:5.2}", cells.precision(), cells.recall(), cells.occupancy_ratio())
    };
    let agree = |of: Comparison| format!("  {:4.2}", (of.cells.precision() + of.cells.recall()) / 2.0);
    let [gs, ls] = light.sampled_entries.sums;
    let without_room = if on_grid { ls.dropped.to_string() } else { format!("{:.1}", ls.backlog()) };
    format!(
        "{:NAME$} {}{}{} {:4.1} {:4.1} {:5.0} {:5.0} {without_room:>5}",
        name(&light.light),
        cells(light.true_entries),
        cells(light.sampled_entries),
        light.other_seed.map_or(String::new(), agree),
        gs.mean_speed_mps(),
        ls.mean_speed_mps(),
        gs.passed_per_h(),
        ls.passed_per_h()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::check::together;
    use dials_core::base::AgentId;
    use dials_traffic::fidelity::Causes;
    use dials_traffic::fidelity::agreement::{Agreement, Sums};

    fn shown(lights: usize, is_random: bool, dropped: u64) -> String {
        let sums = Sums { seconds: 600, passed: 3000, car_seconds: 600, speed_sum_mps: 8000.0, ..Sums::default() };
        let cells = Agreement { first: 100, second: 100, both: 90 };
        let alike = Comparison { cells, sums: [sums, Sums { dropped, ..sums }] };
        let light = LightFidelity {
            agent: AgentId(0),
            light: "cluster_1234567_891011".to_owned(),
            true_entries: alike,
            sampled_entries: alike,
            other_seed: is_random.then_some(alike),
            causes: Causes::default(),
        };
        let lights = vec![light; lights];
        let (all, on_grid) = (together(&lights), dropped > 0);
        described(&Checked { window: 600..1800, sigma: None, seed: 0, lights, all, on_grid })
    }

    #[test]
    fn many_lights_are_the_least_alike_and_the_text_says_so() {
        let line = "\nthese are the 40 least alike of 41 lights; --json has all\n";
        assert!(shown(MOST_LINES + 1, false, 0).contains(line));
        assert!(!shown(MOST_LINES, false, 0).contains("least alike of"));
    }

    #[test]
    fn on_a_grid_cars_without_room_are_counted_as_left_out() {
        let text = shown(1, false, 7);
        assert!(text.contains("left out: cars without room at the border"), "{text}");
        assert!(text.contains("     7\n\nthis local simulator"), "{text}");
    }

    #[test]
    fn only_without_random_numbers_a_local_simulator_can_be_trusted() {
        assert!(shown(1, false, 0).ends_with("\nthis local simulator can be trusted"));
        assert!(shown(2, false, 0).ends_with("\nall 2 local simulators can be trusted"));
        for lights in [1, 2] {
            let text = shown(lights, true, 0);
            assert!(
                !text.contains("simulator can be trusted") && !text.contains("simulators can be trusted"),
                "{text}"
            );
            assert!(text.contains("at least 80 %") && text.contains("--sigma 0"), "{text}");
        }
    }
}
