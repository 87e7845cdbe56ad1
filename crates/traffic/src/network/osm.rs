//! Files of OpenStreetMap, which SUMO cannot simulate before netconvert has made a net of them.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use dials_core::outside::quoted;

/// Ends of the names of such files.
const ENDINGS: [&str; 3] = [".osm", ".osm.xml", ".osm.pbf"];
/// Number of bytes in which the root element begins.
const MOST_PROLOG: u64 = 4096;

/// Returns whether a file is of OpenStreetMap, by its name or its root element.
pub fn is_one(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy().to_lowercase();
    if ENDINGS.iter().any(|ending| name.ends_with(ending)) {
        return true;
    }
    // Opening a pipe would wait for a writer.
    if !path.is_file() {
        return false;
    }
    let mut begin = Vec::new();
    let read = File::open(path).and_then(|file| file.take(MOST_PROLOG).read_to_end(&mut begin));
    read.is_ok() && String::from_utf8_lossy(&begin).contains("<osm ")
}

/// Returns what such a file is, and the command that makes a net of it.
pub fn way_out(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let stem = ENDINGS.iter().rev().find_map(|ending| name.strip_suffix(ending)).unwrap_or("map");
    let net = path.with_file_name(format!("{stem}.net.xml"));
    format!(
        "is a map of OpenStreetMap; make a net of it with netconvert, then give it traffic (docs/street.md has all steps):\n  \
         netconvert --osm-files {} -o {} --geometry.remove --tls.guess-signals --tls.join \
         --output.street-names",
        quoted(path),
        quoted(&net)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_map_is_known_by_its_name_or_its_root_and_the_way_out_is_a_command() {
        let dir = tempfile::tempdir().unwrap();
        let file = |name: &str, text: &str| {
            std::fs::write(dir.path().join(name), text).unwrap();
            dir.path().join(name)
        };
        assert!(is_one(Path::new("a/city.osm.xml")) && is_one(Path::new("CITY.OSM")) && is_one(Path::new("b.osm.pbf")));
        assert!(is_one(&file("city.xml", "<?xml version='1.0'?>\n<osm version=\"0.6\"/>")));
        assert!(!is_one(&file("a.net.xml", "<net/>")) && !is_one(Path::new("none.xml")));
        let words = way_out(Path::new("a/city.osm.xml"));
        assert!(words.contains("netconvert --osm-files a/city.osm.xml -o a/city.net.xml "), "{words}");
    }
}
