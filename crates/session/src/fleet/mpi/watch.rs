//! The death of a rank, noticed at once. MPI does not report it: a rank that waits for a dead one waits for ever.
//!
//! Every relay holds a TCP connection to rank 0. The system closes it when the process at either end dies, however it
//! dies. Nothing is ever sent on it but the greeting. If a whole machine is lost, or the network, the system notices it
//! within a minute, because it asks the other end from time to time.

use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv4Addr, TcpListener, TcpStream, ToSocketAddrs, UdpSocket};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail};
use rustix::net::sockopt;
use serde::{Deserialize, Serialize};

/// Time in which a connection must be made.
const CONNECTING: Duration = Duration::from_secs(5);
/// Time after which a silent end is asked whether it is there, time between two questions, and how many may fail.
const ASKED_AFTER: Duration = Duration::from_secs(30);
const ASKED_EVERY: Duration = Duration::from_secs(10);
const ASKED_IN_VAIN: u32 = 3;
/// An address outside every network, to which nothing is sent. The system names its own address on the way there.
const FAR_AWAY: &str = "203.0.113.1:9";

/// Where rank 0 can be reached.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(super) struct Address {
    /// Names and addresses of its machine, the best first.
    hosts: Vec<String>,
    port: u16,
    /// Number by which rank 0 knows its own relays.
    secret: u64,
}

/// Rank 0's ends of the connections to all relays.
pub(super) struct RankWatch {
    listener: TcpListener,
    address: Address,
    /// By rank. `None`: there is none, or it was found closed.
    lines: Vec<Option<TcpStream>>,
}

impl RankWatch {
    /// `host`: the name of this machine.
    pub(super) fn open(host: &str, ranks: usize) -> Result<RankWatch> {
        let listener = TcpListener::bind((Ipv4Addr::UNSPECIFIED, 0)).context("no port for the other ranks")?;
        listener.set_nonblocking(true)?;
        let outgoing = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, 0)).and_then(|socket| {
            socket.connect(FAR_AWAY)?;
            socket.local_addr()
        });
        let mut hosts: Vec<String> = outgoing.iter().map(|address| address.ip().to_string()).collect();
        hosts.push(host.to_owned());
        hosts.push(Ipv4Addr::LOCALHOST.to_string());
        let secret = RandomState::new().build_hasher().finish();
        let address = Address { hosts, port: listener.local_addr()?.port(), secret };
        Ok(RankWatch { listener, address, lines: (0..ranks).map(|_| None).collect() })
    }

    pub(super) fn address(&self) -> Address {
        self.address.clone()
    }

    /// Waits for the connection of a rank that says it has connected.
    pub(super) fn expect(&mut self, rank: usize) -> Result<()> {
        let begun = Instant::now();
        while self.lines[rank].is_none() {
            match self.listener.accept() {
                Ok((line, _)) => self.greet(line),
                Err(error) if error.kind() != ErrorKind::WouldBlock => return Err(error.into()),
                Err(_) if begun.elapsed() > CONNECTING => bail!("rank {rank} did not connect to rank 0"),
                Err(_) => thread::sleep(Duration::from_millis(1)),
            }
        }
        Ok(())
    }

    /// Takes a connection whose greeting is right. Drops that of a stranger.
    fn greet(&mut self, mut line: TcpStream) {
        let mut greeting = [0; 16];
        let ready = line.set_nonblocking(false).and_then(|()| line.set_read_timeout(Some(CONNECTING)));
        let ready = ready.and_then(|()| keep_asking(&line));
        if ready.and_then(|()| line.read_exact(&mut greeting)).is_err() {
            return;
        }
        let [secret, rank] = [0, 8].map(|at| u64::from_le_bytes(greeting[at..][..8].try_into().expect("eight bytes")));
        let slot = usize::try_from(rank).ok().and_then(|rank| self.lines.get_mut(rank));
        if let (true, Some(slot)) = (secret == self.address.secret, slot) {
            *slot = line.set_nonblocking(true).is_ok().then_some(line);
        }
    }

    /// Returns the ranks that have died since the last call.
    pub(super) fn newly_dead(&mut self) -> Vec<usize> {
        let mut cut = Vec::new();
        for (rank, line) in self.lines.iter_mut().enumerate() {
            if line.as_ref().is_some_and(is_closed) {
                *line = None;
                cut.push(rank);
            }
        }
        cut
    }
}

