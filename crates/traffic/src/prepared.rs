//! What local simulators of a scenario are made from: the cuts and the visits, as bytes for workers and for a later resume.

use std::borrow::Cow;
use std::fmt::Write;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};

use crate::agents::plan::JointPlan;
use crate::cut::local_net::LocalNet;
use crate::road_network::scenario::ScenarioFiles;
use crate::sim::visits::Visits;
use libsumo::Simulation;

#[derive(Serialize, Deserialize)]
pub(crate) struct Prepared<'a> {
    /// That of [`ScenarioFiles::made_from`].
    pub(crate) made_from: [u8; 32],
    /// The net of each agent's region.
    pub(crate) nets: Cow<'a, [LocalNet]>,
    pub(crate) visits: Cow<'a, Visits>,
}

impl Prepared<'_> {
    /// Returns the bytes, with their own digest in front.
    pub(crate) fn to_bytes(&self) -> Result<Vec<u8>> {
        let body = postcard::to_stdvec(self).context("cuts and visits cannot be encoded")?;
        Ok([&*Sha256::digest(&body), &body].concat())
    }

    pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Prepared<'static>> {
        let (digest, body) = bytes.split_at_checked(32).context("these bytes are no cuts and visits")?;
        ensure!(digest == &*Sha256::digest(body), "these bytes are damaged");
        postcard::from_bytes(body).context("these bytes are no cuts and visits")
    }
}

impl ScenarioFiles {
    /// Returns the digest of all that cuts and visits depend on: the files, the agents and their regions, SUMO and this program.
    pub(crate) fn made_from(&self, plan: &JointPlan) -> Result<[u8; 32]> {
        let mut hashed = Hashed(Sha256::new());
        let [program, sumo, libm] = [env!("CARGO_PKG_VERSION"), Simulation::version()?, &Simulation::libm()];
        write!(hashed, "{program}\n{sumo}\n{libm}\n{:08x}\n{plan:?}", self.files.checksum())?;
        Ok(hashed.0.finalize().into())
    }
}

/// Takes text without keeping it: the plans of a city have megabytes of it.
struct Hashed(Sha256);

impl Write for Hashed {
    fn write_str(&mut self, text: &str) -> std::fmt::Result {
        self.0.update(text);
        Ok(())
    }
}
