//! What README and docs/ say about the program is true.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use assert_cmd::cargo::CommandCargoExt;
use clap::Parser;
use dials_cli::cli::{self, Cli};
use dials_session::experiment::file::ExperimentFile;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    fs::read_to_string(root().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Returns the text of all files under a folder.
fn texts(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| if path.is_dir() { texts(&path) } else { vec![fs::read_to_string(path).unwrap()] })
        .collect()
}

/// Returns the pages that people write, relative to the root.
fn pages() -> Vec<String> {
    let mut pages = vec!["README.md".to_owned(), "CHANGELOG.md".to_owned()];
    for folder in ["configs", "docs", "docs/findings", "experiments", "models", "results", "sumo_nets"] {
        let files = fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().file_name());
        let files = files.map(|name| format!("{folder}/{}", name.to_str().unwrap()));
        pages.extend(files.filter(|path| path.ends_with(".md")));
    }
    pages
}

/// Returns the text under a heading, up to the next heading of any level.
fn section<'a>(page: &'a str, heading: &str) -> &'a str {
    let (_, rest) = page.split_once(&format!("\n{heading}\n")).unwrap_or_else(|| panic!("no heading: {heading}"));
    rest.split("\n#").next().unwrap()
}

/// Returns the words in backticks.
fn code_words(text: &str) -> Vec<&str> {
    text.split('`').skip(1).step_by(2).collect()
}

/// Returns the words in backticks in the first column of all tables of a text.
fn first_column(text: &str) -> BTreeSet<String> {
    let rows = text.lines().filter_map(|line| line.strip_prefix("| ")?.split(" |").next());
    rows.flat_map(code_words).map(str::to_owned).collect()
}

/// Returns the number at the beginning of a text, if `after` follows it.
fn number_before(text: &str, after: &str) -> Option<u32> {
    text.split_once(after)?.0.parse().ok()
}

#[test]
fn every_departure_of_the_docs_is_marked_in_the_code_and_no_other() {
    let paper = read("docs/paper.md");
    let list = section(&paper, "## Departures from the paper");
    let listed: Vec<u32> = list.lines().filter_map(|line| number_before(line, ". ")).collect();
    assert_eq!(listed, (1..=listed.len() as u32).collect::<Vec<_>>(), "they are numbered one by one");

    let code = ["src", "crates"].map(|folder| texts(&root().join(folder)).concat()).concat();
    let marks = code.split("DEVIATION").skip(1);
    let marked: BTreeSet<u32> = marks
        .map(|mark| {
            let number = mark.strip_prefix(' ').and_then(|rest| number_before(rest, ":"));
            number.unwrap_or_else(|| {
                panic!("a mark without its number: DEVIATION{}", mark.chars().take(60).collect::<String>())
            })
        })
        .collect();
    assert_eq!(marked, listed.into_iter().collect());
}

#[test]
fn the_readme_has_at_most_900_words() {
    let words = read("README.md").split_whitespace().count();
    assert!(words <= 900, "{words} words");
}

/// Largest size of a picture of the README. Whoever opens the page loads all of them.
const MOST_BYTES: u64 = 1_500_000;

#[test]
fn the_readme_has_a_map_and_a_film_and_its_pictures_are_small() {
    let pictures: Vec<PathBuf> = linked("README.md")
        .into_iter()
        .filter(|path| path.extension().is_some_and(|end| end == "svg" || end == "gif"))
        .collect();
    for picture in ["docs/pictures/grid_5x5.svg", "docs/pictures/grid_2x2.gif"] {
        assert!(pictures.contains(&PathBuf::from(picture)), "README.md does not show {picture}");
    }
    for picture in pictures {
        let bytes = fs::metadata(root().join(&picture)).unwrap().len();
        assert!((1..=MOST_BYTES).contains(&bytes), "{}: {bytes} bytes", picture.display());
    }
    let film = fs::File::open(root().join("docs/pictures/grid_2x2.gif")).unwrap();
    let mut film = gif::DecodeOptions::new().read_info(film).unwrap();
    assert_eq!((film.width(), film.height()), (800, 880), "with captions above and below");
    let mut frames = 0;
    while film.read_next_frame().unwrap().is_some() {
        frames += 1;
    }
    assert_eq!(frames, 90, "one for each second");
}

#[test]
fn the_readmes_test_command_is_the_one_that_is_checked() {
    for page in ["README.md", ".ci/run"] {
        let found = read(page).lines().any(|line| line == "./setup.sh all && cargo test --all-features");
        assert!(found, "{page}");
    }
}

