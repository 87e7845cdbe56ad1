//! A crew of threads, each of which serves at the other end of a pipe in memory, and what becomes of them.

use std::io::{self, Read, Write};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread;
use std::time::Duration;

use anyhow::Result;

use super::lies::lies;
use crate::fleet::bell::{Bell, Cord};
use crate::fleet::channel::{encode, receive};
use crate::fleet::link::{Crew, Frame, Link, News};
use crate::fleet::{MostGrowth, serve};
use dials_core::domain::Domain;

/// What happens to a worker at a certain frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Fate {
    Dies,
    /// The worker says nothing more, and ends when its link ends.
    Hangs,
    /// The worker sends the message of this number in [`lies`] and then hangs.
    Lies(usize),
}

/// Number of the worker's frame, from 0, at which its fate strikes, and the fate.
pub(super) type FateAt = (usize, Fate);

/// The crew of threads.
pub(super) struct ThreadCrew {
    pub(crate) domain: Arc<dyn Domain>,
    pub(crate) bell: Bell,
    pub(crate) can_replace: bool,
    /// Fates by worker. The next one in a list strikes the next worker that is started with that number.
    pub(crate) fates: Vec<Vec<FateAt>>,
    pub(crate) most_growth: MostGrowth,
}

impl Crew for ThreadCrew {
    fn start(&mut self, worker: usize) -> Result<Box<dyn Link>> {
        let fate = self.fates[worker].pop();
        let ((frames, incoming), (outgoing, said)) = (channel(), channel());
        let (cord, domain) = (self.bell.cord(), self.domain.clone());
        let pipe = Pipe { incoming, frames: 0, fate, rest: (Frame::default(), 0), outgoing: Some(outgoing), cord };
        thread::spawn(move || serve(pipe, |_| Ok(domain)));
        Ok(Box::new(ThreadLink { frames, said }))
    }

    fn can_replace(&self) -> bool {
        self.can_replace
    }

    fn wait(&mut self, at_most: Duration) {
        self.bell.wait(at_most);
    }
}

pub(super) struct ThreadLink {
    frames: Sender<Frame>,
    /// Messages, one in each item.
    said: Receiver<Vec<u8>>,
}

impl Link for ThreadLink {
    fn send(&self, frame: Frame) {
        let _ = self.frames.send(frame);
    }

    fn next(&mut self) -> Option<News> {
        match self.said.try_recv() {
            Ok(message) => Some(match receive(&mut &message[..]) {
                Ok(report) => News::Said(report.expect("no message is empty")),
                Err(error) => News::Gone(Some(error)),
            }),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(News::Gone(None)),
        }
    }

    fn state(&self) -> Option<String> {
        None
    }

    fn end(self: Box<Self>) -> String {
        "its thread ended".to_owned()
    }

    fn end_by_force(self: Box<Self>) -> String {
        "its thread is left alone".to_owned()
    }
}

/// The worker's end of the pipe.
struct Pipe {
    incoming: Receiver<Frame>,
    /// Number of frames so far.
    frames: usize,
    fate: Option<FateAt>,
    /// Frame that is being read, and number of its bytes read so far.
    rest: (Frame, usize),
    outgoing: Option<Sender<Vec<u8>>>,
    cord: Cord,
}

impl Read for Pipe {
    /// Reads nothing if the stream has ended.
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if self.rest.1 == self.rest.0.len() {
            let Ok(frame) = self.incoming.recv() else { return Ok(0) };
            match self.fate {
                Some((at, Fate::Dies)) if at == self.frames => return Ok(0),
                Some((at, fate @ (Fate::Hangs | Fate::Lies(_)))) if at == self.frames => {
                    if let Fate::Lies(number) = fate {
                        self.write_all(&encode(&lies().remove(number)).expect("it can be encoded"))?;
                    }
                    while self.incoming.recv().is_ok() {}
                    return Ok(0);
                }
                _ => {}
            }
            self.frames += 1;
            self.rest = (frame, 0);
        }
        let (frame, read) = &mut self.rest;
        let length = buffer.len().min(frame.len() - *read);
        buffer[..length].copy_from_slice(&frame[*read..][..length]);
        *read += length;
        Ok(length)
    }
}

impl Write for Pipe {
    /// Writes a whole message at a time.
    fn write(&mut self, message: &[u8]) -> io::Result<usize> {
        let outgoing = self.outgoing.as_ref().expect("it is only taken at the end");
        outgoing.send(message.to_vec()).map_err(|_| io::ErrorKind::BrokenPipe)?;
        self.cord.ring();
        Ok(message.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Pipe {
    fn drop(&mut self) {
        // The link sees the end only when this is dropped, so drop it before the bell rings.
        drop(self.outgoing.take());
        self.cord.ring();
    }
}
