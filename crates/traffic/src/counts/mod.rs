//! From traffic counts to routes: how many cars pass a turn or an edge in an interval, and routes that pass there as often.
//!
//! - here: the counts of a CSV file, and the whole way from them to vehicles.
//! - `fit`: how many cars take each route. `routes`: the routes that cars may take.
//!
//! Counts never say where cars come from. So of all ways to fit them, this takes the one that spreads cars over the routes most
//! evenly: each fastest route between two ends of the net has the same weight before the counts are seen.
//!
//! Source: van Zuylen and Willumsen, "The most likely trip matrix estimated from traffic counts", Transportation Research B,
//! 1980. GEH: "Design Manual for Roads and Bridges", volume 12, section 2, 1996.

mod fit;
mod routes;

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::{Context, Result, anyhow, ensure};

use crate::config::sumo_time::seconds;
use crate::network::roads::{EdgeNo, Roads};
use crate::network::xml;
use dials_core::outside::{did_you_mean, excerpt, read_text};

const LARGEST: u64 = 64 << 20;
const MOST_CARS: f64 = 1_000_000.0;
const COLUMNS: [&str; 5] = ["begin", "end", "from", "to", "cars"];
/// A count with a smaller GEH is said to fit.
pub const GOOD_GEH: f64 = 5.0;

/// A number of cars that passed a place in an interval.
#[derive(Clone, Debug, PartialEq)]
struct Count {
    /// Begin and end in milliseconds.
    interval_ms: (u64, u64),
    /// One edge, or two that follow each other: a turn.
    place: Vec<EdgeNo>,
    cars: f64,
}

/// A count beside the cars that were made.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted {
    pub begin_s: f64,
    pub end_s: f64,
    pub from: String,
    /// Empty if all cars on `from` were counted.
    pub to: String,
    pub counted: f64,
    pub made: f64,
    /// `sqrt(2 (m - c)^2 / (m + c))` of the flows per hour.
    pub geh: f64,
}

/// What was made of the counts.
#[derive(Clone, Debug, PartialEq)]
pub struct CountedDemand {
    /// Text of a route file.
    pub routes: String,
    pub cars: usize,
    /// Number of different routes.
    pub ways: usize,
    /// Begin of the first interval and end of the last one, in whole seconds.
    pub window_s: (u64, u64),
    pub counts: Vec<Fitted>,
}

/// Makes vehicles whose routes fit the counts of a file. An error names the line and the way out.
pub fn demand(file: &Path, net: &Path) -> Result<CountedDemand> {
    let roads = Roads::of_file(net)?;
    let text = read_text(file, LARGEST).with_context(|| format!("{}: cannot be read", file.display()))?;
    let counts = read(&text, &roads).map_err(|error| anyhow!("{}: {error:#}", file.display()))?;
    made_of(&counts, &roads).with_context(|| net.display().to_string())
}

fn made_of(counts: &[Count], roads: &Roads) -> Result<CountedDemand> {
    let mut by_interval: BTreeMap<(u64, u64), Vec<usize>> = BTreeMap::new();
    counts
        .iter()
        .enumerate()
        .for_each(|(number, count)| by_interval.entry(count.interval_ms).or_default().push(number));
    let places: Vec<&[EdgeNo]> = counts.iter().map(|count| &*count.place).collect();
    let candidates = routes::candidates(roads, &places);
    let (mut departures, mut made) = (Vec::new(), vec![0.0; counts.len()]);
    for ((begin, end), numbers) in &by_interval {
        let places: Vec<&[EdgeNo]> = numbers.iter().map(|&number| &*counts[number].place).collect();
        let passed: Vec<Vec<usize>> = candidates.iter().map(|route| routes::passed(route, &places)).collect();
        let counted: Vec<f64> = numbers.iter().map(|&number| counts[number].cars).collect();
        let cars = fit::fit(&passed, &counted);
        for (route, (&cars, passed)) in cars.iter().zip(&passed).enumerate() {
            passed.iter().for_each(|&place| made[numbers[place]] += cars as f64);
            departures.extend((0..cars).map(|car| (depart_ms(*begin, *end, route, car), route)));
        }
    }
    departures.sort_unstable();
    ensure!(!departures.is_empty(), "no route of cars passes a place with a count above 0; correct the counts");
    let mut ways: Vec<usize> = departures.iter().map(|(_, route)| *route).collect();
    ways.sort_unstable();
    ways.dedup();
    let name = |edge: EdgeNo| roads.edge(edge).id.clone();
    let fitted = counts.iter().zip(&made).map(|(count, &made)| {
        let (begin, end) = count.interval_ms;
        let per_hour = 3_600_000.0 / (end - begin) as f64;
        Fitted {
            begin_s: begin as f64 / 1000.0,
            end_s: end as f64 / 1000.0,
            from: name(count.place[0]),
            to: count.place.get(1).map_or(String::new(), |&to| name(to)),
            counted: count.cars,
            made,
            geh: geh(made * per_hour, count.cars * per_hour),
        }
    });
    let begin = by_interval.keys().map(|(begin, _)| *begin).min().unwrap_or(0);
    let end = by_interval.keys().map(|(_, end)| *end).max().unwrap_or(0);
    Ok(CountedDemand {
        cars: departures.len(),
        ways: ways.len(),
        window_s: (begin / 1000, end.div_ceil(1000)),
        counts: fitted.collect(),
        routes: route_file(&departures, &ways, &candidates, roads),
    })
}

