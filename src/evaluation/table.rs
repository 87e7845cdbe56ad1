//! One player as text for people: its figures, and a line per agent.

use super::{Evaluation, Finding, figures};
use crate::base::statistics::Interval;
use crate::domain::Domain;

/// Writes one player, with a line per agent.
pub fn table(domain: &dyn Domain, finding: &Finding) -> String {
    let evaluation = Evaluation::new(domain, &finding.episodes);
    let figures = figures(&finding.episodes);
    let ((name, returns), measures) = figures.split_first().expect("there is always a return");
    let (all, returns) = (evaluation.of_all(), Interval::of(returns));
    let mut lines = vec![format!(
        "{name} {:.1}{} (mean and half of its 95 % interval over {} episodes), median of the agents {:.1}",
        returns.mean,
        returns.half_width.map_or(String::new(), |half_width| format!(" +- {half_width:.1}")),
        evaluation.episodes(),
        all.median
    )];
    for (name, values) in measures {
        let Interval { mean, half_width } = Interval::of(values);
        let half_width = half_width.map_or(String::new(), |half_width| format!(" +- {half_width:.2}"));
        lines.push(format!("{name:>24} {mean:.2}{half_width}"));
    }
    lines.push(String::new());
    let names: String = evaluation.measures.per_agent.iter().map(|(name, _)| format!(" {name}")).collect();
    lines.push(format!("{:>5} {:>8} {:>8} {:>8}{names} stuck", "agent", "return", "+-95%", "median"));
    for agent in 0..evaluation.agents() {
        let half_width = finding.of_agent(agent).half_width;
        let measures = evaluation.measures.per_agent.iter();
        let measures: String =
            measures.map(|(name, values)| format!(" {:>width$.3}", values[agent], width = name.len())).collect();
        let of_agent = evaluation.of_agent(agent);
        lines.push(format!(
            "{agent:>5} {:>8.1} {:>8} {:>8.1}{measures} {:>5}",
            of_agent.mean,
            half_width.map_or("-".to_owned(), |half_width| format!("{half_width:.1}")),
            of_agent.median,
            if evaluation.stuck[agent] { "yes" } else { "no" }
        ));
    }
    lines.join("\n")
}
