//! A domain of two kinds of agents, end to end: coins and dice, for which every answer is known.

use std::fs;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use dials_core::base::{AgentId, Seed};
use dials_core::domain::{Controller, Domain, Result};
use dials_core::outside::Directory;
use dials_learn::config::{AipTraining, Config, Period, ShortForm, schedule};
use dials_learn::dials;
use dials_learn::evaluation::play;
use dials_learn::fleet::Fleet;
use dials_learn::observer::{Interrupted, Observer, Silent};
use dials_learn::policy::{JointPolicyController, PolicyStack, Selection};
use dials_learn::predictors::Dataset;
use dials_learn::progress::TrainingProgress;
use dials_learn::state::AgentsState;
use dials_learn::steps::Step;
use dials_learn::steps::collect::Collect;
use dials_learn::steps::train_aips::MeasureAips;
use dials_learn::steps::train_aips::TrainAips;
use dials_learn::steps::train_policies::TrainPolicies;
use dials_learn::worker::Worker;
use dials_session::bench::costs::{Costs, Steps};
use dials_session::bench::measure::{MeasurePlan, measure, short_orders};
use dials_session::config::RunConfig;
use dials_session::fleet::in_process;
use dials_session::records::checkpoint::owner::Owner;
use dials_session::records::checkpoint::{self, Checkpoint};
use dials_session::records::files;
use dials_session::records::networks::{JointLayout, Layouts};
use dials_session::records::resume_point::ResumePoint;
use dials_session::records::run_json::RunJson;
use dials_session::records::run_log::RunLog;
use dials_session::records::run_record::RunRecord;
use dials_testkit::toy::CoinsAndDice;
use stacknets::{Threads, read_stack};

const HORIZON: usize = 50;
const RESULTS: [&str; 6] =
    [files::RETURNS, files::TRAINING, files::AIP_LOSS, files::AIP_DRIFT, files::POLICIES, files::AIPS];

fn domain() -> Arc<dyn Domain> {
    Arc::new(CoinsAndDice::new(HORIZON))
}

fn config(simulator: &str) -> Config {
    toml::from_str(&format!("{}{CONFIG}", ShortForm::called(simulator).unwrap().keys())).unwrap()
}

/// Gamma is small because rewards follow at once.
const CONFIG: &str = "seed = 3\ntotal_steps = 30000\n\
    local_simulators = { copies = 4, stagger = true }\n\
    policy = { hidden = [32] }\n\
    ppo = { time_limit = 'bootstrap', learning_rate = 3e-3, gamma = 0.5 }\n\
    aip = { hidden = [16], retrain_every_steps = 15000, dataset_steps = 5000, epochs = 20, learning_rate = 3e-3 }\n\
    evaluation = { every_steps = 10000, episodes = 10, aip_loss_episodes = 10 }\n";

/// A table whose horizon is that of the toy domain, which has none of its own.
const TABLE: &str = "traffic = { network = 'none', local_network = 'none', horizon = 50 }\n";

/// Makes a short run of three periods, with memories.
fn short(simulator: &str) -> Config {
    let mut config = config(simulator);
    config.total_steps = 3000;
    config.policy.recurrent = Some(8);
    config.policy.sequence_length = 8;
    config.aip.recurrent = Some(6);
    config.aip.batch = 4;
    config.aip.epochs = 2;
    config.aip.retrain_every_steps = 2000;
    config.aip.dataset_steps = 500;
    config.evaluation.every_steps = 1000;
    config.evaluation.episodes = 2;
    config
}

fn train(config: &Config, dir: &Path) -> Result<()> {
    let layouts = Layouts::of(config, domain().kinds());
    let mut log =
        RunLog::begin(Directory::lock(dir)?, Owner::of(&RunConfig::from(config.clone()), &*domain())?, layouts);
    let mut fleet = in_process(domain(), config.clone(), Rc::new(Silent)).unwrap();
    dials::train(config, &mut fleet, TrainingProgress::default(), &mut log, &Silent)
}

