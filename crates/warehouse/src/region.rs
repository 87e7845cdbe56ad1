//! The local region of one robot: 5 x 5 cells, twelve of them shelves. Pure.
//!
//! ```text
//!   .  0  1  2  .        shelves by the number of their bit in an observation;
//!   6  .  .  .  7        corners are walls, the inner 3 x 3 cells are floor.
//!   8  .  .  .  9        Each side is shared with the neighbour there.
//!  10  .  .  . 11
//!   .  3  4  5  .
//! ```

use dials_core::domain::{Action, RegionSpec, SourceSpec, Task};

pub(crate) const SIDE: usize = 5;
pub(crate) const CELLS: usize = SIDE * SIDE;
pub(crate) const SHELVES: usize = 12;
/// Cell where a robot begins: the middle.
pub(crate) const CENTRE: u8 = 12;
pub const UP: Action = 0;
pub const DOWN: Action = 1;
pub const LEFT: Action = 2;
pub const RIGHT: Action = 3;
pub(crate) const MOVES: usize = 4;
pub(crate) const NEIGHBOURS: usize = 4;

/// Age of an item, in steps since it appeared; [`NO_ITEM`] if there is none.
pub(crate) type Age = i32;
pub(crate) const NO_ITEM: Age = -1;

/// Shelves shared with the neighbours to the right, below, to the left and above, in row or column order. This is the
/// order of influence sources. Class k > 0 of a source says that the neighbour is on the k-th of its three shelves;
/// class 0 says that it is on none.
pub(crate) const SHARED: [[usize; 3]; NEIGHBOURS] = [[7, 9, 11], [3, 4, 5], [6, 8, 10], [0, 1, 2]];

/// Cell of each shelf, row-major.
pub(crate) const SHELF_CELLS: [u8; SHELVES] = [1, 2, 3, 21, 22, 23, 5, 9, 10, 14, 15, 19];

pub(crate) fn spec(horizon: usize) -> RegionSpec {
    RegionSpec {
        obs_dim: CELLS + SHELVES,
        // The d-set is the observation: items that vanish show what neighbours did.
        d_set_dim: CELLS + SHELVES,
        n_actions: MOVES,
        sets: None,
        masks: false,
        sources: SourceSpec { classes: vec![4; NEIGHBOURS], parts: 0 },
        horizon,
        local_horizon: horizon,
    }
}

/// Returns what a robot sees, does and is paid for, in words.
pub(crate) fn task() -> Task {
    let cells = (0..CELLS).map(|cell| format!("robot in cell, row by row[{cell}]"));
    let item = |(side, shelf)| format!("item on {side} shelf[{shelf}]");
    // The order of `SHELF_CELLS`.
    let sides = [("upper", 0), ("upper", 1), ("upper", 2), ("lower", 0), ("lower", 1), ("lower", 2)];
    let ends = [("left", 0), ("right", 0), ("left", 1), ("right", 1), ("left", 2), ("right", 2)];
    let items = sides.into_iter().chain(ends).map(item);
    let seen: Vec<String> = cells.chain(items).collect();
    // The order of `SHARED`.
    let sides = ["to the right", "below", "to the left", "above"];
    Task {
        observation: seen.clone(),
        // The order of `UP`, `DOWN`, `LEFT` and `RIGHT`.
        actions: ["up", "down", "left", "right"].map(|way| format!("one cell {way}")).to_vec(),
        reward: "age of the item that the robot collects, as a share of the oldest item's age in its region".to_owned(),
        sources: sides.map(|side| format!("shelf of the neighbour {side}, or none")).to_vec(),
        d_set: seen,
    }
}

pub(crate) fn shelf_at(cell: u8) -> Option<usize> {
    SHELF_CELLS.iter().position(|&shelf| shelf == cell)
}

/// Returns the cell of a robot after a move. On a shelf, only the move back inward works.
pub(crate) fn after_move(cell: u8, action: Action) -> u8 {
    // The order of `UP`, `DOWN`, `LEFT` and `RIGHT`.
    let next = cell as i8 + [-(SIDE as i8), SIDE as i8, -1, 1][usize::from(action)];
    // A robot moves where it comes from the floor or goes onto it, so nobody goes along the rim or out of the region.
    if is_floor(cell as i8) || is_floor(next) { next as u8 } else { cell }
}

