//! Agents for the lights of any road network: from [`Roads`] to an [`AgentPlan`] for each light that can learn.
//!
//! Pure: no files and no simulation. The agents are in the order of the elements `<tlLogic>` of the net.

pub mod border;
pub mod clearing;
pub mod crossings;
pub mod greens;
pub mod keeping;
pub(crate) mod lanes;
pub mod limits;
pub mod overrides;
pub mod padding;
pub(crate) mod region;
pub(crate) mod ring_barrier;
pub mod safety;
#[cfg(test)]
mod tests;
pub mod warnings;

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use anyhow::{Result, bail, ensure};

use super::others_plan::OthersPlan;
use super::phase_plan::{Choice, PhasePlan, ProgramChange};
use super::plan::{AgentPlan, Border};
use crate::config::{Actions, Observation, ScenarioConfig, Yellow};
use crate::d_set::{DSetPlan, Parts};
use crate::network::roads::program::{Phase, Program};
use crate::network::roads::{EdgeNo, JunctionNo, Roads};
use border::Seconds;
use crossings::{TimedCrossing, Walking};
use greens::{Change, Greens, MOST_GREENS};
use keeping::{Keeping, Why};
use libsumo::SignalState;
use limits::{Because, Shortest};
use overrides::{LightOverride, Overrides};
use region::Region;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rules {
    /// How far before the stop line an agent sees cars, in metres; more than 0.
    pub approach_m: f64,
    pub yellow: Yellow,
    /// Least number of seconds of a green; at least 1.
    pub min_green_s: u32,
    /// Whether the shortest durations of the phases of a program hold, too.
    pub program_min_green: bool,
    /// How people on foot cross; `None`: their crossings make no green longer.
    pub walking: Option<Walking>,
    /// Whether masks mind the cars that are trapped within junctions.
    pub minds_trapped: bool,
    /// What an agent chooses from.
    pub actions: Actions,
    pub(crate) cars: Observation,
}

impl Rules {
    pub fn of(config: &ScenarioConfig) -> Rules {
        let &ScenarioConfig {
            approach_m,
            yellow_s,
            min_green_s,
            program_min_green,
            observation,
            actions,
            mind_trapped,
            ..
        } = config;
        Rules {
            approach_m,
            yellow: yellow_s,
            min_green_s,
            program_min_green,
            walking: config.walking(),
            minds_trapped: mind_trapped,
            actions,
            cars: observation,
        }
    }
}

impl Default for Rules {
    fn default() -> Rules {
        Rules {
            approach_m: 150.0,
            yellow: Yellow::default(),
            min_green_s: 5,
            program_min_green: true,
            walking: Some(Walking::default()),
            minds_trapped: true,
            actions: Actions::Greens,
            cars: Observation::Cells,
        }
    }
}

/// Longest shortest green that a program may ask for, in seconds. More would be a light that never changes.
const LONGEST_MIN_GREEN_S: f64 = 300.0;

/// Types of programs that agents replace.
const LEARN: [&str; 4] = ["static", "actuated", "delay_based", "NEMA"];

#[derive(Clone, Debug)]
pub struct Derived {
    /// Lights that learn, in the order of their elements `<tlLogic>`.
    pub agents: Vec<Agent>,
    /// Lights that keep their program, in the same order.
    pub keeping: Vec<Keeping>,
}

#[derive(Clone, Debug)]
pub struct Agent {
    pub plan: AgentPlan,
    pub region: Region,
    pub program: Program,
    /// Crossings under the light; empty if they do not count.
    pub crossings: Vec<TimedCrossing>,
    /// Shortest duration of each green, and why.
    pub shortest: Vec<Shortest>,
}

impl Agent {
    /// Returns the greens in which people may walk on a crossing.
    pub fn greens_of(&self, crossing: &TimedCrossing) -> Vec<usize> {
        let greens = self.plan.phases.greens().iter().enumerate();
        greens.filter(|(_, green)| crossing.walks(green)).map(|(number, _)| number).collect()
    }

