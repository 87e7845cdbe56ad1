//! The sections of a report, in order.

use anyhow::Result;

use super::chart::Looks;
use super::cores;
use super::document::{Block, Document, Figure};
use super::family::{Family, families};
use super::group::Comparison;
use super::pictures::{self, Against};
use super::{cost_tables, cpu_to_level, paper, tables};
use crate::drawing::Svg;
use dials_core::base::counted;
use dials_core::outside::quoted_word;

/// Rules by which figures and tables are made, for the reader of a report.
const RULES: [&str; 11] = [
    "Runs with the same settings form a group. Only their seeds differ, and perhaps the step at which they stopped. A \
     label names the config keys whose values in this group are not the usual ones. Usual is the value of more \
     than half of the groups of the scenario. A few keys, such as `policy.imitate`, make another method: a label names \
     them whenever they are on. If more than eight keys were to be named, the label is the directory of a run. In an \
     ablation, the group with the usual values is the reference. Pictures show every other group against it, named by \
     what it changes.",
    "A curve has a point at every step at which a run of the group was evaluated. Between two evaluations a run counts with \
     a linear interpolation. After its last evaluation it does not count. The curve is thin where not all runs of the \
     group count. Curves of cross-entropy follow the same rules. A hollow mark means: trained for some seeds only.",
    "In curves against CPU time, a point is at the mean CPU time of its runs: of all processes, without evaluations. CPU seconds to \
     a level are those until the curve of a seed first reaches it, interpolated between evaluations.",
    "The final return is that of the last evaluation. Only finished runs with the most steps count. If no run of a group is \
     finished, all runs count at the last step that all have reached, and the table says so.",
    "Every interval is a 95 % Student's t interval over seeds, and needs at least five seeds. With fewer seeds, figures and \
     tables show the value of each seed. With three seeds, the interval would be 4.3 standard errors to each side.",
    "Runs and controllers with the same `evaluation.seed` play the same episodes. Their difference is taken in every \
     episode that both have, and averaged for each seed. Its interval is over seeds, so it holds for these episodes and \
     settings only. If the episodes differ, means are subtracted, and a warning names the groups.",
    "The last point of a curve has more episodes than the others (`evaluation.final_episodes`). They include the episodes of \
     the other points.",
    "Grids and warehouses with the same episodes and rewards share a picture of final returns and the tables of costs. \
     Every other network has its own.",
    "The median agent is the median of the mean returns of a run's agents. A single failed agent hardly changes it.",
    "Runtime is wall time without evaluations. Influence is the collection of datasets and the training of the AIPs. \
     In every period both are those of the slowest worker. Agents training is the rest. CPU time is the user and system \
     time of all processes, without evaluations. Other work on the machine changes it less than wall time.",
    "The paper's returns were read off its plots. Its runtimes and memory are from its tables.",
];

pub(crate) fn document(comparisons: &[Comparison], warnings: &[String]) -> Result<Document> {
    let labels = label_order(comparisons);
    let looks = Looks::new(labels.iter().map(String::as_str));
    let mut blocks = vec![Block::Paragraph(overview(comparisons))];
    if !warnings.is_empty() {
        blocks.push(Block::Heading("Missing or unfinished".to_owned()));
        blocks.push(Block::List(warnings.to_vec()));
    }
    for comparison in comparisons {
        blocks.extend(scenario(comparison, &looks)?);
    }
    for family in families(comparisons) {
        blocks.extend(costs(&family, &looks)?);
    }
    blocks.push(Block::Heading("How to read this".to_owned()));
    blocks.push(Block::List(RULES.map(str::to_owned).to_vec()));
    blocks.push(Block::Heading("Runs".to_owned()));
    blocks.push(Block::Table(tables::runs(comparisons)));
    blocks.push(Block::Code(commands(comparisons)));
    Ok(Document { title: "DIALS: learning curves, returns and costs".to_owned(), blocks })
}

fn overview(comparisons: &[Comparison]) -> String {
    let groups = || comparisons.iter().flat_map(|comparison| &comparison.groups);
    let runs: usize = groups().map(|group| group.runs.len()).sum();
    let scenarios: Vec<&str> = comparisons.iter().map(|comparison| comparison.title.as_str()).collect();
    let own = format!("{} in {}; {}.", counted(runs, "run"), counted(groups().count(), "group"), scenarios.join("; "));
    if comparisons.iter().all(|comparison| !paper::has(&comparison.scenario)) {
        return own;
    }
    format!(
        "{own} Paper: Suau et al., Distributed Influence-Augmented Local Simulators for Parallel MARL in Large Networked \
         Systems, NeurIPS 2022."
    )
}

/// Returns the labels in the order of their colours: the paper's methods first, DIALS before GS, variants last.
fn label_order(comparisons: &[Comparison]) -> Vec<String> {
    let mut groups: Vec<_> = comparisons.iter().flat_map(|comparison| &comparison.groups).collect();
    let kind = |simulator: &str| ["dials", "gs", "untrained-dials"].iter().position(|&kind| kind == simulator);
    groups.sort_by_key(|group| {
        let place = kind(group.simulator()).unwrap_or(usize::MAX);
        (group.overrides.len(), place, group.method.retraining, group.label())
    });
    groups.into_iter().map(|group| group.label()).collect()
}

