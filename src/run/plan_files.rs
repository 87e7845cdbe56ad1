//! What `plan` writes and prints: the files of a plan, the command that plays it, and what it gains.

use std::path::{Path, PathBuf};

use anyhow::Result;
use serde_json::{Map, Value, json};

use super::plan::{delays_s, difference};
use dials_core::base::statistics::{Interval, mean};
use dials_core::base::{Seed, counted};
use dials_core::domain::Domain;
use dials_core::domain::signal_sheet::{Aspect, SignalSheet};
use dials_core::outside::{path_as_text, quoted};
use dials_learn::evaluation::{Finding, cell, comparison, episode_seed, json, signed};
use dials_report::signal_plan::{About, PAGE, PROGRAMS, TABLE, csv, page};
use dials_session::terminal::program;
use dials_traffic::controllers::COORDINATED;
use dials_traffic::timing::programs::Programs;
use dials_traffic::timing::{DayPlan, PlainRun};

/// What somebody who puts the plan on the street wants to know.
const WALK_SIGNALS: &str =
    "on foot: walk signals end before the cars' green, so that people are across when others get green";

/// Why a plan of `coordinated` has another delay than `coordinated` itself.
const NO_LEEWAY: &str = "a plan has fixed greens, without the leeway (`early`, `late`) of `baseline --controller coordinated`, so the \
                         two have different delays";

/// What the playing found.
pub(super) struct Outcome<'a> {
    findings: &'a [Finding],
    seed: u64,
    label: &'a str,
    sheets: &'a [SignalSheet],
    periods: usize,
    /// What somebody should know of the scenario's files.
    warnings: Vec<String>,
    directory: String,
    /// Command that plays the plan in plain SUMO.
    command: String,
    /// Command that plays the first episode and writes the trips.
    check: String,
    /// Route file of each episode, if each plays one of several.
    route_files: Vec<PathBuf>,
}