fn describe(dir: &Path) {
    let about = RunJson::new(domain().scenario().unwrap(), domain().names(), 3);
    about.write(&Directory::open(dir).unwrap()).unwrap();
}

/// Returns a column of the lines that have `keys` after the step.
fn column(dir: &Path, file: &str, keys: &[&str], name: &str) -> Vec<f64> {
    let mut reader = csv::Reader::from_path(dir.join(file)).unwrap();
    let index = reader.headers().unwrap().iter().position(|header| header == name).unwrap();
    let lines = reader.records().map(|record| record.unwrap());
    let lines = lines.filter(|record| record.iter().skip(1).zip(keys).all(|(field, key)| field == *key));
    lines.map(|record| record[index].parse().unwrap()).collect()
}

#[test]
fn all_four_simulators_teach_both_kinds() {
    for simulator in ["dials", "gs", "untrained-dials", "marginal-dials"] {
        let dir = tempfile::tempdir().unwrap();
        train(&config(simulator), dir.path()).unwrap();
        for agent in ["0", "1", "2", "3"] {
            let returns = column(dir.path(), files::RETURNS, &[agent], "mean");
            assert!(returns[0] < 0.75 * HORIZON as f64, "{simulator}, agent {agent}: {returns:?}");
            assert!(returns[3] > 0.95 * HORIZON as f64, "{simulator}, agent {agent}: {returns:?}");
        }
    }
}

#[test]
fn the_aips_of_both_kinds_learn_the_closed_form_influence() {
    let dir = tempfile::tempdir().unwrap();
    train(&config("dials"), dir.path()).unwrap();
    // After the training at 15000, when all play almost perfectly: H(0.2) = 0.5004. A coin has one source, its die; a
    // die has two, its coin and the other die.
    for (agent, source) in [("0", "0"), ("1", "0"), ("2", "0"), ("3", "0")] {
        let losses = column(dir.path(), files::AIP_LOSS, &[agent, source], "training_after");
        assert!((losses[1] - 0.5004).abs() < 0.03, "agent {agent}: {losses:?}");
    }
    // The other die turns to one of two faces.
    for agent in ["1", "3"] {
        let losses = column(dir.path(), files::AIP_LOSS, &[agent, "1"], "training_after");
        assert!(losses[1] < 2_f64.ln() + 0.01, "agent {agent}: {losses:?}");
    }
    // At the beginning, coins and dice were almost random: constants lose ln 3 on a die, and ln 2 on a coin.
    let constants = |agent, source| column(dir.path(), files::AIP_LOSS, &[agent, source], "held_out_marginals")[0];
    assert!((constants("0", "0") - 3_f64.ln()).abs() < 0.1 && (constants("1", "0") - 2_f64.ln()).abs() < 0.1);
    assert!(column(dir.path(), files::AIP_LOSS, &["0", "1"], "frequency").is_empty(), "a coin has no second source");

    // The report can read the run, and other programs can open the tensors.
    fs::write(dir.path().join(files::CONFIG), format!("{CONFIG}{TABLE}")).unwrap();
    describe(dir.path());
    let record = RunRecord::read(dir.path()).unwrap();
    assert_eq!(record.scenario().id.domain, "coins-and-dice");
    let report = dials_report::report(&[dir.path().to_owned()], None).unwrap();
    let (_, page) = report.files.iter().find(|(name, _)| name == "report.md").unwrap();
    assert!(report.runs == 1 && page.contains("coins-and-dice, 4 agents"), "{page}");
    assert_eq!((record.evaluations[0].agents.len(), record.evaluations.len(), record.aip_trainings.len()), (4, 4, 2));
    assert!(record.evaluations[3].all.mean > 0.95 * HORIZON as f64);
    let (domain, config) = (domain(), config("dials"));
    let saved = dir.path().join(files::POLICIES);
    let policies = JointLayout::of_policies(domain.kinds(), &config.policy).read(&saved).unwrap();
    for kind in domain.kinds().iter() {
        let layout = PolicyStack::shape(&kind.spec, &config.policy).layout();
        let rows =
            read_stack(&fs::read(&saved).unwrap(), &saved, &format!("{}.", kind.name), &layout, &kind.agents).unwrap();
        for (agent, row) in kind.agents.iter().zip(rows.iter()) {
            assert_eq!(policies.row(agent.0), row);
        }
    }

    // The saved policies play as well as the trained ones.
    for selection in [Selection::Sampled, Selection::Greedy] {
        let mut acting = JointPolicyController::new(domain.kinds(), &config, &policies, selection);
        let mut gs = domain.global_simulator().unwrap();
        let returns = play(&mut *gs, &mut acting, Seed::new(9)).unwrap().returns;
        assert!(returns.iter().all(|&total| total > 0.9 * HORIZON as f64), "{returns:?}");
    }
}

