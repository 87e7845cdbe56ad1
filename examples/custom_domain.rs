//! Trains your own domain with DIALS: a bucket brigade.
//!
//! A pump fills buckets for the first of four people in a line. Each person can hold three buckets. At any step a
//! person may walk to the next one and hand over all buckets. Each bucket handed over is worth 1, and the walk costs 1.
//! Buckets that the next person cannot hold are spilled. It pays to wait for three buckets, and not to walk to a person
//! whose hands are full.
//!
//! ```sh
//! cargo run --release --example custom_domain
//! ```

use std::rc::Rc;
use std::sync::Arc;

use anyhow::Result;
use dials_traffic::base::{AgentId, Dice, Rows, Seed};
use dials_traffic::config::*;
use dials_traffic::domain::*;
use dials_traffic::evaluation::Evaluation;
use dials_traffic::fleet::inline::InlineFleet;
use dials_traffic::training::dials;
use dials_traffic::training::journal::Unrecorded;
use dials_traffic::training::observer::Observer;
use dials_traffic::training::standing::Standing;
use rand::Rng;

const PEOPLE: usize = 4;
const HANDS: usize = 3;
const WALK: Action = 1;

/// People, each one a local region. Local state: the number of buckets held. Influence source: the number that arrive.
struct People {
    spec: RegionSpec,
    held: Vec<u8>,
    last: Transition,
}

impl People {
    fn new(rows: usize, spec: &RegionSpec) -> Self {
        People { spec: spec.clone(), held: vec![0; rows], last: Transition::new(rows, spec) }
    }

    /// Returns the number of buckets that a person hands over with this action.
    fn handed_over(&self, row: usize, action: Action) -> u8 {
        if action == WALK { self.held[row] } else { 0 }
    }

    fn step(&mut self, row: usize, action: Action, arriving: u8) {
        let handed_over = self.handed_over(row, action);
        self.last.rewards[row] = f32::from(handed_over) - f32::from(action);
        self.show(row, (self.held[row] - handed_over + arriving).min(HANDS as u8));
    }

    /// Writes the observation and the d-set (the input of the AIP, the approximate influence predictor): the number of
    /// buckets held, one-hot.
    fn show(&mut self, row: usize, held: u8) {
        self.held[row] = held;
        for table in [&mut self.last.percept.obs, &mut self.last.percept.d_set] {
            table.row_mut(row).fill(0.0);
            table.row_mut(row)[usize::from(held)] = 1.0;
        }
    }
}

/// The local simulator: any number of people. AIPs decide how many buckets arrive.
impl LocalSimulator for People {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.held.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        begin.iter().for_each(|beginning| self.show(beginning.row, 0));
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        (0..actions.len()).for_each(|row| People::step(self, row, actions[row], sources.row(row)[0]));
        Ok(&self.last)
    }
}

/// The global simulator: the whole line.
struct Line {
    people: People,
    pump: Dice,
    d_set: Rows<f32>,
    sources: Rows<u8>,
}

impl GlobalSimulator for Line {
    fn spec(&self) -> &RegionSpec {
        &self.people.spec
    }

    fn agents(&self) -> usize {
        PEOPLE
    }

    fn reset(&mut self, episode: Seed) -> Result<&Percept> {
        self.pump = episode.fork_named("pump").dice();
        (0..PEOPLE).for_each(|person| self.people.show(person, 0));
        Ok(&self.people.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&Transition> {
        self.d_set.copy_from(&self.people.last.percept.d_set);
        let mut arriving = u8::from(self.pump.random_bool(0.5));
        for (person, &action) in actions.iter().enumerate() {
            self.sources.row_mut(person)[0] = arriving;
            let handed_over = self.people.handed_over(person, action);
            self.people.step(person, action, arriving);
            arriving = handed_over;
        }
        Ok(&self.people.last)
    }

    fn influence_sample(&self) -> InfluenceSample<'_> {
        InfluenceSample { d_set: &self.d_set, sources: &self.sources }
    }
}

struct Brigade {
    spec: RegionSpec,
}

impl Domain for Brigade {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn agents(&self) -> usize {
        PEOPLE
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        let (d_set, sources) = (Rows::new(PEOPLE, self.spec.d_set_dim), Rows::new(PEOPLE, 1));
        Ok(Box::new(Line { people: People::new(PEOPLE, &self.spec), pump: Seed::new(0).dice(), d_set, sources }))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, _seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        Ok(Box::new(People::new(regions.len() * copies, &self.spec)))
    }

    fn scenario(&self) -> Result<Scenario> {
        Ok(Scenario::new("brigade", PEOPLE, self.spec.horizon))
    }
}

/// Prints evaluations.
struct Printer;

impl Observer for Printer {
    fn evaluated(&self, steps: u64, evaluation: &Evaluation) {
        let people: Vec<String> =
            (0..PEOPLE).map(|person| format!("{:.1}", evaluation.of_agent(person).mean)).collect();
        println!("step {steps:>6}: mean return {:.1} ({})", evaluation.of_all().mean, people.join(", "));
    }
}

pub fn main() -> Result<()> {
    let sources = SourceSpec::Categorical { sources: 1, classes: HANDS + 1 };
    let spec = RegionSpec { obs_dim: HANDS + 1, d_set_dim: HANDS + 1, n_actions: 2, sources, horizon: 60 };
    let brigade = Arc::new(Brigade { spec });
    let measured = conformance::check(&*brigade, Seed::new(1))?;
    println!(
        "the local simulator reproduces {:.0} % of the global one's non-zero observations",
        100.0 * measured.recall
    );

    let config = Config {
        total_steps: 40_000,
        local_simulators: LocalSimulatorsConfig { copies: 8, stagger: true },
        policy: PolicyConfig { hidden: vec![32], ..PolicyConfig::default() },
        ppo: PpoConfig { learning_rate: 3e-3, time_limit: TimeLimit::Bootstrap, ..PpoConfig::default() },
        aip: AipConfig {
            hidden: vec![16],
            retrain_every_steps: 10_000,
            dataset_steps: 3_000,
            learning_rate: 3e-3,
            epochs: 10,
            ..AipConfig::default()
        },
        evaluation: EvaluationConfig { every_steps: 10_000, ..EvaluationConfig::default() },
        ..Config::default()
    };
    let mut fleet = InlineFleet::new(brigade, &config, Rc::new(Printer));
    dials::train(&config, &mut fleet, Standing::default(), &mut Unrecorded, &Printer)
}
