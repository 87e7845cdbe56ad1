//! Algorithm 3: trajectories of the influence-augmented local simulators (IALS).

use super::environment::{Environment, Experience};
use super::timed::Timed;
use crate::base::{Dice, Phase, Rows, Stopwatch};
use crate::domain::{Action, LocalSimulator, Percept, Result};
use crate::influence::InfluencePredictor;

/// Local simulators and the influence predictor that drives them, every row with an episode of its own.
pub struct Ials<'a> {
    simulator: Timed<dyn LocalSimulator>,
    predictor: &'a mut dyn InfluencePredictor,
    dice: Vec<Dice>,
    /// Steps into the episode, per row.
    ages: Vec<usize>,
    percept: Percept,
    sources: Rows<u8>,
    experience: Experience,
}

impl<'a> Ials<'a> {
    /// Begins an episode in every row.
    ///
    /// `dice`: one per row, for its influence sources. `copies`: rows of one agent. With `stagger`, the first episode
    /// of copy c begins as if `c / copies` of the horizon had passed, so that the copies of an agent later end at
    /// different times and its memory holds all parts of an episode.
    pub fn begin(
        simulator: Box<dyn LocalSimulator>,
        predictor: &'a mut dyn InfluencePredictor,
        dice: Vec<Dice>,
        copies: usize,
        stagger: bool,
    ) -> Result<Self> {
        let mut simulator = Timed::new(simulator);
        let (spec, rows) = (simulator.spec().clone(), simulator.rows());
        let all: Vec<usize> = (0..rows).collect();
        let percept = simulator.reset(&all)?.clone();
        predictor.begin(rows);
        let age = |row: usize| if stagger { row % copies * spec.horizon / copies } else { 0 };
        Ok(Ials {
            predictor,
            dice,
            ages: (0..rows).map(age).collect(),
            percept,
            sources: Rows::new(rows, spec.sources.count()),
            experience: Experience::new(rows, &spec),
            simulator,
        })
    }

    /// Totals of the local simulators since they began.
    pub fn counters(&self) -> Vec<(&'static str, u64)> {
        self.simulator.counters()
    }
}

impl Environment for Ials<'_> {
    fn rows(&self) -> usize {
        self.simulator.rows()
    }

    fn percept(&self) -> &Percept {
        &self.percept
    }

    fn step(&mut self, actions: &[Action], watch: &mut Stopwatch) -> Result<&Experience> {
        // u_t ~ I(. | l_t): the AIP sees the d-set from before the step.
        watch.time(Phase::AipSampling, || {
            self.predictor.sample(&self.percept.d_set, &mut self.dice, &mut self.sources);
        });
        // x_{t+1} ~ T(. | x_t, a_t, u_t)
        let horizon = self.simulator.spec().horizon;
        let transition = self.simulator.step(actions, &self.sources)?;
        self.experience.rewards.copy_from_slice(&transition.rewards);
        let mut over = Vec::new();
        for (row, (age, end)) in self.ages.iter_mut().zip(&mut self.experience.ends).enumerate() {
            *age += 1;
            *end = *age == horizon;
            if *end {
                *age = 0;
                over.push(row);
                self.experience.last_obs.row_mut(row).copy_from_slice(transition.percept.obs.row(row));
            }
        }
        let percept = if over.is_empty() {
            &transition.percept
        } else {
            self.predictor.forget(&over);
            self.simulator.reset(&over)?
        };
        self.percept.obs.copy_from(&percept.obs);
        self.percept.d_set.copy_from(&percept.d_set);
        watch.add(&self.simulator.take_watch());
        Ok(&self.experience)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{AgentId, Seed};
    use crate::domain::Domain;
    use crate::domain::toy::Coins;

    /// Predicts a constant and writes down what it was shown.
    struct Spy {
        seen: Vec<Rows<f32>>,
        forgotten: Vec<Vec<usize>>,
    }

    impl InfluencePredictor for Spy {
        fn begin(&mut self, rows: usize) {
            self.forget(&(0..rows).collect::<Vec<_>>());
        }

        fn forget(&mut self, rows: &[usize]) {
            self.forgotten.push(rows.to_vec());
        }

        fn sample(&mut self, d_set: &Rows<f32>, _dice: &mut [Dice], sources: &mut Rows<u8>) {
            self.seen.push(d_set.clone());
            sources.fill(1);
        }
    }

    fn run(stagger: bool, steps: usize) -> (Spy, Vec<Vec<bool>>, Vec<Rows<f32>>) {
        let mut spy = Spy { seen: vec![], forgotten: vec![] };
        let simulator = Coins::new(4).local_simulator(&[AgentId(0)], 2, Seed::new(0)).unwrap();
        let mut ials = Ials::begin(simulator, &mut spy, vec![Seed::new(0).dice(); 2], 2, stagger).unwrap();
        let (mut ends, mut shown) = (Vec::new(), Vec::new());
        for _ in 0..steps {
            ends.push(ials.step(&[1, 1], &mut Stopwatch::default()).unwrap().ends.clone());
            shown.push(ials.percept().obs.clone());
        }
        (spy, ends, shown)
    }

    #[test]
    fn the_predictor_sees_the_d_set_from_before_the_step_it_drives() {
        let (spy, _, shown) = run(false, 3);
        assert_eq!(spy.seen[0].as_slice(), [0.0; 4], "an episode begins with both coins at 0");
        assert_eq!(spy.seen[1], shown[0]);
        assert_eq!(shown[0].as_slice(), [1.0; 4], "action 1 and source 1 lay both coins as 1");
    }

    #[test]
    fn copies_in_step_end_together_and_begin_again() {
        let (spy, ends, shown) = run(false, 5);
        assert_eq!(ends, [[false; 2], [false; 2], [false; 2], [true; 2], [false; 2]]);
        assert_eq!(spy.forgotten, [[0, 1], [0, 1]]);
        assert_eq!(shown[3].as_slice(), [0.0; 4], "after the end the next episode is shown");
    }

    #[test]
    fn staggered_copies_end_at_different_times() {
        let (spy, ends, _) = run(true, 6);
        let copy = |copy: usize| ends.iter().map(|ends| ends[copy]).collect::<Vec<_>>();
        assert_eq!(copy(0), [false, false, false, true, false, false]);
        assert_eq!(copy(1), [false, true, false, false, false, true]);
        assert_eq!(spy.forgotten, [vec![0, 1], vec![1], vec![0], vec![1]]);
    }
}
