//! Plans as engineers read them: the phases of each light, and which approach has green when.

use std::collections::BTreeMap;

use anyhow::Result;

use super::day::{DayPlan, Stage};
use super::programs::{Part, Phase, Programs, phases};
use crate::Traffic;
use crate::agents::plan::AgentPlan;
use crate::network::roads::{Connection, Function, Roads};
use dials_core::domain::signal_sheet::{Aspect, PhaseSheet, ProgramSheet, SignalGroup, SignalSheet};

/// Largest number of streets that the name of a group says where it leads to.
const MOST_TARGETS: usize = 2;

/// Returns a sheet for each light of a plan. `programs`: those that were written of it.
pub fn sheets(traffic: &Traffic, plan: &DayPlan, programs: &Programs) -> Result<Vec<SignalSheet>> {
    let words = Words { roads: &traffic.network.roads()? };
    let sheet = |(light, agent): (usize, &AgentPlan)| {
        let limits = programs.limits_s.as_ref().map(|limits| &limits[light][..]);
        let program = |(stage, id): (&Stage<'_>, &String)| words.program(agent, stage, id, limits);
        SignalSheet {
            light: agent.light.clone(),
            streets: words.roads.streets_to(&agent.light).into_iter().map(str::to_owned).collect(),
            programs: plan.stages(light).iter().zip(&programs.ids[light]).map(program).collect(),
        }
    };
    Ok(traffic.plans().iter().enumerate().map(sheet).collect())
}

struct Words<'a> {
    roads: &'a Roads,
}

impl Words<'_> {
    fn edge_from<'b>(&'b self, link: &Connection) -> &'b str {
        &self.roads.edge(self.roads.lane(link.from).edge).id
    }

    fn edge_to<'b>(&'b self, link: &Connection) -> &'b str {
        &self.roads.edge(self.roads.lane(link.to).edge).id
    }

    fn crosses_on_foot(&self, link: &Connection) -> bool {
        self.roads.edge(self.roads.lane(link.to).edge).function == Function::Crossing
    }

    /// Returns the name of a road: that of its street, or its id.
    fn name<'b>(&'b self, edge: &'b str) -> &'b str {
        self.roads.edge_named(edge).map_or(edge, |number| self.roads.edge(number).name())
    }

    fn program(&self, agent: &AgentPlan, stage: &Stage<'_>, id: &str, limits_s: Option<&[[u32; 2]]>) -> ProgramSheet {
        let phases = phases(agent, stage.timing);
        let groups = self.groups(&agent.light, &phases);
        let mut of_greens: Vec<PhaseSheet> = Vec::new();
        let mut begun_s = 0;
        for phase in &phases {
            match (phase.part, of_greens.last_mut()) {
                (Part::Green(green), _) => of_greens.push(PhaseSheet {
                    green_s: phase.seconds,
                    pedestrian_clearance_s: 0,
                    yellow_s: 0,
                    all_red_s: 0,
                    limits_s: limits_s.map(|limits| limits[green]),
                    state: phase.state.as_str().to_owned(),
                    serves: groups
                        .iter()
                        .filter(|group| has_green(group, begun_s))
                        .map(|group| group.name.clone())
                        .collect(),
                }),
                (Part::WalkEnd, Some(last)) => {
                    last.green_s += phase.seconds;
                    last.pedestrian_clearance_s += phase.seconds;
                }
                (Part::Between, Some(last)) if phase.state.as_str().contains(['y', 'Y']) => {
                    last.yellow_s += phase.seconds;
                }
                (Part::Between, Some(last)) => last.all_red_s += phase.seconds,
                (_, None) => unreachable!("a cycle begins with a green"),
            }
            begun_s += phase.seconds;
        }
        ProgramSheet {
            id: id.to_owned(),
            from_s: stage.from_s,
            to_s: stage.to_s,
            cycle_s: stage.timing.cycle(),
            offset_s: stage.offset_s,
            phases: of_greens,
            groups,
        }
    }

    /// Returns the groups of a light: links from the same road that always show the same, and crossings. Those of cars
    /// come first.
    fn groups(&self, light: &str, phases: &[Phase<'_>]) -> Vec<SignalGroup> {
        let shown =
            |letter: usize| -> Vec<u8> { phases.iter().map(|phase| phase.state.as_str().as_bytes()[letter]).collect() };
        // By road, in the order of the file.
        let mut groups: Vec<(bool, &str, Vec<u8>, Vec<&Connection>)> = Vec::new();
        for link in self.roads.of_light(light) {
            let Some(signal) = &link.signal else { continue };
            let on_foot = self.crosses_on_foot(link);
            let (edge, shown) = (if on_foot { self.edge_to(link) } else { self.edge_from(link) }, shown(signal.letter));
            match groups.iter_mut().find(|(_, other, letters, _)| *other == edge && *letters == shown) {
                Some((.., links)) => links.push(link),
                None => groups.push((on_foot, edge, shown, vec![link])),
            }
        }
        groups.sort_by_key(|&(on_foot, ..)| on_foot);
        let mut of_edge: BTreeMap<&str, usize> = BTreeMap::new();
        groups.iter().for_each(|(_, edge, ..)| *of_edge.entry(edge).or_default() += 1);
        let mut named: Vec<SignalGroup> = Vec::new();
        for (on_foot, edge, letters, links) in &groups {
            let name = match (*on_foot, of_edge[edge]) {
                (true, _) => self.on_foot(edge),
                (false, 1) => self.both(edge),
                (false, _) => format!("{} to {}", self.both(edge), self.targets(links)),
            };
            named.push(SignalGroup { name, on_foot: *on_foot, bars: bars(letters, phases) });
        }
        named
    }

    /// Returns the street with the id of the road, which says which side it comes from.
    fn both(&self, edge: &str) -> String {
        let name = self.name(edge);
        if name == edge { edge.to_owned() } else { format!("{name} ({edge})") }
    }

    /// Returns the streets that a crossing leads across, with its id: a street may have a crossing on either side.
    fn on_foot(&self, crossing: &str) -> String {
        let number = self.roads.edge_named(crossing);
        let across = number.map_or(&[][..], |number| &self.roads.edge(number).crosses);
        match across {
            [] => format!("on foot, {crossing}"),
            _ => format!("on foot across {} ({crossing})", names(across.iter().map(|edge| self.name(edge)))),
        }
    }

    fn targets(&self, links: &[&Connection]) -> String {
        names(links.iter().map(|link| self.name(self.edge_to(link))))
    }
}

