//! The figures of lights over several episodes, and their differences from those of another player on the same traffic.
//!
//! [`json`], [`csv`] and [`table`] write them. The words of a city's engineer: *level of service* is the letter of the Highway
//! Capacity Manual for the control delay of a light.

pub mod csv;
pub mod json;
pub mod table;

use dials_core::base::statistics::Interval;
use dials_core::domain::light_figures::{CarSums, LightPlace, LightsEpisode};

/// Largest control delay of each level of service at signalised intersections, in seconds per car. Above the last one it is F.
/// Source: Highway Capacity Manual, 6th edition (TRB 2016), exhibit 19-8, for a volume-to-capacity ratio of at most 1.
const LEVELS: [(f64, char); 5] = [(10.0, 'A'), (20.0, 'B'), (35.0, 'C'), (55.0, 'D'), (80.0, 'E')];

/// Returns the level of service of a delay in seconds per car.
pub fn level_of_service(delay_s: f64) -> char {
    LEVELS.iter().find(|(most_s, _)| delay_s <= *most_s).map_or('F', |&(_, level)| level)
}

/// The lights of a domain, and what a player did there: one entry per episode.
pub struct Played<'a> {
    pub places: &'a [LightPlace],
    pub episodes: &'a [LightsEpisode],
}

/// What a line of a table is about. Numbers are those of [`LightPlace`], its approaches and their movements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Part {
    Light(usize),
    Approach(usize, usize),
    Movement(usize, usize, usize),
}

/// The figures of a part: name, value in each episode. A value is missing in an episode without cars there.
pub struct PartFigures {
    pub cars: f64,
    pub figures: Vec<(&'static str, Vec<Option<f64>>)>,
}

/// Names of the figures.
pub const DELAY: &str = "delay_s";
pub const STOPS: &str = "stops_per_car";
pub const QUEUE: &str = "queue_p95_cars";
pub const BUS_DELAY: &str = "bus_delay_s";

/// All figures of a part, in the order of columns. A movement has no queue of its own.
pub const NAMES: [&str; 4] = [DELAY, STOPS, QUEUE, BUS_DELAY];

impl Played<'_> {
    /// Returns all parts, the worst light first: each light with its approaches and their movements behind it.
    pub fn parts(&self) -> Vec<Part> {
        let mut parts = Vec::new();
        for light in self.worst_first() {
            parts.push(Part::Light(light));
            for (approach, of) in self.places[light].approaches.iter().enumerate() {
                parts.push(Part::Approach(light, approach));
                parts.extend((0..of.movements.len()).map(|movement| Part::Movement(light, approach, movement)));
            }
        }
        parts
    }

    /// Returns the figures of a part.
    pub fn figures(&self, part: Part) -> PartFigures {
        let of = |episode: &LightsEpisode| -> (CarSums, Option<f64>) {
            match part {
                Part::Light(light) => (episode.lights[light].sums, Some(episode.lights[light].queue_p95_cars())),
                Part::Approach(light, approach) => {
                    let found = &episode.lights[light].approaches[approach];
                    (found.sums, Some(found.queue_p95_cars))
                }
                Part::Movement(light, approach, movement) => {
                    (episode.lights[light].approaches[approach].movements[movement], None)
                }
            }
        };
        let all: Vec<(CarSums, Option<f64>)> = self.episodes.iter().map(of).collect();
        let share = |sum: f64, count: u64| (count > 0).then(|| sum / count as f64);
        let each = |value: &dyn Fn(&CarSums) -> Option<f64>| all.iter().map(|(sums, _)| value(sums)).collect();
        let queue: Vec<Option<f64>> = all.iter().map(|(_, queue)| *queue).collect();
        let figures = vec![
            (DELAY, each(&|sums| share(sums.delay_s, sums.cars))),
            (STOPS, each(&|sums| share(sums.stops as f64, sums.cars))),
            (QUEUE, queue),
            (BUS_DELAY, each(&|sums| share(sums.bus_delay_s, sums.buses))),
        ];
        let cars = all.iter().map(|(sums, _)| sums.cars as f64).sum::<f64>() / all.len().max(1) as f64;
        PartFigures { cars, figures }
    }

