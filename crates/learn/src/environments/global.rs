//! Training on the GS: the baseline that DIALS is compared with.
//!
//! DEVIATION 6: every agent has its own policy and bootstraps with its own value. The authors' code shares one policy
//! object among the agents and bootstraps all of them with the last agent's observation, so its GS curves are not a
//! fair baseline. `gs.shared_policy` does the same: all rows of a kind hold one policy, see [`crate::algorithms::ppo`].

use std::time::Instant;

use anyhow::ensure;

use super::{Environment, Experience, add_steps};
use crate::state::stream::{AgentStream, Trail, fingerprint, rows_of, rows_of_mut};
use dials_core::base::{Phase, Seed, Stopwatch};
use dials_core::domain::{Action, GlobalSimulator, JointPercept, Kinds, Percept, Result};

/// The GS as an [`Environment`]: all regions end together, and the next episode has the next seed.
pub(crate) struct GlobalEnvironment {
    simulator: Box<dyn GlobalSimulator>,
    kinds: Kinds,
    episodes: Seed,
    /// One trail per agent of each kind, all of the same episode and length.
    trails: Vec<Vec<Trail>>,
    /// One percept per kind; the same for the experiences.
    percepts: Vec<Percept>,
    experiences: Vec<Experience>,
    actions: Vec<Action>,
}

impl GlobalEnvironment {
    /// Brings a new GS to the state in which `streams`, one per agent of each kind, left the old one, and continues
    /// from there. `episodes`: the stream of the episodes' seeds. `alive` is called at every step, because many may
    /// have to be replayed.
    pub(crate) fn resume(
        mut simulator: Box<dyn GlobalSimulator>,
        episodes: Seed,
        streams: &[&[AgentStream]],
        alive: &mut dyn FnMut(),
    ) -> Result<GlobalEnvironment> {
        let kinds = simulator.kinds().clone();
        let trails: Vec<Vec<Trail>> =
            streams.iter().map(|streams| rows_of(streams).map(|row| row.trail.clone()).collect()).collect();
        let mut percepts: Vec<Percept> = kinds.iter().map(|kind| Percept::new(kind.agents.len(), &kind.spec)).collect();
        retrace(&mut *simulator, &kinds, episodes, &trails, &mut percepts, alive)?;
        // The caller has timed this; it is not part of the steps to come.
        simulator.take_watch();
        let experiences = kinds.iter().map(|kind| Experience::new(kind.agents.len(), &kind.spec)).collect();
        let actions = vec![0; kinds.agents()];
        Ok(GlobalEnvironment { simulator, kinds, episodes, trails, percepts, experiences, actions })
    }
}

/// Replays the trails and writes what the GS shows at their end.
fn retrace(
    simulator: &mut dyn GlobalSimulator,
    kinds: &Kinds,
    episodes: Seed,
    trails: &[Vec<Trail>],
    percepts: &mut [Percept],
    alive: &mut dyn FnMut(),
) -> Result<()> {
    let Trail { episode, .. } = trails[0][0];
    show(simulator.reset(episodes.for_episode(episode as usize))?, kinds, percepts);
    let mut actions: Vec<Action> = vec![0; kinds.agents()];
    for step in 0..trails[0][0].steps() {
        alive();
        for (kind, trails) in kinds.iter().zip(trails) {
            kind.agents.iter().zip(trails).for_each(|(agent, trail)| actions[agent.0] = trail.actions[step]);
        }
        show(&simulator.step(&actions)?.percept, kinds, percepts);
    }
    for ((kind, trails), percept) in kinds.iter().zip(trails).zip(percepts) {
        for (row, (agent, trail)) in kind.agents.iter().zip(trails).enumerate() {
            ensure!(
                trail.steps() == 0 || trail.shown == fingerprint(percept, row),
                "the global simulator did not come back to where training left it, as agent {agent} sees it after {} \
                 steps of episode {episode}; possible causes: another build of SUMO or of this program, or a \
                 simulator whose state depends on more than its seed and actions",
                trail.steps()
            );
        }
    }
    Ok(())
}

/// Copies to every kind what its agents see.
fn show(percept: &JointPercept, kinds: &Kinds, percepts: &mut [Percept]) {
    percepts.iter_mut().enumerate().for_each(|(kind, of_kind)| percept.of_kind(kinds, kind, of_kind));
}

impl Environment for GlobalEnvironment {
    fn percepts(&self) -> &[Percept] {
        &self.percepts
    }

    fn step(&mut self, actions: &[Vec<Action>], watch: &mut Stopwatch) -> Result<()> {
        for ((kind, actions), trails) in self.kinds.iter().zip(actions).zip(&mut self.trails) {
            for ((agent, &action), trail) in kind.agents.iter().zip(actions).zip(trails) {
                self.actions[agent.0] = action;
                trail.push(action, &[]);
            }
        }
        let end = self.trails[0][0].steps() == self.kinds.horizon();
        let begun = Instant::now();
        let transition = self.simulator.step(&self.actions)?;
        let steps = begun.elapsed();
        for (kind, experience) in self.kinds.iter().zip(&mut self.experiences) {
            let agents = || kind.agents.iter().map(|agent| agent.0);
            experience.rewards.iter_mut().zip(agents()).for_each(|(reward, agent)| *reward = transition.rewards[agent]);
            experience.ends.fill(end);
            if end {
                transition.percept.obs.pick_into(agents(), &mut experience.last_obs);
                if let Some(last) = &mut experience.last_masks {
                    transition.percept.masks.pick_into(agents(), last);
                }
            }
        }
        let percept = if end {
            self.trails.iter_mut().flatten().for_each(Trail::end_episode);
            let episode = self.episodes.for_episode(self.trails[0][0].episode as usize);
            let begun = Instant::now();
            let percept = self.simulator.reset(episode)?;
            watch.note(Phase::Reset, begun.elapsed());
            percept
        } else {
            &transition.percept
        };
        show(percept, &self.kinds, &mut self.percepts);
        add_steps(watch, &self.simulator.take_watch(), steps);
        Ok(())
    }

    fn experiences(&self) -> &[Experience] {
        &self.experiences
    }

    fn leave(&mut self, streams: &mut [&mut [AgentStream]]) {
        for ((trails, percept), streams) in self.trails.iter_mut().zip(&self.percepts).zip(streams) {
            for (row, (trail, stream)) in trails.iter_mut().zip(rows_of_mut(streams)).enumerate() {
                trail.shown = fingerprint(percept, row);
                stream.trail.clone_from(trail);
            }
        }
    }
}
