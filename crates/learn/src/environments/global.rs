//! Training on the GS: the baseline that DIALS is compared with.
//!
//! DEVIATION 6: every agent has its own policy and bootstraps with its own value. The authors' code shares one policy
//! object among the agents and bootstraps all of them with the last agent's observation, so its GS curves are not a
//! fair baseline. `gs.shared_policy` does the same: all rows of a kind hold one policy, see [`crate::algorithms::ppo`].
//!
//! DEVIATION 23: there may be several copies of the GS (`gs.copies`), as of local simulators. The paper's GS is one simulator,
//! which one core computes. Where there are more cores, it then takes many times longer than it must.
//!
//! # Why not otherwise
//!
//! **Why does a copy make many decisions before the next one has its turn?** One decision in each copy would let all networks act
//! on many rows at once. But the cars of a copy leave the cache while the others move. With 25 lights and 8 copies a step then took
//! twice as long, and acting row by row costs a tenth of that.

use std::ops::Range;
use std::time::Instant;

use anyhow::ensure;

use super::copies::GlobalCopies;
use super::ials::head_start;
use super::{Environment, Experience, add_steps};
use crate::state::stream::{AgentStream, Trail, fingerprint, rows_of, rows_of_mut};
use dials_core::base::{Phase, Seed, Stopwatch};
use dials_core::domain::{Action, Kinds, Percept, Result};

/// Copies of the GS as an [`Environment`]. All regions of a copy end together, and its next episode has the next seed.
pub(crate) struct GlobalEnvironment {
    simulators: Box<dyn GlobalCopies>,
    kinds: Kinds,
    episodes: Seed,
    /// Number of steps by which the first episode of each copy is shorter.
    head_starts: Vec<usize>,
    /// One trail per row of each kind, `[kinds][agents, copies]`. Those of a copy are of the same episode and length.
    trails: Vec<Vec<Trail>>,
    turns: Vec<Turn>,
    /// Whether each copy makes a step, and does not begin an episode.
    steps: Vec<bool>,
}

/// Copies that decide together: consecutive ones.
struct Turn {
    copies: Range<usize>,
    /// One percept per kind; the same for the experiences.
    percepts: Vec<Percept>,
    experiences: Vec<Experience>,
    /// Number of copies that are at work.
    open: usize,
}

/// How copies of the GS begin.
pub(crate) struct Begin<'a> {
    pub(crate) kinds: &'a Kinds,
    /// Stream of the episodes' seeds.
    pub(crate) episodes: Seed,
    /// Whether the first episode of copy c begins as if `c / copies` of the horizon had passed.
    pub(crate) stagger: bool,
    pub(crate) turns: usize,
}

impl GlobalEnvironment {
    /// Brings new copies of the GS to the state in which `streams`, one per agent of each kind, left the old ones, and
    /// continues from there. `alive` is called at every step, because many may have to be replayed.
    pub(crate) fn resume(
        simulators: Box<dyn GlobalCopies>,
        Begin { kinds, episodes, stagger, turns }: Begin<'_>,
        streams: &[&[AgentStream]],
        alive: &mut dyn FnMut(),
    ) -> Result<GlobalEnvironment> {
        let copies = streams[0][0].rows.len();
        let trails: Vec<Vec<Trail>> =
            streams.iter().map(|streams| rows_of(streams).map(|row| row.trail.clone()).collect()).collect();
        let horizon = if stagger { kinds.horizon() } else { 0 };
        let of_turn = copies / turns;
        let turn = |turn: usize| Turn {
            copies: turn * of_turn..(turn + 1) * of_turn,
            percepts: kinds.iter().map(|kind| Percept::new(kind.agents.len() * of_turn, &kind.spec)).collect(),
            experiences: kinds.iter().map(|kind| Experience::new(kind.agents.len() * of_turn, &kind.spec)).collect(),
            open: 0,
        };
        let mut environment = GlobalEnvironment {
            simulators,
            episodes,
            head_starts: (0..copies).map(|copy| head_start(copy, copies, horizon)).collect(),
            trails,
            turns: (0..turns).map(turn).collect(),
            steps: vec![false; copies],
            kinds: kinds.clone(),
        };
        environment.retrace(alive)?;
        // The caller has timed this; it is not part of the steps to come.
        environment.simulators.take_watch();
        Ok(environment)
    }

    fn copies(&self) -> usize {
        self.steps.len()
    }

    fn turn_of(&self, copy: usize) -> usize {
        copy / self.turns[0].copies.len()
    }

    /// Returns a trail of a copy. All of them are as long.
    fn trail(&self, copy: usize) -> &Trail {
        &self.trails[0][copy]
    }

    fn begin_reset(&mut self, copy: usize) -> Result<()> {
        self.steps[copy] = false;
        let episode = self.trail(copy).episode as usize * self.copies() + copy;
        self.simulators.begin_reset(copy, self.episodes.for_episode(episode))
    }

    /// Replays the trails and writes what the copies show at their ends.
    fn retrace(&mut self, alive: &mut dyn FnMut()) -> Result<()> {
        let copies = self.copies();
        let mut done = vec![0; copies];
        let mut actions: Vec<Action> = vec![0; self.kinds.agents()];
        let (mut next, mut open) = (0, 0);
        loop {
            while next < copies && open < self.simulators.at_once() {
                self.begin_reset(next)?;
                (next, open) = (next + 1, open + 1);
            }
            if open == 0 {
                break;
            }
            alive();
            let copy = self.simulators.wait()?;
            if done[copy] == self.trail(copy).steps() {
                self.show(copy);
                open -= 1;
                continue;
            }
            for (kind, trails) in self.kinds.iter().zip(&self.trails) {
                let of_copy = trails.iter().skip(copy).step_by(copies);
                kind.agents.iter().zip(of_copy).for_each(|(agent, trail)| actions[agent.0] = trail.actions[done[copy]]);
            }
            self.simulators.begin_step(copy, &actions)?;
            done[copy] += 1;
        }
        (0..copies).try_for_each(|copy| self.check_place(copy))
    }

