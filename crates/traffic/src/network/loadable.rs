//! A whole network as SUMO of this process loads it.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Error, Result, anyhow};

use super::memory_file::MemoryFile;
use dials_core::outside::{beginning, quoted};
use libsumo::Simulation;

/// Options with which SUMO makes every vehicle and finds its way, but lets none enter.
const EMPTY_ROADS: [(&str, &str); 2] = [("max-num-vehicles", "0"), ("max-depart-delay", "1")];

const MOST_LETTERS: usize = 400;
/// Largest number of kinds of SUMO's warnings that are shown.
const MOST_WARNINGS: usize = 5;
const WARNING_LETTERS: usize = 300;
/// Option with which SUMO says what it warns of.
const LOUD: [&str; 2] = ["--no-warnings", "false"];

/// What to do if SUMO dies of a network of this program.
pub(crate) const REMAKE: &str = "make the network again (dials-traffic nets), or use another SUMO";

/// Returns what to do if SUMO dies of a scenario, or never comes back.
pub(crate) fn way_out_of(scenario: &Path) -> String {
    format!(
        "correct the numbers of its vehicles, types and options, or use another SUMO; plain SUMO may show more: sumo -c {}",
        quoted(scenario)
    )
}

/// A network in memory that SUMO of this process can load, any number of times.
pub struct Loadable {
    files: Vec<(MemoryFile, PathBuf)>,
    /// What a message calls it if SUMO dies, and what to do then.
    name: String,
    way_out: String,
    steps_per_s: u32,
    has_devices: bool,
    /// Options of SUMO without `--`, but for the seed and the additional files.
    options: Vec<(String, String)>,
    additional: Vec<String>,
    /// Path of the file with the actuated programs, and their common name.
    actuated: String,
    program: String,
}

impl Loadable {
    /// `program`: name of the actuated programs. Each file is its text with the path that the user knows.
    pub(crate) fn new(
        program: &str,
        net: (&str, &Path),
        routes: &[(String, PathBuf)],
        additional: &[(String, PathBuf)],
        actuated: (&str, &Path),
    ) -> Result<Loadable> {
        let name = net.1.display().to_string();
        let mut files = Vec::new();
        let mut put = |(text, path): (&str, &Path)| -> Result<String> {
            files.push((MemoryFile::new(text)?, path.to_owned()));
            Ok(files[files.len() - 1].0.path())
        };
        let net = put(net)?;
        let mut all = |texts: &[(String, PathBuf)]| texts.iter().map(|(text, path)| put((text, path))).collect();
        let (routes, additional): (Result<Vec<_>>, Result<Vec<_>>) = (all(routes), all(additional));
        let options = [("net-file", net), ("route-files", routes?.join(","))];
        let options = options.into_iter().filter(|(_, files)| !files.is_empty());
        Ok(Loadable {
            name,
            way_out: REMAKE.to_owned(),
            steps_per_s: 1,
            has_devices: false,
            options: options.map(|(name, value)| (name.to_owned(), value)).collect(),
            additional: additional?,
            actuated: put(actuated)?,
            program: program.to_owned(),
            files,
        })
    }

    pub(crate) fn with(
        mut self,
        options: impl IntoIterator<Item = (impl Into<String>, impl Into<String>)>,
    ) -> Loadable {
        self.options.extend(options.into_iter().map(|(name, value)| (name.into(), value.into())));
        self
    }

    /// Adds a file that SUMO loads after the others. `path`: what messages call it.
    pub(crate) fn with_additional(mut self, text: &str, path: &Path) -> Result<Loadable> {
        self.files.push((MemoryFile::new(text)?, path.to_owned()));
        self.additional.push(self.files[self.files.len() - 1].0.path());
        Ok(self)
    }

    /// `scenario`: path of the .sumocfg, for the message if SUMO dies.
    pub(crate) fn of_scenario(self, scenario: &Path) -> Loadable {
        Loadable { name: scenario.display().to_string(), way_out: way_out_of(scenario), ..self }
    }

    /// `steps`: SUMO's steps in a second, as its option says.
    pub(crate) fn with_steps_per_s(self, steps: u32) -> Loadable {
        Loadable { steps_per_s: steps, ..self }
    }

    /// `may_have`: whether vehicles may have other devices than those that write trips and find ways.
    pub(crate) fn with_devices(self, may_have: bool) -> Loadable {
        Loadable { has_devices: may_have, ..self }
    }

    /// Takes the only place for a simulation. Nothing is loaded yet.
    pub(crate) fn simulation(&self) -> Result<Simulation> {
        let mut simulation = Simulation::unloaded()?;
        simulation.name(&self.name, &self.way_out);
        simulation.set_steps_per_second(self.steps_per_s);
        simulation.few_devices(!self.has_devices);
        Ok(simulation)
    }

    /// Gives every vehicle SUMO's device that computes emissions, in a simulation that is loaded with `options`. Each load needs it
    /// again.
    pub(crate) fn equip_for_emissions(&self, simulation: &mut Simulation, options: &mut Vec<String>) {
        const DEVICE: &str = "--device.emissions.probability";
        simulation.few_devices(false);
        // SUMO refuses an option that is given twice.
        if !options.iter().any(|option| option == DEVICE) {
            options.extend([DEVICE.to_owned(), "1".to_owned()]);
        }
    }

    /// Loads it with these options: those of [`Loadable::options`], and further ones.
    pub(crate) fn load(&self, simulation: &mut Simulation, options: &[String]) -> Result<()> {
        simulation.reload(options).map_err(|error| self.explain(&error))
    }

