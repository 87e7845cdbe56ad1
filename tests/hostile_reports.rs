//! Run directories, plans and experiments that somebody else made: nothing in them acts on the terminal, in a page or in
//! a spreadsheet, and nothing stops a report or keeps it from ending.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::Duration;

use assert_cmd::Command;
use dials_core::outside::is_printable;

/// Time after which a command is killed. It is no measure of speed: none of these needs more than a few seconds.
const DEADLINE: Duration = Duration::from_secs(60);

fn fixed_runs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/report/runs")
}

/// A folder with `runs`, in which commands are called.
struct Place {
    dir: tempfile::TempDir,
}

impl Place {
    fn new() -> Place {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join("runs")).unwrap();
        Place { dir }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    /// Copies a fixed run to `runs/name` and returns its path.
    fn run(&self, of: &str, name: &str) -> PathBuf {
        let to = self.path("runs").join(name);
        fs::create_dir_all(&to).unwrap();
        for entry in fs::read_dir(fixed_runs().join(of)).unwrap() {
            let entry = entry.unwrap();
            fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
        }
        to
    }

    fn call(&self, arguments: &[&str]) -> Output {
        let mut command: Command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
        command.current_dir(self.dir.path()).args(arguments).timeout(DEADLINE).output().unwrap()
    }

    /// Makes a report, and returns what it says on standard error.
    fn report(&self) -> String {
        let output = self.call(&["report", "runs", "--out", "report", "--force"]);
        let said = text(&output.stderr);
        assert!(output.status.success(), "{said}");
        // A long line is broken for the terminal, and goes on further to the right.
        said.replace("\n  ", " ")
    }

    /// Returns the names and contents of the report's files.
    fn files(&self) -> Vec<(String, String)> {
        let entries = fs::read_dir(self.path("report")).unwrap().map(|entry| entry.unwrap());
        let file =
            |entry: fs::DirEntry| (entry.file_name().into_string().unwrap(), fs::read_to_string(entry.path()).unwrap());
        entries.map(file).collect()
    }

