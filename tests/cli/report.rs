//! `report` and `compare` on small fixed run directories, against known results.
//!
//! The runs under `tests/report/runs` are invented, with round numbers. After a deliberate change of a report's text,
//! remake the golden files with `UPDATE_GOLDEN=1 cargo test --test report`, and read the difference.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;

fn home() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/report")
}

/// Makes a command of the program in the folder that holds the fixed runs as `runs`.
fn dials_traffic(args: &[&str]) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.current_dir(home()).args(args);
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Makes a report of all fixed runs. Returns its folders and what the program printed to stderr.
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
    let files =
        ["agents", "aip_cross_entropy", "costs", "curves", "differences", "final"].map(|name| format!("{name}.csv"));
    assert_eq!(expected, [&files[..], &["report.md", "seeds.csv"].map(str::to_owned)].concat());
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
    // 214, 218 and 222: mean 218, deviation 4, standard error 4 / sqrt(3) = 2.3094. Three are too few for an interval.
    // Each run's median agent is 0.5 higher. The worst agent is 3 below the worst run.
    assert_eq!(
        line("final.csv", "traffic_4,DIALS F=1M"),
        "traffic_4,DIALS F=1M,4000064,true,3,4,218.0000,2.3094,,,218.0000,218.5000,211.0000,0,12"
    );
    // Two periods of 410, 420 and 430 s and a last evaluation of 3 s: 823, 843 and 863. Minus three evaluations of 3 s:
    // 814, 834 and 854, of which 2 s collect data and train AIPs. CPU: two periods of 700 s and 6 s; evaluations 5, 5
    // and 6 s.
    assert_eq!(
        line("costs.csv", "traffic_4,DIALS F=1M"),
        "traffic_4,DIALS F=1M,4000064,true,1,832.0000,2.0000,834.0000,,,843.0000,1406.0000,16.0000,202.0000,382.0000,262.0000"
    );
    // The unfinished run with seed 2 does not count.
    assert!(line("final.csv", "traffic_4,GS").starts_with("traffic_4,GS,4000064,true,1,4,200.0000,,,,200.0000,"));
    // At 2M both runs count: 190 and 194.
    let curves = fs::read_to_string(out.join("curves.csv")).unwrap();
    assert!(curves.contains("traffic_4,GS,2000000,2,192.0000,2.0000,,,192.5000,"), "{curves}");
}

#[test]
fn what_is_missing_unfinished_or_broken_is_said() {
    let (_dir, out, said) = report();
    let page = fs::read_to_string(out.join("report.html")).unwrap();
    // On the terminal a long line is broken.
    assert!(said.lines().all(|line| line.chars().count() <= 80), "{said}");
    let said = said.replace("\n  ", " ");
    for told in [
        "runs/traffic_4-gs-seed3: not begun yet",
        "runs/broken: left out: runs/broken/config.toml:",
        "runs/traffic_4-gs-seed2: unfinished, at 4M of 4M steps, last evaluated at 2M",
        "traffic, 4 agents, GS: no run with seed 3",
    ] {
        assert!(page.contains(told), "`{told}` is not in the page");
        assert!(said.contains(told), "`{told}` is not in: {said}");
    }
}

/// Takes the evaluation at 2M out of a run that has trained until there.
fn stop_before_its_evaluation(run: &Path) {
    for file in ["returns.csv", "episodes.csv"] {
        let text = fs::read_to_string(run.join(file)).unwrap();
        let kept = text.lines().filter(|line| !line.starts_with("2000000,")).map(|line| line.to_owned() + "\n");
        fs::write(run.join(file), kept.collect::<String>()).unwrap();
    }
}

