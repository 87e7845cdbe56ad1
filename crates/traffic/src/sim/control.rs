//! Control of the lights of a GS: by the agents, or hand-coded.

use crate::controllers::intersections::Intersections;
use crate::controllers::{self, HandCoded};
use crate::light::KEEP;
use dials_core::base::{AgentId, Seed};
use dials_core::domain::Action;

pub enum SignalControl {
    Agents,
    /// Hand-coded control runs the lights of these agents, whatever the actions say; the actions run the others.
    HandCoded {
        by: HandCoded,
        agents: Vec<AgentId>,
    },
}

impl SignalControl {
    pub(crate) fn is_actuated(&self) -> bool {
        matches!(self, SignalControl::HandCoded { by: HandCoded::Actuated, .. })
    }

    pub(super) fn by_program(&self) -> Vec<usize> {
        match self {
            SignalControl::HandCoded {
                by: HandCoded::Actuated | HandCoded::OwnProgram | HandCoded::Programs(_),
                agents,
            } => agents.iter().map(|agent| agent.0).collect(),
            _ => Vec::new(),
        }
    }

    /// Returns the text of an additional file that SUMO loads last, if there is one.
    pub(super) fn programs(&self) -> Option<&str> {
        match self {
            SignalControl::HandCoded { by: HandCoded::Programs(text), .. } => Some(text),
            _ => None,
        }
    }
}

/// A rule decides once per second. Before a step it may be asked for its advice. The actions of that step then decide
/// for all lights, because whoever asked knows the advice.
pub(super) struct Decisions {
    /// Control from the next episode on.
    pub(super) control: SignalControl,
    /// Actions of the last second that the lights obeyed, `[agents]`, and those of the rule.
    pub(super) obeyed: Vec<Action>,
    by_rule: Vec<Action>,
    /// Whether the rule has already decided for the next second.
    heard: bool,
    /// Whether the actions of this step decide, because the rule was asked for its advice.
    pub(super) advised: bool,
}

impl Decisions {
    pub(super) fn new(control: SignalControl, agents: usize) -> Decisions {
        Decisions { control, obeyed: vec![KEEP; agents], by_rule: vec![KEEP; agents], heard: false, advised: false }
    }

    pub(super) fn has_rule(&self) -> bool {
        matches!(self.control, SignalControl::HandCoded { by: HandCoded::Rule(_), .. })
    }

    /// Returns whether the rule looks within the junctions and at people at its next decision.
    pub(super) fn looks_closely(&self) -> bool {
        matches!(&self.control, SignalControl::HandCoded { by: HandCoded::Rule(rule), .. } if rule.looks_closely())
    }

    pub(super) fn begin(&mut self, episode: Seed) {
        self.heard = false;
        self.advised = false;
        if let SignalControl::HandCoded { by: HandCoded::Rule(controller), .. } = &mut self.control {
            controller.begin(episode);
        }
    }

    /// Decides for the next second of a step with these `actions`.
    pub(super) fn decide(&mut self, actions: &[Action], intersections: &Intersections<'_>) {
        self.obeyed.copy_from_slice(actions);
        let heard = std::mem::replace(&mut self.heard, false);
        if !heard
            && self.ask(intersections)
            && !self.advised
            && let SignalControl::HandCoded { agents, .. } = &self.control
        {
            agents.iter().for_each(|agent| self.obeyed[agent.0] = self.by_rule[agent.0]);
        }
    }

    /// Returns what the rule, if there is one, would do now, and lets the actions of this step decide.
    pub(super) fn advise(&mut self, intersections: &Intersections<'_>) -> Option<&[Action]> {
        self.advised = self.ask(intersections);
        self.heard = self.advised;
        self.advised.then_some(&*self.by_rule)
    }

    /// Lets the rule decide about all lights. Returns whether there is a rule.
    fn ask(&mut self, intersections: &Intersections<'_>) -> bool {
        if let SignalControl::HandCoded { by: HandCoded::Rule(controller), .. } = &mut self.control {
            controllers::ask(&mut **controller, intersections, &mut self.by_rule);
            return true;
        }
        false
    }
}
