//! Datasets for influence predictors: Algorithm 2, with the policies of a run or such that were not trained.

use std::path::PathBuf;

use anyhow::{Result, ensure};
use dials_core::base::AgentId;
use dials_core::domain::{Kinds, RegionSpec};
use dials_learn::observer::Silent;
use dials_learn::steps::Step;
use dials_learn::steps::collect::{Collect, Purpose};
use dials_learn::worker::Worker;
use dials_session::directory;
use dials_session::domains::open_untried;
use serde::Deserialize;
use serde_json::{Value, json};
use stacknets::Threads;

use crate::memory::{Memory, free_bytes};
use crate::request::Opened;
use crate::wire::Refused;

#[derive(Debug, Deserialize)]
pub(crate) struct DatasetsRequest {
    pub episodes: usize,
    /// The run whose policies act.
    pub run: Option<PathBuf>,
}

/// Returns the number of episodes whose tables fit into the free memory at best. Each table is there three times: here, as the image
/// and as shared memory.
fn most_episodes(kinds: &Kinds) -> usize {
    let per_step = |spec: &RegionSpec| spec.d_set_dim * size_of::<f32>() + spec.sources.count();
    let per_episode = kinds.specs().map(|spec| spec.horizon * per_step(spec)).sum::<usize>();
    free_bytes() / (3 * per_episode).max(1)
}

/// Datasets of all agents, in the memory.
pub(crate) struct Datasets {
    about: Value,
}

impl Datasets {
    pub(crate) fn open(opened: Opened, request: &DatasetsRequest, mut memory: Memory) -> Result<Datasets> {
        let Opened { config, domain, names, own } = opened;
        ensure!(
            own.observation.is_none(),
            "datasets: the policies of this config see with a function of Python, and here the program acts; name a config with an \
             observation of ours"
        );
        let kinds = domain.kinds();
        let most = most_episodes(kinds);
        if request.episodes > most {
            let text = format!("episodes {}: there is memory for at most {most} of this config", request.episodes);
            return Err(Refused(text).into());
        }
        let mut worker = Worker::new(domain.clone(), &config.learning, AgentId::all(kinds.agents()), &Threads::one());
        let policies = match &request.run {
            Some(path) => {
                let run = directory::open_with(path, open_untried)?;
                ensure!(run.domain.names() == names, "{}: is a run of other agents", path.display());
                ensure!(
                    run.config.learning.policy == config.learning.policy,
                    "{}: its policies have other networks than the config; name the run as the config, too",
                    path.display()
                );
                run.policies
            }
            None => worker.policies(),
        };
        worker.take_policies(policies);
        let collect = Collect { purpose: Purpose::Training { steps: 0 }, episodes: 0..request.episodes };
        let datasets = collect.run(&mut worker, &Silent)?;
        let (mut d_sets, mut sources, mut agents) = (Vec::new(), Vec::new(), Vec::new());
        for (agent, (dataset, name)) in datasets.iter().zip(&names).enumerate() {
            let width = dataset.d_sets.width();
            let begin = d_sets.len();
            d_sets.resize(begin + dataset.len() * width, 0.0);
            let rows = d_sets[begin..].chunks_exact_mut(width);
            rows.enumerate().for_each(|(row, values)| dataset.d_sets.read(row, values));
            sources.extend_from_slice(dataset.sources.as_slice());
            let spec = &kinds.of(AgentId(agent)).spec;
            agents.push(json!({
                "name": name,
                "d_set_dim": width,
                "classes": spec.sources.classes,
                "own_sources": dataset.own_sources,
            }));
        }
        let of_d_sets = memory.section::<f32>("d_sets", d_sets.len(), "f4");
        let of_sources = memory.section::<u8>("sources", sources.len(), "u1");
        let mut memory = memory.finish(1)?;
        memory.put(&of_d_sets, &d_sets);
        memory.put(&of_sources, &sources);
        memory.show()?;
        let about = json!({ "agents": agents, "horizon": kinds.horizon(), "memory": memory.describe() });
        Ok(Datasets { about })
    }

    pub(crate) fn describe(&self) -> &Value {
        &self.about
    }
}
