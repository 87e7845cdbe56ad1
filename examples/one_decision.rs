//! What is one decision of a light worth? To the light itself, to its neighbours, and two roads away.
//!
//! On a grid of 5 x 5 lights all follow the controller `coordinated`. Then the same episode is played again, and single
//! decisions are the other way round. The same cars come, so the difference in rewards is the worth of the decision.
//!
//! At the end a table is made of what a light sees: the clock, and the nearest car before green and before red. One half
//! of the episodes says in which cases another decision is better on average. The other half says what that is worth.
//!
//! ```sh
//! cargo run --release --example one_decision -- 500    # episodes; a quarter of an hour
//! ```

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Context, Result, ensure};
use dials_core::base::statistics::Interval;
use dials_core::base::{Dice, Seed};
use dials_core::domain::{Action, GlobalSimulator};
use dials_traffic::agents::phases::Light;
use dials_traffic::agents::region::{CELLS, OCCUPANCY};
use dials_traffic::config::{EntryRule, TrafficConfig};
use dials_traffic::side::Side;
use dials_traffic::sim::global::GlobalTraffic;
use dials_traffic::{Traffic, controllers};
use rand::Rng;
use rand::seq::SliceRandom;

/// Lights in a row and in a column.
const SIDE: usize = 5;
const STEPS: usize = 300;
/// Number of times that each episode is played again with other decisions.
const AGAIN: usize = 12;
/// A decision is judged by the rewards of this many steps.
const JUDGED_STEPS: usize = 45;
/// The clock of each light changes every 13 steps: 10 of green and 3 of yellow. Neighbours have the opposite green.
const HALF_CYCLE: usize = 13;
/// A case counts if it was seen this often.
const SEEN_OFTEN: usize = 20;

/// What a light saw: the step of the clock, what the controller decided, and how far the nearest car was before green
/// and before red, in cells of 20 m.
type Case = (usize, Action, [usize; 2]);

/// A decision that was taken the other way round.
struct Tried {
    episode: usize,
    case: Case,
    /// What that gained: for the light itself, with its neighbours, and with the lights two roads away.
    gains: [f64; 3],
}

/// Rewards of all lights, `[steps][lights]`, and the decisions that were changed: step, light and case.
type Played = (Vec<Vec<f32>>, Vec<(usize, usize, Case)>);

#[cfg_attr(test, allow(dead_code, reason = "the test calls `run`"))]
fn main() -> Result<()> {
    let episodes = std::env::args().nth(1).map_or(Ok(2), |given| given.parse()).context("the number of episodes")?;
    run(episodes).map(drop)
}

/// Prints what decisions of these episodes are worth. Returns what all that were changed gained on average.
pub(crate) fn run(episodes: usize) -> Result<[f64; 3]> {
    ensure!(episodes > 0, "no episodes: needs at least one");
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let nets = TrafficConfig::new(nets.join("grid_5x5"), nets.join("local"));
    let traffic = Traffic::open(&TrafficConfig { entry: EntryRule::Max, ..nets })?;
    let controller = controllers::recipe("coordinated", traffic.plans())?;
    let mut gs = traffic.global(traffic.everywhere(controller(&traffic)?))?;
    let mut dice = Seed::new(101).dice();
    let mut tried = Vec::new();
    for episode in 0..episodes {
        let seed = Seed::new(102).for_episode(episode);
        let usual = play(&mut gs, seed, |_, _| Vec::new())?.0;
        for _ in 0..AGAIN {
            let found = try_others(&mut gs, seed, &usual, &mut dice)?;
            tried.extend(found.into_iter().map(|(case, gains)| Tried { episode, case, gains }));
        }
        if (episode + 1) % 50 == 0 {
            eprintln!("{} of {episodes} episodes", episode + 1);
        }
    }
    println!("{} decisions the other way round: mean gain, and half of a 95 % interval", tried.len());
    println!("{:>34} {:>15} {:>15} {:>15}", "", "the light", "+ neighbours", "+ two roads");
    let all: Vec<&Tried> = tried.iter().collect();
    print("all", &all, tried.len());
    let names = ["better for the light", "better with its neighbours", "better for all of them"];
    for (scope, name) in names.iter().enumerate() {
        print(name, &chosen(&tried, scope), tried.len());
    }
    Ok([0, 1, 2].map(|scope| gains(&all, scope).mean))
}

/// Plays an episode. `change`: given the step and what the lights see, those that decide the other way round. Returns
/// the rewards, and what was changed.
fn play(
    gs: &mut GlobalTraffic,
    seed: Seed,
    mut change: impl FnMut(usize, &[Vec<f32>]) -> Vec<usize>,
) -> Result<Played> {
    let mut seen: Vec<Vec<f32>> = gs.reset(seed)?.obs.iter().map(<[f32]>::to_vec).collect();
    let (mut actions, mut rewards, mut changed) = (vec![0; SIDE * SIDE], Vec::new(), Vec::new());
    for step in 0..STEPS {
        gs.advise(&mut actions);
        for light in change(step, &seen) {
            changed.push((step, light, case(step, actions[light], &seen[light])));
            actions[light] = 1 - actions[light];
        }
        let transition = gs.step(&actions)?;
        rewards.push(transition.rewards.clone());
        seen.iter_mut().zip(transition.percept.obs.iter()).for_each(|(seen, obs)| seen.copy_from_slice(obs));
    }
    Ok((rewards, changed))
}

