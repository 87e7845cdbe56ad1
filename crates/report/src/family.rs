//! Families of scenarios: those whose returns may share an axis and a table, because they differ in their size only.

use super::group::Comparison;
use super::paper;
use dials_core::domain::ScenarioId;

/// Scenarios of one domain with equal episodes and equal rules. Their agents are all in rows, or it is a single network.
pub(crate) struct Family<'a> {
    /// Title, unique in a report: `traffic` if all its scenarios of this domain are in one family.
    pub(crate) title: String,
    pub(crate) slug: String,
    pub(crate) comparisons: Vec<&'a Comparison>,
}

impl Family<'_> {
    pub(crate) fn has_paper(&self) -> bool {
        self.comparisons.iter().any(|comparison| paper::has(&comparison.scenario))
    }
}

/// Returns the families of a report, those of a domain one after the other.
pub(crate) fn families<'a>(comparisons: &'a [Comparison]) -> Vec<Family<'a>> {
    let mut kin: Vec<Vec<&'a Comparison>> = Vec::new();
    for comparison in comparisons {
        match kin.iter_mut().find(|family| are_kin(family[0], comparison)) {
            Some(family) => family.push(comparison),
            None => kin.push(vec![comparison]),
        }
    }
    let domain = |family: &[&Comparison]| family[0].scenario.domain.clone();
    kin.sort_by_key(|family| domain(family));
    let alone = |name: &str| kin.iter().filter(|family| domain(family) == name).count() == 1;
    let family = |comparisons: &Vec<&'a Comparison>| {
        let name = domain(comparisons);
        let (title, slug) = match &comparisons[..] {
            _ if alone(&name) => (name.clone(), name),
            [only] => (only.title.clone(), only.slug.clone()),
            _ => of_several(&comparisons[0].scenario),
        };
        Family { title, slug, comparisons: comparisons.clone() }
    };
    kin.iter().map(family).collect()
}

fn are_kin(one: &Comparison, other: &Comparison) -> bool {
    let same = |a: &ScenarioId, b: &ScenarioId| a.domain == b.domain && a.episode == b.episode && a.rules == b.rules;
    let in_rows = one.map().is_some() && other.map().is_some();
    in_rows && same(&one.scenario, &other.scenario)
}

/// Returns the title and the slug of several scenarios beside others of their domain.
fn of_several(scenario: &ScenarioId) -> (String, String) {
    let ScenarioId { domain, episode, rules, .. } = scenario;
    let (title, slug) = match rules {
        Some(rules) => (format!(", rules {rules}"), format!("_{}", rules.replace('-', "_"))),
        None => (String::new(), String::new()),
    };
    let length = episode.length;
    (format!("{domain}, grids, {length} {}{title}", episode.unit), format!("{domain}_grids_{length}{slug}"))
}
