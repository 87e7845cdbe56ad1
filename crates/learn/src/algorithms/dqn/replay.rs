//! The replay: the last decisions of every agent, and what they brought.

use rand::Rng;

use dials_core::base::{Dice, Ragged};
use dials_core::domain::{Action, RegionSpec};

/// The decisions of some agents, each in a ring of its own. All rings are equally full.
///
/// A decision is a row of numbers, as checkpoints hold it: observation, next observation, action, reward, discount of
/// what follows (0 if nothing does), priority, and which actions are allowed next, if the kind has masks.
pub(super) struct Replay {
    agents: usize,
    capacity: usize,
    obs: usize,
    /// Number of values of a decision.
    width: usize,
    /// `[agents, capacity, width]`
    values: Vec<f32>,
    /// Number of decisions so far.
    written: u64,
}

/// A decision, and what it brought. `Mask`: which actions are allowed next, if there are masks.
pub(super) struct Decision<'a, Mask> {
    pub(crate) obs: &'a [f32],
    pub(crate) action: Action,
    pub(crate) reward: f32,
    pub(crate) next_obs: &'a [f32],
    /// Discount of what follows; 0 if nothing does.
    pub(crate) discount: f32,
    pub(crate) next_mask: Mask,
}

/// Returns the number of values of a decision.
pub(super) fn width(spec: &RegionSpec) -> usize {
    2 * spec.obs_dim + 4 + if spec.masks { spec.n_actions } else { 0 }
}

impl Replay {
    pub(super) fn new(agents: usize, capacity: usize, spec: &RegionSpec) -> Replay {
        let width = width(spec);
        Replay { agents, capacity, obs: spec.obs_dim, width, values: vec![0.0; agents * capacity * width], written: 0 }
    }

    /// Returns the number of decisions of an agent that it holds.
    pub(super) fn len(&self) -> usize {
        self.written.min(self.capacity as u64) as usize
    }

    fn row(&self, agent: usize, slot: usize) -> &[f32] {
        let at = (agent * self.capacity + slot) * self.width;
        &self.values[at..][..self.width]
    }

    fn row_mut(&mut self, agent: usize, slot: usize) -> &mut [f32] {
        let at = (agent * self.capacity + slot) * self.width;
        &mut self.values[at..][..self.width]
    }