    /// Returns the limits of each phase of its program, for lights that play these phases by rules of their own.
    ///
    /// A green may have several phases, such as one with a walk signal and one after it. What `agents.toml` says of the green
    /// counts for the first of them.
    pub(crate) fn limits_of_phases(&self) -> Vec<[Option<u32>; 2]> {
        let phases = &self.plan.phases;
        let mut seen = BTreeSet::new();
        let of_phase = |phase: &Phase| {
            let crossing = crossings::slowest(&self.crossings, &phase.state).map(|crossing| crossing.needed_s);
            let green = phases.green_of(&phase.state);
            let written = green.filter(|&green| seen.insert(green)).map(|green| &self.shortest[green]);
            let written = written.filter(|shortest| shortest.because == Because::Overrides).map(|it| it.seconds);
            [crossing.max(written), green.and_then(|green| phases.max_green_steps()[green])]
        };
        self.program.phases.iter().map(of_phase).collect()
    }
}

impl Derived {
    /// Returns an error if no light can learn. `roads`: those that it was derived from.
    pub fn check_learning(&self, roads: &Roads) -> Result<()> {
        let [Keeping { light, why }, others @ ..] = &self.keeping[..] else { return Ok(()) };
        let others = if others.is_empty() { String::new() } else { format!(" (and {} more lights)", others.len()) };
        let several = warnings::of_several(roads, light).map_or(String::new(), |several| format!("; {several}"));
        ensure!(
            !self.agents.is_empty(),
            "has no light that can learn: light `{light}`{others}: {why}; {}{several}",
            why.way_out()
        );
        Ok(())
    }

    pub(crate) fn plans(&self) -> Vec<AgentPlan> {
        self.agents.iter().map(|agent| agent.plan.clone()).collect()
    }

    /// `departs_on`: roads on which cars depart. `approach_m`: how far before the stop lines cars are seen.
    pub fn borders(
        &self,
        roads: &Roads,
        departs_on: &BTreeSet<EdgeNo>,
        approach_m: f64,
        seconds: Seconds,
    ) -> Vec<Border> {
        let of_agent = |Agent { plan, region, .. }: &Agent| {
            let border = border::border(roads, region, departs_on, seconds.decision);
            let d_set = DSetPlan::of(plan, &border, approach_m, Parts::of(seconds.episode));
            Border { plan: border, d_set }
        };
        self.agents.iter().map(of_agent).collect()
    }
}

/// Makes the agents of a net. Errors: the net has no light; the overrides name what the net does not have, or greens that are
/// not safe.
pub fn derive(roads: &Roads, rules: &Rules, overrides: &Overrides) -> Result<Derived> {
    let programs = programs(roads);
    let lit = region::lit_junctions(roads);
    if programs.is_empty() {
        bail!(
            "has no traffic light: no element <tlLogic>; give a junction one in netedit, or let netconvert guess them: \
             --tls.guess --tls.guess.threshold 30"
        );
    }
    overrides.check_names(&programs)?;
    let mut derived = Derived { agents: Vec::new(), keeping: Vec::new() };
    for program in programs {
        match agent(roads, &lit, rules, overrides, program)? {
            Ok(agent) => derived.agents.push(agent),
            Err(why) => {
                overrides.check_may_keep(&program.light, &why)?;
                derived.keeping.push(Keeping { light: program.light.clone(), why });
            }
        }
    }
    Ok(derived)
}

/// Returns the program of each light that its greens come from: the last one, which is the one that SUMO runs.
fn programs(roads: &Roads) -> Vec<&Program> {
    let mut last: HashMap<&str, &Program> = HashMap::new();
    for program in &roads.programs {
        last.insert(&program.light, program);
    }
    // Lights are in the order of their first programs.
    roads.programs.iter().filter_map(|program| last.remove(&*program.light)).collect()
}

fn program_changes(of_program: &Greens, greens: &[SignalState]) -> Vec<ProgramChange> {
    let place = |state: &SignalState| greens.iter().position(|green| green == state);
    let known = |change: Change<'_>| {
        let between = change.between.iter().map(|phase| phase.state.clone()).collect();
        Some(ProgramChange { from: place(change.from)?, to: place(change.to)?, between })
    };
    of_program.changes().into_iter().filter_map(known).collect()
}