    fn file(&self, name: &str) -> String {
        fs::read_to_string(self.path("report").join(name)).unwrap()
    }
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn edit(path: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "{from}");
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

fn assert_printable(what: &str, text: &str) {
    let bad = text.lines().find(|line| !line.chars().all(is_printable));
    assert!(bad.is_none(), "{what}: {bad:?}");
}

fn pipe(path: &Path) {
    rustix::fs::mknodat(rustix::fs::CWD, path, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
}

fn sparse(path: &Path, length: u64) {
    fs::File::create(path).unwrap().set_len(length).unwrap();
}

/// A name with everything that acts somewhere: on a terminal, in XML, in HTML, in Markdown and in a spreadsheet.
const NAME: &str = "=cmd()\u{1b}]0;owned\u{7}\u{202E}<script>|`[x](y)`\nwarning: two lines\u{9b}31m\u{ffff}";

/// Returns a plan of one experiment.
fn plan_of(experiment: &str) -> String {
    format!("{{ \"experiments\": {{ \"e.toml\": {experiment} }} }}")
}

/// Makes runs whose names, scenario, command and controllers are [`NAME`]. Two of them are broken.
fn hostile() -> Place {
    let place = Place::new();
    let run = place.run("traffic_4-dials-seed1", NAME);
    let about = serde_json::json!({
        "command": ["x", "train", NAME, "; rm -rf ~", "```\n# owned"],
        "seed": 1,
        "versions": { "git_commit": NAME },
        "scenario": {
            "domain": "traffic", "agents": 4, "episode": { "length": 300, "unit": "steps" }, "files": { NAME: NAME },
        },
    });
    fs::write(run.join("run.json"), about.to_string()).unwrap();
    let other = place.run("traffic_4-dials-seed2", "other");
    fs::write(other.join("run.json"), about.to_string().replace("=cmd()", "+cmd()")).unwrap();
    let broken = place.run("traffic_4-gs-seed1", &format!("broken {NAME}"));
    edit(&broken.join("returns.csv"), "140.0000", "\u{1b}[31m\u{7}");
    let unknown = place.run("traffic_4-gs-seed1", &format!("unknown {NAME}"));
    edit(&unknown.join("config.toml"), "simulator = \"gs\"", "simulator = \"\u{202E}|<script>\"");
    let baselines = place.path("runs/baselines");
    fs::create_dir(&baselines).unwrap();
    let controller = serde_json::json!({
        "scenario": "traffic-4-300", "controller": NAME, "mean_return": 170.5, "std_error": 0.5, "episodes": 4,
        "seed": 0, "episode_returns": [170.0, 171.0, 170.0, 171.0],
    });
    fs::write(baselines.join("a.json"), controller.to_string()).unwrap();
    fs::write(baselines.join(format!("{NAME}.json")), "{").unwrap();
    fs::write(
        place.path("runs/plan.json"),
        plan_of(&serde_json::json!({ "runs": [NAME], "baselines": [] }).to_string()),
    )
    .unwrap();
    place
}

#[test]
fn no_name_acts_on_the_terminal_or_in_the_files_of_a_report() {
    let place = hostile();
    let said = place.report();
    assert_printable("standard error", &said);
    assert!(said.contains("=cmd()\\u{1b}]0;owned\\u{7}\\u{202e}<script>|`[x](y)`\\nwarning: two lines"), "{said}");
    assert!(said.lines().all(|line| line.starts_with("warning: ") && !line.starts_with("warning: two")), "{said}");
    let files = place.files();
    assert!(files.len() > 12, "{:?}", files.iter().map(|(name, _)| name).collect::<Vec<_>>());
    for (name, content) in &files {
        assert_printable(name, content);
        if name.ends_with(".svg") {
            roxmltree::Document::parse(content).unwrap_or_else(|error| panic!("{name}: {error}"));
        }
    }
    let drawn = place.file("learning_traffic_4.svg");
    assert!(drawn.contains("=cmd()\\u{1b}]0;owned\\u{7}"), "the name is in the picture: {drawn}");
}

#[test]
fn no_name_is_markup_in_the_pages_of_a_report() {
    let place = hostile();
    place.report();
    let page = place.file("report.html");
    let options = roxmltree::ParsingOptions { allow_dtd: true, ..Default::default() };
    let tree = roxmltree::Document::parse_with_options(&page, options).unwrap();
    assert!(tree.descendants().all(|node| !node.has_tag_name("script")), "{page}");
    assert!(page.contains("&lt;script&gt;"), "{page}");
    let markdown = place.file("report.md");
    // Between fences nothing is markup, and the fence is longer than any in a command.
    let (page, commands) = markdown.split_once("\n````sh\n").unwrap();
    assert!(commands.ends_with("\n````\n") && commands.matches("````").count() == 1, "{commands}");
    assert!(!page.contains("<script") && page.contains("&lt;script>"), "{page}");
    assert_eq!(page.matches("](y)").count(), page.matches("\\](y)").count(), "{page}");
    assert!(!markdown.lines().any(|line| line.starts_with("warning") || line == "# owned"), "{markdown}");
    // A name with `|` makes no cell more.
    for table in markdown.split("\n\n").filter(|block| block.starts_with("| ")) {
        let cells = |row: &str| row.replace("\\\\", "").replace("\\|", "").matches('|').count();
        let widths: Vec<usize> = table.lines().map(cells).collect();
        assert!(widths.iter().all(|width| *width == widths[0]), "{table}");
    }
    // The commands of the report are one word for each word of run.json.
    assert!(markdown.contains(r"'; rm -rf ~' $'```\012# owned'"), "{markdown}");
}

#[test]
fn no_name_is_a_formula_in_a_spreadsheet_and_numbers_stay_numbers() {
    let place = hostile();
    // A number below zero is no formula.
    edit(&place.path("runs/other/returns.csv"), "4000064,all,218.0000", "4000064,all,-218.0000");
    place.report();
    let (mut names, mut below_zero) = (0, 0);
    for (name, content) in place.files().iter().filter(|(name, _)| name.ends_with(".csv")) {
        for record in csv::Reader::from_reader(content.as_bytes()).records() {
            for field in &record.unwrap() {
                assert!(!field.starts_with(['=', '+', '@', '\t', '\r']), "{name}: {field}");
                if field.starts_with('-') {
                    below_zero += 1;
                    field.parse::<f64>().unwrap_or_else(|_| panic!("{name}: {field}"));
                }
                names += usize::from(field.starts_with("'=cmd()\\u{1b}"));
            }
        }
    }
    assert!(names > 0 && below_zero > 0, "{names} names, {below_zero} numbers");
}

#[test]
fn an_error_and_a_comparison_hold_no_control_characters_either() {
    let place = hostile();
    let run = format!("runs/{NAME}");
    for arguments in [
        &["compare", &run, "runs/other"][..],
        &["compare", &run, "runs/other", "--json"],
        &["compare", "runs", "runs"],
        &["report", &format!("no/such/{NAME}"), "--out", "never"],
        &["report", &format!("runs/broken {NAME}"), "--out", "never"],
        &["evaluate", &format!("runs/{NAME}")],
        &["train", NAME],
        &["experiment", NAME],
    ] {
        let output = place.call(arguments);
        let (found, said) = (text(&output.stdout), text(&output.stderr));
        assert_printable("standard output", &found);
        assert_printable("standard error", &said);
        assert!(!(found + &said).is_empty(), "{arguments:?}");
        if arguments.contains(&"--json") {
            let found: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
            assert_eq!(found["a"]["name"], serde_json::json!(run), "JSON keeps the name");
        }
    }
}

#[test]
fn a_plan_that_cannot_be_read_is_told_and_the_runs_are_reported() {
    let place = Place::new();
    place.run("traffic_4-gs-seed1", "gs");
    let plan = place.path("runs/plan.json");
    let deep = format!("{{ \"x\": {}", "[".repeat(1 << 20));
    let [number, mixed, outside] =
        [r#"{ "runs": 7 }"#, r#"{ "runs": ["a", 1] }"#, r#"{ "runs": ["../../../etc"] }"#].map(plan_of);
    let written = |content: &str| fs::write(&plan, content).unwrap();
    let kinds: [(&dyn Fn(), &str); 9] = [
        (&|| written("{"), "is not a file of this program"),
        (&|| written(&number), "invalid type: integer `7`"),
        (&|| written(&mixed), "invalid type: integer `1`"),
        (&|| written(&deep), "EOF while parsing a list"),
        (&|| written(&outside), "`../../../etc` cannot be the name of a file or a directory"),
        (&|| fs::write(&plan, [0xff, 0xfe]).unwrap(), "it is not UTF-8 text from byte 0 on"),
        (&|| sparse(&plan, 1 << 40), "it has more than 16777216 bytes, the limit"),
        (&|| fs::create_dir(&plan).unwrap(), "it is not a regular file"),
        (&|| pipe(&plan), "it is not a regular file"),
    ];
    for (make, told) in kinds {
        if plan.is_dir() {
            fs::remove_dir(&plan).unwrap()
        } else {
            drop(fs::remove_file(&plan))
        }
        make();
        let said = place.report();
        let line = said.lines().find(|line| line.starts_with("warning: runs/plan.json: left out: ")).unwrap_or(&said);
        assert!(line.contains(told), "{line}");
        let page = place.file("report.md");
        assert!(page.contains("runs/plan.json: left out: ") && page.contains("1 run in 1 group"), "{page}");
    }
}

#[test]
fn a_link_that_leads_back_into_its_folder_adds_nothing() {
    let place = Place::new();
    place.run("traffic_4-gs-seed1", "gs");
    let runs = place.path("runs");
    fs::create_dir(runs.join("baselines")).unwrap();
    fs::write(runs.join("baselines/broken.json"), "{").unwrap();
    fs::write(runs.join("plan.json"), plan_of(r#"{ "runs": ["gs", "not-there"], "baselines": ["nor-this"] }"#))
        .unwrap();
    let warnings = || -> Vec<String> {
        place.report().lines().filter(|line| line.starts_with("warning: ")).map(str::to_owned).collect()
    };
    let before = warnings();
    assert_eq!(before.len(), 3, "two are missing and one is broken: {before:?}");
    for (link, target) in [("loop", "."), ("up", ".."), ("again", "../runs")] {
        std::os::unix::fs::symlink(target, runs.join(link)).unwrap();
    }
    assert_eq!(warnings(), before);
}

/// Changes one run of two, and asserts that the report tells `told` of it and shows the other.
fn assert_left_out(change: impl Fn(&Path), told: &str) {
    let place = Place::new();
    place.run("traffic_4-dials-seed1", "good");
    change(&place.run("traffic_4-dials-seed2", "bad"));
    let said = place.report();
    let line = said.lines().find(|line| line.starts_with("warning: runs/bad: left out: ")).unwrap_or(&said);
    assert!(line.contains(told), "{told}: {line}");
    let page = place.file("report.md");
    assert!(page.contains("runs/bad: left out: ") && page.contains("1 run in 1 group"), "{page}");
}

#[test]
fn a_run_with_a_damaged_file_is_told_and_the_others_are_reported() {
    let finite = "which is not a finite number";
    assert_left_out(|run| edit(&run.join("returns.csv"), "2000000,all,204.0000", "2000000,all,inf"), finite);
    assert_left_out(
        |run| {
            fs::write(
                run.join("aip_drift.csv"),
                "steps,agent,source,after,loss,marginals\n0,all,all,evaluation,-inf,1\n",
            )
            .unwrap();
        },
        "aip_drift.csv: line 2: `loss` holds \"-inf\", which is not a finite number",
    );
    assert_left_out(|run| edit(&run.join("returns.csv"), "2000000,all,204.0000", "2000000,all,1e308"), "too large");
    let returns = |run: &Path| run.join("returns.csv");
    assert_left_out(|run| edit(&returns(run), "2000000,all,", "1,all,"), "`steps` holds");
    assert_left_out(|run| edit(&returns(run), "4000064,all,", "3,all,"), "which is not later than 2000000 before it");
    assert_left_out(|run| fs::write(returns(run), b"\x00\x01\xff\xfe\n").unwrap(), "it is not UTF-8 text");
    assert_left_out(|run| fs::write(returns(run), "9".repeat(1 << 20) + "\n").unwrap(), "has more than 65536 bytes");
    assert_left_out(|run| sparse(&returns(run), 1 << 40), "it has more than 268435456 bytes, the limit");
    assert_left_out(|run| sparse(&run.join("run.json"), 1 << 40), "run.json: cannot be read: it has more than");
    assert_left_out(|run| sparse(&run.join("config.toml"), 1 << 40), "config.toml: cannot be read: it has more than");
    for name in ["returns.csv", "episodes.csv", "timing.csv", "memory.csv", "run.json"] {
        let replaced = |run: &Path, make: &dyn Fn(&Path)| {
            drop(fs::remove_file(run.join(name)));
            make(&run.join(name));
        };
        let told = format!("{name}: cannot be read: it is not a regular file");
        assert_left_out(|run| replaced(run, &pipe), &told);
        assert_left_out(|run| replaced(run, &|path| fs::create_dir(path).unwrap()), &told);
    }
}

/// A change to a run directory.
type Change<'a> = &'a dyn Fn(&Path);

/// Gives a run a network, and in `run.json` the domain's keys and the checksum of that network.
fn keep_domain(run: &Path) {
    let table = serde_json::json!({
        "network": "", "local_network": "", "d_set": "cells+arrivals", "entry": "max", "initial_switch_bias": -1.5,
    });
    // The CRC-32 of "a".
    let kept = serde_json::json!({ "config": { "traffic": table }, "networks": { "global.net.xml": "e8b7be43" } });
    let mut about: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(run.join("run.json")).unwrap()).unwrap();
    about["kept"] = kept;
    fs::write(run.join("run.json"), about.to_string()).unwrap();
    fs::create_dir(run.join("networks")).unwrap();
    fs::write(run.join("networks/global.net.xml"), "a").unwrap();
}

#[test]
fn a_run_whose_domain_was_changed_after_training_is_told_and_not_compared() {
    let key = |run: &Path| edit(&run.join("config.toml"), "entry = \"max\"", "entry = \"max\"\nhorizon = 50");
    let network = |run: &Path| fs::write(run.join("networks/global.net.xml"), "b").unwrap();
    let changes: [(Change, &str); 2] = [
        (
            &key,
            "run.json: was written with other settings or networks than this run directory has now: traffic.horizon: \
                300 there, 50 here put them back",
        ),
        (&network, "networks/global.net.xml: \"e8b7be43\" there, \"71beeff9\" here put them back"),
    ];
    for (change, told) in changes {
        assert_left_out(
            |run| {
                keep_domain(run);
                change(run);
            },
            told,
        );
        let place = Place::new();
        place.run("traffic_4-gs-seed1", "good");
        let run = place.run("traffic_4-dials-seed1", "bad");
        keep_domain(&run);
        assert!(place.call(&["compare", "runs/good", "runs/bad"]).status.success());
        change(&run);
        let output = place.call(&["compare", "runs/good", "runs/bad"]);
        let said = text(&output.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains(told), "{said}");
    }
}

#[test]
fn a_run_with_allowed_changes_or_without_its_networks_is_reported() {
    let allowed = "seed = 1\nstop_at_steps = 3000000\nevaluation = { every_steps = 500000, episodes = 7 }";
    let changes: [Change; 3] = [
        &|run| edit(&run.join("config.toml"), "seed = 1", allowed),
        &|run| fs::remove_dir_all(run.join("networks")).unwrap(),
        &|run| fs::write(run.join("networks/notes.txt"), "mine").unwrap(),
    ];
    for change in changes {
        let place = Place::new();
        let run = place.run("traffic_4-dials-seed1", "a");
        keep_domain(&run);
        change(&run);
        let said = place.report();
        assert!(!said.contains("left out"), "{said}");
        assert!(place.file("report.md").contains("1 run in 1 group"));
    }
}

#[test]
fn figures_at_the_limits_are_drawn() {
    for figure in ["1e15", "-1e15", "5e-324", "-0.0", "0"] {
        let place = Place::new();
        for seed in 1..=3 {
            let run = place.run(&format!("traffic_4-dials-seed{seed}"), &seed.to_string());
            for (name, columns) in
                [("returns.csv", 2..5), ("aip_loss.csv", 3..8), ("timing.csv", 2..13), ("memory.csv", 2..4)]
            {
                let text = fs::read_to_string(run.join(name)).unwrap();
                let (header, lines) = text.split_once('\n').unwrap();
                let line = |line: &str| {
                    let fields = line.split(',').enumerate();
                    let field = |(index, field)| if columns.contains(&index) { figure } else { field };
                    fields.map(field).collect::<Vec<_>>().join(",")
                };
                let lines: Vec<String> = lines.lines().map(line).collect();
                fs::write(run.join(name), format!("{header}\n{}\n", lines.join("\n"))).unwrap();
            }
        }
        place.report();
        for (name, content) in place.files().iter().filter(|(name, _)| name.ends_with(".svg")) {
            roxmltree::Document::parse(content).unwrap_or_else(|error| panic!("{figure}: {name}: {error}"));
        }
    }
}

#[test]
fn many_short_evaluations_are_read_in_time_that_grows_as_they_do() {
    let place = Place::new();
    let run = place.run("traffic_4-gs-seed1", "gs");
    edit(&run.join("run.json"), "\"agents\": 4", "\"agents\": 1");
    let mut returns = "steps,agent,mean,median,std_error,episodes\n".to_owned();
    let mut timing = "steps,worker,elapsed_s,cpu_s,cpu_evaluation_s\n".to_owned();
    // With a search from the beginning for each, this would take hours.
    for step in 0..100_000 {
        returns += &format!("{step},all,1,1,0,0\n{step},0,1,1,0,0\n");
        timing += &format!("{step},all,{step},1,0\n");
    }
    fs::write(run.join("returns.csv"), returns).unwrap();
    fs::write(run.join("timing.csv"), timing).unwrap();
    fs::remove_file(run.join("episodes.csv")).unwrap();
    place.report();
    assert_eq!(place.file("curves.csv").lines().count(), 100_001);
}

#[test]
fn the_names_of_an_experiment_stay_in_its_folder() {
    let place = Place::new();
    fs::write(place.path("small.toml"), "[warehouse]\nagents_per_side = 1\n").unwrap();
    for name in ["/../../../X", "..", ".", "-rf", "a/b", "\u{1b}[31m", "a\nb"] {
        let name = serde_json::json!(name);
        let file = format!("seeds = [1]\n[[grid]]\nconfigs = ['small.toml']\nname = {name}\n");
        fs::write(place.path("e.toml"), file).unwrap();
        let output = place.call(&["experiment", "e.toml", "--out", "out/runs"]);
        let said = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{said}");
        assert!(said.contains("e.toml") && said.contains("cannot be the name of a file or a directory"), "{said}");
        assert_printable("standard error", &said);
        assert!(!place.path("out").exists() && !place.path("X").exists(), "{name}");
    }
    for (make, told) in [
        (&(|path: &Path| sparse(path, 1 << 40)) as &dyn Fn(&Path), "it has more than 1048576 bytes, the limit"),
        (&|path: &Path| pipe(path), "it is not a regular file"),
    ] {
        for (argument, path) in [("experiment", "e.toml"), ("train", "c.toml")] {
            drop(fs::remove_file(place.path(path)));
            make(&place.path(path));
            let output = place.call(&[argument, path]);
            let said = text(&output.stderr);
            assert!(output.status.code() == Some(2) && said.contains(told), "{said}");
        }
    }
}