fn geh(one: f64, other: f64) -> f64 {
    let sum = one + other;
    if sum > 0.0 { (2.0 * (one - other).powi(2) / sum).sqrt() } else { 0.0 }
}

/// Returns when a car of a route departs: spread over the interval, each route with another beginning. By multiples of the golden
/// ratio, any number of cars is spread evenly, and nothing is random.
fn depart_ms(begin: u64, end: u64, route: usize, car: usize) -> u64 {
    const GOLDEN: f64 = 0.618_033_988_749_895;
    const OTHER: f64 = 0.754_877_666_246_693;
    let share = (car as f64 * GOLDEN + route as f64 * OTHER).fract();
    begin + ((end - begin) as f64 * share) as u64
}

fn route_file(departures: &[(u64, usize)], ways: &[usize], candidates: &[Vec<EdgeNo>], roads: &Roads) -> String {
    xml::document("routes", |xml| {
        for &way in ways {
            let edges: Vec<&str> = candidates[way].iter().map(|&edge| &*roads.edge(edge).id).collect();
            xml::leaf(xml, "route", [("id", format!("way_{way}")), ("edges", edges.join(" "))])?;
        }
        for (number, (depart, way)) in departures.iter().enumerate() {
            let depart = format!("{}.{:03}", depart / 1000, depart % 1000);
            let car = [("id", format!("car_{number}")), ("route", format!("way_{way}")), ("depart", depart)];
            let begin = [("departLane", "best".to_owned()), ("departSpeed", "max".to_owned())];
            xml::leaf(xml, "vehicle", car.into_iter().chain(begin))?;
        }
        Ok(())
    })
}