#[test]
fn a_run_that_was_stopped_between_evaluations_is_where_its_last_checkpoint_is() {
    let change = |runs: &Path| stop_before_its_evaluation(&runs.join("traffic_4-gs-seed2"));
    let (_dir, markdown) = report_of(&["traffic_4-gs-seed2"], change);
    let told = "runs/traffic_4-gs-seed2: unfinished, at 4M of 4M steps, last evaluated at 0";
    assert!(markdown.contains(told), "{markdown}");
    assert!(markdown.contains("| unfinished, at 4M | 0 |"), "{markdown}");
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
    assert_eq!(pictures.len(), 14);
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
    for told in [
        "actuated, measured: 170.6",
        "pale lines: single seeds",
        "hand-coded, the paper: 176.0",
        "DIALS F=1M, the paper",
        "GS, the paper",
    ] {
        assert!(svg.contains(told), "{told}");
    }
    let markdown = fs::read_to_string(out.join("report.md")).unwrap();
    assert!(markdown.contains("| 214.0 ± 1.0 at 4M | +4.0 |"), "{markdown}");
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

#[test]
fn a_folder_that_is_named_twice_counts_once() {
    let dir = tempfile::tempdir().unwrap();
    let made = |name: &str, folders: &[&str]| {
        let out = dir.path().join(name);
        dials_traffic(&[&["report"], folders, &["--out", out.to_str().unwrap()]].concat()).assert().success();
        fs::read_to_string(out.join("report.md")).unwrap()
    };
    let once = made("once", &["runs"]);
    assert_eq!(made("twice", &["runs", "runs"]), once);
    assert_eq!(made("within", &["runs", "runs/traffic_4-gs-seed1", "../report/runs/baselines/.."]), once);
}

/// Copies some fixed runs, changes the copies and makes a report of them. Returns the folder and the Markdown.
fn report_of(runs: &[&str], change: impl Fn(&Path)) -> (tempfile::TempDir, String) {
    let dir = copy_of(runs);
    change(&dir.path().join("runs"));
    let mut command = dials_traffic(&["report", "runs", "--out", "report"]);
    command.current_dir(dir.path()).assert().success();
    let markdown = fs::read_to_string(dir.path().join("report/report.md")).unwrap();
    (dir, markdown)
}

/// Makes a folder with copies of some fixed runs under `runs`.
fn copy_of(runs: &[&str]) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for run in runs {
        let to = dir.path().join("runs").join(run);
        fs::create_dir_all(&to).unwrap();
        for name in names(&home().join("runs").join(run)) {
            fs::copy(home().join("runs").join(run).join(&name), to.join(name)).unwrap();
        }
    }
    dir
}

fn edit(path: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{from}");
    fs::write(path, text.replace(from, to)).unwrap();
}

#[test]
fn scenarios_of_as_many_agents_stand_apart_and_only_the_papers_has_its_numbers() {
    let runs = ["traffic_4-gs-seed1", "traffic_4-dials-seed1", "baselines"];
    let (dir, markdown) = report_of(&runs, |runs| {
        edit(&runs.join("traffic_4-gs-seed1/run.json"), "\"length\": 300", "\"length\": 100");
        edit(&runs.join("baselines/traffic_4-actuated.json"), "traffic-4-300", "traffic-9-300");
    });
    for told in [
        "## Traffic, 4 agents, 300 steps",
        "## Traffic, 4 agents, 100 steps",
        "## Costs, traffic, 4 agents, 300 steps",
        "## Costs, traffic, 4 agents, 100 steps",
        "| hours, ours / paper | training, 4, 300 steps | training, 25 |",
        "| hours | training, 4, 100 steps | influence, 4, 100 steps |",
        "| 214.0 ± 1.0 at 4M | +0.0 |",
        "runs/baselines/traffic_4-actuated.json: left out: was measured on traffic-9-300, but there is no run of it",
    ] {
        assert!(markdown.contains(told), "`{told}` is not in {markdown}");
    }
    assert!(!markdown.contains("200.5 ± 7.0"), "the paper's GS has episodes of 300 steps");
    // 100 steps have our 0.5 h and nothing from the paper. 300 steps have the paper's 7.24 h.
    assert!(markdown.contains("| GS | 0.50 | - | 0.50 | 0.50 |"), "{markdown}");
    assert!(markdown.contains("| GS | - / 7.24 |"), "{markdown}");
    // Episodes of another length have returns of another size, so they have axes of their own.
    let pictures = names(&dir.path().join("report"));
    let returns: Vec<&String> = pictures.iter().filter(|name| name.starts_with("final_return_")).collect();
    assert_eq!(returns.len(), 2, "{pictures:?}");
    let page = fs::read_to_string(dir.path().join("report/report.html")).unwrap();
    for (at, _) in page.match_indices(" id=\"") {
        let id = &page[at..at + 6 + page[at + 6..].find('"').unwrap()];
        assert_eq!(page.matches(&format!("{id}\"")).count(), 1, "{id}");
    }
}

/// Changes the scenario in the `run.json` of a fixed run.
fn set_scenario(run: &Path, change: impl Fn(&mut Value)) {
    let path = run.join("run.json");
    let mut about: Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    change(&mut about["scenario"]);
    fs::write(path, about.to_string()).unwrap();
}

