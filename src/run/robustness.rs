//! `--demand` and `--closed` of `evaluate` and `baseline`: the same players on several variants of a scenario. A variant has
//! another demand, or closed edges. On each one all players drive the same traffic, episode by episode.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context, anyhow};
use serde_json::{Map, Value, json};

use super::evaluate::CsvFiles;
use super::subject::Subject;
use crate::cli;
use dials_core::base::statistics::Interval;
use dials_core::base::{Seed, for_terminal};
use dials_core::domain::Baseline;
use dials_core::outside::csv_name;
use dials_learn::evaluation::{self, Finding, json as figures, of_variants, play_episodes};
use dials_session::config::RunConfig;
use dials_session::domains;
use dials_session::error::{Error, Result};
use dials_session::terminal::counting::EpisodeBar;
use dials_session::terminal::{answer, json as in_json};
use dials_traffic::Traffic;
use dials_traffic::scenario::closing::Detours;

/// Figures in the tables for a terminal. `--json` and `--csv` have all.
const SHOWN: [&str; 2] = ["delay_s", "throughput_per_h"];
/// Longest id of an edge in the title of a column.
const LONGEST_ID: usize = 12;

/// Other demand, closed edges, or both.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Variant {
    /// Factor on the number of vehicles of the scenario.
    demand: f64,
    closed: Vec<String>,
}

/// Returns the variants that the command line asks for: each demand with all edges open, then with each closure. `None`: it asks
/// for none.
pub(super) fn asked_for(args: &cli::VariantArgs) -> Option<Vec<Variant>> {
    if args.demand.is_empty() && args.closed.is_empty() {
        return None;
    }
    let demands = if args.demand.is_empty() { &[1.0][..] } else { &args.demand };
    let closures: Vec<Vec<String>> =
        args.closed.iter().map(|edges| edges.split(',').map(|edge| edge.trim().to_owned()).collect()).collect();
    let all = [Vec::new()].into_iter().chain(closures);
    let mut variants = Vec::new();
    for closed in all {
        for &demand in demands {
            let variant = Variant { demand, closed: closed.clone() };
            if !variants.contains(&variant) {
                variants.push(variant);
            }
        }
    }
    Some(variants)
}

/// Checks that a scenario can have these variants, before anything is tried or played.
pub(super) fn check(config: &RunConfig, variants: &[Variant]) -> anyhow::Result<()> {
    for variant in variants {
        domains::changed_traffic(config, variant.demand, &variant.closed)?;
    }
    let traffic = usual(config)?;
    variants.iter().try_for_each(|variant| traffic.check_edges(&variant.closed)).context("--closed")
}

fn usual(config: &RunConfig) -> anyhow::Result<Traffic> {
    domains::traffic(config)?.context("only traffic has demand and edges")
}

/// What all players of a command play.
pub(super) struct Plan<'a> {
    pub(super) config: &'a RunConfig,
    pub(super) variants: &'a [Variant],
    pub(super) subjects: &'a [Subject],
    pub(super) episodes: usize,
    pub(super) seed: u64,
}

/// A variant with what was played on it.
struct Played {
    variant: Variant,
    /// Names of the closed edges' streets, each once, in their alphabetical order.
    streets: Vec<String>,
    detours: Option<Detours>,
    /// Figures as JSON, which need the domain.
    figures: Map<String, Value>,
    findings: Vec<Finding>,
}

