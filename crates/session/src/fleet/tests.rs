//! Tests of the coordinator: workers in this process, and how it handles their loss.
//!
//! `crew`: the workers, and what becomes of them. `lies`: what no worker may say.

mod crew;
mod lies;

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::rc::Rc;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

use anyhow::Result;

use self::crew::{Fate, FateAt, TestCrew};
use super::{Coordinator, MostGrowth, Options, in_process};
use crate::config::RunConfig;
use dials_core::domain::Domain;
use dials_learn::config::{AlgorithmName, Config, PolicyConfig, Share, Simulator};
use dials_learn::dials;
use dials_learn::fleet::{Fleet, FleetLoad};
use dials_learn::observer::{Observer, Recorder, Silent, Unrecorded};
use dials_learn::progress::TrainingProgress;
use dials_learn::state::AgentsState;
use dials_learn::steps::train_policies::PolicyTraining;
use dials_testkit::toy::{Coins, CoinsAndDice};

/// An observer that keeps the warnings.
#[derive(Default)]
struct Warnings(RefCell<Vec<String>>);

impl Observer for Warnings {
    fn worker_lost(&self, message: &str) {
        self.0.borrow_mut().push(message.to_owned());
    }
}

/// A recorder that keeps the state after the first period.
#[derive(Clone, Default)]
struct Keeper(Option<(AgentsState, TrainingProgress)>);

impl Recorder for Keeper {
    fn period_done(
        &mut self,
        agents: &AgentsState,
        standing: &TrainingProgress,
        _training: &PolicyTraining,
        _load: FleetLoad,
    ) -> Result<()> {
        self.0.get_or_insert_with(|| (agents.clone(), standing.clone()));
        Ok(())
    }
}

const PATIENCE: Duration = Duration::from_secs(3);
/// All workers are one process, so their growth means nothing.
const NEVER: MostGrowth = MostGrowth { kib: u64::MAX, share: 0.0 };

/// Makes a config of two periods, with a training of the AIPs before each.
fn config() -> Config {
    toml::from_str(
        "total_steps = 500\n\
         local_simulators = { copies = 2, stagger = true }\n\
         policy = { hidden = [8] }\n\
         ppo = { time_limit = 'bootstrap' }\n\
         aip = { hidden = [4], retrain_every_steps = 250, dataset_steps = 100, batch = 16, epochs = 2 }\n\
         evaluation = { every_steps = 250, episodes = 3, aip_loss_episodes = 2 }",
    )
    .unwrap()
}

fn coins() -> Arc<dyn Domain> {
    Arc::new(Coins::new(20))
}

/// Returns what a single worker makes of all agents, and their state after the first period.
fn trained_alone(domain: &Arc<dyn Domain>, config: &Config) -> (AgentsState, Keeper) {
    let mut keeper = Keeper::default();
    let mut fleet = in_process(domain.clone(), config.clone(), Rc::new(Silent)).unwrap();
    dials::train(config, &mut fleet, TrainingProgress::default(), &mut keeper, &Silent).unwrap();
    (fleet.agents().clone(), keeper)
}

fn undisturbed() -> (AgentsState, Keeper) {
    static ONCE: LazyLock<(AgentsState, Keeper)> = LazyLock::new(|| trained_alone(&coins(), &config()));
    ONCE.clone()
}

/// Makes workers whose fates strike them in this order.
fn crew<const N: usize>(can_replace: bool, fates: [&[FateAt]; N]) -> TestCrew {
    let fates = fates.map(|fates| fates.iter().rev().copied().collect());
    TestCrew { domain: coins(), can_replace, fates: fates.to_vec(), most_growth: NEVER, running: BTreeMap::new() }
}

fn train(crew: TestCrew) -> (Result<AgentsState, String>, Vec<String>) {
    train_as(&config(), crew)
}

fn train_as(config: &Config, crew: TestCrew) -> (Result<AgentsState, String>, Vec<String>) {
    let (domain, warnings) = (crew.domain.clone(), Rc::new(Warnings::default()));
    let (workers, most_growth) = (crew.fates.len(), crew.most_growth);
    let options = Options { workers, threads: workers, patience: PATIENCE, most_growth, prepared: None };
    let outcome =
        Coordinator::start(domain, &RunConfig::from(config.clone()), Box::new(crew), options, warnings.clone())
            .and_then(|mut fleet| {
                dials::train(config, &mut fleet, TrainingProgress::default(), &mut Unrecorded, &*warnings)?;
                Ok(fleet.agents().clone())
            });
    (outcome.map_err(|error| format!("{error:#}")), warnings.0.take())
}

