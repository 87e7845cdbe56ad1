//! Requests to the live view. Its server runs in this process.

use std::io::{Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::OnceLock;
use std::thread;
use std::time::Duration;

use anyhow::{Result, ensure};
use dials_report::drawing::Svg;
use dials_report::live::page::{DelayView, Maps, Page};
use dials_report::live::server::LiveServer;
use dials_session::records::run_record::RunRecord;

use super::of_project;
use super::place::Place;

/// Stand for the host and the token, which the server draws.
const HOST: &str = "HOST";
const TOKEN: &str = "TOKEN";
/// Time limit. However slow the machine is, an answer that takes longer will never come.
const FOR_EVER: Duration = Duration::from_secs(60);

struct Known {
    host: String,
    token: String,
}

/// The runs of this page have no maps.
struct NoMaps;

impl Maps for NoMaps {
    fn returns(&mut self, _: &RunRecord) -> Option<Svg> {
        None
    }

    fn delays(&mut self, _: &RunRecord) -> Option<DelayView> {
        None
    }
}

/// Returns where the server of this process is. It begins with the first call.
fn server() -> &'static Known {
    static KNOWN: OnceLock<Known> = OnceLock::new();
    KNOWN.get_or_init(|| {
        let server = LiveServer::new(0).expect("a free port");
        let address = server.address();
        let mut words = address.trim_start_matches("http://").trim_end_matches('/').split('/');
        let mut next = || words.next().expect("an address has a host and a token").to_owned();
        let known = Known { host: next(), token: next() };
        thread::spawn(move || {
            let folder = of_project("tests/report/runs");
            server.serve(&mut Page::new(&folder, Box::new(NoMaps)), "runs").expect("it serves until the end");
        });
        known
    })
}

pub(crate) fn http_seeds(_: &Place) -> Vec<Vec<u8>> {
    let browser = "Host: HOST\r\nUser-Agent: Mozilla/5.0 (X11; Linux x86_64; rv:140.0) Gecko/20100101\r\nAccept: */*\r\n\
                   Accept-Encoding: gzip, deflate\r\nConnection: keep-alive\r\nSec-Fetch-Mode: cors\r\nPriority: u=4\r\n";
    [
        format!("GET /TOKEN/ HTTP/1.1\r\n{browser}\r\n"),
        format!("GET /TOKEN/shell.js HTTP/1.1\r\n{browser}\r\n"),
        format!("GET /TOKEN/now HTTP/1.1\r\n{browser}Content-Length: 0\r\n\r\n"),
        "GET /TOKEN/now HTTP/1.0\r\nHost: HOST\r\n\r\n".to_owned(),
    ]
    .map(String::into_bytes)
    .into()
}

/// Requests that must be refused, until they are changed.
pub(crate) fn refused(_: &Place) -> Vec<Vec<u8>> {
    let get = "GET /TOKEN/ HTTP/1.1\r\nHost: HOST\r\n";
    [
        format!("{get}Content-Length: 100000000000000\r\nExpect: 100-continue\r\n\r\n"),
        format!("{get}Transfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n0\r\n\r\n"),
        format!("{get}Connection: Upgrade, HTTP2-Settings\r\nUpgrade: h2c\r\nContent-Length: 5\r\n\r\nhello"),
        "GET / HTTP/1.1\r\nHost: HOST\r\n\r\n".repeat(3),
        "POST http://HOST/TOKEN/now HTTP/1.1\r\nHost: HOST\r\nContent-Length: 5\r\n\r\nhello".to_owned(),
        "CONNECT HOST HTTP/1.1\r\nHost: HOST\r\n\r\n".to_owned(),
    ]
    .map(String::into_bytes)
    .into()
}

/// Sends a request, and returns all that comes back until the server closes the connection.
fn ask(request: &[u8]) -> Vec<u8> {
    let mut stream = TcpStream::connect(&server().host).expect("the server is there");
    stream.set_read_timeout(Some(FOR_EVER)).expect("a time");
    // It may refuse and close before all is sent, or read.
    let _ = stream.write_all(request).and_then(|()| stream.shutdown(Shutdown::Write));
    let mut answer = Vec::new();
    if let Err(error) = stream.read_to_end(&mut answer) {
        assert!(error.kind() == std::io::ErrorKind::ConnectionReset, "no end of the answer: {error}");
    }
    answer
}

/// An accepted request names the token. After any request, the page is there as before.
pub(crate) fn http(_: &Place, bytes: &[u8]) -> Result<()> {
    let Known { host, token } = server();
    let sent = with(&with(bytes, HOST, host), TOKEN, token);
    let answer = ask(&sent);
    let accepted = answer.starts_with(b"HTTP/1.1 200 OK\r\n") || answer.starts_with(b"HTTP/1.0 200 OK\r\n");
    let names_token = sent.windows(token.len()).any(|part| part == token.as_bytes());
    assert!(!accepted || names_token, "the page is given to a request without the token");
    let page = ask(format!("GET /{token}/ HTTP/1.1\r\nHost: {host}\r\n\r\n").as_bytes());
    assert!(page.starts_with(b"HTTP/1.1 200 OK\r\n"), "an ordinary request gets: {}", String::from_utf8_lossy(&page));
    ensure!(accepted, "refused: {}", String::from_utf8_lossy(&answer));
    Ok(())
}

/// Replaces a word wherever it stands.
fn with(bytes: &[u8], word: &str, new: &str) -> Vec<u8> {
    let (mut rest, mut replaced) = (bytes, Vec::new());
    while let Some(byte) = rest.first() {
        if let Some(behind) = rest.strip_prefix(word.as_bytes()) {
            replaced.extend(new.as_bytes());
            rest = behind;
        } else {
            replaced.push(*byte);
            rest = &rest[1..];
        }
    }
    replaced
}
