//! SUMO's data, which the library does not need: `doctor` says where they are, or what does without them.

use std::env;
use std::path::{Path, PathBuf};

use dials_core::outside::quoted;
use dials_traffic::sumo_program;

/// A file of the data: types of the roads of OpenStreetMap.
const TYPES: &str = "data/typemap/osmNetconvert.typ.xml";
/// Where Debian has them.
const OF_DEBIAN: &str = "/usr/share/sumo";
/// What needs the data and `SUMO_HOME`.
const NEEDED: &str = "netconvert on maps of OpenStreetMap (types of roads), and SUMO's tools for traffic counts";

pub(super) enum Data {
    Found(String),
    Missing(String, String),
}

pub(super) fn data() -> Data {
    let variable = env::var_os("SUMO_HOME").filter(|home| !home.is_empty()).map(PathBuf::from);
    let program = sumo_program("netconvert");
    // In a Python package they lie beside the folder of the programs.
    let beside = program.iter().flat_map(|file| file.ancestors().skip(2).take(1)).map(Path::to_path_buf);
    judged(variable, beside.chain([PathBuf::from(OF_DEBIAN)]).collect())
}

/// `variable`: the folder that `SUMO_HOME` names. `others`: further folders.
fn judged(variable: Option<PathBuf>, others: Vec<PathBuf>) -> Data {
    let has_data = |home: &PathBuf| home.join(TYPES).is_file();
    if let Some(home) = variable.as_ref().filter(|home| has_data(home)) {
        return Data::Found(format!("SUMO's data at {}", home.display()));
    }
    let found = others.into_iter().find(has_data);
    match (variable, found) {
        (Some(home), found) => Data::Missing(
            format!("SUMO's data are not at SUMO_HOME, {}: needed for {NEEDED}", home.display()),
            cure(found.as_deref()),
        ),
        (None, Some(found)) => {
            Data::Found(format!("SUMO's data at {}; for {NEEDED}: {}", found.display(), cure(Some(&found))))
        }
        (None, None) => Data::Missing(format!("SUMO's data were not found: needed for {NEEDED}"), cure(None)),
    }
}

fn cure(found: Option<&Path>) -> String {
    match found {
        Some(home) => format!("export SUMO_HOME={}", quoted(home)),
        None => format!("pip install eclipse-sumo, or apt-get install sumo-tools and export SUMO_HOME={OF_DEBIAN}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn data_are_found_by_their_types_of_roads_and_a_wrong_variable_is_named() {
        let room = tempfile::tempdir().unwrap();
        let [good, empty] = ["good", "empty"].map(|name| room.path().join(name));
        std::fs::create_dir_all(good.join("data/typemap")).unwrap();
        std::fs::write(good.join(TYPES), "<types/>").unwrap();
        let found = |variable: Option<&PathBuf>, others: &[&PathBuf]| {
            judged(variable.cloned(), others.iter().map(|path| (*path).clone()).collect())
        };
        assert!(matches!(found(Some(&good), &[]), Data::Found(what) if !what.contains("export")));
        let export = format!("export SUMO_HOME={}", good.display());
        assert!(matches!(found(None, &[&empty, &good]), Data::Found(what) if what.ends_with(&export)));
        let wrong = found(Some(&empty), &[&good]);
        assert!(matches!(wrong, Data::Missing(what, cure) if what.contains("not at SUMO_HOME") && cure == export));
        assert!(matches!(found(None, &[&empty]), Data::Missing(_, cure) if cure.contains("sumo-tools")));
    }
}
