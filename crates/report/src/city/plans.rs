//! Plans in a city's report: a plan stands beside the rules that played the same traffic, and its files lie beside the page.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use super::CITY;
use super::read::{City, Figure};
use crate::document::Block;
use crate::signal_plan::{PAGE, PROGRAMS, TABLE};
use dials_core::outside::read_text;

/// Largest file of a plan.
const LARGEST: u64 = 256 << 20;

/// Checks that the plan in a folder, if there is one, was written with its figures.
pub(super) fn check(folder: &Path) -> Result<()> {
    let has = |name: &str| folder.join(name).is_file();
    ensure!(
        !(has(PROGRAMS) && has(TABLE)) || has(CITY),
        "{}: is a plan without {CITY}, which older versions of this program did not write; make it again, with the `plan` that \
         made it and --force",
        folder.display()
    );
    Ok(())
}

/// Why a plan need not have the delay of the controller that it was made of.
const OTHER_DELAY: &str = "A plan has fixed greens, perhaps other ones for each period of the demand, and each light begins where its \
                           offset says. So its delay is not that of the controller from which it was made.";

/// Puts comparisons of the same traffic together into the first of them, and every plan beside the comparison of its traffic.
/// Also returns sentences about plans that stay alone although there are comparisons.
pub(super) fn beside_the_others(found: Vec<(PathBuf, City)>) -> (Vec<(PathBuf, City)>, Vec<String>) {
    let has_plan = |(_, city): &(PathBuf, City)| city.players.iter().any(|player| player.plan);
    let (plans, comparisons): (Vec<_>, Vec<_>) = found.into_iter().partition(has_plan);
    let mut kept: Vec<(PathBuf, City)> = Vec::new();
    let mut warnings = Vec::new();
    for (folder, more) in comparisons {
        match kept.iter_mut().find(|(_, city)| is_same_traffic(city, &more)) {
            Some((_, city)) => {
                let behind = city.players.len();
                add_players(city, more, behind);
            }
            None => kept.push((folder, more)),
        }
    }
    for (folder, plan) in plans {
        match kept.iter_mut().find(|(_, city)| is_same_traffic(city, &plan)) {
            // Behind today's plan, because the page is about the plan.
            Some((_, city)) => add_players(city, plan, 1),
            None => {
                warnings.extend((!kept.is_empty()).then(|| {
                    format!(
                        "{}: stands alone, because nothing else here has the same traffic; use the same scenario, --episodes, \
                         --seed and --end for all, and name `program` first in --compare",
                        folder.display()
                    )
                }));
                kept.push((folder, plan));
            }
        }
    }
    (kept, warnings)
}

/// Inserts those players of another comparison whose names are new.
fn add_players(city: &mut City, other: City, place: usize) {
    let known: Vec<String> = city.players.iter().map(|player| player.label.clone()).collect();
    let new = other.players.into_iter().filter(|player| !known.contains(&player.label));
    city.players.splice(place..place, new.collect::<Vec<_>>());
    city.name = city.name.take().or(other.name);
    let new: Vec<String> = other.warnings.into_iter().filter(|warning| !city.warnings.contains(warning)).collect();
    city.warnings.extend(new);
}

/// Returns whether two comparisons begin with the same player on the same traffic, so that their differences are from the same.
/// All its figures are equal to the last digit only if all its cars are.
fn is_same_traffic(one: &City, other: &City) -> bool {
    let [own, theirs] = [one, other].map(|city| &city.players[0]);
    let bits = |figure: &Figure| figure.mean.to_bits();
    let is_same =
        |(name, figure): (&String, &Figure)| theirs.figures.get(name).is_none_or(|other| bits(other) == bits(figure));
    let ids = |city: &City| city.players[0].lights.iter().map(|light| light.id.clone()).collect::<Vec<_>>();
    // The copy of a scenario in a run directory has no name.
    let same_name = one.name.is_none() || other.name.is_none() || one.name == other.name;
    same_name
        && (one.seed, one.episodes, &own.label) == (other.seed, other.episodes, &theirs.label)
        && own.delay_s().is_some()
        && own.figures.iter().all(is_same)
        && ids(one) == ids(other)
}

/// The section about plans, and copies of their files.
pub(super) struct Plans {
    pub(super) blocks: Vec<Block>,
    pub(super) files: Vec<(String, String)>,
}

