//! Mutations of XML, by its tags, elements and attributes.

use std::ops::Range;

use dials_core::base::Dice;
use rand::Rng;

use super::hostile::{ELEMENTS, NAMES, NUMBERS, PROLOGUES};
use super::mutate::pick;
use super::text::{names, numbers, replace, some_of};

pub fn mutated(dice: &mut Dice, mut bytes: Vec<u8>) -> Vec<u8> {
    match dice.random_range(0..17) {
        0..=2 => replace(dice, &mut bytes, numbers, NUMBERS),
        14 | 15 => rewrite(dice, &mut bytes),
        3 => replace(dice, &mut bytes, names, NAMES),
        4 => insert(dice, &mut bytes, ELEMENTS),
        5 => {
            let with = pick(dice, PROLOGUES).bytes();
            bytes.splice(0..0, with);
        }
        // An attribute that is gone, or there twice, or of another element.
        6 => drop(some_of(dice, &attributes(&bytes)).map(|place| bytes.drain(place))),
        7 => {
            let places = attributes(&bytes);
            if let (Some(from), Some(to)) = (some_of(dice, &places), some_of(dice, &places)) {
                let copied = bytes[from].to_vec();
                bytes.splice(to.end..to.end, copied);
            }
        }
        8 => drop(some_of(dice, &elements(&bytes)).map(|place| bytes.drain(place))),
        9 | 10 => {
            // An element that is there twice, or somewhere else, or inside another one.
            let (from, to) = (some_of(dice, &elements(&bytes)), some_of(dice, &tags(&bytes)));
            if let (Some(from), Some(to)) = (from, to) {
                let copied = bytes[from.clone()].to_vec();
                if dice.random_bool(0.4) {
                    bytes.splice(from.clone(), Vec::new());
                }
                let to = to.end.min(bytes.len());
                bytes.splice(to..to, copied);
            }
        }
        11 => namespace(dice, &mut bytes),
        12 => nest(dice, &mut bytes),
        _ => comment(dice, &mut bytes),
    }
    bytes
}

/// Writes a number in another way, which readers may take for the same number or not.
fn rewrite(dice: &mut Dice, bytes: &mut Vec<u8>) {
    let Some(place) = some_of(dice, &numbers(bytes)) else { return };
    let number = String::from_utf8_lossy(&bytes[place.clone()]).into_owned();
    let other = match dice.random_range(0..7) {
        0 => format!("{number}.0"),
        1 => format!("{number}e0"),
        2 => format!("+{number}"),
        3 => format!("0{number}"),
        4 => format!("{number}."),
        5 => format!("{number}000000000000000000001"),
        _ => format!(" {number} "),
    };
    bytes.splice(place, other.bytes());
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
    found.reverse();
    found
}

/// Returns the elements without others inside, and those from a first tag to the next closing one.
fn elements(bytes: &[u8]) -> Vec<Range<usize>> {
    let tags = tags(bytes);
    let closing = |place: &Range<usize>| bytes[place.clone()].starts_with(b"</");
    let single = tags.iter().filter(|place| bytes[(*place).clone()].ends_with(b"/>")).cloned();
    let whole = tags.windows(2).filter(|pair| !closing(&pair[0]) && closing(&pair[1]));
    let (mut longer, mut end) = (Vec::new(), None);
    for place in tags.iter().rev() {
        match (closing(place), end) {
            (true, _) => end = Some(place.end),
            (false, Some(end)) => longer.push(place.start..end),
            (false, None) => {}
        }
    }
    longer.reverse();
    single.chain(whole.map(|pair| pair[0].start..pair[1].end)).chain(longer).collect()
}

/// Returns the attributes with the blank before each.
fn attributes(bytes: &[u8]) -> Vec<Range<usize>> {
    let begin = |mark: usize| bytes[..mark].iter().rposition(|&byte| byte == b' ');
    names(bytes).into_iter().filter_map(|value| Some(begin(value.start)?..value.end + 1)).collect()
}

fn insert(dice: &mut Dice, bytes: &mut Vec<u8>, what: &[&str]) {
    if let Some(place) = some_of(dice, &tags(bytes)) {
        bytes.splice(place.end..place.end, pick(dice, what).bytes());
    }
}

/// Puts a tag or an attribute into a namespace: readers differ in what they then see.
fn namespace(dice: &mut Dice, bytes: &mut Vec<u8>) {
    let prefix = b"x:";
    if dice.random_bool(0.5) {
        if let Some(place) = some_of(dice, &attributes(bytes)) {
            bytes.splice(place.start + 1..place.start + 1, *prefix);
        }
    } else if let Some(place) = some_of(dice, &tags(bytes)) {
        bytes.splice(place.start + 1..place.start + 1, *prefix);
    }
    // The prefix is declared at the root, which is the first tag that is no declaration.
    let root = tags(bytes).into_iter().find(|place| bytes[place.start + 1].is_ascii_alphabetic());
    if let Some(root) = root.filter(|_| dice.random_bool(0.9)) {
        let end = bytes[root.clone()].iter().position(|byte| b" >/".contains(byte)).unwrap_or(1);
        bytes.splice(root.start + end..root.start + end, *b" xmlns:x=\"http://x\"");
    }
}

/// Nests an element in itself, more or less deeply.
fn nest(dice: &mut Dice, bytes: &mut Vec<u8>) {
    let depth = *pick(dice, &[2, 64, 1_000, 20_000, 300_000]);
    let nested = ["<a>".repeat(depth), "</a>".repeat(depth)].concat();
    if let Some(place) = some_of(dice, &tags(bytes)) {
        bytes.splice(place.end..place.end, nested.bytes());
    }
}

/// Hides an element in a comment, or in a section of text.
fn comment(dice: &mut Dice, bytes: &mut Vec<u8>) {
    let (open, close) = *pick(dice, &[("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?x ", "?>")]);
    if let Some(place) = some_of(dice, &elements(bytes)) {
        bytes.splice(place.end..place.end, close.bytes());
        bytes.splice(place.start..place.start, open.bytes());
    }
}
