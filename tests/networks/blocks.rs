//! Forests of different local nets: with cars that dawdle at random, each region is bit-identical to itself alone.

use std::fs;

use dials_traffic::config::ScenarioConfig;
use dials_traffic::traffic::cut::beyond::Reach;
use dials_traffic::traffic::cut::blocks::{Blocks, Row, prefix};
use dials_traffic::traffic::cut::local_net::LocalNet;
use dials_traffic::traffic::cut::of_scenario::{cut_light, write};
use dials_traffic::traffic::scenario::SumoScenario;

use super::shipped::file;
use super::{Attributes, elements, elements_of, room, sumo, text};

const SEED: u32 = 7;
const STEPS: usize = 300;

/// Some lights of the town, as many as blocks.
const LIGHTS: usize = 3;

/// A region with its own cars.
struct Region {
    net: LocalNet,
    /// Edges of routes.
    routes: Vec<String>,
}

/// Returns the first lights of the town that learn.
fn regions() -> Vec<Region> {
    let scenario = SumoScenario::read(&ScenarioConfig::of_file(&file("town", "sumocfg")).unwrap()).unwrap();
    let lights: Vec<String> =
        elements(scenario.net_path(), "tlLogic").iter().map(|light| light["id"].clone()).collect();
    let region = |light: &String| {
        let room = room();
        let net = cut_light(&scenario, light, 150.0, Reach::default()).unwrap();
        let files = write(&net, &scenario, room.path()).unwrap();
        let routes = elements(&files.routes, "route").into_iter().map(|route| route["edges"].clone()).collect();
        Region { net, routes }
    };
    lights.iter().take(LIGHTS).map(region).collect()
}

/// Returns a route file with cars that dawdle. Every few seconds each block has one more, on another route.
fn cars(rows: &[(usize, &Region)]) -> String {
    let mut text = "<routes><vType id=\"car\" sigma=\"0.5\" speedDev=\"0\"/>".to_owned();
    for second in (0..STEPS).step_by(2) {
        for (block, region) in rows {
            let prefix = prefix(*block);
            let route = &region.routes[second * 7 % region.routes.len()];
            let edges: Vec<String> = route.split(' ').map(|edge| format!("{prefix}{edge}")).collect();
            text += &format!(
                "<vehicle id=\"{prefix}{second}\" type=\"car\" depart=\"{second}\" departLane=\"best\" \
                 departSpeed=\"max\"><route edges=\"{}\"/></vehicle>",
                edges.join(" ")
            );
        }
    }
    text + "</routes>"
}

/// Plays a forest of these rows. Returns the cars of each row, second by second, without the prefix of their names.
/// `options`: instead of those of the forest.
fn play(blocks: Blocks, rows: &[(usize, &Region)], options: Option<&[&str]>) -> Vec<Vec<Attributes>> {
    let room = room();
    let nets: Vec<Row> = rows.iter().map(|&(block, region)| Row { net: &region.net, block }).collect();
    let forest = blocks.forest(&nets, SEED).unwrap();
    let [net, routes, cars_seen] = ["net.xml", "rou.xml", "fcd.xml"].map(|name| room.path().join(name));
    fs::write(&net, &forest.net).unwrap();
    fs::write(&routes, cars(rows)).unwrap();
    let own: Vec<&str> = forest.options.iter().map(String::as_str).collect();
    let files = ["-n", text(&net), "-r", text(&routes), "--fcd-output", text(&cars_seen)];
    let times = ["--end", "300", "--time-to-teleport", "-1", "--precision", "17", "--no-step-log", "--no-warnings"];
    sumo(&[&files[..], &times, options.unwrap_or(&own)].concat());
    let seen = elements_of(&fs::read_to_string(&cars_seen).unwrap(), "vehicle");
    let of_row = |block: usize| {
        let prefix = prefix(block);
        let without = |mut car: Attributes| {
            for value in car.values_mut() {
                *value = value.replace(&prefix, "");
            }
            car
        };
        let own = seen.iter().filter(|car| car["id"].starts_with(&prefix)).cloned();
        own.map(without).collect::<Vec<_>>()
    };
    rows.iter().map(|(block, _)| of_row(*block)).collect()
}

