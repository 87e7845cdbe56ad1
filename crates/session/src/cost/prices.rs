//! From the price of each kind of work to the cost of a run.

use std::ops::{Add, Mul};

use super::Workload;

/// Price of each kind of work. `T`: a number, or several numbers that are added up separately.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Prices<T> {
    /// Price of a timestep of an agent in training.
    pub(crate) step: T,
    /// Price of a timestep of an agent that is replayed to continue after a period.
    pub(crate) retraced_step: T,
    /// Price of a period, whatever its length.
    pub(crate) period: T,
    /// Price of an evaluation, with all its episodes.
    pub(crate) evaluation: T,
    /// Price of the evaluation at the end.
    pub(crate) final_evaluation: T,
    /// Price of a collection of datasets for all agents.
    pub(crate) collection: T,
    /// Price of a training of all AIPs (approximate influence predictors).
    pub(crate) aip_training: T,
}

/// Cost of a run, by activity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RunCost<T> {
    pub(crate) training: T,
    pub(crate) evaluation: T,
    pub(crate) collection: T,
    pub(crate) aip_training: T,
}

impl<T: Copy + Add<Output = T> + Mul<f64, Output = T>> Prices<T> {
    /// Returns the cost of a run.
    pub(crate) fn of_run(&self, work: &Workload) -> RunCost<T> {
        let retrainings = work.retrainings as f64;
        RunCost {
            training: self.step * work.agent_steps()
                + self.retraced_step * work.retraced_steps()
                + self.period * work.periods as f64,
            evaluation: self.evaluation * work.evaluations as f64 + self.final_evaluation,
            collection: self.collection * retrainings,
            aip_training: self.aip_training * retrainings,
        }
    }
}

impl<T: Add<Output = T>> RunCost<T> {
    /// Returns the total.
    pub(crate) fn sum(self) -> T {
        self.training + self.evaluation + self.collection + self.aip_training
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_is_paid_as_often_as_it_happens() {
        let work = Workload {
            agents: 2,
            steps: 100,
            horizon: 10,
            training_horizon: 10,
            copies: 1,
            periods: 5,
            evaluations: 3,
            evaluation_episodes: 7,
            final_episodes: 9,
            retrainings: 4,
            dataset_episodes: 1,
            epochs: 1,
        };
        let prices = Prices {
            step: 1.0,
            retraced_step: 10.0,
            period: 1000.0,
            evaluation: 2.0,
            final_evaluation: 0.5,
            collection: 3.0,
            aip_training: 5.0,
        };
        // 200 steps, 4 x 20 / 2 = 40 retraced ones and 5 periods; 3 evaluations and the last one; 4 retrainings.
        let cost = prices.of_run(&work);
        assert_eq!(cost, RunCost { training: 5600.0, evaluation: 6.5, collection: 12.0, aip_training: 20.0 });
        assert_eq!(cost.sum(), 5638.5);
    }
}
