//! Do local simulators (LS) rank behaviours of lights as the global simulator (GS) does?
//!
//! Lights behave in a fixed way: in each step in which they may switch, they do so with a fixed probability, or they
//! follow the rule `gap-out`. They are played in the GS, in local simulators with AIPs (approximate influence
//! predictors) that were trained on the arrivals at these very lights, and in local simulators with AIPs that were
//! never trained, as in untrained-DIALS.
//!
//! ```sh
//! cargo run --release --example local_ranking -- paper/traffic_4 34    # a grid of configs/, episodes of a dataset
//! ```

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use dials_core::base::{AgentId, Dice, Rows, Seed, Stopwatch, Work};
use dials_core::domain::{Action, Beginning, Domain, GlobalSimulator, LocalSimulator};
use dials_learn::config::{AipConfig, Predictor};
use dials_learn::predictors::{Dataset, InfluencePredictor, TrainablePredictor, train};
use dials_session::domains::DomainConfig;
use dials_traffic::Traffic;
use dials_traffic::agents::phases::Light;
use dials_traffic::agents::region::{CELLS, OCCUPANCY};
use dials_traffic::config::TrafficTable;
use dials_traffic::light::{KEEP, SWITCH};
use dials_traffic::side::Side;
use dials_traffic::sim::control::SignalControl;
use rand::Rng;
use stacknets::Threads;

/// Local simulators of each light, each with one episode.
const COPIES: usize = if cfg!(test) { 12 } else { 32 };

#[cfg_attr(test, allow(dead_code, reason = "the test calls `run`"))]
fn main() -> Result<()> {
    let mut given = std::env::args().skip(1);
    let config = given.next().unwrap_or_else(|| "paper/traffic_4".to_owned());
    let episodes = given.next().map_or(Ok(34), |given| given.parse()).context("the number of episodes")?;
    run(&config, episodes, &ALL).map(drop)
}

/// How all lights behave.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Behaviour {
    /// Switches with this probability in each step in which it may.
    Switches(f64),
    /// The controller `gap-out`.
    GapOut,
}

#[cfg_attr(test, allow(dead_code, reason = "the test plays two of them"))]
const ALL: [Behaviour; 8] = [
    Behaviour::Switches(0.0),
    Behaviour::Switches(0.02),
    Behaviour::Switches(0.05),
    Behaviour::Switches(0.1),
    Behaviour::Switches(0.2),
    Behaviour::Switches(0.5),
    Behaviour::Switches(1.0),
    Behaviour::GapOut,
];

/// Mean returns of an episode, over all lights and episodes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Returns {
    pub gs: f64,
    /// In local simulators with AIPs that were trained on these lights.
    pub trained: f64,
    /// In local simulators with AIPs that were never trained.
    pub untrained: f64,
}

/// Prints what each behaviour earns, and returns it. `config`: a file of `configs/`. `episodes`: those of a dataset.
pub(crate) fn run(config: &str, episodes: usize, behaviours: &[Behaviour]) -> Result<Vec<Returns>> {
    ensure!(episodes >= 2, "a dataset needs two episodes or more: one of them is held out");
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(config).with_extension("toml");
    let config = dials_session::config::load(&file, &["seed=101".to_owned()])?;
    let Some(DomainConfig::Traffic(TrafficTable::Grid(table))) = &config.domain else {
        bail!("{}: no grid", file.display())
    };
    let traffic = Traffic::open(table)?;
    println!("{:<22} {:>8} {:>15} {:>17}", "lights", "GS", "LS, their AIPs", "LS, random AIPs");
    let mut all = Vec::with_capacity(behaviours.len());
    for &behaviour in behaviours {
        let (gs, datasets) = play(&traffic, behaviour, episodes)?;
        let mut trained = predictor(&traffic, &config.learning.aip, Predictor::Network);
        let work = Work { watch: &mut Stopwatch::default(), progress: &mut |_| () };
        train(
            &mut *trained,
            &AgentId::all(traffic.agents()),
            &datasets,
            (&config.learning.aip, &Threads::one()),
            Seed::new(4),
            work,
        );
        let mut untrained = predictor(&traffic, &config.learning.aip, Predictor::Untrained);
        let [trained, untrained] =
            [&mut trained, &mut untrained].map(|predictor| meet(&traffic, behaviour, &mut **predictor));
        let returns = Returns { gs, trained: trained?, untrained: untrained? };
        print(behaviour, returns);
        all.push(returns);
    }
    Ok(all)
}

