//! A connection to the Python process that started this run, whose functions it calls.
//!
//! A message is a header in JSON and the bytes of arrays. This side asks, and the other one answers. Nothing is shared: the
//! arrays of a message belong to whoever got it, so both sides may keep them.
//!
//! On the socket a message is: the length of the header (four bytes), the length of the arrays (eight bytes, both little
//! endian), the header, the arrays. Each array begins at a multiple of eight bytes. The header of a question is
//! `{"call", "values", "arrays": [[name, dtype, shape], ...]}`. That of an answer has no `call`, or is `{"error": text}`.
//! The other end of it is `python/dials_traffic/_link.py`.
//!
//! ```no_run
//! # fn main() -> anyhow::Result<()> {
//! use dials_session::python::{Array, Link};
//! use serde_json::json;
//!
//! // Both the wish and what belongs to it are given to the function that the Python side has for this wish.
//! let mut link = Link::open("reward", &json!({ "agents": ["A0", "A1"] }))?;
//! let queues: [f32; 4] = [0.0, 1.0, 2.0, 3.0];
//! let answer = link.ask("reward", json!({ "step": 7 }), &[Array::of("queues", &[2, 2], &queues)])?;
//! let rewards: Vec<f32> = answer.array("rewards", &[2])?;
//! # Ok(()) }
//! ```

use std::borrow::Cow;
use std::env;
use std::io::{ErrorKind, Read, Write};
use std::os::unix::net::UnixStream;

use anyhow::{Context, Result, bail, ensure};
use bytemuck::{CheckedBitPattern, NoUninit};
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

/// The variable with the path of the socket. Child processes inherit it.
pub const LINK: &str = "DIALS_TRAFFIC_LINK";

/// Largest header, and largest sum of arrays: far more than any run needs.
const LARGEST_HEADER: usize = 64 << 20;
const LARGEST_BODY: usize = 32 << 30;
/// Every array begins at a multiple of this.
const ALIGNMENT: usize = 8;
/// Bytes before the header.
const HEAD: usize = 12;

/// A number that both sides know.
pub trait Number: NoUninit + CheckedBitPattern {
    /// Name of the type in numpy.
    const DTYPE: &'static str;
}

