//! What a light sees, does and is paid for, in words.

use super::agents::phase_plan::Choice;
use super::agents::plan::{AgentPlan, Border, JointPlan};
use super::agents::region;
use super::agents::sensor::{CarColumns, LightColumns, Sensor};
use crate::config::{DSet, Reward, RewardTerm};
use dials_core::base::AgentId;
use dials_core::domain::{Rules, Task};

pub(crate) fn task(plan: &JointPlan, agent: AgentId) -> Task {
    let of_agent = &plan.agents[agent.0];
    let (sources, d_set) = match plan.borders.get(agent.0) {
        Some(Border { plan, d_set }) => (plan.source_names(), d_set.columns(plan)),
        None => of_grid(of_agent),
    };
    Task { observation: of_agent.columns(), actions: actions(of_agent), reward: reward(&plan.reward), sources, d_set }
}

/// Version of the environment. Counts up when the same actions give other observations, rewards or traffic.
const ENVIRONMENT: u32 = 1;

pub(crate) fn rules(plan: &JointPlan) -> Rules {
    let sensor = &plan.agents[0].sensor;
    let cars = match &sensor.cars {
        CarColumns::Cells(_) => "cells",
        CarColumns::QueueAndDensity(_) => "queues",
        CarColumns::Detectors(_) => "detectors",
        CarColumns::Sets(_) => "lanes and greens as sets",
    };
    let others = if sensor.sees_others { ", buses and persons" } else { "" };
    let light = match sensor.light {
        LightColumns::FourStates => "light of two directions",
        LightColumns::TargetAndAge(_) => "green and its age",
        LightColumns::WithLanes => "",
    };
    let are_apart = plan.agents.iter().any(|agent| agent.sensor.clock_ahead > 0);
    let apart = if are_apart { ", neighbours half a cycle apart" } else { "" };
    let clock = if sensor.clock > 0 { format!(", clock of {} steps{apart}", sensor.clock) } else { String::new() };
    Rules {
        environment: ENVIRONMENT,
        reward: reward(&plan.reward),
        observation: [cars, light].into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join(", ")
            + &clock
            + others,
    }
}

fn actions(plan: &AgentPlan) -> Vec<String> {
    match plan.phases.choice() {
        Choice::KeepOrSwitch | Choice::InOrder => ["keep", "switch to the next green"].map(str::to_owned).to_vec(),
        Choice::Target => plan.phases.greens().iter().map(|green| format!("go to green {green}, or keep it")).collect(),
    }
}

/// Returns the names of the influence sources and of the columns of the d-set of an agent of a grid.
fn of_grid(plan: &AgentPlan) -> (Vec<String>, Vec<String>) {
    let lanes = plan.region.approaches.iter().map(|approach| &approach.lane);
    let arrivals: Vec<String> = lanes.map(|lane| format!("arrival {lane}")).collect();
    let cells = Sensor { cars: CarColumns::Cells(vec![region::CELLS; region::EDGES]), ..plan.sensor.clone() };
    let mut d_set = cells.columns(&plan.region, &plan.others)[..region::OCCUPANCY].to_vec();
    match plan.sensor.d_set {
        DSet::Cells => {}
        DSet::CellsAndArrivals => d_set.extend(arrivals.iter().map(|name| format!("{name}, last step"))),
        DSet::CellsAndLight => d_set.extend(plan.sensor.light.names()),
    }
    d_set.extend_from_slice(&plan.columns()[plan.sensor.clock_columns()]);
    (arrivals, d_set)
}

fn reward(reward: &Reward) -> String {
    let term = |(term, weight): (RewardTerm, f64)| match weight {
        1.0 => term.words().to_owned(),
        weight => format!("{weight} x ({})", term.words()),
    };
    reward.terms().map(term).collect::<Vec<_>>().join(" + ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrafficConfig;
    use crate::paper_grid::grid::Grid;
    use crate::paper_grid::plans::joint_plan;

    #[test]
    fn a_light_of_a_grid_has_a_name_for_everything_that_it_has() {
        for (d_set, beside_cells) in [
            (DSet::Cells, "clock[0]"),
            (DSet::CellsAndArrivals, "arrival r1c0_r1c1_0, last step"),
            (DSet::CellsAndLight, "horizontal green"),
        ] {
            let config = TrafficConfig { clock: Some(26), d_set, ..TrafficConfig::new("", "") };
            let plan = joint_plan(Grid::new(2, 2).unwrap(), &config);
            let spec = &plan.kinds.iter().next().unwrap().spec;
            let task = task(&plan, AgentId(3));
            let counts = [task.observation.len(), task.actions.len(), task.sources.len(), task.d_set.len()];
            assert_eq!(counts, [spec.obs_dim, spec.n_actions, spec.sources.count(), spec.d_set_dim]);
            assert_eq!([&task.sources[0], &task.observation[0]], ["arrival r1c0_r1c1_0", "r1c0_r1c1_0[0]"]);
            assert_eq!(task.d_set[36], beside_cells);
            assert_eq!(task.reward, "mean speed of the cars on the approaches, as a share of the limit");
        }
    }
}
