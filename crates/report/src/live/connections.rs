//! Connections, and what limits them. Everybody on this machine can make some, without knowing the token.
//!
//! A connection carries one request and is closed after the answer. One that has not named the token yet is a
//! *stranger*: it has little time, and gives way if there are too many. So however many strangers there are, they take
//! bounded memory, and keep no browser waiting.

use std::collections::VecDeque;
use std::pin::pin;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use hyper::Request;
use hyper::body::Incoming;
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper_util::rt::TokioIo;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch::error::RecvError;
use tokio::task::{JoinHandle, yield_now};
use tokio::time::{Instant, sleep, timeout_at};

use super::answers::{Answer, Answers};

/// Most connections at a time. A browser makes up to six to one host.
const CONNECTIONS: usize = 64;
/// Longest header, in bytes. Browsers send about 1 KiB.
const HEADER: usize = 16 << 10;
/// Time for a stranger to send a header and take a refusal.
const FOR_STRANGERS: Duration = Duration::from_secs(5);
/// Time for a browser to take the page, once it is made.
const FOR_BROWSERS: Duration = Duration::from_secs(30);
/// Time until the next attempt if no connection can be accepted, such as when there are too many open files.
const PAUSE: Duration = Duration::from_millis(100);

/// How far a connection has come, and until when it may be there.
#[derive(Clone, Copy)]
enum Stage {
    /// It has not named the token yet.
    Stranger { until: Instant },
    /// Its page is being made, which may take any time.
    Waits,
    /// Its page is made.
    Takes { until: Instant },
}

struct Connection {
    task: JoinHandle<()>,
    stage: Arc<Mutex<Stage>>,
}

/// Accepts connections and answers them, until it is dropped.
pub(super) async fn answer_all(listener: TcpListener, answers: Arc<Answers>) {
    // The oldest comes first.
    let mut open = VecDeque::new();
    loop {
        let accepted = listener.accept().await;
        open.retain(|connection: &Connection| !connection.task.is_finished());
        let stranger = open.iter().position(Connection::is_stranger);
        match accepted {
            Ok((stream, _)) => {
                if open.len() >= CONNECTIONS {
                    close(&mut open, stranger.unwrap_or(0)).await;
                }
                open.push_back(Connection::begin(stream, answers.clone()));
                // All others have a turn between two that are accepted. So a request that came together with its
                // connection is read long before the connection is the oldest.
                yield_now().await;
            }
            // No error ends the loop. Where too many files are open, a stranger's is one of them.
            Err(_) => {
                if let Some(stranger) = stranger {
                    close(&mut open, stranger).await;
                }
                sleep(PAUSE).await;
            }
        }
    }
}

async fn close(open: &mut VecDeque<Connection>, place: usize) {
    let Some(connection) = open.remove(place) else { return };
    connection.task.abort();
    // Its file is closed when the task has ended.
    let _ = connection.task.await;
}

impl Connection {
    fn begin(stream: TcpStream, answers: Arc<Answers>) -> Connection {
        let stage = Arc::new(Mutex::new(Stage::Stranger { until: Instant::now() + FOR_STRANGERS }));
        Connection { task: tokio::spawn(serve(stream, answers, stage.clone())), stage }
    }

    fn is_stranger(&self) -> bool {
        matches!(read(&self.stage), Stage::Stranger { .. })
    }
}

fn read(stage: &Mutex<Stage>) -> Stage {
    *stage.lock().expect("nobody panics with the lock")
}

fn write(stage: &Mutex<Stage>, new: Stage) {
    *stage.lock().expect("nobody panics with the lock") = new;
}

/// Answers one request, and ends when the time of its stage is over.
async fn serve(stream: TcpStream, answers: Arc<Answers>, stage: Arc<Mutex<Stage>>) {
    let mut http = http1::Builder::new();
    // The stages limit the time, also that of a header. Who has sent a request may close its own direction.
    http.keep_alive(false).half_close(true).max_buf_size(HEADER).header_read_timeout(None);
    let service = service_fn(|request| answer(&answers, &stage, request));
    let mut served = pin!(http.serve_connection(TokioIo::new(stream), service));
    loop {
        let until = match read(&stage) {
            Stage::Stranger { until } | Stage::Takes { until } => until,
            Stage::Waits => Instant::now() + FOR_BROWSERS,
        };
        // After a wait it may be in another stage, with time left.
        if until <= Instant::now() || timeout_at(until, served.as_mut()).await.is_ok() {
            return;
        }
    }
}

/// Never reads the body: a request for the page has none.
async fn answer(answers: &Answers, stage: &Mutex<Stage>, request: Request<Incoming>) -> Result<Answer, RecvError> {
    let part = match answers.part(&request) {
        Ok(part) => part,
        Err(refusal) => return Ok(refusal.answer()),
    };
    write(stage, Stage::Waits);
    let answer = answers.give(part).await;
    write(stage, Stage::Takes { until: Instant::now() + FOR_BROWSERS });
    answer
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::{Read, Write};
    use std::net;
    use std::sync::mpsc::channel;
    use std::thread;

    use crate::live::maker::pages;
    use tokio::runtime::Builder;

    #[test]
    fn a_browser_that_waits_for_its_page_does_not_give_way_to_strangers() {
        let (pages, maker) = pages();
        let (begins, has_begun) = channel();
        let (allow, allowed) = channel::<()>();
        thread::spawn(move || {
            maker.run(|| {
                begins.send(()).unwrap();
                allowed.recv().unwrap();
                "what is new".to_owned()
            });
        });
        let listener = net::TcpListener::bind("127.0.0.1:0").unwrap();
        listener.set_nonblocking(true).unwrap();
        let host = listener.local_addr().unwrap().to_string();
        let answers = Arc::new(Answers::new(host.clone(), "cafe".to_owned(), "runs", pages));
        thread::spawn(move || {
            let runtime = Builder::new_current_thread().enable_io().enable_time().build().unwrap();
            runtime.block_on(async { answer_all(TcpListener::from_std(listener).unwrap(), answers).await });
        });
        let connect = || net::TcpStream::connect(&host).unwrap();
        let mut browser = connect();
        write!(browser, "GET /cafe/now HTTP/1.1\r\nHost: {host}\r\n\r\n").unwrap();
        has_begun.recv().unwrap();
        let mut strangers: Vec<net::TcpStream> = (0..3 * CONNECTIONS).map(|_| connect()).collect();
        assert!(matches!(strangers[0].read(&mut [0]), Ok(0) | Err(_)), "the oldest stranger has given way");
        allow.send(()).unwrap();
        let mut answer = String::new();
        browser.read_to_string(&mut answer).unwrap();
        assert!(answer.starts_with("HTTP/1.1 200") && answer.ends_with("what is new"), "{answer}");
    }
}
