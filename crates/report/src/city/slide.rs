//! A slide about a city: one picture of 16:9 with the map, the delay of today, of the plan and of the best others, people on foot,
//! the worst lights, and what was assumed.

use std::fmt::Write;

use super::assumed::in_short;
use super::map::{Frame, Scale, is_unclear, legend, roads_and_lights};
use super::page::{signed, with_error};
use super::read::{City, CityPlayer, Figure};
use super::roles::{Role, all_and_best, best, name_of, role};
use crate::document::escape;
use crate::drawing::{BLUE, INK, Svg, hex, shortened};
use dials_core::base::counted;
use dials_core::domain::light_figures::TODAYS_PLAN;
use plotters::style::RGBColor;

/// Size in pixels.
const SIZE: [u32; 2] = [1600, 900];
/// Left end, top, width and height of the map.
const MAP: [f64; 4] = [72.0, 215.0, 850.0, 495.0];
/// Left end and top of the list of the worst lights, beside the legend of the map.
const WORST: [f64; 2] = [590.0, 792.0];
/// Number of lights in that list, and the most letters of a street's name in it.
const WORST_LIGHTS: usize = 3;
const STREET: usize = 28;
/// Left end and width of the column beside the map.
const COLUMN: (f64, f64) = (1000.0, 540.0);
/// Top of the bars, and the distance from one to the next.
const BARS: (f64, f64) = (250.0, 98.0);
const FAINT: RGBColor = RGBColor(0x5c, 0x5c, 0x5c);
const GREY: RGBColor = RGBColor(0x8c, 0x8c, 0x8c);
/// Width of a letter as a share of its height, on average and a little more.
const LETTER: f64 = 0.52;
/// Most lines below four bars.
const MOST_NOTES: usize = 10;

