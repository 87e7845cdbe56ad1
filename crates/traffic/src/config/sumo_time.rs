//! Times in SUMO's files: seconds, or `H:M:S` with days before it if there are three colons.

use anyhow::{Context, Result, ensure};

use dials_core::outside::excerpt;

/// Returns a time in seconds.
///
/// Source: SUMO 1.15, `string2time` in `src/utils/common/SUMOTime.cpp`.
pub fn seconds(text: &str) -> Result<f64> {
    let wrong = || format!("`{}` is no time: it must be seconds, such as 3600, or 01:00:00", excerpt(text));
    let parts: Vec<&str> = text.split(':').collect();
    let numbers =
        parts.iter().map(|part| part.parse::<f64>()).collect::<Result<Vec<_>, _>>().ok().with_context(wrong)?;
    ensure!(numbers.iter().all(|number| number.is_finite()), wrong());
    match numbers[..] {
        [seconds] => Ok(seconds),
        [hours, minutes, seconds] => Ok(hours * 3600.0 + minutes * 60.0 + seconds),
        [days, hours, minutes, seconds] => Ok(days * 86_400.0 + hours * 3600.0 + minutes * 60.0 + seconds),
        _ => Err(anyhow::anyhow!(wrong())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_seconds_or_clocks() {
        for (text, time) in
            [("25200", 25200.0), ("0.50", 0.5), ("-1", -1.0), ("07:00:05", 25205.0), ("1:00:00:01.5", 86_401.5)]
        {
            assert_eq!(seconds(text).unwrap(), time, "{text}");
        }
        for text in ["", "7h", "0:20", "1:2:3:4:5", "inf", "NaN", "12:", "1e999"] {
            let message = seconds(text).unwrap_err().to_string();
            assert_eq!(message, format!("`{text}` is no time: it must be seconds, such as 3600, or 01:00:00"));
        }
    }
}
