//! A light under control: a green, what is shown between two greens, the next green.

use super::agents::phase_plan::{PhasePlan, Shown};
use super::agents::red_limits::RedLimits;
use dials_core::domain::Action;
use libsumo::SignalState;

/// Leave the light as it is. An action of the paper's grids.
pub const KEEP: Action = 0;
/// Give the other direction green, after yellow. An action of the paper's grids.
pub const SWITCH: Action = 1;

pub(crate) const YELLOW_STEPS: u8 = 3;

/// A light and how long it has shown what it shows. A step is a second.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Signal {
    shown: Shown,
    /// Number of steps since this green began or the last one ended.
    steps: u32,
    switched: bool,
    /// Number of steps since each link with a longest red had green. Nobody has waited when an episode begins.
    red: Vec<u32>,
}

impl Signal {
    /// Returns the light at the beginning of an episode: the first green, which may end at once.
    ///
    /// DEVIATION 2: every episode begins with vertical green under the agent's control. In the authors' code a light
    /// runs its program until the agent's first switch; the plan may ask for that.
    pub(crate) fn at_the_beginning(plan: &PhasePlan) -> Self {
        let red = vec![0; plan.red_limits().map_or(0, RedLimits::links)];
        Signal { shown: Shown::Green(0), steps: plan.min_green_steps()[0], switched: false, red }
    }

    pub(crate) fn shown(&self) -> Shown {
        self.shown
    }

