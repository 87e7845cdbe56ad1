//! The episode on the GS that local simulators play again.

use std::ops::Range;

use anyhow::{Context, ensure};
use rand::seq::IndexedRandom;

use super::agreement::Seen;
use crate::Traffic;
use crate::agents::plan::AgentPlan;
use crate::cars_at::CarsAt;
use crate::sim::control::SignalControl;
use crate::sim::recording::{Recording, Step, Tape};
use crate::sim::visits::Visits;
use dials_core::base::{Ragged, RandomPurpose, Seed};
use dials_core::domain::{Action, GlobalSimulator, Result};
use libsumo::{CarTable, LaneCars};

pub struct Truth {
    pub(crate) seed: Seed,
    pub(crate) actions: Vec<Vec<Action>>,
    /// Influence sources of all regions, by decision.
    pub(crate) sources: Vec<Ragged<u8>>,
    pub(crate) recording: Recording,
    pub(crate) visits: Option<Visits>,
}

impl Truth {
    /// Plays the first `seconds` of an episode. At every decision each light gets a random one of the greens that it may
    /// show. SUMO must not be loaded elsewhere in this process.
    pub fn play(traffic: &Traffic, seconds: usize, seed: Seed) -> Result<Truth> {
        ensure!(seconds <= traffic.seconds(), "an episode of {} s has no second {seconds}", traffic.seconds());
        let tape = Tape::default();
        let mut gs = traffic.clone().record_on(&tape).global(SignalControl::Agents)?;
        gs.record_visits()?;
        let mut dice = seed.fork(RandomPurpose::Actions).dice();
        let mut masks = gs.reset(seed)?.masks.clone();
        let (mut joint_actions, mut sources) = (Vec::new(), Vec::new());
        for _ in 0..seconds.div_ceil(traffic.plan.decision_steps) {
            let draw = |(plan, mask): (&AgentPlan, &[bool])| {
                // The mask of a light that may always do everything is empty.
                let is_allowed = |&action: &usize| mask.get(action).copied().unwrap_or(true);
                let allowed: Vec<usize> = (0..plan.phases.actions()).filter(is_allowed).collect();
                let action = *allowed.choose(&mut dice).expect("an action is always allowed");
                Action::try_from(action).expect("a plan has at most 256 greens")
            };
            let actions: Vec<Action> = traffic.plan.agents.iter().zip(masks.iter()).map(draw).collect();
            masks.copy_from(&gs.step(&actions)?.percept.masks);
            joint_actions.push(actions);
            sources.push(gs.influence_sample().sources.clone());
        }
        let visits = gs.visits().cloned();
        let recording = tape.take().context("an episode was recorded")?;
        Ok(Truth { seed, actions: joint_actions, sources, recording, visits })
    }

    /// Returns the cars on some lanes after each second, as tables of these lanes.
    pub(super) fn on_lanes<'a>(
        &'a self,
        lanes: impl Iterator<Item = &'a str>,
    ) -> Result<impl Iterator<Item = CarTable> + 'a> {
        let numbers = lanes.map(|lane| self.recording.roads.number(lane)).collect::<Result<Vec<usize>>>()?;
        let cars = |lane: LaneCars<'_>| lane.iter().map(|car| (car.id, car.position_m, car.speed_mps)).collect();
        let table = move |step: &'a Step| CarTable::of(numbers.iter().map(|&number| cars(step.cars.lane(number))));
        Ok(self.recording.steps.iter().map(table))
    }

    pub(super) fn on_approaches<'a>(&'a self, plan: &'a AgentPlan) -> Result<impl Iterator<Item = CarTable> + 'a> {
        self.on_lanes(plan.region.approaches.iter().map(|approach| approach.lane.as_str()))
    }

    pub(super) fn seen(&self, plan: &AgentPlan, window: &Range<usize>) -> Result<Seen> {
        let mut seen = Seen::new(plan, window.clone());
        for (cars, step) in self.on_approaches(plan)?.zip(&self.recording.steps) {
            seen.note(plan, CarsAt::all(&cars), &step.gone, 0);
        }
        Ok(seen)
    }
}