    fn check_place(&self, copy: usize) -> Result<()> {
        let turn = &self.turns[self.turn_of(copy)];
        for (kind, (trails, percept)) in self.kinds.iter().zip(self.trails.iter().zip(&turn.percepts)) {
            for (place, agent) in kind.agents.iter().enumerate() {
                let trail = &trails[place * self.copies() + copy];
                ensure!(
                    trail.steps() == 0 || trail.shown == fingerprint(percept, turn.row(place, copy)),
                    "the global simulator did not come back to where training left it, as agent {agent} sees it in copy {copy} \
                     after {} steps of its episode {}; possible causes: another build of SUMO or of this program, or a \
                     simulator whose state depends on more than its seed and actions",
                    trail.steps(),
                    trail.episode
                );
            }
        }
        Ok(())
    }

    /// Writes what a copy shows now into its rows.
    fn show(&mut self, copy: usize) {
        let turn = self.turn_of(copy);
        let shown = &self.simulators.shown(copy).percept;
        let turn = &mut self.turns[turn];
        for (number, kind) in self.kinds.iter().enumerate() {
            for (place, agent) in kind.agents.iter().enumerate() {
                let row = turn.row(place, copy);
                let percept = &mut turn.percepts[number];
                percept.obs.row_mut(row).copy_from_slice(shown.obs.row(agent.0));
                percept.d_set.row_mut(row).copy_from_slice(shown.d_set.row(agent.0));
                if let Some(masks) = &mut percept.masks {
                    masks.row_mut(row).copy_from_slice(shown.masks.row(agent.0));
                }
            }
        }
    }

    /// Writes what the last step of a copy has brought. `end`: whether it was the last of the episode.
    fn experience(&mut self, copy: usize, end: bool) {
        let turn = self.turn_of(copy);
        let brought = self.simulators.shown(copy);
        let turn = &mut self.turns[turn];
        for (number, kind) in self.kinds.iter().enumerate() {
            for (place, agent) in kind.agents.iter().enumerate() {
                let row = turn.row(place, copy);
                let experience = &mut turn.experiences[number];
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

    /// Takes in what a copy has done. Returns whether it is ready for its next decision.
    fn take_in(&mut self, copy: usize, watch: &mut Stopwatch) -> Result<bool> {
        if self.steps[copy] {
            let copies = self.copies();
            let Trail { episode, .. } = *self.trail(copy);
            let head_start = if episode == 0 { self.head_starts[copy] } else { 0 };
            let end = self.trail(copy).steps() + head_start == self.kinds.horizon();
            self.experience(copy, end);
            if end {
                let of_copy = self.trails.iter_mut().flat_map(|trails| trails.iter_mut().skip(copy).step_by(copies));
                of_copy.for_each(Trail::end_episode);
                watch.time(Phase::Reset, || self.begin_reset(copy))?;
                return Ok(false);
            }
        }
        self.show(copy);
        Ok(true)
    }
}

impl Turn {
    /// Returns the row of a copy of an agent. `place`: that of the agent in its kind.
    fn row(&self, place: usize, copy: usize) -> usize {
        place * self.copies.len() + copy - self.copies.start
    }
}

impl Environment for GlobalEnvironment {
    fn turns(&self) -> usize {
        self.turns.len()
    }

    fn at_once(&self) -> usize {
        self.simulators.at_once()
    }

    fn percepts(&self, turn: usize) -> &[Percept] {
        &self.turns[turn].percepts
    }

    fn begin(&mut self, turn: usize, actions: &[Vec<Action>], watch: &mut Stopwatch) -> Result<()> {
        let (all, of_turn) = (self.copies(), self.turns[turn].copies.clone());
        let mut joint: Vec<Action> = vec![0; self.kinds.agents()];
        self.turns[turn].open = of_turn.len();
        let begun = Instant::now();
        for copy in of_turn {
            for ((kind, actions), trails) in self.kinds.iter().zip(actions).zip(&mut self.trails) {
                for (place, agent) in kind.agents.iter().enumerate() {
                    let action = actions[self.turns[turn].row(place, copy)];
                    joint[agent.0] = action;
                    trails[place * all + copy].push(action, &[]);
                }
            }
            self.steps[copy] = true;
            self.simulators.begin_step(copy, &joint)?;
        }
        add_steps(watch, &self.simulators.take_watch(), begun.elapsed());
        Ok(())
    }

    fn finish(&mut self, watch: &mut Stopwatch) -> Result<usize> {
        loop {
            let copy = watch.time(Phase::SimulatorStep, || self.simulators.wait())?;
            if !self.take_in(copy, watch)? {
                continue;
            }
            let turn = self.turn_of(copy);
            self.turns[turn].open -= 1;
            if self.turns[turn].open == 0 {
                return Ok(turn);
            }
        }
    }

    fn experiences(&self, turn: usize) -> &[Experience] {
        &self.turns[turn].experiences
    }

    fn leave(&mut self, streams: &mut [&mut [AgentStream]]) {
        let copies = self.copies();
        for (number, (trails, streams)) in self.trails.iter_mut().zip(streams).enumerate() {
            for (row, (trail, stream)) in trails.iter_mut().zip(rows_of_mut(streams)).enumerate() {
                let (place, copy) = (row / copies, row % copies);
                let turn = &self.turns[copy / self.turns[0].copies.len()];
                trail.shown = fingerprint(&turn.percepts[number], turn.row(place, copy));
                stream.trail.clone_from(trail);
            }
        }
    }
}