/// Draws it. `title`: instead of one with the city's name.
pub(super) fn slide(city: &City, title: Option<&str>) -> Svg {
    let [width, height] = SIZE;
    let mut svg = format!(
        "<svg width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" font-family=\"sans-serif\" \
         xmlns=\"http://www.w3.org/2000/svg\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    let (before, after) = (&city.players[0], best(city));
    let title = title.map_or_else(|| format!("Traffic lights of {}", city.title()), str::to_owned);
    write(&mut svg, [72.0, 92.0], 48.0, INK, "bold", &shortened(&title, 56));
    write(&mut svg, [72.0, 148.0], 30.0, INK, "normal", &shortened(&headline(city, after), 96));
    if let Some(words) = on_foot(before, after) {
        write(&mut svg, [72.0, 188.0], 24.0, FAINT, "normal", &words);
    }
    let shown = after.unwrap_or(before);
    let scale = Scale::of(shown, after.is_some());
    match Frame::within(city, shown, MAP, 1.7) {
        Some(frame) if !shown.lights.is_empty() => {
            let worst: Vec<&str> = before.lights.iter().take(WORST_LIGHTS).map(|light| &*light.id).collect();
            roads_and_lights(&mut svg, city, shown, &worst, scale, &frame);
            legend(&mut svg, scale, [MAP[0], 738.0], 1.3);
            worst_lights(&mut svg, before, after);
        }
        _ => write(&mut svg, [MAP[0], 400.0], 22.0, FAINT, "normal", "no map: no light was measured"),
    }
    bars(&mut svg, city);
    notes(&mut svg, city);
    svg += "</svg>\n";
    Svg::of_text(svg)
}

/// Returns what the slide says in one line.
fn headline(city: &City, after: Option<&CityPlayer>) -> String {
    let before = &city.players[0];
    let Some(own) = before.delay_s() else { return String::new() };
    let difference = after.and_then(|after| after.differences.as_ref()?.get("delay_s").copied());
    let (Some(after), Some(difference)) = (after, difference) else {
        return format!("With {} a car loses {} s.", name_of(before), with_error(own));
    };
    let share = 100.0 * difference.mean.abs() / own.mean.max(1e-9);
    let (name, before) = (name_of(after), name_of(before));
    match difference.mean < 0.0 {
        _ if is_unclear(Some(difference)) => format!("No clear difference between {name} and {before}."),
        true => format!("With {name} a car loses {share:.0} % less time than with {before}."),
        false => format!("With {name} a car loses {share:.0} % more time than with {before}."),
    }
}

/// Returns a sentence about people on foot, if there are any. It names a difference only if that is clear.
fn on_foot(before: &CityPlayer, after: Option<&CityPlayer>) -> Option<String> {
    let wait_s = |player: &CityPlayer| player.figures.get("person_wait_s").copied();
    let own = wait_s(before)?;
    let alone = format!("People on foot wait {:.1} s at crossings", own.mean);
    let Some(after) = after else { return Some(format!("{alone}.")) };
    let difference = after.differences.as_ref()?.get("person_wait_s").copied();
    Some(match wait_s(after) {
        Some(theirs) if !is_unclear(difference) => {
            format!("People on foot wait {:.1} s at crossings instead of {:.1} s.", theirs.mean, own.mean)
        }
        _ => format!("{alone}; no clear difference."),
    })
}

/// Writes at which lights cars lose the most time, with the numbers of the map and the delay before and after.
fn worst_lights(svg: &mut String, before: &CityPlayer, after: Option<&CityPlayer>) {
    let [left, top] = WORST;
    write(svg, [left, top], 18.0, INK, "bold", "Most time is lost at");
    let delay = |value: Option<f64>| value.map_or("\u{2013}".to_owned(), |value| format!("{value:.0}"));
    for (number, light) in before.lights.iter().take(WORST_LIGHTS).enumerate() {
        let then = after.and_then(|after| after.lights.iter().find(|other| other.id == light.id));
        let then = then.map_or(String::new(), |light| format!(" \u{2192} {}", delay(light.figures.delay_s)));
        let name = shortened(&light.name, STREET);
        let words = format!("{}  {name}: {}{then} s", number + 1, delay(light.figures.delay_s));
        write(svg, [left, top + 26.0 * (number + 1) as f64], 17.0, INK, "normal", &words);
    }
}

/// Returns a figure with one digit, as all of a slide.
fn of_slide(Figure { mean, half_width_95 }: Figure) -> String {
    match half_width_95 {
        Some(half_width) => format!("{mean:.1}\u{a0}\u{b1}\u{a0}{half_width:.1}"),
        None => format!("{mean:.1}"),
    }
}

/// Returns the players that have a bar: the first one, today's plan, and the best plan, learned one and rule.
fn rows(city: &City) -> Vec<&CityPlayer> {
    let chosen = [Role::Today, Role::Plan, Role::Learned, Role::Rule].map(|role| all_and_best(city, role).1);
    let mut rows: Vec<&CityPlayer> = vec![&city.players[0]];
    for player in chosen.into_iter().flatten() {
        if rows.iter().all(|other| other.label != player.label) {
            rows.push(player);
        }
    }
    rows.truncate(4);
    rows
}

fn bars(svg: &mut String, city: &City) {
    let (left, width) = COLUMN;
    let rows: Vec<_> = rows(city).into_iter().filter_map(|player| Some((player, player.delay_s()?))).collect();
    write(svg, [left, BARS.0 - 34.0], 26.0, INK, "bold", "Delay in seconds per car");
    let end = |(_, delay): &(&CityPlayer, super::read::Figure)| delay.mean + delay.half_width_95.unwrap_or(0.0);
    let most = rows.iter().map(end).fold(1e-9, f64::max);
    // The numbers stand behind the bars.
    let px_per_s = (width - 170.0) / most;
    for (number, (player, delay)) in rows.iter().enumerate() {
        let top = BARS.0 + BARS.1 * number as f64;
        write(svg, [left, top + 20.0], 22.0, INK, "normal", &shortened(&role(city, player), 46));
        let colour = hex(if number == 0 { GREY } else { BLUE });
        let length = (delay.mean * px_per_s).max(1.0);
        let _ = writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{:.1}\" width=\"{length:.1}\" height=\"30\" fill=\"{colour}\"/>",
            top + 32.0
        );
        let half_width = delay.half_width_95.unwrap_or(0.0) * px_per_s;
        let (from, to, middle) = ((length - half_width).max(0.0) + left, length + half_width + left, top + 47.0);
        if half_width > 0.0 {
            let _ = writeln!(
                svg,
                "<path d=\"M{from:.1} {middle}H{to:.1}M{from:.1} {}v14M{to:.1} {}v14\" stroke=\"{}\" stroke-width=\"2.5\" \
                 fill=\"none\"/>",
                middle - 7.0,
                middle - 7.0,
                hex(INK)
            );
        }
        write(svg, [to + 12.0, top + 56.0], 26.0, INK, "bold", &of_slide(*delay));
        let difference = player.differences.as_ref().and_then(|all| all.get("delay_s"));
        if let Some(difference) = difference.filter(|_| number > 0) {
            let words = format!("{} against {}", signed(*difference), name_of(&city.players[0]));
            write(svg, [left, top + 84.0], 18.0, FAINT, "normal", &shortened(&words, 58));
        }
    }
}

