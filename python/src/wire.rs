//! Orders and answers on the control channel: a sequence of records, which arrive whole or not at all.
//!
//! A record begins with the number of the order (eight bytes, little endian), a tag, and 1 if it is the last record of
//! this order or answer. Then comes its piece of the payload. An answer has the number of its order. If Ctrl-C
//! interrupted that order, Python drops the answer.
//!
//! Numbers of a step do not go here. They are in the shared [`Memory`](crate::memory::Memory).

use std::fmt;
use std::io::{ErrorKind, Read, Write};

use anyhow::{Context, Result, bail, ensure};
use serde::de::DeserializeOwned;

/// Largest payload that is read: a request with the names of ten thousand agents is far below it.
const LARGEST: usize = 16 << 20;
/// Largest record.
const RECORD: usize = 16 << 10;
/// Bytes of a record before its piece of the payload.
const HEAD: usize = 10;

/// Tags of the parent.
pub(crate) const BEGIN: u8 = b'B';
pub(crate) const RESET: u8 = b'R';
pub(crate) const STEP: u8 = b'S';
pub(crate) const MEASURE: u8 = b'M';
pub(crate) const DRAW: u8 = b'D';
pub(crate) const LOOK: u8 = b'L';
pub(crate) const KEEP: u8 = b'K';
pub(crate) const TAKE: u8 = b'T';

/// Tags of the answers.
const DONE: u8 = b'K';
const FAILED: u8 = b'E';
const REFUSED: u8 = b'V';

/// An argument that was wrong. Python raises it as a `ValueError`, like those that it finds itself.
#[derive(Debug)]
pub(crate) struct Refused(pub String);

impl fmt::Display for Refused {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        to.write_str(&self.0)
    }
}

impl std::error::Error for Refused {}

/// An order of the parent.
pub(crate) struct Order {
    pub number: u64,
    pub tag: u8,
    pub payload: Vec<u8>,
}

/// Reads the next order. `None`: the parent has closed the channel. Every read of `stream` must return one record.
pub(crate) fn receive(stream: &mut impl Read) -> Result<Option<Order>> {
    let mut record = [0; RECORD];
    let mut begun: Option<Order> = None;
    loop {
        let length = match stream.read(&mut record) {
            Ok(0) => return Ok(None),
            Err(error) if error.kind() == ErrorKind::Interrupted => continue,
            read => read.context("cannot read an order")?,
        };
        let Some(([number @ .., tag, is_last], piece)) = record[..length].split_first_chunk::<HEAD>() else {
            bail!("a record of {length} bytes");
        };
        let number = u64::from_le_bytes(*number);
        // An order of which no more comes was interrupted.
        let mut order = begun.take().filter(|order| order.number == number).unwrap_or_else(|| Order {
            number,
            tag: *tag,
            payload: Vec::new(),
        });
        ensure!(order.payload.len() + piece.len() <= LARGEST, "an order of more than {LARGEST} bytes");
        order.payload.extend_from_slice(piece);
        if *is_last == 1 {
            return Ok(Some(order));
        }
        begun = Some(order);
    }
}

/// Reads the payload of an order.
pub(crate) fn read<T: DeserializeOwned>(payload: &[u8]) -> Result<T> {
    serde_json::from_slice(payload).context(
        "this order cannot be read; Python checks what is in it, so it is of another version of the package: install it again",
    )
}

/// Writes the answer to an order: its payload, or the reason why there is none. Every write to `stream` makes a record.
pub(crate) fn answer(stream: &mut impl Write, number: u64, outcome: &Result<Vec<u8>>) -> Result<()> {
    let reason;
    let (tag, payload) = match outcome {
        Ok(payload) => (DONE, payload.as_slice()),
        Err(error) => {
            reason = format!("{error:#}");
            (if error.is::<Refused>() { REFUSED } else { FAILED }, reason.as_bytes())
        }
    };
    let mut rest = payload;
    loop {
        let (piece, later) = rest.split_at(rest.len().min(RECORD - HEAD));
        let record = [&number.to_le_bytes()[..], &[tag, u8::from(later.is_empty())], piece].concat();
        stream.write_all(&record).context("cannot answer")?;
        if later.is_empty() {
            return Ok(());
        }
        rest = later;
    }
}
