//! Run directories: made, described, and opened again; and how any directory of files is made, whole or not at all.

use std::fs::{self, Permissions};
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use serde_json::json;

use super::END_WITH;
use super::build::Build;
use super::domain;
use super::terminal::tell;
use crate::config::{self, Config};
use crate::domain::Domain;
use crate::policy::{JointPolicy, JointPolicyController, Selection};
use crate::training::files::{self, write_atomically};
use crate::training::joint_layout::JointLayout;

/// What to do where something is at the place of a new run directory.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Existing {
    /// An error.
    Refuse,
    /// Move it to the first free of `path.old-1`, `path.old-2`, ...
    MoveAside,
    /// Leave it and take the first free of `path-2`, `path-3`, ...
    Number,
}

/// Makes the directory of a new run and returns its path. Self-contained: it holds config, networks and circumstances.
pub fn create(path: &Path, existing: Existing, config: &Config) -> Result<PathBuf> {
    let path = place(path, existing)?;
    // Later the run loads its networks from here.
    domain::check_place(config, &path)?;
    make(&path, existing, |dir| describe(dir, config))?;
    Ok(path)
}

/// Where [`make`] will make a directory; an error if something is there that must not be.
pub fn place(path: &Path, existing: Existing) -> Result<PathBuf> {
    let path = match existing {
        Existing::Refuse | Existing::MoveAside => path.to_owned(),
        Existing::Number => first_free(path, "-", 2),
    };
    ensure!(
        existing != Existing::Refuse || is_free(&path),
        "{}: exists already; name another one with --out, or move it aside with --force",
        path.display()
    );
    Ok(path)
}

/// Makes the directory `path`, a [`place`], with what `fill` writes into the directory that it is handed.
///
/// It is filled under another name beside its place and moved there whole, so that an error leaves everything as it was,
/// and so that what is moved aside may be where the content comes from.
pub fn make<T>(path: &Path, existing: Existing, fill: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
    let parent = files::folder_of(path);
    let new_folders: Vec<&Path> = parent.ancestors().take_while(|folder| !folder.exists()).collect();
    fill_and_move(path, parent, existing, fill).inspect_err(|_| {
        new_folders.iter().for_each(|folder| drop(fs::remove_dir(folder)));
    })
}

fn fill_and_move<T>(
    path: &Path,
    parent: &Path,
    existing: Existing,
    fill: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let failed = || format!("{}: cannot be made", path.display());
    if !parent.exists() {
        fs::create_dir_all(parent).with_context(failed)?;
    }
    // A temporary directory is for its owner alone by default; this one is for everyone whom the umask allows.
    let mut builder = tempfile::Builder::new();
    let builder = builder.prefix(".new-").permissions(Permissions::from_mode(0o777));
    let staged = builder.tempdir_in(parent).with_context(failed)?;
    let filled = fill(staged.path())?;
    let aside = match existing {
        Existing::MoveAside if !is_free(path) => Some(move_aside(path)?),
        _ => None,
    };
    let moved = fs::rename(staged.path(), path).with_context(failed);
    match (&moved, &aside) {
        (Ok(()), Some(aside)) => tell_moved(path, aside),
        (Err(_), Some(aside)) => drop(fs::rename(aside, path)),
        (_, None) => {}
    }
    moved?;
    drop(staged.keep()); // Nothing is at that name any more.
    Ok(filled)
}

/// Renames what is at `path` to the first free of `path.old-1`, `path.old-2`, ... and returns that.
pub fn move_aside(path: &Path) -> Result<PathBuf> {
    let aside = first_free(path, ".old-", 1);
    fs::rename(path, &aside).with_context(|| format!("{}: cannot be moved aside", path.display()))?;
    Ok(aside)
}

pub fn tell_moved(path: &Path, aside: &Path) {
    tell(format_args!("moved {} to {}", path.display(), aside.display()));
}

/// Writes config, networks and circumstances.
fn describe(dir: &Path, config: &Config) -> Result<()> {
    let kept = domain::keep_files(config, dir)?;
    write_atomically(&dir.join(files::CONFIG), config::to_toml(&kept)?.as_bytes())?;
    let run = json!({
        "seed": config.seed,
        "command": command_line(),
        "versions": Build::here(config.numerics.vector_width)?,
    });
    write_atomically(&dir.join(files::RUN), format!("{run:#}\n").as_bytes())
}