#[test]
fn rewards_and_networks_that_differ_have_axes_and_tables_of_their_own() {
    let names_of = ["traffic_4-gs-seed1", "traffic_4-dials-seed1"];
    let (dir, markdown) = report_of(&names_of, |runs| {
        names_of
            .iter()
            .for_each(|run| set_scenario(&runs.join(run), |scenario| scenario["checksum"] = "2e9f05c0".into()));
        set_scenario(&runs.join(names_of[1]), |scenario| scenario["scored_by"] = "queue".into());
    });
    for rules in ["usual", "queue"] {
        let told = format!("## Costs, traffic, 4 agents, rules {rules}");
        assert!(markdown.contains(&told), "`{told}` is not in {markdown}");
    }
    assert_eq!(
        markdown.matches("Paper: figure of section Results").count(),
        1,
        "its reward is the usual one: {markdown}"
    );
    let returns = names(&dir.path().join("report")).into_iter().filter(|name| name.starts_with("final_return_"));
    assert_eq!(
        returns.collect::<Vec<_>>(),
        ["final_return_traffic_4_300_2e9f05c0.svg", "final_return_traffic_4_300_2e9f05c0_queue.svg"]
    );
}

#[test]
fn agents_that_are_not_in_rows_are_drawn_by_their_names() {
    let (dir, _) = report_of(&["traffic_4-gs-seed1"], |runs| {
        let run = runs.join("traffic_4-gs-seed1");
        set_scenario(&run, |scenario| drop(scenario.as_object_mut().unwrap().remove("map")));
        edit(&run.join("run.json"), "\"seed\":1,", r#""agents": ["market", "bridge", "mill", "gate"], "seed": 1,"#);
    });
    let svg = fs::read_to_string(dir.path().join("report/agents_traffic_4.svg")).unwrap();
    for told in ["market", "bridge", "mill", "gate", "GS (1 run)"] {
        assert!(svg.contains(&format!("\n{told}\n")), "`{told}` is not in {svg}");
    }
}

#[test]
fn a_run_that_was_evaluated_once_has_no_curves_and_no_bar_below_an_axis() {
    let change = |runs: &Path| stop_before_its_evaluation(&runs.join("traffic_4-gs-seed2"));
    let (dir, markdown) = report_of(&["traffic_4-gs-seed2"], change);
    for told in ["There are no learning curves, because every run", "There is no picture of runtimes, because no run"] {
        assert!(markdown.contains(told), "`{told}` is not in {markdown}");
    }
    let pictures = names(&dir.path().join("report")).into_iter().filter(|name| name.ends_with(".svg"));
    assert_eq!(pictures.collect::<Vec<_>>(), ["agents_traffic_4.svg", "final_return_traffic.svg"]);
}

#[test]
fn an_ablation_is_drawn_row_by_row_and_panel_by_panel_against_its_reference() {
    let settings = ["clip = 0.2", "gamma = 0.9", "epochs = 1", "entropy = 0.1", "gae_lambda = 0.9"];
    let (dir, _) = report_of(&["warehouse_4-dials-clip0.1-seed1"], |runs| {
        for setting in settings {
            let (from, to) = (runs.join("warehouse_4-dials-clip0.1-seed1"), runs.join(setting));
            fs::create_dir(&to).unwrap();
            for name in names(&from) {
                fs::copy(from.join(&name), to.join(&name)).unwrap();
            }
            let clip = if setting.starts_with("clip") { "" } else { "clip = 0.1\n" };
            edit(&to.join("config.toml"), "clip = 0.1", &format!("{clip}{setting}"));
            // The reference has 9.2, in episodes of 2.7 and 15.7.
            edit(&to.join("returns.csv"), "200064,all,9.2", "200064,all,9.7");
            edit(&to.join("episodes.csv"), ",2.700000\n", ",3.200000\n");
            edit(&to.join("episodes.csv"), ",15.700000\n", ",16.200000\n");
        }
    });
    let picture = |name: &str| fs::read_to_string(dir.path().join("report").join(name)).unwrap();
    let (rows, panels) = (picture("ablation_warehouse_4.svg"), picture("learning_warehouse_4.svg"));
    for setting in settings {
        let label = setting.replace(" = ", "=");
        assert_eq!(rows.matches(&format!("\n{label}\n")).count(), 1, "{label}: {rows}");
        assert!(panels.contains(&format!("\n{label} (1 run)\n")), "{label}");
    }
    assert_eq!((rows.matches("\n+0.50 (n = 1)\n").count(), rows.matches("\nthe reference\n").count()), (5, 1));
    assert!(panels.contains("in all panels: DIALS F=200K"));
    assert!(!dir.path().join("report/final_return_warehouse.svg").exists(), "the ablation's rows show the same");
}

#[test]
fn runs_that_are_shorter_than_the_papers_have_rows_of_their_own_among_its_runtimes() {
    let (_dir, markdown) = report_of(&["traffic_4-gs-seed2", "warehouse_4-dials-clip0.1-seed1"], |_| ());
    // The paper's row without ours, and our row: 900 s minus 3 s of evaluation, until 2M steps.
    assert!(markdown.contains("| GS | - / 7.24 |"), "{markdown}");
    assert!(markdown.contains("| GS, 2M steps, unfinished | 0.25 / - |"), "{markdown}");
    assert!(markdown.contains("| DIALS F=200K, 200K steps | 0.0144 / - |"), "{markdown}");
}

#[test]
fn what_a_kill_cut_short_is_left_out_of_a_run_and_a_hole_leaves_the_run_out() {
    let runs = ["traffic_4-dials-seed1", "traffic_4-dials-seed2"];
    let (_dir, markdown) = report_of(&runs, |runs| {
        let returns = runs.join("traffic_4-dials-seed1/returns.csv");
        let text = fs::read_to_string(&returns).unwrap();
        // The last evaluation keeps two agents of four, the second one with half a line.
        let end = text.find("4000064,1,").unwrap();
        fs::write(&returns, &text[..end + 12]).unwrap();
        let returns = runs.join("traffic_4-dials-seed2/returns.csv");
        let text = fs::read_to_string(&returns).unwrap();
        let hole: Vec<&str> = text.lines().filter(|line| !line.starts_with("2000000,3,")).collect();
        fs::write(&returns, hole.join("\n") + "\n").unwrap();
    });
    assert!(
        markdown.contains("runs/traffic_4-dials-seed1: unfinished, at 4M of 4M steps, last evaluated at 2M"),
        "{markdown}"
    );
    let told = "runs/traffic_4-dials-seed2: left out: returns.csv: has 3 of 4 agents at step 2000000";
    assert!(markdown.contains(told), "{markdown}");
}

#[test]
fn a_run_with_a_figure_that_is_no_finite_number_is_left_out_with_its_file_line_and_column() {
    let runs = ["traffic_4-dials-seed1", "traffic_4-dials-seed2", "traffic_4-dials-seed3"];
    let (_dir, markdown) = report_of(&runs, |runs| {
        // Lines 1 to 6: the header, `all` and four agents at step 0.
        edit(&runs.join("traffic_4-dials-seed1/returns.csv"), "2000000,all,200.0000", "2000000,all,NaN");
        let timing = runs.join("traffic_4-dials-seed3/timing.csv");
        let text = fs::read_to_string(&timing).unwrap();
        let (header, lines) = text.split_once('\n').unwrap();
        let column = header.split(',').position(|name| name == "elapsed_s").unwrap();
        let mut fields: Vec<&str> = lines.lines().next().unwrap().split(',').collect();
        fields[column] = "inf";
        let rest: Vec<&str> = lines.lines().skip(1).collect();
        fs::write(&timing, format!("{header}\n{}\n{}\n", fields.join(","), rest.join("\n"))).unwrap();
    });
    for told in [
        "runs/traffic_4-dials-seed1: left out: runs/traffic_4-dials-seed1/returns.csv: line 7: `mean` holds \"NaN\", which is \
         not a finite number",
        "runs/traffic_4-dials-seed3: left out: runs/traffic_4-dials-seed3/timing.csv: line 2: `elapsed_s` holds \"inf\", which \
         is not a finite number",
    ] {
        assert!(markdown.contains(told), "`{told}` is not in {markdown}");
    }
    assert!(!markdown.contains("traffic_4-dials-seed2: left out"), "{markdown}");
}

#[test]
fn runs_of_which_none_can_be_used_are_an_error_with_the_reasons_and_no_report() {
    let dir = copy_of(&["broken", "traffic_4-gs-seed1", "traffic_4-gs-seed2"]);
    let runs = dir.path().join("runs");
    edit(&runs.join("traffic_4-gs-seed1/returns.csv"), "\n0,all,140.0000", "\n0,all,NaN");
    fs::remove_file(runs.join("traffic_4-gs-seed2/returns.csv")).unwrap();
    let reasons = [
        "runs: no run in it was evaluated and can be read:\n",
        "\n  runs/broken: left out: runs/broken/config.toml:",
        "\n  runs/traffic_4-gs-seed1: left out: runs/traffic_4-gs-seed1/returns.csv: line 2: `mean` holds \"NaN",
        "\n  runs/traffic_4-gs-seed2: not evaluated yet",
    ];
    for args in [&["report", "runs", "--out", "report"][..], &["compare", "runs", "runs"]] {
        let output = dials_traffic(args).current_dir(dir.path()).assert().code(2).get_output().clone();
        let said = text(&output.stderr);
        assert!(said.starts_with("error: ") && output.stdout.is_empty(), "{said}");
        for reason in reasons {
            assert!(said.contains(reason), "`{reason}` is not in: {said}");
        }
    }
    assert_eq!(names(dir.path()), ["runs"]);
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
    // Final returns 9.2 and 9.4 against 9.7 and 9.9: both pairs differ by 0.5, in every episode.
    assert_eq!(found["paired_by"], "episode and seed");
    near(&found["difference"], 0.5);
    assert_eq!(found["interval_95"], Value::Null, "two seeds are too few");
    near(&found["differences"][1]["difference"], 0.5);
    assert_eq!(found["differing"]["ppo.clip"], serde_json::json!(["0.1", "0.2"]));
    // A is at 6 at 100K and at 9.2 at the end; B is at 6.5 at 100K.
    near(&found["a"]["reached_steps"], 200_064.0);
    near(&found["b"]["reached_steps"], 100_000.0);
    // 30 s minus an evaluation of 3 s.
    near(&found["b"]["reached_s"], 27.0);
    near(&found["runtime_ratio"], 1.0);
    // The median agent is 0.5 above the mean.
    near(&found["a"]["median_agent"], 9.8);
    assert_eq!((&found["a"]["stuck_agents"], &found["a"]["agents"]), (&0.into(), &8.into()));
}

#[test]
fn a_comparison_names_the_seeds_that_it_uses_and_counts_the_stuck_agents() {
    // The unfinished GS run with seed 2 does not count. One of the 4 agents of seed 1 is stuck.
    let found = compare(&["runs/traffic_4-gs-seed1,runs/traffic_4-gs-seed2", "runs/traffic_4-dials-seed1"]);
    assert_eq!(found["a"]["seeds"], serde_json::json!([1]));
    assert_eq!((&found["a"]["stuck_agents"], &found["a"]["agents"]), (&1.into(), &4.into()));
}

#[test]
fn a_return_to_reach_is_a_number() {
    let runs = "runs/traffic_4-gs-seed1";
    let output = dials_traffic(&["compare", runs, runs, "--reach", "nan"]).assert().code(2).get_output().clone();
    assert!(text(&output.stderr).contains("must be a finite number"), "{output:?}");
}

/// Copies a fixed run for seeds 1 to 5. `raised` is added to the final return of each copy, in all of its four
/// episodes.
fn five_seeds(runs: &Path, of: &str, name: &str, raised: [f64; 5]) {
    for (seed, raised) in (1..).zip(raised) {
        let to = runs.join(format!("{name}-seed{seed}"));
        fs::create_dir_all(&to).unwrap();
        for file in names(&home().join("runs").join(of)) {
            fs::copy(home().join("runs").join(of).join(&file), to.join(&file)).unwrap();
        }
        edit(&to.join("config.toml"), "seed = 1", &format!("seed = {seed}"));
        let raise = |file: &str, column: usize| {
            let text = fs::read_to_string(to.join(file)).unwrap();
            let line = |line: &str| {
                let mut fields: Vec<String> = line.split(',').map(str::to_owned).collect();
                if fields[0] == "4000064" {
                    fields[column] = format!("{:.6}", fields[column].parse::<f64>().unwrap() + raised);
                }
                fields.join(",")
            };
            fs::write(to.join(file), text.lines().map(line).collect::<Vec<_>>().join("\n") + "\n").unwrap();
        };
        raise("returns.csv", 2);
        raise("episodes.csv", 2);
    }
}

#[test]
fn five_seeds_on_the_same_episodes_have_an_interval_of_their_paired_differences() {
    let dir = tempfile::tempdir().unwrap();
    let runs = dir.path().join("runs");
    five_seeds(&runs, "traffic_4-gs-seed1", "gs", [0.0, 1.0, 2.0, 3.0, 4.0]);
    five_seeds(&runs, "traffic_4-dials-seed1", "dials", [1.0, 3.0, 5.0, 7.0, 9.0]);
    let side = |name: &str| format!("{}/{name}-seed*", runs.display());
    let found = compare(&[&side("gs"), &side("dials")]);
    // 200 + 0..4 against 214 + 1, 3, ..., 9: differences 15 to 19, mean 17. Standard error sqrt(2.5 / 5) = 0.70711; t
    // with 4 degrees of freedom: 2.77645.
    assert_eq!((&found["paired_by"], &found["a"]["episodes"]), (&"episode and seed".into(), &4.into()));
    near(&found["difference"], 17.0);
    near(&found["interval_95"][0], 17.0 - 2.77645 * 0.5_f64.sqrt());
    near(&found["differences"][4]["difference"], 19.0);
    assert_eq!(found["warnings"], serde_json::json!([]));
    // 1406 s minus 16 s of evaluations.
    near(&found["b"]["cpu_s"], 1390.0);

    // Seeds 1 and 2 against 3 to 5 cannot be paired by seed, and are too few for an interval.
    let found = compare(&[&format!("{}/gs-seed[12]", runs.display()), &format!("{}/gs-seed[345]", runs.display())]);
    assert_eq!((&found["paired_by"], &found["interval_95"]), (&"episode".into(), &Value::Null));
    // Means of 0.5 and 3 above 200.
    near(&found["difference"], 2.5);
    // 95 % of the lower final return, 200.5.
    near(&found["reach"], 190.475);

    // With another seed of the episodes only means can be compared, and no spread contains the randomness of the
    // traffic.
    for seed in 1..=5 {
        let config = runs.join(format!("dials-seed{seed}/config.toml"));
        let text = fs::read_to_string(&config).unwrap();
        fs::write(&config, text + "[evaluation]\nseed = 3\n").unwrap();
    }
    let found = compare(&[&side("gs"), &side("dials")]);
    assert_eq!((&found["paired_by"], &found["interval_95"]), (&"seed".into(), &Value::Null));
    near(&found["difference"], 17.0);
}

#[test]
fn returns_stand_beside_the_strongest_controller_on_the_same_episodes() {
    let (dir, markdown) = report_of(&["baselines"], |runs| {
        five_seeds(runs, "traffic_4-gs-seed1", "gs", [0.0, 1.0, 2.0, 3.0, 4.0]);
        let (actuated, weaker) = (runs.join("baselines/traffic_4-actuated.json"), runs.join("baselines/weaker.json"));
        fs::copy(&actuated, &weaker).unwrap();
        edit(&weaker, "actuated", "random");
        edit(&weaker, "170.6", "90.6");
    });
    assert!(markdown.contains("| 95 % interval or seeds | − actuated | median run |"), "{markdown}");
    // 200 to 204: mean 202, standard error 0.70711, so 1.96 to each side. The mean is 31.4 above 170.6.
    assert!(markdown.contains("| 5 | 4M | 4 | 202.0 | 95 % [200.0, 204.0] | +31.4 [+29.4, +33.4] |"), "{markdown}");
    assert!(markdown.contains("| random | - | - | 4 | 90.6 | ± 0.9 standard error over 4 episodes |"), "{markdown}");
    assert!(!markdown.contains("not evaluated on the episodes of"), "{markdown}");
    let differences = fs::read_to_string(dir.path().join("report/differences.csv")).unwrap();
    assert!(differences.contains("traffic_4,GS,actuated,episode,5,33.4000,,\n"), "{differences}");
    let svg = fs::read_to_string(dir.path().join("report/learning_traffic_4.svg")).unwrap();
    assert!(svg.contains("band: 95\u{a0}%") && !svg.contains("pale lines"), "{svg}");
}

#[test]
fn a_controller_of_one_episode_has_no_standard_error() {
    let (_dir, markdown) = report_of(&["traffic_4-gs-seed1", "baselines"], |runs| {
        let actuated = runs.join("baselines/traffic_4-actuated.json");
        edit(&actuated, "\"episodes\": 4", "\"episodes\": 1");
        edit(&actuated, "\"std_error\": 0.9129", "\"std_error\": 0.0");
        edit(&actuated, "[168.6, 169.6, 171.6, 172.6]", "[170.6]");
    });
    assert!(markdown.contains("| actuated | - | - | 1 | 170.6 | one episode |"), "{markdown}");
    assert!(!markdown.contains("standard error over"), "{markdown}");
}

#[test]
fn runs_and_controllers_on_other_episodes_are_told_and_only_their_means_subtracted() {
    let (_dir, markdown) = report_of(&["traffic_4-dials-seed1", "traffic_4-dials-seed2", "baselines"], |runs| {
        edit(&runs.join("baselines/traffic_4-actuated.json"), "\"seed\": 0", "\"seed\": 9");
    });
    assert!(markdown.contains("| +45.4 (n = 2: +43.4, +47.4, other episodes) |"), "{markdown}");
    assert!(markdown.contains("- traffic, 4 agents: not evaluated on the episodes of actuated"), "{markdown}");
    let (_dir, markdown) = report_of(&["traffic_4-dials-seed1", "traffic_4-dials-seed2"], |runs| {
        play_two_of_four(&runs.join("traffic_4-dials-seed2"));
    });
    let told = "- traffic, 4 agents, DIALS F=1M: its runs were evaluated on different episodes";
    assert!(markdown.contains(told) && markdown.contains("| 2 or 4 each |"), "{markdown}");
}

/// Takes the last two of four episodes out of the last evaluation of a fixed run.
fn play_two_of_four(run: &Path) {
    let episodes = fs::read_to_string(run.join("episodes.csv")).unwrap();
    let [.., third, fourth] = &episodes.lines().collect::<Vec<_>>()[..] else { panic!("it has four at the end") };
    edit(&run.join("episodes.csv"), &format!("{third}\n{fourth}\n"), "");
    let returns = fs::read_to_string(run.join("returns.csv")).unwrap();
    fs::write(run.join("returns.csv"), returns.replace(",4,0,", ",2,0,").replace(",4,1,", ",2,1,")).unwrap();
}

#[test]
fn of_more_of_the_same_episodes_the_first_ones_are_compared() {
    let dir = copy_of(&["traffic_4-gs-seed1", "traffic_4-dials-seed1"]);
    let gs = dir.path().join("runs/traffic_4-gs-seed1");
    play_two_of_four(&gs);
    edit(&gs.join("returns.csv"), "4000064,all,200.0000", "4000064,all,198.5000");
    let compared = |json: &[&str]| {
        let args = [&["compare", "runs/traffic_4-gs-seed1", "runs/traffic_4-dials-seed1"], json].concat();
        let assert = dials_traffic(&args).current_dir(dir.path()).assert().success();
        text(&assert.get_output().stdout)
    };
    let found: Value = serde_json::from_str(&compared(&["--json"])).unwrap();
    assert_eq!(found["paired_by"], "episode and seed");
    // 198 and 199 against 212 and 213.
    near(&found["a"]["mean_return"], 198.5);
    near(&found["b"]["mean_return"], 212.5);
    assert_eq!([&found["a"]["episodes"], &found["b"]["episodes"]], [2, 2]);
    near(&found["difference"], 14.0);
    let said = compared(&[]);
    assert!(said.contains("returns are of the first 2, which all of them have"), "{said}");
    dials_traffic(&["report", "runs", "--out", "report"]).current_dir(dir.path()).assert().success();
    let markdown = fs::read_to_string(dir.path().join("report/report.md")).unwrap();
    let told = "evaluated on more or fewer episodes than GS, so the difference is over those that both have: DIALS F=1M \
                (the first 2 episodes)";
    assert!(markdown.contains(told), "{markdown}");
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
        "n = 1 in A and 1 in B: an interval needs 5 seeds on each side",
        "4 episodes of evaluation.seed 0",
        "returns: paired by episode and by seed",
        "  seed 1                          200.0            214.0  +14.0\n",
    ] {
        assert!(said.contains(told), "`{told}` is not in: {said}");
    }
    let widest = said.lines().map(|line| line.chars().count()).max().unwrap();
    assert!(widest <= 80, "a line has {widest} characters: {said}");
}

