//! The local net of a light of a scenario, and the files with which plain SUMO shows it.

use std::collections::BTreeSet;
use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};
use rayon::prelude::*;

use super::beyond::Reach;
use super::extract::Source;
use super::local_net::LocalNet;
use super::sample_demand::{END_S, demand, types};
use crate::agents::derive::region::{Region, lit_junctions};
use crate::agents::derive::{Agent, Derived};
use crate::network::files::{NetworkFiles, sumocfg};
use crate::network::roads::Roads;
use crate::network::xml::text;
use crate::scenario::SumoScenario;
use dials_core::outside::{did_you_mean, excerpt, quoted, write_together};

const NAME: &str = "cut";
const TYPES: &str = "cut.types.add.xml";

/// Cuts out the region of a light. `approach_m`: how far before its stop lines the region reaches.
pub fn cut_light(scenario: &SumoScenario, light: &str, approach_m: f64, reach: Reach) -> Result<LocalNet> {
    let roads = scenario.roads()?;
    let known: BTreeSet<&str> = roads.programs.iter().map(|program| program.light.as_str()).collect();
    if !known.contains(light) {
        let near = did_you_mean(light, known);
        let list = format!("dials-traffic nets inspect {}", quoted(scenario.path()));
        bail!("{}: has no light `{}`{near}; list all with: {list}", scenario.net_path().display(), excerpt(light));
    }
    let source = source(scenario, &roads);
    let region = Region::of(&roads, &lit_junctions(&roads), light, approach_m, None)?;
    LocalNet::cut(&source, light, &region, reach)
        .map_err(|error| anyhow!("{}: {error:#}", scenario.net_path().display()))
}

fn source<'a>(scenario: &'a SumoScenario, roads: &'a Roads) -> Source<'a> {
    let programs = scenario.additional().flat_map(|root| root.all("tlLogic")).collect();
    Source::new(scenario.net(), roads, programs)
}

/// Cuts out the regions of all agents, in their order. An error names all lights that cannot be cut out.
pub(crate) fn cut_all(scenario: &SumoScenario, derived: &Derived) -> Result<Vec<LocalNet>> {
    let roads = scenario.roads()?;
    let source = source(scenario, &roads);
    let cut = |Agent { plan, region, .. }: &Agent| LocalNet::cut(&source, &plan.light, region, Reach::default());
    let cuts: Vec<Result<LocalNet>> = derived.agents.par_iter().map(cut).collect();
    let (mut nets, mut refused) = (Vec::new(), Vec::new());
    for cut in cuts {
        match cut {
            Ok(net) => nets.push(net),
            Err(error) => refused.push(format!("{error:#}")),
        }
    }
    ensure!(
        refused.is_empty(),
        "{}: {} of {} lights cannot have a local simulator:\n  {}\n  train on the whole network (--simulator gs), or let \
         these lights keep their programs (`keep` in the file that traffic.agents names)",
        scenario.net_path().display(),
        refused.len(),
        derived.agents.len(),
        refused.join("\n  ")
    );
    Ok(nets)
}

pub(crate) fn types_of(scenario: &SumoScenario) -> String {
    types(&scenario.types())
}

/// Writes the files of a local net, a small demand and a configuration into `dir`, with the scenario's options.
pub fn write(net: &LocalNet, scenario: &SumoScenario, dir: &Path) -> Result<NetworkFiles> {
    let files = NetworkFiles::of(&dir.join(NAME));
    files.check_paths()?;
    let kinds = scenario.types();
    let (net_file, routes) = (format!("{NAME}.net.xml"), format!("{NAME}.rou.xml"));
    let input = [("net-file", &*net_file), ("additional-files", TYPES), ("route-files", &*routes)];
    let options: Vec<(&str, &str)> = scenario.options().iter().map(|(name, value)| (&**name, &**value)).collect();
    let contents = [
        (files.net.clone(), text(net.root())),
        (dir.join(TYPES), types(&kinds)),
        (files.routes.clone(), demand(net, &kinds)?),
        (files.config.clone(), sumocfg(&input, END_S, &options)),
    ];
    write_together(dir, &contents.map(|(path, text)| (path, text.into_bytes())))?;
    Ok(files)
}
