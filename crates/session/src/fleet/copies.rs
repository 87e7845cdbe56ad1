//! Copies of the GS in processes of their own: libsumo holds one simulation per process.
//!
//! At most as many copies are at work as the worker has threads. So a run takes no more cores than it was given. In which order they
//! work changes no number. Copies of a domain that is native are all in the worker: there learning takes the time.
//!
//! A copy that dies takes its worker along, which is started again like any lost worker, from the last exchange.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::mem;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::os::unix::process::CommandExt;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, Error, Result, anyhow, bail, ensure};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;
use rustix::process::{Signal, set_parent_process_death_signal};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::channel::{receive, send};
use super::process::{CpuClock, footprint};
use crate::config::RunConfig;
use dials_core::base::{Seed, Stopwatch};
use dials_core::domain::{Action, Domain, JointPercept, JointTransition};
use dials_learn::environments::copies::{GlobalCopies, InThisProcess, MakeCopies, OwnCopy};
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
    fn of(shown: &JointTransition) -> Bytes {
        let JointTransition { percept: JointPercept { obs, d_set, masks }, rewards } = shown;
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
    /// Memory of all copies of a period together; the largest of the periods.
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
    let make = || -> Result<OwnCopy> {
        let config: RunConfig = serde_json::from_str(&config)?;
        Ok(OwnCopy::new(open_domain(&config)?.global_simulator()?))
    };
    let mut copy = make();
    while let Some(ask) = receive::<Ask>(&mut stream)? {
        let answered = match (ask, &mut copy) {
            (Ask::End, _) => Ok(Answer::Ended { cpu: CpuClock::of_the_process().lap(), footprint: footprint() }),
            (ask, Ok(copy)) => answer(ask, copy),
            (_, Err(error)) => Err(anyhow!("{error:#}")),
        };
        send(&mut stream, &answered.unwrap_or_else(|error| Answer::Failed(format!("{error:#}"))))?;
    }
    Ok(())
}

fn answer(ask: Ask, copy: &mut OwnCopy) -> Result<Answer> {
    match ask {
        Ask::Reset(episode) => copy.reset(episode)?,
        Ask::Step(actions) => copy.step(&actions)?,
        Ask::End => {}
    }
    Ok(Answer::Shown(Bytes::of(copy.shown())))
}

/// Makes copies of the GS in as many processes as it takes.
pub(super) struct Copies {
    pub(super) config_json: String,
    /// Number of copies that may be computed at once.
    pub(super) at_once: usize,
}

impl MakeCopies for Copies {
    fn make(&self, domain: &dyn Domain, copies: usize) -> Result<Box<dyn GlobalCopies>> {
        if copies == 1 || domain.foreign_simulator().is_none() {
            return InThisProcess.make(domain, copies);
        }
        // Where copies are computed at the same time, this process has none: it would be at work when the others need it.
        let own = self.at_once == 1;
        // They load while this process does.
        let start = |copy: usize| if own && copy == 0 { Ok(None) } else { Process::start(&self.config_json).map(Some) };
        let others = (0..copies).map(start).collect::<Result<Vec<_>>>()?;
        Ok(Box::new(Shared {
            own: own.then(|| domain.global_simulator()).transpose()?.map(OwnCopy::new),
            others,
            shown: vec![JointTransition::new(domain.kinds()); copies],
            at_once: self.at_once,
            at_work: Vec::new(),
            waiting: VecDeque::new(),
            done: VecDeque::new(),
        }))
    }
}

/// Copies in processes of their own. If one is computed at a time, the first one is in this process.
struct Shared {
    own: Option<OwnCopy>,
    /// One per copy but the own.
    others: Vec<Option<Process>>,
    /// What the others have shown last.
    shown: Vec<JointTransition>,
    at_once: usize,
    /// Others that are at work, those that must wait for them, and copies that have done what they were asked for.
    at_work: Vec<usize>,
    waiting: VecDeque<(usize, Ask)>,
    done: VecDeque<usize>,
}

/// Every copy but the own has a process.
const IN_A_PROCESS: &str = "a copy that is not here has a process";