    pub(crate) fn state<'a>(&self, plan: &'a PhasePlan) -> &'a SignalState {
        let Shown::Between { from, to } = self.shown else { return &plan.greens()[self.shown.target()] };
        let mut left = self.steps;
        for interval in plan.clearing(from, to) {
            if left <= interval.steps {
                return &interval.state;
            }
            left -= interval.steps;
        }
        unreachable!("a light is between greens for as long as its intervals last")
    }

    /// Returns whether the light may do in the next step what an action for the green `to` asks: go there, or keep it.
    ///
    /// A light that cannot leave its green yet may only keep it. It must leave a green whose longest time is over, and it
    /// goes nowhere from where a link would be red for too long.
    pub(crate) fn allows(&self, plan: &PhasePlan, to: usize) -> bool {
        match self.shown {
            Shown::Green(green) => self.may(plan, green, to),
            Shown::Between { to: target, .. } => to == target,
        }
    }

    /// Returns whether the limits of the plan let a light go from its green to `to`, or keep it for a step more.
    fn may(&self, plan: &PhasePlan, green: usize, to: usize) -> bool {
        if to != green {
            let is_old_enough = self.steps >= plan.least_before(green, to);
            return is_old_enough && plan.red_limits().is_none_or(|limits| limits.may_go(plan, green, to, &self.red));
        }
        let longest = plan.longest_stay(green).is_none_or(|most| self.steps < most);
        longest && plan.red_limits().is_none_or(|it| it.may_stay(plan, green, self.steps + 1, &self.red))
    }

    /// Returns where a light goes that is asked for the green `asked`; `green`: it stays.
    ///
    /// A light that must not do what it is asked stays if it may. If not, it goes to the green whose links have waited
    /// longest, of those to which it may; of several to the first one in the order of the program.
    fn next_green(&self, plan: &PhasePlan, green: usize, asked: usize) -> usize {
        if let Some(allowed) = [asked, green].into_iter().find(|&to| self.may(plan, green, to)) {
            return allowed;
        }
        let count = plan.greens().len();
        let others = if plan.keeps_order() { 1..2 } else { 1..count };
        let allowed = others.map(|steps| (green + steps) % count).filter(|&to| self.may(plan, green, to));
        let waited = |to: &usize| plan.red_limits().map_or(0, |limits| limits.longest_wait(*to, &self.red));
        // The last of equals would win.
        let longest = allowed.collect::<Vec<_>>().into_iter().rev().max_by_key(waited);
        debug_assert!(longest.is_some(), "where a light must leave, the rota goes on");
        longest.unwrap_or(green)
    }

    /// Sets what the light shows in the step that follows the action. Between two greens, and while a green is too
    /// short, it ignores actions. It also ignores a green that it does not have. A light that goes to its next green by
    /// itself does so no more in this episode once it has obeyed. The limits of the plan hold whatever the action is.
    pub(crate) fn act(&mut self, plan: &PhasePlan, action: Action) {
        match self.shown {
            Shown::Green(green) => {
                let asked = Some(plan.asked_for(self.shown, action)).filter(|&asked| asked < plan.greens().len());
                let next = self.next_green(plan, green, asked.unwrap_or(green));
                self.steps += 1;
                if next != green {
                    self.switched = true;
                    self.leave(plan, green, next);
                } else if !self.switched && plan.own_green_steps.is_some_and(|own| self.steps > own) {
                    self.leave(plan, green, plan.next(green));
                }
            }
            Shown::Between { from, to } => {
                self.steps += 1;
                if self.steps > plan.clearing_steps(from, to) {
                    (self.shown, self.steps) = (Shown::Green(to), 1);
                }
            }
        }
        if let Some(limits) = plan.red_limits() {
            let state = self.state(plan);
            limits.note(state, &mut self.red);
        }
    }

    fn leave(&mut self, plan: &PhasePlan, from: usize, to: usize) {
        let cleared_at_once = plan.clearing(from, to).is_empty();
        self.shown = if cleared_at_once { Shown::Green(to) } else { Shown::Between { from, to } };
        self.steps = 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::phase_plan::{Choice, Interval};

    fn state(letters: &str) -> SignalState {
        SignalState::new(letters).unwrap()
    }

    fn interval(letters: &str, steps: u32) -> Interval {
        Interval { state: state(letters), steps }
    }

    fn shown(plan: &PhasePlan, actions: &[Action]) -> Vec<String> {
        let mut signal = Signal::at_the_beginning(plan);
        let act = |&action: &Action| {
            signal.act(plan, action);
            signal.state(plan).to_string()
        };
        actions.iter().map(act).collect()
    }

    fn paper() -> PhasePlan {
        let yellow = |from, _| vec![interval(["yr", "ry"][from], YELLOW_STEPS.into())];
        PhasePlan::new(vec![state("Gr"), state("rG")], Choice::KeepOrSwitch, 1, yellow)
    }

    #[test]
    fn a_light_goes_to_its_next_green_by_itself_until_it_is_switched() {
        let mut plan = paper();
        plan.own_green_steps = Some(5);
        // The beginning counts as the first step. A switch during its own yellow is none. After a true one green lasts.
        let mut actions = vec![KEEP; 30];
        (actions[4], actions[9]) = (SWITCH, SWITCH);
        let shown = shown(&plan, &actions);
        assert_eq!(shown[..9], ["Gr", "Gr", "Gr", "Gr", "yr", "yr", "yr", "rG", "rG"]);
        assert_eq!(shown[9..12], ["ry"; 3]);
        assert_eq!(shown[12..], ["Gr"; 18]);
    }

    #[test]
    fn a_target_is_reached_through_its_own_yellow_and_all_red() {
        // From 0 to 1 two steps of yellow and one of all red; from 1 to 2 nothing has to be cleared.
        let clearing = |from, to| match (from, to) {
            (1, 2) => Vec::new(),
            _ => vec![interval("yyy", 2), interval("rrr", 1)],
        };
        let greens = ["Grr", "rGr", "rGG"].map(state).to_vec();
        let plan = PhasePlan::new(greens, Choice::Target, 3, clearing);
        let shown = shown(&plan, &[1, 2, 0, 1, 2, 2, 2, 2, 2, 9]);
        assert_eq!(shown, ["yyy", "yyy", "rrr", "rGr", "rGr", "rGr", "rGG", "rGG", "rGG", "rGG"]);
        let mut signal = Signal::at_the_beginning(&plan);
        assert!(signal.allows(&plan, 0) && signal.allows(&plan, 2));
        signal.act(&plan, 1);
        assert_eq!([0, 1, 2].map(|to| signal.allows(&plan, to)), [false, true, false], "it is yellow");
    }
}
