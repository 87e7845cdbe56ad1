//! Whether a local simulator (LS) can be trusted, and the limits for that.

use super::LightFidelity;
use super::agreement::{Agreement, Comparison};
use super::causes::SHORT_M;

/// Least precision and recall with true entries. With cars that dawdle: as a share of what two LSs with other random
/// numbers have.
pub const LEAST_TRUE: f64 = 0.75;
/// The same with sampled entries.
pub const LEAST_SAMPLED: f64 = 0.65;
/// Cells that the LS has for one of the GS (global simulator), least and most, with sampled entries.
pub const OCCUPANCY: [f64; 2] = [0.85, 1.15];
/// Largest share of the cars that wait at the border because they find no room.
pub const MOST_WAITED: f64 = 0.10;
/// Largest share of the seconds in which cars stand at green because their exit is full.
pub const MOST_SPILLBACK: f64 = 0.05;
/// Largest share of the cars that come in by short roads.
pub const MOST_SHORT: f64 = 0.25;

/// Returns why the LS of a light should not be trusted, a line. `None`: it is like the GS.
pub fn doubt(found: &LightFidelity) -> Option<String> {
    let symptoms = symptoms(found);
    if symptoms.is_empty() {
        return None;
    }
    let causes = causes(found);
    let causes = if causes.is_empty() { "no cause was found".to_owned() } else { causes.join("; ") };
    Some(format!("{} Why: {causes}.", symptoms.join("; ") + "."))
}

/// Returns how it differs from the GS.
fn symptoms(found: &LightFidelity) -> Vec<String> {
    let mut symptoms = Vec::new();
    let best = found.other_seed.map_or([1.0; 2], |other| both(other.cells));
    for (entries, cells, least) in [
        ("true entries", found.true_entries.cells, LEAST_TRUE),
        ("sampled entries", found.sampled_entries.cells, LEAST_SAMPLED),
    ] {
        for ((name, value), best) in ["precision", "recall"].into_iter().zip(both(cells)).zip(best) {
            let least = least * best;
            if value < least {
                symptoms.push(format!("{name} {value:.2} with {entries} (at least {least:.2})"));
            }
        }
    }
    let (ratio, [least, most]) = (found.sampled_entries.cells.occupancy_ratio(), OCCUPANCY);
    if !(least..=most).contains(&ratio) {
        symptoms.push(format!("{ratio:.2} times the GS's cells with sampled entries ({least} to {most})"));
    }
    let waited = local(&found.sampled_entries).waited_share();
    if waited > MOST_WAITED {
        symptoms.push(format!(
            "{:.0} % of the cars waited at the border (at most {:.0} %)",
            100.0 * waited,
            100.0 * MOST_WAITED
        ));
    }
    symptoms
}

/// Returns what may have caused it.
fn causes(found: &LightFidelity) -> Vec<String> {
    let mut causes = Vec::new();
    if found.causes.spillback > MOST_SPILLBACK {
        let spillback = 100.0 * found.causes.spillback;
        causes.push(format!("spillback: cars stood at green before a full exit in {spillback:.0} % of the seconds"));
    }
    if found.causes.short_entries > MOST_SHORT {
        let short = 100.0 * found.causes.short_entries;
        causes.push(format!("short edges: {short:.0} % of the cars came in by a road shorter than {SHORT_M} m"));
    }
    let lost = local(&found.true_entries).lost;
    if lost > 0 {
        causes.push(format!("{lost} cars left their way, as SUMO moves cars past a jam"));
    }
    causes
}

fn both(cells: Agreement) -> [f64; 2] {
    [cells.precision(), cells.recall()]
}

/// Returns the sums of the LS.
fn local(comparison: &Comparison) -> super::agreement::Sums {
    comparison.sums[1]
}
