//! SUMO's actuated lights, made of the phases of the lights' own programs.

use std::collections::BTreeSet;

use crate::agents::derive::greens::Greens;
use crate::network::roads::program::{Phase, Program};
use crate::network::xml::{document, leaf, nest};

/// Name of the actuated program among those of a light, if no other program has it.
pub(crate) const PROGRAM: &str = "actuated";

/// Shortest and longest green in seconds, unless the own program gives its own.
const GREEN_S: [f64; 2] = [5.0, 50.0];

/// Shortest and longest seconds of a phase beside those of its program; `None`: no other limit.
pub(crate) type PhaseLimits = [Option<u32>; 2];

/// Returns an additional file with an actuated program of this name for each own program of a light. With each program
/// come the letters that cars obey, and the limits of its phases; without these they have none.
///
/// Greens last as long as cars come, within their limits. All other phases last as long as in the own program. Offset
/// and parameters, such as `max-gap`, are those of an own program that is actuated, too.
pub(crate) fn programs<'a>(
    name: &str,
    lights: impl IntoIterator<Item = (&'a Program, &'a BTreeSet<usize>, Vec<PhaseLimits>)>,
) -> String {
    document("additional", |xml| {
        lights.into_iter().try_for_each(|(program, cars, limits)| {
            let is_actuated = program.kind == "actuated";
            let greens = Greens::of(program, cars);
            let offset_s = (if is_actuated { program.offset_s } else { 0.0 }).to_string();
            let head = [("id", &*program.light), ("type", "actuated"), ("programID", name), ("offset", &offset_s)];
            nest(xml, "tlLogic", head, |xml| {
                let mut phases = program.phases.iter().enumerate();
                phases.try_for_each(|(number, phase)| {
                    let limits = limits.get(number).copied().unwrap_or_default();
                    leaf(xml, "phase", attributes(phase, greens.is_green(number), limits))
                })?;
                let mut parameters = program.parameters.iter().filter(|_| is_actuated);
                parameters.try_for_each(|(key, value)| leaf(xml, "param", [("key", key), ("value", value)]))
            })
        })
    })
}

/// Returns what is written of a phase. `is_green`: whether it lasts as long as cars come. A link may also have green in
/// yellow and all red of the others.
fn attributes(phase: &Phase, is_green: bool, limits: PhaseLimits) -> Vec<(&'static str, String)> {
    let &Phase { ref state, duration_s, limits_s: [least_s, most_s], ref next, .. } = phase;
    let (least_s, most_s) = if is_green {
        let most_s = most_s.unwrap_or(GREEN_S[1].max(least_s.unwrap_or(0.0)));
        let [shortest, longest] = limits.map(|limit| limit.map(f64::from));
        let most_s = most_s.min(longest.unwrap_or(f64::INFINITY)).max(shortest.unwrap_or(0.0));
        (least_s.unwrap_or(GREEN_S[0]).max(shortest.unwrap_or(0.0)).min(most_s), most_s)
    } else {
        (duration_s, duration_s)
    };
    let duration_s = if is_green { least_s } else { duration_s };
    let times = [("duration", duration_s), ("minDur", least_s), ("maxDur", most_s)];
    let times = times.map(|(name, seconds)| (name, seconds.to_string()));
    let next: Vec<String> = next.iter().map(usize::to_string).collect();
    let next = (!next.is_empty()).then(|| ("next", next.join(" ")));
    times.into_iter().chain([("state", state.as_str().to_owned())]).chain(next).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::tree::parse;

    fn made(own: &str) -> String {
        let program = Program::read(&parse(own).unwrap()).unwrap();
        programs(PROGRAM, [(&program, &BTreeSet::from([0, 1, 2, 3]), Vec::new())])
    }

    #[test]
    fn phases_keep_limits_of_others() {
        let own = r#"<tlLogic id="J" programID="0"><phase duration="9" state="GGrr"/><phase duration="3" state="yyrr"/>
            <phase duration="9" minDur="30" state="rrGG"/></tlLogic>"#;
        let program = Program::read(&parse(own).unwrap()).unwrap();
        let limits = vec![[Some(24), None], [Some(24), None], [Some(8), Some(20)]];
        let made = programs(PROGRAM, [(&program, &BTreeSet::from([0, 1, 2, 3]), limits)]);
        assert!(made.contains(r#"<phase duration="24" minDur="24" maxDur="50" state="GGrr"/>"#), "{made}");
        assert!(made.contains(r#"<phase duration="3" minDur="3" maxDur="3" state="yyrr"/>"#), "no green");
        assert!(made.contains(r#"<phase duration="20" minDur="20" maxDur="20" state="rrGG"/>"#), "{made}");
    }

    #[test]
    fn greens_get_limits_and_everything_else_keeps_its_time() {
        let own = r#"
    <tlLogic id="a&amp;b" type="actuated" programID="0" offset="7.5">
        <phase duration="33" state="GGrr"/>
        <phase duration="4.5" state="Yyrr"/>
        <phase duration="2" state="rrrr"/>
        <phase duration="12" minDur="8" maxDur="20" state="rrGg" next="0 2"/>
        <phase duration="9" maxDur="3" state="Grrr"/>
        <phase duration="70" minDur="60" state="rGrr"/>
        <param key="max-gap" value="0.5"/>
    </tlLogic>"#;
        let expected = r#"<?xml version="1.0" encoding="UTF-8"?>
<additional>
    <tlLogic id="a&amp;b" type="actuated" programID="actuated" offset="7.5">
        <phase duration="5" minDur="5" maxDur="50" state="GGrr"/>
        <phase duration="4.5" minDur="4.5" maxDur="4.5" state="Yyrr"/>
        <phase duration="2" minDur="2" maxDur="2" state="rrrr"/>
        <phase duration="8" minDur="8" maxDur="20" state="rrGg" next="0 2"/>
        <phase duration="3" minDur="3" maxDur="3" state="Grrr"/>
        <phase duration="60" minDur="60" maxDur="60" state="rGrr"/>
        <param key="max-gap" value="0.5"/>
    </tlLogic>
</additional>
"#;
        assert_eq!(made(own), expected);
    }

    #[test]
    fn a_program_of_another_kind_has_no_parameters_and_begins_at_once() {
        let own = r#"<tlLogic id="J" type="static" programID="0" offset="7"><phase duration="9" state="GGrr"/>
            <phase duration="9" state="rrGG"/><param key="max-gap" value="0.5"/></tlLogic>"#;
        assert!(made(own).contains(r#"offset="0""#) && !made(own).contains("param"), "{}", made(own));
    }
}
