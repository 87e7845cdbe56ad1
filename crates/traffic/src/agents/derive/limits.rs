//! Shortest and longest green and longest red of one light: what binds, and what does not go together.

use std::collections::BTreeSet;
use std::fmt;

use anyhow::{Context, Error, Result, anyhow, bail};

use super::Rules;
use super::crossings::{TimedCrossing, slowest};
use super::greens::is_green;
use super::overrides::LightOverride;
use crate::agents::phase_plan::PhasePlan;
use crate::agents::red_limits::TooShort;
use libsumo::SignalState;

/// Seconds of green at least, and what asks for them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Shortest {
    pub seconds: u32,
    pub because: Because,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Because {
    /// `traffic.min_green_s`.
    Config,
    /// `minDur` of a phase of the light's program.
    Program,
    /// `min_green_s` of the light in `agents.toml`.
    Overrides,
    /// A crossing: its edge.
    Crossing(String),
}

impl Because {
    fn way_out(&self) -> &'static str {
        match self {
            Because::Config => ", or lower traffic.min_green_s",
            Because::Program => ", or set min_green_s for this light",
            Because::Overrides => ", or lower min_green_s",
            Because::Crossing(_) => "; traffic.pedestrians = \"off\" leaves crossings out",
        }
    }
}

impl fmt::Display for Because {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Because::Config => f.write_str("traffic.min_green_s"),
            Because::Program => f.write_str("minDur of its program"),
            Because::Overrides => f.write_str("min_green_s in agents.toml"),
            Because::Crossing(edge) => write!(f, "crossing {edge}"),
        }
    }
}

/// Returns the shortest duration of each green. `min_dur_s`: that of the phases of its program, if it counts.
///
/// The seconds of `agents.toml` stand instead of those of the config and of the program. A crossing always binds.
pub(super) fn shortest(
    greens: &[SignalState],
    rules: &Rules,
    own: &LightOverride,
    min_dur_s: impl Fn(usize) -> Option<u32>,
    crossings: &[TimedCrossing],
) -> Vec<Shortest> {
    let of_green = |(number, green): (usize, &SignalState)| {
        let written = own.min_green_s(number).map(|seconds| (seconds, Because::Overrides));
        let config = (rules.min_green_s, Because::Config);
        let program = min_dur_s(number).map(|seconds| (seconds, Because::Program));
        let usual = || longer(config, program);
        let crossing = slowest(crossings, green).map(|it| (it.needed_s, Because::Crossing(it.edge.clone())));
        let (seconds, because) = longer(written.unwrap_or_else(usual), crossing);
        Shortest { seconds, because }
    };
    greens.iter().enumerate().map(of_green).collect()
}

fn longer(one: (u32, Because), other: Option<(u32, Because)>) -> (u32, Because) {
    other.filter(|(seconds, _)| *seconds > one.0).unwrap_or(one)
}

/// Sets all limits of a light. `links`: letters that somebody obeys. An error names the light, the numbers and the way out.
pub(super) fn apply(
    light: &str,
    phases: PhasePlan,
    shortest: &[Shortest],
    own: &LightOverride,
    links: &BTreeSet<usize>,
) -> Result<PhasePlan> {
    let greens = phases.greens().len();
    own.check_greens(greens).with_context(|| format!("agents.toml: light `{light}`"))?;
    let most: Vec<Option<u32>> = (0..greens).map(|green| own.max_green_s(green)).collect();
    let phases = phases.with_min_greens(shortest.iter().map(|shortest| shortest.seconds));
    for (green, (Shortest { because, .. }, most)) in shortest.iter().zip(&most).enumerate() {
        let seconds = phases.least_longest(green);
        let Some(most) = most.filter(|&most| most < seconds) else { continue };
        let state = &phases.greens()[green];
        bail!(
            "agents.toml: light `{light}`: max_green_s = {most}: green {green} ({state}) must last {seconds} s at least \
             ({because}); raise max_green_s{}",
            because.way_out()
        );
    }
    // A timing may be shorter than the minima of config and program: the light then waits. It must fit those of the file and of
    // crossings.
    let strict = shortest.iter().map(|Shortest { seconds, because }| match because {
        Because::Config | Because::Program => 0,
        Because::Overrides | Because::Crossing(_) => *seconds,
    });
    let phases = phases.with_strict_min_greens(strict).with_max_greens(most);
    let limits = red_limits(&phases, own, links);
    phases.with_red_limits(&limits).map_err(|short| too_short(light, &short, shortest))
}

