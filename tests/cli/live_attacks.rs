//! The live view under attack: anybody on this machine can reach its port, and most of them do not know the token.
//!
//! Each test attacks a view, keeps its connections open, and then asks for the page as a browser would.

use std::collections::VecDeque;
use std::fs;
use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use tempfile::TempDir;

use super::live::{View, parts};

/// Time limit. However slow the machine is, an answer that takes longer will never come.
const FOR_EVER: Duration = Duration::from_secs(60);
/// Memory that an attack may cost, in KiB. An ordinary request costs about one hundredth of it.
const MEMORY_KIB: u64 = 200_000;

struct Attacked {
    view: View,
    most_kib_before: u64,
    _folder: TempDir,
}

impl Attacked {
    fn new() -> Attacked {
        Attacked::under("true")
    }

    /// Starts a view after a command of the shell, such as `ulimit -n 256`.
    fn under(command: &str) -> Attacked {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("runs")).unwrap();
        let mut shell = Command::new("sh");
        shell.args(["-c", &format!("{command}; exec \"$0\" watch runs"), env!("CARGO_BIN_EXE_dials-traffic")]);
        let mut child = shell.current_dir(folder.path()).stdin(Stdio::null()).stdout(Stdio::piped()).spawn().unwrap();
        let mut address = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut address).unwrap();
        let (host, path) = parts(address.trim());
        let mut attacked = Attacked { view: View { child, host, path }, most_kib_before: 0, _folder: folder };
        assert!(attacked.view.get("now").starts_with("HTTP/1.1 200"));
        attacked.most_kib_before = attacked.most_kib();
        attacked
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(&self.view.host).unwrap();
        stream.set_read_timeout(Some(FOR_EVER)).unwrap();
        stream.set_write_timeout(Some(FOR_EVER)).unwrap();
        stream
    }

    /// Connects and sends these bytes. The view may have closed the connection before it has read all of them.
    fn send(&self, bytes: impl AsRef<[u8]>) -> TcpStream {
        let mut stream = self.connect();
        let _ = stream.write_all(bytes.as_ref());
        stream
    }

    /// Returns a request for a part of the page, as a browser sends it.
    fn request(&self, part: &str) -> String {
        let View { host, path, .. } = &self.view;
        format!("GET {path}{part} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n")
    }

    /// Returns the most memory that the process ever had at once.
    fn most_kib(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.view.child.id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
        line.expect("the process is alive").trim().trim_end_matches(" kB").parse().unwrap()
    }

    /// Asserts that the page is served as before, within the time limit, and that the attack cost little memory.
    fn assert_unharmed(&mut self) {
        for part in ["", "now"] {
            let mut answer = String::new();
            let read = self.send(self.request(part)).read_to_string(&mut answer);
            assert!(read.is_ok(), "/{part}: {read:?} after {} bytes of the answer", answer.len());
            assert!(answer.starts_with("HTTP/1.1 200"), "/{part}: {answer}");
        }
        assert_eq!(self.view.child.try_wait().unwrap(), None, "the view has ended");
        let more_kib = self.most_kib() - self.most_kib_before;
        assert!(more_kib < MEMORY_KIB, "the attack cost {more_kib} KiB");
    }
}

/// Reads until the view closes the connection. Panics if it never does.
fn wait_until_closed(stream: &mut TcpStream) -> Vec<u8> {
    let mut answer = Vec::new();
    match stream.read_to_end(&mut answer) {
        Err(error) if [ErrorKind::WouldBlock, ErrorKind::TimedOut].contains(&error.kind()) => {
            panic!("the connection is still open after a minute")
        }
        _ => answer,
    }
}

#[test]
fn a_header_that_announces_a_huge_body_takes_no_memory() {
    for length in ["100000000000000", "9223372036854775807", "9223372036854775808", "18446744073709551616", "-1"] {
        let mut attacked = Attacked::new();
        let host = &attacked.view.host;
        let _open = attacked.send(format!("GET / HTTP/1.1\r\nHost: {host}\r\nContent-Length: {length}\r\n\r\n"));
        attacked.assert_unharmed();
    }
}

#[test]
fn bodies_that_never_come_keep_nobody_waiting() {
    let mut attacked = Attacked::new();
    let headers =
        ["Content-Length: 2000", "Content-Length: 2000\r\nExpect: 100-continue", "Transfer-Encoding: chunked"];
    let send = |header| attacked.send(format!("GET / HTTP/1.1\r\nHost: x\r\n{header}\r\n\r\n"));
    let mut open = headers.map(send);
    attacked.assert_unharmed();
    open.iter_mut().for_each(|stream| drop(wait_until_closed(stream)));
}

