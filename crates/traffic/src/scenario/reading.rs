//! Reads the files that a .sumocfg names, as SUMO will get them.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, anyhow, ensure};

use super::elements::{self, Left};
use super::programs::{Choice, Chosen};
use super::{File, include, newer};
use crate::config::sumo_numbers::check_elements;
use crate::config::sumocfg::Sumocfg;
use crate::network::contents::Content;
use crate::network::other_files;

pub(super) const NET_FILE: &str = "net-file";
pub(super) const ROUTE_FILES: &str = "route-files";

pub(super) struct Files {
    pub(super) net: File,
    pub(super) additional: Vec<File>,
    pub(super) routes: Vec<File>,
    /// What was left out of them, a sentence each.
    pub(super) left_out: Vec<String>,
    pub(super) chosen: Chosen,
}

/// A file that was read, and the option that names it.
struct Read<'a> {
    option: &'static str,
    path: &'a Path,
    content: Content,
    is_changed: bool,
}

impl Files {
    /// `scenario`: path of the .sumocfg, for messages.
    pub(super) fn read(scenario: &Path, sumocfg: &Sumocfg, programs: &Choice) -> Result<Files> {
        let named = |option: &'static str, paths: &'_ [std::path::PathBuf]| -> Vec<_> {
            paths.iter().map(|path| (option, path.clone())).collect()
        };
        let additional = named("additional-files", &sumocfg.additional);
        let routes = named(ROUTE_FILES, &sumocfg.routes);
        let all: Vec<_> = [(NET_FILE, sumocfg.net.clone())].into_iter().chain(additional).chain(routes).collect();
        let mut files = all.iter().map(|(option, path)| read(scenario, option, path)).collect::<Result<Vec<_>>>()?;
        let in_nets = files.iter_mut().filter(|file| file.option != ROUTE_FILES);
        let chosen = programs.apply(scenario, in_nets.map(|file| (&mut file.content.root, &mut file.is_changed)))?;
        let mut asked = BTreeSet::new();
        files.iter().for_each(|file| elements::asked_for(&file.content.root, &mut asked));
        let (mut left, mut left_out) = (Left::default(), Vec::new());
        let here = || libsumo::load().ok().map(|sumo| sumo.version);
        for file in &mut files {
            let root = &mut file.content.root;
            let note = if root.name == "net" { newer::forget_classes(root, here) } else { None };
            file.is_changed |= note.is_some();
            left_out.extend(note.map(|note| format!("{}: {note}", file.path.display())));
            file.clean(&asked, &mut left)?;
        }
        left_out.extend(left.sentences());
        let mut files = files.into_iter();
        let mut of = |count: usize| -> Vec<File> {
            let some = files.by_ref().take(count);
            some.map(|file| File { path: file.path.to_owned(), content: Arc::new(file.content) }).collect()
        };
        let net = of(1).remove(0);
        let (additional, routes) = (of(sumocfg.additional.len()), of(sumocfg.routes.len()));
        Ok(Files { net, additional, routes, left_out, chosen })
    }
}

/// Reads a route file that a config names. `asked`: names of detectors that must stay. Returns also what was left out, a sentence
/// each.
pub(super) fn route_file(path: &Path, asked: &BTreeSet<String>) -> Result<(File, Vec<String>)> {
    let mut content = Content::parse(path)?;
    let is_changed = include::put_in_place(path, &mut content.root)?;
    ensure!(
        content.root.name != "net",
        "{}: is a net, and traffic.routes names route files; correct it",
        path.display()
    );
    let mut file = Read { option: ROUTE_FILES, path, content, is_changed };
    let mut left = Left::default();
    file.clean(asked, &mut left)?;
    let content = Arc::new(file.content);
    Ok((File { path: path.to_owned(), content }, left.sentences().collect()))
}

impl Read<'_> {
    /// Takes out what is not needed. An error names what this program cannot take over.
    fn clean(&mut self, asked: &BTreeSet<String>, left: &mut Left) -> Result<()> {
        let root = &mut self.content.root;
        self.is_changed |= elements::clean(self.option, self.path, root, asked, left);
        other_files::refuse(self.path, root)?;
        check_elements(root).map_err(|error| anyhow!("{}: {error}", self.path.display()))?;
        if self.is_changed {
            self.content.rewrite();
        }
        Ok(())
    }
}

fn read<'a>(scenario: &Path, option: &'static str, path: &'a Path) -> Result<Read<'a>> {
    ensure!(
        path.exists(),
        "{}: <{option}> names {}, and there is no such file; correct the path",
        scenario.display(),
        path.display()
    );
    let mut content = Content::parse(path)?;
    let is_changed = include::put_in_place(path, &mut content.root)?;
    ensure!(
        option == NET_FILE || content.root.name != "net",
        "{}: is a net, and <{option}> of {} names it; correct the path",
        path.display(),
        scenario.display()
    );
    Ok(Read { option, path, content, is_changed })
}
