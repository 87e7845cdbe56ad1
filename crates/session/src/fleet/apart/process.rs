//! A process that holds one simulator, and what is said between it and its worker.

use std::mem;
use std::os::fd::OwnedFd;
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use anyhow::{Context, Error, Result, anyhow, bail};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::fleet::channel::{receive, send};
use dials_core::base::{AgentId, Seed};
use dials_core::domain::Action;
use dials_learn::fleet::Footprint;

/// The hidden subcommand that makes this program such a process.
const SUBCOMMAND: &str = "simulator";

/// The first message.
#[derive(Serialize, Deserialize)]
pub(super) struct Begin {
    pub(super) config_json: String,
    /// See [`dials_core::domain::Domain::prepare`].
    pub(super) prepared: Option<Vec<u8>>,
    pub(super) role: Role,
}

/// Which simulator it holds.
#[derive(Serialize, Deserialize)]
pub(super) enum Role {
    /// A copy of the GS.
    Copy,
    /// Local simulators of some agents of a kind.
    Forest { agents: Vec<AgentId>, copies: usize, seed: Seed },
}

/// What a worker asks.
#[derive(Serialize, Deserialize)]
pub(super) enum Ask {
    /// Begin an episode of the GS.
    Reset(Seed),
    Step(Vec<Action>),
    /// Begin episodes of local simulators: row, and number of the episode.
    Restart(Vec<(usize, u64)>),
    /// A step of local simulators: actions, and the sources of all rows.
    Drive(Vec<Action>, Bytes),
    /// Say what it took, and end.
    End,
}

#[derive(Serialize, Deserialize)]
pub(super) enum Answer {
    /// What it shows, as numbers and masks, whose counts are known; and the counters of local simulators.
    Shown(Bytes, Vec<(String, u64)>),
    Ended {
        cpu: Duration,
        footprint: Footprint,
    },
    Failed(String),
}

/// Bytes that are copied as a whole. A list of numbers would be read one by one.
pub(super) struct Bytes(pub(super) Vec<u8>);

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
    pub(super) fn of(tables: [&[f32]; 3], masks: &[bool]) -> Bytes {
        let mut bytes: Vec<u8> = tables.into_iter().flatten().flat_map(|number| number.to_le_bytes()).collect();
        bytes.extend(masks.iter().map(|&allowed| u8::from(allowed)));
        Bytes(bytes)
    }

    /// Writes what they say. Returns whether there are as many as there must be.
    #[must_use]
    pub(super) fn read_into(&self, tables: [&mut [f32]; 3], masks: &mut [bool]) -> bool {
        let mut rest = &self.0[..];
        for numbers in tables {
            let Some((bytes, after)) = rest.split_at_checked(4 * numbers.len()) else { return false };
            for (number, bytes) in numbers.iter_mut().zip(bytes.chunks_exact(4)) {
                *number = f32::from_le_bytes(bytes.try_into().expect("four bytes"));
            }
            rest = after;
        }
        masks.iter_mut().zip(rest).for_each(|(allowed, &byte)| *allowed = byte == 1);
        rest.len() == masks.len()
    }
}

/// What simulators have taken that ended since somebody asked.
struct Taken {
    cpu: Duration,
    /// Number of those that are still there.
    there: usize,
    /// Memory of those that have ended while others of the same time are still there.
    together: Footprint,
    /// The most memory that simulators of the same time had together.
    most: Footprint,
}

/// A process has one worker at most. A thread of it may end a simulator that another one has made.
static TAKEN: Mutex<Taken> = Mutex::new(Taken {
    cpu: Duration::ZERO,
    there: 0,
    together: Footprint { peak_rss_kib: 0, pss_kib: 0 },
    most: Footprint { peak_rss_kib: 0, pss_kib: 0 },
});

fn taken() -> MutexGuard<'static, Taken> {
    // Nothing that can panic happens under the lock.
    TAKEN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the CPU time of simulators that ended since the last call.
pub(in crate::fleet) fn take_cpu() -> Duration {
    mem::take(&mut taken().cpu)
}

/// Returns the memory of simulators that ended since the last call.
pub(in crate::fleet) fn take_footprint() -> Footprint {
    mem::take(&mut taken().most)
}

/// A simulator is no more. The worker cannot go on, and another one can.
#[derive(Debug, thiserror::Error)]
#[error("a simulator was lost: {0}")]
pub(in crate::fleet) struct SimulatorLost(pub(super) String);

/// A simulator in a process of its own. Dropping it ends it.
pub(super) struct Process {
    /// What it is, for errors.
    name: String,
    child: Child,
    stream: UnixStream,
}

impl Process {
    /// `name`: what it is, for errors.
    pub(super) fn start(begin: &Begin, name: String) -> Result<Process> {
        let (stream, theirs) = UnixStream::pair().context("no socket for a simulator")?;
        // As a worker: not by its path, and not from another thread. Its words go where the worker's go.
        let child = Command::new("/proc/self/exe")
            .arg(SUBCOMMAND)
            .envs(dials_traffic::sumo_for_children())
            .stdin(Stdio::from(OwnedFd::from(theirs)))
            .stdout(Stdio::null())
            .process_group(0)
            .spawn()
            .context("cannot start the process of a simulator")?;
        let mut process = Process { name, child, stream };
        taken().there += 1;
        send(&mut process.stream, begin).map_err(|error| process.lost(&error))?;
        Ok(process)
    }

    /// Asks, and returns what it shows, with its counters.
    pub(super) fn ask(&mut self, ask: &Ask) -> Result<(Bytes, Vec<(String, u64)>)> {
        match self.answer(ask).map_err(|error| self.lost(&error))? {
            Answer::Shown(bytes, counters) => Ok((bytes, counters)),
            Answer::Failed(reason) => bail!("{}: {reason}", self.name),
            Answer::Ended { .. } => bail!(SimulatorLost("it ended unasked".to_owned())),
        }
    }

    fn answer(&mut self, ask: &Ask) -> Result<Answer> {
        send(&mut self.stream, ask)?;
        receive(&mut self.stream)?.context("its stream has ended")
    }

    fn lost(&mut self, error: &Error) -> Error {
        drop(self.child.kill());
        let end = self.child.wait().map_or_else(|error| error.to_string(), |status| status.to_string());
        anyhow!(SimulatorLost(format!("{}, process {}, {end}: {error:#}", self.name, self.child.id())))
    }
}

impl Drop for Process {
    /// Notes what it took. One that does not say it has failed before.
    fn drop(&mut self) {
        let ended = self.answer(&Ask::End);
        let mut taken = taken();
        if let Ok(Answer::Ended { cpu, footprint }) = ended {
            taken.cpu += cpu;
            taken.together = taken.together.and(footprint);
        }
        taken.there -= 1;
        if taken.there == 0 {
            let together = mem::take(&mut taken.together);
            taken.most = taken.most.max(together);
        }
        drop(taken);
        drop(self.child.kill());
        drop(self.child.wait());
    }
}
