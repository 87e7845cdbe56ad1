//! SUMO's actuated lights, made of the phases of the lights' own programs.

use crate::network::xml::{document, leaf, nest};

/// Name of the actuated program among those of a light, if no other program has it.
pub(crate) const PROGRAM: &str = "actuated";

/// Shortest and longest green in seconds, unless the own program gives its own.
const GREEN_S: [f64; 2] = [5.0, 50.0];

/// A phase of a light's own program.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ProgramPhase<'a> {
    pub(crate) state: &'a str,
    /// Whether it lasts as long as cars come. A link may also have green in yellow and all red of the others.
    pub(crate) is_green: bool,
    pub(crate) duration_s: f64,
    /// SUMO's `minDur` and `maxDur`, if the program gives them.
    pub(crate) least_s: Option<f64>,
    pub(crate) most_s: Option<f64>,
    /// Phases that may follow; empty: the next one in their order.
    pub(crate) next: &'a [usize],
}

/// What an actuated program is made of.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Light<'a> {
    /// SUMO's name of the light.
    pub(crate) id: &'a str,
    /// Time by which the program runs late, in seconds.
    pub(crate) offset_s: f64,
    /// Names and values, such as `max-gap`, of an own program that is actuated, too.
    pub(crate) parameters: &'a [(String, String)],
    /// The phases of its own program.
    pub(crate) phases: Vec<ProgramPhase<'a>>,
}

/// Returns an additional file with an actuated program of this name for each light.
///
/// Greens last as long as cars come, within their limits. All other phases last as long as in the own program.
pub(crate) fn programs<'a>(name: &str, lights: impl IntoIterator<Item = Light<'a>>) -> String {
    document("additional", |xml| {
        lights.into_iter().try_for_each(|Light { id, offset_s, parameters, phases }| {
            let offset_s = offset_s.to_string();
            let head = [("id", id), ("type", "actuated"), ("programID", name), ("offset", &offset_s)];
            nest(xml, "tlLogic", head, |xml| {
                phases.iter().try_for_each(|phase| leaf(xml, "phase", attributes(phase)))?;
                parameters.iter().try_for_each(|(key, value)| leaf(xml, "param", [("key", key), ("value", value)]))
            })
        })
    })
}

fn attributes(phase: &ProgramPhase<'_>) -> Vec<(&'static str, String)> {
    let &ProgramPhase { state, is_green, duration_s, least_s, most_s, next } = phase;
    let (least_s, most_s) = if is_green {
        let most_s = most_s.unwrap_or(GREEN_S[1].max(least_s.unwrap_or(0.0)));
        (least_s.unwrap_or(GREEN_S[0]).min(most_s), most_s)
    } else {
        (duration_s, duration_s)
    };
    let duration_s = if is_green { least_s } else { duration_s };
    let times = [("duration", duration_s), ("minDur", least_s), ("maxDur", most_s)];
    let times = times.map(|(name, seconds)| (name, seconds.to_string()));
    let next: Vec<String> = next.iter().map(usize::to_string).collect();
    let next = (!next.is_empty()).then(|| ("next", next.join(" ")));
    times.into_iter().chain([("state", state.to_owned())]).chain(next).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn greens_get_limits_and_everything_else_keeps_its_time() {
        let phase = |state, duration_s| ProgramPhase {
            state,
            is_green: true,
            duration_s,
            least_s: None,
            most_s: None,
            next: &[],
        };
        let between = |state, duration_s| ProgramPhase { is_green: false, ..phase(state, duration_s) };
        let phases = vec![
            phase("GGrr", 33.0),
            between("Yyrr", 4.5),
            between("rrrr", 2.0),
            ProgramPhase { least_s: Some(8.0), most_s: Some(20.0), next: &[0, 2], ..phase("rrGg", 12.0) },
            ProgramPhase { most_s: Some(3.0), ..phase("Grrr", 9.0) },
            ProgramPhase { least_s: Some(60.0), ..phase("rGrr", 70.0) },
        ];
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
        let parameters = [("max-gap".to_owned(), "0.5".to_owned())];
        let light = Light { id: "a&b", offset_s: 7.5, parameters: &parameters, phases };
        assert_eq!(programs(PROGRAM, [light]), expected);
    }
}
