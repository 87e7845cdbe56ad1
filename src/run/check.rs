//! `check`: how far the local simulator (LS) of each light is like the global one (GS).

use std::collections::BTreeSet;
use std::ops::Range;

use anyhow::{Result, anyhow, bail, ensure};
use serde_json::{Value, json};

use crate::cli::CheckArgs;
use dials_core::base::{AgentId, Seed, for_terminal};
use dials_core::domain::Domain;
use dials_core::outside::{Printable, did_you_mean, excerpt, folder_of, quoted};
use dials_session::config::{RunConfig, load};
use dials_session::error::{Error, Result as CommandResult};
use dials_session::records::files::CONFIG;
use dials_session::terminal::counting::EpisodeBar;
use dials_session::terminal::{answer, json as in_json};
use dials_session::{directory, domains};
use dials_traffic::Traffic;
use dials_traffic::fidelity::agreement::Comparison;
use dials_traffic::fidelity::doubts::{LEAST_SAMPLED, LEAST_TRUE, doubt};
use dials_traffic::fidelity::truth::Truth;
use dials_traffic::fidelity::{Causes, Fidelity, LightFidelity};

/// Second from which cells are compared, and for how long, if the episode is long enough.
const BEGIN_S: usize = 600;
const SECONDS: usize = 1200;

struct Checked {
    /// Seconds of the episode that were compared.
    window: Range<usize>,
    sigma: Option<f64>,
    seed: u64,
    lights: Vec<LightFidelity>,
    all: LightFidelity,
    /// Whether these are lights of a grid, whose LS leaves out cars without room.
    on_grid: bool,
}

pub(super) fn check(args: &CheckArgs) -> CommandResult<()> {
    let config = load(&args.config, &args.settings.all()).map_err(Error::Usage)?;
    if args.config.ends_with(CONFIG) {
        // It may be the config of a run. --sigma does not count as a change.
        directory::open_unchanged(folder_of(&args.config), domains::find).map_err(Error::Usage)?;
    }
    let traffic = opened(&config, args).map_err(Error::Usage)?;
    let agents = agents(&traffic, args).map_err(Error::Usage)?;
    let window = window(traffic.seconds(), args).map_err(Error::Usage)?;
    domains::note_left_out(&traffic);
    domains::note_without_locally(&traffic);
    let lights = measured(&traffic, &agents, &window, Seed::new(args.seed)).map_err(Error::Run)?;
    let on_grid = traffic.grid().is_some();
    let all = together(&lights);
    let checked = Checked { window, sigma: args.sigma, seed: args.seed, lights, all, on_grid };
    let message = if args.json { in_json(as_json(&checked)) } else { as_table(&checked) };
    answer(message).map_err(Error::Run)
}

fn opened(config: &RunConfig, args: &CheckArgs) -> Result<Traffic> {
    let traffic = match args.sigma {
        None => domains::traffic(config)?,
        Some(sigma) => domains::dawdling(config, sigma)?,
    };
    let traffic = traffic.ok_or_else(|| anyhow!("{}: only traffic has lights to check", args.config.display()))?;
    domains::check(config, &traffic)?;
    Ok(traffic)
}

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

