//! The LS of a grid's light plays the recorded episode again. Nothing in it is random.

use super::seen::Seen;
use super::{Entering, Fidelity};
use crate::agents::region::EDGES;
use crate::arrivals::has_arrival;
use crate::sim::local::Placement;
use dials_core::base::{AgentId, Rows};
use dials_core::domain::{Beginning, LocalSimulator, Result};
use libsumo::{CarTable, DepartSpeed};

impl Fidelity<'_> {
    pub(super) fn play_on_grid(&self, agent: AgentId, entering: Entering) -> Result<Seen> {
        let plan = &self.traffic.plan.agents[agent.0];
        let mut ls = self.traffic.local(1)?;
        ls.reset(&Beginning::first([0]))?;
        let mut seen = Seen::new(plan, self.window.clone());
        let mut before = CarTable::of(vec![Vec::new(); EDGES]);
        let recorded = self.truth.actions.iter().zip(&self.truth.sources).zip(self.truth.on_approaches(plan)?);
        for ((actions, sources), now) in recorded {
            let actions = &actions[agent.0..=agent.0];
            match entering {
                Entering::ByRule => ls.step(actions, &Rows::from_vec(sources.row(agent.0).to_vec(), EDGES))?,
                Entering::Truly => ls.step_with(actions, &[placements(&now, &before)])?,
            };
            seen.note(plan, ls.cars_on(0), &[], 0); // Trips end behind the intersection.
            before = now;
        }
        let counted = ls.counters();
        [seen.sums.came, seen.sums.dropped] = [counted[0].1, counted[1].1];
        Ok(seen)
    }
}

/// Returns where and how fast a car came to each edge between two reads.
fn placements(now: &CarTable, before: &CarTable) -> [Option<Placement>; EDGES] {
    std::array::from_fn(|edge| {
        let [now, before] = [now, before].map(|cars| cars.lane(edge));
        let car = now.iter().next().filter(|_| has_arrival(now, before));
        car.map(|car| Placement { position_m: car.position_m, speed: DepartSpeed::Fixed(car.speed_mps) })
    })
}