#[test]
fn sides_are_compared_where_both_were_evaluated_and_nothing_is_interpolated() {
    let dir = copy_of(&["traffic_4-gs-seed1", "traffic_4-dials-seed1"]);
    let dials = dir.path().join("runs/traffic_4-dials-seed1");
    // It ended between two evaluations of the other one, which has 190 at 2M and 200 at 4M.
    edit(&dials.join("config.toml"), "seed = 1", "seed = 1\nstop_at_steps = 3000000");
    ["returns.csv", "episodes.csv"].iter().for_each(|file| edit(&dials.join(file), "4000064,", "3000000,"));
    let sides = ["gs", "dials"].map(|simulator| format!("{}/runs/traffic_4-{simulator}-seed1", dir.path().display()));
    let found = compare(&[&sides[0], &sides[1]]);
    assert_eq!((&found["steps"], &found["b"]["steps"]), (&2_000_000.into(), &2_000_000.into()));
    near(&found["a"]["mean_return"], 190.0);
    near(&found["b"]["mean_return"], 200.0);
    let told = "A ends at step 4M and B at step 3M: compared at step 2M, the last one at which all runs of both were \
                evaluated";
    assert!(found["warnings"].as_array().unwrap().contains(&told.into()), "{found}");
}

#[test]
fn sides_that_cannot_be_compared_are_refused() {
    for (a, b, told) in [
        ("runs/warehouse_4-dials-clip0.1-seed1", "runs/traffic_4-gs-seed1", "different scenarios"),
        ("runs", "runs/traffic_4-gs-seed1", "holds runs of 4 methods, but a side must have only one"),
        ("runs/nothing*", "runs/traffic_4-gs-seed1", "runs/nothing*: no folder matches this pattern"),
        ("runs/traffic_4-gs-seed{1,2}", "runs/traffic_4-gs-seed1", "braces are no pattern here: use *, ? and [ab]"),
        ("runs/broken", "runs/traffic_4-gs-seed1", "no run in it was evaluated"),
    ] {
        let output = dials_traffic(&["compare", a, b]).assert().code(2).get_output().clone();
        let said = text(&output.stderr);
        assert!(said.starts_with("error: ") && said.contains(told), "{said}");
    }
}

