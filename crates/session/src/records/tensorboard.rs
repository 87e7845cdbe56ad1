//! TensorBoard event files: the numbers of the CSV files, for people who watch runs in TensorBoard.
//!
//! A file of records (TFRecord: length, checksum, data, checksum), each a protocol buffer `Event` with scalars. Records
//! are only ever appended, and a record that is written again after a resume has the same length. So the file is cut
//! back to a checkpoint like the CSV files, and no step appears in it twice.
//!
//! Source of the format: `tensorboard/compat/proto/{event,summary}.proto` and `tensorflow/core/lib/io/record_writer.h`.

use super::columns::{self, ALL};
use super::files;
use dials_learn::evaluation::csv::Lines;

pub(crate) type Scalar = (String, f32);

pub(crate) fn first_record(wall_time_s: f64) -> Vec<u8> {
    let mut event = event_at(wall_time_s, 0);
    put_bytes(&mut event, 3, b"brain.Event:2"); // file_version
    record(&event)
}

/// Makes one record with all scalars of a step.
pub(crate) fn scalars_record(wall_time_s: f64, step: u64, scalars: &[Scalar]) -> Vec<u8> {
    let mut summary = Vec::new();
    for (tag, number) in scalars {
        let mut value = Vec::new();
        put_bytes(&mut value, 1, tag.as_bytes());
        put_key(&mut value, 2, FIXED_32); // simple_value
        value.extend(number.to_le_bytes());
        put_bytes(&mut summary, 1, &value);
    }
    let mut event = event_at(wall_time_s, step);
    put_bytes(&mut event, 5, &summary);
    record(&event)
}

/// Returns the scalars of lines of a CSV file: `file/column` of all agents, `returns_of_agents/N` of each.
pub(crate) fn scalars_of(file: &str, Lines { header, lines }: &Lines) -> Vec<Scalar> {
    let table = file.strip_suffix(".csv").unwrap_or(file);
    let mut scalars = Vec::new();
    for line in lines {
        // The first column is the step, the second the agent, worker or process.
        let numbers = header.iter().zip(line).skip(2);
        let numbers = numbers.filter_map(|(column, value)| Some((column, value.parse::<f32>().ok()?)));
        if line[1] == ALL {
            scalars.extend(numbers.map(|(column, number)| (format!("{table}/{column}"), number)));
        } else if file == files::RETURNS {
            let mean = numbers.filter(|(column, _)| *column == columns::MEAN);
            scalars.extend(mean.map(|(_, number)| (format!("returns_of_agents/{}", line[1]), number)));
        }
    }
    scalars
}

// Types of fields on the wire.
const VARINT: u8 = 0;
const FIXED_64: u8 = 1;
const BYTES: u8 = 2;
const FIXED_32: u8 = 5;

fn event_at(wall_time_s: f64, step: u64) -> Vec<u8> {
    let mut event = Vec::new();
    put_key(&mut event, 1, FIXED_64);
    event.extend(wall_time_s.to_le_bytes());
    // A zero is left out.
    if step > 0 {
        put_key(&mut event, 2, VARINT);
        put_varint(&mut event, step);
    }
    event
}

fn put_key(out: &mut Vec<u8>, field: u8, kind: u8) {
    out.push(field << 3 | kind);
}

fn put_bytes(out: &mut Vec<u8>, field: u8, bytes: &[u8]) {
    put_key(out, field, BYTES);
    put_varint(out, bytes.len() as u64);
    out.extend(bytes);
}

/// Writes seven bits per byte, the lowest first; the eighth bit says that more follow.
fn put_varint(out: &mut Vec<u8>, mut number: u64) {
    while number >= 0x80 {
        out.push(number as u8 | 0x80);
        number >>= 7;
    }
    out.push(number as u8);
}

fn record(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    [&length[..], &masked_checksum(&length), data, &masked_checksum(data)].concat()
}

/// Computes a checksum that works for data that holds checksums itself.
fn masked_checksum(data: &[u8]) -> [u8; 4] {
    crc32c::crc32c(data).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bytes(hex: &str) -> Vec<u8> {
        let digits = hex.split_whitespace().collect::<String>();
        (0..digits.len()).step_by(2).map(|at| u8::from_str_radix(&digits[at..at + 2], 16).unwrap()).collect()
    }

    #[test]
    fn records_are_those_that_the_tensorboard_package_writes() {
        // Written by RecordWriter and Event of tensorboard 2.21.0 from PyPI with these values.
        let first = "1800000000000000a37f4b22 09000000000000f83f 1a0d627261696e2e4576656e743a32 2a28646c";
        assert_eq!(first_record(1.5), bytes(first));
        let scalars = [("returns/mean".to_owned(), 167.9), ("aip_loss/held_out_after".to_owned(), 0.31)];
        let second = "440000000000000043592e9a 0900000000000004 4010808e062a350a130a0c72657475726e732f6d65616e1566\
                      e627430a1e0a176169705f6c6f73732f68656c645f6f75745f61667465721552b89e3e 4473c002";
        assert_eq!(scalars_record(2.5, 100_096, &scalars), bytes(second));
        let later = scalars_record(1_795_000_000.25, 100_096, &scalars);
        assert_eq!(later.len(), bytes(second).len(), "a resume writes as many bytes, whatever the time");
    }

    #[test]
    fn lines_about_all_agents_become_scalars_and_those_of_agents_their_mean_return() {
        let scalars = |file: &str, header: &str, lines: &[&str]| {
            let row = |text: &&str| text.split(',').map(str::to_owned).collect();
            scalars_of(file, &Lines { header: row(&header), lines: lines.iter().map(row).collect() })
        };
        let named = |named: &[(&str, f32)]| -> Vec<Scalar> {
            named.iter().map(|&(name, number)| (name.to_owned(), number)).collect()
        };
        let all = [("returns/mean", 5.5), ("returns/median", 6.0), ("returns/stuck", 1.0)];
        let agents = [("returns_of_agents/0", 4.0), ("returns_of_agents/1", 7.0)];
        let (header, lines) = ("steps,agent,mean,median,stuck", ["128,all,5.5,6,1", "128,0,4,4,1", "128,1,7,7,0"]);
        assert_eq!(scalars("returns.csv", header, &lines), named(&[&all[..], &agents].concat()));
        assert_eq!(scalars("training.csv", header, &lines[1..]), []);
        // NaN is left out: a period without episodes has no mean return, and sources are called `all`.
        let header = "steps,agent,source,training_after,frequency";
        let found = scalars("aip_loss.csv", header, &["0,all,all,0.31,", "0,0,all,0.3,0.1"]);
        assert_eq!(found, named(&[("aip_loss/training_after", 0.31)]));
    }
}
