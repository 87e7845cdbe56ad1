//! What do lights meet in their local simulators if the AIPs (approximate influence predictors) know only arrivals that
//! untrained lights cause?
//!
//! The global simulator (GS) is played twice: with the policies that training begins with, and with the controller
//! `gap-out`. Each time AIPs and constants learn the arrivals. Then lights that follow `gap-out` meet these arrivals in
//! local simulators (LS), and are compared with the same lights in the GS.
//!
//! ```sh
//! cargo run --release --example stale_influence -- traffic_25 34    # a grid of configs/, episodes of a dataset
//! ```

use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use anyhow::{Context, Result, bail, ensure};
use dials_core::base::{AgentId, Dice, Rows, Seed, Stopwatch, Work};
use dials_core::domain::{Action, Beginning, Controller, Domain, GlobalSimulator, JointPercept, LocalSimulator};
use dials_learn::config::Predictor;
use dials_learn::fleet::Fleet;
use dials_learn::observer::Silent;
use dials_learn::policy::{JointPolicyController, Selection};
use dials_learn::predictors::{Dataset, train};
use dials_session::config::RunConfig;
use dials_session::domains::DomainConfig;
use dials_session::fleet::in_process;
use dials_traffic::Traffic;
use dials_traffic::agents::phases::Light;
use dials_traffic::agents::region::{CELLS, OCCUPANCY};
use dials_traffic::config::TrafficTable;
use dials_traffic::light::{KEEP, SWITCH};
use dials_traffic::side::Side;
use dials_traffic::sim::control::SignalControl;
use stacknets::Threads;

/// Local simulators of each light, each with one episode.
const COPIES: usize = 16;
/// Platoons are counted in windows of this many steps.
const WINDOW: usize = 20;

#[cfg_attr(test, allow(dead_code, reason = "the test calls `run`"))]
fn main() -> Result<()> {
    let mut given = std::env::args().skip(1);
    let config = given.next().unwrap_or_else(|| "traffic_25".to_owned());
    let episodes = given.next().map_or(Ok(34), |given| given.parse()).context("the number of episodes")?;
    run(&config, episodes).map(drop)
}

/// What lights met: means of all lights, and of all steps where nothing else is said.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Met {
    /// Mean return of an episode.
    pub episode_return: f64,
    /// Cars that came to a light in a step.
    pub arrivals: f64,
    /// Variance of the number of cars that came on one approach in [`WINDOW`] steps, by its mean. It is less than 1 if
    /// they come one by one, as chance has it, and more if they come in platoons.
    pub dispersion: f64,
    /// Share of the steps in which no car is on any approach. Such a step pays nothing.
    pub nobody: f64,
}

/// Prints what lights meet, and returns it: in the GS, then with AIPs and constants of untrained lights, then with AIPs
/// and constants of these lights. `config`: a file of `configs/`. `episodes`: those of a dataset.
pub(crate) fn run(config: &str, episodes: usize) -> Result<[Met; 5]> {
    ensure!(episodes >= 2, "a dataset needs two episodes or more: one of them is held out");
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs").join(config).with_extension("toml");
    let config = dials_session::config::load(&file, &["seed=101".to_owned()])?;
    let Some(DomainConfig::Traffic(TrafficTable::Grid(table))) = &config.domain else {
        bail!("{}: no grid", file.display())
    };
    let traffic = Traffic::open(table)?;
    let untrained = in_process(Arc::new(traffic.clone()), config.clone(), Rc::new(Silent))?.agents().policies.clone();
    let mut untrained = JointPolicyController::new(traffic.kinds(), &config.learning, &untrained, Selection::Sampled);
    let (_, stale) = play(&traffic, &mut untrained, Seed::new(1), episodes)?;
    let (truth, fresh) = play(&traffic, &mut GapOut, Seed::new(2), episodes)?;
    println!("{:<32} {:>8} {:>9} {:>11} {:>8}", "", "return", "arrivals", "dispersion", "nobody");
    print("GS", truth);
    let mut all = vec![truth];
    for (of, data) in [("untrained lights", &stale), ("these lights", &fresh)] {
        for (name, choice) in [("AIPs", Predictor::Network), ("constants", Predictor::Marginals)] {
            let met = meet(&traffic, &config, choice, data)?;
            print(&format!("LS, {name} of {of}"), met);
            all.push(met);
        }
    }
    Ok(all.try_into().expect("five rows were made"))
}

fn print(name: &str, met: Met) {
    let Met { episode_return, arrivals, dispersion, nobody } = met;
    println!("{name:<32} {episode_return:>8.1} {arrivals:>9.3} {dispersion:>11.2} {:>6.1} %", 100.0 * nobody);
}