macro_rules! numbers {
    ($($type:ty: $dtype:literal),*) => { $(impl Number for $type { const DTYPE: &'static str = $dtype; })* };
}
numbers!(bool: "b1", u8: "u1", i32: "i4", u32: "u4", i64: "i8", u64: "u8", f32: "f4", f64: "f8");

/// Numbers with a name and a shape, the last index fastest.
#[derive(Clone, Debug, PartialEq)]
pub struct Array<'a> {
    name: &'a str,
    dtype: &'a str,
    shape: Vec<usize>,
    bytes: Cow<'a, [u8]>,
}

impl<'a> Array<'a> {
    /// Makes an array of borrowed numbers. Panics unless the shape is that of this many.
    pub fn of<T: Number>(name: &'a str, shape: &[usize], numbers: &'a [T]) -> Array<'a> {
        assert_eq!(shape.iter().product::<usize>(), numbers.len(), "the shape of `{name}`");
        Array { name, dtype: T::DTYPE, shape: shape.to_vec(), bytes: Cow::Borrowed(bytemuck::cast_slice(numbers)) }
    }
}

/// What the Python process has answered.
#[derive(Debug)]
pub struct Answer {
    /// What is no array: whatever both sides agreed on.
    pub values: Value,
    arrays: Vec<(String, String, Vec<usize>)>,
    body: Vec<u8>,
}

impl Answer {
    /// Reads an array, whose shape must be this one.
    pub fn array<T: Number>(&self, name: &str, shape: &[usize]) -> Result<Vec<T>> {
        if let Some((_, _, found)) = self.arrays.iter().find(|(known, ..)| known == name) {
            ensure!(found == shape, "`{name}` has the shape {found:?} instead of {shape:?}");
        }
        Ok(self.any_array(name)?.1)
    }

    /// Reads an array of any shape. Returns the shape, too.
    pub fn any_array<T: Number>(&self, name: &str) -> Result<(Vec<usize>, Vec<T>)> {
        let mut begin = 0;
        for (known, dtype, shape) in &self.arrays {
            let bytes = size_of_array(dtype, shape)?;
            if known == name {
                ensure!(dtype == T::DTYPE, "`{name}` is of type {dtype} instead of {}", T::DTYPE);
                let bytes = self.body.get(begin..begin + bytes).with_context(|| format!("`{name}` is cut short"))?;
                let number = |bytes| bytemuck::checked::try_pod_read_unaligned(bytes);
                let numbers: Result<Vec<T>, _> = bytes.chunks_exact(size_of::<T>()).map(number).collect();
                return Ok((shape.clone(), numbers.ok().with_context(|| format!("`{name}` has what is no {dtype}"))?));
            }
            begin = (begin + bytes).next_multiple_of(ALIGNMENT);
        }
        bail!("it has no `{name}`")
    }
}

/// A connection to the Python process. It is closed when it is dropped.
#[derive(Debug)]
pub struct Link {
    stream: UnixStream,
    wants: String,
    /// What the other side said at the beginning.
    pub opened: Value,
}

#[derive(Serialize)]
struct Question<'a> {
    call: &'a str,
    values: &'a Value,
    arrays: Vec<(&'a str, &'a str, &'a [usize])>,
}

#[derive(Deserialize)]
struct Header {
    error: Option<String>,
    #[serde(default)]
    values: Value,
    #[serde(default)]
    arrays: Vec<(String, String, Vec<usize>)>,
}

impl Link {
    /// Returns whether a Python process started this one.
    pub fn is_there() -> bool {
        env::var_os(LINK).is_some()
    }

    /// Connects. `wants`: what for, such as `reward`; `about`: what the Python process needs to know for it. What that answers
    /// is in [`Link::opened`].
    pub fn open(wants: &str, about: &Value) -> Result<Link> {
        let path = env::var_os(LINK).with_context(|| {
            format!(
                "the {wants} of this config is written in Python, and no Python process has started this command; run it \
                 with dials_traffic.train(...) or dials_traffic.dials(...), as docs/python.md says"
            )
        })?;
        let stream = UnixStream::connect(&path)
            .with_context(|| format!("the Python process that started this run has ended ({})", path.display()))?;
        let mut link = Link { stream, wants: wants.to_owned(), opened: Value::Null };
        link.opened = link.ask("open", json!({ "wants": wants, "about": about }), &[])?.values;
        Ok(link)
    }

    /// Asks for something, and waits for the answer. An error of the user's code is an error here. The Python process raises
    /// it there, with its traceback, when this run has ended.
    pub fn ask(&mut self, call: &str, values: Value, arrays: &[Array<'_>]) -> Result<Answer> {
        self.send(call, &values, arrays)
            .and_then(|()| self.receive())
            .with_context(|| format!("the {} of the Python process: no answer to `{call}`", self.wants))
            .and_then(|(header, body)| match header {
                Header { error: Some(error), .. } => bail!("{} in Python: {error}", self.wants),
                Header { values, arrays, .. } => Ok(Answer { values, arrays, body }),
            })
    }

    fn send(&mut self, call: &str, values: &Value, arrays: &[Array<'_>]) -> Result<()> {
        let about = arrays.iter().map(|array| (array.name, array.dtype, &array.shape[..])).collect();
        let header = serde_json::to_vec(&Question { call, values, arrays: about })?;
        let body: usize = arrays.iter().map(|array| array.bytes.len().next_multiple_of(ALIGNMENT)).sum();
        let mut message = Vec::with_capacity(HEAD + header.len() + body);
        message.extend((header.len() as u32).to_le_bytes());
        message.extend((body as u64).to_le_bytes());
        message.extend(header);
        let begin = message.len();
        for array in arrays {
            message.extend_from_slice(&array.bytes);
            message.resize(begin + (message.len() - begin).next_multiple_of(ALIGNMENT), 0);
        }
        self.stream.write_all(&message).map_err(gone)
    }

    fn receive(&mut self) -> Result<(Header, Vec<u8>)> {
        let mut head = [0; HEAD];
        self.stream.read_exact(&mut head).map_err(gone)?;
        let (header, body) = head.split_first_chunk::<4>().expect("the head is longer");
        let lengths = (u32::from_le_bytes(*header) as usize, u64::from_le_bytes(body.try_into()?) as usize);
        ensure!(lengths.0 <= LARGEST_HEADER && lengths.1 <= LARGEST_BODY, "a message of {lengths:?} bytes");
        let (mut header, mut body) = (vec![0; lengths.0], vec![0; lengths.1]);
        self.stream.read_exact(&mut header).map_err(gone)?;
        self.stream.read_exact(&mut body).map_err(gone)?;
        Ok((serde_json::from_slice(&header).context("a header that cannot be read")?, body))
    }
}

fn gone(error: std::io::Error) -> anyhow::Error {
    match error.kind() {
        ErrorKind::UnexpectedEof | ErrorKind::BrokenPipe | ErrorKind::ConnectionReset => {
            anyhow::anyhow!("that process has ended")
        }
        _ => error.into(),
    }
}

/// Returns the number of bytes of an array.
fn size_of_array(dtype: &str, shape: &[usize]) -> Result<usize> {
    let size: Option<usize> = dtype.get(1..).and_then(|size| size.parse().ok());
    let size =
        size.filter(|size| matches!(size, 1 | 2 | 4 | 8)).with_context(|| format!("the unknown type {dtype}"))?;
    let bytes = shape.iter().try_fold(size, |bytes, &of| bytes.checked_mul(of));
    bytes.filter(|&bytes| bytes <= LARGEST_BODY).with_context(|| format!("an array of the shape {shape:?}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::thread;

    /// Plays the other side: takes the next message, and answers it with these bytes.
    fn answer_with(mut stream: UnixStream, header: Value, body: Vec<u8>) -> thread::JoinHandle<Vec<u8>> {
        thread::spawn(move || {
            let mut head = [0; HEAD];
            stream.read_exact(&mut head).unwrap();
            let length = u32::from_le_bytes(head[..4].try_into().unwrap()) as usize
                + u64::from_le_bytes(head[4..].try_into().unwrap()) as usize;
            let mut message = vec![0; length];
            stream.read_exact(&mut message).unwrap();
            let header = header.to_string();
            stream.write_all(&(header.len() as u32).to_le_bytes()).unwrap();
            stream.write_all(&(body.len() as u64).to_le_bytes()).unwrap();
            stream.write_all(header.as_bytes()).unwrap();
            stream.write_all(&body).unwrap();
            message
        })
    }

    fn ask(header: Value, body: Vec<u8>) -> (Result<Answer>, Vec<u8>) {
        let (ours, theirs) = UnixStream::pair().unwrap();
        let other = answer_with(theirs, header, body);
        let mut link = Link { stream: ours, wants: "reward".to_owned(), opened: Value::Null };
        let arrays = [Array::of("few", &[3], &[1_u8, 2, 3]), Array::of("half", &[1, 1], &[0.5_f32])];
        (link.ask("rate", json!({ "step": 7 }), &arrays), other.join().unwrap())
    }

    #[test]
    fn arrays_arrive_as_they_were_sent_each_at_a_multiple_of_eight_bytes() {
        let header = json!({ "values": 3, "arrays": [["flags", "b1", [2]], ["sums", "f8", [1, 2]]] });
        let body =
            [vec![1, 0, 0, 0, 0, 0, 0, 0], 1.5_f64.to_le_bytes().to_vec(), 2.5_f64.to_le_bytes().to_vec()].concat();
        let (answer, message) = ask(header, body);
        let answer = answer.unwrap();
        assert_eq!(answer.values, 3);
        assert_eq!(answer.array::<bool>("flags", &[2]).unwrap(), [true, false]);
        assert_eq!(answer.array::<f64>("sums", &[1, 2]).unwrap(), [1.5, 2.5]);
        let asked = br#"{"call":"rate","values":{"step":7},"arrays":[["few","u1",[3]],["half","f4",[1,1]]]}"#;
        // 0.5 is 0x3f000000.
        assert_eq!(message, [&asked[..], &[1, 2, 3, 0, 0, 0, 0, 0], &[0, 0, 0, 0x3f, 0, 0, 0, 0]].concat());
    }

    #[test]
    fn what_is_wrong_with_an_answer_is_said() {
        let header = json!({ "arrays": [["flags", "b1", [2]], ["sums", "f8", [1]]] });
        let answer = ask(header, vec![2; 10]).0.unwrap();
        let said = |error: anyhow::Error| format!("{error:#}");
        assert_eq!(said(answer.array::<bool>("flags", &[3]).unwrap_err()), "`flags` has the shape [2] instead of [3]");
        assert_eq!(said(answer.array::<bool>("flags", &[2]).unwrap_err()), "`flags` has what is no b1");
        assert_eq!(said(answer.array::<f32>("sums", &[1]).unwrap_err()), "`sums` is of type f8 instead of f4");
        assert_eq!(said(answer.array::<f64>("sums", &[1]).unwrap_err()), "`sums` is cut short");
        assert_eq!(said(answer.array::<f64>("means", &[1]).unwrap_err()), "it has no `means`");
        let refused = ask(json!({ "error": "ZeroDivisionError: division by zero" }), Vec::new()).0.unwrap_err();
        assert_eq!(said(refused), "reward in Python: ZeroDivisionError: division by zero");
    }

    #[test]
    fn a_process_that_has_ended_is_no_silent_one() {
        let (ours, theirs) = UnixStream::pair().unwrap();
        drop(theirs);
        let mut link = Link { stream: ours, wants: "learner".to_owned(), opened: Value::Null };
        let error = format!("{:#}", link.ask("act", Value::Null, &[]).unwrap_err());
        assert_eq!(error, "the learner of the Python process: no answer to `act`: that process has ended");
    }
}
