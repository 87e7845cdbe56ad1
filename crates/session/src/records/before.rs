//! What older runs simulated: their `run.json` has no `scenario`.
//!
//! Versions that did not write it had two domains, and only this file still knows their configs by key. From the text
//! of a config, and from the network files that it names, it works out what these runs would have written.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use toml::{Table, Value};

use crate::config::RunConfig;
use dials_core::domain::{FirstRow, Map, Scenario};
use dials_core::outside::{LARGEST_NETWORK, read_bytes, read_text};

/// Most agents on a side of a warehouse, and most rows or columns of a grid.
const LONGEST_SIDE: usize = 1000;

/// Works out the scenario of a run. `agents`: their number, if an evaluation shows it. If nothing shows it: `None`.
pub fn scenario(config: &RunConfig, agents: Option<usize>) -> Result<Option<Scenario>> {
    let domain = config.domain.as_ref().context("it has no domain, and its run.json no scenario")?;
    let config = Table::try_from(config)?;
    let table = config[domain.name()].as_table().context("a domain has a table")?;
    let side = table.get("agents_per_side").and_then(Value::as_integer);
    let side = side.map(|side| usize::try_from(side).ok().filter(|side| (1..=LONGEST_SIDE).contains(side)));
    let side = side.map(|side| side.context("agents_per_side: must be a number from 1 to 1000")).transpose()?;
    let Some(agents) = agents.or(side.map(|side| side * side)) else { return Ok(None) };
    let mut scenario = Scenario::new(domain.name(), agents, domain.table().horizon());
    if let Some(side) = side {
        scenario = scenario.with_map(Map { rows: side, columns: side, first_row: FirstRow::Top });
    }
    if let Some(network) = table.get("network").and_then(Value::as_str) {
        scenario = scenario.with_map(map_of(network, agents));
        if let Some(checksum) = checksum(network)? {
            scenario = scenario.with_checksum(checksum);
        }
    }
    let key = "local_network";
    if let Some(network) = table.get(key).and_then(Value::as_str) {
        // A file that cannot be read gives no checksum.
        let checksum = checksum(network).ok().flatten();
        scenario = scenario.with_files(checksum.map(|checksum| (domain.key(key), checksum)));
    }
    Ok(Some(scenario))
}

/// Computes the checksum of a network if its files are there: the net and its routes. A run keeps them byte by byte.
fn checksum(network: &str) -> Result<Option<u32>> {
    let files = [".net.xml", ".rou.xml"].map(|ending| PathBuf::from(format!("{network}{ending}")));
    if !files.iter().all(|file| file.is_file()) {
        return Ok(None);
    }
    let mut hasher = crc32fast::Hasher::new();
    for file in &files {
        hasher
            .update(&read_bytes(file, LARGEST_NETWORK).with_context(|| format!("{}: cannot be read", file.display()))?);
    }
    Ok(Some(hasher.finalize()))
}

/// Returns a grid of intersections: the grid of its net, or else a square if the number allows it, or a row. Row 0 is
/// in the south.
fn map_of(network: &str, agents: usize) -> Map {
    let side = agents.isqrt();
    let square = if side * side == agents { (side, side) } else { (1, agents) };
    let named = shape_of(Path::new(&format!("{network}.net.xml"))).filter(|(rows, columns)| rows * columns == agents);
    let (rows, columns) = named.unwrap_or(square);
    Map { rows, columns, first_row: FirstRow::Bottom }
}

/// Returns the rows and columns of a net whose intersections are called `r0c0`, `r0c1`, ...
fn shape_of(net: &Path) -> Option<(usize, usize)> {
    let text = read_text(net, LARGEST_NETWORK).ok()?;
    let junctions = text.split("<junction id=\"r").skip(1).filter_map(|rest| {
        let (row, column) = rest.split('"').next()?.split_once('c')?;
        let place = |text: &str| text.parse::<usize>().ok().filter(|&place| place < LONGEST_SIDE);
        Some((place(row)?, place(column)?))
    });
    let (row, column) = junctions.reduce(|(rows, columns), (row, column)| (rows.max(row), columns.max(column)))?;
    Some((row + 1, column + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_core::domain::Domain;
    use dials_traffic::Traffic;
    use dials_traffic::config::TrafficTable;
    use dials_warehouse::Warehouse;

    fn nets(name: &str) -> String {
        format!("{}/../../sumo_nets/{name}", env!("CARGO_MANIFEST_DIR"))
    }

    fn config(text: &str) -> RunConfig {
        toml::from_str(text).unwrap()
    }

    /// Returns a scenario as it was before runs recorded their rules.
    fn without_rules(scenario: Scenario) -> Scenario {
        Scenario { rules: None, ..scenario }
    }

    #[test]
    fn an_older_run_has_the_scenario_that_the_domain_would_write_today() {
        let traffic = dials_traffic::config::TrafficConfig {
            horizon: 50,
            ..dials_traffic::config::TrafficConfig::new(nets("grid_2x2"), nets("local"))
        };
        let domain = Traffic::open(&traffic).unwrap();
        let older = RunConfig {
            domain: Some(crate::domains::DomainConfig::Traffic(TrafficTable::Grid(traffic))),
            ..RunConfig::default()
        };
        assert_eq!(scenario(&older, Some(4)).unwrap().unwrap(), without_rules(domain.scenario().unwrap()));
        assert_eq!(
            scenario(&older, None).unwrap(),
            None,
            "it was never evaluated, so the number of its agents is unknown"
        );

        let warehouse = dials_warehouse::config::WarehouseConfig { agents_per_side: 3, horizon: 50 };
        let domain = Warehouse::new(&warehouse);
        let older =
            RunConfig { domain: Some(crate::domains::DomainConfig::Warehouse(warehouse)), ..RunConfig::default() };
        assert_eq!(scenario(&older, None).unwrap().unwrap(), without_rules(domain.scenario().unwrap()));
    }

    #[test]
    fn a_network_that_nobody_kept_has_no_checksum() {
        let lost = config("[traffic]\nnetwork = 'nowhere/global'\nlocal_network = 'nowhere/local'");
        let found = scenario(&lost, Some(6)).unwrap().unwrap();
        assert_eq!((found.id.checksum, found.files.len()), (None, 0));
        assert_eq!(found.map, Some(Map { rows: 1, columns: 6, first_row: FirstRow::Bottom }));
    }

    #[test]
    fn a_run_of_which_nothing_is_known_is_an_error() {
        let error = scenario(&RunConfig::default(), Some(4)).unwrap_err().to_string();
        assert!(error.contains("no domain"), "{error}");
    }
}
