//! What the GS reads of cars, lanes, detectors and people, per row: every second, and once more after a decision.

use anyhow::Result;

use super::crossings::Crossings;
use super::others::Others;
use super::readings::Readings;
use super::watched::{RowShows, Watched};
use crate::agents::phase_plan::Shown;
use crate::agents::plan::{AgentPlan, JointPlan};
use crate::cars_at::{CarsAt, RowLanes};
use crate::reward::{self, Waiting};
use crate::scenario::travellers::Travellers;
use dials_core::base::{AgentId, Seed};
use dials_core::domain::roads::RoadsNow;
use libsumo::{CarTable, Simulation};

/// What beside the approaches is read in a second.
#[derive(Clone, Copy)]
pub(super) struct Glance {
    pub(super) exits: bool,
    /// Lanes within the junctions; the persons at crossings, too.
    pub(super) closely: bool,
}

pub(super) struct Eyes {
    /// Approaches with the cars now, and the cars a second ago.
    pub(super) approaches: RowLanes,
    pub(super) cars_before: CarTable,
    /// Read only for hand-coded control, for a reward or agents that need them, and if the roads are watched.
    pub(super) exits: RowLanes,
    /// Lanes within the junctions, for masks that mind trapped cars.
    pub(super) inside: RowLanes,
    /// Time that cars have waited, per row; noted only if the roads are watched, or for a reward that needs it.
    pub(super) waiting: Vec<Waiting>,
    /// Buses and trams, if an agent needs them.
    pub(super) others: Option<Others>,
    /// Persons at the crossings of each row; read if a rule or an agent looks at them.
    pub(super) people: Crossings,
    /// Detectors of each row, if agents see them.
    pub(super) readings: Vec<Readings>,
    /// What is known of vehicles, if the roads are watched.
    watched: Option<Watched>,
}

impl Eyes {
    /// `somebody_walks`: whether there is anybody to look for at crossings.
    pub(super) fn open(plan: &JointPlan, somebody_walks: bool, simulation: &mut Simulation) -> Result<Eyes> {
        let agents = || plan.agents.iter();
        let approaches = agents().map(|agent| agent.region.approaches.iter().map(|lane| &lane.lane).collect());
        let exits = agents().map(|agent| agent.region.exits.iter().map(|exit| &exit.lane).collect());
        let approaches = RowLanes::register(simulation, approaches)?;
        let exits = RowLanes::register(simulation, exits)?;
        let inside = RowLanes::register(simulation, agents().map(AgentPlan::lanes_inside))?;
        let others = Others::of_rows(plan, agents());
        let others = others.map(|others| others.with_trams(simulation, &plan.agents)).transpose()?;
        let crossings = agents().map(|agent| if somebody_walks { &agent.others.crossings[..] } else { &[] });
        let people = Crossings::register(simulation, crossings)?;
        Ok(Eyes {
            approaches,
            cars_before: CarTable::new(),
            exits,
            inside,
            waiting: vec![Waiting::default(); plan.agents.len()],
            others,
            people,
            readings: Vec::new(),
            watched: None,
        })
    }

    /// From the next reset on, the roads are read as well, for [`Eyes::roads`].
    pub(super) fn watch_roads(&mut self, plan: &JointPlan, travellers: Option<&Travellers>) {
        self.watched = Some(Watched::new(plan, travellers));
    }

    pub(super) fn begin(&mut self, plan: &JointPlan, episode: Seed) {
        self.waiting.fill(Waiting::default());
        self.others.iter_mut().for_each(Others::begin);
        self.watched.iter_mut().for_each(Watched::begin);
        if plan.sees_detectors() {
            let of_agent = |(row, agent): (usize, &AgentPlan)| {
                Readings::begin(agent.sensor.detectors(), plan.faults, episode.for_agent(AgentId(row)))
            };
            self.readings = plan.agents.iter().enumerate().map(of_agent).collect();
        }
    }

    /// Begins a decision.
    pub(super) fn decide(&mut self) {
        self.waiting.iter_mut().for_each(Waiting::decide);
        self.readings.iter_mut().for_each(Readings::decide);
    }

    /// Keeps the cars of the last second as those from before the next one.
    pub(super) fn keep_cars(&mut self) {
        std::mem::swap(&mut self.approaches.cars, &mut self.cars_before);
    }

    /// Reads the cars of a second.
    pub(super) fn read_cars(&mut self, glance: Glance, simulation: &mut Simulation) -> Result<()> {
        self.approaches.read(simulation)?;
        if glance.exits {
            self.exits.read(simulation)?;
        }
        if glance.closely {
            self.read_inside(simulation)?;
            self.people.read(simulation)?;
        }
        Ok(())
    }

    fn read_inside(&mut self, simulation: &mut Simulation) -> Result<()> {
        if self.inside.is_empty() { Ok(()) } else { self.inside.read(simulation) }
    }

    /// Notes what adds up over the seconds of a decision.
    pub(super) fn second(&mut self, plan: &JointPlan, simulation: &mut Simulation) -> Result<()> {
        self.others.as_mut().map_or(Ok(()), |others| others.second(simulation))?;
        for (row, readings) in self.readings.iter_mut().enumerate() {
            readings.second(&plan.agents[row].region, self.approaches.at(row));
        }
        if let Some(watched) = &mut self.watched {
            watched.entered(&simulation.departures()?);
        }
        if self.watched.is_some() || reward::needs_waiting(&plan.reward) {
            for (row, waiting) in self.waiting.iter_mut().enumerate() {
                waiting.note(self.approaches.at(row));
            }
        }
        if reward::needs_co2(&plan.reward) {
            let of_rows = self.approaches.co2_mg_per_s(simulation)?;
            self.waiting.iter_mut().zip(of_rows).for_each(|(waiting, mg)| waiting.note_co2(mg));
        }
        Ok(())
    }

    /// Reads what agents see or are rewarded for beside the cars of each second. `looked`: a rule has just looked closely.
    pub(super) fn read_others(&mut self, plan: &JointPlan, looked: bool, simulation: &mut Simulation) -> Result<()> {
        if !looked {
            self.read_inside(simulation)?;
        }
        let see_people = || plan.sees_sets() || plan.agents.iter().any(|agent| agent.sensor.sees_others);
        if !looked && (self.watched.is_some() || reward::needs_people(&plan.reward) || see_people()) {
            self.people.read(simulation)?;
        }
        if self.watched.is_some() || plan.sees_sets() {
            self.exits.read(simulation)?;
        }
        let Some(others) = &mut self.others else { return Ok(()) };
        others.read(simulation, plan.agents.iter(), |row| self.approaches.at(row))
    }

    pub(super) fn cars_on(&self, row: usize) -> CarsAt<'_> {
        self.approaches.at(row)
    }

    /// Tells all that is known of the roads, if they are watched. `lights`: what each row shows, and for how many seconds.
    pub(super) fn roads(&self, lights: impl Iterator<Item = (Shown, u32)>, now: &mut RoadsNow) {
        let Some(watched) = &self.watched else { return };
        for (row, (shown, shown_s)) in lights.enumerate() {
            let shows = RowShows {
                shown,
                shown_s,
                waiting: &self.waiting[row],
                readings: self.readings.get(row),
                persons: self.people.at(row).iter().sum(),
            };
            watched.put_row(row, &shows, [self.approaches.at(row), self.exits.at(row)], now);
        }
    }
}
