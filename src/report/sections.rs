//! The order in which a report tells what it has to tell.

use anyhow::Result;

use super::GridShape;
use super::chart::Looks;
use super::document::{Block, Document, Figure};
use super::group::Comparison;
use super::pictures::{self, Against};
use super::scenario::Domain;
use super::tables;
use crate::drawing::Svg;

/// How the figures were made, for whoever wants to know.
const RULES: [&str; 10] = [
    "Runs that differ in nothing but their seed (and in where they were told to stop) are a group. A label names the keys \
     of the config in which a group differs from most groups of its scenario. One that differs in more than \
     eight is named by the directory of a run. A group that differs from them in nothing is the reference: pictures show \
     the others against it, named by what they change.",
    "A curve has a point at every step at which some run of the group was evaluated. A run counts there if it has come so \
     far, interpolated on a straight line between two of its evaluations, and is never prolonged. Where a curve does not \
     hold all runs of its group it is thin. Curves of cross-entropy likewise; where the AIPs of one seed were trained and \
     those of others not, there is a hollow mark.",
    "Against runtime, each point of the curve stands at the mean wall time of its runs, evaluations excluded.",
    "The final return is that of the last evaluation. Only finished runs count, those with the most steps; where no run of a \
     group is finished, all count at the last step that all have reached, and the table says so.",
    "Every interval is a 95 % Student's t interval over seeds. There is one from five seeds on. With fewer, figures and tables \
     show the seeds themselves: with three the interval would be 4.3 standard errors to each side.",
    "Runs with the same `evaluation.seed` are evaluated on the same episodes, as are controllers. A difference is then taken in \
     every episode, averaged for each seed, and its interval is over seeds. So it holds for these episodes and these settings. \
     Where the episodes differ only means are subtracted; a warning names these groups.",
    "The last point of a curve has more episodes than the others (`evaluation.final_episodes`), the same ones among them.",
    "The median agent is the median over a run's agents of their mean returns: one lost agent moves it little.",
    "Runtime: wall time without evaluations. Influence: collection of datasets and training of the AIPs, mean over workers; \
     agents training: all the rest. CPU time: of all processes, user and system, without evaluations; other work on the \
     machine does not lengthen it much, as it does wall time.",
    "The paper's returns were read off its plots; its runtimes and memory are from its tables.",
];

/// The whole report.
pub fn document(comparisons: &[Comparison], warnings: &[String], shape: GridShape) -> Result<Document> {
    let labels = label_order(comparisons);
    let looks = Looks::new(labels.iter().map(String::as_str));
    let mut blocks = vec![Block::Paragraph(overview(comparisons))];
    if !warnings.is_empty() {
        blocks.push(Block::Heading(2, "Missing or unfinished".to_owned()));
        blocks.push(Block::List(warnings.to_vec()));
    }
    for comparison in comparisons {
        blocks.extend(scenario(comparison, &looks, shape)?);
    }
    for domain in [Domain::Traffic, Domain::Warehouse] {
        let of_domain: Vec<&Comparison> =
            comparisons.iter().filter(|comparison| comparison.scenario.domain == domain).collect();
        if !of_domain.is_empty() {
            blocks.extend(costs(domain, &of_domain, &looks)?);
        }
    }
    blocks.push(Block::Heading(2, "How to read this".to_owned()));
    blocks.push(Block::List(RULES.map(str::to_owned).to_vec()));
    blocks.push(Block::Heading(2, "Runs".to_owned()));
    blocks.push(Block::Table(tables::runs(comparisons)));
    blocks.push(Block::Code(commands(comparisons)));
    Ok(Document { title: "DIALS: learning curves, returns and costs".to_owned(), blocks })
}

