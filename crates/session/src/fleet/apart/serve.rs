//! The side of the process that holds a simulator.

use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;
use std::sync::Arc;

use anyhow::{Context, Result, anyhow, bail, ensure};
use rustix::process::{Signal, set_parent_process_death_signal};

use super::process::{Answer, Ask, Begin, Bytes, Role};
use crate::config::RunConfig;
use crate::fleet::channel::{receive, send};
use crate::fleet::process::{CpuClock, footprint};
use dials_core::base::Rows;
use dials_core::domain::{
    Beginning, Domain, GlobalSimulator, JointPercept, JointTransition, LocalSimulator, Percept, Transition,
};

enum Simulator {
    Copy(Box<dyn GlobalSimulator>),
    Forest(Box<dyn LocalSimulator>),
}

/// Does what the worker that started this process asks through standard input, until that is closed.
pub fn serve_a_worker(open_domain: impl FnOnce(&RunConfig) -> Result<Arc<dyn Domain>>) -> Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL)).context("cannot make this simulator end with its worker")?;
    let stdin = std::io::stdin().as_fd().try_clone_to_owned().context("no standard input")?;
    let mut stream = UnixStream::from(stdin);
    let Some(begin) =
        receive::<Begin>(&mut stream).context("this command is for the program itself, not for people")?
    else {
        return Ok(());
    };
    let mut simulator = make(begin, open_domain);
    while let Some(ask) = receive::<Ask>(&mut stream)? {
        let answered = match (ask, &mut simulator) {
            (Ask::End, _) => Ok(Answer::Ended { cpu: CpuClock::of_the_process().lap(), footprint: footprint() }),
            (ask, Ok(simulator)) => answer(ask, simulator),
            (_, Err(error)) => Err(anyhow!("{error:#}")),
        };
        send(&mut stream, &answered.unwrap_or_else(|error| Answer::Failed(format!("{error:#}"))))?;
    }
    Ok(())
}

fn make(
    Begin { config_json, prepared, role }: Begin,
    open_domain: impl FnOnce(&RunConfig) -> Result<Arc<dyn Domain>>,
) -> Result<Simulator> {
    let config: RunConfig = serde_json::from_str(&config_json)?;
    let domain = open_domain(&config)?;
    prepared.map_or(Ok(()), |prepared| domain.take_prepared(&prepared))?;
    Ok(match role {
        Role::Copy => Simulator::Copy(domain.global_simulator()?),
        Role::Forest { agents, copies, seed } => Simulator::Forest(domain.local_simulator(&agents, copies, seed)?),
    })
}

fn answer(ask: Ask, simulator: &mut Simulator) -> Result<Answer> {
    match (simulator, ask) {
        (Simulator::Copy(copy), Ask::Reset(episode)) => {
            let rewards = vec![0.0; copy.agents()];
            Ok(shown_by_all(copy.reset(episode)?, &rewards))
        }
        (Simulator::Copy(copy), Ask::Step(actions)) => {
            let JointTransition { percept, rewards } = copy.step(&actions)?;
            Ok(shown_by_all(percept, rewards))
        }
        (Simulator::Forest(forest), Ask::Restart(rows)) => {
            let begin: Vec<Beginning> = rows.into_iter().map(|(row, episode)| Beginning { row, episode }).collect();
            let (rewards, percept) = (vec![0.0; forest.rows()], forest.reset(&begin)?);
            let bytes = bytes_of(percept, &rewards);
            Ok(Answer::Shown(bytes, forest.counters()))
        }
        (Simulator::Forest(forest), Ask::Drive(actions, Bytes(sources))) => {
            let width = forest.spec().sources.count();
            ensure!(sources.len() == forest.rows() * width, "sources of other rows");
            let Transition { percept, rewards } = forest.step(&actions, &Rows::from_vec(sources, width))?;
            let bytes = bytes_of(percept, rewards);
            Ok(Answer::Shown(bytes, forest.counters()))
        }
        _ => bail!("this simulator cannot do that"),
    }
}

fn shown_by_all(JointPercept { obs, d_set, masks }: &JointPercept, rewards: &[f32]) -> Answer {
    Answer::Shown(Bytes::of([obs.as_slice(), d_set.as_slice(), rewards], masks.as_slice()), Vec::new())
}

fn bytes_of(Percept { obs, d_set, masks }: &Percept, rewards: &[f32]) -> Bytes {
    let masks = masks.as_ref().map_or(&[][..], |masks| masks.as_slice());
    Bytes::of([obs.as_slice(), d_set.as_slice(), rewards], masks)
}