    /// Returns the lights in the order of the time that all cars lose there, the worst first.
    pub fn worst_first(&self) -> Vec<usize> {
        let lost_s = |light: usize| self.episodes.iter().map(|episode| episode.lights[light].sums.delay_s).sum::<f64>();
        let mut lights: Vec<usize> = (0..self.places.len()).collect();
        lights.sort_by(|&one, &other| lost_s(other).total_cmp(&lost_s(one)));
        lights
    }
}

impl PartFigures {
    fn values(&self, name: &str) -> &[Option<f64>] {
        self.figures.iter().find(|(figure, _)| *figure == name).map_or(&[], |(_, values)| values)
    }

    /// Returns the mean of a figure over the episodes that have it, with its interval. `None`: no episode has.
    pub fn mean(&self, name: &str) -> Option<Interval> {
        let values: Vec<f64> = self.values(name).iter().copied().flatten().collect();
        (!values.is_empty()).then(|| Interval::of(&values))
    }

    /// Returns by how much a figure is higher than that of `other`, paired by episode, over the episodes in which both have it.
    pub fn difference(&self, other: &PartFigures, name: &str) -> Option<Interval> {
        let pairs = self.values(name).iter().zip(other.values(name));
        let differences: Vec<f64> = pairs.filter_map(|(own, other)| Some((*own)? - (*other)?)).collect();
        (!differences.is_empty()).then(|| Interval::of(&differences))
    }
}

/// Returns a name for a light that a person knows: its streets, or its id.
pub fn title(place: &LightPlace) -> String {
    match &place.streets[..] {
        [] => place.id.clone(),
        streets => streets.iter().take(3).map(String::as_str).collect::<Vec<_>>().join(" / "),
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use dials_core::domain::light_figures::{ApproachEpisode, ApproachPlace, LightEpisode, MovementPlace};

    /// Returns a light with one approach and one movement.
    pub(crate) fn light(id: &str, streets: &[&str]) -> LightPlace {
        let street = streets.first().map(|&street| street.to_owned());
        let movements = vec![MovementPlace { edge: format!("{id}_out"), street: street.clone() }];
        LightPlace {
            id: id.to_owned(),
            streets: streets.iter().map(|&street| street.to_owned()).collect(),
            place_m: [0.0, 0.0],
            approaches: vec![ApproachPlace { edge: format!("{id}_in"), street, lanes: 1, movements }],
        }
    }

    /// Returns an episode in which this many cars lost this time at each light.
    pub(crate) fn episode(lights: &[(u64, f64)]) -> LightsEpisode {
        let at = |&(cars, delay_s): &(u64, f64)| {
            let sums = CarSums { cars, delay_s, stops: cars, ..CarSums::default() };
            let approach = ApproachEpisode { sums, queue_p95_cars: 3.0, movements: vec![sums] };
            LightEpisode { sums, approaches: vec![approach] }
        };
        LightsEpisode { lights: lights.iter().map(at).collect(), ..LightsEpisode::default() }
    }

    #[test]
    fn the_letters_are_those_of_the_manual() {
        let letters: String =
            [0.0, 10.0, 10.1, 20.0, 35.0, 35.1, 55.0, 80.0, 80.1].map(level_of_service).iter().collect();
        assert_eq!(letters, "AABBCDDEF");
    }

    #[test]
    fn differences_are_paired_and_an_episode_without_cars_has_no_delay() {
        let places = [light("a", &[])];
        let before = [episode(&[(10, 300.0)]), episode(&[(10, 500.0)]), episode(&[(0, 0.0)])];
        let after = [episode(&[(10, 200.0)]), episode(&[(10, 400.0)]), episode(&[(5, 50.0)])];
        let [before, after] = [&before, &after].map(|episodes| Played { places: &places, episodes });
        let [before, after] = [before, after].map(|played| played.figures(Part::Light(0)));
        // 30 and 50 s per car before; 20, 40 and 10 s after.
        assert_eq!(before.mean(DELAY).unwrap().mean, 40.0);
        let difference = after.difference(&before, DELAY).unwrap();
        assert_eq!((difference.mean, difference.half_width), (-10.0, Some(0.0)));
        assert_eq!(after.mean(BUS_DELAY), None);
    }

    #[test]
    fn the_worst_light_is_where_all_cars_together_lose_the_most() {
        let places = [light("a", &[]), light("b", &[]), light("c", &[])];
        let episodes = [episode(&[(1, 90.0), (100, 200.0), (10, 100.0)])];
        assert_eq!(Played { places: &places, episodes: &episodes }.worst_first(), [1, 2, 0]);
    }
}
