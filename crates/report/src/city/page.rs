//! The sections of a city's report: before and after, the map, each light.

use std::path::PathBuf;

use anyhow::Result;

use super::assumed::assumed;
use super::map::{is_unclear, map};
use super::read::{City, CityLight, CityPlayer, Figure, PartFigures};
use super::roles::{best, name_of, role};
use super::variants;
use crate::document::{self, Block, Table};
use dials_core::base::counted;

/// Number of approaches in the table of the worst ones.
const WORST_APPROACHES: usize = 10;
pub(super) const NOTHING: &str = "\u{2013}";
const MINUS: &str = "\u{2212}";

/// Figures of the whole city that the first table shows, with what they are called.
const FIGURES: [(&str, &str); 9] = [
    ("delay_s", "delay, s per car"),
    ("travel_time_s", "travel time, s"),
    ("stops_per_car", "stops per car"),
    ("waiting_time_s", "standing, s per car"),
    ("delay_s_bus", "delay of buses, s"),
    ("person_wait_s", "waiting at crossings, s per person"),
    ("co2_g_per_car", "CO2, g per car"),
    ("fuel_g_per_car", "fuel, g per car"),
    ("teleports", "cars moved out of jams"),
];

/// Makes the sections of a city. `with_variants`: folders that may have tables of variants of it.
/// `number`: that of the city, from 1, if there are several.
pub(super) fn blocks(with_variants: &[PathBuf], city: &City, number: Option<usize>) -> Result<Vec<Block>> {
    let before = &city.players[0];
    let after = best(city);
    let shown = after.unwrap_or(before);
    let order: Vec<&str> = before.lights.iter().map(|light| &*light.id).collect();
    let title = |words: &str| match number {
        None => words.to_owned(),
        Some(number) => format!("{words}: {} ({number})", city.title()),
    };
    let mut blocks = vec![Block::Heading(title("Before and after")), Block::Paragraph(summary(city, after))];
    blocks.push(Block::Table(whole_city(city)));
    if !before.lights.is_empty() {
        blocks.push(Block::Heading(title("Map")));
        let caption = match after {
            Some(after) => format!(
                "{}: where {} saves time against {}. Numbers are those of the next table.",
                city.title(),
                name_of(after),
                name_of(before)
            ),
            None => format!(
                "{}: delay at each light with {}. Numbers are those of the next table.",
                city.title(),
                before.label
            ),
        };
        let number = number.map_or(String::new(), |number| format!("_{number}"));
        let name = format!("map_{}{number}", slug(&city.title()));
        let svg = map(city, shown, &order, after.is_some());
        blocks.push(Block::Figure(document::Figure { name, caption, svg }));
        blocks.push(Block::Heading(title("Each light")));
        blocks.push(Block::Table(lights(before, after)));
        blocks.push(Block::Table(approaches(before, after)));
        blocks.push(Block::Table(shares(city)));
    }
    for folder in with_variants {
        blocks.extend(variants::blocks(folder, title("Robustness"))?);
    }
    blocks.push(Block::Heading(title("What was assumed")));
    blocks.push(Block::List(assumed(city)));
    Ok(blocks)
}

pub(super) fn summary(city: &City, after: Option<&CityPlayer>) -> String {
    let before = &city.players[0];
    let played = counted(city.episodes, "episode");
    let Some(own) = before.delay_s() else { return String::new() };
    let first = format!("With {} a car loses {} s.", name_of(before), with_error(own));
    let Some(after) = after else {
        return format!(
            "{first} These are means over {played}. Compare several controllers with --compare to see what changes."
        );
    };
    let difference = after.differences.as_ref().and_then(|all| all.get("delay_s")).copied();
    let (Some(theirs), Some(difference)) = (after.delay_s(), difference) else { return first };
    let words = match (is_unclear(Some(difference)), difference.mean < 0.0) {
        _ if difference.half_width_95.is_none() => {
            "One episode has no interval, so it does not show which one is better.".to_owned()
        }
        (true, _) => {
            "The difference is within its interval, so these episodes do not show which one is better.".to_owned()
        }
        (false, true) => format!("That is {:.0} % less.", -100.0 * difference.mean / own.mean.max(1e-9)),
        (false, false) => format!("That is {:.0} % more.", 100.0 * difference.mean / own.mean.max(1e-9)),
    };
    format!(
        "{first} With {} it loses {} s: a difference of {} s over {played} of the same traffic. {words}",
        name_of(after),
        with_error(theirs),
        signed(difference)
    )
}

