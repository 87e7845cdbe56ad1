//! What a light shows by itself: the phases of a `<tlLogic>`.

use anyhow::{Context, Result, ensure};

use super::attributes::{tag, text, time, time_if_there, wrong};
use crate::network::tree::Element;
use libsumo::SignalState;

/// Types of programs that may have no phases, because SUMO makes up what they show.
const WITHOUT_PHASES: [&str; 3] = ["off", "rail_signal", "rail_crossing"];

/// Largest number of phases of a program, and of letters of a state. Lights of real cities have a tenth of it.
const MOST_PHASES: usize = 500;
const MOST_LETTERS: usize = 1000;

#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    pub light: String,
    /// Name of the program among those of its light: SUMO's `programID`.
    pub(crate) id: String,
    pub kind: String,
    /// Time by which the program runs late, in seconds.
    pub(crate) offset_s: f64,
    /// Names and values of its `<param>`, such as `max-gap`.
    pub(crate) parameters: Vec<(String, String)>,
    /// Phases in their order, at least one unless SUMO makes up what the light shows. Their states have the same length.
    pub phases: Vec<Phase>,
}

#[derive(Clone, Debug, PartialEq)]
pub struct Phase {
    pub(crate) duration_s: f64,
    /// Shortest and longest duration of an actuated light, as far as the program gives them.
    pub(crate) limits_s: [Option<f64>; 2],
    pub state: SignalState,
    /// Name of the phase; in a program of type NEMA its number in a ring.
    pub(crate) name: Option<String>,
    /// Yellow and red after the phase in a program of type NEMA.
    pub(crate) change_s: [Option<f64>; 2],
    /// Phases that may follow; empty: the next one in their order.
    pub(crate) next: Vec<usize>,
}

impl Program {
    pub(crate) fn read(element: &Element) -> Result<Program> {
        let light = text(element, "id")?.to_owned();
        let phases = element.all("phase").map(|phase| read_phase(phase).with_context(|| tag(element)));
        let phases = phases.collect::<Result<Vec<_>>>()?;
        ensure!(
            !phases.is_empty() || needs_none(element),
            "{}: has no <phase>; a light shows at least one",
            tag(element)
        );
        ensure!(phases.len() <= MOST_PHASES, "{}: has more than {MOST_PHASES} phases, the limit", tag(element));
        let length = phases.first().map_or(0, |phase| phase.state.links());
        ensure!(length <= MOST_LETTERS, "{}: has states of more than {MOST_LETTERS} letters, the limit", tag(element));
        for (number, phase) in phases.iter().enumerate() {
            let (links, place) = (phase.state.links(), format!("{}: phase {number}", tag(element)));
            ensure!(links == length, "{place}: its state has {links} letters, but that of phase 0 has {length}");
            ensure!(
                phase.next.iter().all(|&next| next < phases.len()),
                "{place}: next: names a phase that is not there"
            );
        }
        let kind = element.attribute("type").unwrap_or("static").to_owned();
        let attribute = |parameter: &Element, name: &str| parameter.attribute(name).unwrap_or_default().to_owned();
        let parameters =
            element.all("param").map(|found| (attribute(found, "key"), attribute(found, "value"))).collect();
        let offset_s = offset_s(element)?;
        Ok(Program { light, id: name(element).to_owned(), kind, offset_s, parameters, phases })
    }

    /// Returns the number of letters of its states. `None`: it has no phases.
    pub fn letters(&self) -> Option<usize> {
        Some(self.phases.first()?.state.links())
    }

    pub(crate) fn after(&self, phase: usize) -> Vec<usize> {
        match &self.phases[phase].next[..] {
            [] => vec![(phase + 1) % self.phases.len()],
            next => next.to_vec(),
        }
    }
}

/// Returns whether an element is a program although it has no phases.
pub(super) fn needs_none(element: &Element) -> bool {
    element.attribute("type").is_some_and(|kind| WITHOUT_PHASES.contains(&kind))
}

pub(crate) fn name(element: &Element) -> &str {
    element.attribute("programID").unwrap_or("0")
}

pub(crate) fn offset_s(element: &Element) -> Result<f64> {
    Ok(time_if_there(element, "offset", f64::NEG_INFINITY)?.unwrap_or(0.0))
}

fn read_phase(element: &Element) -> Result<Phase> {
    let state = SignalState::new(text(element, "state")?).with_context(|| tag(element))?;
    let duration_s = time(element, "duration", 0.0)?;
    let limit = |name: &str| time_if_there(element, name, 0.0);
    let next = element.attribute("next").unwrap_or_default().split_whitespace();
    let next = next.map(|index| index.parse().map_err(|_| wrong(element, "next", "must be indices of phases")));
    Ok(Phase {
        duration_s,
        limits_s: [limit("minDur")?, limit("maxDur")?],
        state,
        name: element.attribute("name").map(str::to_owned),
        change_s: [limit("yellow")?, limit("red")?],
        next: next.collect::<Result<_>>()?,
    })
}
