//! A city on the page of `watch`: how the policies of a run that trains do against today's plan.

use anyhow::{Context, Result, ensure};

use super::map::map;
use super::page::{lights, summary, with_error};
use super::read::City;
use crate::document::{Block, Figure, to_html};
use dials_core::base::counted;

/// Number of lights in the table, the worst first.
const WORST_LIGHTS: usize = 10;

/// The map and its numbers, as HTML.
#[derive(Clone)]
pub struct DelayMap {
    pub(crate) html: String,
}

impl DelayMap {
    /// Makes it. `city`: the text of a `city.json` with today's plan first and, if there are any yet, the policies behind it.
    /// `policies`: what they are called in a sentence, such as `the policies of step 100`. Errors: it is no such text.
    pub fn of(city: &str, policies: &str) -> Result<DelayMap> {
        let mut city: City = serde_json::from_str(city).context("the figures of the lights cannot be read")?;
        ensure!(!city.players.is_empty(), "the figures of the lights name no controller");
        let is_compared = city.players.len() > 1;
        city.players.iter_mut().skip(1).for_each(|player| player.label = policies.to_owned());
        let before = &city.players[0];
        let after = city.players.get(1);
        let order: Vec<&str> = before.lights.iter().map(|light| &*light.id).collect();
        let caption = match is_compared {
            true => format!(
                "{}: where {policies} save time against today's plan. Numbers are those of the table.",
                city.title()
            ),
            false => format!("{}: delay at each light with today's plan.", city.title()),
        };
        let words = match (after, before.delay_s()) {
            (None, Some(delay)) => {
                let played = counted(city.episodes, "episode");
                format!("With today's plan a car loses {} s: the mean of {played}.", with_error(delay))
            }
            _ => summary(&city, after),
        };
        let svg = map(&city, after.unwrap_or(before), &order, is_compared);
        let mut table = lights(before, after);
        table.rows.truncate(WORST_LIGHTS);
        let blocks = [
            Block::Paragraph(words),
            Block::Figure(Figure { name: "delay_map".to_owned(), caption, svg }),
            Block::Table(table),
        ];
        Ok(DelayMap { html: to_html(&blocks) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a city with these players at one light, today's plan first, which loses 30 s per car.
    fn city(policies_s: Option<f64>) -> String {
        let player = |delay_s: f64, difference: &str| {
            let figures = format!(r#"{{"delay_s": {{"mean": {delay_s}, "half_width_95": 1.0}}}}"#);
            format!(
                r#"{{"label": "x", "learned": false, "figures": {figures}, "differences": {difference}, "lights": [{{
                "id": "b2", "name": "High Street", "place_m": [5.0, 5.0], "approaches": [], "cars": 9, "delay_s": {delay_s},
                "difference": {difference}}}]}}"#
            )
        };
        let difference =
            |delay_s: f64| format!(r#"{{"delay_s": {{"mean": {}, "half_width_95": 2.0}}}}"#, delay_s - 30.0);
        let players: Vec<String> = [player(30.0, "{}")]
            .into_iter()
            .chain(policies_s.map(|delay_s| player(delay_s, &difference(delay_s))))
            .collect();
        format!(
            r#"{{"name": "town", "seed": 0, "episodes": 2, "left_out": [], "warnings": [], "settings": {{}},
            "streets": [{{"edge": "e", "lanes": 1, "shape_m": [[0, 0], [9, 9]]}}], "players": [{}]}}"#,
            players.join(",")
        )
    }

    #[test]
    fn the_map_says_whose_policies_save_time_and_how_much() {
        let html = DelayMap::of(&city(Some(20.0)), "the policies of step 100").unwrap().html;
        assert!(html.contains("With the policies of step 100 it loses 20.0"), "{html}");
        assert!(html.contains("where the policies of step 100 save time against today"), "{html}");
        assert!(html.contains("High Street (b2): -10.0 s per car"), "{html}");
    }

    #[test]
    fn without_policies_it_shows_todays_plan_and_no_savings() {
        let html = DelayMap::of(&city(None), "the policies").unwrap().html;
        assert!(html.contains("delay at each light with today") && !html.contains("save time"), "{html}");
        assert!(html.contains("a car loses 30.0") && !html.contains("--compare"), "{html}");
        assert!(html.contains("High Street (b2): 30.0 s per car"), "{html}");
        assert!(DelayMap::of("{}", "the policies").is_err());
    }
}
