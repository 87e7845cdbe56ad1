//! Route files of which each episode plays one: `traffic.routes` of a config.
//!
//! RESCO's grids have 1400 of them. So only what must be known of all files stays in memory: who travels, with which types, from
//! which roads. An episode reads its file again, and refuses it if it has changed. The scenario with that one file is an
//! ordinary scenario, so nothing else needs to know that there are others.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use rand::Rng;
use rayon::prelude::*;

use super::closing::Detours;
use super::demand::Departures;
use super::kept::KEPT;
use super::travellers::Travellers;
use super::{SumoScenario, elements, locally, reading};
use crate::config::sumocfg::Notes;
use crate::network::tree::Element;
use dials_core::base::{RandomPurpose, Seed, counted};
use dials_core::outside::packed;

/// What all files have in common, and where they are.
#[derive(Clone, Debug)]
pub(super) struct Drawn {
    files: Vec<DrawnFile>,
    pub(super) travellers: Travellers,
    /// Elements of vehicle types, also those of additional files.
    pub(super) types: Vec<Element>,
    pub(super) may_have_devices: bool,
    pub(super) dawdles: bool,
    /// Sum over all files, if edges are closed.
    pub(super) detours: Option<Detours>,
    /// How much cars dawdle in all files, if it is not what they say.
    sigma: Option<f64>,
}

#[derive(Clone, Debug)]
struct DrawnFile {
    path: PathBuf,
    /// Number of the path in the config that names it.
    named_by: usize,
    checksum: u32,
}

/// What is kept of one file.
struct Known {
    file: DrawnFile,
    departures: Departures,
    notes: Notes,
    travellers: Travellers,
    types: Vec<Element>,
    may_have_devices: bool,
    dawdles: bool,
    detours: Option<Detours>,
}

impl SumoScenario {
    /// Returns the scenario with route files of which each episode plays one. Reads and checks them all. `paths`: the files of
    /// each path in the config.
    pub(super) fn with_drawn(mut self, paths: &[Vec<PathBuf>], sigma: Option<f64>) -> Result<SumoScenario> {
        let named = paths.iter().enumerate().flat_map(|(number, files)| files.iter().map(move |file| (number, file)));
        let named: Vec<(usize, &PathBuf)> = named.collect();
        let asked = self.asked_for();
        let known: Vec<Known> = named
            .par_iter()
            .map(|&(named_by, path)| Known::read(&self, path, named_by, sigma, &asked))
            .collect::<Result<_>>()?;
        let (drawn, departures, notes) = Drawn::of(known, sigma)?;
        let replaced = format!(
            "the .sumocfg's own route files: each episode plays one of {} that traffic.routes names",
            counted(drawn.files.len(), "file")
        );
        self.notes.left_out.push(replaced);
        self.notes.extend(notes);
        if let Some(detours) = drawn.detours {
            let sentence = self.about_detours(&detours);
            self.notes.left_out.push(sentence);
        }
        self.departures = departures;
        self.drawn = Some(Arc::new(drawn));
        Ok(self)
    }

    /// Returns the files of which each episode plays one. Empty: all episodes have the same.
    pub(crate) fn drawn_files(&self) -> impl ExactSizeIterator<Item = &Path> {
        self.drawn.as_ref().map_or(&[][..], |drawn| &drawn.files).iter().map(|file| &*file.path)
    }

    /// Returns the number of the file that an episode plays. `None`: all episodes have the same.
    pub(crate) fn drawn_by(&self, episode: Seed) -> Option<usize> {
        let files = self.drawn_files().len();
        (files > 0).then(|| episode.fork(RandomPurpose::RouteFile).dice().random_range(0..files))
    }

