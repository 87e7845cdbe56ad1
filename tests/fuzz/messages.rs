//! What coordinator and workers say to each other.

use anyhow::Result;
use dials_core::base::{AgentId, Ragged, Seed};
use dials_learn::algorithms::Tables;
use dials_learn::fleet::WorkerLoad;
use dials_learn::state::AgentsState;
use dials_learn::state::stream::{AgentStream, RowStream, Trail};
use dials_learn::steps::evaluate::Evaluate;
use dials_learn::steps::{Reply, ReportState, Request};
use dials_session::fleet::{Order, WorkerReport, encode, receive};
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::place::Place;

fn state() -> AgentsState {
    let rows = |from: u8| Ragged::from_vec((from..from + 6).map(f32::from).collect(), [2, 3, 1]).expect("it fits");
    let row = RowStream {
        trail: Trail { episode: 5, actions: vec![0, 1], sources: vec![1, 0, 0, 1], shown: 77 },
        rewards: 1.25,
        ..RowStream::begin(Seed::new(2).dice())
    };
    AgentsState {
        steps: 128,
        policies: rows(0),
        learners: Tables {
            numbers: [("first_moments".to_owned(), rows(10)), ("second_moments".to_owned(), rows(20))].into(),
            dice: [("acting".to_owned(), vec![vec![Seed::new(1).dice()]; 3])].into(),
            counts: [("gradient_steps".to_owned(), 12)].into(),
            bytes: vec![7, 8],
        },
        aips: rows(30),
        streams: vec![AgentStream { rows: vec![row] }; 3],
        outside_aips: vec![9],
    }
}

fn encoded<T: Serialize>(messages: &[T]) -> Vec<Vec<u8>> {
    messages.iter().map(|message| encode(message).expect("a message can be encoded")).collect()
}

pub(crate) fn orders_seeds(_: &Place) -> Vec<Vec<u8>> {
    let config_json = "{\"warehouse\": {\"agents_per_side\": 2}}".to_owned();
    let begin = Order::Begin { config_json, agents: AgentId::all(3), threads: 1, prepared: Some(vec![1, 2]) };
    let state = state();
    let (take, report) = (Order::TakePolicies(state.policies.clone()), Order::Step(Request::ReportState(ReportState)));
    let evaluate = Order::Step(Request::Evaluate(Evaluate { episodes: 3..7 }));
    encoded(&[begin, report, take, Order::Restore(state), evaluate])
}

pub(crate) fn reports_seeds(_: &Place) -> Vec<Vec<u8>> {
    let load = Box::<WorkerLoad>::default;
    let done = |reply| WorkerReport::Done { reply: Box::new(reply), load: load(), resident_kib: 200_000 };
    let failed = WorkerReport::Failed { reason: "the disk is full".to_owned() };
    let state = done(Reply::ReportState(state()));
    encoded(&[WorkerReport::Trained { steps: 128 }, failed, WorkerReport::Begun, state])
}

pub(crate) fn orders(_: &Place, bytes: &[u8]) -> Result<()> {
    same_when_sent_on::<Order>(bytes, |order| match order {
        Order::Restore(state) => check(state),
        Order::TakePolicies(policies) => drop(policies.iter().count()),
        _ => {}
    })
}

pub(crate) fn reports(_: &Place, bytes: &[u8]) -> Result<()> {
    same_when_sent_on::<WorkerReport>(bytes, |report| {
        if let WorkerReport::Done { reply, .. } = report
            && let Reply::ReportState(state) = &**reply
        {
            check(state);
        }
    })
}

/// Reads messages until the stream ends. Each one that is accepted means the same when it is sent on.
fn same_when_sent_on<T: Serialize + DeserializeOwned>(mut bytes: &[u8], check: impl Fn(&T)) -> Result<()> {
    while let Some(message) = receive::<T>(&mut bytes)? {
        check(&message);
        let sent = encode(&message).expect("an accepted message can be sent on");
        let again = receive::<T>(&mut &sent[..]).expect("it was sent by us").expect("it is there");
        assert!(encode(&again).expect("it was sent once") == sent, "it changes on its way");
    }
    Ok(())
}

/// Tables that contradict themselves would panic here, as they would in a worker.
fn check(state: &AgentsState) {
    for table in state.learners.numbers.values().chain([&state.policies, &state.aips]) {
        std::hint::black_box(table.iter().map(<[f32]>::len).sum::<usize>());
    }
}