impl Shared {
    /// Returns the own copy, if it is this one.
    fn own(&mut self, copy: usize) -> Option<&mut OwnCopy> {
        self.own.as_mut().filter(|_| copy == 0)
    }

    fn other(&mut self, copy: usize) -> &mut Process {
        self.others[copy].as_mut().expect(IN_A_PROCESS)
    }

    /// Asks a copy, now or when others have done their work.
    fn ask(&mut self, copy: usize, ask: Ask) -> Result<()> {
        self.waiting.push_back((copy, ask));
        self.send_what_waits()
    }

    fn send_what_waits(&mut self) -> Result<()> {
        while self.at_work.len() < self.at_once
            && let Some((copy, ask)) = self.waiting.pop_front()
        {
            self.at_work.push(copy);
            self.other(copy).send(&ask)?;
        }
        Ok(())
    }

    /// Waits until at least one of the others that are at work has answered, and takes in what they say.
    fn hear(&mut self) -> Result<()> {
        let processes = self.at_work.iter().map(|&copy| self.others[copy].as_ref().expect(IN_A_PROCESS));
        let mut waits: Vec<PollFd<'_>> = processes.map(|process| PollFd::new(&process.stream, PollFlags::IN)).collect();
        while let Err(error) = poll(&mut waits, None) {
            if error != Errno::INTR {
                return Err(Error::new(error).context("cannot wait for copies of the global simulator"));
            }
        }
        let has_news: Vec<bool> = waits.iter().map(|wait| !wait.revents().is_empty()).collect();
        let (answered, at_work): (Vec<_>, Vec<_>) =
            mem::take(&mut self.at_work).into_iter().zip(has_news).partition(|(_, has_news)| *has_news);
        self.at_work = at_work.into_iter().map(|(copy, _)| copy).collect();
        for (copy, _) in answered {
            match self.other(copy).receive()? {
                Answer::Shown(bytes) => {
                    let fits = bytes.read_into(&mut self.shown[copy]);
                    ensure!(fits, CopyLost("it shows what is not of this domain".to_owned()));
                    self.done.push_back(copy);
                }
                Answer::Failed(reason) => bail!("copy {copy} of the global simulator: {reason}"),
                Answer::Ended { .. } => bail!(CopyLost("it ended unasked".to_owned())),
            }
        }
        self.send_what_waits()
    }
}

impl GlobalCopies for Shared {
    fn at_once(&self) -> usize {
        self.at_once
    }

    fn begin_reset(&mut self, copy: usize, episode: Seed) -> Result<()> {
        let Some(own) = self.own(copy) else { return self.ask(copy, Ask::Reset(episode)) };
        own.reset(episode)?;
        self.done.push_back(copy);
        Ok(())
    }

    fn begin_step(&mut self, copy: usize, actions: &[Action]) -> Result<()> {
        let Some(own) = self.own(copy) else { return self.ask(copy, Ask::Step(actions.to_vec())) };
        own.step(actions)?;
        self.done.push_back(copy);
        Ok(())
    }

    fn wait(&mut self) -> Result<usize> {
        loop {
            if let Some(copy) = self.done.pop_front() {
                return Ok(copy);
            }
            ensure!(!self.at_work.is_empty(), "no copy of the global simulator is at work");
            self.hear()?;
        }
    }

    fn shown(&self, copy: usize) -> &JointTransition {
        self.own.as_ref().filter(|_| copy == 0).map_or(&self.shown[copy], OwnCopy::shown)
    }

    fn take_watch(&mut self) -> Stopwatch {
        self.own.as_mut().map(OwnCopy::take_watch).unwrap_or_default()
    }
}

impl Drop for Shared {
    /// Notes what the others took. One that does not say it has failed before.
    fn drop(&mut self) {
        let mut together = Footprint::default();
        for other in self.others.iter_mut().flatten() {
            if let Ok(Answer::Ended { cpu, footprint }) = other.send(&Ask::End).and_then(|()| other.receive()) {
                TAKEN.with_borrow_mut(|taken| taken.cpu += cpu);
                together = together.and(footprint);
            }
        }
        TAKEN.with_borrow_mut(|taken| taken.footprint = taken.footprint.max(together));
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