/// Plays an episode again. Every 50 steps some lights that are far from each other decide once the other way round.
fn try_others(
    gs: &mut GlobalTraffic,
    seed: Seed,
    usual: &[Vec<f32>],
    dice: &mut Dice,
) -> Result<Vec<(Case, [f64; 3])>> {
    let first = dice.random_range(0..30);
    let mut due: Vec<(usize, usize)> = Vec::new();
    let (rewards, changed) = play(gs, seed, |step, seen| {
        if step >= first && (step - first) % 50 == 0 && step + JUDGED_STEPS < STEPS {
            // In the first steps after a change a switch only does harm.
            due = far_apart(dice).into_iter().map(|light| (light, dice.random_range(3..HALF_CYCLE))).collect();
        }
        let now = due.extract_if(.., |&mut (_, at)| step % HALF_CYCLE == at).map(|(light, _)| light);
        now.filter(|&light| green_and_red(&seen[light]).is_some()).collect()
    })?;
    let worth = |step: usize, light: usize| {
        let mut gains = [0.0; 3];
        for at in step..STEPS.min(step + JUDGED_STEPS) {
            for (other, (now, before)) in rewards[at].iter().zip(&usual[at]).enumerate() {
                let roads = roads_between(light, other);
                gains.iter_mut().skip(roads).for_each(|gain| *gain += f64::from(now - before));
            }
        }
        gains
    };
    Ok(changed.into_iter().map(|(step, light, case)| (case, worth(step, light))).collect())
}

/// Draws lights that are at least four roads from each other.
fn far_apart(dice: &mut Dice) -> Vec<usize> {
    let mut lights: Vec<usize> = (0..SIDE * SIDE).collect();
    lights.shuffle(dice);
    let mut drawn: Vec<usize> = Vec::new();
    for light in lights {
        if drawn.iter().all(|&other| roads_between(light, other) >= 4) {
            drawn.push(light);
        }
    }
    drawn
}

fn roads_between(one: usize, other: usize) -> usize {
    (one / SIDE).abs_diff(other / SIDE) + (one % SIDE).abs_diff(other % SIDE)
}

/// Returns the sides whose cars have green, then those whose cars have red. `None` during yellow.
fn green_and_red(obs: &[f32]) -> Option<[[Side; 2]; 2]> {
    let shown = obs[OCCUPANCY..].iter().position(|&bit| bit == 1.0).expect("a light shows something");
    Light::ALL[shown].green_and_red()
}

fn case(step: usize, action: Action, obs: &[f32]) -> Case {
    let sides = green_and_red(obs).expect("only lights with green are asked");
    let nearest = |side: Side| {
        let cells = &obs[CELLS * side.index()..][..CELLS];
        cells.iter().position(|&bit| bit == 1.0).map_or(CELLS, |cell| cell / 2)
    };
    (step % HALF_CYCLE, action, sides.map(|[one, other]| nearest(one).min(nearest(other))))
}

/// Returns the decisions of the cases that were better the other way round in the other half of the episodes. `scope`:
/// for whom.
fn chosen(tried: &[Tried], scope: usize) -> Vec<&Tried> {
    let half = |half: usize| tried.iter().filter(move |tried| tried.episode % 2 == half);
    let mut chosen = Vec::new();
    for asked in [0, 1] {
        let mut gains: HashMap<Case, Vec<f64>> = HashMap::new();
        half(asked).for_each(|tried| gains.entry(tried.case).or_default().push(tried.gains[scope]));
        gains.retain(|_, gains| gains.len() >= SEEN_OFTEN && gains.iter().sum::<f64>() > 0.0);
        chosen.extend(half(1 - asked).filter(|tried| gains.contains_key(&tried.case)));
    }
    chosen
}

/// Returns what decisions gained, with an interval. `scope`: for whom.
fn gains(tried: &[&Tried], scope: usize) -> Interval {
    Interval::of(&tried.iter().map(|tried| tried.gains[scope]).collect::<Vec<_>>())
}

fn print(name: &str, tried: &[&Tried], all: usize) {
    let share = 100.0 * tried.len() as f64 / all as f64;
    let columns = [0, 1, 2].map(|scope| {
        let Interval { mean, half_width, .. } = gains(tried, scope);
        half_width.map_or("-".to_owned(), |half| format!("{mean:+.2} +- {half:.2}"))
    });
    println!("{name:>26} {share:>5.1} % {:>15} {:>15} {:>15}", columns[0], columns[1], columns[2]);
}
