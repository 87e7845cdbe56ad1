//! Copies of the GS in processes of their own: libsumo holds one simulation per process.
//!
//! At most as many copies are at work as the worker has threads. So a run takes no more cores than it was given. In which order they
//! work changes no number. Copies of a domain that is native are all in the worker: there learning takes the time.
//!
//! A copy that dies takes its worker along, which is started again like any lost worker, from the last exchange.

use std::cell::RefCell;
use std::mem;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Error, Result, anyhow, bail, ensure};
use rustix::process::{Signal, set_parent_process_death_signal};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::channel::{receive, send};
use super::process::{CpuClock, footprint};
use crate::config::RunConfig;
use dials_core::base::Seed;
use dials_core::domain::{Action, Domain, GlobalSimulator, JointPercept, JointTransition, Kinds};
use dials_learn::environments::copies::{GlobalCopies, GlobalCopy, InThisProcess, MakeCopies, OwnCopy};
use dials_learn::fleet::Footprint;

/// The hidden subcommand that makes this program a copy of the GS.
const COPY: &str = "global-copy";

/// What a worker asks of a copy.
#[derive(Serialize, Deserialize)]
enum Ask {
    Reset(Seed),
    Step(Vec<Action>),
    /// Say what it took, and end.
    End,
}

#[derive(Serialize, Deserialize)]
enum Answer {
    /// What it shows, as numbers and masks in the order of a [`JointTransition`]. Their counts are known.
    Shown(Bytes),
    Ended {
        cpu: Duration,
        footprint: Footprint,
    },
    Failed(String),
}

/// Bytes that are copied as a whole. A list of numbers would be read one by one.
struct Bytes(Vec<u8>);

impl Serialize for Bytes {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.serialize_bytes(&self.0)
    }
}

impl<'de> Deserialize<'de> for Bytes {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Bytes, D::Error> {
        <&[u8]>::deserialize(deserializer).map(|bytes| Bytes(bytes.to_vec()))
    }
}

impl Bytes {
    fn of(JointPercept { obs, d_set, masks }: &JointPercept, rewards: &[f32]) -> Bytes {
        let numbers = [obs.as_slice(), d_set.as_slice(), rewards];
        let mut bytes: Vec<u8> = numbers.into_iter().flatten().flat_map(|number| number.to_le_bytes()).collect();
        bytes.extend(masks.as_slice().iter().map(|&allowed| u8::from(allowed)));
        Bytes(bytes)
    }

    /// Writes what they say. Returns whether there are as many as there must be.
    fn read_into(&self, shown: &mut JointTransition) -> bool {
        let JointTransition { percept: JointPercept { obs, d_set, masks }, rewards } = shown;
        let mut rest = &self.0[..];
        for numbers in [obs.as_mut_slice(), d_set.as_mut_slice(), rewards] {
            let Some((bytes, after)) = rest.split_at_checked(4 * numbers.len()) else { return false };
            for (number, bytes) in numbers.iter_mut().zip(bytes.chunks_exact(4)) {
                *number = f32::from_le_bytes(bytes.try_into().expect("four bytes"));
            }
            rest = after;
        }
        let masks = masks.as_mut_slice();
        masks.iter_mut().zip(rest).for_each(|(allowed, &byte)| *allowed = byte == 1);
        rest.len() == masks.len()
    }
}

/// What copies have taken that ended since somebody asked.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Taken {
    pub(super) cpu: Duration,
    /// Memory of all of them together.
    pub(super) footprint: Footprint,
}

thread_local! {
    /// A worker has one thread that makes copies.
    static TAKEN: RefCell<Taken> = RefCell::default();
}

/// Returns the CPU time of copies that ended since the last call.
pub(super) fn take_cpu() -> Duration {
    TAKEN.with_borrow_mut(|taken| mem::take(&mut taken.cpu))
}

/// Returns the memory of copies that ended since the last call.
pub(super) fn take_footprint() -> Footprint {
    TAKEN.with_borrow_mut(|taken| mem::take(&mut taken.footprint))
}

/// A copy is no more. The worker cannot go on, and another one can.
#[derive(Debug, thiserror::Error)]
#[error("a copy of the global simulator was lost: {0}")]
pub(super) struct CopyLost(String);

/// Does what the worker that started this process asks through standard input, until that is closed.
pub fn serve_a_worker(open_domain: impl FnOnce(&RunConfig) -> Result<Arc<dyn Domain>>) -> Result<()> {
    set_parent_process_death_signal(Some(Signal::KILL)).context("cannot make this copy end with its worker")?;
    let stdin = std::io::stdin().as_fd().try_clone_to_owned().context("no standard input")?;
    let mut stream = UnixStream::from(stdin);
    let Some(config) =
        receive::<String>(&mut stream).context("this command is for the program itself, not for people")?
    else {
        return Ok(());
    };
    let make = || -> Result<Box<dyn GlobalSimulator>> {
        let config: RunConfig = serde_json::from_str(&config)?;
        open_domain(&config)?.global_simulator()
    };
    let mut copy = make();
    while let Some(ask) = receive::<Ask>(&mut stream)? {
        let answered = match (ask, &mut copy) {
            (Ask::End, _) => Ok(Answer::Ended { cpu: CpuClock::of_the_process().lap(), footprint: footprint() }),
            (ask, Ok(copy)) => answer(ask, &mut **copy),
            (_, Err(error)) => Err(anyhow!("{error:#}")),
        };
        send(&mut stream, &answered.unwrap_or_else(|error| Answer::Failed(format!("{error:#}"))))?;
    }
    Ok(())
}

