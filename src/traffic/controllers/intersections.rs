//! What hand-coded controllers see of the intersections. It is more than an agent observes: also queues and the cars
//! that have left. Learning uses none of it.

use crate::base::{AgentId, Ragged};
use crate::sumo::{CarTable, LaneCars};
use crate::traffic::agents::phases::Light;
use crate::traffic::paper_grid::grid::Grid;
use crate::traffic::side::Side;

/// All intersections, as they are after the last step.
pub struct Intersections<'a> {
    pub(in crate::traffic) grid: Grid,
    pub(in crate::traffic) lights: &'a [Light],
    pub(in crate::traffic) shown_steps: &'a [u32],
    pub(in crate::traffic) obs: &'a Ragged<f32>,
    pub(in crate::traffic) incoming: &'a CarTable,
    pub(in crate::traffic) outgoing: &'a CarTable,
}

impl<'a> Intersections<'a> {
    pub fn grid(&self) -> Grid {
        self.grid
    }

    /// Returns the intersections, one per agent, in the order of the agents.
    pub fn iter(&self) -> impl Iterator<Item = Intersection<'a>> {
        (0..self.lights.len()).map(|row| Intersection {
            grid: self.grid,
            agent: AgentId(row),
            light: self.lights[row],
            shown_steps: self.shown_steps[row],
            obs: self.obs.row(row),
            incoming: edges_of(self.incoming, row),
            outgoing: edges_of(self.outgoing, row),
        })
    }
}

fn edges_of(cars: &CarTable, row: usize) -> [LaneCars<'_>; 4] {
    std::array::from_fn(|edge| cars.lane(4 * row + edge))
}

/// One intersection.
pub struct Intersection<'a> {
    pub(in crate::traffic) grid: Grid,
    pub(in crate::traffic) agent: AgentId,
    pub(in crate::traffic) light: Light,
    pub(in crate::traffic) shown_steps: u32,
    pub(in crate::traffic) obs: &'a [f32],
    pub(in crate::traffic) incoming: [LaneCars<'a>; 4],
    pub(in crate::traffic) outgoing: [LaneCars<'a>; 4],
}

impl<'a> Intersection<'a> {
    pub fn agent(&self) -> AgentId {
        self.agent
    }

    /// Returns what the light showed in the last step; at the beginning of an episode, what it will show.
    pub fn light(&self) -> Light {
        self.light
    }

    /// Returns the number of steps for which the light has shown that.
    pub fn shown_steps(&self) -> u32 {
        self.shown_steps
    }

    /// Returns the sides whose cars have green, then the sides whose cars have red; `None` during yellow.
    pub fn green_and_red(&self) -> Option<[[Side; 2]; 2]> {
        self.light.green_and_red()
    }

    /// Returns what a policy would observe, 40 bits.
    pub fn obs(&self) -> &'a [f32] {
        self.obs
    }

    /// Returns the cars that come from a side.
    pub fn incoming(&self, from: Side) -> LaneCars<'a> {
        self.incoming[from.index()]
    }

    /// Returns the cars on the edge that leaves towards a side.
    pub fn outgoing(&self, to: Side) -> LaneCars<'a> {
        self.outgoing[to.index()]
    }

    /// Returns whether the edge towards a side leaves the net.
    pub fn leaves_the_net(&self, to: Side) -> bool {
        self.grid.leaves(self.agent, to)
    }

    /// Returns the number of standing cars that come from a side.
    pub fn queue(&self, from: Side) -> usize {
        self.incoming(from).halting()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::sumo::CarId;

    const IDS: [CarId; 16] = [CarId(0); 16];
    const STANDING: [f64; 16] = [0.0; 16];
    const MOVING: [f64; 16] = [5.0; 16];

    /// Returns `standing` cars that stand, followed by `moving` cars that move.
    fn cars(standing: usize, moving: usize) -> LaneCars<'static> {
        let count = standing + moving;
        let speeds_mps = [&STANDING[..standing], &MOVING[..moving]].concat().leak();
        LaneCars { ids: &IDS[..count], positions_m: &MOVING[..count], speeds_mps }
    }

    /// Returns the middle of three intersections in a row. `incoming`: `(standing, moving)` cars from west, south, east
    /// and north; `outgoing`: number of cars on the edges that leave in these directions.
    pub fn middle(
        light: Light,
        shown_steps: u32,
        incoming: [(usize, usize); 4],
        outgoing: [usize; 4],
    ) -> Intersection<'static> {
        Intersection {
            grid: Grid::new(1, 3).expect("a grid"),
            agent: AgentId(1),
            light,
            shown_steps,
            obs: &[],
            incoming: incoming.map(|(standing, moving)| cars(standing, moving)),
            outgoing: outgoing.map(|moving| cars(0, moving)),
        }
    }

    #[test]
    fn a_queue_is_made_of_cars_that_stand() {
        let at = middle(Light::VerticalGreen, 1, [(2, 3), (0, 4), (0, 0), (1, 0)], [0; 4]);
        assert_eq!(Side::ALL.map(|side| at.queue(side)), [2, 0, 0, 1]);
        assert_eq!(at.incoming(Side::West).len(), 5);
        assert_eq!(Side::ALL.map(|side| at.leaves_the_net(side)), [false, true, false, true]);
    }
}