/// A relay's end of its connection to rank 0.
pub(super) struct ParentWatch(TcpStream);

impl ParentWatch {
    pub(super) fn connect(address: &Address, rank: usize) -> Result<ParentWatch> {
        let mut tried = Vec::new();
        for host in &address.hosts {
            match greeted(host, address, rank) {
                Ok(line) => return Ok(ParentWatch(line)),
                Err(error) => tried.push(format!("{host}:{}: {error}", address.port)),
            }
        }
        bail!("rank 0 cannot be reached by TCP ({})", tried.join("; "))
    }

    pub(super) fn has_ended(&self) -> bool {
        is_closed(&self.0)
    }
}

fn greeted(host: &str, address: &Address, rank: usize) -> std::io::Result<TcpStream> {
    let resolved = (host, address.port).to_socket_addrs()?.find(|address| address.is_ipv4());
    let resolved = resolved.ok_or(ErrorKind::AddrNotAvailable)?;
    let mut line = TcpStream::connect_timeout(&resolved, CONNECTING)?;
    line.write_all(&[address.secret.to_le_bytes(), (rank as u64).to_le_bytes()].concat())?;
    line.set_nonblocking(true)?;
    keep_asking(&line)?;
    Ok(line)
}

/// Lets the system ask the other end from time to time whether it is still there.
fn keep_asking(line: &TcpStream) -> std::io::Result<()> {
    sockopt::set_socket_keepalive(line, true)?;
    sockopt::set_tcp_keepidle(line, ASKED_AFTER)?;
    sockopt::set_tcp_keepintvl(line, ASKED_EVERY)?;
    sockopt::set_tcp_keepcnt(line, ASKED_IN_VAIN)?;
    Ok(())
}

fn is_closed(mut line: &TcpStream) -> bool {
    match line.read(&mut [0]) {
        Ok(read) => read == 0,
        Err(error) => !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_of_a_rank_is_seen_once_and_that_of_rank_0_by_all_and_both_ends_ask() {
        let mut watch = RankWatch::open("localhost", 3).unwrap();
        let mut relays =
            [1, 2].map(|rank| ParentWatch::connect(&watch.address(), rank).unwrap()).into_iter().collect::<Vec<_>>();
        [1, 2].iter().for_each(|&rank| watch.expect(rank).unwrap());
        let ends = watch.lines.iter().flatten().chain(relays.iter().map(|relay| &relay.0));
        let asks =
            |line| sockopt::socket_keepalive(line).unwrap() && sockopt::tcp_keepidle(line).unwrap() == ASKED_AFTER;
        assert_eq!(ends.map(asks).collect::<Vec<_>>(), [true; 4]);

        assert!(watch.newly_dead().is_empty() && !relays.iter().any(ParentWatch::has_ended));
        drop(relays.remove(1));
        assert_eq!(watch.newly_dead(), [2]);
        assert!(watch.newly_dead().is_empty() && !relays[0].has_ended());
        drop(watch);
        assert!(relays[0].has_ended());
    }

    #[test]
    fn a_stranger_is_nobodys_connection() {
        let mut watch = RankWatch::open("localhost", 2).unwrap();
        let wrong = Address { secret: watch.address.secret ^ 1, ..watch.address() };
        let stranger = ParentWatch::connect(&wrong, 1).unwrap();
        let relay = ParentWatch::connect(&watch.address(), 1).unwrap();
        watch.expect(1).unwrap();
        drop(stranger);
        assert!(watch.newly_dead().is_empty());
        drop(relay);
        assert_eq!(watch.newly_dead(), [1]);
    }
}
