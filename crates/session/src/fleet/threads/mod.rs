//! Tests: workers that are threads of this process, and how the coordinator handles their loss.
//!
//! `crew`: the threads, and what becomes of them. `lies`: what no worker may say.

mod crew;
mod lies;

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Result;

use self::crew::{Fate, FateAt, ThreadCrew};
use super::bell::Bell;
use super::in_process;
use super::{Coordinator, MostGrowth, Options};
use crate::config::RunConfig;
use dials_core::base::Ragged;
use dials_core::domain::Domain;
use dials_learn::config::{AlgorithmName, Config, PolicyConfig, Simulator};
use dials_learn::dials;
use dials_learn::evaluation::Evaluation;
use dials_learn::fleet::Fleet;
use dials_learn::fleet::FleetLoad;
use dials_learn::observer::{Observer, Silent};
use dials_learn::observer::{Recorder, Unrecorded};
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

/// A journal that keeps the state after the first period.
#[derive(Default)]
struct Keeper(Option<(AgentsState, TrainingProgress)>);

impl Recorder for Keeper {
    fn period_done(
        &mut self,
        agents: &AgentsState,
        standing: &TrainingProgress,
        _training: &PolicyTraining,
        _load: FleetLoad,
    ) -> Result<()> {
        self.0.get_or_insert_with(|| (agents.clone(), *standing));
        Ok(())
    }
}

const PATIENCE: Duration = Duration::from_secs(3);
/// All threads are one process, so their growth means nothing.
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

fn moments(agents: &AgentsState) -> &Ragged<f32> {
    &agents.learners.numbers["second_moments"]
}

fn coins() -> Arc<dyn Domain> {
    Arc::new(Coins::new(20))
}

/// Returns what a single worker makes of the two agents, and their state after the first period.
fn undisturbed() -> (AgentsState, Keeper) {
    let (config, mut keeper) = (config(), Keeper::default());
    let mut fleet = in_process(coins(), config.clone(), Rc::new(Silent)).unwrap();
    dials::train(&config, &mut fleet, TrainingProgress::default(), &mut keeper, &Silent).unwrap();
    (fleet.agents().clone(), keeper)
}

/// Makes workers whose fates strike them in this order.
fn crew<const N: usize>(can_replace: bool, fates: [&[FateAt]; N]) -> ThreadCrew {
    let fates = fates.map(|fates| fates.iter().rev().copied().collect());
    ThreadCrew { domain: coins(), bell: Bell::new(), can_replace, fates: fates.to_vec(), most_growth: NEVER }
}

/// Trains with a crew. Returns the agents or the error, and the warnings.
fn train(crew: ThreadCrew) -> (Result<AgentsState, String>, Vec<String>) {
    train_as(&config(), crew)
}

fn train_as(config: &Config, crew: ThreadCrew) -> (Result<AgentsState, String>, Vec<String>) {
    let (domain, warnings) = (crew.domain.clone(), Rc::new(Warnings::default()));
    let (workers, most_growth) = (crew.fates.len(), crew.most_growth);
    let options = Options { workers, threads: workers, patience: PATIENCE, most_growth };
    let outcome =
        Coordinator::start(domain, &RunConfig::from(config.clone()), Box::new(crew), options, warnings.clone())
            .and_then(|mut fleet| {
                dials::train(config, &mut fleet, TrainingProgress::default(), &mut Unrecorded, &*warnings)?;
                Ok(fleet.agents().clone())
            });
    (outcome.map_err(|error| format!("{error:#}")), warnings.0.take())
}

// Frames of an owner: 0 begin, 1 its state, 2 and 3 policies and evaluation, 4 and 5 policies and measuring, 6 the
// AIPs' loss, 7 and 8 policies and datasets, 9 AIP training, 10 and 11 policies and measuring, 12 the AIPs' loss, 13
// training of policies. Frames of a replaced worker: 0 begin, 1 its state, 2 its order.

#[test]
fn any_number_of_workers_makes_what_a_single_one_makes() {
    let (expected, _) = undisturbed();
    assert!(train(crew(true, [&[]])).0.unwrap() == expected);
    // There are two agents, so worker 0 has none.
    let (outcome, warnings) = train(crew(false, [&[], &[], &[]]));
    assert!(outcome.unwrap() == expected && warnings.is_empty());
}

#[test]
fn a_lost_worker_is_replaced_and_the_numbers_stay() {
    let (outcome, warnings) = train(crew(true, [&[], &[(13, Fate::Dies), (2, Fate::Dies)]]));
    assert!(outcome.unwrap() == undisturbed().0);
    let warning = "worker 1 (agent 1) died: its thread ended\nstarted again from the last exchange";
    assert_eq!(warnings, [warning, warning]);
}

