//! Rewards and observations that the Python process computes, for all rows of a simulator at once.

use std::time::Duration;

use anyhow::{Context, Result};
use serde_json::json;

use super::{Answer, Array, Link};
use crate::records::run_json::PythonFunction;
use dials_core::base::AgentId;
use dials_core::domain::own::{OwnFunctions, OwnRows, OwnSource};
use dials_core::domain::roads::{RoadTables, RoadsNow};

/// What a connection is for.
const FUNCTIONS: &str = "functions";

/// The Python process that started this one.
pub(crate) struct PythonFunctions;

impl OwnSource for PythonFunctions {
    fn width(&self, tables: &RoadTables, observation: &str) -> Result<usize> {
        let rows = AgentId::all(tables.agents.len());
        let link = open(tables, &rows, None, Some(observation))?;
        let width =
            link.opened["width"].as_u64().context("the Python process did not say how wide the observation is")?;
        Ok(width as usize)
    }

    fn open(&self, tables: &RoadTables, rows: &[AgentId], functions: &OwnFunctions) -> Result<Box<dyn OwnRows>> {
        let observation = functions.observation.as_ref().map(|(name, _)| &**name);
        let link = open(tables, rows, functions.reward.as_deref(), observation)?;
        Ok(Box::new(Rows {
            link,
            rows: rows.len(),
            pays: functions.reward.is_some(),
            width: functions.observation.as_ref().map(|(_, width)| *width),
            bytes: Vec::new(),
        }))
    }
}

fn open(tables: &RoadTables, rows: &[AgentId], reward: Option<&str>, observation: Option<&str>) -> Result<Link> {
    let rows: Vec<usize> = rows.iter().map(|agent| agent.0).collect();
    Link::open(FUNCTIONS, &json!({ "tables": tables, "rows": rows, "reward": reward, "observation": observation }))
}

/// Returns functions as the Python process describes them. `objects`: `learner` and `predictor`, those that the run has.
pub(crate) fn described(
    reward: Option<&str>,
    observation: Option<&str>,
    objects: &[&str],
) -> Result<Vec<PythonFunction>> {
    let about = json!({ "reward": reward, "observation": observation, "objects": objects });
    let link = Link::open(FUNCTIONS, &about)?;
    serde_json::from_value(link.opened.clone()).context("the Python process did not describe its functions")
}

struct Rows {
    link: Link,
    rows: usize,
    pays: bool,
    /// Number of columns of the observation, if it has one.
    width: Option<usize>,
    bytes: Vec<u8>,
}

impl Rows {
    fn ask(&mut self, call: &str, now: &RoadsNow, stepped: Duration) -> Result<Answer> {
        self.bytes.clear();
        now.put(&mut self.bytes);
        let roads = Array::of("roads", &[self.bytes.len()], &self.bytes);
        self.link.ask(call, json!(stepped.as_secs_f64()), &[roads])
    }

    fn observations(&self, answer: &Answer) -> Result<Option<Vec<f32>>> {
        self.width.map(|width| answer.array("obs", &[self.rows, width])).transpose()
    }
}

impl OwnRows for Rows {
    fn begin(&mut self, now: &RoadsNow, rows: &[usize], obs: &mut [f32]) -> Result<()> {
        let answer = self.ask("begin", now, Duration::ZERO)?;
        if let (Some(seen), Some(width)) = (self.observations(&answer)?, self.width) {
            for place in rows.iter().map(|row| row * width..(row + 1) * width) {
                obs[place.clone()].copy_from_slice(&seen[place]);
            }
        }
        Ok(())
    }

    fn step(&mut self, now: &RoadsNow, stepped: Duration, rewards: &mut [f32], obs: &mut [f32]) -> Result<()> {
        let answer = self.ask("step", now, stepped)?;
        if self.pays {
            rewards.copy_from_slice(&answer.array::<f32>("rewards", &[self.rows])?);
        }
        if let Some(seen) = self.observations(&answer)? {
            obs.copy_from_slice(&seen);
        }
        Ok(())
    }
}
