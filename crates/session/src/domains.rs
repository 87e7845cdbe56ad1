//! The domains. Only this file knows all of them: a new one needs its crate and a line in [`DomainConfig`].

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};

use super::python::{Link, PythonFunctions, described};
use super::trial;
use crate::config::RunConfig;
use crate::records::files;
use crate::records::run_json::PythonFunction;
use crate::terminal::{note, warn};
use schemars::{Schema, SchemaGenerator};
use serde::Serialize;
use serde::de::MapAccess;

use dials_core::base::for_terminal;
use dials_core::domain::{Domain, DomainTable, Kind};
use dials_learn::config::Simulator;
use dials_learn::policy::PolicyStack;
use dials_traffic::Traffic;
use dials_traffic::config::TrafficTable;
use dials_traffic::config::python::{joined, split};
use dials_traffic::events::EventLog;
use dials_traffic::sim::recording::Tape;
use dials_warehouse::config::WarehouseConfig;
use stacknets::use_vectors;

macro_rules! domains {
    ($($name:literal: $variant:ident($table:ty),)*) => {
        #[derive(Clone, Debug, PartialEq, Serialize)]
        #[expect(clippy::large_enum_variant, reason = "a run has one of it")]
        pub enum DomainConfig {
            $(#[serde(rename = $name)] $variant($table),)*
        }

        impl DomainConfig {
            /// Names of all domains, which are the names of their tables.
            pub(crate) const NAMES: &[&str] = &[$($name),*];

            /// Returns the name of the table in a config, which is the domain's name.
            pub(crate) fn name(&self) -> &'static str {
                match self {
                    $(DomainConfig::$variant(_) => $name,)*
                }
            }

            pub(crate) fn table(&self) -> &dyn DomainTable {
                match self {
                    $(DomainConfig::$variant(table) => table,)*
                }
            }

            pub fn table_mut(&mut self) -> &mut dyn DomainTable {
                match self {
                    $(DomainConfig::$variant(table) => table,)*
                }
            }

            /// Returns the schema of each table, in the order of the names.
            pub(crate) fn schemas(generator: &mut SchemaGenerator) -> Vec<Schema> {
                vec![$(generator.subschema_for::<$table>()),*]
            }

            pub(crate) fn read<'de, M: MapAccess<'de>>(name: &str, map: &mut M) -> Result<DomainConfig, M::Error> {
                match name {
                    $($name => map.next_value().map(DomainConfig::$variant),)*
                    _ => unreachable!("`{name}` is no domain"),
                }
            }
        }
    };
}

domains! {
    "traffic": Traffic(TrafficTable),
    "warehouse": Warehouse(WarehouseConfig),
}

/// Key of the file from whose policy new ones start, in the table of traffic.
pub(crate) const STARTING_FILE: &str = "any_light";

impl DomainConfig {
    /// Returns a key of this table with the table's name before it, as `--set` takes it.
    pub(crate) fn key(&self, key: &str) -> String {
        format!("{}.{key}", self.name())
    }

    /// Returns the path of a key of this table, if it names a file.
    pub(crate) fn file(&self, key: &str) -> Option<PathBuf> {
        self.clone().table_mut().paths().into_iter().find(|(known, _)| *known == key).map(|(_, path)| path.clone())
    }
}

/// Error if a machine cannot compute as a config says. Only the fixed width can be missing.
pub(crate) const NO_SUCH_VECTORS: &str =
    "numerics.vector_width = \"256-bit\": this machine has no such vector instructions; \"widest\" works everywhere";

/// Opens the domain of a config and reads the files that it needs. Another process tries the files first.
/// Also sets the vector width of networks. So every process must call this before it computes with networks.
pub fn open(config: &RunConfig) -> Result<Arc<dyn Domain>> {
    let domain = open_untried(config)?;
    trial::survive(config, &*domain)?;
    Ok(domain)
}

/// Like [`open`], but tries nothing: before [`check`], after a trial elsewhere, or in a process that may end with it.
pub fn open_untried(config: &RunConfig) -> Result<Arc<dyn Domain>> {
    set_vectors(config)?;
    find(config)
}

/// Like [`open_untried`], if the config names traffic; `None` if it names another domain.
pub fn open_traffic_untried(config: &RunConfig) -> Result<Option<Traffic>> {
    set_vectors(config)?;
    traffic(config)
}

fn set_vectors(config: &RunConfig) -> Result<()> {
    use_vectors(config.numerics.vector_width).context(NO_SUCH_VECTORS)
}

