//! Where a period of training is cut, so that a kill costs little: at updates of the policies, some minutes apart.
//!
//! Results do not depend on where that is: at a cut, the state of all agents goes on exactly, as between two periods.

use std::time::{Duration, Instant};

use crate::config::{Config, Period, Simulator};
use dials_core::domain::Domain;

/// Factor by which the first guess may be too low: it was more than 5 on a busy machine with a large observation. If the factor is too
/// high, the first part is one update, and costs one checkpoint more; if it is too low, a stop waits for the part.
const CAUTION: f64 = 100.0;

/// How long a timestep takes, and how long training may go on without a checkpoint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pace {
    every_s: f64,
    /// Wall time of a timestep of all agents.
    timestep_s: f64,
    /// When the last checkpoint was written, or training began.
    saved: Instant,
}

impl Pace {
    /// Guesses from the domain's rough costs, as if one core did all.
    pub(crate) fn guess(config: &Config, domain: &dyn Domain) -> Pace {
        let costs = domain.rough_costs();
        let of_agent_s = if config.simulator == Simulator::Global { costs.training_on_gs_s } else { costs.training_s };
        Pace {
            every_s: 60.0 * config.checkpoints.every_minutes,
            timestep_s: CAUTION * of_agent_s * domain.agents() as f64,
            saved: Instant::now(),
        }
    }

    pub(crate) fn saved(&mut self) {
        self.saved = Instant::now();
    }

    /// Returns whether half of the time without a checkpoint is over.
    pub(crate) fn is_half_over(&self) -> bool {
        self.saved.elapsed().as_secs_f64() > self.every_s / 2.0
    }

    /// Notes how long the last timesteps took.
    pub(crate) fn note(&mut self, timesteps: u64, time: Duration) {
        if timesteps > 0 {
            self.timestep_s = time.as_secs_f64() / timesteps as f64;
        }
    }

    /// Returns the rest of a period from this step on, or its first part if the rest takes too long. Parts end at updates.
    pub(crate) fn next(&self, period: &Period, steps: u64, config: &Config) -> Period {
        let rest = Period { start: period.start.max(steps), ..*period };
        let last = config.update_at_or_after(period.end);
        let left_s = self.every_s - self.saved.elapsed().as_secs_f64();
        let affordable = (left_s / self.timestep_s).clamp(1.0, 1e15) as u64;
        let cut = config.update_at_or_after(steps + 1).max(config.update_at_or_before(steps + affordable));
        if cut < last { Period { end: cut, average: false, ..rest } } else { rest }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::AipTraining;

    fn period(start: u64, end: u64) -> Period {
        Period { start, end, evaluate: true, train_aips: AipTraining::No, average: true }
    }

    #[test]
    fn a_period_is_cut_at_the_last_update_before_the_time_is_over_and_after_one_update_at_least() {
        let mut config = Config::default();
        config.ppo.memory = 64;
        // The time that the test itself takes does not matter here: at most a second.
        let mut pace = Pace { every_s: 11.0, timestep_s: 1.0, saved: Instant::now() };
        // A timestep takes 0.1 s: 100 to 110 of them fit, and an update is at 64.
        pace.note(1000, Duration::from_secs(100));
        let next = |pace: &Pace, steps| pace.next(&period(0, 300), steps, &config);
        assert_eq!(next(&pace, 0), Period { end: 64, average: false, ..period(0, 300) });
        // From 64 on until 164 or a little more, the update at 128.
        assert_eq!(next(&pace, 64), Period { start: 64, end: 128, average: false, ..period(0, 300) });
        // The last update of the period is at 320. From 256 on only that is left.
        assert_eq!(next(&pace, 256), Period { start: 256, ..period(0, 300) });
        pace.note(1, Duration::from_secs(60));
        assert_eq!(next(&pace, 128).end, 192, "one update, however long it takes");
        pace.note(1_000_000, Duration::from_secs(1));
        assert_eq!(next(&pace, 0), period(0, 300));
    }
}
