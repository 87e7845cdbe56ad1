//! Messages about a network that is missing or wrong, with the command that makes it.

use std::path::Path;

use dials_core::outside::quoted;

/// Which of its two networks a config names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    Global,
    Local,
}

/// Returns the message about a network with an error in it, with the command that makes it anew.
pub(crate) fn cannot_be_simulated(net: &Path, role: Role) -> String {
    let named_local = net.file_name().is_some_and(|name| name == "local.net.xml");
    let way_out = match role {
        Role::Local if !named_local => make_local(),
        _ => format!("remake it with: {} --force", command_for(net)),
    };
    format!("{}: this network cannot be simulated; {way_out}", net.display())
}

pub(crate) fn make_local() -> String {
    "make one with: dials-traffic nets local --out DIR".to_owned()
}

pub(crate) fn no_such_network(missing: &Path) -> String {
    let named = missing.to_str().and_then(|path| path.strip_suffix(".net.xml")).map(Path::new);
    if let Some(file) = named.filter(|path| path.is_file()) {
        let (place, ending) = (file.display(), file.extension().unwrap_or_default());
        if ending == "sumocfg" {
            let command = format!("dials-traffic train {}", quoted(file));
            return format!("{place}: is a scenario and no grid; use it in the place of a config, such as: {command}");
        }
        return match file.to_string_lossy().strip_suffix(".net.xml") {
            Some(name) => format!("{place}: name the network without its ending: {name}"),
            None => format!("{place}: is a file, and not the name of a network of `dials-traffic nets`"),
        };
    }
    let path = missing.display();
    let (folder, file) = (missing.parent(), missing.file_name().unwrap_or_default().to_string_lossy());
    if folder.is_some_and(|folder| folder.ends_with("networks")) && file.starts_with("global.") {
        return format!("{path}: this file of the run is missing; copy the run directory again, or train again");
    }
    format!("{path}: no such network; make it with: {}", command_for(missing))
}

pub(crate) fn command_for(path: &Path) -> String {
    let dir = path.parent().filter(|dir| !dir.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let file = path.file_name().unwrap_or_default().to_string_lossy();
    let name = file.split('.').next().unwrap_or_default();
    let which = match name.strip_prefix("grid_").and_then(|shape| shape.split_once('x')) {
        Some((rows, cols)) if [rows, cols].iter().all(|number| number.parse::<usize>().is_ok()) => {
            format!("grid --rows {rows} --cols {cols}")
        }
        _ if name == "local" => "local".to_owned(),
        _ => "grid --rows R --cols C".to_owned(),
    };
    format!("dials-traffic nets {which} --out {}", quoted(dir))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_network_comes_with_the_command_that_makes_it() {
        let way_out = "dials-traffic nets grid --rows 3 --cols 4 --out nowhere";
        let expected = format!("nowhere/grid_3x4.net.xml: no such network; make it with: {way_out}");
        assert_eq!(no_such_network(Path::new("nowhere/grid_3x4.net.xml")), expected);
        assert!(no_such_network(Path::new("local.rou.xml")).ends_with("dials-traffic nets local --out ."));
        assert!(no_such_network(Path::new("a/city.net.xml")).ends_with("nets grid --rows R --cols C --out a"));
        let of_run = no_such_network(Path::new("runs/a/networks/global.net.xml"));
        assert!(of_run.ends_with("copy the run directory again, or train again"), "{of_run}");
    }

    #[test]
    fn a_file_in_the_place_of_a_name_is_no_missing_network() {
        let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../sumo_nets");
        let message = |file: &str| no_such_network(&nets.join(format!("{file}.net.xml")));
        let grid = nets.join("grid_2x2").display().to_string();
        assert!(message("grid_2x2.net.xml").ends_with(&format!("name the network without its ending: {grid}")));
        let town = message("town/town.sumocfg");
        assert!(town.contains("is a scenario and no grid") && town.ends_with("town/town.sumocfg"), "{town}");
    }
}
