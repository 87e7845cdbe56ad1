//! What the global simulator (GS) counts in every episode, also in training.

use crate::domain::{Measures, Result};
use crate::sumo::{CarTable, Simulation};
use crate::traffic::agents::phase_plan::Shown;
use crate::traffic::arrivals::has_arrival;
use crate::traffic::paper_grid::DECEL_MPS2;

/// Name of the measure "share of the steps beginning with green in which the light was switched".
pub const P_SWITCH: &str = "p_switch_given_green";

/// Counts of an episode.
#[derive(Clone, Debug, Default)]
pub struct Tally {
    /// Number of steps that began with green, and number of those in which it ended, per agent.
    greens: Vec<(u64, u64)>,
    car_steps: u64,
    speed_sum_mps: f64,
    departed: u64,
    pub arrived: u64,
    backlog: u64,
    teleports: u64,
    collisions: u64,
    emergency_brakes: u64,
}

impl Tally {
    pub fn new(agents: usize) -> Self {
        Tally { greens: vec![(0, 0); agents], ..Tally::default() }
    }

    pub fn lights(&mut self, before: &[Shown], now: &[Shown]) {
        for ((greens, switches), (before, now)) in self.greens.iter_mut().zip(before.iter().zip(now)) {
            *greens += u64::from(before.is_green());
            *switches += u64::from(before.is_green() && now != before);
        }
    }

    pub fn cars(&mut self, now: &CarTable, before: &CarTable) {
        self.car_steps += now.cars() as u64;
        for (now, before) in now.iter().zip(before.iter()) {
            self.speed_sum_mps += now.speeds_mps.iter().sum::<f64>();
            // Cars neither overtake nor teleport. After the new one, if there is one, they stay in the same order.
            let new = usize::from(has_arrival(now, before));
            let braked = now.speeds_mps[new..]
                .iter()
                .zip(before.speeds_mps)
                .filter(|(now, before)| *before - *now > DECEL_MPS2 + 1e-9);
            self.emergency_brakes += braked.count() as u64;
        }
    }

    pub fn step(&mut self, simulation: &mut Simulation) -> Result<()> {
        let counts = simulation.counts()?;
        self.departed += u64::from(counts.departed);
        self.arrived += u64::from(counts.arrived);
        self.teleports += u64::from(counts.teleports);
        self.collisions += u64::from(counts.collisions);
        self.backlog = u64::from(counts.pending);
        Ok(())
    }

    pub fn measures(&self) -> Measures {
        let system = [
            ("mean_speed_mps", self.speed_sum_mps / self.car_steps.max(1) as f64),
            ("departed", self.departed as f64),
            ("arrived", self.arrived as f64),
            ("backlog", self.backlog as f64),
            ("teleports", self.teleports as f64),
            ("collisions", self.collisions as f64),
            ("emergency_brakes", self.emergency_brakes as f64),
        ];
        Measures {
            per_agent: vec![(P_SWITCH.to_owned(), self.greens.iter().map(share_switched).collect())],
            system: system.map(|(name, value)| (name.to_owned(), value)).to_vec(),
        }
    }
}

fn share_switched(&(greens, switches): &(u64, u64)) -> f64 {
    switches as f64 / greens.max(1) as f64
}
