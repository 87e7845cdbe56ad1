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
use dials_core::base::{AgentId, Dice, Ragged, Rows, Seed};
use dials_core::domain::*;
use dials_learn::config::*;
use dials_learn::dials;
use dials_learn::evaluation::Evaluation;
use dials_learn::observer::Observer;
use dials_learn::observer::Unrecorded;
use dials_learn::progress::TrainingProgress;
use dials_session::fleet::in_process;
use dials_testkit::conformance;
use rand::Rng;

const PEOPLE: usize = 4;
const HANDS: usize = 3;
const WALK: Action = 1;

/// One person, a local region. Local state: the number of buckets held. Influence source: the number that arrive.
#[derive(Clone, Copy, Default)]
struct Person {
    held: u8,
}

impl Person {
    /// Returns the number of buckets that this person hands over with this action.
    fn handed_over(self, action: Action) -> u8 {
        if action == WALK { self.held } else { 0 }
    }

    /// Makes the transition and returns the reward.
    fn step(&mut self, action: Action, arriving: u8) -> f32 {
        let handed_over = self.handed_over(action);
        self.held = (self.held - handed_over + arriving).min(HANDS as u8);
        f32::from(handed_over) - f32::from(action)
    }

    /// Writes the observation and the d-set (the input of the AIP, the approximate influence predictor): the number of
    /// buckets held, one-hot.
    fn show(self, obs: &mut [f32], d_set: &mut [f32]) {
        for row in [obs, d_set] {
            row.fill(0.0);
            row[usize::from(self.held)] = 1.0;
        }
    }
}

/// The local simulator: any number of people. AIPs decide how many buckets arrive.
struct People {
    spec: RegionSpec,
    people: Vec<Person>,
    last: Transition,
}

impl People {
    fn show(&mut self, row: usize) {
        let Percept { obs, d_set, .. } = &mut self.last.percept;
        self.people[row].show(obs.row_mut(row), d_set.row_mut(row));
    }
}

impl LocalSimulator for People {
    fn spec(&self) -> &RegionSpec {
        &self.spec
    }

    fn rows(&self) -> usize {
        self.people.len()
    }

    fn reset(&mut self, begin: &[Beginning]) -> Result<&Percept> {
        for beginning in begin {
            self.people[beginning.row] = Person::default();
            self.show(beginning.row);
        }
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action], sources: &Rows<u8>) -> Result<&Transition> {
        for (row, &action) in actions.iter().enumerate() {
            self.last.rewards[row] = self.people[row].step(action, sources.row(row)[0]);
            self.show(row);
        }
        Ok(&self.last)
    }
}

/// The global simulator: the whole line.
struct Line {
    kinds: Kinds,
    people: [Person; PEOPLE],
    pump: Dice,
    d_set: Ragged<f32>,
    sources: Ragged<u8>,
    last: JointTransition,
}

impl Line {
    fn show(&mut self) {
        let JointPercept { obs, d_set, .. } = &mut self.last.percept;
        self.people.iter().enumerate().for_each(|(row, person)| person.show(obs.row_mut(row), d_set.row_mut(row)));
    }
}

impl GlobalSimulator for Line {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        self.pump = episode.fork_named("pump").dice();
        self.people = Default::default();
        self.show();
        Ok(&self.last.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        self.d_set.copy_from(&self.last.percept.d_set);
        let mut arriving = u8::from(self.pump.random_bool(0.5));
        for (row, (person, &action)) in self.people.iter_mut().zip(actions).enumerate() {
            self.sources.row_mut(row)[0] = arriving;
            let handed_over = person.handed_over(action);
            self.last.rewards[row] = person.step(action, arriving);
            arriving = handed_over;
        }
        self.show();
        Ok(&self.last)
    }

    fn influence_sample(&self) -> InfluenceSample<'_> {
        InfluenceSample { d_set: &self.d_set, sources: &self.sources }
    }
}

/// All people are alike: one kind of agents.
struct Brigade {
    kinds: Kinds,
}

impl Domain for Brigade {
    fn kinds(&self) -> &Kinds {
        &self.kinds
    }

    fn global_simulator(&self) -> Result<Box<dyn GlobalSimulator>> {
        let last = JointTransition::new(&self.kinds);
        Ok(Box::new(Line {
            people: Default::default(),
            pump: Seed::new(0).dice(),
            d_set: last.percept.d_set.clone(),
            sources: Ragged::new([1; PEOPLE]),
            last,
            kinds: self.kinds.clone(),
        }))
    }

    fn local_simulator(&self, regions: &[AgentId], copies: usize, _seed: Seed) -> Result<Box<dyn LocalSimulator>> {
        let (spec, rows) = (self.kinds[0].spec.clone(), regions.len() * copies);
        Ok(Box::new(People { people: vec![Person::default(); rows], last: Transition::new(rows, &spec), spec }))
    }

    fn scenario(&self) -> Result<Scenario> {
        Ok(Scenario::new("brigade", PEOPLE, self.kinds.horizon()))
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

pub(crate) fn main() -> Result<()> {
    let sources = SourceSpec { classes: vec![HANDS as u8 + 1], parts: 0 };
    let spec = RegionSpec {
        obs_dim: HANDS + 1,
        d_set_dim: HANDS + 1,
        n_actions: 2,
        sets: None,
        masks: false,
        sources,
        horizon: 60,
        local_horizon: 60,
    };
    let brigade = Arc::new(Brigade { kinds: Kinds::one(PEOPLE, spec) });
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
    let mut fleet = in_process(brigade, config.clone(), Rc::new(Printer))?;
    dials::train(&config, &mut fleet, TrainingProgress::default(), &mut Unrecorded, &Printer)
}
