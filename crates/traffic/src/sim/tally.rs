//! What the GS counts in every episode, also in training.

use super::at_red::AtRed;
use crate::agents::phase_plan::Shown;
use crate::agents::plan::AgentPlan;
use crate::cars_at::RowLanes;
use crate::inflow::has_arrival;
use dials_core::domain::{Measures, Result};
use libsumo::{CarTable, Simulation};

/// Name of the measure "share of the steps beginning with green in which the light was switched".
pub(crate) const P_SWITCH: &str = "p_switch_given_green";

/// Name of the measure "longest time that somebody stood before a red light of an agent, in seconds", of scenarios only.
pub(crate) const WAIT_AT_RED: &str = "longest_wait_at_red_s";

/// Name of the measure "cars on the approaches of a light", of scenarios only.
pub(crate) const CARS_PER_LIGHT: &str = "cars_per_light";

#[derive(Clone, Debug, Default)]
pub(crate) struct Tally {
    /// Number of steps that began with green, and number of those in which it ended, per agent.
    greens: Vec<(u64, u64)>,
    /// One per agent, in scenarios.
    at_red: Vec<AtRed>,
    steps: u64,
    car_steps: u64,
    speed_sum_mps: f64,
    pub(crate) departed: u64,
    pub(crate) arrived: u64,
    backlog: u64,
    teleports: u64,
    collisions: u64,
    /// Deceleration above which braking is an emergency, if all cars have the same one.
    emergency_decel_mps2: Option<f64>,
    /// Number of brakings harder than that; if there is none, of stops that SUMO calls emergencies.
    emergencies: u64,
}

impl Tally {
    pub(crate) fn new(agents: usize, emergency_decel_mps2: Option<f64>) -> Self {
        let at_red = vec![AtRed::default(); if emergency_decel_mps2.is_none() { agents } else { 0 }];
        Tally { greens: vec![(0, 0); agents], at_red, emergency_decel_mps2, ..Tally::default() }
    }

    pub(crate) fn lights(&mut self, before: &[Shown], now: &[Shown]) {
        for ((greens, switches), (before, now)) in self.greens.iter_mut().zip(before.iter().zip(now)) {
            *greens += u64::from(before.is_green());
            *switches += u64::from(before.is_green() && now != before);
        }
    }

    pub(crate) fn waiting(&mut self, agents: &[AgentPlan], now: &[Shown], approaches: &RowLanes) {
        for (row, (at_red, (agent, &shown))) in self.at_red.iter_mut().zip(agents.iter().zip(now)).enumerate() {
            at_red.note(agent, shown, approaches.at(row));
        }
    }

    pub(crate) fn cars(&mut self, now: &CarTable, before: &CarTable) {
        self.car_steps += now.cars() as u64;
        now.iter().for_each(|lane| self.speed_sum_mps += lane.speeds_mps.iter().sum::<f64>());
        let Some(decel) = self.emergency_decel_mps2 else { return };
        for (now, before) in now.iter().zip(before.iter()) {
            // Cars neither overtake nor teleport. After the new one, if there is one, they stay in the same order.
            let new = usize::from(has_arrival(now, before));
            let speeds = now.speeds_mps[new..].iter().zip(before.speeds_mps);
            self.emergencies += speeds.filter(|(now, before)| *before - *now > decel + 1e-9).count() as u64;
        }
    }

    pub(crate) fn step(&mut self, simulation: &mut Simulation) -> Result<()> {
        let counts = simulation.counts()?;
        self.steps += 1;
        self.departed += u64::from(counts.departed);
        self.arrived += u64::from(counts.arrived);
        self.teleports += u64::from(counts.teleports);
        self.collisions += u64::from(counts.collisions);
        self.backlog = u64::from(counts.pending);
        if self.is_scenario() {
            self.emergencies += u64::from(counts.emergency_stops);
        }
        Ok(())
    }

    fn is_scenario(&self) -> bool {
        self.emergency_decel_mps2.is_none()
    }

    pub(crate) fn measures(&self) -> Measures {
        let emergencies = if self.is_scenario() { "emergency_stops" } else { "emergency_brakes" };
        let mut system = vec![
            ("mean_speed_mps", self.speed_sum_mps / self.car_steps.max(1) as f64),
            ("departed", self.departed as f64),
            ("arrived", self.arrived as f64),
            ("backlog", self.backlog as f64),
            ("teleports", self.teleports as f64),
            ("collisions", self.collisions as f64),
            (emergencies, self.emergencies as f64),
        ];
        if self.is_scenario() {
            let light_steps = self.greens.len() as u64 * self.steps;
            system.push((CARS_PER_LIGHT, self.car_steps as f64 / light_steps.max(1) as f64));
        }
        let shares = self.greens.iter().map(|&(greens, switches)| switches as f64 / greens.max(1) as f64);
        let mut per_agent = vec![(P_SWITCH.to_owned(), shares.collect())];
        if self.is_scenario() {
            let longest = self.at_red.iter().map(|at_red| f64::from(at_red.longest_s()));
            per_agent.push((WAIT_AT_RED.to_owned(), longest.collect()));
        }
        Measures { per_agent, system: system.into_iter().map(|(name, value)| (name.to_owned(), value)).collect() }
    }
}
