//! Plans as programs of SUMO: an additional file that SUMO loads after the others. So its programs are those that run.

use std::collections::HashSet;
use std::io;

use anyhow::{Result, bail};

use super::day::{DayPlan, Stage};
use super::freeze::Watched;
use crate::Traffic;
use crate::agents::plan::AgentPlan;
use crate::controllers::Timing;
use crate::cut::names::free_name;
use crate::network::roads::Roads;
use crate::network::tree::Element;
use crate::network::xml::{Xml, document, element, leaf, nest};
use libsumo::SignalState;

/// The text of an additional file, and the names of the programs in it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Programs {
    pub text: String,
    /// Name of each program, `[lights][stages]`.
    pub(super) ids: Vec<Vec<String>>,
    /// Shortest and longest greens in seconds, `[lights][greens]`, if the lights are actuated.
    pub(super) limits_s: Option<Vec<Vec<[u32; 2]>>>,
}

/// A phase of a program.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Phase<'a> {
    pub(super) state: &'a SignalState,
    pub(super) seconds: u32,
    pub(super) part: Part,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Green(usize),
    /// Cars still have the green, and people on foot end their way across.
    WalkEnd,
    Between,
}

/// Returns the phases of a timing, from its first green on.
pub(super) fn phases<'a>(plan: &'a AgentPlan, timing: &Timing) -> Vec<Phase<'a>> {
    let mut phases = Vec::new();
    for green in timing.order() {
        let state = &plan.phases.greens()[green];
        phases.push(Phase { state, seconds: timing.stay_in(green), part: Part::Green(green) });
        let next = timing.after(green);
        let mut left = plan.phases.walk_end_steps(green, next);
        for interval in plan.phases.clearing(green, next) {
            let part = if left > 0 { Part::WalkEnd } else { Part::Between };
            left = left.saturating_sub(interval.steps);
            phases.push(Phase { state: &interval.state, seconds: interval.steps, part });
        }
    }
    phases
}

/// Writes a plan as fixed-time programs. `name`: of the programs, unless a light has one of this name already.
///
/// A light with several stages is switched from program to program at their seconds (WAUT).
/// Errors: SUMO would refuse a program.
pub fn fixed(traffic: &Traffic, plan: &DayPlan, name: &str) -> Result<Programs> {
    write(traffic, plan, name, None)
}

/// Writes programs of SUMO's actuated lights: the greens of the plan in its order, each between the shortest and the
/// longest length that was watched. Errors: as [`fixed`].
pub fn actuated(traffic: &Traffic, plan: &DayPlan, watched: &Watched, name: &str) -> Result<Programs> {
    write(traffic, plan, name, Some(watched.limits_s(traffic.plans())))
}

fn write(traffic: &Traffic, plan: &DayPlan, name: &str, limits_s: Option<Vec<Vec<[u32; 2]>>>) -> Result<Programs> {
    let roads = traffic.network.roads()?;
    let mut ids = Vec::new();
    for (light, agent) in traffic.plans().iter().enumerate() {
        let stages = plan.stages(light);
        stages.iter().try_for_each(|stage| check(traffic, &roads, agent, stage))?;
        let mut taken: HashSet<String> = {
            let programs = roads.programs.iter().filter(|program| program.light == agent.light);
            programs.map(|program| program.id.clone()).collect()
        };
        let of_light = (1..=stages.len()).map(|number| {
            let name = if stages.len() == 1 { name.to_owned() } else { format!("{name}-{number}") };
            let id = free_name(&name, |name| taken.contains(name));
            taken.insert(id.clone());
            id
        });
        ids.push(of_light.collect::<Vec<_>>());
    }
    let kept = chosen_and_kept(traffic)?;
    let wauts: HashSet<String> = traffic.network.wauts().into_iter().collect();
    let text = document("additional", |xml| {
        for (light, agent) in traffic.plans().iter().enumerate() {
            for (stage, id) in plan.stages(light).iter().zip(&ids[light]) {
                program(xml, agent, stage, id, limits_s.as_ref().map(|limits| &limits[light][..]))?;
            }
        }
        kept.iter().try_for_each(|program| element(xml, program))?;
        for (light, agent) in traffic.plans().iter().enumerate().filter(|&(light, _)| ids[light].len() > 1) {
            let id = free_name(&format!("{name}.{}", agent.light), |name| wauts.contains(name));
            switches(xml, agent, &id, &plan.stages(light), &ids[light])?;
        }
        Ok(())
    });
    Ok(Programs { text, ids, limits_s })
}

