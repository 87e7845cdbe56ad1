//! Training on the GS: the baseline that DIALS is compared with.
//!
//! DEVIATION 6: every agent has its own policy and bootstraps with its own value. The authors' code shares one policy
//! object among the agents and bootstraps all of them with the last agent's observation, so its GS curves are not a
//! fair baseline. `policy.share` and `gs.bootstrap` do the same: all rows of a kind hold one policy, see
//! [`crate::algorithms::ppo`].
//!
//! DEVIATION 23: there may be several copies of the GS (`gs.copies`), as of local simulators. The paper's GS is one simulator,
//! which one core computes. Where there are more cores, it then takes many times longer than it must.

use std::time::Instant;

use anyhow::ensure;

use super::ials::head_start;
use super::lanes::{Lane, Lanes};
use super::makers::{GlobalCopies, GlobalCopy};
use super::{Environment, Experience, add_steps};
use crate::side_by_side::in_threads;
use crate::state::stream::{AgentStream, Part, Trail, fingerprint};
use dials_core::base::{Phase, Seed, Stopwatch};
use dials_core::domain::{Action, JointPercept, JointTransition, Kinds, Percept, Result};
use stacknets::Threads;

/// A copy of the GS as an [`Environment`]. All its regions end together, and its next episode has the next seed.
struct GlobalEnvironment<C: ?Sized> {
    kinds: Kinds,
    episodes: Seed,
    copy: usize,
    copies: usize,
    /// Number of steps by which the first episode is shorter.
    head_start: usize,
    /// The rows of each kind: this copy of all its agents.
    parts: Vec<Part>,
    /// One trail per agent of each kind. All of them are of the same episode and length.
    trails: Vec<Vec<Trail>>,
    /// One per kind; the same for the experiences.
    percepts: Vec<Percept>,
    experiences: Vec<Experience>,
    simulator: Box<C>,
}

/// How copies of the GS begin.
pub(crate) struct Begin<'a> {
    pub(crate) kinds: &'a Kinds,
    /// Stream of the episodes' seeds.
    pub(crate) episodes: Seed,
    /// Whether the first episode of copy c begins as if `c / copies` of the horizon had passed.
    pub(crate) stagger: bool,
    /// Threads that play them, if they are apart.
    pub(crate) threads: &'a Threads,
}

/// Brings new copies of the GS to the state in which `streams`, one per agent of each kind, left the old ones, and
/// continues from there. Each copy is a lane. `alive` is called at every step, because many may have to be replayed.
pub(crate) fn resume(
    simulators: GlobalCopies,
    begin: &Begin<'_>,
    streams: &[&[AgentStream]],
    alive: &mut dyn FnMut(),
) -> Result<Lanes<'static>> {
    match simulators {
        GlobalCopies::Here(copies) => {
            let mut lanes = Vec::new();
            for (copy, simulator) in copies.into_iter().enumerate() {
                let environment = GlobalEnvironment::resume(simulator, copy, begin, streams, alive)?;
                lanes.push(Lane { parts: environment.parts.clone(), environment: Box::new(environment) as _ });
            }
            Ok(Lanes::Here(lanes))
        }
        GlobalCopies::Apart(copies) => {
            let copies = copies.into_iter().enumerate().collect();
            let lanes = in_threads(begin.threads, copies, alive, |_: &mut (), (copy, simulator), alive| {
                let environment = GlobalEnvironment::resume(simulator, copy, begin, streams, alive)?;
                Ok(Lane { parts: environment.parts.clone(), environment: Box::new(environment) as _ })
            });
            Ok(Lanes::Apart(lanes.into_iter().collect::<Result<_>>()?, begin.threads.clone()))
        }
    }
}

impl<C: GlobalCopy + ?Sized> GlobalEnvironment<C> {
    fn resume(
        simulator: Box<C>,
        copy: usize,
        begin: &Begin<'_>,
        streams: &[&[AgentStream]],
        alive: &mut dyn FnMut(),
    ) -> Result<GlobalEnvironment<C>> {
        let Begin { kinds, episodes, stagger, .. } = *begin;
        let copies = streams[0][0].rows.len();
        let parts: Vec<Part> =
            kinds.iter().map(|kind| Part { agents: 0..kind.agents.len(), copies: copy..copy + 1 }).collect();
        let trails =
            parts.iter().zip(streams).map(|(part, streams)| part.of(streams).map(|row| row.trail.clone()).collect());
        let horizon = if stagger { kinds.horizon() } else { 0 };
        let mut environment = GlobalEnvironment {
            episodes,
            copy,
            copies,
            head_start: head_start(copy, copies, horizon),
            trails: trails.collect(),
            parts,
            percepts: kinds.iter().map(|kind| Percept::new(kind.agents.len(), &kind.spec)).collect(),
            experiences: kinds.iter().map(|kind| Experience::new(kind.agents.len(), &kind.spec)).collect(),
            simulator,
            kinds: kinds.clone(),
        };
        environment.retrace(alive)?;
        // The caller has timed this; it is not part of the steps to come.
        environment.simulator.take_watch();
        Ok(environment)
    }