/// Writes n, and what was assumed.
fn notes(svg: &mut String, city: &City) {
    let played = counted(city.episodes, "episode");
    let mut notes = vec![match city.episodes {
        1 => "n = 1 episode, so there are no intervals.".to_owned(),
        _ => format!("n = {played}; lines and \u{b1}: 95 % intervals; differences paired by episode."),
    }];
    let with_bar = rows(city);
    let has_bar = |label: &&str| with_bar.iter().any(|player| player.label == **label);
    let others: Vec<&str> = city.players.iter().map(|player| &*player.label).filter(|label| !has_bar(label)).collect();
    if !others.is_empty() {
        notes.push(format!("Also played, in the report: {}.", others.join(", ")));
    }
    // Of the warnings, only the one that concerns the comparison itself.
    notes.extend(
        city.warnings
            .iter()
            .filter(|warning| warning.starts_with(TODAYS_PLAN))
            .map(|what| format!("Note: {what}.").replace('`', "")),
    );
    notes.push(in_short(city));
    notes.push("Delay: what a car loses against a free road at its own speed, and its wait to enter.".to_owned());
    let letters = (COLUMN.1 / (17.0 * LETTER)) as usize;
    let mut lines: Vec<String> = notes.iter().flat_map(|note| wrapped(note, letters)).collect();
    lines.truncate(MOST_NOTES);
    // They end at the bottom.
    let top = f64::from(SIZE[1]) - 30.0 - 22.0 * (lines.len() - 1) as f64;
    for (number, line) in lines.iter().enumerate() {
        write(svg, [COLUMN.0, top + 22.0 * number as f64], 17.0, FAINT, "normal", line);
    }
}

/// Breaks a text between words, into lines of at most this many letters.
fn wrapped(text: &str, letters: usize) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        let word = shortened(word, letters);
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= letters => {
                line.push(' ');
                line.push_str(&word);
            }
            _ => lines.push(word),
        }
    }
    lines
}

fn write(svg: &mut String, [x, y]: [f64; 2], size: f64, colour: RGBColor, weight: &str, words: &str) {
    let _ = writeln!(
        svg,
        "<text x=\"{x:.1}\" y=\"{y:.1}\" font-size=\"{size}\" font-weight=\"{weight}\" fill=\"{}\">{}</text>",
        hex(colour),
        escape(words)
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    /// Four controllers and a light. `half_width`: that of all differences.
    fn city(half_width: f64) -> City {
        let player = |label: &str, learned: bool, plan: bool, delay_s: f64| {
            let difference = json!({ "mean": delay_s - 40.0, "half_width_95": half_width });
            let differences = if delay_s == 40.0 { Value::Null } else { json!({ "delay_s": difference }) };
            let light = json!({ "id": "a", "name": "<b>", "place_m": [5, 5], "cars": 10.0, "approaches": [],
                                "difference": { "delay_s": difference } });
            json!({ "label": label, "learned": learned, "plan": plan, "differences": differences, "lights": [light],
                    "figures": { "delay_s": { "mean": delay_s, "half_width_95": 1.0 } } })
        };
        let players = [
            player("program", false, false, 40.0),
            player("webster", false, false, 35.0),
            player("max-pressure", false, false, 20.0),
            player("runs/a", true, false, 25.0),
            player("plan of <webster>", false, true, 30.0),
        ];
        let city = json!({ "name": "town", "seed": 7, "episodes": 5, "left_out": [], "warnings": [], "players": players,
                           "settings": {}, "streets": [{ "edge": "e", "lanes": 1, "shape_m": [[0, 0], [9, 9]] }] });
        serde_json::from_value(city).unwrap()
    }

    #[test]
    fn the_slide_has_today_the_plan_and_the_best_of_each_kind_with_n() {
        let svg = slide(&city(2.0), None).file();
        assert!(
            svg.contains("With the plan of &lt;webster&gt; a car loses 25 % less time than with today's plan."),
            "{svg}"
        );
        for words in [">today's plan<", "learned: runs/a", "best rule: max-pressure", "n = 5 episodes", "seed 7"] {
            assert!(svg.contains(words), "{words}: {svg}");
        }
        assert!(!svg.contains(">webster<") && !svg.contains("<webster>") && svg.contains("&lt;b&gt;"), "{svg}");
        assert!(svg.contains("30.0\u{a0}\u{b1}\u{a0}1.0") && svg.contains("\u{2212}10.0\u{a0}\u{b1}\u{a0}2.0 against"));
    }

    #[test]
    fn a_difference_within_its_interval_is_no_saving() {
        let svg = slide(&city(11.0), None).file();
        assert!(svg.contains("No clear difference between the plan of &lt;webster&gt; and today's plan."), "{svg}");
    }

    #[test]
    fn lines_break_between_words() {
        assert_eq!(wrapped("one two three", 7), ["one two", "three"]);
        assert_eq!(wrapped("abcdefghij", 4), ["ab...ij"], "a word is shortened");
    }
}