#[test]
fn a_pattern_leaves_out_what_was_moved_aside_unless_it_says_so() {
    let dir = copy_of(&["traffic_4-gs-seed1"]);
    let runs = dir.path().join("runs");
    let aside = runs.join("traffic_4-gs-seed1.old-1");
    fs::rename(runs.join("traffic_4-gs-seed1"), &aside).unwrap();
    let side = |pattern: &str| runs.join(pattern).to_str().unwrap().to_owned();
    let refused = dials_traffic(&["compare", &side("traffic_4-gs*"), "runs/traffic_4-dials-seed1"]).assert().code(2);
    assert!(text(&refused.get_output().stderr).contains("no folder matches this pattern"));
    near(&compare(&[&side("traffic_4-gs*.old-*"), "runs/traffic_4-dials-seed1"])["difference"], 14.0);
}

#[test]
fn a_folder_with_letters_of_patterns_in_its_name_is_taken_as_it_is() {
    let dir = copy_of(&["traffic_4-gs-seed1"]);
    let runs = dir.path().join("runs");
    let strange = runs.join("traffic.reward={queue=0.5,wait=0.5}-[a]*");
    fs::rename(runs.join("traffic_4-gs-seed1"), &strange).unwrap();
    let found = compare(&[strange.to_str().unwrap(), "runs/traffic_4-dials-seed1"]);
    near(&found["difference"], 14.0);
}