/// Trains alone, with several crews, through deaths, and from the state after the first period: the same agents.
fn same_for_any_fleet(domain: &Arc<dyn Domain>, config: &Config, deaths: [&[usize]; 3]) -> (AgentsState, AgentsState) {
    let (expected, kept) = trained_alone(domain, config);
    let of_worker = |frames: &[usize]| frames.iter().map(|&frame| (frame, Fate::Dies)).collect::<Vec<FateAt>>();
    let [a, b, c] = deaths.map(of_worker);
    for crew in [crew(true, [&[]]), crew(false, [&[], &[]]), crew(false, [&[], &[], &[]]), crew(true, [&a, &b, &c])] {
        let workers = crew.fates.len();
        let deaths: usize = crew.fates.iter().map(Vec::len).sum();
        let (outcome, warnings) = train_as(config, TestCrew { domain: domain.clone(), ..crew });
        assert!(outcome.unwrap() == expected, "{:?}: {workers} workers, {deaths} deaths", config.simulator);
        let end = "died: it is this process\nstarted again from the last exchange";
        assert!(warnings.len() == deaths && warnings.iter().all(|warning| warning.ends_with(end)), "{warnings:?}");
    }
    let (half, standing) = kept.0.unwrap();
    // Workers that can be replaced are started again, others take the state.
    for can_replace in [true, false] {
        let options = Options { workers: 2, threads: 2, patience: PATIENCE, most_growth: NEVER, prepared: None };
        let crew = Box::new(TestCrew { domain: domain.clone(), ..crew(can_replace, [&[], &[]]) });
        let run_config = RunConfig::from(config.clone());
        let mut fleet = Coordinator::start(domain.clone(), &run_config, crew, options, Rc::new(Silent)).unwrap();
        fleet.restore(half.clone()).unwrap();
        dials::train(config, &mut fleet, standing.clone(), &mut Unrecorded, &Silent).unwrap();
        assert!(*fleet.agents() == expected, "{:?}: from the state after the first period", config.simulator);
    }
    (expected, half)
}

// Frames of an owner: 0 begin, 1 its state, 2 and 3 policies and evaluation, 4 and 5 policies and measuring, 6 the
// AIPs' loss, 7 and 8 policies and datasets, 9 AIP training, 10 and 11 policies and measuring, 12 the AIPs' loss, 13
// training of policies. Frames of a replaced worker: 0 begin, 1 its state, 2 its order.

#[test]
fn a_worker_that_has_grown_is_replaced_and_the_numbers_stay() {
    let at_once = MostGrowth { kib: 0, share: 0.0 };
    // The second process, which the next evaluation starts, dies at it.
    let fates = [(usize::MAX, Fate::Dies), (3, Fate::Dies)];
    let (outcome, warnings) = train(TestCrew { most_growth: at_once, ..crew(true, [&[], &fates]) });
    assert!(outcome.unwrap() == undisturbed().0);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let (outcome, warnings) = train(TestCrew { most_growth: at_once, ..crew(false, [&[], &fates]) });
    assert!(outcome.unwrap() == undisturbed().0 && warnings.is_empty());
}

#[test]
fn the_loss_of_a_worker_that_cannot_be_replaced_ends_the_run_and_names_it_and_its_agents() {
    let end = "\na worker of this kind cannot be started again, so the run ends here";
    let silent = "said nothing for 3s (state: unknown) and was ended; if it needs more time, --patience gives it; it \
                  is this process";
    for (fate, what) in [(Fate::Dies, "died: it is this process"), (Fate::Hangs, silent)] {
        let (outcome, warnings) = train(crew(false, [&[], &[(13, fate)]]));
        assert_eq!(outcome.unwrap_err(), format!("worker 1 (agent 1) {what}{end}"));
        assert!(warnings.is_empty(), "{warnings:?}");
    }
    // A worker without agents only plays episodes, but its loss counts as any other.
    let (outcome, _) = train(crew(false, [&[(1, Fate::Dies)], &[], &[]]));
    assert_eq!(outcome.unwrap_err(), format!("worker 0 (no agents of its own) died: it is this process{end}"));
}

