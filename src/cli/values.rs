//! Values of the command line that clap cannot read by itself.

use std::ops::{Range, RangeInclusive};

use super::Seeds;
use clap::builder::{PossibleValue, PossibleValuesParser};
use dials_core::base::repeated;
use dials_learn::config::short_forms;
use dials_traffic::config::DEMAND;
use dials_traffic::config::sumo_time::seconds as seconds_of;

pub(super) fn short_form() -> PossibleValuesParser {
    let capital = |text: &str| format!("{}{}", text[..1].to_uppercase(), &text[1..]);
    short_forms().into_iter().map(|form| PossibleValue::new(form.name).help(capital(form.help))).into()
}

/// Reads the first second and the one after the last.
pub(super) fn seconds(text: &str) -> Result<Range<usize>, String> {
    let ends = text.split_once(',').and_then(|(from, to)| Some(from.trim().parse().ok()?..to.trim().parse().ok()?));
    let ends = ends.ok_or("must be two seconds, such as 600,1200")?;
    if ends.start < ends.end { Ok(ends) } else { Err("must begin before it ends, such as 600,1200".to_owned()) }
}

/// Reads a second as SUMO's files write it: as a number or as a clock.
pub(super) fn time(text: &str) -> Result<u64, String> {
    let second = seconds_of(text).ok().filter(|second| second.fract() == 0.0 && (0.0..2_f64.powi(53)).contains(second));
    second.map(|second| second as u64).ok_or_else(|| "must be a whole second, such as 25200 or 07:00:00".to_owned())
}

/// Returns a reader of whole numbers of this range, written as `--set` has them: `1000000`, `1_000_000` or `1e6`.
pub(super) fn whole<T: TryFrom<u64>>(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        let number =
            whole_number(text).filter(|number| range.contains(number)).and_then(|number| number.try_into().ok());
        number.ok_or_else(|| format!("must be a whole number from {} to {}", range.start(), range.end()))
    }
}

pub(super) fn seed(text: &str) -> Result<u64, String> {
    whole(0..=u64::MAX)(text)
}

/// Largest number of seeds of a benchmark.
const MOST_SEEDS: u64 = 1000;

/// Reads seeds: `1..5` are five, `1,2,7` are three.
pub(super) fn seeds(text: &str) -> Result<Seeds, String> {
    let range =
        text.split_once("..").map(|(first, last)| (whole_number(first), whole_number(last.trim_start_matches('='))));
    let seeds = match range {
        Some((Some(first), Some(last))) if first <= last && last - first < MOST_SEEDS => Some((first..=last).collect()),
        Some(_) => None,
        None => text.split(',').map(|seed| whole_number(seed.trim())).collect::<Option<Vec<u64>>>(),
    };
    let wrong = || format!("must be seeds such as 1..5 or 1,2,7, each once, and at most {MOST_SEEDS}");
    let seeds: Vec<u64> = seeds.ok_or_else(wrong)?;
    if repeated(&seeds).is_some() || seeds.len() as u64 > MOST_SEEDS { Err(wrong()) } else { Ok(Seeds(seeds)) }
}

pub(super) fn number_of_steps(text: &str) -> Result<u64, String> {
    // TOML, in which runs write it down, has no larger numbers.
    let steps = whole_number(text).filter(|steps| *steps <= i64::MAX as u64);
    steps.ok_or_else(|| "must be a whole number such as 1000000 or 1e6".to_owned())
}

fn whole_number(text: &str) -> Option<u64> {
    let digits = text.replace('_', "");
    let whole = |number: &f64| number.fract() == 0.0 && (0.0..2_f64.powi(53)).contains(number);
    let rounded = || digits.parse::<f64>().ok().filter(whole).map(|number| number as u64);
    digits.parse::<u64>().ok().or_else(rounded)
}

pub(super) fn sigma(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if (0.0..=1.0).contains(&number) { Ok(number) } else { Err("must be from 0 to 1".to_owned()) }
}

/// Reads a factor on the demand.
pub(super) fn demand(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    let (least, most) = (DEMAND.start(), DEMAND.end());
    if DEMAND.contains(&number) { Ok(number) } else { Err(format!("must be from {least} to {most}")) }
}

pub(super) fn inflow_at(text: &str) -> Result<(String, f64), String> {
    let (dead_end, probability) = text.split_once('=').ok_or("must be DEAD_END=PROBABILITY, such as w1=0.3")?;
    Ok((dead_end.trim().to_owned(), finite(probability.trim())?))
}

pub(super) fn finite(text: &str) -> Result<f64, String> {
    let number = number(text)?;
    if number.is_finite() { Ok(number) } else { Err("must be a finite number".to_owned()) }
}

pub(super) fn number(text: &str) -> Result<f64, String> {
    text.parse().map_err(|_| "must be a number such as 0.5".to_owned())
}