/// Opens the domain of a config only to ask it something. Leaves the vector width as it is.
pub fn find(config: &RunConfig) -> Result<Arc<dyn Domain>> {
    match traffic(config)? {
        Some(traffic) => Ok(Arc::new(traffic)),
        None => domain(config).table().open(),
    }
}

fn domain(config: &RunConfig) -> &DomainConfig {
    config.domain.as_ref().expect("a config that was loaded has a domain")
}

/// Loads SUMO if the domain of a config needs it. If not: `None`.
pub fn sumo(config: &RunConfig) -> Result<Option<&'static dials_traffic::Sumo>> {
    match domain(config) {
        DomainConfig::Traffic(_) => Ok(Some(dials_traffic::sumo()?)),
        _ => Ok(None),
    }
}

/// Returns whether a config names a scenario of SUMO.
pub fn is_scenario(config: &RunConfig) -> bool {
    matches!(domain(config), DomainConfig::Traffic(TrafficTable::Scenario(_)))
}

/// Like [`find`], if the config names traffic; `None` if it names another domain.
pub fn traffic(config: &RunConfig) -> Result<Option<Traffic>> {
    let traffic = match domain(config) {
        DomainConfig::Traffic(TrafficTable::Grid(table)) => Traffic::open(table)?,
        DomainConfig::Traffic(TrafficTable::Scenario(table)) => Traffic::open_scenario(table)?,
        _ => return Ok(None),
    };
    Ok(Some(if Link::is_there() { traffic.computed_by(Arc::new(PythonFunctions)) } else { traffic }))
}

/// Asks the Python process that started this one how many columns an own observation has, if a config names one and that
/// is not known yet. The config then knows it, also without that process.
pub(crate) fn learn_width(config: &mut RunConfig) -> Result<()> {
    let Some(DomainConfig::Traffic(table)) = &mut config.domain else { return Ok(()) };
    let Some(observation) = table.functions_mut()[1].clone() else { return Ok(()) };
    if split(&observation)?.1.is_some() || !Link::is_there() {
        return Ok(());
    }
    let traffic = traffic(config)?.context("its table is that of traffic")?;
    let width = traffic.width_of(&observation, &PythonFunctions)?;
    if let Some(DomainConfig::Traffic(table)) = &mut config.domain {
        *table.functions_mut()[1] = Some(joined(&observation, width));
    }
    Ok(())
}

/// Takes the names of functions of Python out of a config, the reward and the observation: for a process in which Python
/// itself calls them. The config then has its built-in reward and observation.
pub fn take_own(config: &mut RunConfig) -> (Option<String>, Option<String>) {
    let Some(DomainConfig::Traffic(table)) = &mut config.domain else { return (None, None) };
    let [reward, observation] = table.functions_mut().map(Option::take);
    // The name without the number of columns.
    let name = |text: String| split(&text).map_or_else(|_| text.clone(), |(name, _)| name.to_owned());
    (reward, observation.map(name))
}

/// Returns the functions of Python that a config names, its learner and its predictor, as that process describes them.
pub(crate) fn python_functions(config: &RunConfig) -> Result<Vec<PythonFunction>> {
    let (reward, observation) = take_own(&mut config.clone());
    let outside = [("learner", config.learning.learns_outside()), ("predictor", config.learning.predicts_outside())];
    let objects: Vec<&str> = outside.into_iter().filter_map(|(name, is_there)| is_there.then_some(name)).collect();
    if reward.is_none() && observation.is_none() && objects.is_empty() {
        return Ok(Vec::new());
    }
    described(reward.as_deref(), observation.as_deref(), &objects)
}

/// Returns the config of a scenario with more or fewer vehicles, and with further edges closed: `traffic.demand` and
/// `traffic.closed`. `demand` multiplies that of the config.
pub fn changed_traffic(config: &RunConfig, demand: f64, closed: &[String]) -> Result<RunConfig> {
    let mut changed = config.clone();
    let Some(DomainConfig::Traffic(TrafficTable::Scenario(table))) = &mut changed.domain else {
        bail!(
            "--demand, --closed: are for scenarios of SUMO (a .sumocfg); for a grid of the paper make a net with another inflow: \
             dials-traffic nets grid --inflow"
        )
    };
    table.demand *= demand;
    for edge in closed {
        if !table.closed.contains(edge) {
            table.closed.push(edge.clone());
        }
    }
    table.check()?;
    Ok(changed)
}

/// Opens changed traffic, after a trial. Controllers that measure flows measure those of the unchanged config, which is `usual`.
pub fn open_changed(changed: &RunConfig, usual: &Traffic) -> Result<Traffic> {
    let opened = traffic(changed)?.context("only traffic has demand and edges")?;
    trial::survive(changed, &opened)?;
    Ok(opened.planned_for(usual.clone()))
}

