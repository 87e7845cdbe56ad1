//! Numbers in a text, as SUMO reads them.

/// A number in a text, by where it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Number {
    /// The whole text, or one of a list.
    Plain(f64),
    /// Mean or deviation of a distribution, or a rate: `norm(1,0.1)`, `exp(0.5)`.
    Argument(f64),
    /// Least or largest value of a distribution.
    Bound(f64),
}

/// Smallest share of draws from a distribution that must fall between its bounds. SUMO draws for each car until one does: with
/// this share a hundred thousand times on average.
const LEAST_SHARE: f64 = 1e-5;

/// Returns all numbers in a text: one, a list, the parts of a clock, or the arguments of a distribution. None in another text.
pub(super) fn numbers_in(text: &str) -> Vec<Number> {
    if let Some((_, arguments)) = distribution(text) {
        let number = |(place, text): (usize, &str)| {
            let value = number(text)?;
            Some(if place < 2 { Number::Argument(value) } else { Number::Bound(value) })
        };
        return arguments.into_iter().enumerate().filter_map(number).collect();
    }
    let parts = text.split(|letter: char| letter.is_whitespace() || letter == ':').filter(|part| !part.is_empty());
    let numbers: Option<Vec<_>> = parts.map(|part| number(part).map(Number::Plain)).collect();
    numbers.unwrap_or_default()
}

/// Returns what is wrong with a distribution from which a number between its bounds is never drawn.
pub(super) fn never_drawn(text: &str) -> Option<String> {
    let (name, arguments) = distribution(text).filter(|(name, _)| name.starts_with("norm"))?;
    let arguments: Option<Vec<f64>> = arguments.into_iter().map(number).collect();
    let &[mean, deviation, least, ref rest @ ..] = &arguments?[..] else { return None };
    let most = rest.first().copied().unwrap_or(f64::INFINITY);
    // Without a deviation SUMO takes the mean and looks at no bound.
    if deviation <= 0.0 {
        return None;
    }
    let below = |value: f64| normal_below((value - mean) / deviation);
    let share = below(most) - below(least);
    (share < LEAST_SHARE).then(|| {
        format!(
            "SUMO draws a number until it is from {least} to {most}, which almost never happens; give {name} wider bounds, or \
             a deviation of 0"
        )
    })
}

/// Returns name and arguments of a text such as `normc(1,0.1,0.2,2)`.
fn distribution(text: &str) -> Option<(&str, Vec<&str>)> {
    let (name, rest) = text.trim().split_once('(')?;
    let is_word = !name.is_empty() && name.bytes().all(|letter| letter.is_ascii_lowercase());
    let arguments = rest.strip_suffix(')').filter(|_| is_word && name != "nan")?;
    Some((name, arguments.split(',').collect()))
}

/// Returns a number as C's `strtod` reads it, which SUMO calls: also `nan`, `nan(1)`, `inf` and hexadecimal ones.
fn number(text: &str) -> Option<f64> {
    let text = text.trim();
    let (sign, rest) = match text.strip_prefix('-') {
        Some(rest) => (-1.0, rest),
        None => (1.0, text.strip_prefix('+').unwrap_or(text)),
    };
    if rest.starts_with(['+', '-']) {
        return None;
    }
    let lower = rest.to_ascii_lowercase();
    if lower.starts_with("nan(") {
        return Some(f64::NAN);
    }
    match lower.strip_prefix("0x") {
        Some(digits) => Some(sign * hexadecimal(digits)?),
        None => lower.parse::<f64>().ok().map(|value| sign * value),
    }
}

/// Returns a number such as `1.8p3`, behind its `0x`.
fn hexadecimal(text: &str) -> Option<f64> {
    let (digits, exponent) = text.split_once('p').unwrap_or((text, "0"));
    let (whole, parts) = digits.split_once('.').unwrap_or((digits, ""));
    let sum = [whole, parts]
        .concat()
        .chars()
        .try_fold(0.0, |sum, digit| Some(16.0 * sum + f64::from(digit.to_digit(16)?)))?;
    let exponent = exponent.parse::<i32>().ok()?.clamp(-5000, 5000) - 4 * parts.len().min(5000) as i32;
    Some(sum * f64::powi(2.0, exponent))
}

/// Returns the probability that a normal number with mean 0 and deviation 1 is below a value, to 1e-7.
///
/// Source: Abramowitz and Stegun, Handbook of Mathematical Functions, 26.2.17.
fn normal_below(value: f64) -> f64 {
    const FACTORS: [f64; 5] = [0.319_381_530, -0.356_563_782, 1.781_477_937, -1.821_255_978, 1.330_274_429];
    let size = value.abs().min(40.0);
    let step = 1.0 / (1.0 + 0.231_641_9 * size);
    let sum = FACTORS.iter().rev().fold(0.0, |sum, factor| (sum + factor) * step);
    let above = (-size * size / 2.0).exp() / (2.0 * std::f64::consts::PI).sqrt() * sum;
    if value > 0.0 { 1.0 - above } else { above }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_c_reads_them() {
        for (text, value) in [
            ("1.5", 1.5),
            (" +2. ", 2.0),
            ("-.5e1", -5.0),
            ("0x10", 16.0),
            ("-0x1.8p1", -3.0),
            ("INF", f64::INFINITY),
            ("-infinity", f64::NEG_INFINITY),
        ] {
            assert_eq!(number(text), Some(value), "{text}");
        }
        assert!(["nan", "-NaN", "nan(7)"].iter().all(|text| number(text).is_some_and(f64::is_nan)));
        for text in ["", "max", "1,5", "--1", "0x", "5 m", "infinit"] {
            assert_eq!(number(text).filter(|value| *value != 0.0), None, "{text}");
        }
    }

    #[test]
    fn lists_clocks_and_distributions_have_several() {
        use Number::{Argument, Bound, Plain};
        assert_eq!(numbers_in("0.5 1"), [Plain(0.5), Plain(1.0)]);
        assert_eq!(numbers_in("01:00:30"), [Plain(1.0), Plain(0.0), Plain(30.0)]);
        assert_eq!(numbers_in("normc(1,0.1,0.2)"), [Argument(1.0), Argument(0.1), Bound(0.2)]);
        assert_eq!(numbers_in("exp(0.5)"), [Argument(0.5)]);
        assert_eq!(numbers_in("random"), []);
        assert_eq!(numbers_in("5 m"), []);
    }

    #[test]
    fn a_normal_number_is_below_known_values_as_often_as_tables_say() {
        for (value, share) in [(0.0, 0.5), (1.0, 0.841_344_75), (-2.0, 0.022_750_13), (9.0, 1.0), (-1e300, 0.0)] {
            assert!((normal_below(value) - share).abs() < 1e-6, "{value}");
        }
        assert_eq!((normal_below(f64::INFINITY), normal_below(f64::NEG_INFINITY)), (1.0, 0.0));
    }
}
