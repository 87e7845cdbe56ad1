//! A *network* is four files with one name, such as `grid_2x2.net.xml`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};

use super::way_out::no_such_network;
use super::xml::{document, section};
use dials_core::outside::Printable;

#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkFiles {
    /// File of the roads and of the lights with their static program.
    pub net: PathBuf,
    /// File of the vehicle type and the routes, and of the flows of a grid.
    pub routes: PathBuf,
    pub actuated: PathBuf,
    /// Configuration with net and routes, for `sumo -c` and `sumo-gui -c`.
    pub config: PathBuf,
}

impl NetworkFiles {
    /// Returns the network of a directory and a name, such as `../sumo_nets/grid_2x2`. The files need not exist.
    pub fn of(prefix: &Path) -> NetworkFiles {
        NetworkFiles {
            net: with_ending(prefix, ".net.xml"),
            routes: with_ending(prefix, ".rou.xml"),
            actuated: with_ending(prefix, ".actuated.add.xml"),
            config: with_ending(prefix, ".sumocfg"),
        }
    }

    /// Returns an error with advice if one of the files is missing or SUMO could not take its path.
    pub fn check(&self) -> Result<()> {
        self.check_paths()?;
        match self.all().into_iter().find(|path| !path.is_file()) {
            Some(missing) => bail!(no_such_network(missing)),
            None => Ok(()),
        }
    }

    /// Returns an error if SUMO could not take the path of one of the files. The files need not exist.
    pub(crate) fn check_paths(&self) -> Result<()> {
        self.all().into_iter().try_for_each(|path| for_sumo(path).map(drop))
    }

    /// Returns an error if SUMO could not open the configuration, or would not find the files that it names.
    pub fn check_config_path(&self) -> Result<()> {
        self.check_paths()?;
        let path = for_sumo(&self.config)?;
        // SUMO decodes `%41` to `A` in a path that it puts together from that of a configuration.
        let is_decoded = |(at, _)| {
            let digits = path.as_bytes().get(at + 1..at + 3);
            digits.is_some_and(|digits| digits.iter().all(u8::is_ascii_hexdigit))
        };
        ensure!(
            !path.match_indices('%').any(is_decoded),
            "{}: contains a % and two digits, which SUMO takes for one letter; rename it",
            Printable(&path)
        );
        Ok(())
    }

    fn all(&self) -> [&Path; 4] {
        [&self.net, &self.routes, &self.actuated, &self.config]
    }
}

/// Returns a path with text added at its end. `with_extension` would take a dot in the name for an extension.
fn with_ending(prefix: &Path, ending: &str) -> PathBuf {
    let mut path = OsString::from(prefix);
    path.push(ending);
    PathBuf::from(path)
}

/// Returns a path as SUMO takes it among its options: as text that names one file only.
pub(crate) fn for_sumo(path: &Path) -> Result<String> {
    let place = path.display();
    let text =
        path.to_str().with_context(|| format!("{place}: is not UTF-8, which SUMO's options must be; rename it"))?;
    ensure!(!text.contains(','), "{place}: contains a comma, at which SUMO would split it; rename it");
    ensure!(!text.contains("${"), "{place}: contains `${{`, which SUMO takes for a variable; rename it");
    Ok(text.to_owned())
}

/// Returns the configuration for `sumo -c` of a network of this name in the same directory.
pub(crate) fn config(name: &str) -> String {
    let (net, routes) = (format!("{name}.net.xml"), format!("{name}.rou.xml"));
    // A waiting car is never moved past the jam (the authors' setup).
    sumocfg(&[("net-file", &net), ("route-files", &routes)], "3600", &[("time-to-teleport", "-1")])
}

pub(crate) fn sumocfg(files: &[(&str, &str)], end_s: &str, options: &[(&str, &str)]) -> String {
    document("configuration", |xml| {
        section(xml, "input", files)?;
        section(xml, "time", &[("begin", "0"), ("end", end_s), ("step-length", "1")])?;
        section(xml, "processing", options)?;
        // Without it, SUMO warns of a missing SUMO_HOME, where it would look for the schemas.
        section(xml, "report", &[("xml-validation", "never")])
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_sumo_would_read_as_another_one_is_refused() {
        let checked = |prefix: &str| NetworkFiles::of(Path::new(prefix)).check_config_path();
        for (prefix, what) in [("a,b/net", "a comma"), ("${HOME}/net", "a variable"), ("a%4Fb/net", "one letter")] {
            let error = checked(prefix).unwrap_err().to_string();
            assert!(error.starts_with(prefix) && error.contains(what), "{error}");
        }
        for prefix in ["50 %/net", "5%/net", "a$b/{c}/net", "ü;&'/net"] {
            checked(prefix).unwrap();
        }
    }

    #[test]
    fn a_dot_in_the_name_of_a_network_stays() {
        assert_eq!(NetworkFiles::of(Path::new("../v1.2/net")).config, Path::new("../v1.2/net.sumocfg"));
        assert_eq!(NetworkFiles::of(Path::new("net.a")).net, Path::new("net.a.net.xml"));
    }
}
