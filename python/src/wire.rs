//! Frames on the control channel: a tag, a length of four bytes (little endian) and the payload.
//!
//! Numbers of a step do not go here. They are in the shared [`Memory`](crate::memory::Memory).

use std::io::{ErrorKind, Read, Write};

use anyhow::{Context, Result, ensure};
use serde::de::DeserializeOwned;

/// Largest payload that is read: a request with the names of ten thousand agents is far below it.
const LARGEST: usize = 16 << 20;

/// Tags of the parent.
pub const BEGIN: u8 = b'B';
pub const RESET: u8 = b'R';
pub const STEP: u8 = b'S';
pub const MEASURE: u8 = b'M';
pub const DRAW: u8 = b'D';
pub const LOOK: u8 = b'L';
pub const KEEP: u8 = b'K';

/// Tags of the answers.
const DONE: u8 = b'K';
const FAILED: u8 = b'E';

/// Reads the next order. `None`: the parent has closed the channel.
pub fn receive(stream: &mut impl Read) -> Result<Option<(u8, Vec<u8>)>> {
    let mut head = [0; 5];
    match stream.read_exact(&mut head) {
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => return Ok(None),
        read => read.context("cannot read an order")?,
    }
    let [tag, length @ ..] = head;
    let length = u32::from_le_bytes(length) as usize;
    ensure!(length <= LARGEST, "an order of {length} bytes");
    let mut payload = vec![0; length];
    stream.read_exact(&mut payload).context("an order was cut short")?;
    Ok(Some((tag, payload)))
}

/// Reads the payload of an order.
pub fn read<T: DeserializeOwned>(payload: &[u8]) -> Result<T> {
    serde_json::from_slice(payload).context("this order is of another version of the package; install it again")
}

/// Writes the answer to an order: its payload, or the reason why there is none.
pub fn answer(stream: &mut impl Write, outcome: &Result<Vec<u8>>) -> Result<()> {
    let reason;
    let (tag, payload) = match outcome {
        Ok(payload) => (DONE, payload.as_slice()),
        Err(error) => {
            reason = format!("{error:#}");
            (FAILED, reason.as_bytes())
        }
    };
    let length = u32::try_from(payload.len()).context("an answer of more than 4 GiB")?;
    let frame = [&[tag][..], &length.to_le_bytes(), payload].concat();
    stream.write_all(&frame).context("cannot answer")
}
