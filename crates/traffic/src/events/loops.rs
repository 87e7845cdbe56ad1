//! The loops in SUMO: its `instantInductionLoop`s, which see every crossing with its exact time, however long a step is.
//! They only look, so an episode with them is the same to the last bit.

use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::os::fd::AsRawFd;

use anyhow::{Context, Result};
use roxmltree::Document;

use super::site::{DetectorPlace, Site};
use crate::network::memory_file::MemoryFile;
use crate::network::xml::{document, leaf};
use dials_core::outside::temporary_file;

/// Which loop of a detector.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LoopPlace {
    Begin,
    /// The stop line, of a detector that ends there.
    End,
}

/// The front of a car crosses a loop, or its rear does.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Crossing {
    /// Time in millionths of a second.
    pub(super) micros: u64,
    pub(super) site: usize,
    pub(super) detector: usize,
    pub(super) place: LoopPlace,
    /// Whether it is the front.
    pub(super) is_front: bool,
    /// Name of the car in SUMO.
    pub(super) car: String,
}

/// The loops as SUMO loads them, and the file that it writes for them.
pub(super) struct Loops {
    additional: MemoryFile,
    /// It has no name, so a killed process leaves none behind.
    crossings: File,
}

impl Loops {
    pub(super) fn of(sites: &[Site]) -> Result<Loops> {
        let crossings = temporary_file().context("the crossings of loops have no place")?;
        let file = format!("/proc/self/fd/{}", crossings.as_raw_fd());
        let text = document("additional", |xml| {
            for (number, site) in sites.iter().enumerate() {
                for (detector, of) in site.detectors.iter().enumerate() {
                    let mut put = |place, at_m: f64| {
                        let attributes = [
                            ("id", name(number, detector, place)),
                            ("lane", of.lane.clone()),
                            ("pos", at_m.to_string()),
                            ("friendlyPos", "true".to_owned()),
                            ("file", file.clone()),
                        ];
                        leaf(xml, "instantInductionLoop", attributes)
                    };
                    put(LoopPlace::Begin, of.begin_m)?;
                    if of.place == DetectorPlace::StopBar {
                        put(LoopPlace::End, of.begin_m + of.setback_m)?;
                    }
                }
            }
            Ok(())
        });
        Ok(Loops { additional: MemoryFile::new(&text)?, crossings })
    }

    /// Adds them to the options with which SUMO is loaded.
    pub(super) fn add_to(&self, options: &mut Vec<String>) {
        let path = self.additional.path();
        match options.iter().position(|option| option == "--additional-files") {
            Some(at) => options[at + 1] += &format!(",{path}"),
            None => options.extend(["--additional-files".to_owned(), path]),
        }
    }

    /// Reads what SUMO wrote in the last episode, in its order. SUMO keeps the end of it until it is closed.
    pub(super) fn crossings(&mut self) -> Result<Vec<Crossing>> {
        const UNREADABLE: &str = "the crossings of loops that SUMO wrote could not be read";
        self.crossings.rewind().context(UNREADABLE)?;
        let mut found = Vec::new();
        for line in BufReader::new(&self.crossings).lines() {
            let line = line.context(UNREADABLE)?;
            // SUMO also writes a line for each step in which a car is over a loop.
            if line.contains("<instantOut ") && !line.contains(r#" state="stay""#) {
                found.push(crossing(&line).with_context(|| format!("{UNREADABLE}: {}", line.trim()))?);
            }
        }
        Ok(found)
    }
}

fn name(site: usize, detector: usize, place: LoopPlace) -> String {
    let place = match place {
        LoopPlace::Begin => "begin",
        LoopPlace::End => "end",
    };
    format!("loop.{site}.{detector}.{place}")
}

fn crossing(line: &str) -> Result<Crossing> {
    let document = Document::parse(line.trim())?;
    let text = |name: &str| document.root_element().attribute(name).with_context(|| format!("`{name}` is missing"));
    let mut parts = text("id")?.split('.').skip(1);
    let mut part = || parts.next().context("it is of no loop of this program");
    Ok(Crossing {
        micros: (1e6 * text("time")?.parse::<f64>()?).round() as u64,
        site: part()?.parse()?,
        detector: part()?.parse()?,
        place: if part()? == "end" { LoopPlace::End } else { LoopPlace::Begin },
        is_front: text("state")? == "enter",
        car: text("vehID")?.to_owned(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_of_sumo_is_a_crossing() {
        let line = r#"  <instantOut id="loop.3.12.end" time="19.293718" state="leave" vehID="a&amp;b" speed="14.0" length="5"/>"#;
        let (place, is_front, car) = (LoopPlace::End, false, "a&b".to_owned());
        let expected = Crossing { micros: 19_293_718, site: 3, detector: 12, place, is_front, car };
        assert_eq!(crossing(line).unwrap(), expected);
        assert!(crossing(r#"<instantOut id="x" time="1" state="enter" vehID="a"/>"#).is_err());
    }
}
