//! What hand-coded controllers see of the intersections. It is more than an agent observes: also queues and the cars
//! that have left. Learning uses none of it.

use crate::agents::phase_plan::Shown;
use crate::agents::plan::AgentPlan;
use crate::cars_at::{CarsAt, RowLanes};
use crate::sim::crossings::Crossings;
use crate::sim::lights::Lights;
use dials_core::base::AgentId;
use libsumo::LaneCars;

pub struct Intersections<'a> {
    pub(crate) plans: &'a [AgentPlan],
    /// What every light showed in the last step, and for how many steps.
    pub(crate) shown: &'a [Shown],
    pub(crate) shown_steps: &'a [u32],
    pub(crate) lights: &'a Lights,
    pub(crate) approaches: &'a RowLanes,
    pub(crate) exits: &'a RowLanes,
    /// Lanes within the junctions, and persons at the crossings; read only for a rule that looks closely.
    pub(crate) inside: &'a RowLanes,
    pub(crate) people: &'a Crossings,
}

impl<'a> Intersections<'a> {
    pub fn iter(&self) -> impl Iterator<Item = Intersection<'a>> {
        let &Intersections { plans, shown, shown_steps, approaches, exits, .. } = self;
        plans.iter().enumerate().map(move |(row, plan)| Intersection {
            plan,
            agent: AgentId(row),
            shown: shown[row],
            shown_steps: shown_steps[row],
            approaches: approaches.at(row),
            exits: exits.at(row),
        })
    }

    /// Returns whether a light may go to a green now, or keep it.
    pub(crate) fn allows(&self, row: usize, green: usize) -> bool {
        self.lights.allows(row, green)
    }
}

pub struct Intersection<'a> {
    pub(super) plan: &'a AgentPlan,
    pub(super) agent: AgentId,
    /// What the light showed in the last step; at the beginning of an episode, what it will show.
    pub(super) shown: Shown,
    pub(super) shown_steps: u32,
    /// Cars on each approach and on each exit, in the order of the plan.
    pub(super) approaches: CarsAt<'a>,
    pub(super) exits: CarsAt<'a>,
}

impl<'a> Intersection<'a> {
    pub fn agent(&self) -> AgentId {
        self.agent
    }

    pub fn plan(&self) -> &'a AgentPlan {
        self.plan
    }

    pub fn shown_steps(&self) -> u32 {
        self.shown_steps
    }

    pub fn green(&self) -> Option<usize> {
        self.shown.green()
    }

    /// Returns the green that is shown or comes next. A rule that returns it keeps the light.
    pub fn target(&self) -> usize {
        self.shown.target()
    }

    pub fn next(&self, green: usize) -> usize {
        self.plan.phases.next(green)
    }

    /// Returns the greens but this one, from the next one on in the order of the light's program.
    pub fn others(&self, green: usize) -> impl Iterator<Item = usize> {
        let greens = self.plan.greens();
        (1..greens).map(move |steps| (green + steps) % greens)
    }

    pub fn cars(&self, approach: usize) -> LaneCars<'a> {
        self.approaches.lane(approach)
    }

    /// Returns the number of standing cars on an approach.
    pub fn queue(&self, approach: usize) -> usize {
        self.cars(approach).halting()
    }

    /// Returns the speeds of the cars on an approach that are less than `metres` before the stop line.
    pub(crate) fn speeds_within(&self, approach: usize, metres: f64) -> impl Iterator<Item = f64> {
        let lane = &self.plan.region.approaches[approach];
        let (length_m, ahead_m) = (lane.length_m, lane.ahead_m);
        let cars = self.cars(approach).iter();
        cars.filter(move |car| length_m - car.position_m + ahead_m < metres).map(|car| car.speed_mps)
    }

    /// Returns whether a green is in use: a car is less than `metres` before a stop line that it opens. On a lane that
    /// it opens in part, only a car that moves counts: one that stands waits for another green.
    pub(crate) fn uses(&self, green: usize, metres: f64) -> bool {
        self.plan.served(green).any(|approach| {
            let whole = self.plan.share(green, approach) == 1.0;
            self.speeds_within(approach, metres).any(|speed_mps| whole || speed_mps >= MOVING_MPS)
        })
    }

    /// Returns whether a car may want green `wanted`: it is less than `metres` before a stop line, and `wanted` opens a
    /// link of its lane that green `shown` does not.
    pub(crate) fn wants(&self, wanted: usize, shown: usize, metres: f64) -> bool {
        let opened = |&link: &usize| self.plan.opens(wanted, link) && !self.plan.opens(shown, link);
        let mut approaches = self.plan.region.approaches.iter().enumerate();
        approaches.any(|(approach, lane)| {
            lane.links.iter().any(opened) && self.speeds_within(approach, metres).next().is_some()
        })
    }
}

const MOVING_MPS: f64 = 1.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::{At, crossing};

    #[test]
    fn distances_to_the_stop_line_include_what_lies_ahead_of_a_lane() {
        let plan = crossing();
        // Lane 4 ends 10 m before the stop line.
        let at = At::new(&plan, Shown::Green(0)).cars(4, &[(20.0, 5.0)]).build();
        assert_eq!([30.0, 30.1].map(|metres| at.speeds_within(4, metres).count()), [0, 1]);
    }
}
