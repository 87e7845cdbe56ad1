//! The LS: the regions of many robots in lockstep. The AIPs say where the neighbours are.

use std::iter::repeat_n;

use super::items::{self, Appearances};
use super::layout::FloorPlan;
use super::region::{self, Age, CENTRE, NO_ITEM, SHARED, SHELVES};
use dials_core::base::{AgentId, Rows, Seed};
use dials_core::domain::{Action, Beginning, LocalSimulator, Percept, RegionSpec, Result, Transition};

/// The warehouse LS: one region per row.
pub struct LocalWarehouse {
    spec: RegionSpec,
    seed: Seed,
    copies: usize,
    /// Places of every row's shelves on the floor of the warehouse, which determine their streams.
    places: Vec<[(usize, usize); SHELVES]>,
    cells: Vec<u8>,
    ages: Vec<[Age; SHELVES]>,
    appearances: Vec<[Appearances; SHELVES]>,
    last: Transition,
}

impl LocalWarehouse {
    pub fn new(layout: &FloorPlan, agents: &[AgentId], copies: usize, horizon: usize, seed: Seed) -> Self {
        let spec = region::spec(horizon);
        let rows = agents.len() * copies;
        let shelves_of =
            |agent: AgentId| layout.region(layout.learners()[agent.0]).map(|shelf| layout.shelves()[shelf]);
        LocalWarehouse {
            seed,
            copies,
            places: agents.iter().flat_map(|&agent| repeat_n(shelves_of(agent), copies)).collect(),
            cells: vec![CENTRE; rows],
            ages: vec![[NO_ITEM; SHELVES]; rows],
            appearances: vec![[Appearances::default(); SHELVES]; rows],
            last: Transition::new(rows, &spec),
            spec,
        }
    }

    fn observe(&mut self, row: usize) {
        let percept = &mut self.last.percept;
        region::observe(self.cells[row], &self.ages[row], percept.obs.row_mut(row));
        percept.d_set.row_mut(row).copy_from_slice(percept.obs.row(row));
    }
}

impl LocalSimulator for LocalWarehouse {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.cells.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        for &Beginning { row, episode } in begin {
            let episode = items::episode(self.seed, row % self.copies, episode);
            self.cells[row] = CENTRE;
            self.ages[row] = [NO_ITEM; SHELVES];
            self.appearances[row] = self.places[row].map(|(y, x)| Appearances::of_shelf(episode, y, x));
            items::appear(&mut self.ages[row], &mut self.appearances[row]);
            self.observe(row);
        }
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        for (row, (&action, sources)) in actions.iter().zip(sources.iter()).enumerate() {
            let ages = &mut self.ages[row];
            ages.iter_mut().for_each(|age| *age += Age::from(*age >= 0));
            self.cells[row] = region::after_move(self.cells[row], action);
            let shelf = region::shelf_at(self.cells[row]);
            self.last.rewards[row] = region::reward(shelf, ages);
            if let Some(shelf) = shelf {
                ages[shelf] = NO_ITEM;
            }
            for (shared, &class) in SHARED.iter().zip(sources) {
                if class > 0 {
                    ages[shared[usize::from(class) - 1]] = NO_ITEM;
                }
            }
            items::appear(ages, &mut self.appearances[row]);
            self.observe(row);
        }
        Ok(&self.last)
    }
}