/// Like [`traffic`], with cars that all dawdle as much as `sigma` says. Only the cars of a scenario may.
pub fn dawdling(config: &RunConfig, sigma: f64) -> Result<Option<Traffic>> {
    match domain(config) {
        DomainConfig::Traffic(TrafficTable::Scenario(table)) => Traffic::open_dawdling(table, sigma).map(Some),
        DomainConfig::Traffic(TrafficTable::Grid(_)) if sigma != 0.0 => {
            bail!("--sigma {sigma}: the cars of the paper's grids never dawdle; leave the option out")
        }
        _ => traffic(config),
    }
}

/// Opens the traffic domain of a config. What its global simulators play and measure goes into `log`.
pub fn open_logged(config: &RunConfig, log: &EventLog) -> Result<Traffic> {
    let Some(traffic) = traffic(config)? else {
        bail!("only traffic lights write such a log, and this is {}; leave the option out", domain(config).name())
    };
    trial::survive(config, &traffic)?;
    Ok(traffic.log_events(log))
}

/// Opens the traffic domain of a config, as [`open`] does. The first episode that its simulators play is recorded on `tape`.
pub fn open_recorded(config: &RunConfig, tape: &Tape) -> Result<Traffic> {
    let Some(traffic) = open_traffic_untried(config)? else {
        let name = domain(config).name();
        bail!("only traffic can be recorded, and this is {name}; draw its episodes with `evaluate --render DIR`")
    };
    trial::survive(config, &traffic)?;
    Ok(traffic.record_on(tape))
}

/// Tries the files of a config's domain in its simulator, so that errors in them are reported before a run begins. Checks also
/// the controller to imitate and the policy to start from, if the config names them. `domain`: that of `config`. A process of its
/// own opens `config` anew for the trial, so nothing that only `domain` knows is tried.
pub fn check(config: &RunConfig, domain: &dyn Domain) -> Result<()> {
    if let Some(name) = &config.learning.policy.imitate {
        domain.check_baseline(name).context("policy.imitate: not a controller of this domain")?;
    }
    check_start(config, domain)?;
    trial::survive(config, domain)
}

/// Checks that the policies can start from the one that the config names, if it names one.
fn check_start(config: &RunConfig, domain: &dyn Domain) -> Result<()> {
    let policy = &config.learning.policy;
    let Some(name) = &policy.start else {
        let file = config.domain.as_ref().and_then(|domain| domain.file(STARTING_FILE));
        ensure!(file.is_none(), "traffic.any_light: set policy.start = \"any-light\", too, or leave the file out");
        return Ok(());
    };
    let start = domain.starting_policy(name).context("policy.start")?;
    let fits = |kind: &Kind| {
        let width = PolicyStack::shape(&kind.spec, policy).layout().width();
        kind.spec.sets.is_some() && policy.hidden == start.hidden && width == start.parameters.width()
    };
    ensure!(
        domain.kinds().iter().all(fits),
        "policy.start = \"{name}\": that is another network; set traffic.observation = \"lanes\", policy.separate_critic = \
         false and policy.hidden = {:?}, or leave these keys to the defaults of a scenario",
        start.hidden
    );
    Ok(())
}

/// Tries what training needs: the files, like [`check`], and the local simulators of `domain`, in this process, if the policies
/// train on them.
pub fn check_for_training(config: &RunConfig, domain: &dyn Domain) -> Result<()> {
    check(config, domain)?;
    if config.learning.simulator != Simulator::Global {
        domain.try_local()?;
    }
    Ok(())
}

/// Copies the domain's files into the run directory `dir` and returns a config with the paths of the copies.
pub(crate) fn keep_files(config: &RunConfig, domain: &dyn Domain, dir: &Path) -> Result<RunConfig> {
    let places = domain.keep_files(&dir.join(files::NETWORKS))?;
    let mut kept = config.clone();
    let paths = kept.domain.iter_mut().flat_map(|domain| domain.table_mut().paths());
    paths.zip(places).for_each(|((_, path), place)| *path = Path::new(files::NETWORKS).join(place));
    Ok(kept)
}

/// Says what is odd about the domain's files, and what of them is not simulated.
pub fn note_left_out(domain: &dyn Domain) {
    domain.warnings().iter().for_each(|what| warn(for_terminal(&format!("warning: {what}"))));
    domain.left_out().iter().for_each(|what| note(for_terminal(&format!("note: {what}"))));
}

/// Says what of the domain's files only the global simulator has.
pub fn note_without_locally(domain: &dyn Domain) {
    domain.without_locally().iter().for_each(|what| note(for_terminal(&format!("note: local simulators: {what}"))));
}
