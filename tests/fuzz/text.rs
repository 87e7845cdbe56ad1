//! Mutations of TOML, JSON and CSV, by what looks like a number, a name, a value, a cell or a line.

use std::ops::Range;

use dials_core::base::Dice;
use rand::Rng;

use super::hostile::{NAMES, NUMBERS, VALUES};
use super::mutate::{pick, stretch};

pub fn mutated(dice: &mut Dice, mut bytes: Vec<u8>) -> Vec<u8> {
    match dice.random_range(0..10) {
        0..=2 => replace(dice, &mut bytes, numbers, NUMBERS),
        3 => replace(dice, &mut bytes, names, NAMES),
        4 => replace(dice, &mut bytes, values, VALUES),
        5 => {
            let with = if dice.random_bool(0.5) { NUMBERS } else { NAMES };
            replace(dice, &mut bytes, cells, with);
        }
        6 => {
            let (from, to) = (some_of(dice, &cells(&bytes)), some_of(dice, &values(&bytes)));
            if let (Some(from), Some(to)) = (from, to) {
                let moved = bytes[from].to_vec();
                bytes.splice(to, moved);
            }
        }
        _ => bytes = lines(dice, &bytes),
    }
    bytes
}

/// Replaces one of the places that `find` finds.
pub fn replace(dice: &mut Dice, bytes: &mut Vec<u8>, find: fn(&[u8]) -> Vec<Range<usize>>, with: &[&str]) {
    if let Some(place) = some_of(dice, &find(bytes)) {
        bytes.splice(place, pick(dice, with).bytes());
    }
}

pub fn some_of(dice: &mut Dice, places: &[Range<usize>]) -> Option<Range<usize>> {
    (!places.is_empty()).then(|| pick(dice, places).clone())
}

/// Returns the places whose letters all belong together.
fn runs(bytes: &[u8], belongs: impl Fn(u8) -> bool) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut begin = None;
    for (place, &byte) in bytes.iter().chain([&0]).enumerate() {
        match (begin, belongs(byte)) {
            (None, true) => begin = Some(place),
            (Some(first), false) => {
                found.push(first..place);
                begin = None;
            }
            _ => {}
        }
    }
    found
}

pub fn numbers(bytes: &[u8]) -> Vec<Range<usize>> {
    let mut found = runs(bytes, |byte| byte.is_ascii_digit() || b".-+_".contains(&byte));
    found.retain(|place| bytes[place.clone()].iter().any(u8::is_ascii_digit));
    found
}

/// Returns what stands between quotation marks.
pub fn names(bytes: &[u8]) -> Vec<Range<usize>> {
    let marks: Vec<usize> = (0..bytes.len()).filter(|&place| b"\"'".contains(&bytes[place])).collect();
    marks.chunks_exact(2).map(|marks| marks[0] + 1..marks[1]).collect()
}

/// Returns what stands behind `=` or `:`, up to the end of the line or the next comma.
fn values(bytes: &[u8]) -> Vec<Range<usize>> {
    let begins = (0..bytes.len()).filter(|&place| b"=:".contains(&bytes[place]));
    let end = |begin: usize| {
        bytes[begin..].iter().position(|byte| b"\n,}".contains(byte)).map_or(bytes.len(), |end| begin + end)
    };
    begins.map(|place| place + 1..end(place + 1)).collect()
}

fn cells(bytes: &[u8]) -> Vec<Range<usize>> {
    runs(bytes, |byte| !b",\n\0".contains(&byte))
}

/// Removes, repeats, moves or exchanges lines, or breaks one.
fn lines(dice: &mut Dice, bytes: &[u8]) -> Vec<u8> {
    let mut lines: Vec<Vec<u8>> = bytes.split_inclusive(|&byte| byte == b'\n').map(<[u8]>::to_vec).collect();
    if lines.is_empty() {
        return pick(dice, NAMES).as_bytes().to_vec();
    }
    let place = dice.random_range(0..lines.len());
    match dice.random_range(0..7) {
        0 => {
            lines.drain(stretch(dice, lines.len()));
        }
        1 => {
            let copied = lines[stretch(dice, lines.len())].to_vec();
            lines.splice(place..place, copied);
        }
        2 => {
            let other = dice.random_range(0..lines.len());
            lines.swap(place, other);
        }
        3 => {
            let times = *pick(dice, &[2, 10, 1000]);
            let line = lines[place].clone();
            lines.splice(place..place, vec![line; times]);
        }
        4 => {
            let length = lines[place].len();
            lines[place].truncate(length / 2);
        }
        5 => lines[place].splice(0..0, pick(dice, NAMES).bytes()).for_each(drop),
        _ => {
            let line = lines.remove(place);
            lines.push(line);
        }
    }
    lines.concat()
}