/// Returns the GitHub anchor of a heading: lower case, hyphens for spaces, no other punctuation.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|&c| c.is_alphanumeric() || c == ' ' || c == '-' || c == '_');
    kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>().to_lowercase()
}

fn anchors(page: &str) -> BTreeSet<String> {
    let headings = page.lines().filter(|line| line.starts_with('#'));
    headings.map(|line| anchor(line.trim_start_matches('#').trim())).collect()
}

#[test]
fn every_relative_link_leads_somewhere() {
    for page in pages() {
        let text = read(&page);
        let folder = root().join(&page).parent().unwrap().to_owned();
        for link in text.split("](").skip(1).map(|rest| rest.split(')').next().unwrap()) {
            if link.contains("://") {
                continue;
            }
            let (path, anchor) = link.split_once('#').map_or((link, None), |(path, anchor)| (path, Some(anchor)));
            let target = if path.is_empty() { root().join(&page) } else { folder.join(path) };
            assert!(target.exists(), "{page}: {link} leads nowhere");
            if let Some(anchor) = anchor {
                let there = anchors(&fs::read_to_string(&target).unwrap());
                assert!(there.contains(anchor), "{page}: {link} has no such heading");
            }
        }
    }
}

#[test]
fn the_index_names_every_page_of_the_book() {
    let index = read("docs/README.md");
    let others = |page: &&str| !["README.md", "SUMMARY.md"].contains(page);
    for page in pages().iter().filter_map(|page| page.strip_prefix("docs/")).filter(others) {
        assert!(index.contains(&format!("]({page})")), "docs/README.md does not name {page}");
    }
}

/// Returns what the links of a page lead to, without anchors, relative to the root.
fn linked(page: &str) -> Vec<PathBuf> {
    let text = read(page);
    let links = text.split("](").skip(1).map(|rest| rest.split([')', '#']).next().unwrap());
    let files = links.filter(|link| !link.is_empty() && !link.contains("://"));
    let mut paths = Vec::new();
    for link in files {
        let mut path = Path::new(page).parent().unwrap().to_owned();
        for part in Path::new(link) {
            if part == ".." {
                path.pop();
            } else {
                path.push(part);
            }
        }
        paths.push(path);
    }
    paths
}

#[test]
fn the_book_has_every_page_once_and_no_link_out_of_it() {
    let listed = linked("docs/SUMMARY.md");
    let book: BTreeSet<&PathBuf> = listed.iter().collect();
    assert_eq!(book.len(), listed.len(), "a page stands twice in docs/SUMMARY.md");
    for page in pages().iter().filter(|page| *page != "docs/SUMMARY.md") {
        assert!(book.contains(&PathBuf::from(page)), "docs/SUMMARY.md does not name {page}");
    }
    for page in &listed {
        for file in linked(page.to_str().unwrap()) {
            assert!(root().join(&file).is_file(), "{}: {} is not there", page.display(), file.display());
            let is_page = file.extension().is_some_and(|ending| ending == "md");
            assert!(!is_page || book.contains(&file), "{}: {} is not in the book", page.display(), file.display());
        }
    }
}

/// Returns the files under a folder of results, but for what a user has made there: runs, and pages that git ignores.
fn kept(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries
        .flat_map(|path| match path.is_dir() {
            true if path.ends_with("runs") => vec![],
            true => kept(&path),
            false if path.ends_with("report.html") => vec![],
            false => vec![path],
        })
        .collect()
}

/// The names of what stands in a folder, without their endings.
fn stems(folder: &str) -> BTreeSet<String> {
    let paths = fs::read_dir(root().join(folder)).unwrap().map(|entry| entry.unwrap().path());
    paths.map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned()).collect()
}

#[test]
fn what_is_kept_of_results_is_small_is_in_the_book_and_can_be_made_again() {
    let files = kept(&root().join("results"));
    let bytes: u64 = files.iter().map(|file| fs::metadata(file).unwrap().len()).sum();
    assert!(files.len() <= 150 && bytes <= 5_000_000, "{} files, {bytes} bytes", files.len());

    let book = linked("docs/SUMMARY.md");
    for report in files.iter().filter(|file| file.extension().is_some_and(|ending| ending == "md")) {
        let report = report.strip_prefix(root()).unwrap();
        assert!(book.iter().any(|page| page == report), "docs/SUMMARY.md does not name {}", report.display());
    }

    let experiments = stems("experiments");
    assert!(experiments.len() <= 12, "{experiments:?}");
    let folders: BTreeSet<String> = files.iter().filter_map(|file| experiment_of(file)).collect();
    assert!(folders.is_subset(&experiments), "no file in experiments/ makes {:?}", folders.difference(&experiments));
    let table = read("experiments/README.md");
    for name in experiments.iter().filter(|name| *name != "README") {
        assert!(first_column(&table).contains(&format!("{name}.toml")), "experiments/README.md does not name {name}");
    }
}

