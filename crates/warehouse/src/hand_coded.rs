//! Robots without a policy: random moves, the closest item (also in the ring around the learning robots), the oldest.

use rand::Rng;

use super::region::{Age, DOWN, LEFT, MOVES, RIGHT, SHELF_CELLS, SHELVES, SIDE, UP, shelf_at};
use dials_core::base::Dice;
use dials_core::domain::Action;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rule {
    Random,
    /// Goes to the item with the fewest moves; ties go to the first in row-major order. Continues to that shelf as long
    /// as it holds an item, even a new one. Does not see an item on its own cell.
    ClosestItem,
    /// Goes to the item with the greatest age. Ties go to the first in row-major order, which was created first.
    OldestItem,
}

impl Rule {
    pub(crate) const NAMES: &'static [&'static str] = &["random", "closest-item", "oldest-item"];

    pub(crate) fn by_name(name: &str) -> Option<Rule> {
        let rules = [Rule::Random, Rule::ClosestItem, Rule::OldestItem];
        Rule::NAMES.iter().zip(rules).find_map(|(known, rule)| (*known == name).then_some(rule))
    }
}

const ROW_MAJOR: [usize; SHELVES] = [0, 1, 2, 6, 7, 8, 9, 10, 11, 3, 4, 5];

/// Returns the next move of a robot on `cell` that sees items of these ages. A robot with nothing to do moves at
/// random. `target`: the shelf that it goes to, which it remembers from step to step.
pub(crate) fn decide(
    rule: Rule,
    target: &mut Option<usize>,
    cell: u8,
    ages: &[Age; SHELVES],
    dice: &mut Dice,
) -> Action {
    *target = match rule {
        Rule::Random => None,
        Rule::ClosestItem => closest(*target, cell, ages),
        Rule::OldestItem => oldest(ages).filter(|&shelf| shelf_at(cell) != Some(shelf)),
    };
    target.map_or_else(|| dice.random_range(0..MOVES) as Action, |shelf| towards(cell, shelf))
}

fn closest(kept: Option<usize>, cell: u8, ages: &[Age; SHELVES]) -> Option<usize> {
    let seen = |&shelf: &usize| ages[shelf] >= 0 && shelf_at(cell) != Some(shelf);
    kept.filter(seen).or_else(|| ROW_MAJOR.into_iter().filter(seen).min_by_key(|&shelf| distance(cell, shelf)))
}

fn oldest(ages: &[Age; SHELVES]) -> Option<usize> {
    let items = ROW_MAJOR.into_iter().filter(|&shelf| ages[shelf] >= 0);
    items.reduce(|oldest, shelf| if ages[shelf] > ages[oldest] { shelf } else { oldest })
}

fn place(cell: u8) -> (usize, usize) {
    (usize::from(cell) / SIDE, usize::from(cell) % SIDE)
}

/// Returns the number of moves from a cell to a shelf. Between two of one side the way leads over the floor.
fn distance(cell: u8, shelf: usize) -> usize {
    let ((row, col), (to_row, to_col)) = (place(cell), place(SHELF_CELLS[shelf]));
    let same_side = (row == to_row && at_end(row)) || (col == to_col && at_end(col));
    row.abs_diff(to_row) + col.abs_diff(to_col) + if same_side && cell != SHELF_CELLS[shelf] { 2 } else { 0 }
}

fn at_end(place: usize) -> bool {
    place == 0 || place == SIDE - 1
}

/// Returns the first move of a shortest way to another shelf: off the current shelf, along the side, onto the shelf.
fn towards(cell: u8, shelf: usize) -> Action {
    let ((row, col), (to_row, to_col)) = (place(cell), place(SHELF_CELLS[shelf]));
    if shelf_at(cell).is_some() {
        return match (row, col) {
            (0, _) => DOWN,
            (_, 0) => RIGHT,
            (_, col) if col == SIDE - 1 => LEFT,
            _ => UP,
        };
    }
    let vertical = if to_row < row { UP } else { DOWN };
    let horizontal = if to_col < col { LEFT } else { RIGHT };
    if to_row == 0 || to_row == SIDE - 1 {
        if col != to_col { horizontal } else { vertical }
    } else if row != to_row {
        vertical
    } else {
        horizontal
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::region::{CELLS, CENTRE, NO_ITEM, after_move, is_floor};
    use dials_core::base::Seed;

    fn items(ages: &[(usize, Age)]) -> [Age; SHELVES] {
        let mut all = [NO_ITEM; SHELVES];
        ages.iter().for_each(|&(shelf, age)| all[shelf] = age);
        all
    }

    #[test]
    fn every_way_is_as_long_as_its_distance() {
        for from in (0..CELLS as u8).filter(|&cell| shelf_at(cell).is_some() || is_floor(cell as i8)) {
            for shelf in (0..SHELVES).filter(|&shelf| shelf_at(from) != Some(shelf)) {
                let mut way = std::iter::successors(Some(from), |&cell| Some(after_move(cell, towards(cell, shelf))));
                let moves = way.position(|cell| shelf_at(cell) == Some(shelf)).expect("the way ends");
                assert_eq!(moves, distance(from, shelf), "from {from} to shelf {shelf}");
            }
        }
        assert_eq!(distance(1, 2), 4, "two more on the same side");
    }

    #[test]
    fn a_target_is_kept_while_an_item_is_there_and_ties_go_to_the_first_in_row_major_order() {
        let mut dice = Seed::new(0).dice();
        for (rule, kept, ages, expected, why) in [
            (Rule::ClosestItem, None, &[(3, 5)][..], 3, "the only item"),
            (Rule::ClosestItem, Some(3), &[(3, 0), (1, 9)], 3, "kept, although it is new and another one is nearer"),
            (Rule::ClosestItem, Some(3), &[(1, 9)], 1, "its item is gone"),
            (Rule::OldestItem, Some(1), &[(1, 3), (4, 8)], 4, "the oldest"),
            // Left (2, 0) and bottom (4, 2) are both two moves away.
            (Rule::ClosestItem, None, &[(4, 7), (8, 7)], 8, "a tie"),
            (Rule::OldestItem, None, &[(4, 7), (8, 7)], 8, "a tie"),
        ] {
            let mut target = kept;
            let action = decide(rule, &mut target, CENTRE, &items(ages), &mut dice);
            assert_eq!((target, action), (Some(expected), towards(CENTRE, expected)), "{rule:?}: {why}");
        }
        assert_eq!(towards(CENTRE, 4), DOWN);
    }

    #[test]
    fn without_anything_to_do_a_robot_moves_at_random() {
        let mut dice = Seed::new(0).dice();
        let on_its_only_item = items(&[(0, 4)]);
        for rule in [Rule::Random, Rule::ClosestItem, Rule::OldestItem] {
            let mut seen = [false; MOVES];
            for _ in 0..100 {
                let action = decide(rule, &mut None, SHELF_CELLS[0], &on_its_only_item, &mut dice);
                seen[usize::from(action)] = true;
            }
            assert_eq!(seen, [true; MOVES], "{rule:?}");
        }
    }
}