#[test]
fn who_knows_the_address_can_send_no_body_either() {
    let mut attacked = Attacked::new();
    let (host, path) = (&attacked.view.host, &attacked.view.path);
    let mut open = attacked.send(format!("GET {path}now HTTP/1.1\r\nHost: {host}\r\nContent-Length: 2000\r\n\r\n"));
    let answer = String::from_utf8(wait_until_closed(&mut open)).unwrap();
    assert!(answer.starts_with("HTTP/1.1 413"), "{answer}");
    attacked.assert_unharmed();
}

#[test]
fn requests_whose_answers_nobody_reads_keep_nobody_waiting() {
    let mut attacked = Attacked::new();
    // Their answers are more than the system keeps for a reader, which is about 10 MB.
    let _open = attacked.send("GET / HTTP/1.1\r\nHost: x\r\n\r\n".repeat(200_000));
    // Time to answer until an answer waits for the reader.
    thread::sleep(Duration::from_secs(3));
    attacked.assert_unharmed();
}

#[test]
fn more_idle_connections_than_the_system_allows_keep_nobody_waiting() {
    let mut attacked = Attacked::under("ulimit -n 256");
    let _open: Vec<TcpStream> = (0..400).map(|_| attacked.connect()).collect();
    attacked.assert_unharmed();
}

#[test]
fn a_view_that_may_open_hardly_any_file_goes_on_when_it_can() {
    // About ten connections are allowed. After them, accepting fails.
    let mut attacked = Attacked::under("ulimit -n 24");
    let open: Vec<TcpStream> = (0..100).map(|_| attacked.send("GET")).collect();
    thread::sleep(Duration::from_secs(1));
    drop(open);
    attacked.assert_unharmed();
}

#[test]
fn a_header_without_an_end_is_cut_off() {
    let mut attacked = Attacked::new();
    let (mut line, mut lines) = (attacked.send("GET / HTTP/1.1\r\nHost: "), attacked.send("GET / HTTP/1.1\r\n"));
    for (stream, more) in [(&mut line, "x".repeat(1 << 20)), (&mut lines, "A: b\r\n".repeat(1 << 18))] {
        let sent = (0..300).take_while(|_| stream.write_all(more.as_bytes()).is_ok()).count();
        assert!(sent < 300, "all {sent} parts were taken");
    }
    attacked.assert_unharmed();
}

#[test]
fn a_header_that_comes_letter_by_letter_is_cut_off() {
    let mut attacked = Attacked::new();
    let mut open = attacked.send("GET / HTTP/1.1\r\nHost: ");
    let begun = Instant::now();
    while open.write_all(b"x").is_ok() {
        assert!(begun.elapsed() < FOR_EVER, "the connection is still open after a minute");
        thread::sleep(Duration::from_millis(50));
    }
    attacked.assert_unharmed();
}

#[test]
fn a_connection_that_says_nothing_is_closed() {
    let mut attacked = Attacked::new();
    let mut open = attacked.connect();
    assert_eq!(wait_until_closed(&mut open), b"");
    attacked.assert_unharmed();
}

#[test]
fn connections_that_come_all_the_time_keep_nobody_waiting() {
    let mut attacked = Attacked::new();
    let host = attacked.view.host.clone();
    let ended = AtomicBool::new(false);
    thread::scope(|scope| {
        scope.spawn(|| {
            let mut open = VecDeque::new();
            while !ended.load(Ordering::Relaxed) {
                open.extend(TcpStream::connect(&host));
                open.drain(..open.len().saturating_sub(200));
            }
        });
        // If an assertion fails, the other thread must end all the same.
        let outcome = catch_unwind(AssertUnwindSafe(|| (0..20).for_each(|_| attacked.assert_unharmed())));
        ended.store(true, Ordering::Relaxed);
        outcome.unwrap_or_else(|panic| resume_unwind(panic));
    });
}

#[test]
fn two_hundred_browsers_at_once_leave_the_view_as_it_was() {
    let mut attacked = Attacked::new();
    let _open: Vec<TcpStream> = (0..200).map(|_| attacked.send(attacked.request("now"))).collect();
    attacked.assert_unharmed();
}