/// Lets all subjects play all variants, and prints their figures. `about`: further keys of the JSON object.
pub(super) fn play(plan: &Plan<'_>, mut csv: Option<CsvFiles>, is_json: bool, about: Map<String, Value>) -> Result<()> {
    let Plan { config, variants, subjects, episodes, .. } = *plan;
    let usual = usual(config).map_err(Error::Usage)?;
    let open = |variant: &Variant| -> anyhow::Result<Traffic> {
        let changed = domains::changed_traffic(config, variant.demand, &variant.closed)?;
        domains::open_changed(&changed, &usual).with_context(|| variant.name())
    };
    // All are tried before the first one is played.
    let opened = variants.iter().map(open).collect::<anyhow::Result<Vec<Traffic>>>().map_err(Error::Usage)?;
    // Once: the net is read for it.
    let edges: BTreeSet<&String> = variants.iter().flat_map(|variant| &variant.closed).collect();
    let edges: Vec<String> = edges.into_iter().cloned().collect();
    let streets = usual.streets_of(&edges).map_err(Error::Run)?;
    let street_of: BTreeMap<String, Option<String>> = edges.into_iter().zip(streets).collect();
    let bar = EpisodeBar::of(variants.len() * subjects.len() * episodes, "episodes");
    let (mut all, mut written, mut done) = (Vec::new(), Ok(()), 0);
    for (variant, traffic) in variants.iter().zip(opened) {
        bar.set_message(variant.name());
        let columns = [("demand", variant.demand.to_string()), ("closed", variant.closed.join(" "))];
        let mut findings = Vec::new();
        for subject in subjects {
            let player = subject.player(&traffic).map_err(Error::Usage)?;
            let Baseline { mut simulator, mut controller } = subject.open(&traffic).map_err(Error::Usage)?;
            let (simulator, controller) = (&mut *simulator, &mut *controller);
            let progress = &mut |now| bar.set(done + now);
            let played = simulator
                .measure_in_full()
                .and_then(|()| play_episodes(simulator, controller, Seed::new(plan.seed), episodes, progress));
            done += episodes;
            let place = || format!("{} with {}", subject.label(), variant.name());
            let finding = Finding { player, episodes: played.with_context(place).map_err(Error::Run)? };
            if let (Ok(()), Some(csv)) = (&written, &mut csv) {
                written = csv.append(&finding, &columns, None).map_err(Error::Run);
            }
            findings.push(finding);
        }
        let streets: BTreeSet<&String> = variant.closed.iter().filter_map(|edge| street_of[edge].as_ref()).collect();
        let streets = streets.into_iter().cloned().collect();
        let (variant, detours) = (variant.clone(), traffic.detours());
        all.push(Played { variant, streets, detours, figures: figures::of_all(&traffic, &findings), findings });
    }
    bar.finish();
    if let (Ok(()), Some(csv)) = (&written, &csv) {
        written = as_csv(&all).and_then(|table| csv.write_variants(&table)).map_err(Error::Run);
    }
    let found = if is_json { as_json(plan, &all, about) } else { as_text(&all) };
    answer(found).map_err(Error::Run)?;
    written
}

fn as_json(plan: &Plan<'_>, all: &[Played], about: Map<String, Value>) -> String {
    let variants = all.iter().map(|played| {
        let Variant { demand, closed } = &played.variant;
        let mut object = Map::new();
        object.insert("demand".into(), json!(demand));
        object.insert("closed".into(), json!(closed));
        object.insert("streets".into(), json!(played.streets));
        if let Some(detours) = played.detours {
            object.insert("vehicles_of_files".into(), json!(detours.vehicles));
            object.insert("rerouted".into(), json!(detours.rerouted));
            object.insert("without_way".into(), json!(detours.without_way));
            object.insert("trips".into(), json!(detours.trips));
            object.insert("stops_left_out".into(), json!(detours.stops_left_out));
        }
        object.extend(played.figures.clone());
        Value::Object(object)
    });
    let mut object = about;
    object.insert("episodes".into(), json!(plan.episodes));
    object.insert("variants".into(), variants.collect());
    in_json(Value::Object(object))
}

