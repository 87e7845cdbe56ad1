//! A config as TOML or JSON: every domain has a table of its own there, and a run has one of them.

use serde::{Deserialize, Serialize};

use super::traffic_table::TrafficTable;
use super::{
    AipConfig, CheckpointsConfig, Config, DomainConfig, EvaluationConfig, GsConfig, ImitationConfig,
    LocalSimulatorsConfig, LoggingConfig, NumericsConfig, PolicyConfig, PpoConfig, Simulator, WarehouseConfig, seed,
};

/// Keys of a config, in the order in which they are written. [`Config`] explains them.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Written {
    #[serde(with = "seed")]
    seed: u64,
    simulator: Simulator,
    total_steps: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    stop_at_steps: Option<u64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    traffic: Option<TrafficTable>,
    #[serde(skip_serializing_if = "Option::is_none")]
    warehouse: Option<WarehouseConfig>,
    local_simulators: LocalSimulatorsConfig,
    gs: GsConfig,
    policy: PolicyConfig,
    imitation: ImitationConfig,
    ppo: PpoConfig,
    aip: AipConfig,
    evaluation: EvaluationConfig,
    checkpoints: CheckpointsConfig,
    logging: LoggingConfig,
    numerics: NumericsConfig,
}

impl Default for Written {
    fn default() -> Self {
        Config::default().into()
    }
}

impl From<Config> for Written {
    fn from(config: Config) -> Self {
        let (traffic, warehouse) = match config.domain {
            None => (None, None),
            Some(DomainConfig::Traffic(table)) => (Some(TrafficTable::Grid(table)), None),
            Some(DomainConfig::Scenario(table)) => (Some(TrafficTable::Scenario(table)), None),
            Some(DomainConfig::Warehouse(table)) => (None, Some(table)),
        };
        Written {
            seed: config.seed,
            simulator: config.simulator,
            total_steps: config.total_steps,
            stop_at_steps: config.stop_at_steps,
            traffic,
            warehouse,
            local_simulators: config.local_simulators,
            gs: config.gs,
            policy: config.policy,
            imitation: config.imitation,
            ppo: config.ppo,
            aip: config.aip,
            evaluation: config.evaluation,
            checkpoints: config.checkpoints,
            logging: config.logging,
            numerics: config.numerics,
        }
    }
}

impl TryFrom<Written> for Config {
    type Error = String;

    fn try_from(written: Written) -> Result<Self, String> {
        let traffic = written.traffic.map(|table| match table {
            TrafficTable::Grid(table) => DomainConfig::Traffic(table),
            TrafficTable::Scenario(table) => DomainConfig::Scenario(table),
        });
        let warehouse = written.warehouse.map(DomainConfig::Warehouse);
        Ok(Config {
            seed: written.seed,
            simulator: written.simulator,
            total_steps: written.total_steps,
            stop_at_steps: written.stop_at_steps,
            domain: only([traffic, warehouse].into_iter().flatten())?,
            local_simulators: written.local_simulators,
            gs: written.gs,
            policy: written.policy,
            imitation: written.imitation,
            ppo: written.ppo,
            aip: written.aip,
            evaluation: written.evaluation,
            checkpoints: written.checkpoints,
            logging: written.logging,
            numerics: written.numerics,
        })
    }
}

fn only(domains: impl Iterator<Item = DomainConfig>) -> Result<Option<DomainConfig>, String> {
    let mut domains: Vec<DomainConfig> = domains.collect();
    if domains.len() > 1 {
        let tables: Vec<String> = domains.iter().map(|domain| format!("[{}]", domain.name())).collect();
        return Err(format!("{}: a run has one domain; remove one of these tables", tables.join(" and ")));
    }
    Ok(domains.pop())
}