#[test]
fn a_worker_that_has_grown_is_replaced_and_the_numbers_stay() {
    let at_once = MostGrowth { kib: 0, share: 0.0 };
    // The second process, which the next evaluation starts, dies at it.
    let fates = [(usize::MAX, Fate::Dies), (3, Fate::Dies)];
    let (outcome, warnings) = train(ThreadCrew { most_growth: at_once, ..crew(true, [&[], &fates]) });
    assert!(outcome.unwrap() == undisturbed().0);
    assert_eq!(warnings.len(), 1, "{warnings:?}");
    let (outcome, warnings) = train(ThreadCrew { most_growth: at_once, ..crew(false, [&[], &fates]) });
    assert!(outcome.unwrap() == undisturbed().0 && warnings.is_empty());
}

#[test]
fn three_deaths_in_a_row_are_too_many() {
    let (outcome, warnings) = train(crew(true, [&[(13, Fate::Dies), (2, Fate::Dies), (2, Fate::Dies)], &[]]));
    let error = outcome.unwrap_err();
    assert_eq!(error, "worker 0 (agent 0) died: its thread ended\ngave up after 3 deaths in a row at the same place");
    assert_eq!(warnings.len(), 2);
}

#[test]
fn a_worker_that_hangs_is_replaced_after_the_patience() {
    let (outcome, warnings) = train(crew(true, [&[], &[(9, Fate::Hangs)]]));
    assert!(outcome.unwrap() == undisturbed().0);
    let warning = "worker 1 (agent 1) said nothing for 3s (state: unknown) and was ended; if it needs more time, --patience \
                   gives it; its thread is left alone";
    assert!(warnings.len() == 1 && warnings[0].starts_with(warning), "{warnings:?}");
}

#[test]
fn the_loss_of_a_worker_that_cannot_be_replaced_ends_the_run_and_names_it_and_its_agents() {
    let end = "\na worker of this kind cannot be started again, so the run ends here";
    for (fate, what) in [
        (Fate::Dies, "died: its thread ended"),
        (
            Fate::Hangs,
            "said nothing for 3s (state: unknown) and was ended; if it needs more time, --patience gives it; its thread \
             is left alone",
        ),
    ] {
        let (outcome, warnings) = train(crew(false, [&[], &[(13, fate)]]));
        assert_eq!(outcome.unwrap_err(), format!("worker 1 (agent 1) {what}{end}"));
        assert!(warnings.is_empty(), "{warnings:?}");
    }
    // A worker without agents only plays episodes, but its loss counts as any other.
    let (outcome, _) = train(crew(false, [&[(1, Fate::Dies)], &[], &[]]));
    assert_eq!(outcome.unwrap_err(), format!("worker 0 (no agents of its own) died: its thread ended{end}"));
}

#[test]
fn training_goes_on_from_a_state_with_workers_that_run_or_are_started_again() {
    let (expected, Keeper(kept)) = undisturbed();
    let (agents, standing) = kept.unwrap();
    assert_eq!((standing.until, agents.steps), (250, 256));
    for can_replace in [true, false] {
        let options = Options { workers: 2, threads: 2, patience: PATIENCE, most_growth: NEVER };
        let crew = crew(can_replace, [&[], &[]]);
        let mut fleet =
            Coordinator::start(coins(), &RunConfig::from(config()), Box::new(crew), options, Rc::new(Silent)).unwrap();
        fleet.restore(agents.clone()).unwrap();
        dials::train(&config(), &mut fleet, standing, &mut Unrecorded, &Silent).unwrap();
        assert!(*fleet.agents() == expected, "can_replace: {can_replace}");
    }
}

/// Counts evaluations.
#[derive(Default)]
struct Evaluations(usize);

impl Recorder for Evaluations {
    fn evaluated(&mut self, _agents: &AgentsState, _evaluation: &Evaluation) -> Result<()> {
        self.0 += 1;
        Ok(())
    }
}

#[test]
fn an_evaluation_that_was_made_is_not_made_again_when_a_period_begins_after_the_same_update() {
    let (agents, standing) = undisturbed().1.0.unwrap();
    for (evaluated_at, evaluations) in [(Some(256), 1), (Some(0), 2)] {
        let (standing, mut journal) = (TrainingProgress { evaluated_at, ..standing }, Evaluations::default());
        let mut fleet = in_process(coins(), config(), Rc::new(Silent)).unwrap();
        fleet.restore(agents.clone()).unwrap();
        dials::train(&config(), &mut fleet, standing, &mut journal, &Silent).unwrap();
        assert_eq!(journal.0, evaluations, "evaluated at {evaluated_at:?}, and once at the end");
    }
}

