//! DIALS end to end on two coupled coins, for which every answer is known.

use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use dials_core::domain::{Domain, Result};
use dials_core::outside::Directory;
use dials_learn::config::{AlgorithmName, Config, Share, ShortForm};
use dials_learn::dials;
use dials_learn::observer::Silent;
use dials_learn::progress::TrainingProgress;
use dials_session::config::RunConfig;
use dials_session::fleet::in_process;
use dials_session::records::checkpoint::owner::Owner;
use dials_session::records::files;
use dials_session::records::networks::Layouts;
use dials_session::records::run_log::RunLog;
use dials_testkit::toy::Coins;

const HORIZON: usize = 50;

/// Makes a config. Gamma is small because rewards follow at once: long returns would hide them in the shared hidden
/// layer.
fn config(simulator: &str) -> Config {
    let keys = ShortForm::called(simulator).unwrap().keys();
    toml::from_str(&format!(
        "{keys}seed = 3\ntotal_steps = 30000\n\
         local_simulators = {{ copies = 4, stagger = true }}\n\
         policy = {{ hidden = [16] }}\n\
         ppo = {{ time_limit = 'bootstrap', learning_rate = 3e-3, gamma = 0.5 }}\n\
         aip = {{ hidden = [16], retrain_every_steps = 15000, dataset_steps = 5000, epochs = 20, learning_rate = 3e-3 }}\n\
         evaluation = {{ every_steps = 10000, episodes = 10, aip_loss_episodes = 40 }}"
    ))
    .unwrap()
}

fn train(config: &Config, dir: &Path) -> Result<()> {
    let coins: Arc<dyn Domain> = Arc::new(Coins::new(HORIZON));
    let (owner, layouts) = (Owner::of(&RunConfig::from(config.clone()), &*coins)?, Layouts::of(config, coins.kinds()));
    let mut fleet = in_process(coins, config.clone(), Rc::new(Silent)).unwrap();
    let mut log = RunLog::begin(Directory::lock(dir)?, owner, layouts);
    dials::train(config, &mut fleet, TrainingProgress::default(), &mut log, &Silent)
}

/// Returns the column `name` of the lines about all agents, by steps.
fn column(dir: &Path, file: &str, name: &str) -> Vec<(u64, f64)> {
    let mut reader = csv::Reader::from_path(dir.join(file)).unwrap();
    let index = reader.headers().unwrap().iter().position(|header| header == name).unwrap();
    let lines = reader.records().map(|record| record.unwrap()).filter(|record| &record[1] == "all");
    lines.map(|record| (record[0].parse().unwrap(), record[index].parse().unwrap())).collect()
}

#[test]
fn all_four_simulators_teach_the_coins_to_copy() {
    for simulator in ["dials", "gs", "untrained-dials", "marginal-dials"] {
        let dir = tempfile::tempdir().unwrap();
        train(&config(simulator), dir.path()).unwrap();
        let returns = column(dir.path(), files::RETURNS, "mean");
        // Evaluations at 0, 10000, 20000 and the end, each at the first multiple of the memory (128).
        assert_eq!(returns.iter().map(|&(steps, _)| steps).collect::<Vec<_>>(), [0, 10_112, 20_096, 30_080]);
        assert!(returns[0].1 < 0.75 * HORIZON as f64, "{simulator}: {returns:?}");
        assert!(returns[3].1 > 0.97 * HORIZON as f64, "{simulator}: {returns:?}");
        let trained = ["dials", "marginal-dials"].contains(&simulator);
        assert_eq!(dir.path().join(files::AIP_LOSS).exists(), trained);
        assert_eq!(dir.path().join(files::AIP_DRIFT).exists(), simulator != "gs", "on the GS nothing is predicted");
    }
}

#[test]
fn dqn_teaches_the_coins_to_copy_with_each_of_its_variants() {
    for (simulator, double, dueling, prioritised) in [
        ("dials", true, true, false),
        ("gs", true, true, false),
        ("dials", false, false, false),
        ("dials", true, true, true),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let mut config = config(simulator);
        config.algorithm = AlgorithmName::Dqn;
        let dqn = &mut config.dqn;
        (dqn.double, dqn.dueling, dqn.prioritised) = (double, dueling, prioritised);
        (dqn.gamma, dqn.learning_rate, dqn.epsilon_steps) = (0.5, 3e-3, 10_000);
        train(&config, dir.path()).unwrap();
        let variant = format!("{simulator}, double {double}, dueling {dueling}, prioritised {prioritised}");
        let returns = column(dir.path(), files::RETURNS, "mean");
        // An untrained network is greedy already, and by chance does right in most states.
        assert!(returns[0].1 < 0.9 * HORIZON as f64, "{variant}: {returns:?}");
        assert!(returns[3].1 > 0.97 * HORIZON as f64, "{variant}: {returns:?}");
        let (steps, epsilon) = *column(dir.path(), files::TRAINING, "epsilon").last().unwrap();
        assert!(steps == 30_000 && (epsilon - 0.02).abs() < 1e-12, "{variant}: {epsilon} at {steps}");
    }
}