#[test]
fn a_masked_action_is_never_chosen() {
    let (domain, config) = (domain(), config("dials"));
    let policies = in_process(domain.clone(), config.clone(), Rc::new(Silent)).unwrap().agents().policies.clone();
    let mut gs = domain.global_simulator().unwrap();
    for selection in [Selection::Sampled, Selection::Greedy] {
        let mut acting = JointPolicyController::new(domain.kinds(), &config, &policies, selection);
        let mut actions = [0; 4];
        for episode in 0..20 {
            let seed = Seed::new(5).for_episode(episode);
            acting.begin(seed);
            let mut percept = gs.reset(seed).unwrap().clone();
            for _ in 0..HORIZON {
                acting.act(&percept, &mut actions).unwrap();
                for die in [1, 3] {
                    assert!(percept.masks.row(die)[usize::from(actions[die])], "{actions:?}");
                }
                percept = gs.step(&actions).unwrap().percept.clone();
            }
        }
    }
}

/// An observer that asks training to stop after every period.
struct Stop;

impl Observer for Stop {
    fn stop_requested(&self) -> bool {
        true
    }
}

#[test]
fn a_run_that_was_stopped_goes_on_to_the_same_bytes() {
    for simulator in ["dials", "gs", "marginal-dials"] {
        let config = short(simulator);
        let [whole, stopped] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        train(&config, whole.path()).unwrap();
        describe(stopped.path());
        let layouts = || Layouts::of(&config, domain().kinds());
        let periods = schedule(&config).len();
        assert!(periods >= 3);
        let go_on = |observer: &dyn Observer| {
            let directory = Directory::lock(stopped.path()).unwrap();
            let owner = Owner::of(&RunConfig::from(config.clone()), &*domain()).unwrap();
            let point = ResumePoint::find(&directory, &owner).unwrap();
            let (mut log, checkpoint) = RunLog::resume(directory, point, owner, layouts()).unwrap();
            let mut fleet = in_process(domain(), config.clone(), Rc::new(Silent)).unwrap();
            let standing = checkpoint.map_or(TrainingProgress::default(), |checkpoint| {
                let standing = checkpoint.progress.standing;
                fleet.restore(checkpoint.agents).unwrap();
                standing
            });
            dials::train(&config, &mut fleet, standing, &mut log, observer)
        };
        // The first time there is no checkpoint, so the run begins.
        for _ in 1..periods {
            assert!(go_on(&Stop).unwrap_err().is::<Interrupted>());
        }
        go_on(&Silent).unwrap();
        for file in RESULTS {
            let [whole, stopped] = [&whole, &stopped].map(|dir| fs::read(dir.path().join(file)).ok());
            assert!(whole == stopped, "{simulator}: {file}");
        }
        assert_that_agents_of_other_kinds_are_refused(&config, stopped.path());
    }
}

/// Asserts that the states of a coin and of a die cannot change places in a checkpoint.
fn assert_that_agents_of_other_kinds_are_refused(config: &Config, dir: &Path) {
    let owner = Owner::of(&RunConfig::from(config.clone()), &*domain()).unwrap();
    let folder = Directory::open(&dir.join(files::CHECKPOINTS)).unwrap();
    let newest = || Checkpoint::read(&folder, checkpoint::list(&folder).unwrap().last().unwrap(), &owner);
    let Checkpoint { mut agents, progress } = newest().unwrap();
    agents.streams.swap(0, 1);
    checkpoint::write(&folder, &owner, &agents, progress).unwrap();
    let error = format!("{:#}", newest().unwrap_err());
    assert!(error.contains("cannot be resumed from") && error.contains(": agent "), "{error}");
}

