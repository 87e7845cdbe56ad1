//! What of RESCO is in the user's folder: for each map its net, its files of demand, and its .sumocfg if it has one.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use dials_report::resco::published::{MAPS, Map};
use dials_traffic::config::files_called;
use dials_traffic::config::sumocfg::Sumocfg;

/// Folders within the user's folder where the maps may be.
const PLACES: [&str; 3] = ["", "environments", "resco_benchmark/environments"];

pub(super) struct Found {
    pub(super) copies: Vec<MapCopy>,
    /// Names of the maps that are not there.
    pub(super) absent: Vec<&'static str>,
}

/// The files of one map.
#[derive(Debug)]
pub(super) struct MapCopy {
    pub(super) map: &'static Map,
    pub(super) net: PathBuf,
    pub(super) routes: Vec<PathBuf>,
    /// Files of which each episode plays one, as a config names them. `None`: all episodes play the same.
    pub(super) demands: Option<PathBuf>,
    pub(super) additional: Vec<PathBuf>,
    /// Options of its .sumocfg that change traffic.
    pub(super) options: Vec<(String, String)>,
    /// Begin and end that its .sumocfg names.
    pub(super) window_s: Option<[u64; 2]>,
    pub(super) notes: Vec<String>,
}

/// Looks for the maps in a folder that holds them, or that is one of them. `wanted`: names; if empty, all that are there.
pub(super) fn find(dir: &Path, wanted: &[String]) -> Result<Found> {
    ensure!(dir.is_dir(), "{}: no such folder; name your copy of RESCO's folder `environments`", dir.display());
    for name in wanted {
        let names = || MAPS.iter().map(|map| map.name).collect::<Vec<_>>().join(", ");
        ensure!(Map::called(name).is_some(), "--maps: {name}: is no map of RESCO; its maps: {}", names());
    }
    let (mut copies, mut absent) = (Vec::new(), Vec::new());
    for map in &MAPS {
        let is_wanted = wanted.is_empty() || wanted.iter().any(|name| name == map.name);
        match folder_of(dir, map.name).filter(|_| is_wanted) {
            Some(folder) => copies.push(MapCopy::read(map, &folder)?),
            None => absent.push((map.name, is_wanted)),
        }
    }
    let missing: Vec<&str> = absent.iter().filter(|(_, is_wanted)| *is_wanted).map(|(name, _)| *name).collect();
    if copies.is_empty() || !wanted.is_empty() && !missing.is_empty() {
        bail!(
            "{}: has no folder with the files of {}; every map has one of its name, with NAME.net.xml and NAME.rou.xml in it",
            dir.display(),
            missing.join(", ")
        );
    }
    Ok(Found { copies, absent: missing })
}

/// Returns the folder of a map: one of its name, or the folder itself if the map is in it.
fn folder_of(dir: &Path, name: &str) -> Option<PathBuf> {
    let has = |folder: &PathBuf| {
        let endings = [".net.xml", ".net.xml.gz", ".sumocfg"];
        endings.iter().any(|ending| folder.join(format!("{name}{ending}")).is_file())
            || folder.file_name().is_some_and(|own| own == name) && !with_ending(folder, ".net.xml").is_empty()
    };
    let named = PLACES.iter().map(|place| dir.join(place).join(name));
    named.chain([dir.to_owned()]).find(has)
}

/// Returns the files of a folder whose names end so, in order.
fn with_ending(folder: &Path, ending: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_file()).collect();
    files.retain(|path| path.file_name().is_some_and(|name| name.to_string_lossy().ends_with(ending)));
    files.sort();
    files
}

impl MapCopy {
    fn read(map: &'static Map, folder: &Path) -> Result<MapCopy> {
        let own = folder.join(format!("{}.sumocfg", map.name));
        let sumocfg = if own.is_file() { Some(own) } else { one_of(with_ending(folder, ".sumocfg")) };
        let mut notes = Vec::new();
        let read = match &sumocfg {
            Some(path) => Some(Sumocfg::read(path)?),
            None => {
                notes.push(format!("It has no {}.sumocfg, so its times are those of RESCO's protocol.", map.name));
                None
            }
        };
        if read.as_ref().is_some_and(|read| read.steps_per_s != 1) {
            notes.push("A step of SUMO takes a second here, whatever its .sumocfg says (step-length).".to_owned());
        }
        let file = read.as_ref();
        let net = file.map(|file| file.net.clone()).filter(|net| net.is_file());
        let net = net
            .or_else(|| named_or_only(folder, map.name, ".net.xml"))
            .with_context(|| format!("{}: has no net; RESCO calls it {}.net.xml", folder.display(), map.name))?;
        let routes = file.map(|file| file.routes.clone()).unwrap_or_default();
        let are_there = !routes.is_empty() && routes.iter().all(|path| path.is_file());
        let routes = if are_there { Some(routes) } else { routes_in(folder, map.name) }.with_context(|| {
            format!(
                "{}: has no demand; RESCO calls it {name}.rou.xml or {name}_1.rou.xml",
                folder.display(),
                name = map.name
            )
        })?;
        let mut demands = None;
        if map.many_demands {
            // As RESCO numbers them: NAME_1.rou.xml to NAME_1400.rou.xml.
            let all = folder.join(format!("{}_[0-9]*.rou.xml", map.name));
            let count = files_called(&all).map_or(0, |files| files.len());
            demands = Some(all).filter(|_| count > 1);
            let here = match count {
                0 | 1 => {
                    "This copy has only one, so all episodes have that, and the random numbers of the cars differ."
                        .to_owned()
                }
                _ => format!("So do all here: the seed of an episode draws one of the {count} files of this copy."),
            };
            notes.push(format!("RESCO plays another file of demand in every episode. {here}"));
        }
        let window_s = file.and_then(|file| Some([file.begin_s, file.end_s?]));
        Ok(MapCopy {
            map,
            net,
            routes,
            demands,
            additional: file.map(|file| file.additional.clone()).unwrap_or_default(),
            options: file.map(|file| file.options.clone()).unwrap_or_default(),
            window_s,
            notes,
        })
    }
}

