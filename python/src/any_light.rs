//! A policy for any light: one of this program, or one from a file. Its weights are handed over in the memory.

use std::path::PathBuf;

use anyhow::Result;
use dials_traffic::any_light::AnyLight;
use serde::Deserialize;
use serde_json::{Value, json};

use crate::agent;
use crate::memory::Memory;

#[derive(Debug, Deserialize)]
pub(crate) struct AnyLightRequest {
    /// The file. `None`: one of this program.
    pub file: Option<PathBuf>,
    /// Whether lights see a part of the cars. A file serves both.
    pub partial: bool,
}

/// The weights, in the memory, and what they belong to.
pub(crate) struct ReadAnyLight {
    about: Value,
}

impl ReadAnyLight {
    pub(crate) fn open(request: &AnyLightRequest, mut memory: Memory) -> Result<ReadAnyLight> {
        let policy = match &request.file {
            Some(file) => AnyLight::read(file)?,
            None => AnyLight::shipped(request.partial)?,
        };
        let parameters = memory.section::<f32>("parameters", policy.parameters().len(), "f4");
        memory.put(&parameters, policy.parameters());
        let memory = memory.finish(0)?;
        memory.show()?;
        // Shapes begin with the number of networks, which is one.
        let layout = policy.shape().layout();
        let tensors = layout.blocks(1).map(|(name, shape, _)| json!([name, &shape[1..]]));
        let about = json!({
            "tensors": tensors.collect::<Vec<_>>(),
            "sets": policy.shape().sets.as_ref().map(agent::sets),
            "memory": memory.describe(),
        });
        Ok(ReadAnyLight { about })
    }

    pub(crate) fn describe(&self) -> &Value {
        &self.about
    }
}