#[test]
fn a_critic_of_its_own_one_policy_for_all_and_means_of_policies_learn_the_coins_too() {
    for (simulator, setting) in [
        ("dials", "separate critic"),
        ("gs", "shared policy"),
        ("dials", "means of policies"),
        ("gs", "means of policies"),
    ] {
        let dir = tempfile::tempdir().unwrap();
        let mut config = config(simulator);
        config.policy.separate_critic = setting == "separate critic";
        config.policy.share = if setting == "shared policy" { Share::Kind } else { Share::None };
        config.policy.average_every_steps = (setting == "means of policies").then_some(1000);
        train(&config, dir.path()).unwrap();
        let returns = column(dir.path(), files::RETURNS, "mean");
        assert!(returns[0].1 < 0.75 * HORIZON as f64, "{setting}: {returns:?}");
        assert!(returns[3].1 > 0.97 * HORIZON as f64, "{setting}: {returns:?}");
        let bytes = std::fs::read(dir.path().join(files::POLICIES)).unwrap();
        let saved = safetensors::SafeTensors::deserialize(&bytes).unwrap();
        assert_eq!(saved.tensor("critic.layers.0.weight").is_ok(), config.policy.separate_critic);
        let weights = saved.tensor("layers.0.weight").unwrap();
        let (one, other) = weights.data().split_at(weights.data().len() / 2);
        assert_eq!(one == other, setting != "separate critic", "{setting}: the policies of the two agents");
    }
}

#[test]
fn policies_that_imitate_begin_with_the_return_of_the_controller_and_keep_it_while_the_critic_learns() {
    for simulator in ["dials", "gs"] {
        let dir = tempfile::tempdir().unwrap();
        let mut config = config(simulator);
        config.policy.imitate = Some("copy".to_owned());
        config.imitation.dataset_steps = 5000;
        config.imitation.minibatch = 32;
        config.imitation.learning_rate = 2e-3;
        config.imitation.critic_steps = 10_000;
        train(&config, dir.path()).unwrap();
        let returns = column(dir.path(), files::RETURNS, "mean");
        assert!(returns.iter().all(|&(_, mean)| mean > 0.97 * HORIZON as f64), "{simulator}: {returns:?}");
        assert_eq!(returns[0].1, returns[1].1, "{simulator}: at 10112 steps only the critic has learnt");
        let rates = column(dir.path(), files::TRAINING, "learning_rate");
        assert!(rates[0].1 == 2e-3 && rates[1].1 < 1.6e-3, "{simulator}: {rates:?}");
        for (name, least, most) in [("accuracy_before", 0.2, 0.8), ("accuracy_after", 0.99, 1.0)] {
            let [(0, accuracy)] = column(dir.path(), files::IMITATION, name)[..] else { panic!("one line for all") };
            assert!((least..=most).contains(&accuracy), "{name} {accuracy}");
        }
        // Rewards are near 1, gamma is 0.5: all values are near 2, and the loss of a new critic is near 4.
        let losses = column(dir.path(), files::TRAINING, "value_loss");
        assert!(losses[0].1 < 0.5 && losses[1].1 < 0.05, "{simulator}: {losses:?}");
    }
}

#[test]
fn the_aips_learn_the_closed_form_influence_of_coins_that_copy() {
    let dir = tempfile::tempdir().unwrap();
    train(&config("dials"), dir.path()).unwrap();
    let losses = column(dir.path(), files::AIP_LOSS, "training_after");
    // Trained at 0 and again at 15000, when the coins nearly copy: H(0.32) = 0.6269.
    assert_eq!(losses.len(), 2);
    assert!((losses[1].1 - 0.6269).abs() < 0.02, "{losses:?}");
}

