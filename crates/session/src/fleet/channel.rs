//! Messages on a stream of bytes: a header, then the message in postcard's format.

use std::io::{ErrorKind, Read, Write};

use anyhow::{Context, Result, ensure};
use serde::Serialize;
use serde::de::DeserializeOwned;

const MAGIC: [u8; 4] = *b"DIAL";
/// Number of the protocol. Bump it when a message changes its shape: other builds must not misread it.
const PROTOCOL: u16 = 6;
/// Length limit in bytes. Longer messages mean a broken stream: the datasets and states of 10 000 agents are shorter.
const LONGEST: u64 = 1 << 36;
/// Length of a header: magic, protocol and the length of the message.
const HEADER: usize = 14;

/// Encodes a message with its header. The frame can be sent any number of times.
pub fn encode<T: Serialize>(message: &T) -> Result<Vec<u8>> {
    let mut frame = Vec::new();
    frame.extend(MAGIC);
    frame.extend(PROTOCOL.to_le_bytes());
    frame.extend([0; 8]);
    let mut frame = postcard::to_extend(message, frame).context("a message cannot be encoded")?;
    let length = (frame.len() - HEADER) as u64;
    frame[HEADER - 8..HEADER].copy_from_slice(&length.to_le_bytes());
    Ok(frame)
}

pub(super) fn send<T: Serialize>(stream: &mut impl Write, message: &T) -> Result<()> {
    Ok(stream.write_all(&encode(message)?)?)
}

/// Reads the next message. If the other side has closed the stream: `None`.
pub fn receive<T: DeserializeOwned>(stream: &mut impl Read) -> Result<Option<T>> {
    receive_frame(stream)?.map(|frame| decode(&frame)).transpose()
}

/// Reads the next message like [`receive`], but leaves it encoded, with its header.
pub(super) fn receive_frame(stream: &mut impl Read) -> Result<Option<Vec<u8>>> {
    let mut header = [0; HEADER];
    match stream.read_exact(&mut header) {
        Err(error) if matches!(error.kind(), ErrorKind::UnexpectedEof | ErrorKind::ConnectionReset) => return Ok(None),
        outcome => outcome?,
    }
    let length = length_in(header)?;
    let mut frame = header.to_vec();
    let read = stream.take(length).read_to_end(&mut frame)?;
    ensure!(read as u64 == length, "a message ended after {read} of {length} bytes");
    Ok(Some(frame))
}

pub(super) fn decode<T: DeserializeOwned>(frame: &[u8]) -> Result<T> {
    let (header, payload) = frame.split_first_chunk().context("a message ended within its header")?;
    let length = length_in(*header)?;
    ensure!(payload.len() as u64 == length, "a message ended after {} of {length} bytes", payload.len());
    postcard::from_bytes(payload).context("a message cannot be decoded")
}

/// Returns the length of the message that follows a header.
fn length_in(header: [u8; HEADER]) -> Result<u64> {
    let (magic, rest) = header.split_at(4);
    let (protocol, length) = rest.split_at(2);
    ensure!(magic == MAGIC, "the channel received data that is not one of our messages");
    let protocol = u16::from_le_bytes(protocol.try_into().expect("two bytes"));
    ensure!(
        protocol == PROTOCOL,
        "received a message of protocol {protocol}, but this program uses {PROTOCOL}: coordinator and workers must be \
         the same build"
    );
    let length = u64::from_le_bytes(length.try_into().expect("eight bytes"));
    ensure!(length <= LONGEST, "a message of {length} bytes was announced, which is longer than any of ours");
    Ok(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn error_of(frame: &[u8]) -> String {
        receive::<Vec<u32>>(&mut &frame[..]).unwrap_err().to_string()
    }

    #[test]
    fn other_versions_strangers_and_torn_messages_have_errors_of_their_own() {
        let frame = encode(&vec![1_u32, 2, 3]).unwrap();
        let mut newer = frame.clone();
        newer[4] = 9;
        let expected = format!("received a message of protocol 9, but this program uses {PROTOCOL}");
        assert!(error_of(&newer).contains(&expected));
        assert!(error_of(b"GET / HTTP/1.1\r\n").contains("not one of our messages"));
        assert!(error_of(&frame[..frame.len() - 1]).contains("ended after 3 of 4 bytes"));
        for cut in [3, frame.len() - 1] {
            assert!(decode::<Vec<u32>>(&frame[..cut]).unwrap_err().to_string().contains("a message ended"));
        }
        let mut endless = frame;
        endless[13] = 0xff;
        assert!(error_of(&endless).contains("which is longer than any of ours"));
    }
}
