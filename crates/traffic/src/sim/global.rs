//! The GS: the whole network in SUMO, with cars that flow in at its boundary.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, ensure};

use super::border::Borders;
use super::control::{Decisions, SignalControl};
use super::crossings::Crossings;
use super::eyes::{Eyes, Glance};
use super::light_delays::LightDelays;
use super::lights::{History, Lights, ShownLights, Stay};
use super::metrics::{TrafficMetrics, Window};
use super::picture::Camera;
use super::recording::{Recorder, Tape};
use super::route_file::{RouteFile, source};
use super::tally::Tally;
use super::visits::Visits;
use crate::agents::others_plan::OthersPlan;
use crate::agents::plan::{AgentPlan, JointPlan};
use crate::cars_at::CarsAt;
use crate::controllers::intersections::Intersections;
use crate::events::{EventLog, EventRecorder};
use crate::inflow::has_arrival;
use crate::lane_sets::{Draw, Seen, SinceGreen};
use crate::network::loadable::Loadable;
use crate::observe::{self, LightView};
use crate::reward;
use crate::road_network::RoadNetwork;
use dials_core::base::{AgentId, Phase, Ragged, Seed, Stopwatch};
use dials_core::domain::light_figures::{LightPlace, LightsEpisode};
use dials_core::domain::roads::RoadsNow;
use dials_core::domain::{
    Action, GlobalSimulator, InfluenceSample, JointPercept, JointTransition, Kinds, Measures, Result, Scene,
};
#[cfg(test)]
use libsumo::SignalState;
use libsumo::{Car, Simulation};

/// The traffic GS: one row per intersection. A step of it is a decision of the agents, which may take several seconds.
///
/// Arrivals at the boundary depend only on the seed of the episode, so controllers can be compared on the same traffic.
pub struct GlobalTraffic {
    plan: Arc<JointPlan>,
    network: Arc<RoadNetwork>,
    source: Loadable,
    /// Route file of the episode, if each episode plays one of several, and the further programs that SUMO loads.
    route_file: Option<RouteFile>,
    programs: Option<String>,
    decisions: Decisions,
    simulation: Simulation,
    lights: Lights,
    shown: ShownLights,
    /// Number of seconds since the episode began.
    age: usize,
    eyes: Eyes,
    /// Which cars are seen in this episode by agents that see lanes, per row.
    draws: Vec<Draw>,
    last: JointTransition,
    /// Borders of a scenario's regions, once influence is observed.
    borders: Option<Borders>,
    /// D-sets from before the last step, and the influence sources during it.
    d_set_before: Ragged<f32>,
    sources: Ragged<u8>,
    tally: Tally,
    watch: Stopwatch,
    recorder: Option<Recorder>,
    /// Logs what is measured in full, if somebody wants the events of the street.
    events: Option<EventRecorder>,
    camera: Option<Camera>,
    metrics: Option<TrafficMetrics>,
    /// Crossings of all lights, also of those that keep their programs, if persons' waiting is measured.
    crossings: Option<Crossings>,
    light_delays: Option<LightDelays>,
    /// What the lights have shown in this episode, if it is kept.
    history: Option<History>,
}