/// How the program was called, without what ties it to the life of an experiment.
fn command_line() -> Vec<String> {
    let mut words = std::env::args_os().map(|word| word.to_string_lossy().into_owned());
    let mut kept = Vec::new();
    while let Some(word) = words.next() {
        if word == END_WITH {
            words.next();
        } else {
            kept.push(word);
        }
    }
    kept
}

/// What [`open`] finds: a run that can be evaluated.
pub struct TrainedRun {
    pub config: Config,
    pub domain: Arc<dyn Domain>,
    pub policies: JointPolicy,
}

/// Reads the config of a run directory and opens its domain.
pub fn open_config(path: &Path) -> Result<(Config, Arc<dyn Domain>)> {
    let config_path = path.join(files::CONFIG);
    ensure!(
        config_path.is_file(),
        "{}: not a run directory: it has no {}; `dials-traffic train` makes one",
        path.display(),
        files::CONFIG
    );
    let config = config::load(&config_path, &[])?;
    let domain = domain::open(&config)?;
    Ok((config, domain))
}

/// Reads a run directory with its policies.
pub fn open(path: &Path) -> Result<TrainedRun> {
    let (config, domain) = open_config(path)?;
    let saved = path.join(files::POLICIES);
    ensure!(saved.is_file(), "{}: has no policies yet; they are written after the first period", path.display());
    let policies = JointLayout::of_policies(domain.kinds(), &config.policy).read(&saved)?;
    Ok(TrainedRun { config, domain, policies })
}

impl TrainedRun {
    /// Its policies as they act on the GS.
    pub fn controller(&self, selection: Selection) -> JointPolicyController {
        JointPolicyController::new(self.domain.kinds(), &self.config.policy, &self.policies, selection)
    }
}

/// `path` itself where there is nothing and numbers begin at 2, else the first free of `path` + `word` + number.
fn first_free(path: &Path, word: &str, first: usize) -> PathBuf {
    if first > 1 && is_free(path) {
        return path.to_owned();
    }
    let mut candidates = (first..).map(|number| {
        let mut name = path.file_name().unwrap_or_default().to_owned();
        name.push(format!("{word}{number}"));
        path.with_file_name(name)
    });
    candidates.find(|candidate| is_free(candidate)).expect("numbers go on")
}

/// An error if something is where `option` shall make a directory.
pub fn check_free(path: &Path, option: &str) -> Result<()> {
    ensure!(is_free(path), "{}: exists already; name another directory with {option}", path.display());
    Ok(())
}

/// Makes a directory where there is none; an error if no file can be made in it.
pub fn check_writable(dir: &Path) -> Result<()> {
    let failed = || format!("{}: cannot be written to", dir.display());
    fs::create_dir_all(dir).with_context(failed)?;
    tempfile::tempfile_in(dir).map(drop).with_context(failed)
}

/// An error if two of the places that options name are the same, or one is within another.
pub fn check_apart(places: &[(&str, Option<&Path>)]) -> Result<()> {
    let places: Vec<_> = places.iter().filter_map(|&(option, path)| Some((option, path?, real(path?)))).collect();
    for (number, (option, path, place)) in places.iter().enumerate() {
        for (other, _, taken) in &places[..number] {
            ensure!(
                !place.starts_with(taken) && !taken.starts_with(place),
                "{}: {other} and {option} must not write to the same place, nor one within the other's; name another one",
                path.display()
            );
        }
    }
    Ok(())
}

/// A path without links, as far as it exists.
fn real(path: &Path) -> PathBuf {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let known = path.ancestors().find_map(|known| Some((known.canonicalize().ok()?, path.strip_prefix(known).ok()?)));
    known.map(|(known, rest)| known.join(rest)).unwrap_or(path)
}