/// Reads the files of the plans in these folders.
pub(super) fn files(folders: &[PathBuf]) -> Result<Plans> {
    let mut plans = Plans { blocks: Vec::new(), files: Vec::new() };
    let with_plan: Vec<&PathBuf> = folders.iter().filter(|folder| folder.join(PROGRAMS).is_file()).collect();
    for (number, folder) in with_plan.iter().enumerate() {
        let mut links = Vec::new();
        for (name, what) in [
            (PAGE, "cycle, offset and a ring diagram for each light, and the commands that play the plan"),
            (PROGRAMS, "the programs, which plain SUMO loads after its other files"),
            (TABLE, "cycle, offset, splits, yellow and all red of each light"),
        ] {
            let path = folder.join(name);
            let text = read_text(&path, LARGEST).with_context(|| path.display().to_string())?;
            let name = match (with_plan.len(), name.split_once('.')) {
                (2.., Some((stem, ending))) => format!("{stem}_{}.{ending}", number + 1),
                _ => name.to_owned(),
            };
            plans.files.push((name.clone(), text));
            links.push((name, what.to_owned()));
        }
        plans.blocks.push(match with_plan.len() {
            1 => Block::Heading("The plan".to_owned()),
            _ => Block::Heading(format!("The plan in {}", folder.display())),
        });
        plans.blocks.push(Block::Links(links));
        plans.blocks.push(Block::Paragraph(OTHER_DELAY.to_owned()));
    }
    Ok(plans)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    /// A city of one light. `delay_s`: that of today's programs.
    fn city(delay_s: f64, label: &str, plan: bool) -> (PathBuf, City) {
        let player = |label: &str, plan: bool, delay_s: f64, differences: Value| {
            json!({ "label": label, "learned": false, "plan": plan, "figures": { "delay_s": { "mean": delay_s } },
                    "differences": differences, "lights": [] })
        };
        let differences = json!({ "delay_s": { "mean": 20.0 - delay_s, "half_width_95": 1.0 } });
        let city = json!({
            "name": "town", "seed": 0, "episodes": 5, "left_out": [], "warnings": [], "settings": {}, "streets": [],
            "players": [player("program", false, delay_s, Value::Null), player(label, plan, 20.0, differences)],
        });
        (PathBuf::from(label), serde_json::from_value(city).unwrap())
    }

    fn labels(city: &City) -> Vec<&str> {
        city.players.iter().map(|player| &*player.label).collect()
    }

    #[test]
    fn a_plan_of_the_same_traffic_stands_beside_the_rules_whatever_comes_first() {
        let (plan, rules) = (city(30.0, "plan of webster", true), city(30.0, "max-pressure", false));
        for found in [vec![plan.clone(), rules.clone()], vec![rules, plan]] {
            let (found, warnings) = beside_the_others(found);
            assert_eq!((found.len(), warnings.len()), (1, 0));
            assert_eq!(labels(&found[0].1), ["program", "plan of webster", "max-pressure"]);
        }
    }

    #[test]
    fn comparisons_of_the_same_traffic_become_one() {
        let found = vec![city(30.0, "max-pressure", false), city(30.0, "webster", false), city(30.5, "webster", false)];
        let (found, _) = beside_the_others(found);
        assert_eq!(
            found.iter().map(|(_, city)| labels(city)).collect::<Vec<_>>(),
            [vec!["program", "max-pressure", "webster"], vec!["program", "webster"]]
        );
    }

    #[test]
    fn a_plan_of_a_run_whose_copy_of_the_scenario_has_no_name_stands_beside_the_others() {
        let mut plan = city(30.0, "plan of runs/a", true);
        plan.1.name = None;
        for found in [vec![plan.clone(), city(30.0, "webster", false)], vec![city(30.0, "webster", false), plan]] {
            let (found, _) = beside_the_others(found);
            assert_eq!((found.len(), found[0].1.title()), (1, "town".to_owned()));
        }
    }

    #[test]
    fn a_plan_of_other_traffic_stays_alone_with_a_word_why() {
        let found = vec![city(30.0, "max-pressure", false), city(30.5, "plan of webster", true)];
        let (found, warnings) = beside_the_others(found);
        assert_eq!(found.len(), 2);
        assert!(warnings[0].starts_with("plan of webster: stands alone"), "{warnings:?}");
        let (_, warnings) = beside_the_others(vec![city(30.0, "plan of webster", true)]);
        assert!(warnings.is_empty(), "one alone is no surprise");
    }
}
