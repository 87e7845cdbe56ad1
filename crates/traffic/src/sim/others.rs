//! Buses and trams at the lights of a simulator, for agents that see them or are rewarded for them.

use std::collections::HashMap;

use crate::agents::others_plan::PUBLIC;
use crate::agents::plan::{AgentPlan, JointPlan};
use crate::cars_at::{CarsAt, RowLanes};
use crate::reward::needs_others;
use dials_core::domain::Result;
use libsumo::{CarId, Simulation};

/// Who else is at a light now.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct OthersNow {
    /// Number of buses on each approach, and of trams on each track.
    pub(crate) buses: Vec<u32>,
    pub(crate) trams: Vec<u32>,
    /// Seconds that all of them lose in a second against their limits.
    pub(crate) lost: f64,
}

impl OthersNow {
    fn clear(&mut self) {
        self.buses.fill(0);
        self.trams.fill(0);
        self.lost = 0.0;
    }
}

/// Reads them. In a local simulator there are buses only.
pub(crate) struct Others {
    /// Buses, with the row in which they entered.
    buses: HashMap<CarId, usize>,
    /// Only the whole net has them.
    tracks: Option<RowLanes>,
    pub(crate) now: Vec<OthersNow>,
}

impl Others {
    /// Returns nothing if no agent needs them. `rows`: the agents of the rows.
    pub(crate) fn of_rows<'a>(joint: &JointPlan, rows: impl Iterator<Item = &'a AgentPlan>) -> Option<Others> {
        let is_needed = needs_others(&joint.reward) || joint.agents.iter().any(|agent| agent.sensor.sees_others);
        let nobody = |plan: &AgentPlan| OthersNow {
            buses: vec![0; plan.region.approaches.len()],
            trams: vec![0; plan.others.tracks.len()],
            lost: 0.0,
        };
        is_needed.then(|| Others { buses: HashMap::new(), tracks: None, now: rows.map(nobody).collect() })
    }

    /// Adds the trams, which only the whole net has.
    pub(crate) fn with_trams(mut self, simulation: &mut Simulation, plans: &[AgentPlan]) -> Result<Others> {
        let tracks = plans.iter().map(|plan| plan.others.tracks.iter().map(|track| &track.lane).collect());
        self.tracks = Some(RowLanes::register(simulation, tracks)?);
        Ok(self)
    }

    pub(crate) fn begin(&mut self) {
        self.buses.clear();
    }

    /// Begins an episode of one row. Nobody is there.
    pub(crate) fn begin_row(&mut self, row: usize) {
        self.buses.retain(|_, of| *of != row);
        self.now[row].clear();
    }

    /// Notes a bus that enters.
    pub(crate) fn bus_enters(&mut self, row: usize, car: CarId) {
        self.buses.insert(car, row);
    }

    /// Notes the vehicles that entered in the last second.
    pub(crate) fn second(&mut self, simulation: &mut Simulation) -> Result<()> {
        for departure in simulation.departures()? {
            if PUBLIC.contains(&&*departure.vehicle_class) {
                self.bus_enters(0, departure.id);
            }
        }
        Ok(())
    }

    /// Reads all rows after a decision. `approaches`: the cars there.
    pub(crate) fn read<'a>(
        &mut self,
        simulation: &mut Simulation,
        plans: impl Iterator<Item = &'a AgentPlan>,
        approaches: impl Fn(usize) -> CarsAt<'a>,
    ) -> Result<()> {
        if let Some(tracks) = &mut self.tracks {
            tracks.read(simulation)?;
        }
        for (row, plan) in plans.enumerate() {
            let now = &mut self.now[row];
            now.lost = 0.0;
            for ((approach, lane), count) in
                plan.region.approaches.iter().zip(approaches(row).iter()).zip(&mut now.buses)
            {
                let buses = lane.iter().filter(|car| self.buses.contains_key(&car.id));
                *count = 0;
                for bus in buses {
                    *count += 1;
                    now.lost += (1.0 - bus.speed_mps / approach.speed_limit_mps).max(0.0);
                }
            }
            let Some(tracks) = &self.tracks else { continue };
            for ((track, lane), count) in plan.others.tracks.iter().zip(tracks.at(row).iter()).zip(&mut now.trams) {
                *count = lane.len() as u32;
                now.lost +=
                    lane.speeds_mps.iter().map(|speed| (1.0 - speed / track.speed_limit_mps).max(0.0)).sum::<f64>();
            }
        }
        Ok(())
    }
}
