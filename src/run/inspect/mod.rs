//! `nets inspect`: what becomes of the lights of a network, before anything is simulated.

mod text;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow, ensure};
use serde_json::{Value, json};

use super::nets::scenario_with;
use crate::cli::InspectArgs;
use dials_core::base::for_terminal;
use dials_core::domain::road_trace::Line;
use dials_core::outside::{did_you_mean, excerpt, read_text};
use dials_report::drawing::Svg;
use dials_report::plot::{MapRegion, RegionsMap, regions_map};
use dials_session::error::{Error, Result as CommandResult};
use dials_session::outputs;
use dials_session::places::{self, Existing};
use dials_session::terminal::{self, answer, note, program};
use dials_traffic::agents::derive::border::Seconds;
use dials_traffic::agents::derive::overrides::Overrides;
use dials_traffic::agents::derive::padding::{InfluencePadding, Padding};
use dials_traffic::agents::derive::warnings::{never_walked, too_short_for_people, walk_s, warnings};
use dials_traffic::agents::derive::{Agent, Derived, Rules, derive};
use dials_traffic::agents::phase_plan::{Interval, PhasePlan};
use dials_traffic::agents::plan::Border;
use dials_traffic::agents::region::spec;
use dials_traffic::agents::region_plan::RegionPlan;
use dials_traffic::config::sumocfg::{Notes, Sumocfg};
use dials_traffic::config::{ScenarioConfig, TrafficConfig};
use dials_traffic::network::files::NetworkFiles;
use dials_traffic::network::roads::{EdgeNo, LaneNo, Roads};
use dials_traffic::paper_grid::recognise::recognise_grid;
use dials_traffic::scenario::SumoScenario;

const MOST_OVERRIDES: u64 = 1 << 20;

struct Inspected {
    net: PathBuf,
    roads: Roads,
    derived: Derived,
    padding: Padding,
    /// Borders of the agents' regions, in their order.
    borders: Vec<Border>,
    influence: InfluencePadding,
    rules: Rules,
    notes: Notes,
    /// Number of columns that agents see on this net if it is taken as a grid of the paper. `None`: it is none.
    columns_of_grid: Option<usize>,
}

pub(super) fn inspect(args: &InspectArgs) -> CommandResult<()> {
    let existing = Existing::of_named(args.force);
    let inspected = Inspected::of(args, existing).map_err(Error::Usage)?;
    let text = inspected.text(args).map_err(Error::Usage)?;
    if let Some(columns) = inspected.columns_of_grid {
        note(for_terminal(&format!(
            "note: this is one of the paper's grids, here described as a scenario of your own; a config of the grid \
             (traffic.network) gives its agents {columns} columns, see: {} describe CONFIG",
            program()
        )));
    }
    let plot = args.plot.as_deref();
    answer(text).and_then(|()| plot.map_or(Ok(()), |dir| draw(&inspected, dir, existing))).map_err(Error::Run)
}

impl Inspected {
    fn of(args: &InspectArgs, existing: Existing) -> Result<Inspected> {
        let path = &args.file;
        args.plot.as_deref().map_or(Ok(()), |dir| outputs::check_free(dir, "--plot", existing))?;
        ensure!(
            path.extension().is_none_or(|extension| extension != "toml"),
            "{}: is a config of this program; inspect the .sumocfg or the net that it names",
            path.display()
        );
        let Subject { net, roads, departs_on, seconds, rules, notes } = Subject::of(path, &args.settings.all())?;
        let overrides = args.agents.as_deref().map_or(Ok(Overrides::default()), read_overrides)?;
        let derived = derive(&roads, &rules, &overrides).map_err(|error| anyhow!("{}: {error:#}", net.display()));
        let derived = match &args.agents {
            Some(file) => derived.with_context(|| format!("{}: does not go with this network", file.display()))?,
            None => derived?,
        };
        let padding = Padding::of(derived.agents.iter().map(|agent| &agent.plan));
        let borders = derived.borders(&roads, &departs_on, rules.approach_m, seconds);
        let influence = InfluencePadding::of(borders.iter());
        let columns_of_grid = columns_of_grid(&net);
        Ok(Inspected { net, roads, derived, padding, borders, influence, rules, notes, columns_of_grid })
    }

    /// Returns a sentence for each thing that is odd about the programs.
    fn warnings(&self) -> Vec<String> {
        let mut found = warnings(&self.roads);
        found.extend(too_short_for_people(&self.derived.agents));
        found.extend(never_walked(&self.derived.agents));
        found
    }

    fn text(&self, args: &InspectArgs) -> Result<String> {
        if args.json {
            let text = serde_json::to_string_pretty(&as_json(self)).expect("JSON has any text");
            return Ok(terminal::json(text));
        }
        match &args.light {
            Some(light) => text::one(self, light).with_context(|| no_light(self, light)),
            None if args.all => Ok(text::all(self)),
            None => Ok(text::overview(self)),
        }
    }
}