/// The figures of the whole city: one line per figure, one column per player, and the differences.
fn whole_city(city: &City) -> Table {
    let mut header = vec!["figure".to_owned()];
    for (number, player) in city.players.iter().enumerate() {
        header.push(role(city, player));
        header.extend((number > 0).then(|| "difference".to_owned()));
    }
    let mut rows = Vec::new();
    for (name, words) in FIGURES {
        if !city.players[0].figures.contains_key(name) {
            continue;
        }
        let mut row = vec![words.to_owned()];
        for (number, player) in city.players.iter().enumerate() {
            row.push(player.figures.get(name).map_or(NOTHING.to_owned(), |&found| with_error(found)));
            let difference = player.differences.as_ref().and_then(|all| all.get(name));
            row.extend((number > 0).then(|| difference.map_or(NOTHING.to_owned(), |&found| signed(found))));
        }
        rows.push(row);
    }
    let caption = format!("The whole city, means over {}.", counted(city.episodes, "episode"));
    Table { caption, header, rows }
}

pub(super) fn lights(before: &CityPlayer, after: Option<&CityPlayer>) -> Table {
    let rows = before.lights.iter().enumerate().map(|(number, light)| {
        let name = match light.name == light.id {
            true => light.id.clone(),
            false => format!("{} ({})", light.name, light.id),
        };
        let others = after.and_then(|after| after.lights.iter().find(|other| other.id == light.id));
        let first = format!("{}. {name}", number + 1);
        [first].into_iter().chain(cells(&light.figures, others.map(|other: &CityLight| &other.figures))).collect()
    });
    let caption = "Delay at each light in seconds per car, where cars lose the most time first. LOS: level of service."
        .to_owned();
    Table { caption, header: header("light", before, after), rows: rows.collect() }
}

fn approaches(before: &CityPlayer, after: Option<&CityPlayer>) -> Table {
    let mut all: Vec<_> =
        before.lights.iter().flat_map(|light| light.approaches.iter().map(move |approach| (light, approach))).collect();
    let lost_s = |figures: &PartFigures| figures.cars * figures.delay_s.unwrap_or(0.0);
    all.sort_by(|(_, one), (_, other)| lost_s(&other.figures).total_cmp(&lost_s(&one.figures)));
    all.truncate(WORST_APPROACHES);
    let rows = all.into_iter().map(|(light, approach)| {
        let name = match &approach.street {
            Some(street) => format!("{street} ({}) to {}", approach.edge, light.id),
            None => format!("{} to {}", approach.edge, light.id),
        };
        let others = after.and_then(|after| after.lights.iter().find(|other| other.id == light.id));
        let others = others.and_then(|other| other.approaches.iter().find(|other| other.edge == approach.edge));
        [name].into_iter().chain(cells(&approach.figures, others.map(|other| &other.figures))).collect()
    });
    let caption = "The approaches where cars lose the most time: delay in seconds per car. All, with their movements, are in lights.csv.".to_owned();
    Table { caption, header: header("approach", before, after), rows: rows.collect() }
}

fn header(first: &str, before: &CityPlayer, after: Option<&CityPlayer>) -> Vec<String> {
    let mut header = vec![first.to_owned(), name_of(before), "LOS".to_owned()];
    if let Some(after) = after {
        header.extend([after.label.clone(), "LOS".to_owned(), "difference".to_owned()]);
    }
    header.extend(["cars", "stops per car", "queue"].map(str::to_owned));
    header
}

