//! The figures of lights, as lines of a CSV file: one per light, per approach and per movement.

use anyhow::{Context, Result};

use super::{DELAY, NAMES, Part, Played, level_of_service};
use dials_core::base::statistics::Interval;
use dials_core::outside::csv_name;

/// Columns before the figures.
const FIXED: [&str; 13] = [
    "controller",
    "level",
    "light",
    "name",
    "x_m",
    "y_m",
    "edge",
    "street",
    "lanes",
    "to_edge",
    "to_street",
    "cars",
    "level_of_service",
];

/// Returns the names of the columns.
pub fn header() -> Vec<String> {
    let of_figures = NAMES.into_iter().flat_map(|name| {
        [
            name.to_owned(),
            format!("{name}_half_width_95"),
            format!("{name}_difference"),
            format!("{name}_difference_half_width_95"),
        ]
    });
    FIXED.map(str::to_owned).into_iter().chain(of_figures).collect()
}

/// Returns the lines of a player, the worst light first. `label`: what it is called. `reference`: the player from which differences
/// are taken; of that one they are empty.
pub fn lines(label: &str, played: &Played<'_>, reference: Option<&Played<'_>>) -> Vec<Vec<String>> {
    played.parts().into_iter().map(|part| line(label, played, reference, part)).collect()
}

/// Returns these lines under their header, as a file.
pub fn text(lines: &[Vec<String>]) -> Result<String> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    [header()].iter().chain(lines).try_for_each(|line| writer.write_record(line))?;
    String::from_utf8(writer.into_inner().context("a CSV file in memory")?).context("only strings were written")
}

fn line(label: &str, played: &Played<'_>, reference: Option<&Played<'_>>, part: Part) -> Vec<String> {
    let (Part::Light(light) | Part::Approach(light, _) | Part::Movement(light, ..)) = part;
    let place = &played.places[light];
    let approach = match part {
        Part::Light(_) => None,
        Part::Approach(_, approach) | Part::Movement(_, approach, _) => Some(&place.approaches[approach]),
    };
    let movement = match part {
        Part::Movement(_, approach, movement) => Some(&place.approaches[approach].movements[movement]),
        _ => None,
    };
    let level = match part {
        Part::Light(_) => "light",
        Part::Approach(..) => "approach",
        Part::Movement(..) => "movement",
    };
    let name = |name: Option<&str>| csv_name(name.unwrap_or_default());
    let own = played.figures(part);
    let delay = own.mean(DELAY).map_or(String::new(), |delay| level_of_service(delay.mean).to_string());
    let [x_m, y_m] = place.place_m.map(|metres| format!("{metres:.2}"));
    let mut line = vec![
        csv_name(label),
        level.to_owned(),
        csv_name(&place.id),
        csv_name(&super::title(place)),
        x_m,
        y_m,
        name(approach.map(|approach| &*approach.edge)),
        name(approach.and_then(|approach| approach.street.as_deref())),
        approach.map_or(String::new(), |approach| approach.lanes.to_string()),
        name(movement.map(|movement| &*movement.edge)),
        name(movement.and_then(|movement| movement.street.as_deref())),
        own.cars.to_string(),
        delay,
    ];
    let reference = reference.map(|reference| reference.figures(part));
    for name in NAMES {
        let difference = reference.as_ref().and_then(|reference| own.difference(reference, name));
        line.extend(cells(own.mean(name)).into_iter().chain(cells(difference)));
    }
    line
}

/// Returns a mean and the half-width of its interval; empty where there is none.
fn cells(interval: Option<Interval>) -> [String; 2] {
    let text = |value: Option<f64>| value.map_or(String::new(), |value| value.to_string());
    [text(interval.map(|interval| interval.mean)), text(interval.and_then(|interval| interval.half_width))]
}

#[cfg(test)]
mod tests {
    use super::super::tests::{episode, light};
    use super::*;

    #[test]
    fn every_part_has_a_line_with_a_cell_per_column() {
        let places = [light("a", &["High Street"]), light("=b", &[])];
        let before = [episode(&[(10, 300.0), (10, 900.0)])];
        let after = [episode(&[(10, 100.0), (10, 50.0)])];
        let [before, after] = [&before, &after].map(|episodes| Played { places: &places, episodes });
        let lines = lines("learned", &after, Some(&before));
        assert_eq!(lines.len(), 6);
        assert!(lines.iter().all(|line| line.len() == header().len()), "{lines:?}");
        let cell = |line: usize, column: &str| &*lines[line][header().iter().position(|name| name == column).unwrap()];
        assert_eq!([cell(0, "level"), cell(0, "light"), cell(0, "delay_s")], ["light", "a", "10"]);
        assert_eq!([cell(2, "level"), cell(2, "edge"), cell(2, "to_edge")], ["movement", "a_in", "a_out"]);
        assert_eq!([cell(0, "delay_s_difference"), cell(0, "delay_s_half_width_95")], ["-20", ""]);
        assert_eq!([cell(3, "light"), cell(3, "bus_delay_s")], ["'=b", ""], "no formula of a spreadsheet");
    }
}
