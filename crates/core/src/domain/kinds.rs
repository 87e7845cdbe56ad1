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
    pub(crate) row: usize,
}

/// The kinds of a domain. Every agent belongs to exactly one of them; kinds may interleave.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Kinds {
    kinds: Vec<Kind>,
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
        for (index, Kind { name, spec, agents }) in kinds.iter().enumerate() {
            let check = |holds: bool, wrong: &str| {
                ensure!(holds, "kind `{name}`: {wrong}");
                Ok(())
            };
            let letters = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || "-_".contains(c);
            let is_name = !name.is_empty() && name.chars().all(letters);
            check(is_name, "not a name of letters a to z, digits, - and _")?;
            check(names.insert(name), "there are two of this name")?;
            check(!agents.is_empty(), "it has no agents")?;
            check(agents.is_sorted(), "its agents are not in ascending order")?;
            let (own, others) = (spec.horizon, kinds[0].spec.horizon);
            check(own == others, &format!("its horizon is {own}, but that of others is {others}"))?;
            check(spec.sources.classes.iter().all(|&classes| classes > 1), "a source has fewer than two classes")?;
            for (row, agent) in agents.iter().enumerate() {
                ensure!(agent.0 < places.len(), "kind `{name}`: it has agent {agent}, but a lower number is missing");
                let taken = places[agent.0].replace(Place { kind: index, row }).is_some();
                ensure!(!taken, "kind `{name}`: it has agent {agent}, which another kind or place already has");
            }
        }
        let places = places.into_iter().map(|place| place.expect("n agents in n places, no two in one"));
        let places: Vec<Place> = places.collect();
        let sources = places.iter().map(|place| kinds[place.kind].spec.sources.count()).collect();
        Ok(Kinds { kinds, places, sources })
    }

    /// Makes a single kind of `agents` agents.
    pub fn one(agents: usize, spec: RegionSpec) -> Kinds {
        let kind = Kind { name: "agent".to_owned(), spec, agents: AgentId::all(agents) };
        Kinds::new(vec![kind]).expect("a domain has at least one agent, and sources of two classes or more")
    }

    /// Sets how many influence sources each agent has itself. Its kind may have more: the last ones then never happen to
    /// this agent. Without this, every agent has all sources of its kind.
    pub fn with_sources(mut self, sources: Vec<usize>) -> Kinds {
        assert_eq!(sources.len(), self.agents(), "one number per agent");
        let fits = self.specs().zip(&sources).all(|(spec, &sources)| sources <= spec.sources.count());
        assert!(fits, "no agent has more sources than its kind");
        self.sources = sources;
        self
    }

    /// Returns the same kinds with another number of columns of observations.
    pub fn with_obs_dim(mut self, obs_dim: usize) -> Kinds {
        self.kinds.iter_mut().for_each(|kind| (kind.spec.obs_dim, kind.spec.sets) = (obs_dim, None));
        self
    }

    pub fn agents(&self) -> usize {
        self.places.len()
    }

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::SourceSpec;

    fn kind(name: &str, horizon: usize, agents: &[usize]) -> Kind {
        let sources = SourceSpec::bits(1);
        let (obs_dim, d_set_dim, n_actions, local_horizon) = (1, 1, 2, horizon);
        let spec =
            RegionSpec { obs_dim, d_set_dim, n_actions, sets: None, masks: false, sources, horizon, local_horizon };
        Kind { name: name.to_owned(), spec, agents: agents.iter().map(|&agent| AgentId(agent)).collect() }
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
