//! What the Python process asks for, and the config and agents that it means.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use dials_core::base::AgentId;
use dials_core::domain::Domain;
use dials_session::config::RunConfig;
use dials_session::domains::{self, open_untried};
use dials_session::records::files;
use serde::{Deserialize, Serialize};

use crate::wire::Refused;

use crate::any_light::AnyLightRequest;
use crate::datasets::DatasetsRequest;

/// The first order: which environment this process is.
#[derive(Debug, Deserialize)]
pub(crate) struct Request {
    /// A config, a .sumocfg or a run directory.
    pub config: PathBuf,
    /// Settings `key=value`, as for `--set`.
    pub settings: Vec<String>,
    pub environment: Environment,
}

/// What a process can be.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Environment {
    /// A policy, and no environment: the config means nothing.
    AnyLight(AnyLightRequest),
    Datasets(DatasetsRequest),
    Joint(JointRequest),
    Local(LocalRequest),
    Policies(PoliciesRequest),
}

/// All agents on the global simulator (GS).
#[derive(Debug, Deserialize)]
pub(crate) struct JointRequest {
    /// Hand-coded controllers that decide for agents, by the agent's name.
    pub controller_for: BTreeMap<String, String>,
    /// Whether to measure all that `evaluate` prints.
    pub full_metrics: bool,
    /// Whether the Python process asks for pictures.
    pub draws: bool,
    /// Whether a function of the Python process sees what is on the roads.
    pub watches_roads: bool,
    /// Whether episodes are recorded, so that they can be saved as a replay.
    pub records: bool,
}

/// Local simulators of some agents of one kind, with an influence predictor.
#[derive(Debug, Deserialize)]
pub(crate) struct LocalRequest {
    /// Names of the agents; empty for all.
    pub agents: Vec<String>,
    pub copies: usize,
    pub predictor: PredictorRequest,
    pub stagger: bool,
    /// Whether a function of the Python process sees what is on the roads.
    pub watches_roads: bool,
}

/// The policies of a run directory.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PoliciesRequest {
    /// Reads the weights. Nobody acts.
    Read,
    /// Acts with weights that the Python process has read before and puts into the memory. The file may be of a later
    /// step by now.
    Act {
        /// Whether they choose the most probable action instead of drawing one.
        greedy: bool,
    },
}

/// Where the influence predictors come from.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum PredictorRequest {
    /// From this run directory.
    Run(PathBuf),
    /// Constants, measured on the GS under policies that were not trained.
    Marginals,
    /// Networks that were not trained.
    Untrained,
    /// From an object of the Python process, which puts the influence sources into the memory before each step.
    Own,
}

/// An episode to begin. Local simulators begin the first episodes of the seed, whatever its number.
#[derive(Debug, Deserialize)]
pub(crate) struct ResetRequest {
    pub seed: u64,
    pub episode: usize,
}

/// Where to write the recorded episode.
#[derive(Debug, Deserialize)]
pub(crate) struct KeepRequest {
    /// A folder that does not exist.
    pub folder: PathBuf,
}

/// The error for functions of the user in a domain without roads.
pub(crate) const NO_ROADS: &str =
    "observation, reward: this domain has no roads, and only its own observations and rewards";

/// Functions of Python that a config names. The Python process calls them.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct OwnNames {
    pub reward: Option<String>,
    pub observation: Option<String>,
}

/// A config with its domain and the names of its agents. The domain has its own rewards and observations, also where the
/// config names functions of Python.
pub(crate) struct Opened {
    pub own: OwnNames,
    pub config: RunConfig,
    pub domain: Arc<dyn Domain>,
    pub names: Vec<String>,
}

impl Opened {
    /// Opens the config of a request. Its files are not tried in another process first: this one may end with them.
    pub(crate) fn open(path: &Path, settings: &[String]) -> Result<Opened> {
        let file = if files::is_run_dir(path) { path.join(files::CONFIG) } else { path.to_owned() };
        ensure!(
            !file.is_dir(),
            "{}: neither a config nor a run directory; name a .toml, a .sumocfg or a directory that `train` made",
            path.display()
        );
        let mut config =
            dials_session::config::load(&file, settings).map_err(|error| refused(error, &file, settings))?;
        let (reward, observation) = domains::take_own(&mut config);
        let domain = open_untried(&config)?;
        let names = domain.names();
        Ok(Opened { own: OwnNames { reward, observation }, config, domain, names })
    }

    /// Returns the agent of a name.
    pub(crate) fn agent(&self, name: &str) -> Result<AgentId> {
        let found = self.names.iter().position(|other| other == name);
        let first = || self.names.iter().take(5).map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ");
        let more = if self.names.len() > 5 { ", ..." } else { "" };
        found.map(AgentId).with_context(|| format!("agent `{name}`: there is none; the agents are {}{more}", first()))
    }

    /// Returns the agents of these names, which must be of one kind.
    pub(crate) fn agents_of_one_kind(&self, names: &[String]) -> Result<Vec<AgentId>> {
        let agents = names.iter().map(|name| self.agent(name)).collect::<Result<Vec<_>>>()?;
        let Some(&first) = agents.first() else { bail!("agents: there is none") };
        let kinds = self.domain.kinds();
        let kind = kinds.place(first).kind;
        for (agent, name) in agents.iter().zip(names) {
            ensure!(
                kinds.place(*agent).kind == kind,
                "agent `{name}`: is of kind `{}` and `{}` of kind `{}`; make one environment per kind",
                kinds.of(*agent).name,
                names[0],
                kinds[kind].name
            );
        }
        ensure!(agents.is_sorted_by(|one, next| one < next), "agents: name each once, in the order of the config");
        Ok(agents)
    }
}

/// Returns an error of a config as a wrong argument if the settings are wrong: the config alone can be read.
fn refused(error: anyhow::Error, file: &Path, settings: &[String]) -> anyhow::Error {
    if settings.is_empty() || dials_session::config::load(file, &[]).is_err() {
        return error;
    }
    let text = format!("{error:#}");
    Refused(format!("settings: {}", text.strip_prefix("--set: ").unwrap_or(&text))).into()
}