fn overview(comparisons: &[Comparison]) -> String {
    let groups = || comparisons.iter().flat_map(|comparison| &comparison.groups);
    let runs: usize = groups().map(|group| group.runs.len()).sum();
    let scenarios: Vec<&str> = comparisons.iter().map(|comparison| comparison.title.as_str()).collect();
    format!(
        "{runs} runs in {} groups; {}. Paper: Suau et al., Distributed Influence-Augmented Local Simulators for Parallel \
         MARL in Large Networked Systems, NeurIPS 2022.",
        groups().count(),
        scenarios.join("; ")
    )
}

/// Looks are given out in this order: the paper's methods first, DIALS before GS, variants last.
fn label_order(comparisons: &[Comparison]) -> Vec<String> {
    let mut groups: Vec<_> = comparisons.iter().flat_map(|comparison| &comparison.groups).collect();
    let kind = |simulator: &str| ["dials", "gs", "untrained-dials"].iter().position(|&kind| kind == simulator);
    groups.sort_by_key(|group| {
        let place = kind(group.simulator()).unwrap_or(usize::MAX);
        (group.overrides.len(), place, group.method.retraining, group.label())
    });
    groups.into_iter().map(|group| group.label()).collect()
}

fn scenario(comparison: &Comparison, looks: &Looks, shape: GridShape) -> Result<Vec<Block>> {
    let (slug, title) = (&comparison.slug, &comparison.title);
    let mut blocks = vec![Block::Heading(2, comparison.heading()), Block::Table(tables::finals(comparison))];
    let against = |against| pictures::learning(comparison, looks, against);
    let figures = [
        (
            format!("ablation_{slug}"),
            format!("Final returns against the reference, which has what most groups have in every key, {title}."),
            pictures::ablation(comparison).transpose()?,
        ),
        (format!("learning_{slug}"), format!("Learning curves, {title}."), against(Against::Timesteps)?),
        (
            format!("runtime_curves_{slug}"),
            format!("Learning curves against runtime, {title}."),
            against(Against::Runtime)?,
        ),
        (
            format!("aip_cross_entropy_{slug}"),
            format!(
                "Cross-entropy of the AIPs, {title}. AIPs before their first training are far above \
                 (aip_cross_entropy.csv). The paper draws it against runtime."
            ),
            pictures::cross_entropy(comparison, looks)?,
        ),
        (format!("agents_{slug}"), format!("Every agent at the end, {title}."), pictures::agents(comparison, shape)?),
    ];
    blocks.extend(figures.into_iter().filter_map(|(name, caption, svg)| Some(figure(name, caption, svg?))));
    blocks.push(Block::Table(tables::agents(comparison)));
    Ok(blocks)
}

fn costs(domain: Domain, comparisons: &[&Comparison], looks: &Looks) -> Result<Vec<Block>> {
    let name = domain.name();
    let mut blocks = vec![Block::Heading(2, format!("All sizes, {name}"))];
    // Ablations have their own picture of it.
    if comparisons.iter().any(|comparison| comparison.reference.is_none()) {
        blocks.push(figure(
            format!("final_return_{name}"),
            format!("Final return by number of agents, {name}. Diamonds: the paper, where ours ran as long."),
            pictures::final_bars(domain, comparisons, looks)?,
        ));
    }
    blocks.push(figure(
        format!("runtime_{name}"),
        format!("Runtime by number of agents, {name}. Diamonds: the paper, where ours ran as long."),
        pictures::runtime_bars(domain, comparisons, looks)?,
    ));
    blocks.push(Block::Table(tables::runtimes(domain, comparisons)));
    blocks.push(Block::Table(tables::memory(domain, comparisons)));
    Ok(blocks)
}

fn figure(name: String, caption: String, svg: Svg) -> Block {
    Block::Figure(Figure { name, caption, svg })
}

/// What made the runs, as `run.json` tells it.
fn commands(comparisons: &[Comparison]) -> String {
    let runs = comparisons.iter().flat_map(|comparison| &comparison.groups).flat_map(|group| &group.runs);
    let commands = runs.filter_map(|run| Some(format!("dials-traffic {}", run.about.command.get(1..)?.join(" "))));
    commands.collect::<Vec<_>>().join("\n")
}