/// Returns the agent of a light, or why it keeps its program. `lit`: all junctions under a light.
fn agent(
    roads: &Roads,
    lit: &BTreeSet<JunctionNo>,
    rules: &Rules,
    overrides: &Overrides,
    program: &Program,
) -> Result<Result<Agent, Why>> {
    let light = &program.light;
    if !overrides.learns(light) {
        return Ok(Err(Why::Excluded));
    }
    if !LEARN.contains(&program.kind.as_str()) {
        return Ok(Err(Why::Kind(program.kind.clone())));
    }
    if roads.switched.contains(light) {
        return Ok(Err(Why::Switched));
    }
    if roads.of_light(light).next().is_none() {
        return Ok(Err(Why::NoLink));
    }
    if roads.under_light(light).next().is_none() {
        return Ok(Err(Why::NoCars));
    }
    let own = overrides.of(light);
    let cars = roads.letters_of_vehicles(light);
    let of_program = Greens::of(program, &cars);
    let written = own.greens();
    let of_rings = match rules.actions {
        Actions::RingBarrier if written.is_none() => Some(ring_barrier::greens(roads, program)?),
        _ => None,
    };
    let greens = written.as_deref().or(of_rings.as_ref().map(|rings| &rings.greens[..])).unwrap_or(of_program.states());
    if !(2..=MOST_GREENS).contains(&greens.len()) {
        return Ok(Err(Why::Greens(greens.len())));
    }
    let LightOverride { yellow_s, all_red_s, .. } = own;
    let rings = of_rings.as_ref();
    let all_red_s = all_red_s.or(rings.and_then(|rings| rings.all_red_s));
    let of_rules = match (rules.yellow, rings.and_then(|rings| rings.yellow_s)) {
        (Yellow::Program, Some(seconds)) => Yellow::Seconds(seconds),
        (yellow, _) => yellow,
    };
    let times = clearing::Times::of(&of_program, yellow_s.map_or(of_rules, Yellow::Seconds), all_red_s);
    let crossings = rules.walking.map_or_else(Vec::new, |walking| crossings::of(roads, light, walking));
    // A crossing may share its letter with cars. Then it ends with them.
    let ending: Vec<TimedCrossing> = crossings.iter().filter(|it| !cars.contains(&it.letter)).cloned().collect();
    let clearing = |from: usize, to: usize| clearing::between(&greens[from], &greens[to], &times, &ending);
    let choice = if rules.actions == Actions::FixedOrder { Choice::InOrder } else { Choice::Target };
    let mut phases = PhasePlan::new(greens.to_vec(), choice, 1, clearing).for_cars(cars.clone());
    let min_dur_s = |green: usize| {
        let seconds = match rings {
            Some(rings) => rings.least_s[green],
            None => of_program.least_s(&greens[green]),
        };
        let seconds = seconds.filter(|_| rules.program_min_green)?;
        Some(seconds.ceil().min(LONGEST_MIN_GREEN_S) as u32)
    };
    let shortest = limits::shortest(greens, rules, own, min_dur_s, &crossings);
    let links = roads.of_light(light).filter_map(|link| Some(link.signal.as_ref()?.letter)).collect();
    phases = limits::apply(light, phases, &shortest, own, &links)?;
    phases.program = program_changes(&of_program, greens);
    safety::check(roads, program, &phases)?;
    let region = Region::of(roads, lit, light, rules.approach_m, own.approaches.as_deref())?;
    let lanes = lanes::region_plan(roads, light, &region, rules.minds_trapped)?;
    let sensor = lanes::sensor(&lanes, rules, phases.greens().len());
    let plan = AgentPlan {
        light: light.clone(),
        place_m: region.place_m(roads),
        region: lanes,
        others: OthersPlan::of(roads, light),
        phases: Arc::new(phases),
        sensor,
    };
    Ok(Ok(Agent { plan, region, program: program.clone(), crossings, shortest }))
}