#[test]
fn agents_of_two_kinds_that_take_turns_are_shared_out_and_put_together_again() {
    let domain: Arc<dyn Domain> = Arc::new(CoinsAndDice::new(20));
    for simulator in [Simulator::Local, Simulator::Global] {
        let config = Config { simulator, ..config() };
        let mut alone = in_process(domain.clone(), config.clone(), Rc::new(Silent)).unwrap();
        dials::train(&config, &mut alone, TrainingProgress::default(), &mut Unrecorded, &Silent).unwrap();
        let lost: [&[FateAt]; 3] = [&[], &[(2, Fate::Dies)], &[]];
        for crew in [crew(true, [&[]]), crew(false, [&[], &[]]), crew(false, [&[], &[], &[]]), crew(true, lost)] {
            let workers = crew.fates.len();
            let (outcome, _) = train_as(&config, ThreadCrew { domain: domain.clone(), ..crew });
            assert!(outcome.unwrap() == *alone.agents(), "{simulator:?}, {workers} workers");
        }
    }
}

/// Makes configs with an imitation: coins without memory, and coins and dice with one and with critics of their own.
fn imitating() -> [(Arc<dyn Domain>, Config); 2] {
    let mut coins_config = config();
    coins_config.policy.imitate = Some("copy".to_owned());
    let imitation = &mut coins_config.imitation;
    (imitation.dataset_steps, imitation.minibatch, imitation.epochs, imitation.critic_steps) = (100, 16, 2, 300);
    let mut of_both = coins_config.clone();
    of_both.policy.imitate = Some("best".to_owned());
    (of_both.policy.recurrent, of_both.policy.separate_critic) = (Some(5), true);
    (of_both.imitation.minibatch, of_both.ppo.rollout_steps) = (2, 16);
    [(coins(), coins_config), (Arc::new(CoinsAndDice::new(20)), of_both)]
}

fn trained_alone(domain: &Arc<dyn Domain>, config: &Config) -> (AgentsState, Keeper) {
    let mut keeper = Keeper::default();
    let mut fleet = in_process(domain.clone(), config.clone(), Rc::new(Silent)).unwrap();
    dials::train(config, &mut fleet, TrainingProgress::default(), &mut keeper, &Silent).unwrap();
    (fleet.agents().clone(), keeper)
}

// With an imitation, an owner's frame 2 is its share of the episodes and frame 3 the imitation.

#[test]
fn an_imitation_is_the_same_for_any_number_of_workers_and_through_deaths() {
    for (domain, config) in imitating() {
        let (expected, _) = trained_alone(&domain, &config);
        let without = Config { policy: PolicyConfig { imitate: None, ..config.policy.clone() }, ..config.clone() };
        assert!(trained_alone(&domain, &without).0.policies != expected.policies);
        let lost: [&[FateAt]; 2] = [&[(3, Fate::Dies), (2, Fate::Dies)], &[(2, Fate::Dies)]];
        for crew in [crew(true, [&[]]), crew(false, [&[], &[]]), crew(false, [&[], &[], &[]]), crew(true, lost)] {
            let (workers, deaths) = (crew.fates.len(), crew.fates.iter().map(Vec::len).sum::<usize>());
            let (outcome, warnings) = train_as(&config, ThreadCrew { domain: domain.clone(), ..crew });
            assert!(outcome.unwrap() == expected, "{workers} workers");
            assert_eq!(warnings.len(), deaths, "{warnings:?}");
        }
    }
}

#[test]
fn a_run_that_imitated_goes_on_from_a_state_without_imitating_again() {
    for (domain, config) in imitating() {
        let (expected, Keeper(kept)) = trained_alone(&domain, &config);
        // At 256 steps, when the critic has learnt alone for a while and has not finished.
        let (agents, standing) = kept.unwrap();
        let mut fleet = in_process(domain.clone(), config.clone(), Rc::new(Silent)).unwrap();
        fleet.restore(agents).unwrap();
        dials::train(&config, &mut fleet, standing, &mut Unrecorded, &Silent).unwrap();
        assert!(*fleet.agents() == expected);
    }
}

