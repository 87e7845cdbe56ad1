//! `check`: how far the local simulator (LS) of each light is like the global one (GS).
//!
//! `table`: for people. The JSON for programs is here.

mod table;

use std::collections::BTreeSet;
use std::ops::Range;

use anyhow::{Result, anyhow, bail, ensure};
use serde_json::{Value, json};

use crate::cli::CheckArgs;
use dials_core::base::{AgentId, Seed};
use dials_core::domain::Domain;
use dials_core::outside::{did_you_mean, excerpt, folder_of, quoted};
use dials_session::config::{RunConfig, load};
use dials_session::error::{Error, Result as CommandResult};
use dials_session::records::files::CONFIG;
use dials_session::terminal::counting::EpisodeBar;
use dials_session::terminal::{answer, json as in_json};
use dials_session::{directory, domains};
use dials_traffic::Traffic;
use dials_traffic::fidelity::agreement::Comparison;
use dials_traffic::fidelity::doubts::doubt;
use dials_traffic::fidelity::truth::Truth;
use dials_traffic::fidelity::{Causes, Fidelity, LightFidelity};

/// Second from which cells are compared, and for how long, if the episode is long enough.
const BEGIN_S: usize = 600;
const SECONDS: usize = 1200;

/// What was measured.
struct Checked {
    /// Seconds of the episode that were compared.
    window: Range<usize>,
    sigma: Option<f64>,
    seed: u64,
    lights: Vec<LightFidelity>,
    /// All lights together.
    all: LightFidelity,
    /// Whether these are lights of a grid, whose LS leaves out cars without room.
    on_grid: bool,
}

pub(super) fn check(args: &CheckArgs) -> CommandResult<()> {
    let config = load(&args.config, &[]).map_err(Error::Usage)?;
    if args.config.ends_with(CONFIG) {
        // It may be the config of a run. --sigma does not count as a change.
        directory::open_unchanged(folder_of(&args.config), domains::find).map_err(Error::Usage)?;
    }
    let traffic = opened(&config, args).map_err(Error::Usage)?;
    let agents = agents(&traffic, args).map_err(Error::Usage)?;
    let window = window(traffic.seconds(), args).map_err(Error::Usage)?;
    domains::note_left_out(&traffic);
    let lights = measured(&traffic, &agents, &window, Seed::new(args.seed)).map_err(Error::Run)?;
    let on_grid = traffic.grid().is_some();
    let all = together(&lights);
    let checked = Checked { window, sigma: args.sigma, seed: args.seed, lights, all, on_grid };
    let message = if args.json { in_json(as_json(&checked)) } else { table::described(&checked) };
    answer(message).map_err(Error::Run)
}

fn opened(config: &RunConfig, args: &CheckArgs) -> Result<Traffic> {
    domains::check(config)?;
    let traffic = match args.sigma {
        None => domains::traffic(config)?,
        Some(sigma) => domains::dawdling(config, sigma)?,
    };
    traffic.ok_or_else(|| anyhow!("{}: only traffic has lights to check", args.config.display()))
}

/// Returns the agents of the lights that were asked for.
fn agents(traffic: &Traffic, args: &CheckArgs) -> Result<Vec<AgentId>> {
    let lights = || traffic.plans().iter().map(|plan| plan.light.as_str());
    if args.lights.is_empty() {
        return Ok(AgentId::all(traffic.agents()));
    }
    let agent = |light: &String| {
        if let Some(agent) = lights().position(|other| other == light) {
            return Ok(AgentId(agent));
        }
        let near = did_you_mean(light, lights());
        let list = format!("dials-traffic check {}", quoted(&args.config));
        bail!("--light: no light `{}` learns here{near}; without the option all are measured: {list}", excerpt(light))
    };
    let mut agents = args.lights.iter().map(agent).collect::<Result<Vec<AgentId>>>()?;
    // A light counts once, however often it was named.
    let mut seen = BTreeSet::new();
    agents.retain(|agent| seen.insert(*agent));
    Ok(agents)
}