/// Lists names, each once.
fn names<'n>(all: impl Iterator<Item = &'n str>) -> String {
    let mut names: Vec<&str> = all.collect();
    names.sort_unstable();
    names.dedup();
    let more = if names.len() > MOST_TARGETS { " and others" } else { "" };
    names.truncate(MOST_TARGETS);
    names.join(", ") + more
}

fn has_green(group: &SignalGroup, second: u32) -> bool {
    let mut end = 0;
    let at = group.bars.iter().find(|(_, seconds)| {
        end += seconds;
        second < end
    });
    at.is_some_and(|(aspect, _)| matches!(aspect, Aspect::Green | Aspect::YieldingGreen))
}

fn bars(letters: &[u8], phases: &[Phase<'_>]) -> Vec<(Aspect, u32)> {
    let mut bars: Vec<(Aspect, u32)> = Vec::new();
    for (letter, phase) in letters.iter().zip(phases) {
        let aspect = match letter {
            b'G' | b'O' => Aspect::Green,
            b'g' | b'o' => Aspect::YieldingGreen,
            b'y' | b'Y' | b'u' => Aspect::Yellow,
            _ => Aspect::Red,
        };
        match bars.last_mut().filter(|(last, _)| *last == aspect) {
            Some((_, seconds)) => *seconds += phase.seconds,
            None => bars.push((aspect, phase.seconds)),
        }
    }
    bars
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::light_limits_test::{CROSSING, crossing_roads};
    use crate::network::tree::parse;

    #[test]
    fn a_crossing_is_called_by_the_street_that_people_cross() {
        let roads = crossing_roads();
        assert_eq!(Words { roads: &roads }.on_foot(":A0_c0"), "on foot across A0top0, top0A0.40.00 (:A0_c0)");
        let named = |edge: &str| (format!("<edge id=\"{edge}\""), format!("<edge name=\"High Street\" id=\"{edge}\""));
        let changes = ["A0top0", "top0A0.40.00"].map(named);
        let net = changes.iter().fold(CROSSING.to_owned(), |net, (from, to)| net.replace(from, to));
        let roads = Roads::read(&parse(&net).unwrap()).unwrap();
        assert_eq!(Words { roads: &roads }.on_foot(":A0_c0"), "on foot across High Street (:A0_c0)");
    }

    #[test]
    fn names_are_listed_once_and_long_lists_are_cut() {
        assert_eq!(names(["b", "a", "b"].into_iter()), "a, b");
        assert_eq!(names(["c", "b", "a"].into_iter()), "a, b and others");
    }
}
