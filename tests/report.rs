//! `report` and `compare` on fixed small run directories, against what is known of them.
//!
//! The runs under `tests/report/runs` are made up of round numbers. After a deliberate change of what a report says, remake
//! the golden files with `UPDATE_GOLDEN=1 cargo test --test report`, and read the difference.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;

fn home() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/report")
}

/// The program, called where the fixed runs are `runs`.
fn dials_traffic(args: &[&str]) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.current_dir(home()).args(args);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A report of all fixed runs.
fn report() -> (tempfile::TempDir, PathBuf, String) {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("report");
    let assert = dials_traffic(&["report", "runs", "--out", out.to_str().unwrap()]).assert().success();
    let said = text(&assert.get_output().stderr);
    (dir, out, said)
}

fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = entries.collect();
    names.sort();
    names
}

#[test]
fn the_tables_are_the_golden_ones() {
    let (_dir, out, _) = report();
    let golden = home().join("golden");
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        fs::create_dir_all(&golden).unwrap();
        for name in names(&out).iter().filter(|name| name.ends_with(".csv") || name.ends_with(".md")) {
            fs::copy(out.join(name), golden.join(name)).unwrap();
        }
    }
    let expected = names(&golden);
    assert_eq!(expected, ["agents.csv", "aip_cross_entropy.csv", "costs.csv", "curves.csv", "final.csv", "report.md"]);
    for name in expected {
        let [found, golden] = [&out, &golden].map(|dir| fs::read_to_string(dir.join(&name)).unwrap());
        for (number, (found, golden)) in found.lines().zip(golden.lines()).enumerate() {
            assert_eq!(found, golden, "{name}, line {}", number + 1);
        }
        assert_eq!(found.lines().count(), golden.lines().count(), "{name}");
    }
}

#[test]
fn final_returns_and_runtimes_are_worked_out_by_hand() {
    let (_dir, out, _) = report();
    let line = |file: &str, group: &str| {
        let table = fs::read_to_string(out.join(file)).unwrap();
        table.lines().find(|line| line.starts_with(group)).unwrap().to_owned()
    };
    // 214, 218 and 222: mean 218, deviation 4, standard error 4 / sqrt(3) = 2.3094; each run's median agent is 0.5 higher;
    // the worst agent is 3 below the worst run.
    assert_eq!(
        line("final.csv", "traffic_4,DIALS F=1M"),
        "traffic_4,DIALS F=1M,4000064,true,3,218.0000,2.3094,214.0000,222.0000,218.0000,218.5000,211.0000,0,12"
    );
    // Two periods of 410, 420 and 430 s and a last evaluation of 3 s: 823, 843 and 863; three evaluations of 3 s off: 814, 834
    // and 854, of which 2 s collect and train AIPs; deviation 20, / sqrt(3) = 11.5470.
    assert_eq!(
        line("costs.csv", "traffic_4,DIALS F=1M"),
        "traffic_4,DIALS F=1M,4000064,1,832.0000,2.0000,834.0000,11.5470,843.0000,202.0000,382.0000,262.0000"
    );
    // The unfinished run with seed 2 does not count.
    assert!(line("final.csv", "traffic_4,GS").starts_with("traffic_4,GS,4000064,true,1,200.0000,,,,200.0000,"));
    // At 2M both do: 190 and 194.
    let curves = fs::read_to_string(out.join("curves.csv")).unwrap();
    assert!(curves.contains("traffic_4,GS,2000000,2,192.0000,2.0000,190.0000,194.0000,192.5000,"), "{curves}");
}

#[test]
fn what_is_missing_unfinished_or_broken_is_said() {
    let (_dir, out, said) = report();
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    for told in [
        "runs/traffic_4-gs-seed3: not begun yet",
        "runs/broken: left out: runs/broken/config.toml:",
        "runs/traffic_4-gs-seed2: unfinished, at 2M of 4M steps",
        "traffic, 4 agents, GS: no run with seed 3",
    ] {
        assert!(page.contains(told), "`{told}` is not in the page");
        assert!(said.contains(told), "`{told}` is not in: {said}");
    }
}

#[test]
fn the_page_needs_nothing_else_and_its_pictures_are_well_formed() {
    let (_dir, out, _) = report();
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    let links = page.replace("http://www.w3.org/2000/svg", "");
    for word in ["http:", "https:", "src=", "@import", "url("] {
        assert!(!links.contains(word), "the page asks for something: {word}");
    }
    let pictures: Vec<String> = names(&out).into_iter().filter(|name| name.ends_with(".svg")).collect();
    assert_eq!(pictures.len(), page.matches("<svg ").count());
    assert_eq!(pictures.len(), 12);
    for name in pictures {
        let svg = fs::read_to_string(out.join(&name)).unwrap();
        let mut reader = quick_xml::Reader::from_str(&svg);
        while reader.read_event().unwrap_or_else(|error| panic!("{name}: {error}")) != quick_xml::events::Event::Eof {}
    }
}