fn print(behaviour: Behaviour, Returns { gs, trained, untrained }: Returns) {
    let name = match behaviour {
        Behaviour::Switches(share) => format!("switch in {:.0} %", 100.0 * share),
        Behaviour::GapOut => "gap-out".to_owned(),
    };
    println!("{name:<22} {gs:>8.1} {trained:>15.1} {untrained:>17.1}");
}

fn predictor(traffic: &Traffic, aip: &AipConfig, choice: Predictor) -> Box<dyn TrainablePredictor> {
    let (agents, spec) = (AgentId::all(traffic.agents()), &traffic.kinds()[0].spec);
    choice.kind().make(&agents, spec, aip, Seed::new(3))
}

/// Plays episodes on the GS. Returns the mean return of a light, and a dataset per light.
fn play(traffic: &Traffic, behaviour: Behaviour, episodes: usize) -> Result<(f64, Vec<Dataset>)> {
    let lights = traffic.agents();
    let mut datasets = Dataset::of_all(traffic.kinds());
    let mut dice: Vec<Dice> = (0..lights).map(|light| Seed::new(6).for_copy(light).dice()).collect();
    let mut gs = traffic.global(SignalControl::Agents)?;
    gs.observe_influence()?;
    let mut sum = 0.0;
    for episode in 0..episodes {
        let mut percept = gs.reset(Seed::new(1).for_episode(episode))?.clone();
        for _ in 0..traffic.kinds().horizon() {
            let seen = percept.obs.iter().zip(&mut dice);
            let actions: Vec<Action> = seen.map(|(obs, dice)| decide(behaviour, obs, dice)).collect();
            let transition = gs.step(&actions)?;
            percept.clone_from(&transition.percept);
            sum += transition.rewards.iter().map(|&reward| f64::from(reward)).sum::<f64>();
            let sample = gs.influence_sample();
            for (light, dataset) in datasets.iter_mut().enumerate() {
                dataset.push(sample.d_set.row(light), sample.sources.row(light));
            }
        }
    }
    Ok((sum / (episodes * lights) as f64, datasets))
}

/// Returns the mean return of a light in local simulators with a predictor.
fn meet(traffic: &Traffic, behaviour: Behaviour, predictor: &mut dyn InfluencePredictor) -> Result<f64> {
    let spec = &traffic.kinds()[0].spec;
    let rows = traffic.agents() * COPIES;
    let dice_of = |seed: u64| (0..rows).map(|row| Seed::new(seed).for_copy(row).dice()).collect::<Vec<Dice>>();
    let (mut arrivals, mut decisions) = (dice_of(5), dice_of(7));
    let mut ls = traffic.local(rows)?;
    predictor.begin(rows)?;
    let mut came = Rows::new(rows, spec.sources.count());
    let mut percept = ls.reset(&Beginning::first(0..rows))?.clone();
    let mut sum = 0.0;
    for _ in 0..spec.horizon {
        let seen = percept.obs.iter().zip(&mut decisions);
        let actions: Vec<Action> = seen.map(|(obs, dice)| decide(behaviour, obs, dice)).collect();
        predictor.sample(&percept.d_set, &mut arrivals, &mut came)?;
        let transition = ls.step(&actions, &came)?;
        percept.clone_from(&transition.percept);
        sum += transition.rewards.iter().map(|&reward| f64::from(reward)).sum::<f64>();
    }
    Ok(sum / rows as f64)
}

fn decide(behaviour: Behaviour, obs: &[f32], dice: &mut Dice) -> Action {
    let shown = obs[OCCUPANCY..].iter().position(|&bit| bit == 1.0).expect("a light shows something");
    let Some([green, red]) = Light::ALL[shown].green_and_red() else { return KEEP };
    let switches = match behaviour {
        Behaviour::Switches(share) => dice.random_bool(share),
        Behaviour::GapOut => {
            let car = |side: &Side, cells: usize| obs[CELLS * side.index()..][..cells].contains(&1.0);
            !green.iter().any(|side| car(side, 3)) && red.iter().any(|side| car(side, 4))
        }
    };
    if switches { SWITCH } else { KEEP }
}
