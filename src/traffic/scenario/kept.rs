//! The copy of a scenario in a run directory: plain names, and a .sumocfg that `sumo -c` and `sumo-gui -c` open.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::SumoScenario;
use crate::outside::write_together;
use crate::traffic::network::xml::{document, section};

/// Names in the copy. Files of which there may be several are numbered from 1.
const SUMOCFG: &str = "scenario.sumocfg";
const NET: &str = "scenario.net.xml";
const AGENTS: &str = "agents.toml";

fn routes(number: usize) -> String {
    format!("scenario.{}.rou.xml", number + 1)
}

fn additional(number: usize) -> String {
    format!("scenario.{}.add.xml", number + 1)
}

impl SumoScenario {
    /// Makes a folder and copies the scenario into it, all or nothing. Returns the paths in the folder, in the order of
    /// the config's keys that name files.
    pub fn keep_in(&self, folder: &Path) -> Result<Vec<PathBuf>> {
        fs::create_dir(folder).with_context(|| format!("{}: cannot be made", folder.display()))?;
        let mut files = vec![(NET.to_owned(), self.net.content.bytes())];
        files.extend(self.routes.iter().enumerate().map(|(number, file)| (routes(number), file.content.bytes())));
        files.extend(
            self.additional.iter().enumerate().map(|(number, file)| (additional(number), file.content.bytes())),
        );
        let mut kept = vec![PathBuf::from(SUMOCFG)];
        if let Some((_, text)) = self.agents() {
            files.push((AGENTS.to_owned(), text.as_bytes()));
            kept.push(PathBuf::from(AGENTS));
        }
        let sumocfg = self.sumocfg();
        files.push((SUMOCFG.to_owned(), sumocfg.as_bytes()));
        let files: Vec<_> = files.into_iter().map(|(name, bytes)| (folder.join(name), bytes.to_vec())).collect();
        write_together(folder, &files)?;
        Ok(kept)
    }

    /// Returns the .sumocfg of the copy.
    fn sumocfg(&self) -> String {
        let list = |name: fn(usize) -> String, count: usize| (0..count).map(name).collect::<Vec<_>>().join(",");
        let (route_files, additional_files) =
            (list(routes, self.routes.len()), list(additional, self.additional.len()));
        let mut input = vec![("net-file", NET)];
        input.extend([("route-files", &*route_files), ("additional-files", &*additional_files)]);
        input.retain(|(_, files)| !files.is_empty());
        let (begin, end) = (self.window_s.0.to_string(), self.window_s.1.to_string());
        let options: Vec<(&str, &str)> = self.options.iter().map(|(name, value)| (&**name, &**value)).collect();
        document("configuration", |xml| {
            section(xml, "input", &input)?;
            section(xml, "time", &[("begin", &begin), ("end", &end), ("step-length", "1")])?;
            section(xml, "processing", &options)?;
            // Without it, SUMO warns of a missing SUMO_HOME, where it would look for the schemas.
            section(xml, "report", &[("xml-validation", "never")])
        })
    }
}