    /// Remembers one decision of every agent, in place of the oldest one. `priority`: that of a new decision.
    pub(super) fn push<'a>(
        &mut self,
        decisions: impl Iterator<Item = Decision<'a, Option<&'a [bool]>>>,
        priority: f32,
    ) {
        let slot = (self.written % self.capacity as u64) as usize;
        let obs = self.obs;
        for (agent, decision) in decisions.enumerate() {
            let row = self.row_mut(agent, slot);
            row[..obs].copy_from_slice(decision.obs);
            row[obs..2 * obs].copy_from_slice(decision.next_obs);
            let rest = &mut row[2 * obs..];
            rest[..4].copy_from_slice(&[f32::from(decision.action), decision.reward, decision.discount, priority]);
            if let Some(mask) = decision.next_mask {
                rest[4..].iter_mut().zip(mask).for_each(|(value, &allowed)| *value = f32::from(u8::from(allowed)));
            }
        }
        self.written += 1;
    }

    /// Returns a decision; `next_mask`: 1 where an action is allowed, empty without masks.
    pub(super) fn read(&self, agent: usize, slot: usize) -> Decision<'_, &[f32]> {
        let (both, rest) = self.row(agent, slot).split_at(2 * self.obs);
        let (obs, next_obs) = both.split_at(self.obs);
        Decision { obs, action: rest[0] as Action, reward: rest[1], next_obs, discount: rest[2], next_mask: &rest[4..] }
    }

    fn priority_at(&self) -> usize {
        2 * self.obs + 3
    }

    pub(super) fn set_priority(&mut self, agent: usize, slot: usize, priority: f32) {
        let at = self.priority_at();
        self.row_mut(agent, slot)[at] = priority;
    }

    pub(super) fn draw(&self, count: usize, dice: &mut Dice) -> Vec<usize> {
        (0..count).map(|_| dice.random_range(0..self.len())).collect()
    }

    /// Draws slots by their priorities, and returns the probability of each.
    pub(super) fn draw_by_priority(&self, agent: usize, count: usize, dice: &mut Dice) -> (Vec<usize>, Vec<f64>) {
        let mut sum = 0.0;
        let at = self.priority_at();
        let sums: Vec<f64> = (0..self.len())
            .map(|slot| {
                sum += f64::from(self.row(agent, slot)[at]);
                sum
            })
            .collect();
        let draw = |_| {
            let place = dice.random::<f64>() * sum;
            let slot = sums.partition_point(|&until| until <= place).min(sums.len() - 1);
            let before = if slot == 0 { 0.0 } else { sums[slot - 1] };
            (slot, (sums[slot] - before) / sum)
        };
        (0..count).map(draw).unzip()
    }

    pub(super) fn table(&self) -> Ragged<f32> {
        let width = self.len() * self.width;
        let ring = self.capacity * self.width;
        let mut table = Ragged::default();
        (0..self.agents).for_each(|agent| table.push(&self.values[agent * ring..][..width]));
        table
    }

    /// Continues with what such a table holds. `written`: number of decisions so far.
    pub(super) fn load(&mut self, table: &Ragged<f32>, written: u64) {
        let ring = self.capacity * self.width;
        for (agent, row) in table.iter().enumerate() {
            self.values[agent * ring..][..row.len()].copy_from_slice(row);
        }
        self.written = written;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::region;
    use dials_core::base::Seed;
    use dials_core::domain::SourceSpec;

    /// Remembers the decisions 0, 1, 2, ... of two agents.
    fn filled(count: u8, capacity: usize) -> Replay {
        let spec = RegionSpec { n_actions: 3, masks: true, ..region(2, 1, SourceSpec::bits(1), 8) };
        let mut replay = Replay::new(2, capacity, &spec);
        for step in 0..count {
            let values = [0, 100].map(|agent| [f32::from(agent + step), 0.5]);
            let decisions = values.iter().map(|values| Decision {
                obs: values,
                action: step % 3,
                reward: -values[0],
                next_obs: &[7.0, 8.0],
                discount: 0.9,
                next_mask: Some(&[true, false, true][..]),
            });
            replay.push(decisions, f32::from(step + 1));
        }
        replay
    }

    #[test]
    fn the_oldest_decision_gives_way_to_the_newest() {
        let replay = filled(5, 3);
        let firsts = |agent| (0..3).map(|slot| replay.read(agent, slot).obs[0]).collect::<Vec<_>>();
        assert_eq!((firsts(0), firsts(1)), (vec![3.0, 4.0, 2.0], vec![103.0, 104.0, 102.0]));
        let newest = replay.read(1, 1);
        assert_eq!((newest.action, newest.reward, newest.discount), (1, -104.0, 0.9));
        assert_eq!((newest.next_obs, newest.next_mask), ([7.0, 8.0].as_slice(), [1.0, 0.0, 1.0].as_slice()));
    }

    #[test]
    fn decisions_are_drawn_as_often_as_their_priorities_say() {
        let mut replay = filled(3, 3);
        replay.set_priority(0, 1, 7.0);
        let mut dice = Seed::new(3).dice();
        // Priorities 1, 7, 3 of 11.
        let (slots, probabilities) = replay.draw_by_priority(0, 20_000, &mut dice);
        let count = |slot| slots.iter().filter(|&&drawn| drawn == slot).count() as f64 / 20_000.0;
        // Standard deviations: sqrt(p (1 - p) / 20000), at most 0.0035.
        for (slot, expected) in [1.0 / 11.0, 7.0 / 11.0, 3.0 / 11.0].into_iter().enumerate() {
            assert!((count(slot) - expected).abs() < 0.014, "{slot}: {}", count(slot));
        }
        assert!(slots.iter().zip(probabilities).all(|(&slot, p)| (p - [1.0, 7.0, 3.0][slot] / 11.0).abs() < 1e-6));
    }
}
