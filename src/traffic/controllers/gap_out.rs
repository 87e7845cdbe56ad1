//! Gap-out: keep green as long as a car uses it.

use crate::domain::Action;
use crate::traffic::agents::phases::Light;
use crate::traffic::agents::region::{CELLS, OCCUPANCY};
use crate::traffic::light::{KEEP, SWITCH};
use crate::traffic::side::Side;

const GREEN_CELLS: usize = 3;
const RED_CELLS: usize = 4;

/// Switches when no car is within three cells before a green line and some car is within four before a red one. Needs
/// no more than an observation.
pub fn decide(obs: &[f32]) -> Action {
    let shown = Light::ALL.into_iter().find(|&light| obs[OCCUPANCY + light as usize] != 0.0);
    let Some([green, red]) = shown.and_then(Light::green_and_red) else { return KEEP };
    let used = green.into_iter().any(|side| has_car_within(obs, side, GREEN_CELLS));
    let wanted = red.into_iter().any(|side| has_car_within(obs, side, RED_CELLS));
    if !used && wanted { SWITCH } else { KEEP }
}

/// Returns whether a car is in one of the first `cells` cells before the stop line of a side.
pub(super) fn has_car_within(obs: &[f32], side: Side, cells: usize) -> bool {
    obs[side.index() * CELLS..][..cells].iter().any(|&bit| bit != 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns an observation with cars in these cells of the edges west, south, east, north.
    fn obs(cars: &[(usize, usize)], light: Light) -> Vec<f32> {
        let mut obs = vec![0.0; OCCUPANCY + 4];
        cars.iter().for_each(|&(edge, cell)| obs[edge * CELLS + cell] = 1.0);
        obs[OCCUPANCY + light as usize] = 1.0;
        obs
    }

    #[test]
    fn green_is_given_away_when_nobody_uses_it_and_somebody_wants_it() {
        assert_eq!(decide(&obs(&[(1, 3)], Light::HorizontalGreen)), SWITCH, "a car 30 m before red");
        assert_eq!(decide(&obs(&[(1, 4)], Light::HorizontalGreen)), KEEP, "a car 40 m before red does not count yet");
        assert_eq!(decide(&obs(&[(1, 0), (0, 2)], Light::HorizontalGreen)), KEEP, "a car 20 m before green holds it");
        assert_eq!(decide(&obs(&[(1, 0), (0, 3)], Light::HorizontalGreen)), SWITCH, "a car 30 m before green does not");
        assert_eq!(decide(&obs(&[(0, 0), (2, 0)], Light::VerticalGreen)), SWITCH);
        assert_eq!(decide(&obs(&[], Light::VerticalGreen)), KEEP);
        assert_eq!(decide(&obs(&[(0, 0)], Light::VerticalYellow)), KEEP);
    }
}
