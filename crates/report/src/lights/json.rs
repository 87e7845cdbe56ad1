//! The figures of lights, as JSON for programs.

use serde_json::{Map, Value, json};

use super::{BUS_DELAY, DELAY, NAMES, Part, PartFigures, Played, QUEUE, level_of_service};

/// Returns the list `lights`, the worst first. `reference`: the player from which differences are taken, on the same traffic.
pub fn lights(played: &Played<'_>, reference: Option<&Played<'_>>) -> Value {
    let object = |part: Part| object(played, reference, part);
    let lights = played.worst_first().into_iter().map(|number| {
        let place = &played.places[number];
        let mut light = Map::new();
        light.insert("id".into(), json!(place.id));
        light.insert("name".into(), json!(super::title(place)));
        light.insert("streets".into(), json!(place.streets));
        light.insert("place_m".into(), json!(place.place_m));
        light.extend(object(Part::Light(number)));
        let approaches = place.approaches.iter().enumerate().map(|(approach, of)| {
            let mut found = Map::new();
            found.insert("edge".into(), json!(of.edge));
            found.insert("street".into(), json!(of.street));
            found.insert("lanes".into(), json!(of.lanes));
            found.extend(object(Part::Approach(number, approach)));
            let movements = of.movements.iter().enumerate().map(|(movement, to)| {
                let mut found = Map::new();
                found.insert("to".into(), json!(to.edge));
                found.insert("street".into(), json!(to.street));
                found.extend(object(Part::Movement(number, approach, movement)));
                Value::Object(found)
            });
            found.insert("movements".into(), movements.collect());
            Value::Object(found)
        });
        light.insert("approaches".into(), approaches.collect());
        Value::Object(light)
    });
    lights.collect()
}

/// Returns where all cars lose their time, in seconds per episode: at lights, on other roads, before entering, and the sum.
pub fn lost_time(played: &Played<'_>) -> Value {
    let count = played.episodes.len().max(1) as f64;
    let mean = |value: &dyn Fn(usize) -> f64| (0..played.episodes.len()).map(value).sum::<f64>() / count;
    let at_lights = |number: usize| played.episodes[number].lights.iter().map(|light| light.sums.delay_s).sum::<f64>();
    json!({
        "cars": mean(&|number| played.episodes[number].cars as f64),
        "at_lights_s": mean(&at_lights),
        "elsewhere_s": mean(&|number| played.episodes[number].elsewhere_s),
        "before_entering_s": mean(&|number| played.episodes[number].before_entering_s),
        "all_s": mean(&|number| played.episodes[number].delay_s()),
    })
}

fn object(played: &Played<'_>, reference: Option<&Played<'_>>, part: Part) -> Map<String, Value> {
    let own = played.figures(part);
    let mut object = Map::new();
    object.insert("cars".into(), json!(own.cars));
    for name in names_of(part, &own) {
        object.insert(name.into(), json!(own.mean(name).map(|found| found.mean)));
    }
    let half_widths =
        names_of(part, &own).map(|name| (name.to_owned(), json!(own.mean(name).and_then(|of| of.half_width))));
    object.insert("half_width_95".into(), Value::Object(half_widths.collect()));
    let level = own.mean(DELAY).map(|delay| level_of_service(delay.mean).to_string());
    object.insert("level_of_service".into(), json!(level));
    if let Some(reference) = reference {
        let reference = reference.figures(part);
        let difference = names_of(part, &own).map(|name| (name.to_owned(), json!(own.difference(&reference, name))));
        object.insert("difference".into(), Value::Object(difference.collect()));
    }
    object
}

/// Returns the names of the figures of a part: a movement has no queue, and most have no buses.
fn names_of(part: Part, own: &PartFigures) -> impl Iterator<Item = &'static str> {
    let has_buses = own.mean(BUS_DELAY).is_some();
    let has_queue = !matches!(part, Part::Movement(..));
    NAMES.into_iter().filter(move |&name| (name != QUEUE || has_queue) && (name != BUS_DELAY || has_buses))
}

#[cfg(test)]
mod tests {
    use super::super::tests::{episode, light};
    use super::*;

    #[test]
    fn each_light_has_its_figures_its_level_and_its_difference() {
        let places = [light("a", &["High Street"]), light("b", &[])];
        let before = [episode(&[(10, 300.0), (10, 900.0)]), episode(&[(10, 500.0), (10, 900.0)])];
        let after = [episode(&[(10, 100.0), (10, 50.0)]), episode(&[(10, 200.0), (10, 50.0)])];
        let [before, after] = [&before, &after].map(|episodes| Played { places: &places, episodes });
        let lights = lights(&after, Some(&before));
        assert_eq!(lights[0]["id"], "a", "the worst first");
        assert_eq!((&lights[0]["name"], &lights[1]["name"]), (&json!("High Street"), &json!("b")));
        assert_eq!((&lights[0]["delay_s"], &lights[0]["level_of_service"]), (&json!(15.0), &json!("B")));
        // -20 and -30 s: mean -25, half the interval 12.706 * 5.
        assert_eq!(lights[0]["difference"]["delay_s"]["mean"], -25.0);
        assert!((lights[0]["difference"]["delay_s"]["half_width_95"].as_f64().unwrap() - 63.53).abs() < 0.01);
        let movement = &lights[0]["approaches"][0]["movements"][0];
        assert_eq!(
            (&movement["to"], &movement["cars"], &movement["delay_s"]),
            (&json!("a_out"), &json!(10.0), &json!(15.0))
        );
        assert!(movement.get("queue_p95_cars").is_none() && lights[0].get("bus_delay_s").is_none());
        assert!(super::lights(&before, None)[0].get("difference").is_none());
    }
}