impl GlobalTraffic {
    /// Makes it ready. The first reset loads the network.
    pub(crate) fn new(
        plan: Arc<JointPlan>,
        network: Arc<RoadNetwork>,
        control: SignalControl,
        tape: Option<&Tape>,
        log: Option<&EventLog>,
    ) -> Result<GlobalTraffic> {
        let last = JointTransition::new(&plan.kinds);
        let (route_file, programs) = (RouteFile::first(&network)?, control.programs().map(str::to_owned));
        let source = source(&network, route_file.as_ref(), programs.as_deref())?;
        let mut simulation = source.simulation()?;
        let agents = plan.agents.iter();
        let lights = agents.clone().map(|agent| (agent.light.clone(), agent.phases.clone()));
        let lights = Lights::register(&mut simulation, lights)?;
        let has_crossings = agents.clone().any(|agent| !agent.others.crossings.is_empty());
        // Looked up only where it matters: all of the demand is asked.
        let somebody_walks = has_crossings && network.travellers().is_some_and(|travellers| travellers.has_persons);
        let eyes = Eyes::open(&plan, somebody_walks, &mut simulation)?;
        let record = |tape| Recorder::new(tape, &mut simulation, network.recorded(&plan)?, String::new());
        let recorder = tape.map(record).transpose()?;
        let events = |log| EventRecorder::new(log, network.sites(&plan)?, &mut simulation);
        let events = log.map(events).transpose()?;
        let agents = agents.len();
        Ok(GlobalTraffic {
            source,
            route_file,
            programs,
            network,
            eyes,
            draws: Vec::new(),
            decisions: Decisions::new(control, agents),
            simulation,
            lights,
            shown: ShownLights::new(agents),
            age: 0,
            d_set_before: last.percept.d_set.clone(),
            last,
            borders: None,
            sources: Ragged::new(plan.kinds.specs().map(|spec| spec.sources.count())),
            tally: Tally::default(),
            watch: Stopwatch::default(),
            recorder,
            events,
            camera: None,
            metrics: None,
            crossings: None,
            light_delays: None,
            history: None,
            plan,
        })
    }

    /// Returns the car that arrived at an edge of an intersection in the last step; for tests of the physics.
    pub fn arrival(&self, agent: usize, edge: usize) -> Option<Car> {
        let arrived = self.sources.row(agent)[edge] == 1;
        arrived.then(|| self.cars_on(agent).lane(edge).iter().next().expect("an arrival is a car on the edge"))
    }

