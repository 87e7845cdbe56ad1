//! Training on the global simulator: the baseline that DIALS is compared with.
//!
//! DEVIATION 6: every agent has its own policy and bootstraps with its own value. The authors' code shares one policy
//! object among the agents and bootstraps all of them with the last agent's observation, so its GS curves are not a fair
//! baseline.

use super::environment::{Environment, Experience};
use super::timed::Timed;
use crate::base::{Seed, Stopwatch};
use crate::domain::{Action, GlobalSimulator, Percept, Result};

/// The GS as an [`Environment`]: all regions end together, and the next episode has the next seed.
pub struct GlobalEnvironment {
    simulator: Timed<dyn GlobalSimulator>,
    episodes: Seed,
    episode: usize,
    age: usize,
    percept: Percept,
    experience: Experience,
}

impl GlobalEnvironment {
    /// Begins with episode 0 of the stream `episodes`.
    pub fn begin(simulator: Box<dyn GlobalSimulator>, episodes: Seed) -> Result<Self> {
        let mut simulator = Timed::new(simulator);
        let experience = Experience::new(simulator.agents(), simulator.spec());
        let percept = simulator.reset(episodes.for_episode(0))?.clone();
        Ok(GlobalEnvironment { simulator, episodes, episode: 0, age: 0, percept, experience })
    }
}

impl Environment for GlobalEnvironment {
    fn rows(&self) -> usize {
        self.simulator.agents()
    }

    fn percept(&self) -> &Percept {
        &self.percept
    }

    fn step(&mut self, actions: &[Action], watch: &mut Stopwatch) -> Result<&Experience> {
        let horizon = self.simulator.spec().horizon;
        let transition = self.simulator.step(actions)?;
        self.age += 1;
        let end = self.age == horizon;
        self.experience.rewards.copy_from_slice(&transition.rewards);
        self.experience.ends.fill(end);
        let percept = if end {
            self.experience.last_obs.copy_from(&transition.percept.obs);
            (self.age, self.episode) = (0, self.episode + 1);
            let next = self.episodes.for_episode(self.episode);
            self.simulator.reset(next)?
        } else {
            &transition.percept
        };
        self.percept.obs.copy_from(&percept.obs);
        self.percept.d_set.copy_from(&percept.d_set);
        watch.add(&self.simulator.take_watch());
        Ok(&self.experience)
    }
}