/// Returns the experiment to whose folder a file of results belongs.
fn experiment_of(file: &Path) -> Option<String> {
    let mut parts = file.strip_prefix(root().join("results")).unwrap().components();
    let folder = parts.next()?.as_os_str().to_str()?.to_owned();
    parts.next().map(|_| folder)
}

#[test]
fn a_page_of_findings_and_the_changelog_have_at_most_60_lines() {
    for page in pages().iter().filter(|page| page.starts_with("docs/findings/") || *page == "CHANGELOG.md") {
        let lines = read(page).lines().count();
        assert!(lines <= 60, "{page}: {lines} lines");
    }
}

/// Returns a term without what does not count in an alphabet.
fn sorted_as(term: &str) -> String {
    term.chars().filter(char::is_ascii_alphanumeric).collect::<String>().to_lowercase()
}

#[test]
fn the_glossary_is_in_order_and_has_every_word_that_newcomers_ask_for() {
    let page = read("docs/glossary.md");
    let rows = page.lines().filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |")?.split_once(" | "));
    let entries: Vec<(&str, &str)> = rows.filter(|(term, _)| *term != "term").collect();
    for pair in entries.windows(2) {
        assert!(sorted_as(pair[0].0) < sorted_as(pair[1].0), "{} is not before {}", pair[0].0, pair[1].0);
    }
    for (term, meaning) in &entries {
        let words = meaning.split_whitespace().count();
        assert!(meaning.ends_with('.') && words <= 35, "{term}: one or two short sentences, not {words} words");
    }
    let terms: BTreeSet<&str> = entries.iter().map(|(term, _)| *term).collect();
    for term in [
        "agent",
        "AIP",
        "AIP loss",
        "ALSH",
        "approach",
        "backlog",
        "blocked exit",
        "cell",
        "copy",
        "d-set",
        "delay",
        "DIALS",
        "F",
        "forest",
        "GS",
        "IALS",
        "influence source",
        "kind",
        "LS",
        "marginal",
        "mask",
        "region",
        "retrain",
        "rollout",
        "second",
        "step",
        "timestep",
        "decision",
        "window",
    ] {
        assert!(terms.contains(term), "docs/glossary.md does not explain {term}");
    }
    for page in ["docs/README.md", "docs/guide.md"] {
        assert!(read(page).contains("](glossary.md)"), "{page} does not lead to the glossary");
    }
}

#[test]
fn the_glossary_and_the_help_say_when_an_agent_is_stuck_as_the_domains_count_it() {
    let page = read("docs/glossary.md");
    let row = page.lines().find_map(|line| line.strip_prefix("| stuck | ")?.strip_suffix(" |")).unwrap();
    assert_eq!(row, cli::STUCK);
    for (file, limit, words) in [
        ("traffic/src/road_network/mod.rs", "const STUCK_ABOVE: f64 = 0.75;", "over 75 % of green steps (grids)"),
        ("traffic/src/road_network/scenario.rs", "const STUCK_BELOW: f64 = 1.0 / 300.0;", "over 5 minutes on average"),
        ("traffic/src/road_network/scenario.rs", "const STUCK_WAIT_S: f64 = 240.0;", "cars wait over 4 (scenarios)"),
        ("warehouse/src/lib.rs", "const STUCK_BELOW: f64 = 0.5;", "under 0.5 items an episode"),
    ] {
        assert!(read(&format!("crates/{file}")).contains(limit) && row.contains(words), "{file}: {limit} and {row}");
    }
    for command in ["evaluate", "baseline", "compare"] {
        let help = Command::cargo_bin("dials-traffic").unwrap().args([command, "--help"]).output().unwrap();
        let help = String::from_utf8(help.stdout).unwrap();
        assert!(help.split_whitespace().collect::<Vec<_>>().join(" ").contains(row), "{command}: {help}");
    }
}

/// Figures and tables of the paper.
const FIGURES: u32 = 10;
const TABLES: u32 = 6;

