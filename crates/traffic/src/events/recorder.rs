//! Logs the episodes of a GS that are measured.

use std::collections::{HashMap, HashSet};

use anyhow::Result;

use super::loops::{LoopPlace, Loops};
use super::phases::PhaseClock;
use super::presence::{Passage, Presence};
use super::site::{DetectorPlace, Site};
use super::{Event, EventLog, code};
use libsumo::{CarId, CarTable, LaneId, LightId, SignalState, Simulation};

const MICROS_PER_S: u64 = 1_000_000;
const MICROS_PER_TENTH: u64 = MICROS_PER_S / 10;

pub(crate) struct EventRecorder {
    log: EventLog,
    sites: Vec<Site>,
    lights: Vec<LightId>,
    /// Lanes of the detectors that end at a stop line, and which ones these are: site, detector, its beginning in metres.
    lanes: Vec<LaneId>,
    stop_bars: Vec<(usize, usize, f64)>,
    loops: Loops,
    /// Length of SUMO's step. SUMO dates what happens in the step at second `t` to the time before `t`, and lights change at `t`.
    step_micros: u64,
    episode: Option<Episode>,
    /// Memory that is used again.
    states: Vec<SignalState>,
    cars: CarTable,
}

/// What is known of the episode under way.
struct Episode {
    begin_s: u64,
    seconds: u64,
    clocks: Vec<PhaseClock>,
    of_phases: Vec<Event>,
    /// Numbers of cars by their names in SUMO.
    cars: HashMap<String, CarId>,
    /// Cars on each stop-bar detector at the last read.
    found: Vec<Vec<CarId>>,
    /// What reads found: time in millionths of a second, site, detector, passage.
    reads: Vec<(u64, usize, usize, Passage)>,
    gone: Vec<(u64, CarId)>,
}

impl EventRecorder {
    pub(crate) fn new(log: &EventLog, sites: Vec<Site>, simulation: &mut Simulation) -> Result<EventRecorder> {
        let lights: Vec<&String> = sites.iter().map(|site| &site.light).collect();
        let lights = simulation.register_lights(&lights)?;
        let all = || {
            sites
                .iter()
                .enumerate()
                .flat_map(|(number, site)| site.detectors.iter().zip(0..).zip(std::iter::repeat(number)))
        };
        let at_stop_line = || all().filter(|((detector, _), _)| detector.place == DetectorPlace::StopBar);
        let names: Vec<&String> = at_stop_line().map(|((detector, _), _)| &detector.lane).collect();
        Ok(EventRecorder {
            log: log.clone(),
            lights,
            lanes: simulation.register_lanes(&names)?,
            stop_bars: at_stop_line().map(|((detector, number), site)| (site, number, detector.begin_m)).collect(),
            loops: Loops::of(&sites)?,
            step_micros: MICROS_PER_S / u64::from(simulation.steps_per_second()),
            episode: None,
            states: Vec::new(),
            cars: CarTable::new(),
            sites,
        })
    }

    /// Adds the loops to the options with which SUMO is loaded for an episode.
    pub(crate) fn add_to(&self, options: &mut Vec<String>) {
        self.loops.add_to(options);
    }

    /// Begins an episode that was loaded. What an earlier one has not [finished](Self::finish) is dropped.
    pub(crate) fn begin(&mut self, simulation: &Simulation) -> Result<()> {
        self.episode = Some(Episode {
            begin_s: simulation.time_s()?.round() as u64,
            seconds: 0,
            clocks: self.sites.iter().map(PhaseClock::new).collect(),
            of_phases: Vec::new(),
            cars: HashMap::new(),
            found: vec![Vec::new(); self.lanes.len()],
            reads: Vec::new(),
            gone: Vec::new(),
        });
        Ok(())
    }

    /// Notes a second that was simulated. Lights that this program sets have shown what they show now during the whole of it.
    pub(crate) fn second(&mut self, simulation: &mut Simulation) -> Result<()> {
        let Some(episode) = &mut self.episode else { return Ok(()) };
        simulation.read_lights(&self.lights, &mut self.states)?;
        simulation.read_lanes(&self.lanes, &mut self.cars)?;
        let begin_s = episode.begin_s + episode.seconds;
        episode.seconds += 1;
        for (number, (site, state)) in self.sites.iter().zip(&self.states).enumerate() {
            let events = episode.clocks[number].second(site, state).into_iter();
            let event = |(code, parameter)| Event { tenths: 10 * begin_s, site: number, code, parameter };
            episode.of_phases.extend(events.map(event));
        }
        for departure in simulation.departures()? {
            episode.cars.insert(departure.name, departure.id);
        }
        let now = MICROS_PER_S * (begin_s + 1);
        episode.gone.extend(simulation.gone()?.into_iter().map(|car| (now, car)));
        for (lane, (&(site, detector, begin_m), before)) in self.stop_bars.iter().zip(&mut episode.found).enumerate() {
            let on = self.cars.lane(lane).iter().filter(|car| car.position_m >= begin_m).map(|car| car.id);
            let on: Vec<CarId> = on.collect();
            let mut note = |passage| episode.reads.push((now, site, detector, passage));
            before.iter().filter(|car| !on.contains(car)).for_each(|&car| note(Passage::Lost(car)));
            on.iter().filter(|car| !before.contains(car)).for_each(|&car| note(Passage::Found(car)));
            *before = on;
        }
        Ok(())
    }

