//! Rewards and observations that are functions of the user in another process.

use std::sync::{Arc, OnceLock};

use anyhow::{Context, ensure};

use crate::Traffic;
use crate::config::python::Functions;
use dials_core::base::AgentId;
use dials_core::domain::own::{OwnFunctions, OwnGlobal, OwnLocal, OwnRows, OwnSource};
use dials_core::domain::roads::RoadTables;
use dials_core::domain::{Domain, GlobalSimulator, Kinds, LocalSimulator, Result, Task};

/// The functions of a config. By default there are none.
#[derive(Clone, Default)]
pub(crate) struct Own {
    functions: OwnFunctions,
    /// Name of an observation whose width is not known.
    unknown: Option<String>,
    /// The kinds with the width of the own observation.
    kinds: Option<Arc<Kinds>>,
    source: Option<Arc<dyn OwnSource>>,
    /// The roads, once a simulator has been opened: local simulators are opened in every period.
    tables: Arc<OnceLock<RoadTables>>,
}

impl Own {
    pub(crate) fn of(names: &Functions<'_>, kinds: &Kinds) -> Result<Own> {
        let functions = names.known()?;
        let own_kinds = functions.observation.as_ref().map(|(_, width)| Arc::new(kinds.clone().with_obs_dim(*width)));
        let unknown = names.observation.filter(|_| functions.observation.is_none()).map(str::to_owned);
        Ok(Own { functions, unknown, kinds: own_kinds, ..Own::default() })
    }

    pub(crate) fn is_some(&self) -> bool {
        self.functions != OwnFunctions::default() || self.unknown.is_some()
    }

    pub(crate) fn kinds(&self) -> Option<&Kinds> {
        self.kinds.as_deref()
    }

    /// Returns the name of the reward, if it is a function.
    pub(crate) fn reward(&self) -> Option<&str> {
        self.functions.reward.as_deref()
    }

    pub(crate) fn describe(&self, task: &mut Task) {
        if let Some(name) = &self.functions.reward {
            task.reward = in_words(name);
        }
        if let Some((name, width)) = &self.functions.observation {
            task.observation = (0..*width).map(|column| format!("{name}[{column}]")).collect();
        }
    }

    pub(crate) fn describe_rules(&self, rules: &mut dials_core::domain::Rules) {
        if let Some(name) = &self.functions.reward {
            rules.reward = in_words(name);
        }
        if let Some((name, width)) = &self.functions.observation {
            rules.observation = format!("function `{name}` of Python, {width} columns");
        }
    }
}

fn in_words(name: &str) -> String {
    format!("function `{name}` of Python")
}

impl Traffic {
    /// Lets functions that the config names be computed there. Without them it changes nothing.
    pub fn computed_by(mut self, source: Arc<dyn OwnSource>) -> Traffic {
        self.own.source = Some(source);
        self
    }

    /// Returns the number of columns of an observation of this name.
    pub fn width_of(&self, observation: &str, source: &dyn OwnSource) -> Result<usize> {
        source.width(&self.road_tables()?.context("traffic has roads")?, observation)
    }

    fn open_own(&self, rows: &[AgentId]) -> Result<Box<dyn OwnRows>> {
        let Own { functions, unknown, source, .. } = &self.own;
        let name = [functions.reward.as_ref(), functions.observation.as_ref().map(|(name, _)| name), unknown.as_ref()];
        let name = name.into_iter().flatten().next().map_or("", String::as_str);
        let source = source.as_ref().with_context(|| {
            format!(
                "`{name}` is a function of Python, and this program was not started from Python: call register_reward or \
                 register_observation with it, and then dials_traffic.train, or another function of the package"
            )
        })?;
        ensure!(unknown.is_none(), "`{name}`: the number of columns of this observation of Python is not known");
        let tables = match self.own.tables.get() {
            Some(known) => known,
            None => {
                let found = self.road_tables()?.context("traffic has roads")?;
                self.own.tables.get_or_init(|| found)
            }
        };
        source.open(tables, rows, functions)
    }

    pub(crate) fn with_own_rows(&self, simulator: Box<dyn GlobalSimulator>) -> Result<Box<dyn GlobalSimulator>> {
        if !self.own.is_some() {
            return Ok(simulator);
        }
        let rows = self.open_own(&AgentId::all(self.agents()))?;
        let sees = self.own.functions.observation.is_some();
        Ok(Box::new(OwnGlobal::new(simulator, rows, Arc::new(self.kinds().clone()), sees)?))
    }

    pub(crate) fn with_own_local(
        &self,
        simulator: Box<dyn LocalSimulator>,
        rows: &[AgentId],
    ) -> Result<Box<dyn LocalSimulator>> {
        if !self.own.is_some() {
            return Ok(simulator);
        }
        let width = self.own.functions.observation.as_ref().map(|(_, width)| *width);
        Ok(Box::new(OwnLocal::new(simulator, self.open_own(rows)?, width)?))
    }
}