/// Returns the class of an influence source: which of three shared shelves the neighbour is on, 0 for none.
pub(crate) fn class_of(shelf: Option<usize>, shared: &[usize; 3]) -> u8 {
    shared.iter().position(|&other| Some(other) == shelf).map_or(0, |place| place as u8 + 1)
}

/// Writes the observation, 37 bits: the robot's cell, one-hot, and which shelves hold an item.
pub(crate) fn observe(cell: u8, ages: &[Age; SHELVES], obs: &mut [f32]) {
    let (cells, items) = obs.split_at_mut(CELLS);
    cells.fill(0.0);
    cells[usize::from(cell)] = 1.0;
    items.iter_mut().zip(ages).for_each(|(bit, &age)| *bit = f32::from(u8::from(age >= 0)));
}

/// Returns the age of the item under the robot as a share of the greatest in its region; 0 without an item.
pub(crate) fn reward(shelf: Option<usize>, ages: &[Age; SHELVES]) -> f32 {
    match shelf.map(|shelf| ages[shelf]) {
        Some(age) if age >= 0 => {
            // An item is at least one step old when it is collected. If all were new, 0 / 0 would be no number.
            let oldest = ages.iter().copied().max().expect("there are shelves").max(1);
            age as f32 / oldest as f32
        }
        _ => 0.0,
    }
}

pub(crate) fn is_floor(cell: i8) -> bool {
    let side = SIDE as i8;
    [cell / side, cell % side].iter().all(|&place| place > 0 && place < side - 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(row: u8, col: u8) -> u8 {
        5 * row + col
    }

    #[test]
    fn everything_that_a_robot_sees_and_does_has_a_name() {
        let (task, spec) = (task(), spec(100));
        let counts = [task.observation.len(), task.actions.len(), task.sources.len(), task.d_set.len()];
        assert_eq!(counts, [spec.obs_dim, spec.n_actions, spec.sources.count(), spec.d_set_dim]);
        // Shelves 8 and 9 are the middle ones of the left and the right column.
        assert_eq!(task.observation[CELLS + 8..CELLS + 10], ["item on left shelf[1]", "item on right shelf[1]"]);
        assert_eq!(SHELF_CELLS[8..10], [cell(2, 0), cell(2, 4)]);
    }

    #[test]
    fn shelves_are_numbered_as_in_the_observation() {
        let order: Vec<(u8, u8)> = SHELF_CELLS.iter().map(|&cell| (cell / 5, cell % 5)).collect();
        let top_bottom = [(0, 1), (0, 2), (0, 3), (4, 1), (4, 2), (4, 3)];
        let pairs = [(1, 0), (1, 4), (2, 0), (2, 4), (3, 0), (3, 4)];
        assert_eq!(order, [top_bottom, pairs].concat());
        assert_eq!(shelf_at(cell(3, 4)), Some(11));
        assert_eq!([shelf_at(CENTRE), shelf_at(0)], [None, None]);
        // Right, down, left, up, each in row or column order.
        assert_eq!(SHARED[0].map(|shelf| SHELF_CELLS[shelf]), [cell(1, 4), cell(2, 4), cell(3, 4)]);
        assert_eq!(SHARED[3].map(|shelf| SHELF_CELLS[shelf]), [cell(0, 1), cell(0, 2), cell(0, 3)]);
        assert_eq!(class_of(Some(9), &SHARED[0]), 2);
        assert_eq!([class_of(Some(9), &SHARED[1]), class_of(None, &SHARED[0])], [0, 0]);
    }

    #[test]
    fn the_reward_is_the_age_as_a_share_of_the_oldest() {
        let mut ages = [NO_ITEM; SHELVES];
        (ages[2], ages[7], ages[8]) = (3, 12, 12);
        assert_eq!(reward(Some(2), &ages), 0.25);
        assert_eq!(reward(Some(7), &ages), 1.0, "the oldest, also if there are two of them");
        assert_eq!([reward(Some(0), &ages), reward(None, &ages)], [0.0, 0.0]);
    }
}
