//! The plans of a grid's agents: four approaches of one lane, four exits, and a light with two greens.

use std::sync::Arc;

use super::grid::{Grid, Node, lane};
use crate::agents::loops::Loop;
use crate::agents::others_plan::OthersPlan;
use crate::agents::phase_plan::{Choice, Interval, PhasePlan};
use crate::agents::phases::Light;
use crate::agents::plan::{AgentPlan, JointPlan};
use crate::agents::region::{self, CELLS, EDGE_M, EDGES, SPEED_LIMIT_MPS};
use crate::agents::region_plan::{Approach, Exit, Link, RegionPlan};
use crate::agents::sensor::{CarColumns, LightColumns, Sensor};
use crate::config::{ClockOffsets, Observation, SeenCars, TrafficConfig, UntilFirstSwitch};
use crate::light::YELLOW_STEPS;
use crate::paper_grid::content::{DECEL_MPS2, place};
use crate::side::Side;
use dials_core::base::AgentId;
use dials_core::domain::Kinds;

/// Greens of every light, in the order of their indices. An episode begins with the first one.
const GREENS: [Light; 2] = [Light::VerticalGreen, Light::HorizontalGreen];

/// Greens of the program that netconvert gives a light of a grid: a cycle of 90 s, 3 s of yellow each time.
const PROGRAM_GREEN_STEPS: u32 = 42;

pub(crate) fn joint_plan(grid: Grid, config: &TrafficConfig) -> JointPlan {
    let kinds = Kinds::one(grid.agents().len(), region::spec(config));
    JointPlan {
        agents: plans(grid, config),
        borders: Vec::new(),
        kinds,
        decision_steps: 1,
        reward: config.reward.clone(),
        faults: config.detector_faults,
        seen_cars: SeenCars::default(),
        emergency_decel_mps2: Some(DECEL_MPS2),
    }
}

pub fn plans(grid: Grid, config: &TrafficConfig) -> Vec<AgentPlan> {
    let phases = Arc::new(phases(config.until_first_switch));
    let plan = |agent| {
        let (x, y) = place(grid, grid.intersection(agent));
        AgentPlan {
            light: grid.light(agent),
            place_m: [x, y],
            region: around(grid, agent),
            others: OthersPlan::default(),
            phases: phases.clone(),
            sensor: sensor(grid, agent, config),
        }
    };
    grid.agents().into_iter().map(plan).collect()
}

fn phases(until_first_switch: UntilFirstSwitch) -> PhasePlan {
    let greens = GREENS.map(Light::state).to_vec();
    let yellow = |from: usize, _| vec![Interval { state: GREENS[from].next().state(), steps: YELLOW_STEPS.into() }];
    let mut plan = PhasePlan::new(greens, Choice::KeepOrSwitch, 1, yellow);
    plan.own_green_steps = (until_first_switch == UntilFirstSwitch::Program).then_some(PROGRAM_GREEN_STEPS);
    plan
}

fn sensor(grid: Grid, agent: AgentId, config: &TrafficConfig) -> Sensor {
    let cars = match config.observation {
        Observation::Cells | Observation::CellsAndBuses => CarColumns::Cells(vec![CELLS; EDGES]),
        Observation::Queues => CarColumns::QueueAndDensity(EDGES),
        Observation::Detectors => CarColumns::Detectors(Loop::of(&around(grid, agent).approaches)),
        Observation::Lanes => unreachable!("a grid's config is checked for it"),
    };
    let clock = config.clock.unwrap_or(0);
    let (row, col) = grid.place(agent);
    let is_behind = config.clock_offsets == ClockOffsets::Checkerboard && (row + col) % 2 == 1;
    Sensor {
        cars,
        light: LightColumns::FourStates,
        clock,
        // Half a cycle behind, as `coordinated` lights are.
        clock_ahead: if is_behind { clock - clock / 2 } else { 0 },
        sees_others: false,
        d_set: config.d_set,
    }
}

/// Returns the lanes of one intersection. Approaches and links are in the order of [`Side::ALL`].
fn around(grid: Grid, agent: AgentId) -> RegionPlan {
    let (incoming, outgoing) = (grid.incoming_edges(agent), grid.outgoing_edges(agent));
    let approach = |from: &Side| Approach {
        lane: lane(&incoming[from.index()]),
        length_m: EDGE_M,
        speed_limit_mps: SPEED_LIMIT_MPS,
        ahead_m: 0.0,
        links: vec![from.index()],
    };
    let exit = |to: &Side| Exit {
        lane: lane(&outgoing[to.index()]),
        length_m: EDGE_M,
        speed_limit_mps: SPEED_LIMIT_MPS,
        leaves_the_net: matches!(grid.neighbour(agent, *to), Node::Boundary { .. }),
    };
    let link = |from: &Side| Link {
        letter: from.link_index(),
        from: from.index(),
        to: from.opposite().index(),
        inside: Vec::new(),
        crosses: Vec::new(),
    };
    RegionPlan {
        approaches: Side::ALL.iter().map(approach).collect(),
        exits: Side::ALL.iter().map(exit).collect(),
        links: Side::ALL.iter().map(link).collect(),
    }
}