fn window(episode_s: usize, args: &CheckArgs) -> Result<Range<usize>> {
    let begin = args.from.unwrap_or(BEGIN_S.min(episode_s / 3));
    ensure!(begin < episode_s, "--from {begin}: an episode has {episode_s} s; begin earlier");
    let left = episode_s - begin;
    let seconds = args.seconds.unwrap_or(SECONDS.min(left));
    ensure!(
        seconds <= left,
        "--seconds {seconds}: from second {begin} on an episode has {left} s; ask for fewer or set --from"
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

/// Precision and recall compare the local simulator with the global one; in `other_seed`, two local simulators.
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
            "short_exits": light.causes.short_exits,
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

/// Largest number of lights that have a line each. Of more, the worst are shown.
const MOST_LINES: usize = 40;
const WORST: usize = 3;
const NAME: usize = 11;

fn as_table(checked: &Checked) -> String {
    let Checked { window, sigma, lights, all, on_grid, .. } = checked;
    let (on_grid, is_random) = (*on_grid, all.other_seed.is_some());
    let dawdling = sigma.map_or(String::new(), |sigma| format!(", sigma {sigma}"));
    let without_room = if on_grid { "left out" } else { "waiting" };
    let mut lines = vec![
        for_terminal(&format!(
            "local simulators (LS) beside the global one (GS): random greens, seconds {} to {} of the episode{dawdling}",
            window.start, window.end
        )),
        for_terminal(&format!(
            "precision and recall of the LS's cells of 10 m with cars, and its number of cells / the GS's; \
             {without_room}: cars without room at the border"
        )),
        String::new(),
    ];
    lines.extend(head(is_random, on_grid));
    let worst = worst(lights);
    let shown = if lights.len() > MOST_LINES { worst[..MOST_LINES].to_vec() } else { lights.iter().collect() };
    lines.extend(shown.iter().map(|light| line(light, on_grid)));
    if lights.len() > 1 {
        lines.push(line(all, on_grid));
        if shown.len() < lights.len() {
            let (shown, all) = (shown.len(), lights.len());
            lines.push(format!("\nthese are the {shown} least alike of {all} lights; --json has all"));
        }
        let names: Vec<String> = worst.iter().take(WORST).map(|light| Printable(&light.light).to_string()).collect();
        lines.push(for_terminal(&format!("\nleast alike with sampled entries: {}", names.join(", "))));
    }
    lines.push(String::new());
    let warnings: Vec<String> = lights.iter().filter_map(warning).collect();
    if warnings.is_empty() {
        lines.push(verdict(lights.len(), is_random));
    } else {
        lines.extend(warnings);
    }
    lines.join("\n")
}

/// Returns what follows if there is no doubt about any light. If cars dawdle at random, that is less.
fn verdict(lights: usize, is_random: bool) -> String {
    let these = if lights == 1 { "this local simulator".to_owned() } else { format!("all {lights} local simulators") };
    if !is_random {
        return format!("{these} can be trusted");
    }
    let [exact, sampled] = [LEAST_TRUE, LEAST_SAMPLED].map(|share| format!("{:.0} %", 100.0 * share));
    let is = if lights == 1 { "is" } else { "are" };
    let compared = format!(
        "{these} {is} nearly as like the GS as two LSs with other random numbers are to each other: at least {exact} of \
         that with true entries, {sampled} with sampled ones"
    );
    let limits = "random numbers hide smaller faults; --sigma 0 takes them out and says what can be trusted";
    [compared, limits.to_owned()].map(|line| for_terminal(&line)).join("\n")
}

fn warning(light: &LightFidelity) -> Option<String> {
    let (doubt, light) = (doubt(light)?, Printable(&light.light));
    Some(for_terminal(&format!("warning: light {light}: do not trust its LS: {doubt}")))
}

fn worst(lights: &[LightFidelity]) -> Vec<&LightFidelity> {
    let likeness = |light: &LightFidelity| {
        let cells = light.sampled_entries.cells;
        cells.precision().min(cells.recall())
    };
    let mut sorted: Vec<&LightFidelity> = lights.iter().collect();
    sorted.sort_by(|one, other| likeness(one).total_cmp(&likeness(other)));
    sorted
}

fn name(light: &str) -> String {
    let name = Printable(light).to_string();
    if name.chars().count() <= NAME {
        return name;
    }
    name.chars().take(NAME - 2).chain("..".chars()).collect()
}

fn head(is_random: bool, on_grid: bool) -> [String; 2] {
    let [group, column] = if is_random { ["   two", "   LSs"] } else { [""; 2] };
    let [without, room] = if on_grid { [" left", "  out"] } else { ["wait-", "  ing"] };
    [
        format!("{:NAME$}      true entries  sampled entries{group} speed m/s    passed/h {without}", ""),
        format!("{:NAME$}  prec. rec. cells prec. rec. cells{column}   GS   LS    GS    LS {room}", "light"),
    ]
}

fn line(light: &LightFidelity, on_grid: bool) -> String {
    let cells = |of: Comparison| {
        let cells = of.cells;
        format!("{:6.2} {:4.2} {:5.2}", cells.precision(), cells.recall(), cells.occupancy_ratio())
    };
    let agree = |of: Comparison| format!("  {:4.2}", (of.cells.precision() + of.cells.recall()) / 2.0);
    let [gs, ls] = light.sampled_entries.sums;
    let without_room = if on_grid { ls.dropped.to_string() } else { format!("{:.1}", ls.backlog()) };
    format!(
        "{:NAME$} {}{}{} {:4.1} {:4.1} {:5.0} {:5.0} {without_room:>5}",
        name(&light.light),
        cells(light.true_entries),
        cells(light.sampled_entries),
        light.other_seed.map_or(String::new(), agree),
        gs.mean_speed_mps(),
        ls.mean_speed_mps(),
        gs.passed_per_h(),
        ls.passed_per_h()
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_traffic::fidelity::agreement::{Agreement, Sums};

    fn shown(lights: usize, is_random: bool, dropped: u64) -> String {
        let sums = Sums { seconds: 600, passed: 3000, car_seconds: 600, speed_sum_mps: 8000.0, ..Sums::default() };
        let cells = Agreement { first: 100, second: 100, both: 90 };
        let alike = Comparison { cells, sums: [sums, Sums { dropped, ..sums }] };
        let light = LightFidelity {
            agent: AgentId(0),
            light: "cluster_1234567_891011".to_owned(),
            true_entries: alike,
            sampled_entries: alike,
            other_seed: is_random.then_some(alike),
            causes: Causes::default(),
        };
        let lights = vec![light; lights];
        let (all, on_grid) = (together(&lights), dropped > 0);
        as_table(&Checked { window: 600..1800, sigma: None, seed: 0, lights, all, on_grid })
    }

    #[test]
    fn many_lights_are_the_least_alike_and_on_a_grid_cars_without_room_are_counted_as_left_out() {
        let line = "\nthese are the 40 least alike of 41 lights; --json has all\n";
        let [many, few] = [MOST_LINES + 1, MOST_LINES].map(|lights| shown(lights, false, 0));
        assert!(many.contains(line) && !few.contains("least alike of"), "{many}");
        let text = shown(1, false, 7);
        assert!(text.contains("left out: cars") && text.contains("     7\n\nthis local simulator"), "{text}");
    }

    #[test]
    fn only_without_random_numbers_a_local_simulator_can_be_trusted() {
        for (lights, these) in [(1, "\nthis local simulator"), (2, "\nall 2 local simulators")] {
            let trusted = format!("{these} can be trusted");
            let (sure, random) = (shown(lights, false, 0), shown(lights, true, 0));
            assert!(sure.ends_with(&trusted), "{sure}");
            assert!(!random.contains(&trusted) && random.contains("at least 80 %"), "{random}");
        }
    }
}