/// Plays episodes on the GS. Returns what lights met, and a dataset per light.
fn play(traffic: &Traffic, by: &mut dyn Controller, seed: Seed, episodes: usize) -> Result<(Met, Vec<Dataset>)> {
    let (lights, horizon) = (traffic.agents(), traffic.kinds().horizon());
    let mut datasets = Dataset::of_all(traffic.kinds());
    let mut tally = Tally::new(lights);
    let mut gs = traffic.global(SignalControl::Agents)?;
    gs.observe_influence()?;
    let mut actions = vec![KEEP; lights];
    for episode in 0..episodes {
        let seed = seed.for_episode(episode);
        by.begin(seed);
        let mut percept = gs.reset(seed)?.clone();
        for _ in 0..horizon {
            by.act(&percept, &mut actions)?;
            let transition = gs.step(&actions)?;
            percept.clone_from(&transition.percept);
            let rewards = transition.rewards.clone();
            let sample = gs.influence_sample();
            for (light, dataset) in datasets.iter_mut().enumerate() {
                let came = sample.sources.row(light);
                dataset.push(sample.d_set.row(light), came);
                tally.note(light, came, rewards[light], gs.cars_on(light).cars());
            }
        }
    }
    Ok((tally.met(episodes * lights), datasets))
}

/// Trains a predictor on datasets, and lets lights that follow gap-out meet it in local simulators.
fn meet(traffic: &Traffic, config: &RunConfig, choice: Predictor, datasets: &[Dataset]) -> Result<Met> {
    let (agents, spec) = (AgentId::all(traffic.agents()), &traffic.kinds()[0].spec);
    let mut predictor = choice.kind().make(&agents, spec, &config.learning.aip, Seed::new(3));
    let work = Work { watch: &mut Stopwatch::default(), progress: &mut |_| () };
    train(&mut *predictor, &agents, datasets, (&config.learning.aip, &Threads::one()), Seed::new(4), work);

    let rows = agents.len() * COPIES;
    let mut dice: Vec<Dice> = (0..rows).map(|row| Seed::new(5).for_copy(row).dice()).collect();
    let mut ls = traffic.local(rows)?;
    predictor.begin(rows)?;
    let (mut tally, mut came) = (Tally::new(rows), Rows::new(rows, spec.sources.count()));
    let mut percept = ls.reset(&Beginning::first(0..rows))?.clone();
    for _ in 0..spec.horizon {
        let actions: Vec<Action> = percept.obs.iter().map(gap_out).collect();
        predictor.sample(&percept.d_set, &mut dice, &mut came)?;
        let transition = ls.step(&actions, &came)?;
        percept.clone_from(&transition.percept);
        let rewards = transition.rewards.clone();
        for (row, reward) in rewards.into_iter().enumerate() {
            tally.note(row, came.row(row), reward, ls.cars_on(row).cars());
        }
    }
    Ok(tally.met(rows))
}

/// Sums over the steps of some lights.
struct Tally {
    steps: usize,
    rewards: f64,
    nobody: usize,
    /// Arrivals on the approaches of each light in the window that is open.
    open: Vec<Window>,
    closed: Vec<f64>,
}

#[derive(Clone, Default)]
struct Window {
    steps: usize,
    came: Vec<u32>,
}

impl Tally {
    fn new(lights: usize) -> Tally {
        Tally { steps: 0, rewards: 0.0, nobody: 0, open: vec![Window::default(); lights], closed: Vec::new() }
    }

    fn note(&mut self, light: usize, came: &[u8], reward: f32, cars: usize) {
        self.steps += 1;
        self.rewards += f64::from(reward);
        self.nobody += usize::from(cars == 0);
        let window = &mut self.open[light];
        window.came.resize(came.len(), 0);
        window.came.iter_mut().zip(came).for_each(|(sum, &came)| *sum += u32::from(came));
        window.steps += 1;
        if window.steps == WINDOW {
            self.closed.extend(window.came.iter().map(|&sum| f64::from(sum)));
            *window = Window::default();
        }
    }

    /// `episodes`: those of all lights.
    fn met(&self, episodes: usize) -> Met {
        let mean = self.closed.iter().sum::<f64>() / self.closed.len() as f64;
        let squares = self.closed.iter().map(|came| (came - mean).powi(2)).sum::<f64>();
        let approaches = Side::ALL.len() as f64;
        Met {
            episode_return: self.rewards / episodes as f64,
            arrivals: mean * approaches / WINDOW as f64,
            dispersion: squares / self.closed.len() as f64 / mean,
            nobody: self.nobody as f64 / self.steps as f64,
        }
    }
}

/// The controller `gap-out`, from observations: a local simulator has no controllers of its own.
struct GapOut;

impl Controller for GapOut {
    fn begin(&mut self, _: Seed) {}

    fn act(&mut self, percept: &JointPercept, actions: &mut [Action]) -> dials_core::domain::Result<()> {
        actions.iter_mut().zip(percept.obs.iter()).for_each(|(action, obs)| *action = gap_out(obs));
        Ok(())
    }
}

fn gap_out(obs: &[f32]) -> Action {
    let shown = obs[OCCUPANCY..].iter().position(|&bit| bit == 1.0).expect("a light shows something");
    let Some([green, red]) = Light::ALL[shown].green_and_red() else { return KEEP };
    let car = |side: &Side, cells: usize| obs[CELLS * side.index()..][..cells].contains(&1.0);
    let (used, wanted) = (green.iter().any(|side| car(side, 3)), red.iter().any(|side| car(side, 4)));
    if !used && wanted { SWITCH } else { KEEP }
}