    /// Returns the scenario as an episode plays it that has drawn this file.
    ///
    /// Errors: the file cannot be read, or is another one than when the scenario was read.
    pub(crate) fn playing(&self, number: usize) -> Result<SumoScenario> {
        let Some(drawn) = &self.drawn else { bail!("there are no route files to draw") };
        let file = &drawn.files[number];
        let (scenario, _) = self.with_route_file(&file.path, drawn.sigma, &self.asked_for())?;
        ensure!(
            scenario.route_checksum() == file.checksum,
            "{}: has changed since this command began; episodes must stay the same, so begin again",
            file.path.display()
        );
        Ok(scenario)
    }

    /// Writes copies of all files, packed with gzip. Returns a path for each one of the config.
    pub(super) fn keep_drawn(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        let Some(drawn) = &self.drawn else { return Ok(Vec::new()) };
        let name = |named_by: usize, number: &str| format!("{KEPT}.{}.{number}.rou.xml.gz", named_by + 1);
        (0..drawn.files.len()).into_par_iter().try_for_each(|number| -> Result<()> {
            let content = self.playing(number)?.routes.remove(0).content;
            // With as many digits as the largest number can have, names are in the order of the files.
            let path = folder.join(name(drawn.files[number].named_by, &format!("{number:05}")));
            let bytes = packed(&content.bytes)?;
            fs::write(&path, bytes).with_context(|| format!("{}: cannot be written", path.display()))
        })?;
        let paths: BTreeSet<usize> = drawn.files.iter().map(|file| file.named_by).collect();
        Ok(paths.into_iter().map(|named_by| name(named_by, "*").into()).collect())
    }

    /// Returns text that changes with any of the files, and with their order.
    pub(super) fn drawn_checksums(&self) -> Option<String> {
        let drawn = self.drawn.as_ref()?;
        let checksums: Vec<String> = drawn.files.iter().map(|file| format!("{:08x}", file.checksum)).collect();
        Some(format!("an episode plays one of {}", checksums.join(" ")))
    }

    /// Returns the same scenario, in which all cars dawdle in whichever file an episode draws.
    pub(super) fn drawn_dawdling(&self, sigma: f64) -> Result<SumoScenario> {
        let mut paths: BTreeMap<usize, Vec<PathBuf>> = BTreeMap::new();
        for file in self.drawn.iter().flat_map(|drawn| &drawn.files) {
            paths.entry(file.named_by).or_default().push(file.path.clone());
        }
        let notes = self.notes.clone();
        let paths: Vec<Vec<PathBuf>> = paths.into_values().collect();
        let scenario = SumoScenario { drawn: None, ..self.clone() }.with_drawn(&paths, Some(sigma))?;
        Ok(SumoScenario { notes, ..scenario })
    }

    fn asked_for(&self) -> BTreeSet<String> {
        let mut asked = BTreeSet::new();
        [self.net()].into_iter().chain(self.additional()).for_each(|root| elements::asked_for(root, &mut asked));
        asked
    }

    /// Returns the scenario with a single route file, and what is not simulated of it.
    fn with_route_file(
        &self,
        path: &Path,
        sigma: Option<f64>,
        asked: &BTreeSet<String>,
    ) -> Result<(SumoScenario, Notes)> {
        let (file, left_out) = reading::route_file(path, asked)?;
        let mut scenario = SumoScenario { routes: vec![file], drawn: None, plays_drawn: true, ..self.clone() };
        let (departures, mut notes) = scenario.check_demand().with_context(|| path.display().to_string())?;
        notes.left_out.extend(left_out);
        scenario.departures = departures;
        if let Some(sigma) = sigma {
            scenario = scenario.dawdling(sigma)?;
        }
        if !scenario.closed.is_empty() {
            let closed = scenario.close_edges().with_context(|| path.display().to_string())?;
            scenario.without_closed = Some(Arc::new(closed));
        }
        Ok((scenario, notes))
    }

    fn route_checksum(&self) -> u32 {
        crc32fast::hash(self.routes[0].content.text().as_bytes())
    }
}