    /// Returns a trail. All of them are as long.
    fn trail(&self) -> &Trail {
        &self.trails[0][0]
    }

    fn reset(&mut self) -> Result<()> {
        let episode = self.trail().episode as usize * self.copies + self.copy;
        let shown = self.simulator.reset(self.episodes.for_episode(episode))?;
        show(&self.kinds, shown, &mut self.percepts);
        Ok(())
    }

    /// Replays the trails.
    fn retrace(&mut self, alive: &mut dyn FnMut()) -> Result<()> {
        self.reset()?;
        let mut actions: Vec<Action> = vec![0; self.kinds.agents()];
        for step in 0..self.trail().steps() {
            alive();
            for (kind, trails) in self.kinds.iter().zip(&self.trails) {
                kind.agents.iter().zip(trails).for_each(|(agent, trail)| actions[agent.0] = trail.actions[step]);
            }
            show(&self.kinds, &self.simulator.step(&actions)?.percept, &mut self.percepts);
        }
        for (kind, (trails, percept)) in self.kinds.iter().zip(self.trails.iter().zip(&self.percepts)) {
            for (row, (agent, trail)) in kind.agents.iter().zip(trails).enumerate() {
                ensure!(
                    trail.steps() == 0 || trail.shown == fingerprint(percept, row),
                    "the global simulator did not come back to where training left it, as agent {agent} sees it in copy {} \
                     after {} steps of its episode {}; possible causes: another build of SUMO or of this program, or a \
                     simulator whose state depends on more than its seed and actions",
                    self.copy,
                    trail.steps(),
                    trail.episode
                );
            }
        }
        Ok(())
    }
}

/// Writes what a GS shows into the rows of each kind.
fn show(kinds: &Kinds, shown: &JointPercept, percepts: &mut [Percept]) {
    for (kind, percept) in kinds.iter().zip(percepts) {
        for (row, agent) in kind.agents.iter().enumerate() {
            percept.obs.row_mut(row).copy_from_slice(shown.obs.row(agent.0));
            percept.d_set.row_mut(row).copy_from_slice(shown.d_set.row(agent.0));
            if let Some(masks) = &mut percept.masks {
                masks.row_mut(row).copy_from_slice(shown.masks.row(agent.0));
            }
        }
    }
}

/// Writes what a step of a GS has brought the rows of each kind. `end`: whether it was the last one of the episode.
fn experience(kinds: &Kinds, brought: &JointTransition, end: bool, experiences: &mut [Experience]) {
    for (kind, experience) in kinds.iter().zip(experiences) {
        for (row, agent) in kind.agents.iter().enumerate() {
            experience.rewards[row] = brought.rewards[agent.0];
            experience.ends[row] = end;
            if end {
                experience.last_obs.row_mut(row).copy_from_slice(brought.percept.obs.row(agent.0));
                if let Some(last) = &mut experience.last_masks {
                    last.row_mut(row).copy_from_slice(brought.percept.masks.row(agent.0));
                }
            }
        }
    }
}

impl<C: GlobalCopy + ?Sized> Environment for GlobalEnvironment<C> {
    fn percepts(&self) -> &[Percept] {
        &self.percepts
    }

    fn step(&mut self, actions: &[Vec<Action>], watch: &mut Stopwatch) -> Result<()> {
        let mut joint: Vec<Action> = vec![0; self.kinds.agents()];
        for ((kind, actions), trails) in self.kinds.iter().zip(actions).zip(&mut self.trails) {
            for ((agent, &action), trail) in kind.agents.iter().zip(actions).zip(trails) {
                joint[agent.0] = action;
                trail.push(action, &[]);
            }
        }
        let head_start = if self.trail().episode == 0 { self.head_start } else { 0 };
        let end = self.trail().steps() + head_start == self.kinds.horizon();
        let begun = Instant::now();
        let brought = self.simulator.step(&joint)?;
        let steps = begun.elapsed();
        experience(&self.kinds, brought, end, &mut self.experiences);
        show(&self.kinds, &brought.percept, &mut self.percepts);
        add_steps(watch, &self.simulator.take_watch(), steps);
        if end {
            self.trails.iter_mut().flatten().for_each(Trail::end_episode);
            watch.time(Phase::Reset, || self.reset())?;
        }
        Ok(())
    }

    fn experiences(&self) -> &[Experience] {
        &self.experiences
    }

    fn leave(&mut self, streams: &mut [&mut [AgentStream]]) {
        for (number, (trails, streams)) in self.trails.iter_mut().zip(streams).enumerate() {
            for (row, (trail, stream)) in trails.iter_mut().zip(self.parts[number].of_mut(streams)).enumerate() {
                trail.shown = fingerprint(&self.percepts[number], row);
                stream.trail.clone_from(trail);
            }
        }
    }
}
