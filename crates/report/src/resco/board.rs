//! The page of the board: a table over all maps, one per map, and how all of it was measured.

use super::published::{CPU_SECONDS, Kind, OTHERS, RESCO};
use super::results::{About, MapResults, Measurement, MethodResults};
use crate::document::{Block, Document, Table};
use crate::words::certainty;
use dials_core::base::counted;
use dials_core::base::statistics::Spread;

const NOTHING: &str = "-";

/// Columns of the table over all maps that are controllers that were not trained here.
const CONTROLLERS: [&str; 7] =
    ["program", "actuated", "fixed-time, tuned", "gap-out", "max-wave", "max-pressure", "any-light"];

pub(super) fn document(about: &About, maps: &[MapResults]) -> Document {
    let mut blocks = vec![Block::Paragraph(format!(
        "Delay on RESCO's maps by the protocol `{}`, in seconds per car; lower is better. Ours are last policies, after {} of \
         training, never the best ones of a run. Simulated with {}.",
        about.protocol,
        counted(about.episodes as usize, "episode"),
        about.sumo,
    ))];
    blocks.extend(warnings(about, maps));
    blocks.push(Block::Table(overview(maps)));
    for of_map in maps {
        blocks.push(Block::Heading(format!("{}, {}", of_map.map.name, counted(of_map.lights, "light"))));
        blocks.push(Block::Table(table(of_map)));
        if !of_map.notes.is_empty() {
            blocks.push(Block::List(of_map.notes.clone()));
        }
    }
    blocks.push(Block::Heading("How it was measured".to_owned()));
    blocks.push(Block::List(about.rules.iter().cloned().chain(how(about)).collect()));
    blocks.push(Block::Heading("Sources".to_owned()));
    blocks.push(Block::List(vec![
        format!("Published delays: {RESCO}."),
        format!("Cost: {CPU_SECONDS}."),
        format!("Other measures: {OTHERS}."),
    ]));
    blocks.push(Block::Heading("Make it again".to_owned()));
    blocks.push(Block::Code(vec![about.command.clone()]));
    Document { title: "RESCO's maps".to_owned(), blocks }
}

fn how(about: &About) -> Vec<String> {
    vec![
        "Delay is RESCO's: time loss and departure delay of all cars, unfinished ones included, and the whole wait of those \
         that never departed, over the number of cars."
            .to_owned(),
        format!(
            "Every controller and every last policy plays the same {} episodes. Seeds of training: {}.",
            about.measured_episodes,
            about.seeds.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")
        ),
        "After a controller's delay stands half of its 95 % interval over episodes. For policies it is a Student's t interval \
         over seeds; with fewer than five seeds the value of each seed stands there."
            .to_owned(),
        "The median episode is what is usual: where a few episodes jam, they make the mean. For policies it is the mean of the \
         seeds' medians."
            .to_owned(),
        "Greedy: the most probable action. Sampled: as in training. CPU minutes are those of all processes of a run, with the \
         evaluations during it."
            .to_owned(),
        "`gs` trains on the whole map in SUMO, `dials` on local simulators of the lights. A method named `-shared` has one \
         policy for all lights of a kind, the others one per light. `gs-any-light` starts from any-light instead of at random."
            .to_owned(),
        "RESCO's runs used older versions of SUMO, and its figures are over episodes of training, in which learners explore."
            .to_owned(),
    ]
}

/// Returns what is missing, if something is.
fn warnings(about: &About, maps: &[MapResults]) -> Option<Block> {
    let mut lines: Vec<String> = Vec::new();
    if !about.absent.is_empty() {
        lines.push(format!("Not in this copy of RESCO: {}.", about.absent.join(", ")));
    }
    for of_map in maps.iter().filter(|of_map| !of_map.missing.is_empty()) {
        lines.push(format!("{}: not measured yet: {}.", of_map.map.name, of_map.missing.join(", ")));
    }
    (!lines.is_empty()).then_some(Block::List(lines))
}

fn s(value: f64) -> String {
    format!("{value:.1}")
}

fn minutes(seconds: f64) -> String {
    format!("{:.1}", seconds / 60.0)
}

fn with_half_width(found: &Measurement) -> String {
    match found.half_width_s {
        Some(half) => format!("{} ± {}", s(found.delay_s), s(half)),
        None => s(found.delay_s),
    }
}

fn or_nothing(cell: Option<String>) -> String {
    cell.unwrap_or_else(|| NOTHING.to_owned())
}

/// Returns the names of the methods of all maps, each once, in their order.
fn methods(maps: &[MapResults]) -> Vec<&str> {
    let mut names: Vec<&str> = Vec::new();
    for method in maps.iter().flat_map(|of_map| &of_map.methods) {
        if !names.contains(&&*method.method) {
            names.push(&method.method);
        }
    }
    names
}

fn of_seeds(spread: Option<Spread>) -> String {
    or_nothing(spread.map(|spread| s(spread.mean)))
}