#[test]
fn the_loss_on_fresh_episodes_is_that_of_the_closed_form() {
    let dir = tempfile::tempdir().unwrap();
    train(&config("dials"), dir.path()).unwrap();
    let [losses, marginals] = ["loss", "marginals"].map(|name| column(dir.path(), files::AIP_DRIFT, name));
    // At 0 before and after the training, at 10000 and 20000, after the training at 15000 (not evaluated), at the end.
    let steps: Vec<u64> = losses.iter().map(|&(steps, _)| steps).collect();
    assert_eq!(steps, [0, 0, 10_112, 15_104, 20_096, 30_080]);
    // The coins copy in the end: H(0.32) = 0.6269 and ln 2 = 0.6931. 40 x 50 x 2 samples: standard error 0.35 /
    // sqrt(4000) = 0.006. The best constants lose at most ln 2, and less if a coin is not quite fair: H(0.58) = 0.6803.
    let (last, constant) = (losses[5].1, marginals[5].1);
    assert!((last - 0.6269).abs() < 0.025, "{losses:?}");
    assert!((0.6803..=2_f64.ln()).contains(&constant), "{marginals:?}");
}

#[test]
fn the_marginals_of_the_coins_are_those_of_a_fair_coin() {
    let dir = tempfile::tempdir().unwrap();
    train(&config("marginal-dials"), dir.path()).unwrap();
    for name in ["training_after", "held_out_after", "held_out_marginals"] {
        // At 15000 the coins copy, and noise turns them to 0 as often as to 1: ln 2 = 0.6931, while AIPs reach 0.6269.
        let losses = column(dir.path(), files::AIP_LOSS, name);
        assert!(losses.len() == 2 && (losses[1].1 - 2_f64.ln()).abs() < 0.01, "{name} {losses:?}");
    }
}

#[test]
fn the_same_seed_gives_the_same_files_and_another_one_others() {
    let run = |seed: u64| {
        let dir = tempfile::tempdir().unwrap();
        let config = Config { seed, total_steps: 3000, ..config("dials") };
        train(&config, dir.path()).unwrap();
        [files::RETURNS, files::AIP_LOSS, files::TRAINING, files::POLICIES, files::AIPS]
            .map(|file| std::fs::read(dir.path().join(file)).unwrap())
    };
    let first = run(3);
    assert!(first == run(3));
    assert!(first.iter().zip(run(4)).all(|(one, other)| *one != other));
}

#[test]
fn learning_rate_and_clip_decay_over_the_total_steps_also_where_a_run_stops_early() {
    for stop_at_steps in [None, Some(10_000)] {
        let dir = tempfile::tempdir().unwrap();
        train(&Config { stop_at_steps, ..config("dials") }, dir.path()).unwrap();
        let rates = column(dir.path(), files::TRAINING, "learning_rate");
        let clips = column(dir.path(), files::TRAINING, "clip");
        // Periods end at 10000, 15000, 20000 and 30000, each at the next multiple of 128; the last update before that
        // began 128 steps earlier: 9984, 14976, 19968 and 29952 of the total 30000.
        let last_updates = [9984.0, 14_976.0, 19_968.0, 29_952.0];
        assert_eq!(rates.len(), if stop_at_steps.is_some() { 1 } else { 4 });
        for ((rate, clip), at) in rates.iter().zip(&clips).zip(last_updates) {
            let left = 1.0 - at / 30_000.0;
            // 3e-3 falls to 1e-10 and 0.1 to 1e-5.
            assert!((rate.1 - (3e-3 * left + 1e-10 * (1.0 - left))).abs() < 1e-12, "{rate:?}");
            assert!((clip.1 - (0.1 * left + 1e-5 * (1.0 - left))).abs() < 1e-12, "{clip:?}");
        }
    }
}

#[test]
fn a_period_that_the_last_update_has_passed_trains_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let mut config = Config { stop_at_steps: Some(3000), ..config("dials") };
    // The update that ends at 1024 passes both 1000 and 1010.
    (config.evaluation.every_steps, config.aip.retrain_every_steps) = (1000, 1010);
    train(&config, dir.path()).unwrap();
    let steps = |file: &str, name: &str| -> Vec<u64> {
        column(dir.path(), file, name).into_iter().map(|(steps, _)| steps).collect()
    };
    assert_eq!(steps(files::TRAINING, "value_loss"), [1024, 2048, 3072]);
    assert_eq!(steps(files::RETURNS, "mean"), [0, 1024, 2048, 3072]);
    assert_eq!(steps(files::AIP_LOSS, "held_out_after"), [0, 1024, 2048]);
    assert!(column(dir.path(), files::TRAINING, "value_loss").iter().all(|&(_, loss)| loss > 0.0));
}

#[test]
fn learning_that_diverges_ends_the_run_and_says_what_to_do() {
    let dir = tempfile::tempdir().unwrap();
    let mut config = config("gs");
    config.ppo.learning_rate = 1e30;
    let error = train(&config, dir.path()).unwrap_err().to_string();
    assert!(error.contains("its policy diverged before step 10112") && error.contains("ppo.learning_rate"), "{error}");
    assert!(!dir.path().join(files::POLICIES).exists());
}