/// What a file describes: a net, and the scenario around it.
struct Subject {
    net: PathBuf,
    roads: Roads,
    departs_on: BTreeSet<EdgeNo>,
    seconds: Seconds,
    rules: Rules,
    notes: Notes,
}

impl Subject {
    /// Reads a scenario or a net. A scenario that cannot be played has a net all the same: then a note says why.
    fn of(path: &Path, settings: &[String]) -> Result<Subject> {
        if !Sumocfg::is_one(path) {
            return Subject::of_net(path.to_owned(), Notes::default());
        }
        let scenario = scenario_with(path, settings).and_then(|config| Ok((SumoScenario::read(&config)?, config)));
        let (scenario, config) = match scenario {
            Ok(found) => found,
            Err(error) if !settings.is_empty() => return Err(error),
            Err(error) => {
                let net = Sumocfg::read(path)?.net;
                let left_out = vec![format!("the whole scenario, but for its net: {error:#}")];
                return Subject::of_net(net, Notes { left_out, ..Notes::default() });
            }
        };
        let roads = scenario.roads()?;
        let departs_on = scenario.departs_on(&roads);
        let (net, notes) = (scenario.net_path().to_owned(), scenario.notes().clone());
        Ok(Subject { net, roads, departs_on, seconds: Seconds::of(&config), rules: Rules::of(&config), notes })
    }

    /// Nobody departs on a net alone, and an episode would be an hour of decisions of the usual length.
    fn of_net(net: PathBuf, notes: Notes) -> Result<Subject> {
        let decision = ScenarioConfig::new(&net).decision_s as usize;
        let (roads, departs_on) = (Roads::of_file(&net)?, BTreeSet::new());
        let seconds = Seconds { decision, episode: 3600 };
        Ok(Subject { net, roads, departs_on, seconds, rules: Rules::default(), notes })
    }
}

fn no_light(Inspected { net, derived, .. }: &Inspected, light: &str) -> String {
    let learning = derived.agents.iter().map(|agent| &*agent.plan.light);
    let near = did_you_mean(light, learning.chain(derived.keeping.iter().map(|kept| &*kept.light)));
    format!(
        "{}: --light: no light `{}` is here{near}; without the option all are listed",
        net.display(),
        excerpt(light)
    )
}

/// Returns the number of columns that an agent of a grid sees, if this net is that of a grid with all its files.
fn columns_of_grid(net: &Path) -> Option<usize> {
    let name = net.file_name()?.to_str()?.strip_suffix(".net.xml")?;
    recognise_grid(&NetworkFiles::of(&net.with_file_name(name))).ok()?;
    Some(spec(&TrafficConfig::new("", "")).obs_dim)
}

fn read_overrides(path: &Path) -> Result<Overrides> {
    let text = read_text(path, MOST_OVERRIDES).with_context(|| format!("{}: could not be read", path.display()))?;
    Overrides::parse(&text).map_err(|error| anyhow!("{}: {error:#}", path.display()))
}

fn draw(inspected: &Inspected, dir: &Path, existing: Existing) -> Result<()> {
    const NAME: &str = "regions.svg";
    let svg = map(inspected)?;
    places::make(dir, existing, |staged| staged.put(NAME, svg.file().as_bytes()))?;
    note(format_args!("drew {NAME} into {}", dir.display()));
    Ok(())
}

fn map(inspected: &Inspected) -> Result<Svg> {
    let Inspected { net, roads, derived, .. } = inspected;
    let line = |lane: LaneNo| -> Line { roads.lane(lane).shape.clone() };
    let regions = derived.agents.iter().map(|agent| {
        let edges = agent.region.edges(roads);
        let within = |lane: &LaneNo| edges.contains(&roads.lane(*lane).edge);
        MapRegion {
            name: called(roads, &agent.plan.light),
            place_m: agent.plan.place_m,
            approaches: agent.region.ahead_m.keys().map(|&lane| line(lane)).collect(),
            lanes: roads.lanes_of_cars().filter(within).map(line).collect(),
        }
    });
    let keeping = derived.keeping.iter().flat_map(|kept| roads.junctions_of(&kept.light));
    regions_map(&RegionsMap {
        subject: net.file_name().unwrap_or(net.as_os_str()).to_string_lossy().into_owned(),
        junctions: roads.outlines(),
        lanes: roads.lanes_of_cars().map(line).collect(),
        regions: regions.collect(),
        keeping: keeping.map(|junction| roads.junction(junction).place_m).collect(),
    })
}

/// Returns the id of a light, behind the names of its first streets if it has any.
fn called(roads: &Roads, light: &str) -> String {
    match roads.streets_to(light) {
        streets if streets.is_empty() => light.to_owned(),
        streets => format!("{} ({light})", streets.iter().take(2).copied().collect::<Vec<_>>().join(" / ")),
    }
}

