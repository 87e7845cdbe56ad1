//! The file `agents.toml`: what a person says of the lights of a net where the derivation guesses wrong.

use std::collections::BTreeMap;

use anyhow::{Context, Result, anyhow, ensure};
use serde::Deserialize;

use super::greens::{MOST_GREENS, is_green, is_yellow};
use super::keeping::Why;
use crate::network::roads::program::Program;
use dials_core::base::counted;
use libsumo::SignalState;

/// Longest yellow and all red that are accepted, in seconds.
const LONGEST_S: u32 = 60;
/// Longest shortest green, and longest of the longest greens and reds, in seconds.
const LONGEST_LEAST_S: u32 = 300;
const LONGEST_MOST_S: u32 = 3600;

#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Overrides {
    /// Lights that learn; all others keep their program.
    learn: Option<Vec<String>>,
    /// Lights that keep their program; all others learn if they can.
    keep: Option<Vec<String>>,
    #[serde(default, rename = "light")]
    lights: BTreeMap<String, LightOverride>,
}

#[derive(Clone, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LightOverride {
    greens: Option<Vec<String>>,
    /// Edges on which its agent sees cars, instead of those that the derivation finds.
    pub(crate) approaches: Option<Vec<String>>,
    pub(crate) yellow_s: Option<u32>,
    /// Its program that counts, if it has several.
    pub(crate) program: Option<String>,
    /// Seconds in which links that lose green show red after yellow.
    pub(crate) all_red_s: Option<u32>,
    min_green_s: Option<Each>,
    max_green_s: Option<Each>,
    max_red_s: Option<Each>,
}

/// Seconds of all greens of a light, or one number for each.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(untagged, expecting = "must be a whole number of seconds, or a list with one for each green")]
enum Each {
    All(u32),
    One(Vec<u32>),
}

impl Each {
    fn of(&self, green: usize) -> Option<u32> {
        match self {
            Each::All(seconds) => Some(*seconds),
            Each::One(list) => list.get(green).copied(),
        }
    }

    fn all(&self) -> &[u32] {
        match self {
            Each::All(seconds) => std::slice::from_ref(seconds),
            Each::One(list) => list,
        }
    }
}

impl Overrides {
    /// Reads the text of a file. An error names the light and the key.
    pub fn parse(text: &str) -> Result<Overrides> {
        let file: Overrides = toml::from_str(text)?;
        ensure!(
            file.learn.is_none() || file.keep.is_none(),
            "learn and keep: name the lights that learn, or those that do not"
        );
        for (name, light) in &file.lights {
            light.check().map_err(|error| anyhow!("light `{name}`: {error:#}"))?;
        }
        Ok(file)
    }

    /// Returns what the file says of a light; nothing if it does not name it.
    pub(crate) fn of(&self, light: &str) -> &LightOverride {
        const NOTHING: &LightOverride = &LightOverride {
            greens: None,
            approaches: None,
            yellow_s: None,
            program: None,
            all_red_s: None,
            min_green_s: None,
            max_green_s: None,
            max_red_s: None,
        };
        self.lights.get(light).unwrap_or(NOTHING)
    }

    /// Returns the lights for which the file chooses a program, with its name.
    pub(crate) fn programs(&self) -> impl Iterator<Item = (&str, &str)> {
        self.lights.iter().filter_map(|(light, its)| Some((&**light, its.program.as_deref()?)))
    }

    pub(crate) fn learns(&self, light: &str) -> bool {
        let names = |list: &Option<Vec<String>>| list.as_ref().map(|names| names.iter().any(|name| name == light));
        names(&self.learn).unwrap_or(true) && !names(&self.keep).unwrap_or(false)
    }

    /// Returns an error if the file names a light that the net does not have, or greens of another length than its.
    pub(crate) fn check_names(&self, programs: &[&Program]) -> Result<()> {
        let known = |name: &String| programs.iter().find(|program| program.light == *name);
        let lists = [("learn", &self.learn), ("keep", &self.keep)];
        let listed = lists.iter().flat_map(|(key, names)| names.iter().flatten().map(|name| (*key, name)));
        for (key, name) in listed.chain(self.lights.keys().map(|name| ("light", name))) {
            let program =
                known(name).with_context(|| format!("agents.toml: {key}: the net has no light `{name}`; remove it"))?;
            for green in self.of(name).greens().iter().flatten() {
                let letters = program.letters().unwrap_or(0);
                ensure!(
                    green.links() == letters,
                    "agents.toml: light `{name}`: greens: `{green}` has {} letters, but its program has {letters}; give one \
                     letter per link",
                    green.links()
                );
            }
        }
        Ok(())
    }

    /// Returns an error if the file says that a light learns, and it cannot.
    pub(crate) fn check_may_keep(&self, light: &str, why: &Why) -> Result<()> {
        let wanted = self.learn.iter().flatten().any(|name| name == light);
        ensure!(!wanted, "agents.toml: learn: light `{light}` cannot learn: {why}; {}", why.way_out());
        Ok(())
    }
}

