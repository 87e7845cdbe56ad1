//! Pictures of the GS: all lanes, the cars on them, and what the lights show.

use super::lights::Lights;
use crate::agents::plan::AgentPlan;
use crate::agents::region_plan::Approach;
use crate::network::roads::{Place, Roads};
use dials_core::domain::{Colour, Result, Scene};
use libsumo::{CarTable, LaneId, SignalState, Simulation};

/// Longer side of a picture, in the units of a scene.
const LONGER: f64 = 50.0;
const MARGIN: f64 = 1.0;
/// Sizes in metres.
const LANE_M: f64 = 3.0;
const CAR_LENGTH_M: f64 = 4.5;
const CAR_M: f64 = 2.0;
const LIGHT_M: f64 = 2.5;
/// Least widths in the units of a scene, so that a large map still shows something.
const LEAST_LANE: f64 = 0.12;
const LEAST_CAR: f64 = 0.2;

const GROUND: Colour = Colour([0xf4, 0xf2, 0xec]);
const LANE: Colour = Colour([0xb4, 0xb0, 0xa8]);
const CAR: Colour = Colour([0x1f, 0x5f, 0xa8]);
const STANDING_CAR: Colour = Colour([0xb7, 0x3e, 0x0c]);
const GREEN: Colour = Colour([0x2c, 0xa0, 0x2c]);
const YELLOW: Colour = Colour([0xff, 0xc1, 0x07]);
const RED: Colour = Colour([0xd6, 0x27, 0x28]);

/// All lanes of a loaded net, and the cars on them and what the lights showed when it last looked.
pub(crate) struct Camera {
    lanes: Vec<LaneId>,
    cars: CarTable,
    states: Vec<SignalState>,
    /// Lines of the lanes and their lengths in metres.
    shapes: Vec<(Vec<Place>, f64)>,
    /// Lanes that end at a stop line, for each agent: the lane, and the letters of the light that its cars obey.
    stop_lines: Vec<Vec<(usize, Vec<usize>)>>,
    frame: Frame,
}

/// Where metres are in a picture. East is right, and north is up.
struct Frame {
    left_m: f64,
    top_m: f64,
    per_m: f64,
    width: f64,
    height: f64,
}

impl Camera {
    pub(super) fn new(roads: &Roads, agents: &[AgentPlan], simulation: &mut Simulation) -> Result<Camera> {
        let drawn: Vec<_> = roads.lanes.iter().filter(|lane| lane.carries_cars && lane.shape.len() > 1).collect();
        let names: Vec<String> = drawn.iter().map(|lane| lane.id.clone()).collect();
        let shapes: Vec<(Vec<Place>, f64)> = drawn.iter().map(|lane| (lane.shape.clone(), lane.length_m)).collect();
        let stop_lines = agents.iter().map(|agent| {
            let region = &agent.region;
            let at_the_light = region.approaches.iter().enumerate().filter(|(_, approach)| approach.ahead_m == 0.0);
            let place = |(number, approach): (usize, &Approach)| {
                let place = names.iter().position(|name| *name == approach.lane)?;
                let links = region.links.iter().filter(|link| link.from == number);
                Some((place, links.map(|link| link.letter).collect()))
            };
            at_the_light.filter_map(place).collect()
        });
        Ok(Camera {
            stop_lines: stop_lines.collect(),
            frame: Frame::around(&shapes),
            lanes: simulation.register_lanes(&names)?,
            cars: CarTable::of(vec![Vec::new(); names.len()]),
            states: Vec::new(),
            shapes,
        })
    }

    pub(super) fn look(&mut self, simulation: &mut Simulation, lights: &Lights) -> Result<()> {
        self.states = lights.states(simulation)?;
        Ok(simulation.read_lanes(&self.lanes, &mut self.cars)?)
    }

