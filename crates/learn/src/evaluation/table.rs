//! The figures of one player, as text, with a line per agent, or with the worst agents of many.

use super::comparison::blocks;
use super::{Evaluation, Finding, figures};
use crate::policy::Selection;
use dials_core::base::statistics::Interval;
use dials_core::base::{AgentId, decimals};
use dials_core::domain::Domain;

/// Largest number of agents that have a line each.
const MOST_LINES: usize = 12;
/// Number of agents that are shown if there are more.
const WORST: usize = 5;

/// Returns the figures of one player, and a table of its agents. Of many agents, only the worst are in the table.
pub fn table(domain: &dyn Domain, finding: &Finding) -> String {
    text(&Evaluation::new(domain, &finding.episodes), finding, &|agent| domain.agent_title(AgentId(agent)))
}

/// `title`: title of an agent by its number.
fn text(evaluation: &Evaluation, finding: &Finding, title: &dyn Fn(usize) -> String) -> String {
    let figures = figures(&finding.episodes);
    let ((name, returns), measures) = figures.split_first().expect("there is always a return");
    let (all, returns) = (evaluation.of_all(), Interval::of(returns));
    let policies = match finding.player.policies {
        Some(Selection::Greedy) => "; greedy policies",
        Some(Selection::Sampled) => "; sampled policies",
        None => "",
    };
    let others = finding.player.others.as_ref().map_or(String::new(), |others| format!("\n({others})"));
    let episodes = match evaluation.episodes() {
        1 => "1 episode".to_owned(),
        episodes => format!("+-: half of a 95 % interval over {episodes} episodes"),
    };
    let digits = decimals(returns.mean, returns.half_width);
    let mut lines = vec![format!(
        "{name} {:.digits$}{}, median of the agents {:.digits$}\n({episodes}{policies}){others}",
        returns.mean,
        returns.half_width.map_or(String::new(), |half_width| format!(" +- {half_width:.digits$}")),
        all.median
    )];
    for (name, values) in measures {
        let Interval { mean, half_width } = Interval::of(values);
        let digits = decimals(mean, half_width).max(2);
        let half_width = half_width.map_or(String::new(), |half_width| format!(" +- {half_width:.digits$}"));
        lines.push(format!("{name:>24} {mean:.digits$}{half_width}"));
    }
    lines.push(String::new());
    let mut agents: Vec<usize> = (0..evaluation.agents()).collect();
    if agents.len() > MOST_LINES {
        let mean = |agent: usize| evaluation.of_agent(agent).mean;
        agents.sort_by(|&one, &other| mean(one).total_cmp(&mean(other)));
        let (lowest, highest) = (mean(agents[0]), mean(agents[agents.len() - 1]));
        let stuck = evaluation.stuck.iter().filter(|&&stuck| stuck).count();
        let count = agents.len();
        lines.push(format!("{count} agents: returns from {lowest:.digits$} to {highest:.digits$}, {stuck} stuck"));
        lines.push(format!("the {WORST} with the lowest return (all: --json, or --csv DIR):"));
        agents.truncate(WORST);
    }
    lines.push(of_agents(finding, evaluation, &agents, title, digits));
    lines.join("\n")
}

/// Returns a table with one line for each of `agents`. `digits`: how many digits after the point a return has.
fn of_agents(
    finding: &Finding,
    evaluation: &Evaluation,
    agents: &[usize],
    title: &dyn Fn(usize) -> String,
    digits: usize,
) -> String {
    let measures = &evaluation.measures.per_agent;
    // Of one episode there is no interval.
    let is_sure = evaluation.episodes() > 1;
    let mut names = vec!["return"];
    names.extend(is_sure.then_some("+-"));
    names.push("median");
    names.extend(measures.iter().map(|(name, _)| name.as_str()));
    names.push("stuck");
    let cells = |&agent: &usize| {
        let of_agent = evaluation.of_agent(agent);
        let half_width = finding.of_agent(agent).half_width;
        let mut cells = vec![format!("{:.digits$}", of_agent.mean)];
        cells.extend(is_sure.then(|| half_width.map_or("-".to_owned(), |half_width| format!("{half_width:.digits$}"))));
        cells.push(format!("{:.digits$}", of_agent.median));
        cells.extend(measures.iter().map(|(_, values)| format!("{:.3}", values[agent])));
        cells.push(if evaluation.stuck[agent] { "yes" } else { "no" }.to_owned());
        cells
    };
    let labels: Vec<String> = agents.iter().map(|&agent| title(agent)).collect();
    blocks(&names, &labels, &agents.iter().map(cells).collect::<Vec<_>>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::{EpisodeReport, Player};
    use dials_core::base::Rows;
    use dials_core::domain::Measures;

    fn shown(agents: usize, policies: Option<Selection>) -> String {
        let measures = Measures {
            per_agent: vec![("x".into(), (0..agents).map(|agent| 10_f64.powi(agent as i32 % 7)).collect())],
            ..Measures::default()
        };
        let episode = |add: f64| EpisodeReport {
            returns: (0..agents).map(|agent| 100.0 - agent as f64 + add).collect(),
            measures: measures.clone(),
        };
        let episodes = vec![episode(0.0), episode(2.0)];
        let mut returns = Rows::new(0, agents);
        episodes.iter().for_each(|episode| returns.push(&episode.returns));
        let evaluation = Evaluation { returns, measures, stuck: vec![false; agents] };
        let player = Player { label: "p".into(), keys: Vec::new(), policies, others: None };
        text(&evaluation, &Finding { player, episodes }, &|agent| format!("agent {agent}"))
    }

    #[test]
    fn the_columns_are_aligned_whatever_the_values_and_of_many_agents_the_worst_are_shown() {
        let text = shown(8, Some(Selection::Greedy));
        assert!(text.starts_with("return 97.5 +- "), "{text}");
        assert!(text.contains("(+-: half of a 95 % interval over 2 episodes; greedy policies)"), "{text}");
        let lines: Vec<&str> = text.lines().skip_while(|line| !line.contains("stuck")).collect();
        assert_eq!(lines.len(), 9, "{text}");
        assert!(lines.iter().all(|line| line.len() == lines[0].len()), "{text}");
        let text = shown(20, None);
        assert!(
            text.contains("20 agents: returns from 82.0 to 101.0, 0 stuck\nthe 5 with the lowest return"),
            "{text}"
        );
        let shown: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("agent ")?.split(' ').next()).collect();
        assert_eq!(shown, ["19", "18", "17", "16", "15"]);
    }
}