    pub fn cars_on(&self, agent: usize) -> CarsAt<'_> {
        self.eyes.cars_on(agent)
    }

    /// Returns the letters that SUMO says all lights show.
    #[cfg(test)]
    pub(super) fn states(&mut self) -> Result<Vec<SignalState>> {
        self.lights.states(&mut self.simulation)
    }

    /// Returns the actions of the last step that the lights obeyed. They mean nothing if SUMO runs the lights.
    pub fn actions(&self) -> &[Action] {
        &self.decisions.obeyed
    }

    /// Records all visits to the regions of a scenario from the next reset on, and observes their influence.
    pub(crate) fn record_visits(&mut self) -> Result<()> {
        self.observe_influence()?;
        self.note_stops()
    }

    /// Begins to record visits, with the stops of the vehicles of this episode.
    fn note_stops(&mut self) -> Result<()> {
        let stops = Arc::new(self.network.stops(self.route_file.as_ref().map(|file| &file.scenario))?);
        self.borders.iter_mut().for_each(|borders| borders.record_visits(stops.clone()));
        Ok(())
    }

    /// Lets all further episodes play one of several route files, by its number.
    pub(crate) fn play_only(&mut self, number: usize) {
        self.route_file.iter_mut().for_each(|file| file.fix(number));
    }

    pub(crate) fn visits(&self) -> Option<&Visits> {
        self.borders.as_ref().and_then(Borders::visits)
    }

    /// Keeps what the lights show from the next reset on.
    pub(crate) fn keep_history(&mut self) {
        self.history = Some(History::default());
    }

    /// Returns what each light has shown in this episode, one stay after the other. Nothing unless it is kept.
    pub(crate) fn history(&self) -> &[Vec<Stay>] {
        self.history.as_ref().map_or(&[], |history| &history.0)
    }

    pub fn hand_over(&mut self, control: SignalControl) {
        self.decisions.control = control;
    }

    /// Returns what hand-coded controllers see now, and the decisions that they make from it.
    fn intersections(&mut self) -> (Intersections<'_>, &mut Decisions) {
        let intersections = Intersections {
            plans: &self.plan.agents,
            shown: &self.shown.now,
            shown_steps: &self.shown.steps,
            lights: &self.lights,
            approaches: &self.eyes.approaches,
            exits: &self.eyes.exits,
            inside: &self.eyes.inside,
            people: &self.eyes.people,
        };
        (intersections, &mut self.decisions)
    }

    /// Moves the whole system on by a second. `number`: that of the second within the decision.
    fn second(&mut self, number: usize, actions: &[Action]) -> Result<()> {
        let begun = Instant::now();
        let (intersections, decisions) = self.intersections();
        decisions.decide(actions, &intersections);
        self.eyes.keep_cars();
        self.lights.act(&mut self.simulation, &self.decisions.obeyed)?;
        self.watch.note(Phase::Insertion, begun.elapsed());
        self.watch.time(Phase::SimulatorStep, || self.simulation.second())?;
        let begun = Instant::now();
        self.read_cars()?;
        self.shown.second(&mut self.lights, &mut self.simulation)?;
        self.age += 1;
        self.note_sources(number)?;
        self.eyes.second(&self.plan, &mut self.simulation)?;
        self.history.iter_mut().for_each(|history| history.note(&self.shown.now));
        self.tally.lights(&self.shown.before, &self.shown.now);
        self.tally.waiting(&self.plan.agents, &self.shown.now, &self.eyes.approaches);
        self.tally.cars(&self.eyes.approaches.cars, &self.eyes.cars_before);
        self.tally.step(&mut self.simulation)?;
        let warm_up_s = self.network.warm_up_s as usize;
        let is_warm = self.age > warm_up_s;
        if let Some(metrics) = self.metrics.as_mut().filter(|_| self.age == warm_up_s) {
            metrics.arrived_in_warm_up = self.tally.arrived;
        }
        if let Some(delays) = &mut self.light_delays {
            delays.second(&mut self.simulation, is_warm)?;
        }
        if let Some(metrics) = self.metrics.as_mut().filter(|_| is_warm) {
            metrics.step(&self.eyes.approaches, &self.eyes.cars_before, &self.simulation.gone()?);
            if let Some(crossings) = &mut self.crossings {
                crossings.read(&mut self.simulation)?;
                metrics.note_waiting(crossings.persons());
            }
        }
        self.watch.note(Phase::Reading, begun.elapsed());
        if let Some(recorder) = &mut self.recorder {
            recorder.step(&mut self.simulation, &[])?;
        }
        self.events.as_mut().map_or(Ok(()), |events| events.second(&mut self.simulation))
    }

    fn note_sources(&mut self, second: usize) -> Result<()> {
        if let Some(borders) = &mut self.borders {
            return borders.second(&mut self.simulation, second, &mut self.sources);
        }
        if !self.plan.borders.is_empty() {
            return Ok(());
        }
        // DEVIATION 4: an influence source is the event that a car entered the edge in this step. In the authors' code
        // it is the occupancy of the entry cell.
        for row in 0..self.plan.agents.len() {
            let (now, before) = (self.eyes.cars_on(row), self.eyes.approaches.of(&self.eyes.cars_before, row));
            for (source, (now, before)) in self.sources.row_mut(row).iter_mut().zip(now.iter().zip(before.iter())) {
                *source |= u8::from(has_arrival(now, before));
            }
        }
        Ok(())
    }

    fn read_cars(&mut self) -> Result<()> {
        let glance = Glance {
            exits: self.decisions.has_rule() || reward::needs_exits(&self.plan.reward),
            closely: self.decisions.looks_closely(),
        };
        self.eyes.read_cars(glance, &mut self.simulation)
    }

    fn read_others(&mut self) -> Result<()> {
        self.eyes.read_others(&self.plan, self.decisions.looks_closely(), &mut self.simulation)
    }

    fn take_picture(&mut self) -> Result<()> {
        self.camera.as_mut().map_or(Ok(()), |camera| camera.look(&mut self.simulation, &self.lights))
    }

    fn perceive(&mut self) {
        let JointTransition { percept, rewards } = &mut self.last;
        for (row, reward) in rewards.iter_mut().enumerate() {
            let (plan, cars) = (&self.plan.agents[row], self.eyes.cars_on(row));
            let clock = self.age + plan.sensor.clock_ahead;
            let (shown, shown_steps) = (self.shown.now[row], self.shown.steps[row]);
            let light = LightView { shown, shown_steps, age: self.age, clock };
            observe::observe(plan, cars, light, percept.obs.row_mut(row));
            let d_set = percept.d_set.row_mut(row);
            match &self.borders {
                Some(borders) => borders.d_separate(row, light, d_set),
                None if self.plan.borders.is_empty() => {
                    observe::d_separate(plan, cars, percept.obs.row(row), self.sources.row(row), d_set);
                }
                None => {}
            }
            let (waiting, others) = (&self.eyes.waiting[row], self.eyes.others.as_ref().map(|others| &others.now[row]));
            let people = self.eyes.people.at(row);
            others.iter().for_each(|others| observe::observe_others(plan, others, people, percept.obs.row_mut(row)));
            if let Some((since, &draw)) = self.shown.since.get(row).zip(self.draws.get(row)) {
                let exits = self.eyes.exits.at(row);
                let readings = self.eyes.readings.get(row);
                let seen = Seen { cars, exits, people, shown, shown_steps, since, draw, readings };
                observe::observe_sets(plan, &seen, percept.obs.row_mut(row));
            }
            if let Some(readings) = self.eyes.readings.get(row) {
                observe::observe_detectors(plan, readings, percept.obs.row_mut(row));
            }
            let exits = self.eyes.exits.at(row);
            *reward = reward::reward(&self.plan.reward, &plan.region, cars, exits, waiting, others, people);
            let allows = |green| self.lights.allows(row, green);
            observe::mask(plan, shown, self.eyes.inside.at(row), allows, percept.masks.row_mut(row));
        }
    }
}