#[test]
fn every_figure_and_table_of_the_paper_has_a_row_and_the_files_that_it_names_are_there() {
    let paper = read("docs/paper.md");
    let table = section(&paper, "## Which config for which figure");
    let rows: Vec<&str> =
        table.lines().filter(|line| line.starts_with("| Figure ") || line.starts_with("| Table ")).collect();
    let numbered = |word: &'static str, last: u32| (1..=last).map(move |number| format!("| {word} {number}"));
    for begins in numbered("Figure", FIGURES).chain(numbered("Table", TABLES)) {
        let is_its = |row: &&str| row.strip_prefix(&*begins).is_some_and(|rest| rest.starts_with([':', ' ']));
        assert!(rows.iter().any(is_its), "no row begins with {begins}");
    }
    for file in code_words(table).into_iter().filter(|word| word.ends_with(".toml") && !word.contains(' ')) {
        let path = if file.contains('/') { file.to_owned() } else { format!("experiments/{file}") };
        assert!(root().join(&path).is_file(), "{path} is named, and not there");
    }
}

#[test]
fn every_source_file_that_the_docs_name_is_there() {
    let pages: Vec<String> = pages().iter().map(|page| read(page)).collect();
    let is_source = |word: &&str| ["src/", "crates/", "tests/"].iter().any(|folder| word.starts_with(folder));
    // Capital letters stand for a name of the reader.
    let is_placeholder = |word: &str| word.chars().any(|letter| letter.is_ascii_uppercase());
    let paths: BTreeSet<&str> = pages.iter().flat_map(|text| code_words(text)).filter(is_source).collect();
    assert!(paths.len() > 40, "{paths:?}");
    for path in paths.into_iter().filter(|path| !is_placeholder(path)) {
        assert!(root().join(path).exists(), "{path} is named, and not there");
    }
}

/// Returns the blocks of shell commands of a page.
fn shell_blocks(page: &str) -> Vec<&str> {
    page.split("```sh\n").skip(1).map(|rest| rest.split("\n```").next().unwrap()).collect()
}

/// Returns the simple commands of a block, as lists of words. Joins continued lines, splits at `&&`, and drops comments and
/// the files that a command writes to.
fn commands(block: &str) -> Vec<Vec<String>> {
    let block = block.replace("\\\n", " ");
    let mut commands = Vec::new();
    for line in block.lines().map(|line| line.split(" #").next().unwrap()) {
        for command in line.split("&&") {
            let command = command.split(" > ").next().unwrap();
            commands.push(command.split_whitespace().map(|word| word.trim_matches('\'').to_owned()).collect());
        }
    }
    commands
}

#[test]
fn every_shell_command_of_the_docs_can_be_typed() {
    let mut parsed = 0;
    for page in pages() {
        let text = read(&page);
        for block in shell_blocks(&text) {
            let checked = Command::new("bash").args(["-n", "-c", block]).status().unwrap();
            assert!(checked.success(), "{page}: {block}");
            for command in commands(block) {
                let words: Vec<&str> = command.iter().map(String::as_str).collect();
                let arguments = match &words[..] {
                    ["dials-traffic", arguments @ ..] | ["cargo", "run", "--release", "--", arguments @ ..] => {
                        arguments
                    }
                    ["cargo", "run", "--release", "--example", name] => {
                        assert!(root().join(format!("examples/{name}.rs")).is_file(), "{page}: no example {name}");
                        continue;
                    }
                    _ => continue,
                };
                let line = std::iter::once("dials-traffic").chain(arguments.iter().copied());
                Cli::try_parse_from(line).unwrap_or_else(|error| panic!("{page}: {command:?}: {error}"));
                let ours = ["configs/", "sumo_nets/"];
                for file in arguments.iter().filter(|word| ours.iter().any(|folder| word.starts_with(folder))) {
                    assert!(root().join(file).exists(), "{page}: {command:?}: there is no {file}");
                }
                parsed += 1;
            }
        }
    }
    assert!(parsed > 20, "only {parsed} commands were found");
}

/// Returns what a shell block writes: the words after options that name outputs, and after `>`.
fn outputs(block: &str) -> Vec<&str> {
    const OPTIONS: [&str; 7] = ["--out", "--plot", "--csv", "--render", "--video", "--save-configuration", ">"];
    let words: Vec<&str> = block.split_whitespace().collect();
    words
        .windows(2)
        .filter(|pair| OPTIONS.contains(&pair[0]))
        .map(|pair| pair[1].trim_matches(['\'', ')', ';']))
        .collect()
}

