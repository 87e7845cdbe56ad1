//! `benchmark resco`: a short road in the place of a map is trained and measured, and the board has all of it.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;

/// Makes a folder like RESCO's `environments`, with two minutes of the shipped busy road called cologne1.
fn environments() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let map = dir.path().join("env/cologne1");
    fs::create_dir_all(&map).unwrap();
    let road = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/busy_road");
    for ending in ["net.xml", "rou.xml"] {
        fs::copy(road.join(format!("grid_3x3.{ending}")), map.join(format!("cologne1.{ending}"))).unwrap();
    }
    let sumocfg = "<configuration><net-file value='cologne1.net.xml'/><route-files value='cologne1.rou.xml'/>\
                   <begin value='0'/><end value='120'/></configuration>";
    fs::write(map.join("cologne1.sumocfg"), sumocfg).unwrap();
    dir
}

fn benchmark(dir: &Path, more: &[&str]) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.current_dir(dir).args([
        "benchmark",
        "resco",
        "env",
        "--protocol",
        "ours",
        "--methods",
        "gs,gs-any-light",
        "--cores",
        "2",
    ]);
    command.args(["--seeds", "1", "--episodes", "1", "--measured-episodes", "2", "--out", "board"]).args(more);
    command
}

fn board(dir: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(dir.join("board/benchmark.json")).unwrap()).unwrap()
}

#[test]
fn a_map_is_trained_and_measured_once_and_stands_beside_what_others_published() {
    let dir = environments();
    let assert = benchmark(dir.path(), &[]).assert().success();
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    // Six controllers, the tuned one, two runs, and the last policies of each greedy and sampled.
    assert!(said.contains("13 done now, 0 done earlier"), "{said}");
    let found = board(dir.path());
    let map = &found["maps"][0];
    assert_eq!((map["map"].as_str(), map["missing"].as_array().map(Vec::len)), (Some("cologne1"), Some(0)));
    let names: Vec<&str> =
        map["controllers"].as_array().unwrap().iter().map(|one| one["controller"].as_str().unwrap()).collect();
    assert_eq!(names, ["program", "actuated", "gap-out", "max-pressure", "max-wave", "any-light", "fixed-time, tuned"]);
    let [gs, from_any_light] = &map["methods"].as_array().unwrap()[..] else { panic!("{map:#}") };
    assert_eq!((gs["method"].as_str(), gs["runs"][0]["greedy"]["episodes"].as_u64()), (Some("gs"), Some(2)));
    assert!(gs["cpu_s"].as_f64().unwrap() > 0.0 && gs["sampled"]["mean_delay_s"].as_f64().unwrap() > 0.0);
    let sampled = from_any_light["sampled"]["mean_delay_s"].as_f64();
    assert!(from_any_light["method"] == "gs-any-light" && sampled > Some(0.0), "{from_any_light:#}");
    assert_eq!(map["published"][2]["kind"], "best episode");
    let page = fs::read_to_string(dir.path().join("board/benchmark.md")).unwrap();
    assert!(page.contains("| IDQN | - | 26.1 | - | - | - | - | published, best episode |"), "{page}");
    assert!(page.contains("| gs, greedy | 1 | "), "{page}");
    assert_eq!(fs::read_to_string(dir.path().join("board/benchmark.csv")).unwrap().lines().count(), 1 + 7 + 4 + 4);

    let assert = benchmark(dir.path(), &[]).assert().success();
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(said.contains("0 done now, 13 done earlier"), "{said}");
    assert_eq!(board(dir.path()), found);
}

#[test]
fn without_time_nothing_begins_and_the_page_names_what_is_missing() {
    let dir = environments();
    let assert = benchmark(dir.path(), &["--budget-minutes", "0"]).assert().success();
    let said = String::from_utf8_lossy(&assert.get_output().stderr).into_owned();
    assert!(said.contains("0 done now, 0 done earlier; 13 tasks left"), "{said}");
    let missing = &board(dir.path())["maps"][0]["missing"];
    assert_eq!(missing.as_array().map(Vec::len), Some(9), "{missing}");
    let other = benchmark(dir.path(), &["--maps", "cologne2"]).assert().code(2);
    let said = String::from_utf8_lossy(&other.get_output().stderr).into_owned();
    assert!(said.contains("cologne2: is no map of RESCO"), "{said}");
}