impl<'a> Outcome<'a> {
    /// `findings`: today's programs, perhaps the one that was watched, and the plan. `place`: the output directory.
    pub(super) fn new(
        sheets: &'a [SignalSheet],
        plain: &PlainRun,
        place: &Path,
        findings: &'a [Finding],
        seed: u64,
        label: &'a str,
        plan: &DayPlan,
    ) -> Outcome<'a> {
        let programs = place.join(PROGRAMS);
        let additional: Vec<String> =
            plain.additional.iter().chain([&programs]).map(|path| path.display().to_string()).collect();
        let additional = quoted(Path::new(&additional.join(",")));
        let mut command = format!("sumo -c {} -a {additional}", quoted(&plain.config));
        for (option, second) in [("--begin", plain.begin_s), ("--end", plain.end_s)] {
            command += &second.map_or(String::new(), |second| format!(" {option} {second}"));
        }
        command += &plain.routes.as_ref().map_or(String::new(), |routes| format!(" -r {}", quoted(routes)));
        if plain.validates {
            command += " --xml-validation never";
        }
        let check = format!(
            "{command} --seed {} --precision 6 --tripinfo-output trips.xml --tripinfo-output.write-unfinished \
             --tripinfo-output.write-undeparted",
            sumo_seed(seed, 0)
        );
        Outcome {
            findings,
            seed,
            label,
            sheets,
            periods: plan.periods(),
            warnings: Vec::new(),
            directory: place.display().to_string(),
            command,
            check,
            route_files: Vec::new(),
        }
    }

    /// Takes the route files of the episodes. `file_of`: returns that of the episode with a seed, if each plays one of several.
    pub(super) fn with_route_files(mut self, file_of: impl Fn(Seed) -> Option<PathBuf>) -> Outcome<'a> {
        let seeds = (0..self.episodes()).map(|episode| episode_seed(Seed::new(self.seed), episode));
        self.route_files = seeds.filter_map(file_of).collect();
        self
    }

    /// Takes what somebody should know of the scenario's files, a sentence each.
    pub(super) fn with_warnings(mut self, warnings: Vec<String>) -> Outcome<'a> {
        self.warnings = warnings;
        self
    }

    fn today(&self) -> &Finding {
        &self.findings[0]
    }

    fn plan(&self) -> &Finding {
        &self.findings[self.findings.len() - 1]
    }

    /// Returns the one whose greens were frozen, if that is not today's programs.
    fn watched(&self) -> Option<&Finding> {
        (self.findings.len() == 3).then(|| &self.findings[1])
    }

    fn episodes(&self) -> usize {
        self.plan().episodes.len()
    }

    /// Returns the delays in sentences.
    fn sentences(&self) -> Vec<String> {
        let [today, plan] = [self.today(), self.plan()].map(|finding| seconds(Interval::of(&delays_s(finding))));
        let saved = change(difference(self.plan(), self.today()));
        let interval = if self.episodes() > 1 { "95 % interval, " } else { "" };
        let episodes = counted(self.episodes(), "episode");
        let mut sentences = vec![format!(
            "delay per car: {today} with today's programs, {plan} with the plan; difference {saved} ({interval}{episodes}, \
             the same traffic)"
        )];
        if let Some(watched) = self.watched() {
            let own = seconds(Interval::of(&delays_s(watched)));
            let lost = change(difference(self.plan(), watched));
            sentences.push(format!("{} itself has {own}; the plan differs from it by {lost}", self.label));
        }
        if self.label.split(':').next() == Some(COORDINATED) {
            sentences.push(NO_LEEWAY.to_owned());
        }
        if let Some(first) = self.route_files.first() {
            sentences.push(format!(
                "each episode plays one of several route files; the commands play {}, which the first episode had",
                first.display()
            ));
        }
        if self.sheets.iter().any(has_walk_signals) {
            sentences.push(WALK_SIGNALS.to_owned());
        }
        sentences
    }

    pub(super) fn text(&self, files: &[&str]) -> String {
        let plans =
            if self.periods > 1 { format!(", {} in turn", counted(self.periods, "plan")) } else { String::new() };
        format!(
            "{}\n\nwritten to {}: {}; {}{plans}\n{}\nfor a page with a map, each light before and after, and a slide: {} report \
             {}\nplay it with: {}\nto check the first episode, \
             whose trips lose {} s on average (timeLoss + departDelay in trips.xml): {}",
            comparison(self.findings),
            self.directory,
            files.join(", "),
            counted(self.sheets.len(), "light"),
            self.sentences().join("\n"),
            program(),
            quoted(Path::new(&self.directory)),
            self.command,
            delays_s(self.plan())[0],
            self.check
        )
    }

    pub(super) fn json(&self, domain: &dyn Domain) -> Map<String, Value> {
        let delays = delays_s(self.plan());
        let episodes = delays.iter().enumerate().map(|(episode, delay)| {
            let mut object = json!({ "sumo_seed": sumo_seed(self.seed, episode), "delay_s": delay });
            if let Some(routes) = self.route_files.get(episode) {
                object["routes"] = json!(path_as_text(routes));
            }
            object
        });
        let mut object = json::of_all(domain, self.findings);
        object.insert("seed".into(), json!(self.seed));
        object.insert("lights".into(), json!(self.sheets.len()));
        object.insert("periods".into(), json!(self.periods));
        object.insert("warnings".into(), json!(self.warnings));
        object.insert("delay_today_s".into(), json!(mean(&delays_s(self.today()))));
        object.insert("delay_plan_s".into(), json!(mean(&delays)));
        object.insert("delay_difference_s".into(), json!(difference(self.plan(), self.today())));
        if let Some(watched) = self.watched() {
            object.insert("delay_of_watched_s".into(), json!(mean(&delays_s(watched))));
            object.insert("delay_lost_by_freezing_s".into(), json!(difference(self.plan(), watched)));
        }
        object.insert("episodes_of_plan".into(), episodes.collect());
        object.insert("command".into(), json!(self.command));
        object.insert("check_command".into(), json!(self.check));
        object
    }

    fn about(&self) -> About {
        let row = |finding: &Finding| {
            let name =
                if finding == self.today() { "today's programs".to_owned() } else { finding.player.label.clone() };
            let difference = match finding == self.today() {
                true => String::new(),
                false => change(difference(finding, self.today())),
            };
            vec![name, seconds(Interval::of(&delays_s(finding))), difference]
        };
        let mut words = self.sentences();
        if self.periods > 1 {
            words.push(format!(
                "The demand changes, so there are {} for one period after the other. Each light goes to its next plan when \
                 a cycle ends (WAUT).",
                counted(self.periods, "plan")
            ));
        }
        About {
            title: format!("Signal plan: {}", self.label),
            words: words.iter().map(|sentence| sentence_of(sentence)).collect(),
            caption: match self.episodes() {
                1 => "Delay per car in one episode, so there are no intervals.".to_owned(),
                played => format!(
                    "Delay per car, mean +- half of its 95 % interval over {played} episodes. The difference is paired by episode."
                ),
            },
            header: ["lights", "delay", "difference from today"].map(str::to_owned).to_vec(),
            rows: self.findings.iter().map(row).collect(),
            commands: vec![
                (
                    "Plain SUMO plays the plan with this command, in the folder where the plan was made:".to_owned(),
                    self.command.clone(),
                ),
                (
                    format!(
                        "The first episode has a delay of {:.2} s: the mean of timeLoss + departDelay of all trips in trips.xml \
                         after this command:",
                        delays_s(self.plan())[0]
                    ),
                    self.check.clone(),
                ),
            ],
            assumed: self.warnings.iter().map(|warning| sentence_of(warning)).chain([
                "Delay is what SUMO calls timeLoss, and the time that a car waited to enter. Buses and other vehicles count as \
                 cars, and those that never entered count, too."
                    .to_owned(),
                "Phases, yellow and all red come from the programs of the net, or from the settings of the config.".to_owned(),
                "Lights that are not listed keep their programs.".to_owned(),
                "An offset is the second of the simulation, modulo the cycle, at which phase 1 begins.".to_owned(),
            ]).collect(),
        }
    }
}

fn has_walk_signals(sheet: &SignalSheet) -> bool {
    let mut groups = sheet.programs.iter().flat_map(|program| &program.groups);
    let is_green = |(aspect, _): &(Aspect, u32)| matches!(aspect, Aspect::Green | Aspect::YieldingGreen);
    groups.any(|group| group.on_foot && group.bars.iter().any(is_green))
}

/// Returns the seed with which SUMO plays an evaluation episode.
fn sumo_seed(seed: u64, episode: usize) -> u32 {
    episode_seed(Seed::new(seed), episode).for_sumo()
}

fn seconds(interval: Interval) -> String {
    format!("{} s", cell(interval))
}

/// Returns a difference with its sign.
fn change(interval: Interval) -> String {
    format!("{} s", signed(interval))
}

fn sentence_of(words: &str) -> String {
    let mut letters = words.chars();
    let first: String = letters.next().into_iter().flat_map(char::to_uppercase).collect();
    let end = if words.ends_with('.') { "" } else { "." };
    format!("{first}{}{end}", letters.as_str())
}

/// Returns the names and texts of all files.
pub(super) fn files(programs: &Programs, outcome: &Outcome<'_>) -> Result<Vec<(&'static str, String)>> {
    let (table, page) = (csv(outcome.sheets)?, page(&outcome.about(), outcome.sheets)?);
    Ok(vec![(PROGRAMS, programs.text.clone()), (TABLE, table), (PAGE, page)])
}