#[test]
fn what_the_commands_of_the_docs_leave_behind_is_not_taken_for_sources() {
    let ignored = read(".gitignore");
    let is_ignored = |output: &str| {
        let first = output.split('/').next().unwrap();
        ignored.lines().filter_map(|line| line.strip_prefix('/')).any(|pattern| match pattern.split_once('*') {
            Some((begins, ends)) => first.starts_with(begins) && first.ends_with(ends),
            None => first == pattern,
        })
    };
    assert!(!is_ignored("src") && is_ignored("runs/a") && is_ignored("town.mp4"));
    let mut checked = 0;
    for page in pages().iter().filter(|page| *page == "README.md" || page.starts_with("docs/")) {
        let text = read(page);
        for output in shell_blocks(&text).into_iter().flat_map(outputs) {
            // Results and pictures that are kept.
            let is_kept = ["results/", "docs/", "/", "$"].iter().any(|begins| output.starts_with(begins));
            assert!(is_kept || is_ignored(output), "{page}: .gitignore has no line for {output}");
            checked += 1;
        }
    }
    assert!(checked > 15, "only {checked} outputs were found");
}

/// Returns the keys that an error about an unknown key lists.
fn expected_keys(error: &str) -> Vec<String> {
    let (_, known) = error.split_once("expected ").unwrap_or_else(|| panic!("{error}"));
    code_words(known.lines().next().unwrap()).into_iter().map(str::to_owned).collect()
}

#[test]
fn every_key_of_an_experiment_is_explained() {
    let page = read("docs/experiments.md");
    let explained = code_words(section(&page, "## `experiment`"));
    for text in ["no_such_key = 1", "[[grid]]\nno_such_key = 1"] {
        let error = toml::from_str::<ExperimentFile>(text).unwrap_err().to_string();
        for key in expected_keys(&error) {
            assert!(explained.iter().any(|word| word.trim_matches(['[', ']']) == key), "{key}");
        }
    }
}

/// The files of a few steps of both domains and of a scenario, with an evaluation and a report.
struct Written {
    folder: tempfile::TempDir,
    runs: [PathBuf; 4],
    /// Output of `evaluate --json` for each run.
    json: [serde_json::Value; 4],
}

/// What is trained, the config, and settings that make it short.
const TRAINED: [(&str, &str, &[&str]); 4] = [
    ("traffic", "configs/smoke_traffic.toml", &["policy.imitate=gap-out"]),
    ("warehouse", "configs/smoke_warehouse.toml", &["policy.imitate=oldest-item"]),
    ("dqn", "configs/smoke_traffic.toml", &["algorithm=dqn", "policy.share=none", "dqn.learning_starts=32"]),
    (
        "scenario",
        "configs/grid_4x4_turns.toml",
        &[
            "simulator=dials",
            "total_steps=128",
            "traffic.end_s=300",
            "traffic.local_horizon=60",
            "ppo.rollout_steps=16",
            "ppo.memory=64",
            "ppo.minibatch=32",
            "ppo.epochs=1",
            "policy.hidden=[8]",
            "policy.imitate=random",
            "imitation.critic_steps=64",
            "aip.hidden=[8]",
            "aip.dataset_steps=120",
            "aip.batch=32",
            "aip.retrain_every_steps=64",
            "evaluation.every_steps=64",
            "evaluation.aip_loss_episodes=1",
        ],
    ),
];

impl Written {
    fn new() -> Written {
        let folder = tempfile::tempdir().unwrap();
        let run = |(domain, config, settings): (&str, &str, &[&str])| {
            let out = folder.path().join("runs").join(domain);
            let small = [
                "aip.epochs=1",
                "aip.correct_marginals=true",
                "evaluation.episodes=1",
                "evaluation.final_episodes=1",
                "imitation.dataset_steps=600",
                "imitation.minibatch=4",
                "imitation.epochs=1",
            ];
            let mut command = Command::cargo_bin("dials-traffic").unwrap();
            command.arg("train").arg(root().join(config)).arg("--out").arg(&out);
            command.args(["--steps", "128", "--workers", "1", "--tensorboard"]);
            command.args(small.iter().chain(settings).flat_map(|setting| ["--set", setting]));
            succeed(command);
            let mut command = Command::cargo_bin("dials-traffic").unwrap();
            let csv = folder.path().join(format!("csv_{domain}"));
            command.arg("evaluate").arg(&out).args(["--episodes", "1", "--json", "--csv"]).arg(csv);
            (out, serde_json::from_slice(&succeed(command)).unwrap())
        };
        let trained = TRAINED.map(run);
        let mut command = Command::cargo_bin("dials-traffic").unwrap();
        command.arg("report").arg(folder.path().join("runs")).arg("--out").arg(folder.path().join("report"));
        succeed(command);
        let runs = trained.each_ref().map(|(run, _)| run.clone());
        Written { folder, runs, json: trained.map(|(_, json)| json) }
    }

