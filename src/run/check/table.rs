//! The figures of `check` as a table for people.

use super::{Checked, together};
use crate::outside::Printable;
use crate::traffic::fidelity::LightFidelity;
use crate::traffic::fidelity::agreement::{Agreement, Comparison};
use crate::traffic::fidelity::doubts::doubt;

/// Largest number of lights that have a line each. Of more, the worst are shown.
const MOST_LINES: usize = 40;
/// Number of lights that are named as the worst.
const WORST: usize = 3;
/// Longest name in the table, in characters.
const NAME: usize = 16;

/// Returns the whole text.
pub fn described(checked: &Checked) -> String {
    let Checked { window, sigma, lights, .. } = checked;
    let dawdling = sigma.map_or(String::new(), |sigma| format!(", sigma {sigma}"));
    let mut lines = vec![
        format!(
            "local simulators (LS) beside the global one (GS): random greens, seconds {} to {} of the episode{dawdling}",
            window.start, window.end
        ),
        "precision and recall of the LS's cells of 10 m with cars, and its number of cells / the GS's".to_owned(),
        String::new(),
    ];
    let is_random = lights.iter().any(|light| light.other_seed.is_some());
    lines.extend(head(is_random));
    let mut shown: Vec<&LightFidelity> = lights.iter().collect();
    if shown.len() > MOST_LINES {
        shown = worst(lights);
        shown.truncate(MOST_LINES);
    }
    for light in &shown {
        lines.push(line(&light.light, light.true_entries, light.sampled_entries, light.other_seed));
    }
    if lights.len() > 1 {
        let other = is_random.then(|| together(lights, |light| light.other_seed.unwrap_or_default()));
        let [exact, sampled] =
            [together(lights, |light| light.true_entries), together(lights, |light| light.sampled_entries)];
        lines.push(line("all", exact, sampled, other));
        let names: Vec<String> = worst(lights).iter().take(WORST).map(|light| name(&light.light)).collect();
        lines.push(format!("\nleast alike with sampled entries: {}", names.join(", ")));
    }
    let doubts: Vec<String> = lights.iter().filter_map(|light| Some((light, doubt(light)?))).map(told).collect();
    if doubts.is_empty() {
        lines.push("\nall of these local simulators can be trusted".to_owned());
    } else {
        lines.push(String::new());
        lines.extend(doubts);
    }
    lines.join("\n")
}

fn told((light, doubt): (&LightFidelity, String)) -> String {
    format!("warning: light {}: do not trust its LS: {doubt}", Printable(&light.light))
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

fn head(is_random: bool) -> [String; 2] {
    let [group, column] = if is_random { ["  two LSs", "    agree"] } else { [""; 2] };
    [
        format!("{:NAME$}       true entries      sampled entries{group}    speed m/s     passed/h  waiting", ""),
        format!("{:NAME$}  prec.  rec. cells    prec.  rec. cells{column}    GS    LS    GS    LS     cars", "light"),
    ]
}

fn line(light: &str, exact: Comparison, sampled: Comparison, other: Option<Comparison>) -> String {
    let cells = |of: Comparison| {
        let cells = of.cells;
        format!("{:5.3} {:5.3} {:5.2}", cells.precision(), cells.recall(), cells.occupancy_ratio())
    };
    let agree = |cells: Agreement| format!("    {:5.3}", (cells.precision() + cells.recall()) / 2.0);
    let other = other.map_or(String::new(), |other| agree(other.cells));
    let [gs, ls] = sampled.sums;
    let [speeds, passed] = [[gs.mean_speed_mps(), ls.mean_speed_mps()], [gs.passed_per_h(), ls.passed_per_h()]];
    format!(
        "{:NAME$}  {}    {}{other} {:5.1} {:5.1} {:5.0} {:5.0}  {:7.1}",
        name(light),
        cells(exact),
        cells(sampled),
        speeds[0],
        speeds[1],
        passed[0],
        passed[1],
        ls.backlog()
    )
}