impl GlobalSimulator for GlobalTraffic {
    fn kinds(&self) -> &Kinds {
        &self.plan.kinds
    }

    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        if let Some(file) = &mut self.route_file
            && file.draw(&self.network, episode)?
        {
            self.source = source(&self.network, Some(file), self.programs.as_deref())?;
            if self.visits().is_some() {
                self.note_stops()?;
            }
        }
        // DEVIATION 3: loading again also clears the backlog of cars that wait at the boundary. In the authors' code it
        // leaks into the next episode.
        let mut options = self.source.options(self.decisions.control.is_actuated(), episode.for_sumo());
        if let Some(metrics) = &mut self.metrics {
            metrics.begin();
            options.extend(metrics.options());
            if metrics.measures_emissions() {
                self.source.equip_for_emissions(&mut self.simulation, &mut options);
            }
            self.events.iter().for_each(|events| events.add_to(&mut options));
        }
        self.light_delays.iter_mut().for_each(LightDelays::begin);
        self.source.load(&mut self.simulation, &options)?;
        if let Some(events) = self.events.as_mut().filter(|_| self.metrics.is_some()) {
            events.begin(&self.simulation)?;
        }
        let by_program = self.decisions.control.by_program();
        let program = self.decisions.control.is_actuated().then(|| self.source.actuated_program());
        let ours: Vec<usize> = (0..self.agents()).filter(|row| !by_program.contains(row)).collect();
        self.lights.reset(&mut self.simulation, &ours)?;
        self.lights.hand_to_program(&mut self.simulation, program, &by_program)?;
        self.decisions.begin(episode);
        self.read_cars()?;
        self.shown.begin(&mut self.lights, &mut self.simulation)?;
        self.age = 0;
        self.sources.fill(0);
        if let Some(borders) = &mut self.borders {
            borders.reset(&mut self.simulation)?;
        }
        self.history.iter_mut().for_each(|history| history.begin(self.plan.agents.len()));
        self.tally = Tally::new(self.agents(), self.plan.emergency_decel_mps2);
        self.eyes.begin(&self.plan, episode);
        if self.plan.sees_sets() {
            let greens = self.plan.agents.iter().map(AgentPlan::greens);
            self.shown.since = greens.map(SinceGreen::begin).collect();
            let share = |row| self.plan.seen_cars.of(episode, AgentId(row));
            self.draws = (0..self.agents()).map(|row| Draw::of(episode, share(row))).collect();
        }
        self.read_others()?;
        self.take_picture()?;
        self.perceive();
        if let Some(recorder) = &mut self.recorder {
            recorder.begin(episode.for_sumo(), self.route_file.as_ref().map(|file| &file.scenario));
        }
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        ensure!(!self.metrics.as_ref().is_some_and(TrafficMetrics::finished), "the episode ended with its measures");
        self.d_set_before.copy_from(&self.last.percept.d_set);
        self.shown.decide();
        self.eyes.decide();
        self.sources.fill(0);
        for number in 0..self.plan.decision_steps {
            self.second(number, actions)?;
        }
        self.decisions.advised = false;
        // Its returns would be the best possible ones.
        if self.tally.departed == 0 && self.age >= self.network.horizon * self.plan.decision_steps {
            self.network.check_not_empty(self.route_file.as_ref().map(|file| &file.scenario))?;
        }
        let begun = Instant::now();
        self.read_others()?;
        self.take_picture()?;
        self.perceive();
        self.watch.note(Phase::Reading, begun.elapsed());
        Ok(&self.last)
    }

    /// Reads all lanes of the regions of a scenario every second from then on. On a grid it changes nothing.
    fn observe_influence(&mut self) -> Result<()> {
        if !self.plan.borders.is_empty() && self.borders.is_none() {
            self.borders = Some(Borders::register(&mut self.simulation, self.plan.clone())?);
        }
        Ok(())
    }

    /// DEVIATION 5: the d-set of t and the arrivals from t to t + 1, which is what the LS samples.
    /// The authors pair both at t and use the prediction one step later.
    fn influence_sample(&self) -> InfluenceSample<'_> {
        InfluenceSample { d_set: &self.d_set_before, sources: &self.sources }
    }

    /// A program of SUMO cannot be asked.
    fn advise(&mut self, actions: &mut [Action]) -> bool {
        let (intersections, decisions) = self.intersections();
        let advice = decisions.advise(&intersections);
        advice.inspect(|advice| actions.copy_from_slice(advice)).is_some()
    }

    /// Read from the lights, so that it is known of SUMO's own programs, too. Yellow takes its time whatever the action.
    fn carried_out(&self, actions: &mut [Option<Action>]) {
        let shown = self.shown.at_decision.iter().zip(&self.shown.now);
        for ((action, (before, now)), agent) in actions.iter_mut().zip(shown).zip(&self.plan.agents) {
            *action = before.is_green().then(|| agent.phases.towards(*before, now.target()));
        }
    }

    fn watch_roads(&mut self) -> Result<bool> {
        self.eyes.watch_roads(&self.plan, self.network.travellers().as_ref());
        Ok(true)
    }

    fn roads(&self, now: &mut RoadsNow) {
        now.clear();
        let lights = self.shown.now.iter().zip(&self.shown.steps).map(|(&shown, &steps)| (shown, steps));
        self.eyes.roads(lights, now);
    }

    fn watch_scene(&mut self) -> Result<()> {
        let roads = self.network.recorded(&self.plan)?.roads;
        self.camera = Some(Camera::new(&roads, &self.plan.agents, &mut self.simulation)?);
        Ok(())
    }

    fn scene(&self) -> Option<Scene> {
        Some(self.camera.as_ref()?.draw())
    }

    fn measure_in_full(&mut self) -> Result<()> {
        let agents = self.plan.agents.iter().map(|agent| &agent.region.approaches);
        let at_stop_line = agents.map(|lanes| lanes.iter().map(|lane| lane.ahead_m == 0.0).collect()).collect();
        let window = Window { begin_s: self.network.begin_s(), end_s: 0.0, warm_up_s: self.network.warm_up_s };
        let metrics = TrafficMetrics::new(at_stop_line, self.network.travellers(), window)?;
        if metrics.has_persons() {
            let roads = self.network.recorded(&self.plan)?.roads;
            let lights: BTreeSet<&str> = roads.programs.iter().map(|program| &*program.light).collect();
            let others: Vec<OthersPlan> = lights.into_iter().map(|light| OthersPlan::of(&roads, light)).collect();
            let crossings = others.iter().map(|others| &others.crossings[..]);
            self.crossings = Some(Crossings::register(&mut self.simulation, crossings)?);
        }
        self.metrics = Some(metrics);
        Ok(())
    }

    fn measures(&mut self) -> Result<Measures> {
        let Some(metrics) = &mut self.metrics else { return Ok(self.tally.measures()) };
        if !metrics.finished() {
            // SUMO writes the trips of the cars that are still on the road when it ends.
            let end_s = self.simulation.time_s()?;
            self.simulation.unload()?;
            metrics.finish(end_s)?;
            self.events.as_mut().map_or(Ok(()), EventRecorder::finish)?;
        }
        let mut measures = self.tally.measures();
        measures.system.splice(1..1, metrics.of_net(self.tally.arrived));
        measures.per_agent.extend(metrics.of_agents());
        Ok(measures)
    }

    fn measure_lights(&mut self) -> Result<Option<Vec<LightPlace>>> {
        let delays = LightDelays::register(&mut self.simulation, &self.network.recorded(&self.plan)?)?;
        let lights = delays.ways.lights.clone();
        self.light_delays = Some(delays);
        Ok(Some(lights))
    }

    fn light_figures(&mut self) -> Option<LightsEpisode> {
        let metrics = self.metrics.as_ref().filter(|metrics| metrics.finished())?;
        Some(self.light_delays.as_ref()?.figures(metrics.counted_trips()))
    }

    fn measure_emissions(&mut self) -> Result<bool> {
        let metrics = self.metrics.as_mut().context("emissions are measured together with all else")?;
        metrics.measure_emissions();
        Ok(true)
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.watch.take()
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use std::path::Path;

    use super::*;
    use crate::Traffic;
    use crate::config::TrafficConfig;
    use crate::controllers::HandCoded;

    /// Returns when every car wanted to enter, in seconds, in an episode with this action at every step.
    fn wished_departures(control: SignalControl, action: Action) -> BTreeMap<String, i64> {
        let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../sumo_nets");
        let traffic = Traffic::open(&TrafficConfig::new(nets.join("grid_2x2"), nets.join("local"))).unwrap();
        let mut gs = traffic.global(control).unwrap();
        gs.measure_in_full().unwrap();
        gs.reset(Seed::new(21).for_episode(0)).unwrap();
        (0..300).for_each(|_| drop(gs.step(&[action; 4]).unwrap().clone()));
        gs.measures().unwrap();
        let trips = gs.metrics.unwrap().trips_as_text().unwrap();
        let trips = trips.lines().filter(|line| line.contains("<tripinfo "));
        trips
            .map(|line| {
                let text = |name: &str| line.split(&format!(" {name}=\"")).nth(1).unwrap().split('"').next().unwrap();
                let seconds = |name: &str| text(name).parse::<f64>().unwrap() as i64;
                // A car that never entered departs at -1. Its delay is the whole time since it wanted to enter.
                let departed = if seconds("depart") < 0 { 300 } else { seconds("depart") };
                (text("id").to_owned(), departed - seconds("departDelay"))
            })
            .collect()
    }

    #[test]
    fn the_same_cars_want_to_enter_at_the_same_seconds_whatever_the_lights_do() {
        let never = wished_departures(SignalControl::Agents, 0);
        // 8 edges x 300 steps x 0.1 = 240, standard deviation 14.7.
        assert!((180..300).contains(&never.len()), "{}", never.len());
        assert_eq!(never, wished_departures(SignalControl::Agents, 1));
        let agents = AgentId::all(4);
        assert_eq!(never, wished_departures(SignalControl::HandCoded { by: HandCoded::Actuated, agents }, 0));
    }
}