#[test]
fn the_measured_controller_and_the_papers_numbers_stand_beside_ours() {
    let (_dir, out, _) = report();
    let svg = fs::read_to_string(out.join("learning_traffic_4.svg")).unwrap();
    for told in ["actuated, measured: 170.6", "hand-coded, the paper: 176.0", "DIALS F=1M, the paper", "GS, the paper"]
    {
        assert!(svg.contains(told), "{told}");
    }
    let markdown = fs::read_to_string(out.join("report.md")).unwrap();
    // 218 - 214 = 4; standard errors 2.3094 and the paper's 1: sqrt(6.3333) = 2.5166; 4 / 2.5166 = 1.6.
    assert!(markdown.contains("| 214.0 ± 1.0 at 4M | +4.0 (1.6 SE) |"), "{markdown}");
    let warehouse = fs::read_to_string(out.join("learning_warehouse_4.svg")).unwrap();
    assert!(!warehouse.contains("DIALS F=200K, the paper"), "200K steps are no match for 4M");
}

#[test]
fn an_earlier_report_is_kept_unless_it_may_be_moved() {
    let (dir, out, _) = report();
    let arguments = ["report", "runs", "--out", out.to_str().unwrap()];
    let output = dials_traffic(&arguments).assert().code(2).get_output().clone();
    assert!(text(&output.stderr).contains("exists already; name another one with --out"));
    dials_traffic(&[&arguments[..], &["--force"]].concat()).assert().success();
    assert_eq!(names(dir.path()), ["report", "report.old-1"]);
}

#[test]
fn folders_without_runs_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for (folder, told) in [("no/such", "no such folder"), (dir.path().to_str().unwrap(), "holds no run directory")] {
        let output = dials_traffic(&["report", folder, "--out", "never"]).assert().code(2).get_output().clone();
        assert!(text(&output.stderr).contains(told), "{output:?}");
    }
    assert!(!home().join("never").exists());
}

fn compare(args: &[&str]) -> Value {
    let assert = dials_traffic(&[&["compare"], args, &["--json"]].concat()).assert().success();
    serde_json::from_slice(&assert.get_output().stdout).unwrap()
}

fn near(value: &Value, expected: f64) {
    let found = value.as_f64().unwrap_or_else(|| panic!("{value} is no number"));
    assert!((found - expected).abs() < 1e-3, "{found} is not {expected}");
}

#[test]
fn the_same_seeds_are_compared_in_pairs() {
    let found =
        compare(&["runs/warehouse_4-dials-clip0.1-seed*", "runs/warehouse_4-dials-clip0.2-seed*", "--reach", "6.2"]);
    // Finals 9.2 and 9.4 against 9.7 and 9.9: both pairs differ by 0.5, without any spread.
    assert_eq!(found["method"], "paired");
    near(&found["difference"], 0.5);
    near(&found["interval_95"][0], 0.5);
    assert_eq!(found["differing"]["ppo.clip"], serde_json::json!(["0.1", "0.2"]));
    // A is at 6 at 100K and at 9.2 at the end; B is at 6.5 at 100K.
    near(&found["a"]["reached_steps"], 200_064.0);
    near(&found["b"]["reached_steps"], 100_000.0);
    // 30 s less an evaluation of 3 s.
    near(&found["b"]["reached_s"], 27.0);
    near(&found["runtime_ratio"], 1.0);
}

#[test]
fn other_seeds_are_compared_as_welch_does() {
    let a = "runs/traffic_4-dials-seed1,runs/traffic_4-dials-seed2";
    let b = "runs/traffic_4-dials-seed2,runs/traffic_4-dials-seed3";
    let found = compare(&[a, b]);
    // 214 and 218 against 218 and 222: difference 4; both variances 8, / 2 = 4; error sqrt(8) = 2.8284; freedom 64 / 32 = 2,
    // whose t is 4.30265: 12.1697.
    assert_eq!(found["method"], "welch");
    near(&found["difference"], 4.0);
    near(&found["interval_95"][0], 4.0 - 12.1697);
    near(&found["interval_95"][1], 4.0 + 12.1697);
    // 95 % of 216.
    near(&found["reach"], 205.2);
}

#[test]
fn a_comparison_tells_a_person_what_to_doubt() {
    let assert =
        dials_traffic(&["compare", "runs/traffic_4-gs-seed1", "runs/traffic_4-dials-seed1"]).assert().success();
    let said = text(&assert.get_output().stdout);
    for told in [
        "simulator: gs in A, dials in B",
        "traffic, 4 agents, at 4M timesteps",
        "+14.0",
        "a side has one seed: no interval",
    ] {
        assert!(said.contains(told), "`{told}` is not in: {said}");
    }
}

#[test]
fn sides_that_cannot_be_compared_are_refused() {
    for (a, b, told) in [
        ("runs/warehouse_4-dials-clip0.1-seed1", "runs/traffic_4-gs-seed1", "different scenarios"),
        ("runs", "runs/traffic_4-gs-seed1", "holds runs of 4 methods, and a side has one"),
        ("runs/nothing*", "runs/traffic_4-gs-seed1", "runs/nothing*: no such folder"),
        ("runs/broken", "runs/traffic_4-gs-seed1", "has no run that was evaluated"),
    ] {
        let output = dials_traffic(&["compare", a, b]).assert().code(2).get_output().clone();
        let said = text(&output.stderr);
        assert!(said.starts_with("error: ") && said.contains(told), "{said}");
    }
}
