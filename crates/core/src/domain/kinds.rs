//! Kinds: agents whose regions have the same shape. They share a stack of networks and a local simulator.

use std::collections::BTreeSet;
use std::ops::Index;

use anyhow::ensure;

use super::{RegionSpec, Result};
use crate::base::AgentId;

/// The agents of one shape.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kind {
    /// Name of lower-case letters, digits, `-` and `_`. It becomes a part of the names of tensors and files.
    pub name: String,
    pub spec: RegionSpec,
    /// Agents in ascending order.
    pub agents: Vec<AgentId>,
}

/// The place of an agent: the index of its kind, and its row among the agents of that kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    pub kind: usize,
    pub row: usize,
}

/// The kinds of a domain. Every agent belongs to exactly one of them; kinds may interleave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kinds {
    kinds: Vec<Kind>,
    /// Place of each agent.
    places: Vec<Place>,
    /// Number of influence sources that each agent has itself.
    sources: Vec<usize>,
}

impl Kinds {
    /// Makes the kinds. Together they must hold the agents `0..n`, each once, and have one horizon. An error says what
    /// is wrong.
    pub fn new(kinds: Vec<Kind>) -> Result<Kinds> {
        ensure!(!kinds.is_empty(), "a domain has at least one kind of agents");
        let mut places = vec![None; kinds.iter().map(|kind| kind.agents.len()).sum()];
        let mut names = BTreeSet::new();
        for (index, kind) in kinds.iter().enumerate() {
            let Kind { name, spec, agents } = kind;
            let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
            ensure!(
                !name.is_empty() && name.chars().all(letters),
                "kind `{name}`: not a name of letters a to z, digits, - and _"
            );
            ensure!(names.insert(name), "kind `{name}`: there are two of this name");
            ensure!(!agents.is_empty(), "kind `{name}`: it has no agents");
            ensure!(agents.is_sorted(), "kind `{name}`: its agents are not in ascending order");
            let horizon = kinds[0].spec.horizon;
            ensure!(
                spec.horizon == horizon,
                "kind `{name}`: its horizon is {}, but that of others is {horizon}",
                spec.horizon
            );
            ensure!(
                spec.sources.classes.iter().all(|&classes| classes > 1),
                "kind `{name}`: a source has fewer than two classes"
            );
            for (row, agent) in agents.iter().enumerate() {
                let place: Option<&mut Option<Place>> = places.get_mut(agent.0);
                let place = place.ok_or_else(|| {
                    anyhow::anyhow!("kind `{name}`: it has agent {agent}, but a lower number is missing")
                })?;
                ensure!(
                    place.is_none(),
                    "kind `{name}`: it has agent {agent}, which another kind or place already has"
                );
                *place = Some(Place { kind: index, row });
            }
        }
        let places = places.into_iter().map(|place| place.expect("n agents in n places, no two in one"));
        Ok(Kinds::of_places(kinds, places.collect()))
    }

    /// Makes a single kind of `agents` agents.
    pub fn one(agents: usize, spec: RegionSpec) -> Kinds {
        assert!(agents > 0, "a domain has at least one agent");
        let places = (0..agents).map(|row| Place { kind: 0, row }).collect();
        Kinds::of_places(vec![Kind { name: "agent".to_owned(), spec, agents: AgentId::all(agents) }], places)
    }

    fn of_places(kinds: Vec<Kind>, places: Vec<Place>) -> Kinds {
        let sources = places.iter().map(|place| kinds[place.kind].spec.sources.count()).collect();
        Kinds { kinds, places, sources }
    }

    /// Says how many influence sources each agent has itself. Its kind may have more: the last ones then never happen to
    /// this agent. Without this, every agent has all sources of its kind.
    pub fn with_sources(mut self, sources: Vec<usize>) -> Kinds {
        assert_eq!(sources.len(), self.agents(), "one number per agent");
        let fits = self.specs().zip(&sources).all(|(spec, &sources)| sources <= spec.sources.count());
        assert!(fits, "no agent has more sources than its kind");
        self.sources = sources;
        self
    }

    /// Returns the number of agents of all kinds.
    pub fn agents(&self) -> usize {
        self.places.len()
    }