/// Returns the seconds of the episode that are compared.
fn window(episode_s: usize, args: &CheckArgs) -> Result<Range<usize>> {
    let begin = args.begin.unwrap_or(BEGIN_S.min(episode_s / 3));
    ensure!(begin < episode_s, "--begin {begin}: an episode has {episode_s} s; begin earlier");
    let left = episode_s - begin;
    let seconds = args.seconds.unwrap_or(SECONDS.min(left));
    ensure!(
        seconds <= left,
        "--seconds {seconds}: from second {begin} on an episode has {left} s; ask for fewer or set --begin"
    );
    Ok(begin..begin + seconds)
}

fn measured(traffic: &Traffic, agents: &[AgentId], window: &Range<usize>, seed: Seed) -> Result<Vec<LightFidelity>> {
    let bar = EpisodeBar::of(agents.len(), "lights");
    bar.set_message("the global simulator plays");
    let truth = Truth::play(traffic, window.end, seed)?;
    let fidelity = Fidelity::new(traffic, &truth, window.clone())?;
    let mut lights = Vec::new();
    for &agent in agents {
        bar.set_message(&traffic.plans()[agent.0].light);
        lights.push(fidelity.measure(agent)?);
        bar.set(lights.len());
    }
    bar.finish();
    Ok(lights)
}

/// Returns the comparison of all lights together.
fn together(lights: &[LightFidelity]) -> LightFidelity {
    let sum = |one: &dyn Fn(&LightFidelity) -> Comparison| {
        let mut sum = Comparison::default();
        lights.iter().for_each(|light| sum += one(light));
        sum
    };
    let is_random = lights.iter().any(|light| light.other_seed.is_some());
    LightFidelity {
        agent: AgentId(0),
        light: "all".to_owned(),
        true_entries: sum(&|light| light.true_entries),
        sampled_entries: sum(&|light| light.sampled_entries),
        other_seed: is_random.then(|| sum(&|light| light.other_seed.unwrap_or_default())),
        causes: Causes::default(),
    }
}

/// Returns the whole object. Precision and recall compare the local simulator with the global one; in `other_seed`, two
/// local simulators.
fn as_json(checked: &Checked) -> Value {
    let Checked { window, sigma, seed, lights, all, .. } = checked;
    let each = lights.iter().map(|light| {
        json!({
            "id": light.light,
            "true_entries": entries(light.true_entries),
            "sampled_entries": entries(light.sampled_entries),
            "other_seed": light.other_seed.map(cells),
            "spillback": light.causes.spillback,
            "short_entries": light.causes.short_entries,
            "doubt": doubt(light),
        })
    });
    json!({
        "begin": window.start,
        "seconds": window.len(),
        "sigma": sigma,
        "seed": seed,
        "lights": each.collect::<Vec<_>>(),
        "all": {
            "true_entries": entries(all.true_entries),
            "sampled_entries": entries(all.sampled_entries),
            "other_seed": all.other_seed.map(cells),
        },
    })
}

fn cells(comparison: Comparison) -> Value {
    let cells = comparison.cells;
    json!({
        "precision": cells.precision(),
        "recall": cells.recall(),
        "occupancy_ratio": cells.occupancy_ratio(),
    })
}

fn entries(comparison: Comparison) -> Value {
    let mut value = cells(comparison);
    let [gs, ls] = comparison.sums;
    let object = value.as_object_mut().expect("made as an object");
    object.insert("mean_speed_mps".into(), json!({ "gs": gs.mean_speed_mps(), "ls": ls.mean_speed_mps() }));
    object.insert("passed_per_h".into(), json!({ "gs": gs.passed_per_h(), "ls": ls.passed_per_h() }));
    object.insert("backlog".into(), json!(ls.backlog()));
    object.insert("waited_share".into(), json!(ls.waited_share()));
    object.insert("dropped_share".into(), json!(ls.dropped_share()));
    object.insert("lost".into(), json!(ls.lost));
    value
}