/// Nothing is there, not even a link that leads nowhere.
pub fn is_free(path: &Path) -> bool {
    path.symlink_metadata().is_err()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::traffic::net_file::NetworkFiles;

    /// A config that is loaded from `dir`, with the networks of this project.
    fn config_in(dir: &Path) -> Config {
        let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
        let text = format!("[traffic]\nnetwork = '{0}/grid_2x2'\nlocal_network = '{0}/local'\n", nets.display());
        fs::write(dir.join("c.toml"), text).unwrap();
        config::load(&dir.join("c.toml"), &[]).unwrap()
    }

    fn networks_of(config: &Config) -> [NetworkFiles; 2] {
        let traffic = config.traffic.as_ref().unwrap();
        [&traffic.network, &traffic.local_network].map(|network| NetworkFiles::of(network))
    }

    fn names(dir: &Path) -> Vec<String> {
        let entries = fs::read_dir(dir).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn an_existing_directory_is_refused_numbered_or_moved_aside() {
        let dir = tempfile::tempdir().unwrap();
        let (config, path) = (config_in(dir.path()), dir.path().join("a.b"));
        create(&path, Existing::Refuse, &config).unwrap();
        fs::write(path.join("precious"), "x").unwrap();
        let error = create(&path, Existing::Refuse, &config).unwrap_err().to_string();
        assert!(error.contains("exists already") && error.contains("--force"), "{error}");
        assert_eq!(create(&path, Existing::Number, &config).unwrap(), dir.path().join("a.b-2"));
        assert_eq!(create(&path, Existing::Number, &config).unwrap(), dir.path().join("a.b-3"));
        assert_eq!(create(&dir.path().join("c"), Existing::Number, &config).unwrap(), dir.path().join("c"));
        create(&path, Existing::MoveAside, &config).unwrap();
        assert!(!path.join("precious").exists());
        assert!(dir.path().join("a.b.old-1/precious").exists());
        assert_eq!(names(dir.path()), ["a.b", "a.b-2", "a.b-3", "a.b.old-1", "c", "c.toml"]);
    }

    #[test]
    fn places_that_meet_are_told_from_places_apart() {
        let dir = tempfile::tempdir().unwrap();
        let place = |name: &str| dir.path().join(name);
        fs::create_dir(place("a")).unwrap();
        std::os::unix::fs::symlink(place("a"), place("link")).unwrap();
        let apart = |one: &str, other: &str| check_apart(&[("--x", Some(&place(one))), ("--y", Some(&place(other)))]);
        for (one, other) in [("a", "b"), ("a", "ab"), ("new/a", "new/b"), ("a/b", "link/c")] {
            apart(one, other).unwrap();
        }
        for (one, other) in [("a", "a"), ("new", "./new"), ("new", "new/in"), ("a/b/c", "a"), ("a/b", "link/b")] {
            let error = apart(one, other).unwrap_err().to_string();
            assert!(error.contains(": --x and --y must not write to the same place"), "{error}");
        }
        check_apart(&[("--x", None), ("--y", Some(&place("a"))), ("--z", None)]).unwrap();
    }

    #[test]
    fn an_error_changes_nothing_and_leaves_nothing_behind() {
        let dir = tempfile::tempdir().unwrap();
        let (config, path) = (config_in(dir.path()), dir.path().join("run"));
        create(&path, Existing::Refuse, &config).unwrap();
        fs::write(path.join("precious"), "x").unwrap();
        let mut lost = config.clone();
        lost.traffic.as_mut().unwrap().network = dir.path().join("nowhere");
        for place in [path.clone(), dir.path().join("new/and/deep")] {
            let error = create(&place, Existing::MoveAside, &lost).unwrap_err();
            assert!(error.to_string().contains("nowhere.net.xml: no such network"), "{error}");
            assert_eq!(names(dir.path()), ["c.toml", "run"]);
        }
        assert!(path.join("precious").exists());
    }

    #[test]
    fn a_run_may_take_the_place_of_the_one_that_its_networks_come_from() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("run");
        create(&path, Existing::Refuse, &config_in(dir.path())).unwrap();
        let kept = config::load(&path.join(files::CONFIG), &[]).unwrap();
        create(&path, Existing::MoveAside, &kept).unwrap();
        let again = config::load(&path.join(files::CONFIG), &[]).unwrap();
        networks_of(&again).iter().for_each(|network| network.check().unwrap());
    }

    #[test]
    fn networks_of_one_name_from_two_folders_are_both_kept() {
        let dir = tempfile::tempdir().unwrap();
        let mut config = config_in(dir.path());
        let [global, local] = networks_of(&config);
        for (network, folder) in [(&global, "g"), (&local, "l")] {
            network.copy_to(&dir.path().join(folder), "same").unwrap();
        }
        let traffic = config.traffic.as_mut().unwrap();
        traffic.network = dir.path().join("g/same");
        traffic.local_network = dir.path().join("l/same");
        let path = create(&dir.path().join("run"), Existing::Refuse, &config).unwrap();
        let kept = networks_of(&config::load(&path.join(files::CONFIG), &[]).unwrap());
        for (kept, original) in kept.iter().zip([&global, &local]) {
            assert_eq!(fs::read(&kept.net).unwrap(), fs::read(&original.net).unwrap());
            assert_eq!(fs::read(&kept.routes).unwrap(), fs::read(&original.routes).unwrap());
        }
    }
}
