//! What somebody should know of the programs of a net before he compares controllers.

use std::collections::{BTreeSet, HashMap};
use std::ops::Range;

use super::Agent;
use super::crossings::TimedCrossing;
use super::greens::{Greens, goes};
use super::keeping::names;
use super::programs;
use crate::network::roads::Roads;
use crate::network::roads::program::{Phase, Program};
use dials_core::base::counted;

/// Largest number of links that are named.
const MOST_LINKS: usize = 5;

/// Returns a sentence for each thing that is odd about the programs that count.
pub fn warnings(roads: &Roads) -> Vec<String> {
    let counting: Vec<&Program> = programs(roads).into_iter().filter(|program| !program.phases.is_empty()).collect();
    let mut counts: HashMap<&str, usize> = HashMap::new();
    roads.programs.iter().for_each(|program| *counts.entry(&program.light).or_default() += 1);
    let several = counting.iter().filter(|program| counts[&*program.light] > 1);
    let several = several.filter_map(|program| of_several(roads, &program.light));
    let jumping: Vec<&str> =
        counting.iter().filter(|program| jumps(roads, program)).map(|program| &*program.light).collect();
    let jumping = (!jumping.is_empty()).then(|| {
        format!(
            "{} without yellow somewhere ({}): `program` and `actuated` lose no time there, all other controllers and agents \
             show yellow",
            match jumping.len() {
                1 => "a program goes from green to red".to_owned(),
                count => format!("{count} programs go from green to red"),
            },
            names(&jumping)
        )
    });
    let closed = counting.iter().filter_map(|program| never_green(roads, program));
    several.chain(jumping).chain(closed).collect()
}

/// Returns a sentence about lights whose own program has walk signals that are shorter than people on foot need, if there are
/// some. Such a program is played as it is.
pub fn too_short_for_people(agents: &[Agent]) -> Option<String> {
    let short = |agent: &Agent| {
        let lacks = agent.crossings.iter().filter_map(|it| Some((it.clone(), crossing_s(&agent.program, it)?)));
        let lacks = lacks.filter(|(crossing, seconds)| *seconds < f64::from(crossing.needed_s));
        let lack = |(crossing, seconds): &(TimedCrossing, f64)| f64::from(crossing.needed_s) - seconds;
        let worst = lacks.max_by(|one, other| lack(one).total_cmp(&lack(other)))?;
        Some((agent.program.light.clone(), lack(&worst), worst))
    };
    let found: Vec<_> = agents.iter().filter_map(short).collect();
    let (light, _, (TimedCrossing { edge, length_m, needed_s, .. }, seconds)) =
        found.iter().max_by(|one, other| one.1.total_cmp(&other.1))?;
    let lights: Vec<&str> = found.iter().map(|(light, ..)| &**light).collect();
    let (programs, their) = match lights.len() {
        1 => ("a program gives".to_owned(), "it"),
        count => (format!("{count} programs give"), "them"),
    };
    Some(format!(
        "{programs} people on foot too little time ({}); at light `{light}` crossing {edge} has {seconds} s before others get \
         green, but its {length_m:.1} m need {needed_s} s; `program` plays {their} all the same",
        names(&lights)
    ))
}

/// Returns a sentence about crossings on which no green lets people walk, if there are some. Often a program lets them walk in
/// a phase of their own.
pub fn never_walked(agents: &[Agent]) -> Option<String> {
    let closed = |agent: &Agent| agent.crossings.iter().any(|crossing| agent.greens_of(crossing).is_empty());
    let lights: Vec<&str> = agents.iter().filter(|agent| closed(agent)).map(|agent| &*agent.plan.light).collect();
    (!lights.is_empty()).then(|| {
        format!(
            "{} ({}) with a crossing on which no green lets people walk, so under agents and rules nobody crosses there; write \
             greens with a walk signal into agents.toml",
            counted(lights.len(), "light"),
            names(&lights)
        )
    })
}

/// Returns the shortest walk signal of a crossing in a program, in seconds; `None`: it has none, or it never ends.
pub fn walk_s(program: &Program, crossing: &TimedCrossing) -> Option<f64> {
    walks(program, crossing).map(|[walk, _]| walk).reduce(f64::min)
}

/// Returns the shortest time from the beginning of a walk signal until somebody else gets green, in seconds; `None`: as above.
fn crossing_s(program: &Program, crossing: &TimedCrossing) -> Option<f64> {
    walks(program, crossing).map(|[walk, cleared]| walk + cleared).reduce(f64::min)
}

