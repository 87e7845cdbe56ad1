//! One input made from others: one of them, changed in at most four places.
//!
//! A change finds all places of a kind in a part of the input, such as the numbers of a header, and acts on one of them.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::LazyLock;

use proptest::collection::vec;
use proptest::prelude::{Strategy, any, prop_oneof};
use proptest::sample::{Index, select};

/// Longest input, but for XML, whose nests are deep.
const LONGEST: usize = 1 << 18;

/// What the inputs of a target are, which decides how they are mutated.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Form {
    /// TOML, JSON or CSV.
    Text,
    Xml,
    /// A header of JSON behind its length in eight bytes, then data.
    Tensors,
    /// Messages, each behind a header of fourteen bytes that ends with the length.
    Messages,
}

/// Part of an input that is changed.
#[derive(Clone, Copy, Debug)]
enum Part {
    All,
    /// What a length counts that stands before it, and is corrected.
    Counted,
    /// What comes behind that.
    Rest,
}

/// Finds places in a part.
type Find = fn(&[u8]) -> Vec<Range<usize>>;

#[derive(Clone, Copy, Debug)]
enum Act {
    Remove,
    /// Copies it to another such place.
    Copy,
    Repeat(usize),
    /// Replaces it by a value of `hostile.json`.
    Hostile(&'static str),
    /// Puts a value of `hostile.json` behind it.
    Behind(&'static str),
    With(&'static [&'static [u8]]),
    Around(&'static [(&'static str, &'static str)]),
    Nest(usize),
    Zeros,
    Flip,
    /// Replaces it by the end of another input, as after a write that a crash tore.
    OtherEnd,
}

type Row = (Find, Act);

const TEXT: &[Row] = &[
    (numbers, Act::Hostile("numbers")),
    (numbers, Act::Hostile("numbers")),
    (numbers, Act::Hostile("numbers")),
    (numbers, Act::Copy),
    (bytes, Act::With(&[b"0", b"1", b"7", b"a", b"z"])),
    (quoted, Act::Hostile("names")),
    (values, Act::Hostile("values")),
    (values, Act::Copy),
    (cells, Act::Hostile("numbers")),
    (cells, Act::Hostile("names")),
    (cells, Act::Copy),
    (lines, Act::Remove),
    (lines, Act::Copy),
    (lines, Act::Repeat(1000)),
];
const XML: &[Row] = &[
    (numbers, Act::Hostile("numbers")),
    (numbers, Act::Hostile("numbers")),
    (numbers, Act::Around(&[("", ".0"), ("", "e0"), ("+", ""), ("0", ""), ("", "."), ("", "0000000000000000001")])),
    (quoted, Act::Hostile("names")),
    (tags, Act::Behind("elements")),
    (beginning, Act::Behind("prologues")),
    (attributes, Act::Remove),
    (attributes, Act::Copy),
    // The prefix is declared in a saved input. Readers differ in what they then see.
    (words, Act::Around(&[("x:", "")])),
    (tags, Act::Nest(64)),
    (tags, Act::Nest(300_000)),
    (elements, Act::Remove),
    (elements, Act::Copy),
    (elements, Act::Around(&[("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?x ", "?>")])),
];
const BYTES: &[Row] = &[
    (bytes, Act::Flip),
    (bytes, Act::With(&[b"\0", b"\x01", b"\x7f", b"\x80", b"\xff", b"\"", b"\n", b"<", b"-", b""])),
    (spans, Act::Remove),
    (spans, Act::Copy),
    (spans, Act::Repeat(60)),
    // A length in postcard's variable form, as large as it can be.
    (spans, Act::With(&[b"\xff\xff\xff\xff\xff\xff\xff\xff\xff\x01"])),
    (ends, Act::Remove),
    // As after a power loss: the length is right, the end was never written.
    (ends, Act::Zeros),
    (ends, Act::OtherEnd),
];

#[derive(Clone, Debug)]
struct Change {
    part: Part,
    find: Find,
    act: Act,
    at: [Index; 2],
}

/// An input by the number of another one and what is changed in that.
#[derive(Clone, Debug)]
pub(crate) struct Case {
    from: Index,
    changes: Vec<Change>,
}

pub(crate) fn cases(form: Form) -> impl Strategy<Value = Case> {
    let of = |part: Part, rows: &[Row]| rows.iter().map(|&(find, act)| (part, find, act)).collect::<Vec<_>>();
    let rows = match form {
        Form::Text => [of(Part::All, TEXT).repeat(4), of(Part::All, BYTES)],
        Form::Xml => [of(Part::All, XML).repeat(4), of(Part::All, BYTES)],
        Form::Tensors => [of(Part::Counted, TEXT).repeat(2), [of(Part::Rest, BYTES), of(Part::All, BYTES)].concat()],
        Form::Messages => [of(Part::Counted, BYTES).repeat(4), of(Part::All, BYTES)],
    };
    let change = (select(rows.concat()), any::<[Index; 2]>());
    let change = change.prop_map(|((part, find, act), at)| Change { part, find, act, at });
    // Many changes at once are refused for the first of them.
    let changes = prop_oneof![3 => vec(change.clone(), 1), 2 => vec(change, 2..=4)];
    (any::<Index>(), changes).prop_map(|(from, changes)| Case { from, changes })
}

impl Case {
    /// Returns the input. `inputs`: those that it may be made of.
    pub(crate) fn bytes(&self, inputs: &[Vec<u8>], form: Form) -> Vec<u8> {
        let mut bytes = self.from.get(inputs).clone();
        for change in &self.changes {
            let counted = counted(&bytes, form);
            let place = match change.part {
                Part::All => 0..bytes.len(),
                Part::Counted => counted.clone(),
                Part::Rest => counted.end..bytes.len(),
            };
            let mut part = bytes[place.clone()].to_vec();
            change.make(&mut part, inputs);
            let length = (part.len() as u64).to_le_bytes();
            bytes.splice(place, part);
            if matches!(change.part, Part::Counted) && counted.start >= 8 {
                bytes[counted.start - 8..counted.start].copy_from_slice(&length);
            }
            bytes.truncate(if let Form::Xml = form { 16 * LONGEST } else { LONGEST });
        }
        bytes
    }
}

/// Returns what a length counts that stands before it.
fn counted(bytes: &[u8], form: Form) -> Range<usize> {
    let header = match form {
        Form::Text | Form::Xml => 0,
        Form::Tensors => 8,
        Form::Messages => 14,
    };
    if bytes.len() < header {
        return 0..bytes.len();
    }
    let length = bytes[..header].last_chunk().map_or(usize::MAX, |length| u64::from_le_bytes(*length) as usize);
    header..header.saturating_add(length).min(bytes.len())
}

/// Returns a list of `hostile.json`.
fn hostile(list: &str) -> &'static [String] {
    static LISTS: LazyLock<HashMap<String, Vec<String>>> =
        LazyLock::new(|| serde_json::from_str(include_str!("hostile.json")).expect("lists of texts"));
    &LISTS[list]
}

impl Change {
    fn make(&self, bytes: &mut Vec<u8>, inputs: &[Vec<u8>]) {
        let places = (self.find)(bytes);
        if places.is_empty() {
            return;
        }
        let [at, more] = &self.at;
        let (place, other) = (at.get(&places).clone(), more.get(&places).start);
        let old = bytes[place.clone()].to_vec();
        let around = |before: &[u8], after: &[u8]| [before, &old, after].concat();
        let new = match self.act {
            Act::Remove => Vec::new(),
            Act::Repeat(times) => old.repeat(times.min(LONGEST / old.len().max(1))),
            Act::Hostile(list) => more.get(hostile(list)).clone().into_bytes(),
            Act::Behind(list) => around(&[], more.get(hostile(list)).as_bytes()),
            Act::With(list) => more.get(list).to_vec(),
            Act::Around(pairs) => around(more.get(pairs).0.as_bytes(), more.get(pairs).1.as_bytes()),
            Act::Nest(depth) => around(&[], ["<a>".repeat(depth), "</a>".repeat(depth)].concat().as_bytes()),
            Act::Zeros => vec![0; old.len()],
            Act::Flip => old.iter().map(|byte| byte ^ (1 << more.index(8))).collect(),
            Act::OtherEnd => {
                let other = more.get(inputs);
                other[place.start.min(other.len())..].to_vec()
            }
            Act::Copy => {
                bytes.splice(other..other, old);
                return;
            }
        };
        bytes.splice(place, new);
    }
}

/// Returns the places whose bytes all belong together.
fn together(bytes: &[u8], belongs: impl Fn(u8) -> bool) -> Vec<Range<usize>> {
    let mut end = 0;
    let parts = bytes.chunk_by(|&one, &next| belongs(one) == belongs(next));
    let places = parts.map(|part| {
        end += part.len();
        (belongs(part[0]), end - part.len()..end)
    });
    places.filter(|(belongs, _)| *belongs).map(|(_, place)| place).collect()
}

fn numbers(bytes: &[u8]) -> Vec<Range<usize>> {
    let mut found = together(bytes, |byte| byte.is_ascii_digit() || b".-+_".contains(&byte));
    found.retain(|place| bytes[place.clone()].iter().any(u8::is_ascii_digit));
    found
}

/// Returns what stands between quotation marks.
fn quoted(bytes: &[u8]) -> Vec<Range<usize>> {
    let marks: Vec<usize> = (0..bytes.len()).filter(|&place| b"\"'".contains(&bytes[place])).collect();
    marks.chunks_exact(2).map(|marks| marks[0] + 1..marks[1]).collect()
}

/// Returns what stands behind `=` or `:`, up to the end of the line or the next comma.
fn values(bytes: &[u8]) -> Vec<Range<usize>> {
    let begins = (0..bytes.len()).filter(|&place| b"=:".contains(&bytes[place])).map(|place| place + 1);
    let length = |rest: &[u8]| rest.iter().position(|byte| b"\n,}".contains(byte)).unwrap_or(rest.len());
    begins.map(|begin| begin..begin + length(&bytes[begin..])).collect()
}

fn cells(bytes: &[u8]) -> Vec<Range<usize>> {
    together(bytes, |byte| !b",\n\0".contains(&byte))
}

fn lines(bytes: &[u8]) -> Vec<Range<usize>> {
    let mut end = 0;
    let ends = bytes.split_inclusive(|&byte| byte == b'\n').map(|line| line.len());
    let place = |length| {
        end += length;
        end - length..end
    };
    ends.map(place).collect()
}

/// Returns the stretches from a `<` to the next `>`. In one pass from the end, because a deep nest has very many.
fn tags(bytes: &[u8]) -> Vec<Range<usize>> {
    let (mut found, mut end) = (Vec::new(), None);
    for (place, byte) in bytes.iter().enumerate().rev() {
        match (byte, end) {
            (b'>', _) => end = Some(place + 1),
            (b'<', Some(end)) => found.push(place..end),
            _ => {}
        }
    }
    found
}

/// Returns the stretches from a tag to the next one that closes an element or is one alone.
fn elements(bytes: &[u8]) -> Vec<Range<usize>> {
    let (mut found, mut end) = (Vec::new(), None);
    for tag in tags(bytes) {
        let (closes, alone) = (bytes[tag.clone()].starts_with(b"</"), bytes[tag.clone()].ends_with(b"/>"));
        end = if closes || alone { Some(tag.end) } else { end };
        found.extend(end.filter(|_| !closes).map(|end| tag.start..end));
    }
    found
}

fn words(bytes: &[u8]) -> Vec<Range<usize>> {
    together(bytes, |byte| byte.is_ascii_alphanumeric())
}

/// Returns what stands between blanks, which in a tag are its attributes.
fn attributes(bytes: &[u8]) -> Vec<Range<usize>> {
    together(bytes, |byte| !b" />".contains(&byte))
}

fn beginning(_: &[u8]) -> Vec<Range<usize>> {
    std::iter::once(0..0).collect()
}

fn bytes(bytes: &[u8]) -> Vec<Range<usize>> {
    (0..bytes.len()).map(|place| place..place + 1).collect()
}

fn spans(bytes: &[u8]) -> Vec<Range<usize>> {
    (0..bytes.len()).map(|place| place..(place + 1 + place % 8).min(bytes.len())).collect()
}

fn ends(bytes: &[u8]) -> Vec<Range<usize>> {
    (0..bytes.len()).map(|place| place..bytes.len()).collect()
}
