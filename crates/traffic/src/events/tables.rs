//! The log and its two tables, as lines of CSV files. PyPI's `atspm` reads the log and the table of detectors as they
//! are.

use super::site::{DetectorPlace, PhaseKind, Site};
use super::{DAY_S, Event};
use dials_core::outside::csv_name;

/// A CSV file: its header and its lines.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Table {
    pub header: Vec<String>,
    pub lines: Vec<Vec<String>>,
}

impl Table {
    fn new<const N: usize>(header: [&str; N], lines: impl Iterator<Item = [String; N]>) -> Table {
        Table { header: header.map(str::to_owned).into(), lines: lines.map(Vec::from).collect() }
    }
}

pub fn log(sites: &[Site], events: &[Event]) -> Table {
    let devices: Vec<String> = sites.iter().map(|site| csv_name(&site.light)).collect();
    let line = |event: &Event| {
        let Event { tenths, site, code, parameter } = *event;
        [timestamp(tenths), devices[site].clone(), code.to_string(), parameter.to_string()]
    };
    Table::new(["TimeStamp", "DeviceId", "EventId", "Parameter"], events.iter().map(line))
}

/// Returns the detectors. The first four columns are the `detector_config` of `atspm`.
pub fn detectors(sites: &[Site]) -> Table {
    let header = ["DeviceId", "Phase", "Parameter", "Function", "Lane", "Street", "BeginM", "LengthM", "SetbackM"];
    let lines = sites.iter().flat_map(|site| {
        site.detectors.iter().enumerate().map(|(number, detector)| {
            let (function, length_m) = match detector.place {
                DetectorPlace::StopBar => ("Presence", detector.setback_m),
                DetectorPlace::Advance => ("Advance", 0.0),
            };
            [
                csv_name(&site.light),
                detector.phase.to_string(),
                (number + 1).to_string(),
                function.to_owned(),
                csv_name(&detector.lane),
                csv_name(&site.phases[usize::from(detector.phase) - 1].street),
                format!("{:.2}", detector.begin_m),
                format!("{length_m:.2}"),
                format!("{:.2}", detector.setback_m),
            ]
        })
    });
    Table::new(header, lines)
}

/// Returns what each phase is: when it has green, and whose cars obey it.
pub fn phases(sites: &[Site]) -> Table {
    let header = ["DeviceId", "Phase", "Kind", "Greens", "States", "Edge", "Street", "Movements", "Lanes", "Letters"];
    let lines = sites.iter().flat_map(|site| {
        site.phases.iter().enumerate().map(|(number, phase)| {
            let kind = match phase.kind {
                PhaseKind::Vehicles => "vehicles",
                PhaseKind::Pedestrians => "pedestrians",
            };
            let movements: Vec<&str> = phase.directions.iter().map(|letter| movement(letter)).collect();
            let states = phase.greens.iter().map(|&green| site.greens[green].as_str());
            [
                csv_name(&site.light),
                (number + 1).to_string(),
                kind.to_owned(),
                joined(&phase.greens),
                states.collect::<Vec<_>>().join(" "),
                csv_name(&phase.edge),
                csv_name(&phase.street),
                movements.join(" "),
                csv_name(&phase.lanes.join(" ")),
                joined(&phase.letters),
            ]
        })
    });
    Table::new(header, lines)
}

fn joined(numbers: &[usize]) -> String {
    numbers.iter().map(usize::to_string).collect::<Vec<_>>().join(" ")
}

/// Returns a direction of SUMO's connections in words.
fn movement(letter: &str) -> &str {
    match letter {
        "s" => "straight",
        "l" => "left",
        "r" => "right",
        "L" => "half-left",
        "R" => "half-right",
        "t" | "T" => "u-turn",
        other => other,
    }
}

/// Returns a time as tools read it. Second 0 of SUMO is midnight of the first day, Monday 1 January 2024: SUMO knows no
/// date.
fn timestamp(tenths: u64) -> String {
    let seconds = tenths / 10;
    let [year, month, day] = date(seconds / DAY_S);
    let [hour, minute, second] = [seconds % DAY_S / 3600, seconds % 3600 / 60, seconds % 60];
    format!("{year:04}-{month:02}-{day:02} {hour:02}:{minute:02}:{second:02}.{}", tenths % 10)
}

/// Returns year, month and day of the day with this number, from 0.
fn date(mut day: u64) -> [u64; 3] {
    let mut year = 2024;
    let leaps = |year: u64| year.is_multiple_of(4) && (!year.is_multiple_of(100) || year.is_multiple_of(400));
    while day >= 365 + u64::from(leaps(year)) {
        day -= 365 + u64::from(leaps(year));
        year += 1;
    }
    let lengths = [31, 28 + u64::from(leaps(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while day >= lengths[month] {
        day -= lengths[month];
        month += 1;
    }
    [year, month as u64 + 1, day + 1]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn second_0_is_midnight_of_the_first_day() {
        assert_eq!(timestamp(0), "2024-01-01 00:00:00.0");
        assert_eq!(timestamp(10 * (7 * 3600 + 5 * 60 + 9) + 3), "2024-01-01 07:05:09.3");
        assert_eq!(timestamp(10 * DAY_S * 59), "2024-02-29 00:00:00.0");
        assert_eq!(timestamp(10 * DAY_S * 366), "2025-01-01 00:00:00.0");
        assert_eq!(timestamp(10 * DAY_S * 365 - 1), "2024-12-30 23:59:59.9");
    }
}