/// Returns the programs of lights without a plan that a config has chosen. Plain SUMO would run their last ones, so it gets
/// copies under other names. Errors: plain SUMO would switch a light to other programs than those of the plan.
fn chosen_and_kept(traffic: &Traffic) -> Result<Vec<Element>> {
    let Some((chosen, programs)) = traffic.network.chosen_programs() else { return Ok(Vec::new()) };
    if let Some(light) = chosen.switched.first() {
        bail!(
            "light `{light}`: a <wautJunction> of the scenario would switch it to other programs, whatever the plan says; \
             remove that element"
        );
    }
    let has_plan = |light: &str| traffic.plans().iter().any(|agent| agent.light == light);
    let copy = |light: &String| {
        let of_light = || programs.iter().filter(|program| program.attribute("id") == Some(light));
        // Those behind the chosen one were taken out.
        let mut copy = (*of_light().next_back()?).clone();
        // Names of programs that were taken out are not known here, but nobody calls one so.
        let id =
            free_name("chosen-for-plan", |name| of_light().any(|program| program.attribute("programID") == Some(name)));
        copy.attributes.retain(|(key, _)| key != "programID");
        copy.attributes.push(("programID".to_owned(), id));
        Some(copy)
    };
    Ok(chosen.lights.iter().filter(|light| !has_plan(light)).filter_map(copy).collect())
}

/// Returns an error if SUMO would refuse the program of a stage in an additional file.
fn check(traffic: &Traffic, roads: &Roads, agent: &AgentPlan, stage: &Stage<'_>) -> Result<()> {
    let phases = phases(agent, stage.timing);
    let states: Vec<&SignalState> = phases.iter().map(|phase| phase.state).collect();
    if let Some([one, two]) = roads.waiting_for_each_other(&agent.light, &states) {
        bail!(
            "light `{}`: SUMO refuses its program in a file of its own: `g` for the letters {one} and {two} at once, whose \
             cars yield to each other; make the net anew with `netconvert -s {} --tls.ignore-internal-junction-jam -o \
             NEW.net.xml`, and use that",
            agent.light,
            traffic.network.net_name()
        );
    }
    Ok(())
}

fn program(
    xml: &mut Xml,
    agent: &AgentPlan,
    stage: &Stage<'_>,
    id: &str,
    limits_s: Option<&[[u32; 2]]>,
) -> io::Result<()> {
    let kind = if limits_s.is_some() { "actuated" } else { "static" };
    let offset = stage.offset_s.to_string();
    let head = [("id", &*agent.light), ("type", kind), ("programID", id), ("offset", &offset)];
    nest(xml, "tlLogic", head, |xml| {
        phases(agent, stage.timing).iter().try_for_each(|phase| {
            let limits = match phase.part {
                Part::Green(green) => limits_s.map(|limits| {
                    // The limits are those of cars, which keep the green for the end of the walk.
                    let walk_end = agent.phases.walk_end_steps(green, stage.timing.after(green));
                    limits[green].map(|seconds| seconds.saturating_sub(walk_end).max(1))
                }),
                Part::WalkEnd | Part::Between => None,
            };
            let seconds = limits.map_or(phase.seconds, |[least, most]| phase.seconds.clamp(least, most));
            let limits = limits.map(|[least, most]| [("minDur", least.to_string()), ("maxDur", most.to_string())]);
            let attributes = [("duration", seconds.to_string())].into_iter().chain(limits.into_iter().flatten());
            leaf(xml, "phase", attributes.chain([("state", phase.state.as_str().to_owned())]))
        })
    })
}

fn switches(xml: &mut Xml, agent: &AgentPlan, id: &str, stages: &[Stage<'_>], programs: &[String]) -> io::Result<()> {
    nest(xml, "WAUT", [("id", id), ("refTime", "0"), ("startProg", &programs[0])], |xml| {
        stages.iter().zip(programs).skip(1).try_for_each(|(stage, program)| {
            leaf(xml, "wautSwitch", [("time", &*stage.from_s.to_string()), ("to", program)])
        })
    })?;
    leaf(xml, "wautJunction", [("wautID", id), ("junctionID", &agent.light)])
}