/// Reads the lines of a CSV file with the columns [`COLUMNS`], in any order.
fn read(text: &str, roads: &Roads) -> Result<Vec<Count>> {
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let (_, header) = lines.next().context("is empty; its first line names the columns: begin,end,from,to,cars")?;
    let header = cells(header.trim_start_matches('\u{FEFF}'));
    let column = |name: &str| {
        header.iter().position(|cell| cell == name).with_context(|| {
            let near = did_you_mean(name, header.iter().map(String::as_str));
            format!(
                "line 1: there is no column `{name}`{near}; the columns are {}, separated by commas",
                COLUMNS.join(",")
            )
        })
    };
    let [begin, end, from, to, cars] = COLUMNS.map(column);
    let [begin, end, from, to, cars] = [begin?, end?, from?, to?, cars?];
    let mut counts: Vec<Count> = Vec::new();
    let mut seen = BTreeSet::new();
    for (number, line) in lines {
        let line = cells(line);
        let place = || format!("line {}", number + 1);
        let cell = |column: usize| line.get(column).map_or("", String::as_str);
        let time = |column: usize| -> Result<u64> {
            let second = seconds(cell(column)).ok().filter(|second| (0.0..1e10).contains(second));
            let what = || {
                format!(
                    "{}: {} = `{}`: must be a second, such as 25200 or 07:00:00",
                    place(),
                    COLUMNS[usize::from(column == end)],
                    excerpt(cell(column))
                )
            };
            second.map(|second| (second * 1000.0).round() as u64).with_context(what)
        };
        let interval_ms = (time(begin)?, time(end)?);
        ensure!(interval_ms.0 < interval_ms.1, "{}: must end after it begins", place());
        let number = cell(cars).parse::<f64>().ok().filter(|cars| (0.0..=MOST_CARS).contains(cars));
        let cars = number.with_context(|| {
            format!("{}: cars = `{}`: must be a number from 0 to {MOST_CARS}", place(), excerpt(cell(cars)))
        })?;
        let edges = [cell(from), cell(to)].into_iter().enumerate().filter(|(way, edge)| *way == 0 || !edge.is_empty());
        let edges = edges.map(|(_, edge)| roads.edge_called(edge)).collect::<Result<Vec<_>>>().with_context(place)?;
        if let [from, to] = edges[..] {
            ensure!(
                routes::follows(roads, from, to),
                "{}: cars cannot turn from `{}` into `{}`; name two edges that follow each other",
                place(),
                roads.edge(from).id,
                roads.edge(to).id
            );
        }
        ensure!(
            seen.insert((interval_ms, edges.clone())),
            "{}: counts the same place and time as an earlier line; leave one",
            place()
        );
        counts.push(Count { interval_ms, place: edges, cars });
    }
    ensure!(counts.iter().any(|count| count.cars > 0.0), "has no count above 0");
    let mut intervals: Vec<(u64, u64)> = counts.iter().map(|count| count.interval_ms).collect();
    intervals.sort_unstable();
    intervals.dedup();
    let overlap = intervals.windows(2).find(|pair| pair[1].0 < pair[0].1);
    ensure!(
        overlap.is_none(),
        "has intervals that overlap, such as {:?} and {:?} (milliseconds): each second may be in one interval only",
        overlap.map_or((0, 0), |pair| pair[0]),
        overlap.map_or((0, 0), |pair| pair[1])
    );
    Ok(counts)
}

fn cells(line: &str) -> Vec<String> {
    line.split(',').map(|cell| cell.trim().trim_matches('"').to_owned()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::roads::example::roads;

    #[test]
    fn routes_fit_the_counts_of_turns_and_edges() {
        let text = "begin,end,from,to,cars\n0,600,far,near,30\n0,600,north,back,12\n0,600,out,,40\n";
        let roads = roads(&[]);
        let found = made_of(&read(text, &roads).unwrap(), &roads).unwrap();
        // 30 cars come from far. The other 10 on `out` come from north, beside 12 that turn right.
        assert_eq!(found.counts.iter().map(|count| count.made).collect::<Vec<_>>(), [30.0, 12.0, 40.0]);
        assert!(found.counts.iter().all(|count| count.geh == 0.0));
        assert_eq!((found.cars, found.window_s), (52, (0, 600)));
        assert_eq!(found.routes.matches("<vehicle ").count(), 52);
        assert!(found.routes.contains("edges=\"far near out\""), "{}", found.routes);
    }

    #[test]
    fn geh_is_of_flows_per_hour() {
        // 2 * 100^2 / 1900 = 10.5
        assert!((geh(1000.0, 900.0) - 3.244).abs() < 1e-3);
        assert_eq!(geh(0.0, 0.0), 0.0);
    }

    #[test]
    fn what_is_wrong_in_a_file_is_an_error_with_its_line() {
        let roads = roads(&[]);
        for (text, message) in [
            ("", "is empty"),
            ("begin,end,from,cars\n", "no column `to`"),
            ("begin,end,from,to,cars\n0,9,fart,near,1\n", "line 2: the net has no edge `fart` (did you mean `far`?)"),
            ("begin,end,from,to,cars\n0,9,far,out,1\n", "line 2: cars cannot turn from `far` into `out`"),
            ("begin,end,from,to,cars\n9,9,far,near,1\n", "line 2: must end after it begins"),
            ("begin,end,from,to,cars\n0,9,far,near,many\n", "line 2: cars = `many`"),
            ("begin,end,from,to,cars\n0,9,far,near,1\n0,9,far,near,2\n", "line 3: counts the same place"),
            ("begin,end,from,to,cars\n0,9,far,near,1\n5,12,far,near,2\n", "has intervals that overlap"),
            ("begin,end,from,to,cars\n0,9,far,near,0\n", "has no count above 0"),
        ] {
            let error = format!("{:#}", read(text, &roads).unwrap_err());
            assert!(error.contains(message), "{text}: {error}");
        }
    }
}
