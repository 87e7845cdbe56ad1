//! The warehouse domain: robots that fetch items from shelves that they share with their neighbours.
//!
//! It is native and needs no SUMO, so it runs anywhere in seconds. Its agents are more strongly coupled than in
//! traffic. Source: DIALS paper, section "Environments", with the rules of the authors' code where the paper gives
//! none.
//!
//! [`global`] is the GS (global simulator), the whole warehouse; [`local`] is the LS (local simulator), single regions.

pub mod config;
pub mod global;
pub(crate) mod hand_coded;
pub(crate) mod items;
pub mod layout;
pub mod local;
pub mod region;
mod scene;

use anyhow::bail;

use config::WarehouseConfig;
use dials_core::base::{AgentId, Seed};
use dials_core::domain::{
    Baseline, BuiltInControl, Domain, FirstRow, GlobalSimulator, Kind, Kinds, LocalSimulator, Map, Measures, Result,
    RoughCosts, Rules, Scenario, Task,
};
use global::{GlobalWarehouse, ITEMS};
use hand_coded::Rule;
use layout::FloorPlan;
use local::LocalWarehouse;

/// Number of collected items per episode below which a robot is stuck. Random moves collect about two, policies more
/// than ten.
const STUCK_BELOW: f64 = 0.5;

/// Version of the environment. Counts up when the same actions give other observations, rewards or items.
const ENVIRONMENT: u32 = 1;

pub struct Warehouse {
    layout: FloorPlan,
    horizon: usize,
    kinds: Kinds,
}

impl Warehouse {
    pub fn new(config: &WarehouseConfig) -> Self {
        let layout = FloorPlan::around(config.agents_per_side);
        let kinds = Kinds::one(layout.learners().len(), region::spec(config.horizon));
        Warehouse { layout, horizon: config.horizon, kinds }
    }
}

impl Domain for Warehouse {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn agent_name(&self, agent: AgentId) -> String {
        let side = self.agents().isqrt();
        format!("r{}c{}", agent.0 / side, agent.0 % side)
    }

    fn task(&self, _agent: AgentId) -> Task {
        region::task()
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        Ok(Box::new(GlobalWarehouse::new(&self.layout, self.horizon, None)))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        Ok(Box::new(LocalWarehouse::new(&self.layout, regions, copies, self.horizon, seed)))
    }

    fn baselines(&self) -> &'static [&'static str] {
        Rule::NAMES
    }

    fn baseline(&self, name: &str) -> Result<Baseline> {
        let Some(rule) = Rule::by_name(name) else {
            bail!("controller `{name}`: unknown; one of {}", Rule::NAMES.join(", "));
        };
        // The rules use ages, which no observation shows, so they run inside the simulator.
        let simulator = Box::new(GlobalWarehouse::new(&self.layout, self.horizon, Some(rule)));
        Ok(Baseline { simulator, controller: Box::new(BuiltInControl) })
    }

    fn scenario(&self) -> Result<Scenario> {
        let side = self.agents().isqrt();
        let map = Map { rows: side, columns: side, first_row: FirstRow::Top };
        let observation = "cell and items".to_owned();
        let rules = Rules { environment: ENVIRONMENT, reward: region::task().reward, observation };
        Ok(Scenario::new("warehouse", self.agents(), self.horizon).with_map(map).with_rules(rules, None))
    }

    fn rival(&self) -> Option<&'static str> {
        Some("oldest-item")
    }

    /// Measured with warehouse_4.toml and warehouse_100.toml.
    fn rough_costs(&self) -> RoughCosts {
        RoughCosts {
            training_s: 60e-6,
            training_on_gs_s: 60e-6,
            influence_s: 3e-6,
            evaluation_s: 8e-6,
            process_mb: 110.0,
            agent_mb: 8.0,
        }
    }

    fn stuck(&self, kind: &Kind, measures: &Measures) -> Vec<bool> {
        let (_, items) =
            measures.per_agent.iter().find(|(name, _)| name == ITEMS).expect("the warehouse GS counts them");
        kind.agents.iter().map(|agent| items[agent.0] < STUCK_BELOW).collect()
    }
}
