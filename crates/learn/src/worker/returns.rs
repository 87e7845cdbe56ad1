//! Returns of the episodes that end in a period of training.

use crate::environments::Experience;
use crate::state::stream::{AgentStream, rows_of, rows_of_mut};

/// Returns of the episodes that ended in this period, per agent.
///
/// First episodes that were cut short by staggering do not count.
#[derive(Clone, Debug)]
pub(super) struct EpisodeReturns {
    horizon: usize,
    /// Sum of rewards and number of steps since the episode began, per row.
    running: Vec<(f64, usize)>,
    /// Sum of returns and number of episodes, per agent.
    finished: Vec<(f64, u64)>,
}

impl EpisodeReturns {
    /// Continues the current episodes. `horizon`: number of steps of a whole episode.
    pub(super) fn resume(streams: &[AgentStream], horizon: usize) -> Self {
        let running = rows_of(streams).map(|row| (row.rewards, row.trail.steps()));
        EpisodeReturns { horizon, running: running.collect(), finished: vec![(0.0, 0); streams.len()] }
    }

    pub(super) fn add(&mut self, experience: &Experience) {
        let copies = self.running.len() / self.finished.len();
        for (row, (sum, steps)) in self.running.iter_mut().enumerate() {
            *sum += f64::from(experience.rewards[row]);
            *steps += 1;
            if experience.ends[row] {
                if *steps == self.horizon {
                    let (returns, episodes) = &mut self.finished[row / copies];
                    *returns += *sum;
                    *episodes += 1;
                }
                (*sum, *steps) = (0.0, 0);
            }
        }
    }

    /// Returns the mean return and the number of episodes, per agent. If no episode ended: `None` and 0.
    pub(super) fn means(&self) -> Vec<(Option<f64>, u64)> {
        let mean = |&(sum, episodes): &(f64, u64)| ((episodes > 0).then(|| sum / episodes as f64), episodes);
        self.finished.iter().map(mean).collect()
    }

    /// Writes the sums of the unfinished episodes to the streams.
    pub(super) fn leave(&self, streams: &mut [AgentStream]) {
        self.running.iter().zip(rows_of_mut(streams)).for_each(|((rewards, _), stream)| stream.rewards = *rewards);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::stream::RowStream;
    use dials_core::base::{Rows, Seed};

    #[test]
    fn only_whole_episodes_count_as_returns() {
        let row = || RowStream::begin(Seed::new(0).dice());
        let mut streams = [AgentStream { rows: vec![row()] }, AgentStream { rows: vec![row()] }];
        let mut returns = EpisodeReturns::resume(&streams, 3);
        let experience = |ends: [bool; 2]| Experience {
            rewards: vec![1.5, 0.25],
            ends: ends.to_vec(),
            last_obs: Rows::new(2, 1),
            last_masks: None,
        };
        // The first agent ends after two steps and then after three, the second one never.
        for ends in [false, true, false, false, true, false] {
            returns.add(&experience([ends, false]));
        }
        assert_eq!(returns.means(), [(Some(4.5), 1), (None, 0)]);
        returns.leave(&mut streams);
        assert_eq!([streams[0].rows[0].rewards, streams[1].rows[0].rewards], [1.5, 1.5]);
    }
}