fn answer(ask: Ask, copy: &mut dyn GlobalSimulator) -> Result<Answer> {
    Ok(Answer::Shown(match ask {
        Ask::Reset(episode) => {
            // It brings no rewards.
            let rewards = vec![0.0; copy.agents()];
            Bytes::of(copy.reset(episode)?, &rewards)
        }
        Ask::Step(actions) => {
            let JointTransition { percept, rewards } = copy.step(&actions)?;
            Bytes::of(percept, rewards)
        }
        Ask::End => bail!("it is over"),
    }))
}

/// Makes copies of the GS in as many processes as it takes.
pub(super) struct Copies {
    pub(super) config_json: String,
    /// Number of copies that may be computed at once.
    pub(super) at_once: usize,
}

impl MakeCopies for Copies {
    fn make(&self, domain: &dyn Domain, copies: usize) -> Result<GlobalCopies> {
        if copies == 1 || domain.foreign_simulator().is_none() {
            return InThisProcess.make(domain, copies);
        }
        let kinds = domain.kinds();
        // They load while this process does.
        let start = |_| Remote::start(&self.config_json, kinds);
        if self.at_once > 1 {
            let boxed = |copy| Ok(Box::new(start(copy)?) as Box<dyn GlobalCopy + Send>);
            return Ok(GlobalCopies::Apart((0..copies).map(boxed).collect::<Result<_>>()?));
        }
        let others = (1..copies).map(start).collect::<Result<Vec<_>>>()?;
        let own = Box::new(OwnCopy(domain.global_simulator()?)) as Box<dyn GlobalCopy>;
        Ok(GlobalCopies::Here([own].into_iter().chain(others.into_iter().map(|other| Box::new(other) as _)).collect()))
    }
}

/// A copy in another process.
struct Remote {
    process: Process,
    /// What it has shown last.
    shown: JointTransition,
}

impl Remote {
    fn start(config_json: &String, kinds: &Kinds) -> Result<Remote> {
        Ok(Remote { process: Process::start(config_json)?, shown: JointTransition::new(kinds) })
    }

    fn ask(&mut self, ask: &Ask) -> Result<()> {
        self.process.send(ask)?;
        match self.process.receive()? {
            Answer::Shown(bytes) => {
                let fits = bytes.read_into(&mut self.shown);
                ensure!(fits, CopyLost("it shows what is not of this domain".to_owned()));
                Ok(())
            }
            Answer::Failed(reason) => bail!("a copy of the global simulator: {reason}"),
            Answer::Ended { .. } => bail!(CopyLost("it ended unasked".to_owned())),
        }
    }
}

impl GlobalCopy for Remote {
    fn reset(&mut self, episode: Seed) -> Result<&JointPercept> {
        self.ask(&Ask::Reset(episode))?;
        Ok(&self.shown.percept)
    }

    fn step(&mut self, actions: &[Action]) -> Result<&JointTransition> {
        self.ask(&Ask::Step(actions.to_vec()))?;
        Ok(&self.shown)
    }
}

impl Drop for Remote {
    /// Notes what it took. One that does not say it has failed before.
    fn drop(&mut self) {
        if let Ok(Answer::Ended { cpu, footprint }) = self.process.send(&Ask::End).and_then(|()| self.process.receive())
        {
            TAKEN.with_borrow_mut(|taken| {
                taken.cpu += cpu;
                taken.footprint = taken.footprint.and(footprint);
            });
        }
    }
}

/// A copy in a process of its own. Dropping it kills it.
struct Process {
    child: Child,
    stream: UnixStream,
}

impl Process {
    fn start(config_json: &String) -> Result<Process> {
        let (stream, theirs) = UnixStream::pair().context("no socket for a copy of the global simulator")?;
        // As a worker: not by its path, and not from another thread. Its words go where the worker's go.
        let child = Command::new("/proc/self/exe")
            .arg(COPY)
            .envs(dials_traffic::sumo_for_children())
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(Stdio::null())
            .process_group(0)
            .spawn()
            .context("cannot start a copy of the global simulator")?;
        let mut copy = Process { child, stream };
        send(&mut copy.stream, config_json).map_err(|error| copy.lost(&error))?;
        Ok(copy)
    }

    fn send(&mut self, ask: &Ask) -> Result<()> {
        send(&mut self.stream, ask).map_err(|error| self.lost(&error))
    }

    fn receive(&mut self) -> Result<Answer> {
        let received = receive(&mut self.stream).and_then(|answer| answer.context("its stream has ended"));
        received.map_err(|error| self.lost(&error))
    }

    fn lost(&mut self, error: &Error) -> Error {
        drop(self.child.kill());
        let end = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        anyhow!(CopyLost(format!("process {}, {end}: {error:#}", self.child.id())))
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