/// Returns delays and arrivals: a line for each player on each variant.
fn as_csv(all: &[Played]) -> anyhow::Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    let [delay, arrivals] = SHOWN;
    writer.write_record(["controller", "demand", "closed", "streets", delay, "half_width_95", arrivals, "episodes"])?;
    let all = all.iter().flat_map(|played| played.findings.iter().map(move |finding| (played, finding)));
    for (Played { variant: Variant { demand, closed }, streets, .. }, finding) in all {
        let figures = evaluation::figures(&finding.episodes);
        let of = |wanted: &str| figures.iter().find(|(name, _)| name == wanted).map(|(_, all)| Interval::of(all));
        let Some(Interval { mean, half_width }) = of(delay) else { continue };
        writer.write_record([
            csv_name(&finding.player.label),
            demand.to_string(),
            csv_name(&closed.join(" ")),
            csv_name(&streets.join(", ")),
            mean.to_string(),
            half_width.map_or(String::new(), |half_width| half_width.to_string()),
            of(arrivals).map_or(String::new(), |arrivals| arrivals.mean.to_string()),
            finding.episodes.len().to_string(),
        ])?;
    }
    Ok(writer.into_inner()?)
}

fn as_text(all: &[Played]) -> String {
    let is_short = |played: &Played| played.variant.closed.join(",").chars().count() <= LONGEST_ID;
    let mut closures: Vec<&Vec<String>> =
        all.iter().map(|played| &played.variant.closed).filter(|closed| !closed.is_empty()).collect();
    // Variants of a closure stand one behind the other.
    closures.dedup();
    let short = all.iter().all(is_short);
    let label = |played: &Played| {
        let Variant { demand, closed } = &played.variant;
        let place = closures.iter().position(|known| *known == closed);
        match place {
            None => format!("demand {demand}"),
            Some(_) if short => format!("{demand}, closed {}", closed.join(",")),
            Some(place) => format!("{demand}, closure {}", place + 1),
        }
    };
    let labels: Vec<String> = all.iter().map(label).collect();
    // What becomes of the vehicles is the same for every demand.
    let of_closure = |(number, closed): (usize, &&Vec<String>)| {
        let Played { streets, detours, .. } = all.iter().find(|played| played.variant.closed == **closed)?;
        let mut name = if short { closed.join(",") } else { format!("{}, {}", number + 1, closed.join(",")) };
        if !streets.is_empty() {
            name += &format!(" ({})", streets.join(", "));
        }
        Some(for_terminal(&format!("closure {name}: {}", (*detours)?)))
    };
    let legend: Vec<String> = closures.iter().enumerate().filter_map(of_closure).collect();
    let findings: Vec<Vec<Finding>> = all.iter().map(|played| played.findings.clone()).collect();
    let table = of_variants(&labels, &findings, &SHOWN);
    if legend.is_empty() { table } else { format!("{table}\n\n{}", legend.join("\n")) }
}

impl Variant {
    fn name(&self) -> String {
        match &self.closed[..] {
            [] => format!("demand {}", self.demand),
            closed => format!("demand {}, closed {}", self.demand, closed.join(",")),
        }
    }
}

/// Returns an error for outputs that are of one variant only.
pub(super) fn check_output(output: &cli::OutputArgs) -> anyhow::Result<()> {
    let given = [
        ("--plot", output.plot.is_some()),
        ("--render", output.render.is_some()),
        ("--events", output.events.is_some()),
        ("--per-light", output.per_light),
        ("--emissions", output.emissions),
    ];
    match given.into_iter().find(|(_, is_given)| *is_given) {
        None => Ok(()),
        Some((option, _)) => {
            Err(anyhow!("{option}: is of one scenario, but --demand and --closed play several variants; leave one out"))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(demand: &[f64], closed: &[&str]) -> Option<Vec<String>> {
        let closed = closed.iter().map(|edges| (*edges).to_owned()).collect();
        let variants = asked_for(&cli::VariantArgs { demand: demand.to_vec(), closed })?;
        Some(variants.iter().map(Variant::name).collect())
    }

    #[test]
    fn every_demand_is_played_with_all_edges_open_and_with_each_closure() {
        assert_eq!(names(&[], &[]), None);
        assert_eq!(names(&[0.8, 1.0, 0.8], &[]).unwrap(), ["demand 0.8", "demand 1"]);
        assert_eq!(names(&[], &["a", "b,c"]).unwrap(), ["demand 1", "demand 1, closed a", "demand 1, closed b,c"]);
        assert_eq!(names(&[1.2], &["a"]).unwrap(), ["demand 1.2", "demand 1.2, closed a"]);
    }
}