/// Two kinds of agents that take turns.
fn coins_and_dice() -> Arc<dyn Domain> {
    Arc::new(CoinsAndDice::new(20))
}

#[test]
fn agents_of_one_kind_and_of_two_that_take_turns_are_shared_out_and_put_together_again() {
    same_for_any_fleet(&coins(), &config(), [&[], &[], &[13, 2]]);
    for simulator in [Simulator::Local, Simulator::Global] {
        same_for_any_fleet(&coins_and_dice(), &Config { simulator, ..config() }, [&[], &[2], &[]]);
    }
}

#[test]
fn an_imitation_is_the_same_for_any_fleet_and_is_not_made_again_on_a_resume() {
    let mut of_coins = config();
    of_coins.policy.imitate = Some("copy".to_owned());
    let imitation = &mut of_coins.imitation;
    // At 256 steps the critic has learnt alone for a while and has not finished.
    (imitation.dataset_steps, imitation.minibatch, imitation.epochs, imitation.critic_steps) = (100, 16, 2, 300);
    // With memory and with critics of their own.
    let mut of_both = of_coins.clone();
    of_both.policy.imitate = Some("best".to_owned());
    (of_both.policy.recurrent, of_both.policy.separate_critic) = (Some(5), true);
    (of_both.imitation.minibatch, of_both.ppo.rollout_steps) = (2, 16);
    for (domain, config) in [(coins(), of_coins), (coins_and_dice(), of_both)] {
        // An owner's frame 2 is its share of the episodes, and frame 3 the imitation.
        let (agents, _) = same_for_any_fleet(&domain, &config, [&[], &[3, 2], &[2]]);
        let without = Config { policy: PolicyConfig { imitate: None, ..config.policy.clone() }, ..config };
        assert!(trained_alone(&domain, &without).0.policies != agents.policies);
    }
}

fn assert_that_kinds_have_one_policy(agents: &AgentsState) {
    let moments = &agents.learners.numbers["second_moments"];
    for [one, other] in [[0, 2], [1, 3]] {
        assert_eq!(agents.policies.row(one), agents.policies.row(other));
        assert_eq!(moments.row(one), moments.row(other));
    }
}

#[test]
fn agents_of_a_kind_that_share_a_policy_have_the_same_one_for_any_fleet() {
    for simulator in [Simulator::Local, Simulator::Global] {
        let mut config = Config { simulator, ..config() };
        let (alone, _) = trained_alone(&coins_and_dice(), &config);
        assert!(alone.policies.row(0) != alone.policies.row(2));
        config.policy.share = Share::Kind;
        let (agents, _) = same_for_any_fleet(&coins_and_dice(), &config, [&[], &[2], &[]]);
        assert_that_kinds_have_one_policy(&agents);
    }
}

#[test]
fn agents_that_get_the_mean_of_their_policies_are_the_same_for_any_fleet() {
    for simulator in [Simulator::Local, Simulator::Global] {
        let mut config = Config { simulator, ..config() };
        config.policy.average_every_steps = Some(200);
        let (agents, half) = same_for_any_fleet(&coins_and_dice(), &config, [&[5], &[2], &[]]);
        assert_that_kinds_have_one_policy(&agents);
        assert!(agents.streams[0].rows[0].trail != agents.streams[2].rows[0].trail);
        assert!(half.policies.row(0) == half.policies.row(2), "{simulator:?}: averaged at step 256");
    }
}

#[test]
fn dqn_is_the_same_for_any_fleet_and_goes_on_from_a_state() {
    for (simulator, prioritised) in [(Simulator::Local, true), (Simulator::Global, false)] {
        let mut config = Config { simulator, algorithm: AlgorithmName::Dqn, ..config() };
        let dqn = &mut config.dqn;
        // The replay is full, and begins again, in the second period.
        (dqn.replay, dqn.learning_starts, dqn.minibatch, dqn.prioritised) = (300, 32, 16, prioritised);
        same_for_any_fleet(&coins_and_dice(), &config, [&[], &[2], &[]]);
    }
}
