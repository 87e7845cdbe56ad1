//! The floor: n x n overlapping regions, and which robots learn.

use super::region::{NEIGHBOURS, SHELF_CELLS, SHELVES, SIDE};

/// Number of cells from one region's corner to the next one's: neighbours share a row or column.
const STRIDE: usize = SIDE - 1;

/// A warehouse of `robots_per_side` squared robots. Only the inner ones learn, because only they have four neighbours.
#[derive(Clone, Debug)]
pub struct FloorPlan {
    robots_per_side: usize,
    /// Places of all shelves on the floor, row-major: (row, column).
    shelves: Vec<(usize, usize)>,
    /// Twelve shelves of each robot's region, as indices of `shelves`.
    regions: Vec<[usize; SHELVES]>,
    learners: Vec<usize>,
}

impl FloorPlan {
    /// Makes a warehouse with `agents_per_side` squared learning robots and a ring of others around them.
    pub fn around(agents_per_side: usize) -> Self {
        let n = agents_per_side + 2;
        let cells = STRIDE * n + 1;
        let places = (0..cells).flat_map(|row| (0..cells).map(move |col| (row, col)));
        // Rims of regions without their corners.
        let shelves: Vec<(usize, usize)> =
            places.filter(|(row, col)| row.is_multiple_of(STRIDE) != col.is_multiple_of(STRIDE)).collect();
        let index = |place: (usize, usize)| shelves.binary_search(&place).expect("the rim of a region is all shelves");
        let regions = (0..n * n)
            .map(|robot| {
                let (top, left) = (STRIDE * (robot / n), STRIDE * (robot % n));
                SHELF_CELLS.map(|cell| index((top + usize::from(cell) / SIDE, left + usize::from(cell) % SIDE)))
            })
            .collect();
        let inner = |robot: &usize| [robot / n, robot % n].iter().all(|&place| place > 0 && place < n - 1);
        let learners = (0..n * n).filter(inner).collect();
        FloorPlan { robots_per_side: n, regions, learners, shelves }
    }

    pub(crate) fn robots(&self) -> usize {
        self.regions.len()
    }

    pub(crate) fn cells_per_side(&self) -> usize {
        STRIDE * self.robots_per_side + 1
    }

    /// Returns the robots that learn, in the order of agents.
    pub(crate) fn learners(&self) -> &[usize] {
        &self.learners
    }

    pub(crate) fn shelves(&self) -> &[(usize, usize)] {
        &self.shelves
    }

    pub(crate) fn region(&self, robot: usize) -> &[usize; SHELVES] {
        &self.regions[robot]
    }

    /// Returns row and column of the upper left corner of a robot's region.
    pub(crate) fn corner(&self, robot: usize) -> (usize, usize) {
        (STRIDE * (robot / self.robots_per_side), STRIDE * (robot % self.robots_per_side))
    }

    /// Returns the neighbours of a learning robot: to the right, below, to the left, above.
    pub(crate) fn neighbours(&self, learner: usize) -> [usize; NEIGHBOURS] {
        let n = self.robots_per_side;
        [learner + 1, learner + n, learner - 1, learner - n]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_agents_are_the_inner_robots_of_sixteen() {
        let layout = FloorPlan::around(2);
        assert_eq!((layout.robots(), layout.cells_per_side()), (16, 17));
        assert_eq!(layout.learners(), [5, 6, 9, 10]);
        // 5 x 5 lines of 16 cells in each direction, 3 of 4 of them shelves.
        assert_eq!(layout.shelves().len(), 2 * 5 * 12);
        assert_eq!(layout.corner(6), (4, 8));
        assert_eq!(layout.neighbours(5), [6, 9, 4, 1]);
    }
}