    /// Puts the episode into the log. The simulation must be unloaded: until then SUMO keeps what it writes.
    pub(crate) fn finish(&mut self) -> Result<()> {
        let Some(mut episode) = self.episode.take() else { return Ok(()) };
        let mut passages: Vec<(u64, usize, usize, Passage)> = Vec::new();
        for crossing in self.loops.crossings()? {
            // Not there: a car that entered and arrived within a second.
            let Some(&car) = episode.cars.get(&crossing.car) else { continue };
            let ends_here = self.sites[crossing.site].detectors[crossing.detector].place == DetectorPlace::Advance;
            let passage = match (crossing.place, crossing.is_front) {
                (LoopPlace::Begin, true) => Passage::Comes(car),
                (LoopPlace::Begin, false) if ends_here => Passage::Leaves(car),
                // Its rear is now over the detector, too.
                (LoopPlace::Begin, false) => continue,
                (LoopPlace::End, true) => Passage::Passes(car),
                (LoopPlace::End, false) => Passage::Leaves(car),
            };
            passages.push((crossing.micros + self.step_micros, crossing.site, crossing.detector, passage));
        }
        passages.append(&mut episode.reads);
        passages.extend(self.lost_unread(&passages));
        // What loops saw comes before what was read at the end of the second.
        passages.sort_by_key(|&(micros, site, detector, _)| (micros, site, detector));
        let mut events = std::mem::take(&mut episode.of_phases);
        let mut presence: Vec<Vec<Presence>> =
            self.sites.iter().map(|site| site.detectors.iter().map(|_| Presence::default()).collect()).collect();
        let mut note = |presence: &mut Presence, (micros, site, detector, passage): (u64, usize, usize, Passage)| {
            if let Some(is_on) = presence.note(passage) {
                events.push(event(micros, site, detector, is_on));
            }
        };
        let mut gone = episode.gone.iter().peekable();
        for passage in passages {
            let (micros, site, detector, _) = passage;
            while let Some((gone_at, car)) = gone.next_if(|(gone_at, _)| *gone_at <= micros) {
                for (site, presence) in presence.iter_mut().enumerate() {
                    for (detector, presence) in presence.iter_mut().enumerate() {
                        note(presence, (*gone_at, site, detector, Passage::Gone(*car)));
                    }
                }
            }
            note(&mut presence[site][detector], passage);
        }
        let end_s = episode.begin_s + episode.seconds;
        // The next episode begins on empty roads.
        for (site, presence) in presence.iter().enumerate() {
            let on = presence.iter().enumerate().filter(|(_, presence)| presence.is_on());
            events.extend(on.map(|(detector, _)| event(MICROS_PER_S * end_s, site, detector, false)));
        }
        events.sort_by_key(|event| (event.tenths, event.site));
        self.log.add(events, end_s);
        Ok(())
    }
}

impl EventRecorder {
    /// Returns when cars are lost that came to a stop bar and changed lanes within a second: they are in no read.
    fn lost_unread(&self, passages: &[(u64, usize, usize, Passage)]) -> Vec<(u64, usize, usize, Passage)> {
        let end_of = |micros: u64| micros.div_ceil(MICROS_PER_S) * MICROS_PER_S;
        let known: HashSet<(u64, usize, usize, CarId)> = passages
            .iter()
            .filter_map(|&(micros, site, detector, passage)| match passage {
                Passage::Passes(car) | Passage::Found(car) => Some((end_of(micros), site, detector, car)),
                _ => None,
            })
            .collect();
        let lost = passages.iter().filter_map(|&(micros, site, detector, passage)| match passage {
            Passage::Comes(car)
                if self.sites[site].detectors[detector].place == DetectorPlace::StopBar
                    && !known.contains(&(end_of(micros), site, detector, car)) =>
            {
                Some((end_of(micros), site, detector, Passage::Lost(car)))
            }
            _ => None,
        });
        lost.collect()
    }
}

fn event(micros: u64, site: usize, detector: usize, is_on: bool) -> Event {
    let code = if is_on { code::DETECTOR_ON } else { code::DETECTOR_OFF };
    let parameter = u16::try_from(detector + 1).expect("a light has fewer detectors than 65 536");
    Event { tenths: micros / MICROS_PER_TENTH, site, code, parameter }
}