/// The table over all maps.
fn overview(maps: &[MapResults]) -> Table {
    let methods = methods(maps);
    let mut header = vec!["map".to_owned(), "lights".to_owned()];
    header.extend(CONTROLLERS.map(str::to_owned));
    header.extend(methods.iter().map(|method| format!("{method}, greedy")));
    header.extend(["RESCO: program (ours against it)", "RESCO: best episode", "RESCO: last ten"].map(str::to_owned));
    let row = |of_map: &MapResults| {
        let mut row = vec![of_map.map.name.to_owned(), of_map.lights.to_string()];
        row.extend(CONTROLLERS.map(|name| or_nothing(of_map.controller(name).map(|found| s(found.delay_s)))));
        row.extend(methods.iter().map(|name| {
            let method = of_map.methods.iter().find(|method| method.method == **name);
            of_seeds(method.and_then(|method| method.delay(true)))
        }));
        let program = of_map.map.figure(Kind::Program).map(|theirs| match of_map.controller("program") {
            Some(ours) => format!("{} ({:+.1} %)", s(theirs.delay_s), 100.0 * (ours.delay_s / theirs.delay_s - 1.0)),
            None => s(theirs.delay_s),
        });
        row.push(or_nothing(program));
        for kind in [Kind::BestEpisode, Kind::LastTen] {
            let figure = of_map.map.figure(kind);
            row.push(or_nothing(figure.map(|theirs| format!("{} {}", theirs.player, s(theirs.delay_s)))));
        }
        row
    };
    Table {
        caption: "All maps: mean delay in seconds per car. Policies: last ones, mean over seeds.".to_owned(),
        header,
        rows: maps.iter().map(row).collect(),
    }
}

/// The table of one map: ours, then what others published.
fn table(of_map: &MapResults) -> Table {
    let header = ["player", "n", "delay (s)", "median episode (s)", "certainty", "CPU minutes", "episodes", "kind"]
        .map(str::to_owned)
        .to_vec();
    let mut rows: Vec<Vec<String>> = Vec::new();
    for (name, found) in &of_map.controllers {
        let n = found.episodes.to_string();
        let how_sure = found.half_width_s.map(|_| "95 % over episodes".to_owned());
        rows.push(vec![
            name.clone(),
            n,
            with_half_width(found),
            or_nothing(found.median_s.map(s)),
            or_nothing(how_sure),
            NOTHING.to_owned(),
            NOTHING.to_owned(),
            "controller".to_owned(),
        ]);
    }
    for method in &of_map.methods {
        for (greedy, how) in [(true, "greedy"), (false, "sampled")] {
            rows.extend(method.delay(greedy).map(|spread| policies(method, greedy, how, &spread)));
        }
    }
    for theirs in of_map.map.published {
        let nothing = || NOTHING.to_owned();
        let delay = s(theirs.delay_s);
        let kind = format!("published, {}", theirs.kind.words());
        rows.push(vec![theirs.player.to_owned(), nothing(), delay, nothing(), nothing(), nothing(), nothing(), kind]);
    }
    Table { caption: format!("Delay on {}.", of_map.map.name), header, rows }
}

fn policies(method: &MethodResults, greedy: bool, how: &str, spread: &Spread) -> Vec<String> {
    let episodes = method.runs.first().map(|run| format!("{:.0}", run.episodes));
    vec![
        format!("{}, {how}", method.method),
        spread.runs().to_string(),
        s(spread.mean),
        or_nothing(method.median_s(greedy).map(s)),
        certainty(spread),
        or_nothing(method.cpu_s().map(minutes)),
        or_nothing(episodes),
        "last policy".to_owned(),
    ]
}

/// Writes the overview with spaces for a terminal.
pub(super) fn summary_text(maps: &[MapResults]) -> String {
    let methods = methods(maps);
    let mut cells = vec![vec!["delay, s per car".to_owned()]];
    cells[0].extend(maps.iter().map(|of_map| of_map.map.name.to_owned()));
    for name in CONTROLLERS {
        let mut row = vec![name.to_owned()];
        row.extend(maps.iter().map(|of_map| or_nothing(of_map.controller(name).map(|found| s(found.delay_s)))));
        cells.push(row);
    }
    for name in methods {
        for (greedy, how) in [(true, "greedy"), (false, "sampled")] {
            let mut row = vec![format!("{name}, {how}")];
            row.extend(maps.iter().map(|of_map| {
                let method = of_map.methods.iter().find(|method| method.method == name);
                of_seeds(method.and_then(|method| method.delay(greedy)))
            }));
            cells.push(row);
        }
    }
    for (kind, name) in [
        (Kind::Program, "RESCO: program"),
        (Kind::BestEpisode, "RESCO: best episode"),
        (Kind::LastTen, "RESCO: last ten"),
    ] {
        let mut row = vec![name.to_owned()];
        row.extend(maps.iter().map(|of_map| or_nothing(of_map.map.figure(kind).map(|theirs| s(theirs.delay_s)))));
        cells.push(row);
    }
    let width = |column: usize| cells.iter().map(|row| row[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..cells[0].len()).map(width).collect();
    let line = |row: &Vec<String>| {
        let first = format!("{:<width$}", row[0], width = widths[0]);
        row[1..].iter().zip(&widths[1..]).fold(first, |line, (cell, width)| format!("{line}  {cell:>width$}"))
    };
    cells.iter().map(line).collect::<Vec<_>>().join("\n")
}