/// Returns the longest red of each letter: the shortest one of the greens that open it.
fn red_limits(phases: &PhasePlan, own: &LightOverride, links: &BTreeSet<usize>) -> Vec<(usize, u32)> {
    let opens = |green: &SignalState, letter: usize| is_green(green.as_str().as_bytes()[letter].into());
    let of_letter = |&letter: &usize| {
        let opened = phases.greens().iter().enumerate().filter(|(_, green)| opens(green, letter));
        let most = opened.filter_map(|(green, _)| own.max_red_s(green)).min()?;
        Some((letter, most))
    };
    links.iter().filter_map(of_letter).collect()
}

fn too_short(light: &str, short: &TooShort, shortest: &[Shortest]) -> Error {
    let TooShort { letter, most_steps, needed_steps, rota } = short;
    let of_green = |&(green, least, clearing): &(usize, u32, u32)| {
        format!("green {green}: {least} s ({}) and {clearing} s between greens", shortest[green].because)
    };
    let rota: Vec<String> = rota.iter().map(of_green).collect();
    anyhow!(
        "agents.toml: light `{light}`: max_red_s = {most_steps}: link {letter} is red for {needed_steps} s even if greens take \
         turns at their shortest ({}); set max_red_s to {needed_steps} at least, or shorten greens",
        rota.join("; ")
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::derive::overrides::Overrides;
    use crate::agents::derive::{Agent, derive};
    use crate::light_limits_test::crossing_roads;

    fn made(rules: Rules, file: &str) -> Result<Agent> {
        let overrides = Overrides::parse(&format!("[light.A0]\n{file}")).unwrap();
        Ok(derive(&crossing_roads(), &rules, &overrides)?.agents.remove(0))
    }

    /// Returns the shortest greens with what binds.
    fn bound(rules: Rules, file: &str) -> Vec<(u32, String)> {
        let found = made(rules, file).unwrap();
        let seconds: Vec<u32> = found.shortest.iter().map(|shortest| shortest.seconds).collect();
        assert_eq!(found.plan.phases.min_green_steps(), seconds);
        found.shortest.into_iter().map(|shortest| (shortest.seconds, shortest.because.to_string())).collect()
    }

    #[test]
    fn the_longest_of_config_program_file_and_crossing_binds() {
        // 7 + 9.6 / 1.07 = 15.97. Greens 1 and 3 are left turns without people.
        let because = |all: &[(u32, &str)]| all.iter().map(|&(s, why)| (s, why.to_owned())).collect::<Vec<_>>();
        let config = "traffic.min_green_s";
        let usual = [(16, "crossing :A0_c1"), (5, config), (16, "crossing :A0_c0"), (5, config)];
        assert_eq!(bound(Rules::default(), ""), because(&usual));
        assert_eq!(bound(Rules { walking: None, ..Rules::default() }, ""), because(&[(5, config); 4]));
        let file = "min_green_s in agents.toml";
        let written = [(20, file), (16, "crossing :A0_c0")];
        let listed = bound(Rules::default(), "min_green_s = [20, 3, 4, 8]");
        assert_eq!(listed, because(&[written[0], (3, file), written[1], (8, file)]));
        let found = made(Rules::default(), "max_green_s = [0, 30, 40, 0]\nmax_red_s = 100").unwrap().plan.phases;
        assert_eq!(found.max_green_steps(), [None, Some(30), Some(40), None]);
        assert_eq!(found.max_red_steps().collect::<Vec<_>>(), (0..16).map(|letter| (letter, 100)).collect::<Vec<_>>());
    }

    #[test]
    fn limits_that_do_not_go_together_are_named_with_their_numbers() {
        let error = |file: &str| format!("{:#}", made(Rules::default(), file).err().unwrap());
        assert_eq!(
            error("max_green_s = 10"),
            "agents.toml: light `A0`: max_green_s = 10: green 0 (gGgrrrgGgrrrrGrG) must last 16 s at least (crossing :A0_c1); \
             raise max_green_s; traffic.pedestrians = \"off\" leaves crossings out"
        );
        assert_eq!(
            error("max_red_s = [60, 50]"),
            "agents.toml: light `A0`: max_red_s: has 2 numbers, but the light has 4 greens; give one number for all, or one \
             for each"
        );
        // Greens 0 and 2 open all links: 3 + 16 + 3 s of the one after the other. The walk on a crossing ends 6 s before the
        // green: 9.6 / 1.07 = 8.97, of which 3 s are yellow.
        assert_eq!(
            error("max_red_s = 27"),
            "agents.toml: light `A0`: max_red_s = 27: link 12 is red for 28 s even if greens take turns at their shortest \
             (green 0: 16 s (crossing :A0_c1) and 3 s between greens; green 2: 16 s (crossing :A0_c0) and 3 s between \
             greens); set max_red_s to 28 at least, or shorten greens"
        );
        assert!(made(Rules::default(), "max_red_s = 28").is_ok());
        let cars = Rules { walking: None, min_green_s: 16, ..Rules::default() };
        assert!(made(cars, "max_red_s = 22").is_ok());
    }
}
