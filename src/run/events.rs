//! `--events`: the event log of the street, with a table of its detectors and one of its phases beside it.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};

use dials_core::outside::{Directory, folder_of};
use dials_learn::evaluation::csv::Lines;
use dials_session::config::RunConfig;
use dials_session::domains;
use dials_session::outputs::{check_free, check_writable};
use dials_session::places::{self, Existing};
use dials_session::records::growing::{GrowingFile, Mark};
use dials_session::terminal::note;
use dials_traffic::Traffic;
use dials_traffic::events::EventLog;
use dials_traffic::events::site::Site;
use dials_traffic::events::tables::{self, Table};

/// The files of `--events`. Each episode is written as soon as it was played.
pub(super) struct EventFiles {
    pub(super) log: EventLog,
    sites: Vec<Site>,
    files: Files,
    existing: Existing,
    /// Nothing is made before the first episode was played.
    directory: Option<Directory>,
    growing: GrowingFile,
}

/// The log and the two tables beside it.
#[derive(Debug)]
struct Files {
    log: PathBuf,
    detectors: PathBuf,
    phases: PathBuf,
}

impl Files {
    fn of(log: &Path) -> Result<Files> {
        let name = log.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        let stem = name.strip_suffix(".csv").filter(|stem| !stem.is_empty());
        let stem = stem.with_context(|| format!("--events {}: must name a file that ends in .csv", log.display()))?;
        let beside = |what: &str| log.with_file_name(format!("{stem}_{what}.csv"));
        Ok(Files { log: log.to_owned(), detectors: beside("detectors"), phases: beside("phases") })
    }

    fn all(&self) -> [&Path; 3] {
        [&self.log, &self.detectors, &self.phases]
    }
}

impl EventFiles {
    /// Checks that the files can be made, before long work begins. Returns also the domain whose episodes go into the log.
    /// `None`: the option was not given.
    pub(super) fn asked_for(
        file: Option<&Path>,
        existing: Existing,
        config: &RunConfig,
    ) -> Result<Option<(Traffic, EventFiles)>> {
        let Some(file) = file else { return Ok(None) };
        let files = Files::of(file)?;
        files.all().into_iter().try_for_each(|file| check_free(file, "--events", existing))?;
        check_writable(folder_of(file))?;
        let log = EventLog::default();
        let traffic = domains::open_logged(config, &log).context("--events: nothing can be logged")?;
        let sites = traffic.sites()?;
        ensure!(!sites.is_empty(), "--events: cars obey no light here, so there is nothing to log");
        let name = file.file_name().and_then(|name| name.to_str()).expect("a name that was checked");
        let growing = GrowingFile::new(name, Mark::default());
        Ok(Some((traffic, EventFiles { log, sites, files, existing, directory: None, growing })))
    }

    /// Writes what was logged since the last call.
    pub(super) fn append(&mut self) -> Result<()> {
        let directory = match &self.directory {
            Some(directory) => directory,
            None => {
                self.files.all().into_iter().try_for_each(|file| places::clear(file, self.existing))?;
                let directory = Directory::open(folder_of(&self.files.log))?;
                for (file, table) in [
                    (&self.files.detectors, tables::detectors(&self.sites)),
                    (&self.files.phases, tables::phases(&self.sites)),
                ] {
                    let name = file.file_name().and_then(|name| name.to_str()).expect("a name that was checked");
                    GrowingFile::new(name, Mark::default()).append_lines(&directory, &lines(table))?;
                }
                self.directory.insert(directory)
            }
        };
        self.growing.append_lines(directory, &lines(tables::log(&self.sites, &self.log.take())))
    }

    /// Says what was written.
    pub(super) fn note_written(&self) {
        let [log, detectors, phases] = self.files.all().map(Path::display);
        note(format_args!("wrote the event log {log}, with {detectors} and {phases}"));
    }
}

fn lines(Table { header, lines }: Table) -> Lines {
    Lines { header, lines }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_are_beside_the_log() {
        let files = Files::of(Path::new("out/street.csv")).unwrap();
        assert_eq!(
            files.all().map(|file| file.to_str().unwrap()),
            ["out/street.csv", "out/street_detectors.csv", "out/street_phases.csv"]
        );
        for wrong in ["out/street", "out/.csv", "street.parquet", "/"] {
            let error = Files::of(Path::new(wrong)).unwrap_err().to_string();
            assert!(error.contains("must name a file that ends in .csv"), "{error}");
        }
    }
}