/// Returns the seconds of each walk signal of a crossing, and those from its end until somebody gets green.
fn walks(program: &Program, crossing: &TimedCrossing) -> impl Iterator<Item = [f64; 2]> {
    // An actuated program may cut a phase down.
    let least_s = move |phase: &Phase| match &*program.kind {
        "static" => phase.duration_s,
        _ => phase.limits_s[0].unwrap_or(phase.duration_s),
    };
    let count = program.phases.len();
    let phase = move |place: usize| &program.phases[place % count];
    let walks = move |place: usize| crossing.walks(&phase(place).state);
    let opens = move |place: usize| {
        let [before, now] = [place - 1, place].map(|place| phase(place).state.as_str().chars());
        before.zip(now).any(|(before, now)| !goes(before) && goes(now))
    };
    let sum_s = move |places: Range<usize>| places.map(|place| least_s(phase(place))).sum();
    let begins = (0..count).filter(move |&place| walks(place) && !walks(place + count - 1));
    begins.map(move |begin| {
        let end = (begin..).find(|&place| !walks(place)).expect("the phase before the first one does not walk");
        let opened = (end..end + count).find(|&place| opens(place)).unwrap_or(end);
        [sum_s(begin..end), sum_s(end..opened)]
    })
}

/// Returns a sentence about the programs of a light, if it has several.
pub(super) fn of_several(roads: &Roads, light: &str) -> Option<String> {
    let all: Vec<&str> =
        roads.programs.iter().filter(|program| program.light == light).map(|program| &*program.id).collect();
    let [_, .., last] = all[..] else { return None };
    Some(format!(
        "light `{light}` has {} ({}): `{last}` counts, because SUMO runs the last one; --program ID takes another",
        counted(all.len(), "program"),
        all.join(", ")
    ))
}

/// Returns whether some link for cars loses green without yellow.
fn jumps(roads: &Roads, program: &Program) -> bool {
    let cars = roads.letters_of_vehicles(&program.light);
    let greens = Greens::of(program, &cars);
    greens.changes().iter().any(|change| {
        let states =
            [change.from].into_iter().chain(change.between.iter().map(|phase| &phase.state)).chain([change.to]);
        let states: Vec<&[u8]> = states.map(|state| state.as_str().as_bytes()).collect();
        let is_lost = |before: u8, after: u8| matches!(before, b'G' | b'g') && matches!(after, b'r' | b'R');
        cars.iter().any(|&link| states.windows(2).any(|pair| is_lost(pair[0][link], pair[1][link])))
    })
}

/// Returns a sentence about the links that cars can never use.
fn never_green(roads: &Roads, program: &Program) -> Option<String> {
    let opens = |letter: usize| program.phases.iter().any(|phase| goes(phase.state.as_str().as_bytes()[letter].into()));
    let links = roads.under_light(&program.light).filter_map(|link| Some((link.signal.as_ref()?.letter, link)));
    let closed: Vec<_> = links.filter(|(letter, _)| !opens(*letter)).collect();
    let lanes: BTreeSet<&str> = closed.iter().map(|(_, link)| &*roads.lane(link.from).id).collect();
    let lanes: Vec<&str> = lanes.into_iter().collect();
    (!closed.is_empty()).then(|| {
        let letters: BTreeSet<usize> = closed.iter().map(|(letter, _)| *letter).collect();
        let letters: Vec<String> = letters.iter().take(MOST_LINKS).map(usize::to_string).collect();
        format!(
            "light `{}`: links of {} ({}) have green in no phase, so their cars never pass (letters {})",
            program.light,
            counted(lanes.len(), "lane"),
            names(&lanes),
            letters.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::roads::example::roads;
    use crate::network::tree::parse;

    #[test]
    fn odd_programs_are_named() {
        assert_eq!(warnings(&roads(&[])), [""; 0]);
        let jumping = warnings(&roads(&[("yyrr", "rrrr")]));
        assert!(
            jumping[0].starts_with("a program goes from green to red without yellow somewhere (`J`)"),
            "{jumping:?}"
        );
        let closed = warnings(&roads(&[("\"GGrr\"", "\"Grrr\""), ("\"yyrr\"", "\"yrrr\"")]));
        assert!(closed[0].contains("have green in no phase, so their cars never pass (letters 1)"), "{closed:?}");
        let mut several = roads(&[]);
        let night = r#"<tlLogic id="J" programID="night"><phase duration="9" state="oooo"/></tlLogic>"#;
        several.load_program(&parse(night).unwrap()).unwrap();
        let several = warnings(&several);
        assert_eq!(
            several,
            [
                "light `J` has 2 programs (0, night): `night` counts, because SUMO runs the last one; --program ID takes another"
            ]
        );
    }
}