    /// Returns the number of kinds.
    pub fn count(&self) -> usize {
        self.kinds.len()
    }

    pub fn iter(&self) -> std::slice::Iter<'_, Kind> {
        self.kinds.iter()
    }

    /// Returns the number of steps of an episode, the same for all kinds.
    pub fn horizon(&self) -> usize {
        self.kinds[0].spec.horizon
    }

    /// Returns the number of influence sources that the agent has itself. These are the first ones of its kind.
    pub fn sources(&self, agent: AgentId) -> usize {
        self.sources[agent.0]
    }

    pub fn place(&self, agent: AgentId) -> Place {
        self.places[agent.0]
    }

    pub fn of(&self, agent: AgentId) -> &Kind {
        &self.kinds[self.place(agent).kind]
    }

    /// Returns the spec of every agent, in order.
    pub fn specs(&self) -> impl Iterator<Item = &RegionSpec> + Clone {
        self.places.iter().map(|place| &self.kinds[place.kind].spec)
    }

    /// Returns the prefix of the names of a kind's tensors and files; empty if there is only one kind.
    pub fn prefix(&self, kind: &Kind) -> String {
        if self.kinds.len() == 1 { String::new() } else { format!("{}.", kind.name) }
    }
}

impl Index<usize> for Kinds {
    type Output = Kind;

    fn index(&self, kind: usize) -> &Kind {
        &self.kinds[kind]
    }
}

impl<'a> IntoIterator for &'a Kinds {
    type Item = &'a Kind;
    type IntoIter = std::slice::Iter<'a, Kind>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::SourceSpec;

    fn kind(name: &str, horizon: usize, agents: &[usize]) -> Kind {
        let sources = SourceSpec::bits(1);
        let spec = RegionSpec {
            obs_dim: 1,
            d_set_dim: 1,
            n_actions: 2,
            masks: false,
            sources,
            horizon,
            local_horizon: horizon,
        };
        Kind { name: name.to_owned(), spec, agents: agents.iter().map(|&agent| AgentId(agent)).collect() }
    }

    #[test]
    fn kinds_may_interleave_and_every_agent_is_found() {
        let kinds = Kinds::new(vec![kind("a", 5, &[0, 2]), kind("b", 5, &[1, 3, 4])]).unwrap();
        assert_eq!((kinds.agents(), kinds.count(), kinds.horizon()), (5, 2, 5));
        let places: Vec<(usize, usize)> =
            AgentId::all(5).into_iter().map(|agent| kinds.place(agent)).map(|place| (place.kind, place.row)).collect();
        assert_eq!(places, [(0, 0), (1, 0), (0, 1), (1, 1), (1, 2)]);
        assert_eq!(kinds.of(AgentId(3)).name, "b");
        assert_eq!([kinds.prefix(&kinds[0]), kinds.prefix(&kinds[1])], ["a.", "b."]);
    }

    #[test]
    fn one_kind_has_all_agents_and_no_prefix() {
        let kinds = Kinds::one(3, kind("x", 7, &[]).spec);
        assert_eq!((kinds.agents(), kinds.count(), kinds[0].agents.len()), (3, 1, 3));
        assert_eq!(kinds.prefix(&kinds[0]), "");
    }

    #[test]
    fn what_does_not_partition_the_agents_is_refused() {
        for (kinds, reason) in [
            (vec![], "at least one kind"),
            (vec![kind("a", 5, &[])], "kind `a`: it has no agents"),
            (vec![kind("a", 5, &[0, 2])], "kind `a`: it has agent 2, but a lower number is missing"),
            (vec![kind("a", 5, &[0, 1]), kind("b", 5, &[1])], "kind `b`: it has agent 1, which another"),
            (vec![kind("a", 5, &[1, 0])], "kind `a`: its agents are not in ascending order"),
            (vec![kind("a", 5, &[0]), kind("a", 5, &[1])], "kind `a`: there are two of this name"),
            (vec![kind("a.b", 5, &[0])], "kind `a.b`: not a name"),
            (vec![kind("a", 5, &[0]), kind("b", 6, &[1])], "kind `b`: its horizon is 6, but that of others is 5"),
        ] {
            let error = Kinds::new(kinds).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}
