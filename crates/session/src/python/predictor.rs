//! The predictor of `predictor = "outside"`, in the Python process that started this run.
//!
//! The coordinator has one connection: for learning, losses and the state. Every block of local simulators has its own, for
//! samples, with one question per step for all of its rows.

use std::time::Instant;

use anyhow::{Context, Result};
use serde::Deserialize;
use serde_json::{Value, json};

use super::link::{Array, Link};
use crate::config::RunConfig;
use dials_core::base::{AgentId, Rows};
use dials_core::domain::{Domain, RegionSpec};
use dials_learn::predictors::Dataset;
use dials_learn::predictors::outside::{self, Losses, OutsidePredictor, OutsideRows};

/// Makes the predictor known, if the config has one outside of this program. It connects where it is used.
pub fn install(config: &RunConfig, domain: &dyn Domain) {
    if !config.learning.predicts_outside() {
        return;
    }
    let agents = domain.names().into_iter().zip(domain.kinds().specs()).enumerate().map(|(agent, (name, spec))| {
        let own_sources = domain.kinds().sources(AgentId(agent));
        json!({ "name": name, "own_sources": own_sources, "classes": spec.sources.classes })
    });
    let about = json!({ "agents": agents.collect::<Vec<_>>(), "seed": config.learning.seed });
    let own_sources = AgentId::all(domain.agents()).into_iter().map(|agent| domain.kinds().sources(agent)).collect();
    outside::install(Box::new(InPython { about, own_sources, link: None }));
}

struct InPython {
    about: Value,
    /// Number of sources that each agent has itself.
    own_sources: Vec<usize>,
    /// The connection of the coordinator, once it needs one.
    link: Option<Link>,
}

impl InPython {
    fn link(&mut self) -> Result<&mut Link> {
        if self.link.is_none() {
            self.link = Some(Link::open("predictor", &self.about)?);
        }
        Ok(self.link.as_mut().expect("it was just opened"))
    }

    /// Sends the datasets, one message each: together they may be large.
    fn show(&mut self, datasets: &[Dataset], training: usize) -> Result<()> {
        let link = self.link()?;
        for (agent, dataset) in datasets.iter().enumerate() {
            let (width, count, horizon) = (dataset.d_sets.width(), dataset.sources.width(), dataset.horizon);
            let mut d_sets = vec![0.0; dataset.len() * width];
            d_sets.chunks_exact_mut(width).enumerate().for_each(|(sample, row)| dataset.d_sets.read(sample, row));
            let arrays = [
                Array::of("d_set", &[dataset.episodes(), horizon, width], &d_sets),
                Array::of("sources", &[dataset.episodes(), horizon, count], dataset.sources.as_slice()),
            ];
            link.ask("dataset", json!({ "agent": agent, "training": training / horizon }), &arrays)?;
        }
        Ok(())
    }

    /// Splits the losses of all agents, one after another.
    fn of_agents(&self, losses: &[f64]) -> Vec<Vec<f64>> {
        let mut rest = losses;
        let mut next = |&count: &usize| {
            let (own, others) = rest.split_at(count);
            rest = others;
            own.to_vec()
        };
        self.own_sources.iter().map(&mut next).collect()
    }
}

impl OutsidePredictor for InPython {
    fn rows(&self, agents: &[AgentId], spec: &RegionSpec) -> Result<Box<dyn OutsideRows>> {
        let agents: Vec<usize> = agents.iter().map(|agent| agent.0).collect();
        let about = json!({ "rows_of": agents, "classes": spec.sources.classes });
        let link = Link::open("predictor", &about)?;
        let Opened { watches } =
            Opened::deserialize(&link.opened).context("the predictor in Python was not described")?;
        Ok(Box::new(RowsInPython { link, watches, answered: Instant::now() }))
    }

    fn fit(&mut self, datasets: &[Dataset], training: usize) -> Result<Losses> {
        self.show(datasets, training)?;
        let answer = self.link()?.ask("fit", Value::Null, &[])?;
        let count: usize = self.own_sources.iter().sum();
        let losses: Vec<f64> = answer.array("losses", &[2, 2, count])?;
        let part = |when: usize, which: usize| self.of_agents(&losses[(2 * when + which) * count..][..count]);
        Ok([0, 1].map(|when| [0, 1].map(|which| part(when, which))))
    }

    fn losses(&mut self, datasets: &[Dataset]) -> Result<Vec<Vec<f64>>> {
        self.show(datasets, 0)?;
        let count: usize = self.own_sources.iter().sum();
        let losses: Vec<f64> = self.link()?.ask("measure", Value::Null, &[])?.array("losses", &[count])?;
        Ok(self.of_agents(&losses))
    }

    fn state(&mut self) -> Result<Vec<u8>> {
        Ok(self.link()?.ask("state", Value::Null, &[])?.any_array("state")?.1)
    }

    fn load(&mut self, state: &[u8]) -> Result<()> {
        self.link()?.ask("load", Value::Null, &[Array::of("state", &[state.len()], state)]).map(drop)
    }
}

/// What the Python process says of the predictor.
#[derive(Deserialize)]
struct Opened {
    /// Whether it has a memory, and wants to see d-sets whose sources are known.
    watches: bool,
}

struct RowsInPython {
    link: Link,
    watches: bool,
    /// When the last answer came: the time since then is that of the simulators and of learning.
    answered: Instant,
}

impl OutsideRows for RowsInPython {
    fn begin(&mut self, copies: usize) -> Result<()> {
        self.link.ask("begin", json!(copies), &[])?;
        self.answered = Instant::now();
        Ok(())
    }

    fn forget(&mut self, rows: &[usize]) -> Result<()> {
        let rows: Vec<i64> = rows.iter().map(|&row| row as i64).collect();
        self.link.ask("forget", Value::Null, &[Array::of("rows", &[rows.len()], &rows)]).map(drop)
    }

    fn watch(&mut self, d_set: &Rows<f32>) -> Result<()> {
        if self.watches {
            self.link.ask(
                "watch",
                Value::Null,
                &[Array::of("d_set", &[d_set.len(), d_set.width()], d_set.as_slice())],
            )?;
        }
        Ok(())
    }

    fn sample(&mut self, d_set: &Rows<f32>, uniform: &Rows<f32>) -> Result<Vec<u8>> {
        let shape = [uniform.len(), uniform.width()];
        let arrays = [
            Array::of("d_set", &[d_set.len(), d_set.width()], d_set.as_slice()),
            Array::of("uniform", &shape, uniform.as_slice()),
        ];
        let beside = self.answered.elapsed().as_secs_f64();
        let sources = self.link.ask("sample", json!(beside), &arrays)?.array("sources", &shape);
        self.answered = Instant::now();
        sources
    }
}
