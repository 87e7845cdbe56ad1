//! One input made from others: a seed of the pool, changed in one to a few places.

use dials_core::base::{Dice, Seed};
use rand::Rng;

use super::{text, xml};

/// Longest input, but for deep nests.
const LONGEST: usize = 1 << 18;

/// What the inputs of a target are, which decides how they are mutated.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Form {
    /// TOML, JSON or CSV.
    Text,
    Xml,
    /// A header of JSON behind its length in eight bytes, then data.
    Tensors,
    /// Messages, each behind a header of fourteen bytes that ends with the length.
    Messages,
}

/// What inputs are made of. It grows with those that led to something new.
pub struct Pool {
    /// Real files, and saved inputs.
    seeds: Vec<Vec<u8>>,
    accepted: Vec<Vec<u8>>,
    /// One of each kind of error.
    refused: Vec<Vec<u8>>,
    taken: usize,
}

/// Number of accepted inputs, and of refused ones, that are kept.
const KEPT: usize = 200;

impl Pool {
    pub fn new(seeds: Vec<Vec<u8>>) -> Pool {
        Pool { seeds, accepted: Vec::new(), refused: Vec::new(), taken: 0 }
    }

    pub fn take(&mut self, bytes: Vec<u8>, accepted: bool) {
        let kept = if accepted { &mut self.accepted } else { &mut self.refused };
        self.taken += 1;
        if kept.len() < KEPT {
            kept.push(bytes);
        } else {
            kept[self.taken % KEPT] = bytes;
        }
    }

    /// Draws one. Most inputs that are made of refused ones are refused for the same reason.
    fn draw(&self, dice: &mut Dice) -> &Vec<u8> {
        let from = match dice.random_range(0..10) {
            0..=4 => &self.seeds,
            5..=7 => &self.accepted,
            _ => &self.refused,
        };
        pick(dice, if from.is_empty() { &self.seeds } else { from })
    }
}

/// Returns an input. `seed`, `index`: its name among all inputs of a target; `pool`: what it may be made of.
pub fn mutated(form: Form, pool: &Pool, seed: u64, index: u64) -> Vec<u8> {
    let mut dice = Seed::new(seed).fork_named("fuzz").for_steps(index).dice();
    let mut bytes = pool.draw(&mut dice).clone();
    // Most inputs have one or two changes: many changes at once are refused for the first of them.
    let changes = 1 + usize::from(dice.random_bool(0.5)) * dice.random_range(0..4);
    for _ in 0..changes {
        if dice.random_bool(0.08) {
            let other = pool.draw(&mut dice);
            bytes = splice(&mut dice, &bytes, other);
            continue;
        }
        let plain = dice.random_bool(0.15);
        bytes = match form {
            _ if plain => bytewise(&mut dice, bytes),
            Form::Text => text::mutated(&mut dice, bytes),
            Form::Xml => xml::mutated(&mut dice, bytes),
            Form::Tensors => tensors(&mut dice, bytes),
            Form::Messages => messages(&mut dice, bytes),
        };
        if form != Form::Xml {
            bytes.truncate(LONGEST);
        }
    }
    bytes
}

pub fn pick<'a, T>(dice: &mut Dice, from: &'a [T]) -> &'a T {
    &from[dice.random_range(0..from.len())]
}

/// Returns a range within a length: short ones more often than long ones.
pub fn stretch(dice: &mut Dice, length: usize) -> std::ops::Range<usize> {
    let begin = dice.random_range(0..=length);
    let most = if dice.random_bool(0.7) { 8.min(length - begin) } else { length - begin };
    begin..begin + dice.random_range(0..=most)
}

fn splice(dice: &mut Dice, one: &[u8], other: &[u8]) -> Vec<u8> {
    let (end, begin) = (dice.random_range(0..=one.len()), dice.random_range(0..=other.len()));
    // Often at the same place, as after a write that a crash tore.
    let begin = if dice.random_bool(0.5) { end.min(other.len()) } else { begin };
    [&one[..end], &other[begin..]].concat()
}

fn bytewise(dice: &mut Dice, mut bytes: Vec<u8>) -> Vec<u8> {
    let place = dice.random_range(0..bytes.len().max(1)).min(bytes.len().saturating_sub(1));
    match dice.random_range(0..7) {
        0 if !bytes.is_empty() => bytes[place] ^= 1 << dice.random_range(0..8),
        1 if !bytes.is_empty() => bytes[place] = *pick(dice, &[0, 1, 0x7f, 0x80, 0xff, b'"', b'\n', b'<', b'-']),
        2 => {
            let at = stretch(dice, bytes.len());
            bytes.drain(at);
        }
        3 => {
            let at = stretch(dice, bytes.len());
            let copied = bytes[at.clone()].to_vec();
            bytes.splice(at.end..at.end, copied);
        }
        4 => bytes.truncate(place),
        5 => {
            let zeros = vec![0; dice.random_range(1..600)];
            bytes.splice(place..place, zeros);
        }
        _ => {
            // As after a power loss: the length is right, the end was never written.
            let length = bytes.len();
            bytes[place.min(length)..].fill(0);
        }
    }
    bytes
}

/// Mutates the header of a safetensors file as text, and its data as bytes.
fn tensors(dice: &mut Dice, bytes: Vec<u8>) -> Vec<u8> {
    let Some((length, rest)) = bytes.split_first_chunk::<8>() else { return bytewise(dice, bytes) };
    let length = (u64::from_le_bytes(*length) as usize).min(rest.len());
    let (header, data) = rest.split_at(length);
    if dice.random_bool(0.2) {
        let data = bytewise(dice, data.to_vec());
        return [&(length as u64).to_le_bytes(), header, &data].concat();
    }
    let header = if dice.random_bool(0.3) { digit(dice, header) } else { text::mutated(dice, header.to_vec()) };
    let told = if dice.random_bool(0.9) { header.len() as u64 } else { dice.random() };
    [&told.to_le_bytes()[..], &header, data].concat()
}

/// Changes one digit or letter of a text: what a check of its form does not see.
fn digit(dice: &mut Dice, text: &[u8]) -> Vec<u8> {
    let mut text = text.to_vec();
    let places: Vec<usize> = (0..text.len()).filter(|&place| text[place].is_ascii_alphanumeric()).collect();
    if !places.is_empty() {
        let place = *pick(dice, &places);
        let letters = if text[place].is_ascii_digit() { b'0'..=b'9' } else { b'a'..=b'z' };
        text[place] = dice.random_range(letters);
    }
    text
}

/// Mutates the payload of a message and mostly corrects its length.
fn messages(dice: &mut Dice, bytes: Vec<u8>) -> Vec<u8> {
    let Some((header, payload)) = bytes.split_at_checked(14) else { return bytewise(dice, bytes) };
    let mut payload = bytewise(dice, payload.to_vec());
    if dice.random_bool(0.3) && !payload.is_empty() {
        // A length in postcard's variable form, as large as it can be.
        let place = dice.random_range(0..payload.len());
        payload.splice(place..place, [0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x01]);
    }
    let told = if dice.random_bool(0.9) { payload.len() as u64 } else { dice.random() };
    [&header[..6], &told.to_le_bytes(), &payload].concat()
}