fn one_of(mut files: Vec<PathBuf>) -> Option<PathBuf> {
    if files.len() == 1 { files.pop() } else { None }
}

fn named_or_only(folder: &Path, name: &str, ending: &str) -> Option<PathBuf> {
    let own = folder.join(format!("{name}{ending}"));
    if own.is_file() { Some(own) } else { one_of(with_ending(folder, ending)) }
}

/// Returns the files of demand: the one of the map's name, or the first numbered one, or the only one.
fn routes_in(folder: &Path, name: &str) -> Option<Vec<PathBuf>> {
    let ending = ".rou.xml";
    let own = folder.join(format!("{name}{ending}"));
    let found = if own.is_file() { Some(own) } else { numbered(folder, name).into_iter().next() };
    Some(vec![found.or_else(|| one_of(with_ending(folder, ending)))?])
}

/// Returns `NAME_1.rou.xml`, `NAME_2.rou.xml` and so on, in the order of their numbers.
fn numbered(folder: &Path, name: &str) -> Vec<PathBuf> {
    let mut files: Vec<(u64, PathBuf)> = Vec::new();
    for path in with_ending(folder, ".rou.xml") {
        let file = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let number = file.strip_prefix(name).and_then(|rest| rest.strip_prefix('_')?.strip_suffix(".rou.xml"));
        if let Some(number) = number.and_then(|number| number.parse().ok()) {
            files.push((number, path));
        }
    }
    files.sort();
    files.into_iter().map(|(_, path)| path).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    const NET: &str = "<net/>";

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        for file in files {
            let path = dir.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, NET).unwrap();
        }
        dir
    }

    #[test]
    fn maps_are_found_in_folders_of_their_names_and_without_a_sumocfg() {
        let dir =
            folder(&["environments/cologne8/cologne8.net.xml", "environments/cologne8/cologne8.rou.xml", "b/c.xml"]);
        let found = find(dir.path(), &[]).unwrap();
        let [copy] = &found.copies[..] else { panic!("{} maps", found.copies.len()) };
        assert_eq!((copy.map.name, copy.window_s), ("cologne8", None));
        assert!(copy.routes[0].ends_with("cologne8.rou.xml") && found.absent.len() == 7);
        // The folder of the map itself.
        let own = find(&dir.path().join("environments/cologne8"), &[]).unwrap();
        assert_eq!(own.copies[0].net, copy.net);
    }

    #[test]
    fn the_first_of_numbered_demands_is_the_one_with_the_least_number() {
        let routes = ["10", "2", "x"].map(|number| format!("arterial4x4/arterial4x4_{number}.rou.xml"));
        let [ten, two, other] = &routes;
        let dir = folder(&["arterial4x4/arterial4x4.net.xml", ten, two, other]);
        let copy = find(dir.path(), &["arterial4x4".to_owned()]).unwrap().copies.remove(0);
        assert!(copy.routes[0].ends_with("arterial4x4_2.rou.xml"), "{:?}", copy.routes);
        assert!(copy.notes[1].ends_with("draws one of the 2 files of this copy."), "{:?}", copy.notes);
        assert!(copy.demands.unwrap().ends_with("arterial4x4_[0-9]*.rou.xml"));
    }

    #[test]
    fn a_copy_with_one_of_many_demands_says_so() {
        let dir = folder(&["grid4x4/grid4x4.net.xml", "grid4x4/grid4x4_1.rou.xml"]);
        let copy = find(dir.path(), &[]).unwrap().copies.remove(0);
        assert_eq!(copy.demands, None);
        assert!(copy.notes[1].contains("This copy has only one"), "{:?}", copy.notes);
    }

    #[test]
    fn what_is_missing_is_named() {
        let dir = folder(&["cologne1/cologne1.net.xml"]);
        let error = |wanted: &[&str]| {
            let wanted: Vec<String> = wanted.iter().map(|&name| name.to_owned()).collect();
            format!("{:#}", find(dir.path(), &wanted).err().unwrap())
        };
        assert!(error(&[]).ends_with("has no demand; RESCO calls it cologne1.rou.xml or cologne1_1.rou.xml"));
        assert!(error(&["cologne2"]).starts_with("--maps: cologne2: is no map of RESCO; its maps: cologne1, "));
        assert!(error(&["grid4x4"]).contains("has no folder with the files of grid4x4"));
    }
}