#[test]
fn agents_of_a_kind_that_share_a_policy_have_the_same_one_for_any_number_of_workers() {
    let domain: Arc<dyn Domain> = Arc::new(CoinsAndDice::new(20));
    let mut config = Config { simulator: Simulator::Global, ..config() };
    let (alone, _) = trained_alone(&domain, &config);
    assert!(alone.policies.row(0) != alone.policies.row(2));
    config.gs.shared_policy = true;
    let (agents, Keeper(kept)) = trained_alone(&domain, &config);
    for [one, other] in [[0, 2], [1, 3]] {
        assert_eq!(agents.policies.row(one), agents.policies.row(other));
        assert_eq!(moments(&agents).row(one), moments(&agents).row(other));
    }
    for crew in [crew(true, [&[]]), crew(false, [&[], &[]])] {
        assert!(train_as(&config, ThreadCrew { domain: domain.clone(), ..crew }).0.unwrap() == agents);
    }
    let (half, standing) = kept.unwrap();
    let mut fleet = in_process(domain, config.clone(), Rc::new(Silent)).unwrap();
    fleet.restore(half).unwrap();
    dials::train(&config, &mut fleet, standing, &mut Unrecorded, &Silent).unwrap();
    assert!(*fleet.agents() == agents);
    // Local simulators know nothing of it.
    let local = Config { simulator: Simulator::default(), ..config };
    assert!(trained_alone(&coins(), &local).0 == undisturbed().0);
}

#[test]
fn agents_that_get_the_mean_of_their_policies_are_the_same_for_any_number_of_workers_and_through_deaths() {
    let domain: Arc<dyn Domain> = Arc::new(CoinsAndDice::new(20));
    for simulator in [Simulator::Local, Simulator::Global] {
        let mut config = Config { simulator, ..config() };
        config.policy.average_every_steps = Some(200);
        let (agents, Keeper(kept)) = trained_alone(&domain, &config);
        for [one, other] in [[0, 2], [1, 3]] {
            assert_eq!(agents.policies.row(one), agents.policies.row(other));
            assert_eq!(moments(&agents).row(one), moments(&agents).row(other));
        }
        assert!(agents.streams[0].rows[0].trail != agents.streams[2].rows[0].trail);
        let lost: [&[FateAt]; 3] = [&[(5, Fate::Dies)], &[(2, Fate::Dies)], &[]];
        for crew in [crew(true, [&[]]), crew(false, [&[], &[]]), crew(false, [&[], &[], &[]]), crew(true, lost)] {
            let workers = crew.fates.len();
            let (outcome, _) = train_as(&config, ThreadCrew { domain: domain.clone(), ..crew });
            assert!(outcome.unwrap() == agents, "{simulator:?}, {workers} workers");
        }
        let (half, standing) = kept.unwrap();
        assert!(half.policies.row(0) == half.policies.row(2), "{simulator:?}: averaged at step 256");
        let mut fleet = in_process(domain.clone(), config.clone(), Rc::new(Silent)).unwrap();
        fleet.restore(half).unwrap();
        dials::train(&config, &mut fleet, standing, &mut Unrecorded, &Silent).unwrap();
        assert!(*fleet.agents() == agents, "{simulator:?}");
    }
}

#[test]
fn dqn_is_the_same_for_any_number_of_workers_and_goes_on_from_a_state() {
    let domain: Arc<dyn Domain> = Arc::new(CoinsAndDice::new(20));
    for (simulator, prioritised) in [(Simulator::Local, true), (Simulator::Global, false)] {
        let mut config = Config { simulator, algorithm: AlgorithmName::Dqn, ..config() };
        let dqn = &mut config.dqn;
        // The replay is full, and begins again, in the second period.
        (dqn.replay, dqn.learning_starts, dqn.minibatch, dqn.prioritised) = (300, 32, 16, prioritised);
        let (expected, Keeper(kept)) = trained_alone(&domain, &config);
        let lost: [&[FateAt]; 3] = [&[], &[(2, Fate::Dies)], &[]];
        for crew in [crew(false, [&[], &[]]), crew(true, lost)] {
            let workers = crew.fates.len();
            let (outcome, _) = train_as(&config, ThreadCrew { domain: domain.clone(), ..crew });
            assert!(outcome.unwrap() == expected, "{simulator:?}, {workers} workers");
        }
        let (half, standing) = kept.unwrap();
        let mut fleet = in_process(domain.clone(), config.clone(), Rc::new(Silent)).unwrap();
        fleet.restore(half).unwrap();
        dials::train(&config, &mut fleet, standing, &mut Unrecorded, &Silent).unwrap();
        assert!(*fleet.agents() == expected, "{simulator:?}");
    }
}
