//! The light of one intersection under an agent's control: green, three steps of yellow, the other green.

use super::agents::phases::Light;
use crate::domain::Action;

/// Leave the light as it is.
pub const KEEP: Action = 0;
/// Give the other direction green, after yellow.
pub const SWITCH: Action = 1;

/// Number of steps of yellow.
pub const YELLOW_STEPS: u8 = 3;

/// A light and how long it has been yellow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signal {
    light: Light,
    yellow_steps: u8,
}

impl Signal {
    /// Returns the light at the beginning of an episode.
    ///
    /// DEVIATION 2: every episode begins with vertical green under the agent's control. In the authors' code a light
    /// runs its program until the agent's first switch.
    pub fn at_the_beginning() -> Self {
        Signal { light: Light::VerticalGreen, yellow_steps: 0 }
    }

    pub fn light(self) -> Light {
        self.light
    }

    /// Sets what the light shows in the step that follows the action. Yellow lasts three steps and ignores actions.
    pub fn act(&mut self, action: Action) {
        if self.light.is_green() {
            if action == SWITCH {
                *self = Signal { light: self.light.next(), yellow_steps: 1 };
            }
        } else if self.yellow_steps < YELLOW_STEPS {
            self.yellow_steps += 1;
        } else {
            *self = Signal { light: self.light.next(), yellow_steps: 0 };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Light::*;

    fn shown(actions: &[Action]) -> Vec<Light> {
        let mut signal = Signal::at_the_beginning();
        actions
            .iter()
            .map(|&action| {
                signal.act(action);
                signal.light()
            })
            .collect()
    }

    #[test]
    fn a_switch_shows_yellow_at_once_and_for_three_steps() {
        assert_eq!(
            shown(&[KEEP, SWITCH, KEEP, KEEP, KEEP, KEEP]),
            [VerticalGreen, VerticalYellow, VerticalYellow, VerticalYellow, HorizontalGreen, HorizontalGreen]
        );
    }

    #[test]
    fn actions_during_yellow_are_ignored_and_green_lasts_at_least_one_step() {
        let always = shown(&[SWITCH; 16]);
        let cycle = [
            VerticalYellow,
            VerticalYellow,
            VerticalYellow,
            HorizontalGreen,
            HorizontalYellow,
            HorizontalYellow,
            HorizontalYellow,
            VerticalGreen,
        ];
        assert_eq!(always, [cycle, cycle].concat(), "switching always has a period of 8 steps");
    }
}