/// Returns the whole object. Indices (`links` of an approach, `from`, `to`) count the other lists of the same light.
fn as_json(inspected: &Inspected) -> Value {
    let Inspected { net, derived, padding, rules, notes, .. } = inspected;
    let agents = derived.agents.iter().zip(&inspected.borders).map(|(agent, border)| light(inspected, agent, border));
    let keeping = derived
        .keeping
        .iter()
        .map(|kept| json!({ "light": kept.light, "why": kept.why.to_string(), "way_out": kept.why.way_out() }));
    json!({
        "net": net.display().to_string(),
        "approach_m": rules.approach_m,
        "yellow_s": rules.yellow,
        "min_green_s": rules.min_green_s,
        "walking": rules.walking.map(|walking| json!({ "speed_mps": walking.speed_mps, "walk_s": walking.walk_s })),
        "kind": { "columns": padding.columns, "actions": padding.actions, "padded_share": padding.padded },
        "influence": { "d_set_columns": inspected.influence.columns, "sources": inspected.influence.sources },
        "warnings": inspected.warnings(),
        "left_out": notes.left_out,
        "not_in_local_simulators": notes.without_locally,
        "no_local_simulators": notes.not_local,
        "learning": agents.collect::<Vec<_>>(),
        "keeping": keeping.collect::<Vec<_>>(),
    })
}

fn light(inspected: &Inspected, agent: &Agent, border: &Border) -> Value {
    let Agent { plan, region, .. } = agent;
    let roads = &inspected.roads;
    let ids = |junctions: &mut dyn Iterator<Item = _>| -> Vec<&str> {
        junctions.map(|&junction| roads.junction(junction).id.as_str()).collect()
    };
    let RegionPlan { approaches, exits, links } = &plan.region;
    json!({
        "light": plan.light,
        "place_m": plan.place_m,
        "junctions": ids(&mut region.own.iter()),
        "uncontrolled_junctions": ids(&mut region.passed.iter()),
        "greens": plan.phases.greens().iter().map(|green| green.as_str()).collect::<Vec<_>>(),
        "min_green_s": plan.phases.min_green_steps(),
        "min_green_because": agent.shortest.iter().map(|shortest| shortest.because.to_string()).collect::<Vec<_>>(),
        "max_green_s": plan.phases.max_green_steps(),
        "max_red_s": plan.phases.max_red_steps().map(|(letter, seconds)| json!({ "letter": letter, "seconds": seconds }))
            .collect::<Vec<_>>(),
        "crossings": agent.crossings.iter().map(|crossing| json!({
            "edge": crossing.edge,
            "letter": crossing.letter,
            "length_m": crossing.length_m,
            "needed_s": crossing.needed_s,
            "program_walk_s": walk_s(&agent.program, crossing),
            "greens": agent.greens_of(crossing),
        })).collect::<Vec<_>>(),
        "people": plan.others.crossings.iter().enumerate().map(|(number, crossing)| json!({
            "crossing": crossing.edge,
            "from": crossing.areas,
            "greens": plan.walked_in(number),
        })).collect::<Vec<_>>(),
        "changes": changes(&plan.phases),
        "approaches": approaches.iter().map(|approach| json!({
            "lane": approach.lane,
            "length_m": approach.length_m,
            "ahead_m": approach.ahead_m,
            "speed_limit_mps": approach.speed_limit_mps,
            "links": approach.links,
        })).collect::<Vec<_>>(),
        "exits": exits.iter().map(|exit| json!({
            "lane": exit.lane,
            "length_m": exit.length_m,
            "leaves_the_net": exit.leaves_the_net,
        })).collect::<Vec<_>>(),
        "links": links.iter().map(|link| json!({
            "letter": link.letter,
            "from": link.from,
            "to": link.to,
            "inside": link.inside,
            "crosses": link.crosses,
        })).collect::<Vec<_>>(),
        "columns": plan.columns(),
        "sources": border.plan.source_names(),
        "d_set_columns": border.d_set.columns(&border.plan),
    })
}

/// Returns after how many seconds of a green a light may leave it for each other one, and what is shown in between.
fn changes(phases: &PhasePlan) -> Vec<Value> {
    let greens = 0..phases.greens().len();
    let pairs = greens.clone().flat_map(|from| greens.clone().map(move |to| (from, to)));
    let pairs = pairs.filter(|(from, to)| from != to);
    let shown = |interval: &Interval| json!({ "state": interval.state.as_str(), "seconds": interval.steps });
    pairs
        .map(|(from, to)| {
            let states: Vec<Value> = phases.clearing(from, to).iter().map(shown).collect();
            json!({ "from": from, "to": to, "after_s": phases.least_before(from, to), "states": states })
        })
        .collect()
}
