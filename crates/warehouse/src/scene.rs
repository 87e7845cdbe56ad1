//! A picture of the warehouse.

use super::layout::FloorPlan;
use super::region::{Age, SIDE};
use dials_core::domain::{Colour, Scene};

const FLOOR: Colour = Colour([0xf4, 0xf2, 0xec]);
const WALL: Colour = Colour([0x6b, 0x6b, 0x6b]);
const SHELF: Colour = Colour([0xd9, 0xd4, 0xc5]);
const REGION: Colour = Colour([0xa8, 0xa2, 0x92]);
const LEARNER: Colour = Colour([0x1f, 0x5f, 0xa8]);
const OTHER_ROBOT: Colour = Colour([0x9d, 0xb4, 0xcc]);
/// Colour of a new item. With age it becomes that of an old one, which an item keeps from [`OLD`] steps on.
const NEW_ITEM: [f32; 3] = [255.0, 224.0, 130.0];
const OLD_ITEM: [f32; 3] = [183.0, 62.0, 12.0];
const OLD: f32 = 15.0;

/// Draws floor, shelves, items shaded by age, robots (the learning ones dark), and the rims of the regions.
///
/// `ages`: one per shelf of the floor; `cells`: the cell of each robot within its region.
pub(crate) fn draw(layout: &FloorPlan, ages: &[Age], cells: &[u8]) -> Scene {
    let side = layout.cells_per_side();
    let mut scene = Scene::new(side as f32, side as f32, FLOOR);
    for corner in (0..side).step_by(SIDE - 1).flat_map(|row| (0..side).step_by(SIDE - 1).map(move |col| (row, col))) {
        scene.rectangle(corner.1 as f32, corner.0 as f32, 1.0, 1.0, WALL);
    }
    for (&(row, col), &age) in layout.shelves().iter().zip(ages) {
        let (x, y) = (col as f32, row as f32);
        scene.rectangle(x, y, 1.0, 1.0, REGION);
        scene.rectangle(x + 0.04, y + 0.04, 0.92, 0.92, SHELF);
        if age >= 0 {
            scene.rectangle(x + 0.2, y + 0.2, 0.6, 0.6, item_colour(age as f32));
        }
    }
    for (robot, &cell) in cells.iter().enumerate() {
        let (top, left) = layout.corner(robot);
        let cell = usize::from(cell);
        let (x, y) = ((left + cell % SIDE) as f32 + 0.5, (top + cell / SIDE) as f32 + 0.5);
        let colour = if layout.learners().contains(&robot) { LEARNER } else { OTHER_ROBOT };
        scene.disc(x, y, 0.32, colour);
    }
    scene.explain(LEARNER, "robot that learns");
    scene.explain(OTHER_ROBOT, "other robot: goes for the closest item");
    scene.explain(item_colour(0.0), "new item");
    scene.explain(item_colour(OLD), "item of 15 steps or more");
    scene.explain(SHELF, "shelf without an item");
    scene
}

fn item_colour(age: f32) -> Colour {
    let share = (age / OLD).min(1.0);
    Colour(std::array::from_fn(|i| (NEW_ITEM[i] + (OLD_ITEM[i] - NEW_ITEM[i]) * share) as u8))
}
