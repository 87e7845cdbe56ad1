//! The phases of a light: which sides have green, and in which order the phases follow each other.

use crate::side::Side;
use libsumo::SignalState;

/// The state that a light shows. The order is that of the one-hot light in an observation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Light {
    HorizontalGreen,
    HorizontalYellow,
    VerticalYellow,
    VerticalGreen,
}

impl Light {
    pub const ALL: [Light; 4] =
        [Light::HorizontalGreen, Light::HorizontalYellow, Light::VerticalYellow, Light::VerticalGreen];

    pub(crate) const CYCLE: [Light; 4] =
        [Light::VerticalGreen, Light::VerticalYellow, Light::HorizontalGreen, Light::HorizontalYellow];

    /// Returns SUMO's letters, one per link, in the order of [`Side::LINK_ORDER`].
    pub fn letters(self) -> String {
        Side::LINK_ORDER.into_iter().map(|from| self.letter(from)).collect()
    }

    fn letter(self, from: Side) -> char {
        match (self, from.is_vertical()) {
            (Light::VerticalGreen, true) | (Light::HorizontalGreen, false) => 'G',
            (Light::VerticalYellow, true) | (Light::HorizontalYellow, false) => 'y',
            _ => 'r',
        }
    }

    pub fn state(self) -> SignalState {
        SignalState::new(self.letters()).expect("the letters are SUMO's")
    }

    pub fn is_green(self) -> bool {
        matches!(self, Light::HorizontalGreen | Light::VerticalGreen)
    }

    /// Returns the sides whose cars have green, then the sides whose cars have red; `None` during yellow.
    pub fn green_and_red(self) -> Option<[[Side; 2]; 2]> {
        match self {
            Light::HorizontalGreen => Some([Side::HORIZONTAL, Side::VERTICAL]),
            Light::VerticalGreen => Some([Side::VERTICAL, Side::HORIZONTAL]),
            Light::HorizontalYellow | Light::VerticalYellow => None,
        }
    }

    pub fn next(self) -> Light {
        let place = Light::CYCLE.iter().position(|&light| light == self).expect("every light is in the cycle");
        Light::CYCLE[(place + 1) % Light::CYCLE.len()]
    }
}