impl Known {
    fn read(
        scenario: &SumoScenario,
        path: &Path,
        named_by: usize,
        sigma: Option<f64>,
        asked: &BTreeSet<String>,
    ) -> Result<Known> {
        let (one, mut notes) = scenario.with_route_file(path, sigma, asked)?;
        notes.extend(locally::notes(&one));
        let file = DrawnFile { path: path.to_owned(), named_by, checksum: one.route_checksum() };
        Ok(Known {
            file,
            notes,
            travellers: one.travellers(),
            types: one.types().into_iter().cloned().collect(),
            may_have_devices: one.may_have_devices(),
            dawdles: one.dawdles(),
            detours: one.detours(),
            departures: one.departures,
        })
    }
}

impl Drawn {
    /// Joins what is known of all files. An error names a vehicle type that is not the same in all of them.
    fn of(known: Vec<Known>, sigma: Option<f64>) -> Result<(Drawn, Departures, Notes)> {
        let mut types: Vec<Element> = Vec::new();
        let mut places: HashMap<String, (usize, PathBuf)> = HashMap::new();
        let mut departures: Option<Departures> = None;
        let mut travellers: Option<Travellers> = None;
        let mut notes: [Kinds; 3] = Default::default();
        let mut drawn = Drawn {
            files: Vec::with_capacity(known.len()),
            travellers: Travellers::default(),
            types: Vec::new(),
            may_have_devices: false,
            dawdles: false,
            detours: None,
            sigma,
        };
        for one in known {
            let path = &one.file.path;
            for kind in one.types {
                match places.get(kind.id()) {
                    Some((place, other)) => ensure!(
                        types[*place] == kind,
                        "{}: its vehicle type `{}` is another one than in {}; rename one of the two, because episodes play either file",
                        path.display(),
                        kind.id(),
                        other.display()
                    ),
                    None => {
                        places.insert(kind.id().to_owned(), (types.len(), path.clone()));
                        types.push(kind);
                    }
                }
            }
            let Notes { left_out, without_locally, not_local } = one.notes;
            for (kinds, sentences) in notes.iter_mut().zip([left_out, without_locally, not_local]) {
                sentences.into_iter().for_each(|sentence| kinds.add(path, sentence));
            }
            departures = Some(match departures {
                None => one.departures,
                Some(others) => others.or(one.departures),
            });
            travellers = Some(match travellers {
                None => one.travellers,
                Some(others) => others.and(one.travellers),
            });
            drawn.may_have_devices |= one.may_have_devices;
            drawn.dawdles |= one.dawdles;
            drawn.detours = match (drawn.detours, one.detours) {
                (Some(others), Some(detours)) => Some(others.plus(&detours)),
                (others, detours) => others.or(detours),
            };
            drawn.files.push(one.file);
        }
        drawn.types = types;
        drawn.travellers = travellers.unwrap_or_default();
        let [left_out, without_locally, not_local] = notes.map(Kinds::sentences);
        Ok((drawn, departures.unwrap_or_default(), Notes { left_out, without_locally, not_local }))
    }
}

/// Sentences about many files. Those that differ in the path and in numbers only are one kind.
#[derive(Default)]
struct Kinds {
    places: HashMap<String, usize>,
    /// First sentence of each kind, and the number of files with others.
    first: Vec<(String, usize)>,
}

impl Kinds {
    fn add(&mut self, path: &Path, sentence: String) {
        let kind =
            sentence.replace(&path.display().to_string(), "").replace(|letter: char| letter.is_ascii_digit(), "");
        match self.places.get(&kind) {
            // One about an additional file is the same with every route file.
            Some(&place) => self.first[place].1 += usize::from(self.first[place].0 != sentence),
            None => {
                self.places.insert(kind, self.first.len());
                self.first.push((sentence, 0));
            }
        }
    }

    fn sentences(self) -> Vec<String> {
        let in_words = |(first, others): (String, usize)| match others {
            0 => first,
            others => format!("{first} (and {others} like it)"),
        };
        self.first.into_iter().map(in_words).collect()
    }
}
