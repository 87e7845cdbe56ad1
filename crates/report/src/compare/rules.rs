//! Whether the returns of two sides can be compared: they must be of the same scenario and by the same rules.

use anyhow::{Result, bail, ensure};

use super::ComparedSide;
use dials_core::domain::ScenarioId;
use dials_core::outside::quoted;
use dials_session::records::files::CONFIG;

/// Returns warnings about what the agents of the sides see.
///
/// # Errors
///
/// The scenarios differ, the rewards, or the versions of the environment.
pub(super) fn check(a: &ComparedSide, b: &ComparedSide) -> Result<Option<String>> {
    // The rules are the same for all runs of a side. A domain may name none.
    let rules = |side: &ComparedSide| side.group.runs.iter().find_map(|run| run.scenario().rules.clone());
    let mut differences = rules(a).zip(rules(b)).map_or(Vec::new(), |(of_a, of_b)| of_a.differences(&of_b, ["A", "B"]));
    if a.scenario == b.scenario {
        let warning = format!("A and B differ in more than their methods: {}", differences.join("; "));
        return Ok((!differences.is_empty()).then_some(warning));
    }
    // The checksum of a network of one's own covers the reward, too.
    let place = |side: &ComparedSide| ScenarioId { rules: None, checksum: None, ..side.scenario.clone() };
    ensure!(
        place(a) == place(b) && a.scenario.rules != b.scenario.rules,
        "{} is {} and {} is {}: returns of different scenarios (domain, agents, horizon, network) cannot be compared",
        a.name,
        a.scenario.word(),
        b.name,
        b.scenario.word()
    );
    if let (Some(of_a), Some(of_b)) = (&a.scenario.checksum, &b.scenario.checksum)
        && of_a != of_b
    {
        differences.push(format!("checksum of network and rules: {of_a} in A, {of_b} in B"));
    }
    let [of_a, of_b] = [a, b].map(|side| &side.group.runs[0].dir);
    bail!(
        "the returns of A and B are by different rules, so their difference means nothing\n  {}\nplay both by the same \
         rules on the same episodes, and compare other figures:\n  dials-traffic baseline {} --compare {},{}",
        differences.join("\n  "),
        quoted(&of_a.join(CONFIG)),
        quoted(of_a),
        quoted(of_b)
    )
}