    pub(super) fn draw(&self) -> Scene {
        let mut scene = Scene::new(self.frame.width as f32, self.frame.height as f32, GROUND);
        let mut line = |from: Place, to: Place, width: f64, colour: Colour| {
            scene.line(self.frame.place(from), self.frame.place(to), width as f32, colour);
        };
        let wide = |metres: f64, least: f64| (metres * self.frame.per_m).max(least);
        for (shape, _) in &self.shapes {
            shape.windows(2).for_each(|ends| line(ends[0], ends[1], wide(LANE_M, LEAST_LANE), LANE));
        }
        for (state, stop_lines) in self.states.iter().zip(&self.stop_lines) {
            for (lane, letters) in stop_lines {
                let (shape, length_m) = &self.shapes[*lane];
                let [from, to] = [LIGHT_M, 0.0].map(|back_m| along(shape, *length_m, length_m - back_m));
                line(from, to, wide(LANE_M, LEAST_LANE), aspect(state, letters));
            }
        }
        for ((shape, length_m), cars) in self.shapes.iter().zip(self.cars.iter()) {
            for (car, (_, stands)) in cars.iter().zip(cars.standing()) {
                let [front, rear] = [0.0, CAR_LENGTH_M].map(|back| along(shape, *length_m, car.position_m - back));
                line(front, rear, wide(CAR_M, LEAST_CAR), if stands { STANDING_CAR } else { CAR });
            }
        }
        scene
    }
}

/// Returns the colour that cars see who obey these letters of a light.
fn aspect(state: &SignalState, letters: &[usize]) -> Colour {
    let shown = state.as_str().as_bytes();
    let has = |wanted: u8| {
        letters.iter().any(|&letter| shown.get(letter).is_some_and(|letter| letter.eq_ignore_ascii_case(&wanted)))
    };
    if has(b'g') {
        GREEN
    } else if has(b'y') {
        YELLOW
    } else {
        RED
    }
}

/// Returns the place on a line, which stands for a lane of `length_m`, this far from its beginning.
fn along(shape: &[Place], length_m: f64, position_m: f64) -> Place {
    let lengths = shape.windows(2).map(|ends| (ends[1][0] - ends[0][0]).hypot(ends[1][1] - ends[0][1]));
    let drawn_m: f64 = lengths.clone().sum();
    let mut rest = if length_m > 0.0 { position_m.max(0.0) / length_m * drawn_m } else { 0.0 };
    for (ends, length) in shape.windows(2).zip(lengths) {
        if rest <= length && length > 0.0 {
            return std::array::from_fn(|i| ends[0][i] + (ends[1][i] - ends[0][i]) * rest / length);
        }
        rest -= length;
    }
    *shape.last().expect("lanes that are drawn have at least two points")
}

impl Frame {
    fn around(shapes: &[(Vec<Place>, f64)]) -> Frame {
        let points = || shapes.iter().flat_map(|(shape, _)| shape);
        let widen = |[low, high]: [f64; 2], at: f64| [low.min(at), high.max(at)];
        let bounds = |i: usize| points().map(|place| place[i]).fold([f64::INFINITY, f64::NEG_INFINITY], widen);
        let [[left_m, right_m], [bottom_m, top_m]] = [bounds(0), bounds(1)];
        let per_m = (LONGER - 2.0 * MARGIN) / (right_m - left_m).max(top_m - bottom_m).max(1.0);
        let side = |length_m: f64| length_m.max(0.0) * per_m + 2.0 * MARGIN;
        Frame { left_m, top_m, per_m, width: side(right_m - left_m), height: side(top_m - bottom_m) }
    }

    fn place(&self, [east_m, north_m]: Place) -> [f32; 2] {
        [(east_m - self.left_m) * self.per_m + MARGIN, (self.top_m - north_m) * self.per_m + MARGIN].map(|x| x as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_car_is_on_the_line_of_its_lane() {
        // 30 m east and 40 m north are drawn for a lane of 140 m: twice as long as the line.
        let line = [[0.0, 0.0], [30.0, 0.0], [30.0, 40.0]];
        let at = |position_m: f64| along(&line, 140.0, position_m);
        assert_eq!(at(0.0), [0.0, 0.0]);
        assert_eq!(at(20.0), [10.0, 0.0]);
        assert_eq!(at(80.0), [30.0, 10.0]);
        assert_eq!(at(140.0), [30.0, 40.0]);
        assert_eq!([at(-5.0), at(500.0)], [[0.0, 0.0], [30.0, 40.0]], "a car may stand over the ends");
    }

    #[test]
    fn north_is_up_and_the_longer_side_fills_the_picture() {
        let frame = Frame::around(&[(vec![[100.0, 0.0], [580.0, 240.0]], 1.0)]);
        // 480 m are 48 of 50 units.
        assert_eq!((frame.width, frame.height), (50.0, 26.0));
        assert_eq!(frame.place([100.0, 240.0]), [1.0, 1.0]);
        assert_eq!(frame.place([580.0, 0.0]), [49.0, 25.0]);
    }
}