    /// Returns the options that make SUMO load it. `actuated`: also the actuated programs.
    pub fn options(&self, actuated: bool, seed: u32) -> Vec<String> {
        let additional = self.additional.iter().chain(actuated.then_some(&self.actuated)).cloned().collect::<Vec<_>>();
        let mut options = self.options.clone();
        options.push(("seed".to_owned(), seed.to_string()));
        if !additional.is_empty() {
            options.push(("additional-files".to_owned(), additional.join(",")));
        }
        options.into_iter().flat_map(|(name, value)| [format!("--{name}"), value]).collect()
    }

    pub(crate) fn actuated_program(&self) -> &str {
        &self.program
    }

    /// Returns what SUMO warns of when it loads the files. Lets it read all demand until the option `end`, for at most about
    /// `patience`. Without an end it does nothing. SUMO reads demand piece by piece, and finds ways when cars depart. So
    /// otherwise it would complain in the middle of an episode. On empty roads an hour takes a fraction of a second.
    pub(crate) fn try_demand(&self, patience: Duration) -> Result<Vec<String>> {
        let end_s = self.options.iter().find(|(name, _)| name == "end").and_then(|(_, end)| end.parse::<f64>().ok());
        let Some(end_s) = end_s else { return Ok(Vec::new()) };
        let mut options = self.options(false, 0);
        for (name, value) in EMPTY_ROADS {
            let name = format!("--{name}");
            // SUMO refuses an option that is given twice.
            if let Some(given) = options.iter().step_by(2).position(|option| *option == name) {
                options.drain(2 * given..2 * given + 2);
            }
            options.extend([name, value.to_owned()]);
        }
        options.extend(LOUD.map(str::to_owned));
        let mut simulation = self.simulation()?;
        self.load(&mut simulation, &options)?;
        let heard = simulation.heard();
        let begun = Instant::now();
        while simulation.time_s()? < end_s && begun.elapsed() < patience {
            simulation.second().map_err(|error| self.explain(&error))?;
        }
        Ok(warnings(&self.in_words_of_user(&heard)))
    }

    fn in_words_of_user(&self, said: &str) -> String {
        with_names(said.to_owned(), self.files.iter().map(|(file, path)| (file, &**path)))
    }

    pub fn explain(&self, error: &libsumo::Error) -> Error {
        explain(error, self.files.iter().map(|(file, path)| (file, &**path)))
    }
}

/// Returns an error of SUMO in its own words. Each file in memory has the path of the user's file that it was made of.
pub(crate) fn explain<'a>(
    error: &libsumo::Error,
    names: impl IntoIterator<Item = (&'a MemoryFile, &'a Path)>,
) -> Error {
    let said = match error {
        libsumo::Error::Load { text, .. } | libsumo::Error::Refused { text, .. } => format!("SUMO: {text}"),
        error => error.to_string(),
    };
    anyhow!(beginning(&with_names(said, names), MOST_LETTERS))
}

fn with_names<'a>(said: String, names: impl IntoIterator<Item = (&'a MemoryFile, &'a Path)>) -> String {
    names.into_iter().fold(said, |said, (memory, path)| renamed(&said, &memory.path(), &path.display().to_string()))
}

/// Returns SUMO's warnings in a text, the first one of each kind with the number of others like it.
fn warnings(said: &str) -> Vec<String> {
    let mut kinds: Vec<(String, &str, usize)> = Vec::new();
    for warning in said.lines().filter_map(|line| line.trim().strip_prefix("Warning: ")) {
        // Warnings of one kind differ in names, which are in quotes, and in numbers.
        let kind: String = warning.split('\'').step_by(2).collect();
        let kind = kind.replace(|letter: char| letter.is_ascii_digit(), "");
        match kinds.iter_mut().find(|(other, ..)| *other == kind) {
            Some((.., count)) => *count += 1,
            None => kinds.push((kind, warning, 0)),
        }
    }
    let more = kinds.len().saturating_sub(MOST_WARNINGS);
    let in_words = |(_, first, others): &(String, &str, usize)| match others {
        0 => beginning(first, WARNING_LETTERS),
        others => format!("{} (and {others} like it)", beginning(first, WARNING_LETTERS)),
    };
    let shown = kinds.iter().take(MOST_WARNINGS).map(in_words);
    shown.chain((more > 0).then(|| format!("{more} further kinds of warnings"))).collect()
}

/// Returns a text with one path replaced by another, but not where it is the beginning of a longer one.
fn renamed(text: &str, path: &str, name: &str) -> String {
    let mut pieces = text.split(path);
    let mut result = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        result += if piece.starts_with(|letter: char| letter.is_ascii_digit()) { path } else { name };
        result += piece;
    }
    result
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn warnings_of_one_kind_share_a_line() {
        let said = "Loading... done\nWarning: Missing yellow in 'c' for 7\nWarning: Missing yellow in 'd' for 12\nWarning: No.";
        assert_eq!(warnings(said), ["Missing yellow in 'c' for 7 (and 1 like it)", "No."]);
        assert_eq!(warnings(&["", "a", "b", "c", "d", "e", "f"].join("\nWarning: ")).len(), 6);
        assert!(warnings("").is_empty());
    }

    #[test]
    fn an_error_of_sumo_names_the_files_of_the_user() {
        let named = renamed("could not load `/proc/self/fd/7` or `/proc/self/fd/71`", "/proc/self/fd/7", "a.net.xml");
        assert_eq!(named, "could not load `a.net.xml` or `/proc/self/fd/71`");
    }
}