#[test]
fn regions_are_bit_identical_alone_and_in_any_company_where_cars_dawdle() {
    let regions = regions();
    let blocks = Blocks::of(regions.iter().map(|region| &region.net));
    // Block 4 is another copy of the first region.
    let rows: Vec<(usize, &Region)> = (2..6).map(|block| (block, &regions[[0, 1, 0, 2][block - 2]])).collect();
    let together = play(blocks, &rows, None);
    for (row, seen) in rows.iter().zip(&together) {
        let alone = play(blocks, &[*row], None).remove(0);
        assert!(seen.len() > 10 * STEPS, "block {}: many cars drive", row.0);
        assert!(*seen == alone, "block {}: alone and in company", row.0);
    }
    assert!(play(blocks, &rows[1..], None) == together[1..], "other blocks before it");
    assert!(play(blocks, &rows[..2], None) == together[..2], "other blocks behind it");
    assert!(together[0] != together[2], "two copies of a region draw numbers of their own");
    // With SUMO's own options company matters.
    let shared = ["--seed", "7"];
    assert!(play(blocks, &rows, Some(&shared))[1] != play(blocks, &rows[1..2], Some(&shared))[0]);
}

#[test]
fn plain_sumo_has_nothing_to_say_of_a_forest_and_every_block_has_as_many_lanes() {
    let regions = regions();
    let blocks = Blocks::of(regions.iter().map(|region| &region.net));
    let rows: Vec<Row> = regions.iter().enumerate().map(|(block, region)| Row { net: &region.net, block }).collect();
    let forest = blocks.forest(&rows, SEED).unwrap();
    let room = room();
    let net = room.path().join("net.xml");
    fs::write(&net, &forest.net).unwrap();
    let options: Vec<&str> = forest.options.iter().map(String::as_str).collect();
    let quiet = ["-n", text(&net), "--end", "10", "--no-step-log", "--xml-validation", "never"];
    assert_eq!(sumo(&[&quiet[..], &options].concat()), "");
    let lanes: Vec<String> = elements(&net, "lane").iter().map(|lane| lane["id"].clone()).collect();
    let most = regions.iter().map(|region| region.net.lanes().count()).max().unwrap();
    assert_eq!(lanes.len(), LIGHTS * most);
    for (block, lanes) in lanes.chunks(most).enumerate() {
        let own = |lane: &String| lane.trim_start_matches(':').starts_with(&prefix(block));
        assert!(lanes.iter().all(own), "block {block}");
    }
    assert_eq!(forest.options, ["--thread-rngs", &lanes.len().to_string(), "--seed", "7"].map(str::to_owned));
}

#[test]
fn what_is_no_forest_is_refused() {
    let regions = regions();
    let nets: Vec<&LocalNet> = regions.iter().map(|region| &region.net).collect();
    let error = |blocks: Blocks, numbers: [usize; 2], seed: u32| {
        let rows = numbers.map(|block| Row { net: nets[block % 2], block });
        blocks.forest(&rows, seed).unwrap_err().to_string()
    };
    let blocks = Blocks::of(nets.clone());
    assert_eq!(error(blocks, [4, 6], 0), "row 1 of the forest is block 6, but must be 5");
    assert!(error(blocks, [4, 5], i32::MAX as u32).contains("have seeds beyond 2147483647"));
    let most = nets.iter().max_by_key(|net| net.lanes().count()).unwrap();
    let few = Blocks::of(nets.iter().copied().filter(|net| net.light != most.light));
    let rows = [Row { net: most, block: 0 }];
    assert!(few.forest(&rows, 0).unwrap_err().to_string().contains(", but blocks have "));
    assert!(blocks.forest(&[], 0).is_err());
}
