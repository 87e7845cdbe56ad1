//! Places of the networks of all agents in a file: one stack per kind. If there are several kinds, the names of the
//! tensors begin with the kind's name.

use std::collections::HashMap;
use std::path::Path;

use anyhow::Context;

use dials_core::base::{AgentId, Ragged};
use dials_core::domain::{Kind, Kinds, RegionSpec, Result};
use dials_core::outside::read_bytes;
use dials_learn::config::{AipConfig, PolicyConfig, Predictor};
use dials_learn::policy::PolicyStack;
use stacknets::{Layout, StackToWrite, about_stacks, read_stack, write_stacks};

/// Largest file: 10 000 agents with 100 000 parameters each.
const LARGEST_FILE: u64 = 4 << 30;
/// Key of the timesteps per agent at which a file was written.
pub(crate) const STEPS: &str = "steps";

/// The layouts of all kinds.
pub struct JointLayout {
    kinds: Vec<KindLayout>,
}

struct KindLayout {
    prefix: String,
    agents: Vec<AgentId>,
    layout: Layout,
}

impl JointLayout {
    /// Makes the layouts. `layout`: returns the layout of an agent's network.
    pub(crate) fn new(kinds: &Kinds, layout: impl Fn(&RegionSpec) -> Layout) -> JointLayout {
        let of_kind = |kind: &Kind| KindLayout {
            prefix: kinds.prefix(kind),
            agents: kind.agents.clone(),
            layout: layout(&kind.spec),
        };
        JointLayout { kinds: kinds.iter().map(of_kind).collect() }
    }

    pub fn of_policies(kinds: &Kinds, config: &PolicyConfig) -> JointLayout {
        JointLayout::new(kinds, |spec| PolicyStack::shape(spec, config).layout())
    }

    pub fn of_aips(kinds: &Kinds, choice: Predictor, config: &AipConfig) -> JointLayout {
        JointLayout::new(kinds, |spec| choice.kind().layout(spec, config))
    }

    /// Writes a file of these networks. `networks`: one row of parameters per agent.
    pub(crate) fn write(&self, networks: &Ragged<f32>, about: &HashMap<String, String>, path: &Path) -> Result<()> {
        let stacks = self.kinds.iter().map(|KindLayout { prefix, layout, agents }| {
            let rows = agents.iter().map(|agent| networks.row(agent.0)).collect();
            StackToWrite { prefix, layout, rows }
        });
        write_stacks(&stacks.collect::<Vec<_>>(), about, path)
    }

    /// Reads the networks of such a file, one row of parameters per agent.
    pub fn read(&self, path: &Path) -> Result<Ragged<f32>> {
        Ok(self.read_with_steps(path)?.0)
    }

    /// Reads the networks of such a file, and the timesteps per agent at which it was written, if it says so.
    ///
    /// The file is read once: a run that is being trained replaces it at any moment.
    pub(crate) fn read_with_steps(&self, path: &Path) -> Result<(Ragged<f32>, Option<u64>)> {
        let bytes = read_bytes(path, LARGEST_FILE).with_context(|| format!("{}: cannot be read", path.display()))?;
        let mut widths = vec![0; self.kinds.iter().map(|kind| kind.agents.len()).sum()];
        let of_agents =
            self.kinds.iter().flat_map(|kind| kind.agents.iter().map(|agent| (agent.0, kind.layout.width())));
        of_agents.for_each(|(agent, width)| widths[agent] = width);
        let mut networks = Ragged::new(widths);
        for KindLayout { prefix, agents, layout } in &self.kinds {
            let names: Vec<String> = agents.iter().map(|agent| format!("agent {agent}")).collect();
            let rows = read_stack(&bytes, path, prefix, layout, &names)?;
            agents.iter().zip(rows.iter()).for_each(|(agent, row)| networks.row_mut(agent.0).copy_from_slice(row));
        }
        let steps = about_stacks(&bytes).get(STEPS).and_then(|steps| steps.parse().ok());
        Ok((networks, steps))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::domain::Domain;
    use dials_testkit::toy::CoinsAndDice;

    #[test]
    fn networks_of_kinds_that_interleave_come_back_agent_by_agent() {
        let domain = CoinsAndDice::new(5);
        let layout = JointLayout::new(domain.kinds(), |spec| Layout::new(vec![("w".to_owned(), vec![spec.n_actions])]));
        // Coins have two actions, dice three.
        let networks = Ragged::from_vec((0..10).map(|i| i as f32).collect(), [2, 3, 2, 3]).unwrap();
        let file = tempfile::NamedTempFile::new().unwrap();
        layout.write(&networks, &HashMap::new(), file.path()).unwrap();
        assert_eq!(layout.read(file.path()).unwrap(), networks);
        let dice = Layout::new(vec![("w".to_owned(), vec![3])]);
        let bytes = std::fs::read(file.path()).unwrap();
        let rows = read_stack(&bytes, file.path(), "die.", &dice, &[AgentId(1), AgentId(3)]).unwrap();
        assert_eq!(rows.as_slice(), [2.0, 3.0, 4.0, 7.0, 8.0, 9.0]);
    }
}