fn cells(before: &PartFigures, after: Option<&PartFigures>) -> Vec<String> {
    let number =
        |value: Option<f64>, digits: usize| value.map_or(NOTHING.to_owned(), |value| format!("{value:.digits$}"));
    let level = |figures: &PartFigures| figures.level_of_service.clone().unwrap_or(NOTHING.to_owned());
    let mut cells = vec![number(before.delay_s, 1), level(before)];
    let pair = |value: fn(&PartFigures) -> Option<f64>, digits: usize| match after {
        Some(after) => format!("{}\u{a0}\u{2192}\u{a0}{}", number(value(before), digits), number(value(after), digits)),
        None => number(value(before), digits),
    };
    if let Some(after) = after {
        let difference = after.delay_difference().map_or(NOTHING.to_owned(), signed);
        cells.extend([number(after.delay_s, 1), level(after), difference]);
    }
    cells.push(format!("{:.0}", before.cars));
    cells.extend([pair(|figures| figures.stops_per_car, 2), pair(|figures| figures.queue_p95_cars, 1)]);
    cells
}

fn shares(city: &City) -> Table {
    let header = ["", "at lights", "on other roads", "before entering", "all"].map(str::to_owned).to_vec();
    let rows = city.players.iter().filter_map(|player| {
        let lost = player.lost_time.as_ref()?;
        let share = |key: &str| match (lost.get(key), lost.get("all_s")) {
            (Some(part), Some(all)) if *all > 0.0 => format!("{:.1} h ({:.0} %)", part / 3600.0, 100.0 * part / all),
            (Some(part), _) => format!("{:.1} h", part / 3600.0),
            (None, _) => NOTHING.to_owned(),
        };
        let all = lost.get("all_s").map_or(NOTHING.to_owned(), |all| format!("{:.1} h", all / 3600.0));
        Some(vec![role(city, player), share("at_lights_s"), share("elsewhere_s"), share("before_entering_s"), all])
    });
    let caption = "Where all cars together lose their time in an episode, in hours.".to_owned();
    Table { caption, header, rows: rows.collect() }
}

pub(super) fn with_error(Figure { mean, half_width_95 }: Figure) -> String {
    let digits = digits(mean, half_width_95);
    match half_width_95 {
        Some(half_width) if half_width > 0.0 => format!("{mean:.digits$}\u{a0}\u{b1}\u{a0}{half_width:.digits$}"),
        _ => format!("{mean:.digits$}"),
    }
}

pub(super) fn signed(figure: Figure) -> String {
    let text = with_error(Figure { mean: figure.mean.abs(), ..figure });
    let is_zero = !text.contains(|letter: char| ('1'..='9').contains(&letter));
    let sign = if is_zero {
        ""
    } else if figure.mean < 0.0 {
        MINUS
    } else {
        "+"
    };
    format!("{sign}{text}")
}

fn digits(mean: f64, half_width: Option<f64>) -> usize {
    let least = half_width.filter(|half_width| *half_width > 0.0).unwrap_or(mean.abs());
    if least >= 1.0 || mean.abs() >= 50.0 { 1 } else { 2 }
}

/// Returns a plain word for the name of a file.
fn slug(title: &str) -> String {
    title.chars().map(|letter| if letter.is_ascii_alphanumeric() || letter == '-' { letter } else { '_' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_have_a_sign_and_as_many_digits_as_they_need() {
        let figure = |mean, half_width_95| Figure { mean, half_width_95 };
        assert_eq!(signed(figure(-39.84, Some(2.81))), "\u{2212}39.8\u{a0}\u{b1}\u{a0}2.8");
        assert_eq!(signed(figure(0.234, Some(0.051))), "+0.23\u{a0}\u{b1}\u{a0}0.05");
        assert_eq!(signed(figure(0.0, None)), "0.00");
        assert_eq!(with_error(figure(76.44, None)), "76.4");
    }
}