#[test]
fn a_run_of_a_third_domain_is_reported_as_what_it_is() {
    let dir = copy_of(&["warehouse_4-dials-clip0.1-seed1", "warehouse_4-dials-clip0.2-seed1"]);
    let runs = dir.path().join("runs");
    let ants = runs.join("hill");
    fs::rename(runs.join("warehouse_4-dials-clip0.1-seed1"), &ants).unwrap();
    // Its domain did not come from a config, so the config has no table of it.
    edit(&ants.join("config.toml"), "[warehouse]\nagents_per_side = 2\n", "");
    set_scenario(&ants, |scenario| {
        *scenario = serde_json::json!({
            "domain": "ants", "agents": 4, "episode": { "length": 50, "unit": "days" },
            "map": { "rows": 1, "columns": 4, "first_row": "top" },
        });
    });
    dials_traffic(&["report", "runs", "--out", "report"]).current_dir(dir.path()).assert().success();
    let markdown = fs::read_to_string(dir.path().join("report/report.md")).unwrap();
    for told in ["2 runs in 2 groups; ants, 4 agents; warehouse, 4 agents.", "## Ants, 4 agents", "## All sizes, ants"]
    {
        assert!(markdown.contains(told), "`{told}` is not in {markdown}");
    }
    assert!(markdown.contains("| hill |") || markdown.contains("runs/hill | ants, 4 agents |"), "{markdown}");
    let curve = fs::read_to_string(dir.path().join("report/learning_ants_4.svg")).unwrap();
    assert!(curve.contains("mean return of an agent, 50 days"), "{curve}");
    assert!(!curve.contains("the paper"), "the paper has no ants");
    let output = dials_traffic(&["compare", "runs/hill", "runs/warehouse_4-dials-clip0.2-seed1"])
        .current_dir(dir.path())
        .assert()
        .code(2)
        .get_output()
        .clone();
    let told =
        "is ants-4-50 and runs/warehouse_4-dials-clip0.2-seed1 is warehouse-4-100: returns of different scenarios";
    assert!(text(&output.stderr).contains(told), "{output:?}");
}
