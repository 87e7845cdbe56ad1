//! Training on the global simulator: the baseline that DIALS is compared with.
//!
//! DEVIATION 6: every agent has its own policy and bootstraps with its own value. The authors' code shares one policy
//! object among the agents and bootstraps all of them with the last agent's observation, so its GS curves are not a fair
//! baseline.

use anyhow::ensure;

use super::environment::{Environment, Experience};
use super::stream::{AgentStream, Trail, fingerprint, longest, rows_of, rows_of_mut};
use super::timed::Timed;
use crate::base::{Seed, Stopwatch};
use crate::domain::{Action, GlobalSimulator, Percept, Result};

/// The GS as an [`Environment`]: all regions end together, and the next episode has the next seed.
pub struct GlobalEnvironment {
    simulator: Timed<dyn GlobalSimulator>,
    episodes: Seed,
    /// One per agent; all of the same episode and length.
    trails: Vec<Trail>,
    percept: Percept,
    experience: Experience,
}

impl GlobalEnvironment {
    /// Brings a new GS to where `streams`, one per agent, left the old one, and goes on from there. `episodes`: the
    /// stream of the episodes' seeds.
    pub fn resume(
        simulator: Box<dyn GlobalSimulator>,
        episodes: Seed,
        streams: &[AgentStream],
    ) -> Result<GlobalEnvironment> {
        let mut simulator = Timed::new(simulator);
        let trails: Vec<Trail> = rows_of(streams).map(|row| row.trail.clone()).collect();
        let percept = retrace(&mut simulator, episodes, &trails)?;
        // What that took is known to the caller, and is no part of the steps to come.
        simulator.take_watch();
        let experience = Experience::new(simulator.agents(), simulator.spec());
        Ok(GlobalEnvironment { simulator, episodes, trails, percept, experience })
    }
}

/// Plays the trails again; returns what the GS shows at their end.
fn retrace(simulator: &mut Timed<dyn GlobalSimulator>, episodes: Seed, trails: &[Trail]) -> Result<Percept> {
    let episode = trails[0].episode;
    let mut percept = simulator.reset(episode_seed(episodes, episode))?.clone();
    for step in 0..longest(trails) {
        let actions: Vec<Action> = trails.iter().map(|trail| trail.actions[step]).collect();
        percept.clone_from(&simulator.step(&actions)?.percept);
    }
    for (agent, trail) in trails.iter().enumerate() {
        ensure!(
            trail.steps() == 0 || trail.shown == fingerprint(&percept, agent),
            "the global simulator did not come back to where training left it, as agent {agent} sees it after {} steps of \
             episode {episode}: another build of SUMO or of this program, or a simulator that does not follow from its \
             seed and actions alone",
            trail.steps()
        );
    }
    Ok(percept)
}

fn episode_seed(episodes: Seed, episode: u64) -> Seed {
    episodes.for_episode(episode as usize)
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
        self.trails.iter_mut().zip(actions).for_each(|(trail, &action)| trail.push(action, &[]));
        let end = longest(&self.trails) == horizon;
        self.experience.rewards.copy_from_slice(&transition.rewards);
        self.experience.ends.fill(end);
        let percept = if end {
            self.experience.last_obs.copy_from(&transition.percept.obs);
            self.trails.iter_mut().for_each(Trail::end_episode);
            self.simulator.reset(episode_seed(self.episodes, self.trails[0].episode))?
        } else {
            &transition.percept
        };
        self.percept.obs.copy_from(&percept.obs);
        self.percept.d_set.copy_from(&percept.d_set);
        watch.add(&self.simulator.take_watch());
        Ok(&self.experience)
    }

    fn leave(&mut self, streams: &mut [AgentStream]) {
        for (agent, (trail, stream)) in self.trails.iter_mut().zip(rows_of_mut(streams)).enumerate() {
            trail.shown = fingerprint(&self.percept, agent);
            stream.trail.clone_from(trail);
        }
    }
}