impl LightOverride {
    /// Returns the least seconds of a green, if the file names them.
    pub(crate) fn min_green_s(&self, green: usize) -> Option<u32> {
        self.min_green_s.as_ref()?.of(green)
    }

    /// Returns the most seconds of a green; `None`: it has no limit.
    pub(crate) fn max_green_s(&self, green: usize) -> Option<u32> {
        self.max_green_s.as_ref()?.of(green).filter(|&seconds| seconds > 0)
    }

    /// Returns the most seconds of red for the links of a green; `None`: it has no limit.
    pub(crate) fn max_red_s(&self, green: usize) -> Option<u32> {
        self.max_red_s.as_ref()?.of(green).filter(|&seconds| seconds > 0)
    }

    fn limits(&self) -> [(&'static str, u32, u32, &Option<Each>); 3] {
        [
            ("min_green_s", 1, LONGEST_LEAST_S, &self.min_green_s),
            ("max_green_s", 0, LONGEST_MOST_S, &self.max_green_s),
            ("max_red_s", 0, LONGEST_MOST_S, &self.max_red_s),
        ]
    }

    /// Returns an error if a list of seconds has another length than the light has greens.
    pub(crate) fn check_greens(&self, greens: usize) -> Result<()> {
        for (key, _, _, each) in self.limits() {
            let Some(Each::One(list)) = each else { continue };
            ensure!(
                list.len() == greens,
                "{key}: has {}, but the light has {}; give one number for all, or one for each",
                counted(list.len(), "number"),
                counted(greens, "green")
            );
        }
        Ok(())
    }

    pub(crate) fn greens(&self) -> Option<Vec<SignalState>> {
        let state = |letters: &String| SignalState::new(letters.clone()).expect("checked when the file was read");
        Some(self.greens.as_ref()?.iter().map(state).collect())
    }

    fn check(&self) -> Result<()> {
        let LightOverride { greens, approaches, yellow_s, all_red_s, .. } = self;
        ensure!(
            yellow_s.is_none_or(|seconds| (1..=LONGEST_S).contains(&seconds)),
            "yellow_s: must be from 1 to {LONGEST_S}"
        );
        ensure!(all_red_s.is_none_or(|seconds| seconds <= LONGEST_S), "all_red_s: must be at most {LONGEST_S}");
        for (key, least, most, each) in self.limits() {
            let Some(each) = each else { continue };
            // In a list, 0 leaves a green without a limit.
            let least = if matches!(each, Each::All(_)) { least.max(1) } else { least };
            let bad = each.all().iter().find(|seconds| !(least..=most).contains(seconds));
            ensure!(bad.is_none(), "{key} = {}: must be from {least} to {most}", bad.unwrap_or(&0));
        }
        ensure!(approaches.as_ref().is_none_or(|edges| !edges.is_empty()), "approaches: must name at least one edge");
        let Some(greens) = greens else { return Ok(()) };
        ensure!(greens.len() >= 2, "greens: must be at least two; with fewer there is nothing to choose");
        ensure!(greens.len() <= MOST_GREENS, "greens: must be at most {MOST_GREENS}");
        for (number, letters) in greens.iter().enumerate() {
            let green = SignalState::new(letters.clone()).context("greens")?;
            let goes = !is_yellow(&green) && letters.contains(is_green);
            ensure!(goes, "greens: `{green}` must have a G or g, and neither y, Y nor u");
            ensure!(!greens[..number].contains(letters), "greens: `{green}` is there twice");
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_names_the_light_and_the_key() {
        for (file, message) in [
            ("learn = ['a']\nkeep = ['b']", "learn and keep: name the lights that learn, or those that do not"),
            ("[light.a]\nyellow_s = 0", "light `a`: yellow_s: must be from 1 to 60"),
            ("[light.a]\nall_red_s = 61", "light `a`: all_red_s: must be at most 60"),
            ("[light.a]\napproaches = []", "light `a`: approaches: must name at least one edge"),
            (
                "[light.a]\ngreens = ['G']",
                "light `a`: greens: must be at least two; with fewer there is nothing to choose",
            ),
            ("lern = ['a']", "unknown field `lern`"),
            ("[light.a]\nyellow_s = -3", "yellow_s"),
            ("[light.a]\nmin_green_s = 0", "light `a`: min_green_s = 0: must be from 1 to 300"),
            ("[light.a]\nmax_red_s = [60, 3601]", "light `a`: max_red_s = 3601: must be from 0 to 3600"),
            ("[light.a]\nmax_green_s = 0", "light `a`: max_green_s = 0: must be from 1 to 3600"),
            ("[light.a]\nmax_green_s = 'x'", "must be a whole number of seconds, or a list with one for each green"),
            ("[light.a]\ngreens = ['Gx', 'rG']", "light `a`: greens: "),
            ("[light.a]\ngreens = ['Gr', 'Gr']", "light `a`: greens: `Gr` is there twice"),
            ("[light.a]\ngreens = ['Gr', 'yG']", "light `a`: greens: `yG` must have a G or g, and neither y, Y nor u"),
        ] {
            let error = format!("{:#}", Overrides::parse(file).unwrap_err());
            assert!(error.contains(message), "{error}");
        }
    }
}