#[test]
fn workers_that_share_the_agents_bring_what_one_worker_brings() {
    let config = short("dials");
    let period = Period { start: 0, end: 1000, train_aips: AipTraining::Yes, evaluate: false, average: false };
    let worker = |agents: Vec<AgentId>| Worker::new(domain(), &config, agents, &Threads::one());
    let mut whole = worker(AgentId::all(4));
    let purpose = dials_learn::steps::collect::Purpose::Training { steps: 0 };
    let policies = whole.state().policies;
    whole.take_policies(policies);
    let datasets = Collect { purpose, episodes: 0..10 }.run(&mut whole, &Silent).unwrap();
    let train_aips = |worker: &mut Worker, datasets: &[Dataset]| {
        TrainAips { datasets: datasets.to_vec(), period }.run(worker, &Silent).unwrap().0
    };
    let measure_aips = |worker: &mut Worker, datasets: &[Dataset]| {
        MeasureAips { datasets: datasets.to_vec() }.run(worker, &Silent).unwrap()
    };
    let train = |worker: &mut Worker, period| TrainPolicies { period, so_far: None }.run(worker, &Silent).unwrap().0;
    let losses = train_aips(&mut whole, &datasets);
    let training = train(&mut whole, period);

    // The second worker has agents of both kinds, the first worker of one kind.
    let mut parts = Vec::new();
    for agents in [0..1, 1..4] {
        let mut part = worker(agents.clone().map(AgentId).collect());
        assert_eq!(train_aips(&mut part, &datasets[agents.clone()]), losses[agents.clone()]);
        let measured = measure_aips(&mut part, &datasets[agents.clone()]);
        assert_eq!(measured, measure_aips(&mut whole, &datasets)[agents.clone()]);
        let of_part = train(&mut part, period);
        assert_eq!(of_part.agents, training.agents[agents.clone()]);
        let metrics = of_part.metrics.of_agents.iter().zip(&training.metrics.of_agents);
        metrics.for_each(|((name, part), (_, whole))| assert_eq!(*part, whole[agents.clone()], "{name}"));
        parts.push(part.state());
    }
    let joined = AgentsState::joined(parts);
    assert!(joined == whole.state());

    // Other workers continue from a state that they are given.
    let mut other = worker(AgentId::all(4));
    other.restore(&joined);
    assert!(other.state() == joined && other.aips() == joined.aips);
    let next = Period { start: 1000, end: 2000, ..period };
    let [one, two] = [&mut whole, &mut other].map(|worker| train(worker, next).agents);
    assert_eq!(one, two);
}

#[test]
fn the_costs_of_both_kinds_are_measured() {
    let config = RunConfig { learning: short("dials"), ..toml::from_str(TABLE).unwrap() };
    let (domain, short, dir) = (domain(), short_orders(&config, 1), tempfile::tempdir().unwrap());
    let layouts = Layouts::of(&config.learning, domain.kinds());
    let mut log = RunLog::begin(Directory::lock(dir.path()).unwrap(), Owner::of(&config, &*domain).unwrap(), layouts);
    let mut fleet = in_process(domain.clone(), short.clone(), Rc::new(Silent)).unwrap();
    let time = Duration::from_millis(100);
    let plan = MeasurePlan { config: &short, kinds: domain.kinds(), workers: 1, time, peak_flops: 1e9 };
    let measured = measure(&plan, &mut fleet, &mut log).unwrap();
    let steps = Steps { foreign: false, per_timestep: 1 };
    let costs = Costs::of(&config, domain.kinds(), steps, 1e9, &measured);
    assert!(costs.agent_steps_per_s() > 0.0 && costs.training.products > 0.0 && costs.aip_training.products > 0.0);
}