fn scenario(comparison: &Comparison, looks: &Looks) -> Result<Vec<Block>> {
    let (slug, title) = (&comparison.slug, &comparison.title);
    let mut blocks = vec![Block::Heading(comparison.heading()), Block::Table(tables::finals(comparison))];
    let evaluations = comparison.runs().map(|run| run.evaluations.len()).max().unwrap_or(0);
    let has_curves = evaluations > 1;
    let learning = |against| if has_curves { pictures::learning(comparison, looks, against) } else { Ok(None) };
    let agents_caption = format!("Every agent {}, {{title}}.", comparison.when());
    let figures = [
        (
            "ablation",
            "Final returns against the reference (the group with the most common settings), {title}.",
            pictures::ablation(comparison).transpose()?,
        ),
        ("learning", "Learning curves, {title}.", learning(Against::Timesteps)?),
        ("cpu_curves", "Learning curves against CPU time, {title}.", learning(Against::CpuTime)?),
        (
            "aip_cross_entropy",
            "Cross-entropy of the AIPs, {title}. Before their first training it is far higher, and not drawn. The paper \
             draws it against runtime.",
            pictures::cross_entropy(comparison, looks)?,
        ),
        ("agents", &agents_caption, pictures::agents(comparison, looks)?),
    ];
    blocks.extend(figures.into_iter().filter_map(|(name, caption, svg)| {
        Some(figure(format!("{name}_{slug}"), caption.replace("{title}", title), svg?))
    }));
    if !has_curves {
        let why = if evaluations == 0 { "no run was evaluated yet" } else { "every run was evaluated once only" };
        blocks.insert(2, Block::Paragraph(format!("There are no learning curves, because {why}.")));
    }
    blocks.extend(cpu_to_level::table(comparison).map(Block::Table));
    blocks.push(Block::Table(tables::agents(comparison)));
    blocks.extend(tables::likeness(comparison).map(Block::Table));
    let paper =
        if paper::has(&comparison.scenario) { " Black diamonds: the paper, if our runs were as long." } else { "" };
    blocks.extend(pictures::time_by_cores(comparison, looks)?.map(|svg| {
        figure(
            format!("time_by_cores_{slug}"),
            format!(
                "Wall time of a run by number of cores, {title}. Lines: a model. Marks: measured; on a machine that did \
                 other work, too, they lie above the line.{paper}"
            ),
            svg,
        )
    }));
    blocks.extend(cores::table(comparison).map(Block::Table));
    Ok(blocks)
}

fn costs(family: &Family, looks: &Looks) -> Result<Vec<Block>> {
    let Family { title, slug, comparisons } = family;
    let what = if comparisons.iter().any(|comparison| comparison.title == *title) { "Costs" } else { "All sizes" };
    let diamonds = if family.has_paper() { " Diamonds: the paper, if our runs were as long." } else { "" };
    let mut blocks = vec![Block::Heading(format!("{what}, {title}"))];
    // An ablation has its own picture of the final returns.
    if comparisons.iter().any(|comparison| comparison.reference.is_none()) {
        blocks.push(figure(
            format!("final_return_{slug}"),
            format!("Final return by number of agents, {title}.{diamonds}"),
            pictures::final_bars(family, looks)?,
        ));
    }
    let caption = format!("Runtime by number of agents, {title}.{diamonds}");
    blocks.push(match pictures::runtime_bars(family, looks)? {
        Some(svg) => figure(format!("runtime_{slug}"), caption, svg),
        None => Block::Paragraph("There is no picture of runtimes, because no run has trained yet.".to_owned()),
    });
    blocks.push(Block::Table(cost_tables::runtimes(family)));
    blocks.push(Block::Table(cost_tables::memory(family)));
    Ok(blocks)
}

fn figure(name: String, caption: String, svg: Svg) -> Block {
    Block::Figure(Figure { name, caption, svg })
}

/// Returns the commands that made the runs, from `run.json`, with the ends that the runs have now.
fn commands(comparisons: &[Comparison]) -> Vec<String> {
    let runs = comparisons.iter().flat_map(|comparison| &comparison.groups).flat_map(|group| &group.runs);
    let commands = runs.filter_map(|run| {
        let words = run.about.command.get(1..)?.iter();
        let mut words: Vec<String> = words.map(|word| quoted_word(&word.as_it_was())).collect();
        end_at(&mut words, run.config.learning.stop_at_steps);
        Some(format!("dials-traffic {}", words.join(" ")))
    });
    commands.collect()
}

/// Sets the `--steps` of a `train` command: a resume may have given the run another end.
fn end_at(words: &mut Vec<String>, steps: Option<u64>) {
    let Some(steps) = steps else { return };
    if words.iter().any(|word| word.contains("stop_at_steps=")) {
        return;
    }
    if let Some(place) = words.iter().position(|word| word == "--steps") {
        words.drain(place..(place + 2).min(words.len()));
    }
    words.retain(|word| !word.starts_with("--steps="));
    words.extend(["--steps".to_owned(), steps.to_string()]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_command_has_the_end_that_its_run_has_now() {
        let with = |command: &str, steps| {
            let mut words: Vec<String> = command.split(' ').map(str::to_owned).collect();
            end_at(&mut words, steps);
            words.join(" ")
        };
        assert_eq!(with("train a --steps 60 --seed 1", Some(90)), "train a --seed 1 --steps 90");
        assert_eq!(with("train a --steps=60", Some(90)), "train a --steps 90");
        assert_eq!(with("train a", Some(90)), "train a --steps 90");
        assert_eq!(with("train a", None), "train a");
        assert_eq!(with("train a --set stop_at_steps=60", Some(60)), "train a --set stop_at_steps=60");
    }
}
