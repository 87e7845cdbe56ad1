//! Workers that send what cannot be right.

use std::time::Duration;

use super::crew::{Fate, FateAt};
use super::{coins, crew, train, undisturbed};
use crate::fleet::message::WorkerReport;
use dials_core::base::{Activity, Ragged, Timesheet};
use dials_core::domain::Measures;
use dials_learn::algorithms::Metrics;
use dials_learn::evaluation::EpisodeReport;
use dials_learn::fleet::{Footprint, WorkerLoad};
use dials_learn::predictors::{Dataset, FreshLoss};
use dials_learn::state::AgentsState;
use dials_learn::steps::Reply;
use dials_learn::steps::train_policies::{AgentTraining, PolicyTraining};

/// Makes messages that no worker of two coins may send, whatever its order is.
pub(super) fn lies() -> Vec<WorkerReport> {
    let done =
        |reply, load| WorkerReport::Done { reply: Box::new(reply), load: Box::new(load), resident_kib: u64::MAX };
    let said = |reply| done(reply, WorkerLoad::default());
    let report = |returns: &[f64]| EpisodeReport { returns: returns.to_vec(), measures: Measures::default() };
    let agent = AgentTraining::default();
    let training = |agents: Vec<AgentTraining>| PolicyTraining {
        metrics: Metrics { of_agents: vec![("loss".to_owned(), vec![0.5; agents.len()])], settings: vec![] },
        agents,
        updates: 1,
        counters: vec![("cars".to_owned(), u64::MAX)],
    };
    let slow = WorkerLoad { timesheet: Timesheet::of_cpu(Duration::MAX), footprint: Footprint::default() };
    let large = Footprint { peak_rss_kib: u64::MAX, pss_kib: u64::MAX };
    let wide = Ragged::from_vec(vec![0.0; 3], [3]).unwrap();
    // Agent 1 after the first period. Each of these has the right sizes.
    let trained = |change: fn(&mut AgentsState)| {
        let mut state = undisturbed().1.0.expect("there is a first period").0.share([1]);
        change(&mut state);
        said(Reply::TrainPolicies((training(vec![agent]), state)))
    };
    vec![
        WorkerReport::Trained { steps: u64::MAX },
        WorkerReport::Busy { activity: Activity::Evaluation, share: f64::NAN },
        WorkerReport::Busy { activity: Activity::Collection, share: 1e300 },
        said(Reply::ReportState(AgentsState::nobody())),
        said(Reply::ReportState(AgentsState { steps: 7, policies: wide.clone(), ..AgentsState::nobody() })),
        said(Reply::Collect(vec![])),
        said(Reply::Collect(vec![Dataset::new(&coins().kinds().iter().next().unwrap().spec); 2])),
        said(Reply::TrainAips((vec![], wide))),
        said(Reply::MeasureAips(vec![FreshLoss { predictor: vec![], marginals: vec![0.1; 9] }])),
        said(Reply::TrainPolicies((training(vec![]), AgentsState::nobody()))),
        said(Reply::TrainPolicies((training(vec![agent]), AgentsState::nobody()))),
        said(Reply::Evaluate(vec![])),
        said(Reply::Evaluate(vec![report(&[0.5]); 2])),
        said(Reply::Evaluate(vec![report(&[0.5, f64::NAN]); 2])),
        done(Reply::Evaluate(vec![]), slow),
        done(Reply::Evaluate(vec![]), WorkerLoad { footprint: large, ..WorkerLoad::default() }),
        trained(|state| *state.learners.counts.get_mut("gradient_steps").unwrap() += 1),
        trained(|state| state.streams[0].rows[0].trail.sources.fill(200)),
    ]
}

#[test]
fn a_worker_that_says_what_cannot_be_right_is_replaced_and_the_numbers_stay() {
    let (expected, _) = undisturbed();
    // Every lie strikes at one of the orders. Three lies in a row would end the run.
    let numbers: Vec<usize> = (0..lies().len()).collect();
    for (index, numbers) in numbers.chunks(2).enumerate() {
        let at = [1, 3, 5, 6, 8, 9, 13][index % 7];
        // The worker in its place gets the same order at frame 2, or at frame 1 if there is no state yet.
        let fates: Vec<FateAt> = numbers.iter().zip([at, at.min(2)]).map(|(&lie, at)| (at, Fate::Lies(lie))).collect();
        let (outcome, warnings) = train(crew(true, [&[], &fates]));
        assert!(outcome.unwrap() == expected, "lies {numbers:?} at frame {at}");
        let warned = |warning: &String| warning.starts_with("worker 1 (agent 1) sent what cannot be right (");
        assert!(warnings.len() == 2 && warnings.iter().all(warned), "lies {numbers:?} at {at}: {warnings:?}");
    }
}

#[test]
fn a_state_to_which_training_does_not_lead_is_not_believed() {
    let last = lies().len() - 1;
    let lies = [(13, Fate::Lies(last - 1)), (2, Fate::Lies(last))];
    let (outcome, warnings) = train(crew(true, [&[], &lies]));
    assert!(outcome.unwrap() == undisturbed().0);
    assert_eq!(warnings.len(), 2, "{warnings:?}");
    for (warning, what) in
        warnings.iter().zip(["its count `gradient_steps` is", "an influence source has the value 200"])
    {
        assert!(warning.contains(what), "{warning}");
    }
}
