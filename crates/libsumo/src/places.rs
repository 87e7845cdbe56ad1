//! The places where SUMO's library is looked for, and SUMO's programs beside it.

use std::env;
use std::ffi::CStr;
use std::fs;
use std::path::{self, Path, PathBuf};

use super::{ffi, library};

/// The file name of SUMO's library.
pub(crate) const LIBRARY: &str = "libsumocpp.so";
/// The variable that names the library's file. Nothing else is looked at then.
pub(crate) const VARIABLE: &str = "DIALS_SUMO_LIBRARY";

/// The source of the library that the system's loader finds.
const SYSTEM: &str = "the system";

/// Folders of an installed SUMO that may hold its library.
const LIBRARY_FOLDERS: [&str; 3] = ["lib64", "lib", "bin"];
/// Folders of packages in that of a Python. The second one is Debian's, for what pip installs as root.
const PACKAGES: [&str; 2] = ["site-packages", "dist-packages"];
/// The file that makes a folder a Python package.
pub(crate) const PACKAGE: &str = "__init__.py";

/// A place where SUMO's library is looked for.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Place {
    /// Who names this place: a variable such as `SUMO_HOME`, `beside this program` or `the system`.
    pub source: &'static str,
    /// The library's file. Of the system only its name, because the system's loader finds it.
    pub library: PathBuf,
    /// Whether the file is there. `None`: only the system's loader knows.
    pub is_there: Option<bool>,
}

/// Returns the places where SUMO's library is looked for, in order. The first one that has it is taken.
///
/// These are: the file that `DIALS_SUMO_LIBRARY` names, and then no other; `SUMO_HOME`; the Python packages beside this program or
/// library, as `pip install eclipse-sumo` makes them; the environments `VIRTUAL_ENV` and `CONDA_PREFIX`; the system.
pub fn places() -> Vec<Place> {
    let at = |source, library: PathBuf| Place { source, is_there: Some(library.exists()), library };
    if let Some(library) = variable(VARIABLE) {
        return vec![at(VARIABLE, library)];
    }
    let mut places = Vec::new();
    let mut add =
        |source, libraries: Vec<PathBuf>| places.extend(libraries.into_iter().map(|library| at(source, library)));
    add("SUMO_HOME", variable("SUMO_HOME").map(|home| in_home(&home)).unwrap_or_default());
    add("beside this program", beside_own_files());
    add("VIRTUAL_ENV", variable("VIRTUAL_ENV").map(|folder| in_environment(&folder)).unwrap_or_default());
    if let Some(folder) = variable("CONDA_PREFIX") {
        add("CONDA_PREFIX", [vec![folder.join("lib").join(LIBRARY)], in_environment(&folder)].concat());
    }
    places.push(Place { source: SYSTEM, library: LIBRARY.into(), is_there: None });
    places
}

/// Returns the file of a program of the SUMO that is loaded, such as `netconvert`. Where none lies beside the library, or without a
/// library, it is the first of that name on the `PATH`. `None` if there is none.
pub fn program(name: &str) -> Option<PathBuf> {
    let library = library::load().ok().map(|library| library.file.clone());
    // Debian's lies in a folder below `lib`.
    let folder = library
        .iter()
        .flat_map(|file| file.ancestors().skip(1).take(2))
        .find(|folder| LIBRARY_FOLDERS.iter().any(|name| folder.ends_with(name)));
    let beside = folder.and_then(Path::parent).map(|prefix| prefix.join("bin"));
    let path = env::var_os("PATH").unwrap_or_default();
    let mut folders = beside.into_iter().chain(env::split_paths(&path));
    folders.find_map(|folder| Some(folder.join(name)).filter(|file| file.is_file()))
}

/// Returns the first place that has the library, unless only the system can say.
pub(crate) fn taken(places: &[Place]) -> Option<&Place> {
    places.iter().find(|place| place.is_there == Some(true))
}

fn in_home(home: &Path) -> Vec<PathBuf> {
    LIBRARY_FOLDERS.map(|folder| home.join(folder).join(LIBRARY)).into()
}

/// Returns the library in the package `sumo` of each Python of an environment.
fn in_environment(folder: &Path) -> Vec<PathBuf> {
    let Ok(pythons) = fs::read_dir(folder.join("lib")) else { return Vec::new() };
    let pythons = pythons.flatten().map(|python| python.path());
    let packages = pythons.flat_map(|python| PACKAGES.map(|packages| python.join(packages)));
    let mut packages: Vec<PathBuf> = packages.filter(|path| path.is_dir()).collect();
    packages.sort();
    packages.iter().map(|packages| in_packages(packages)).collect()
}

/// Returns where the wheel `eclipse-sumo` puts the library, in a folder of packages.
fn in_packages(folder: &Path) -> PathBuf {
    folder.join("sumo").join("lib64").join(LIBRARY)
}

/// Looks from where pip puts files. A library that Python loads lies in a package beside the package `sumo`. A program lies in the
/// folder `bin` of an environment.
fn beside_own_files() -> Vec<PathBuf> {
    // SAFETY: the text ends in zero and lives as long as this code.
    let own = unsafe { CStr::from_ptr(ffi::ds_own_file()) }.to_string_lossy();
    let own = Path::new(own.as_ref()).canonicalize().ok();
    let package = own.as_deref().and_then(Path::parent).filter(|folder| folder.join(PACKAGE).is_file());
    if let Some(packages) = package.and_then(Path::parent) {
        // The program is then Python, perhaps that of another environment.
        return vec![in_packages(packages)];
    }
    let program = env::current_exe().ok();
    let environment = program.as_deref().and_then(Path::parent).filter(|folder| folder.ends_with("bin"));
    environment.and_then(Path::parent).map(in_environment).unwrap_or_default()
}

/// Returns the absolute path that a variable holds: workers run in other folders. An empty variable counts as unset.
fn variable(name: &str) -> Option<PathBuf> {
    let path = env::var_os(name).filter(|value| !value.is_empty())?;
    Some(path::absolute(&path).unwrap_or(path.into()))
}