    /// Returns the folders that hold CSV files of a kind.
    fn folders(&self, kind: &str) -> Vec<PathBuf> {
        match kind {
            "a run" => self.runs.to_vec(),
            "`--csv`" => TRAINED.map(|(domain, ..)| self.folder.path().join(format!("csv_{domain}"))).to_vec(),
            _ => vec![self.folder.path().join("report")],
        }
    }
}

/// Runs a command and returns what it prints.
fn succeed(mut command: Command) -> Vec<u8> {
    let output = command.output().unwrap();
    assert!(output.status.success(), "{command:?}: {}", String::from_utf8_lossy(&output.stderr));
    output.stdout
}

/// Returns the columns of all CSV files in these folders, by the name of the file.
fn columns_of(folders: &[PathBuf]) -> BTreeMap<String, BTreeSet<String>> {
    let mut columns: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for path in folders.iter().flat_map(|folder| fs::read_dir(folder).unwrap()).map(|entry| entry.unwrap().path()) {
        if path.extension().is_some_and(|extension| extension == "csv") {
            let text = fs::read_to_string(&path).unwrap();
            let header = text.lines().next().unwrap().split(',').map(str::to_owned);
            columns.entry(path.file_name().unwrap().to_str().unwrap().to_owned()).or_default().extend(header);
        }
    }
    columns
}

#[test]
fn every_file_of_a_run_and_every_column_is_explained_and_no_other() {
    let written = Written::new();

    let explained = first_column(section(&read("docs/files.md"), "## The files of a run directory"));
    let entries = written.runs.iter().flat_map(|run| fs::read_dir(run).unwrap());
    let there: BTreeSet<String> = entries
        .map(|entry| entry.unwrap())
        .map(|entry| (entry.file_name().into_string().unwrap(), entry.path().is_dir()))
        .map(|(name, folder)| if folder { format!("{name}/") } else { name.replace("worker_0", "worker_N") })
        .collect();
    assert_eq!(explained, there, "docs/files.md and what a run leaves behind");

    let page = read("docs/figures.md");
    let columns = |heading: &str| first_column(section(&page, heading));
    let figures: BTreeSet<String> =
        ["## Figures of traffic", "## Figures of the warehouse"].into_iter().flat_map(columns).collect();
    let of_all_reports = columns("## Columns that all files of a report share");
    let mut seen = BTreeSet::new();
    for kind in ["a run", "`--csv`", "a report"] {
        for (file, there) in columns_of(&written.folders(kind)) {
            let mut explained = columns(&format!("## `{file}` of {kind}"));
            if kind == "a report" {
                explained.extend(of_all_reports.iter().cloned());
            }
            if file == "training.csv" {
                explained.extend(columns("## Columns of DQN"));
            }
            if file == "returns.csv" || kind == "`--csv`" {
                // Classes of vehicles have a column each, which the page explains together.
                explained.extend(there.iter().filter(|column| column.starts_with("delay_s_")).cloned());
                let of_the_domain: BTreeSet<String> = there.difference(&explained).cloned().collect();
                assert!(of_the_domain.is_subset(&figures), "{file} of {kind}: {of_the_domain:?} and {figures:?}");
                explained.extend(of_the_domain);
            }
            assert_eq!(explained, there, "{file} of {kind}");
            seen.extend(there);
        }
    }
    assert!(figures.is_subset(&seen), "{:?}", figures.difference(&seen));

    let explained: BTreeSet<&str> = code_words(section(&page, "## JSON output")).into_iter().collect();
    for json in written.json.iter().flat_map(|json| [json, &json["per_agent"][0]]) {
        let is_explained =
            |key: &&String| explained.contains(&***key) || figures.contains(*key) || key.starts_with("delay_s_");
        let unexplained = json.as_object().unwrap().keys().find(|key| !is_explained(key));
        assert_eq!(unexplained, None, "a key of --json");
    }
}
