//! `evaluate` and `baseline`: both play the same episodes and print the same figures. `--tune` first searches the best
//! timings of the lights that go by the clock, once per network, and caches them in a file.

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail, ensure};
use serde_json::{Map, Value, json};

use super::events::EventFiles;
use super::lights::{CITY, LIGHTS, LightFigures, VARIANTS, has_lights};
use super::plot::Plots;
use super::robustness::{self, Plan, Variant};
use super::subject::{Background, Subject, agent_called};
use crate::cli;
use crate::film::scenes;
use dials_core::base::{AgentId, Seed, counted, repeated};
use dials_core::domain::{Baseline, Controller, Domain, GlobalSimulator, Measures};
use dials_core::outside::{Directory, FileName, path_as_text, write_together};
use dials_learn::evaluation::csv::{Lines, by_agent, by_episode};
use dials_learn::evaluation::{Evaluation, Finding, comparison, episode_seed, json, play_watched, table};
use dials_report::plot::About;
use dials_session::config::{RunConfig, load};
use dials_session::error::{Error, Result};
use dials_session::places::{self, Existing};
use dials_session::records::growing::{GrowingFile, Mark};
use dials_session::terminal::counting::EpisodeBar;
use dials_session::terminal::{answer, json as in_json, note};
use dials_session::{directory, domains, outputs};
use dials_traffic::config::sumocfg::Sumocfg;
use dials_traffic::controllers::timing_file::{TimingFile, TunedOn};
use dials_traffic::controllers::{COORDINATED, FIXED_TIME, any_light_of, check_name};
use dials_traffic::{Sumo, Traffic, tuning};

pub(super) fn evaluate(args: &cli::EvaluateArgs) -> Result<()> {
    if let Some(config) = &args.on {
        return evaluate_on(args, config);
    }
    // Names are checked before the files are tried, which may take long.
    let (config, domain) = directory::open_unchanged(&args.run_dir, domains::open_untried).map_err(Error::Usage)?;
    let agents = args.agents.iter().map(|word| agent_called(&*domain, word, "--agents")).collect::<anyhow::Result<_>>();
    let policies_of: Vec<AgentId> = agents.map_err(Error::Usage)?;
    if let Some(&agent) = repeated(&policies_of) {
        let twice = format!("--agents: {} is named twice; leave one", domain.agent_name(agent));
        return Err(Error::Usage(anyhow!(twice)));
    }
    args.background.iter().try_for_each(|name| domain.check_baseline(name)).map_err(Error::Usage)?;
    let variants = robustness::asked_for(&args.variants);
    variants.iter().try_for_each(|variants| check_variants(&config, variants, &args.output)).map_err(Error::Usage)?;
    domains::check(&config, &*domain).map_err(Error::Usage)?;
    let background = args.background.clone().map(|controller| Background { controller, policies_of });
    let subjects = vec![Subject::Run { dir: args.run_dir.clone(), greedy: args.greedy, background }];
    let plots = Plots::asked_for(&args.output, &config).map_err(Error::Usage)?;
    let (logged, mut events) = logged(&config, &args.output)?;
    let plots = with_events(plots, events.as_ref());
    let domain = watched(&*domain, plots.as_ref(), logged.as_ref());
    let session = Session::new(domain, &config, &args.episodes, &args.output)?;
    let mut lights = LightFigures::asked_for(domain, &args.output, false).map_err(Error::Usage)?;
    let csv = session.prepare(&subjects, variants.is_some()).map_err(Error::Usage)?;
    if let Some(variants) = &variants {
        return session.play_variants(variants, &subjects, csv, &[]);
    }
    let (findings, written) = session.play(subjects, csv, events.as_mut(), &mut lights)?;
    session.print(&findings, false, &[], &lights)?;
    session.draw(plots.as_ref(), &findings[0], format!("policies of {}", findings[0].player.label))?;
    written
}

/// Plays a policy for any light on the lights of a config: it is a controller there.
fn evaluate_on(args: &cli::EvaluateArgs, config: &Path) -> Result<()> {
    let file = &args.run_dir;
    if file.is_dir() {
        let is_run = "is a run directory; `export` writes its policy for any light as a file";
        return Err(Error::Usage(anyhow!("{}: {is_run}", file.display())));
    }
    baseline(&cli::BaselineArgs {
        config: config.to_owned(),
        controller: Some(any_light_of(file, args.greedy).map_err(Error::Usage)?),
        episodes: args.episodes.clone(),
        variants: args.variants.clone(),
        output: args.output.clone(),
        settings: cli::SettingsArgs::default(),
        compare: None,
        greedy: false,
        tune: false,
        tune_episodes: 1,
    })
}

pub(super) fn baseline(args: &cli::BaselineArgs) -> Result<()> {
    if Sumocfg::is_one(&args.config) {
        let alone = args.controller.iter().filter(|name| !Path::new(name).is_dir());
        let checked =
            alone.map(|name| check_name(name)).chain(args.compare.iter().map(|list| Subject::check_names(list)));
        checked.collect::<anyhow::Result<()>>().map_err(Error::Usage)?;
    }
    if args.compare.is_some() && args.output.events.is_some() {
        return Err(Error::Usage(anyhow!(
            "--events: a log is of one controller; use --controller NAME instead of --compare"
        )));
    }
    let config = load(&args.config, &args.settings.all()).map_err(Error::Usage)?;
    // Names are checked before the files are tried, which may take long.
    let domain = domains::open_untried(&config).map_err(Error::Usage)?;
    let variants = robustness::asked_for(&args.variants);
    variants.iter().try_for_each(|variants| check_variants(&config, variants, &args.output)).map_err(Error::Usage)?;
    let mut subjects = match (&args.controller, &args.compare) {
        (Some(name), _) => vec![Subject::Controller(name.clone())],
        (None, Some(list)) => Subject::list(list, args.greedy, &*domain).map_err(Error::Usage)?,
        (None, None) => unreachable!("clap asks for one of them"),
    };
    subjects.iter().try_for_each(|subject| subject.check_controller(&*domain)).map_err(Error::Usage)?;
    domains::check(&config, &*domain).map_err(Error::Usage)?;
    let about = [("config", json!(path_as_text(&args.config)))];
    let plots = Plots::asked_for(&args.output, &config).map_err(Error::Usage)?;
    let (logged, mut events) = logged(&config, &args.output)?;
    let plots = with_events(plots, events.as_ref());
    let domain = watched(&*domain, plots.as_ref(), logged.as_ref());
    let session = Session::new(domain, &config, &args.episodes, &args.output)?;
    let mut lights = LightFigures::asked_for(domain, &args.output, args.compare.is_some()).map_err(Error::Usage)?;
    let csv = session.prepare(&subjects, variants.is_some()).map_err(Error::Usage)?;
    if args.tune {
        tune(&config, args.tune_episodes as usize, &mut subjects)?;
    }
    if let Some(variants) = &variants {
        return session.play_variants(variants, &subjects, csv, &about);
    }
    let (findings, written) = session.play(subjects, csv, events.as_mut(), &mut lights)?;
    session.print(&findings, args.compare.is_some(), &about, &lights)?;
    let config = args.config.file_name().unwrap_or_default().to_string_lossy();
    session.draw(plots.as_ref(), &findings[0], format!("controller {} on {config}", findings[0].player.label))?;
    written
}

fn check_variants(config: &RunConfig, variants: &[Variant], output: &cli::OutputArgs) -> anyhow::Result<()> {
    robustness::check_output(output)?;
    robustness::check(config, variants)
}

/// Returns the domain whose episodes are logged, and the files of the log. Nothing if `--events` was not given.
fn logged(config: &RunConfig, output: &cli::OutputArgs) -> Result<(Option<Traffic>, Option<EventFiles>)> {
    let existing = Existing::of_named(output.force);
    let found = EventFiles::asked_for(output.events.as_deref(), existing, config).map_err(Error::Usage)?;
    Ok(found.unzip())
}

/// Makes the episodes of the pictures go into the log, too.
fn with_events(plots: Option<Plots>, events: Option<&EventFiles>) -> Option<Plots> {
    plots.map(|plots| match events {
        Some(events) => plots.log_events(&events.log),
        None => plots,
    })
}

/// Returns the domain that plays: that of the pictures, of the log, or the usual one.
fn watched<'a>(usual: &'a dyn Domain, plots: Option<&'a Plots>, logged: Option<&'a Traffic>) -> &'a dyn Domain {
    match (plots, logged) {
        (Some(plots), _) => plots.domain(),
        (None, Some(traffic)) => traffic,
        (None, None) => usual,
    }
}

struct Session<'a> {
    domain: &'a dyn Domain,
    config: &'a RunConfig,
    episodes: usize,
    seed: u64,
    /// Scenario in the words of `report`.
    scenario: String,
    /// SUMO, if the domain needs it.
    sumo: Option<&'static Sumo>,
    output: &'a cli::OutputArgs,
}

impl<'a> Session<'a> {
    fn new(
        domain: &'a dyn Domain,
        config: &'a RunConfig,
        episodes: &cli::EpisodesArgs,
        output: &'a cli::OutputArgs,
    ) -> Result<Session<'a>> {
        let count = episodes.episodes.map_or(config.learning.evaluation.final_episodes, |count| count as usize);
        let places = [
            ("--csv", &output.csv),
            ("--plot", &output.plot),
            ("--render", &output.render),
            ("--events", &output.events),
        ];
        outputs::check_apart(&places.map(|(option, dir)| (option, dir.as_deref()))).map_err(Error::Usage)?;
        let scenario = domain.scenario().map_err(Error::Run)?.id.word();
        domains::note_left_out(domain);
        let seed = episodes.seed.unwrap_or(config.learning.evaluation.seed);
        let sumo = domains::sumo(config).map_err(Error::Run)?;
        Ok(Session { domain, config, episodes: count, seed, scenario, sumo, output })
    }

    /// Checks all subjects and all output places before anything plays. Makes the files of `--csv`.
    /// `has_variants`: whether they play variants of the traffic.
    fn prepare(&self, subjects: &[Subject], has_variants: bool) -> anyhow::Result<Option<CsvFiles>> {
        subjects.iter().try_for_each(|subject| subject.check(self.domain))?;
        subjects.iter().try_for_each(|subject| subject.warn(self.domain))?;
        if let Some(subject) = repeated(subjects) {
            bail!("--compare: `{}` is named twice", subject.label());
        }
        let existing = Existing::of_named(self.output.force);
        self.output.render.iter().try_for_each(|dir| outputs::check_free(dir, "--render", existing))?;
        let beside = match has_variants {
            true => &[VARIANTS][..],
            false if has_lights(self.domain)? => &[LIGHTS, CITY],
            false => &[],
        };
        self.output.csv.as_deref().map(|dir| CsvFiles::create(dir, existing, beside)).transpose()
    }

    /// Lets all subjects play the same episodes. The files of `--csv` and `--events` have a result of their own, because a
    /// full disk must not cost what was played.
    fn play(
        &self,
        subjects: Vec<Subject>,
        mut csv: Option<CsvFiles>,
        mut events: Option<&mut EventFiles>,
        lights: &mut LightFigures,
    ) -> Result<(Vec<Finding>, Result<()>)> {
        let bar = EpisodeBar::of(subjects.len() * self.episodes, "episodes");
        let mut findings = Vec::new();
        let mut written = Ok(());
        for (number, subject) in subjects.into_iter().enumerate() {
            // Before it reads its file, which may change while it plays.
            let player = subject.player(self.domain).map_err(Error::Usage)?;
            let Baseline { mut simulator, mut controller } = subject.open(self.domain).map_err(Error::Usage)?;
            let (simulator, controller) = (&mut *simulator, &mut *controller);
            if let Some(dir) = &self.output.render {
                let existing = Existing::of_named(self.output.force);
                render(simulator, controller, Seed::new(self.seed), dir, existing).map_err(Error::Usage)?;
            }
            lights.begin(simulator, self.output.emissions).map_err(Error::Run)?;
            let mut episodes = Vec::with_capacity(self.episodes);
            for episode in 0..self.episodes {
                episodes.push(lights.play(simulator, controller, self.seed, episode).map_err(Error::Run)?);
                bar.set(number * self.episodes + episode + 1);
                if let (Ok(()), Some(events)) = (&written, &mut events) {
                    written = events.append().map_err(Error::Run);
                }
            }
            let finding = Finding { player, episodes };
            if let (Ok(()), Some(csv)) = (&written, &mut csv) {
                let lines = lights.lines(&finding.player.label);
                written = csv.append(&finding, &[], Some(&lines)).map_err(Error::Run);
            }
            findings.push(finding);
        }
        bar.finish();
        if let (Ok(()), Some(csv)) = (&written, &csv) {
            written = self.write_city(csv, &findings, lights).map_err(Error::Run);
        }
        if let (Ok(()), Some(events)) = (&written, &events) {
            events.note_written();
        }
        Ok((findings, written))
    }

    /// Writes the file from which `report` makes a page, if the domain has lights.
    fn write_city(&self, csv: &CsvFiles, findings: &[Finding], lights: &LightFigures) -> anyhow::Result<()> {
        if csv.lights.is_none() {
            return Ok(());
        }
        let city = lights.city(self.config, self.domain, findings, self.seed)?;
        csv.directory.write(CITY, &serde_json::to_vec(&city)?)
    }

    /// Lets all subjects play all variants, and prints the figures.
    fn play_variants(
        &self,
        variants: &[Variant],
        subjects: &[Subject],
        csv: Option<CsvFiles>,
        about: &[(&str, Value)],
    ) -> Result<()> {
        let keys = self.keys(about);
        let plan = Plan { config: self.config, variants, subjects, episodes: self.episodes, seed: self.seed };
        robustness::play(&plan, csv, self.output.json, keys)
    }

    /// Returns the keys of a JSON object that say what was played. `about`: further ones.
    fn keys(&self, about: &[(&str, Value)]) -> Map<String, Value> {
        let mut keys: Map<String, Value> =
            about.iter().map(|(key, value)| ((*key).to_owned(), value.clone())).collect();
        keys.insert("scenario".into(), json!(self.scenario));
        keys.insert("seed".into(), json!(self.seed));
        keys.insert("warnings".into(), json!(self.domain.warnings()));
        if let Some(sumo) = self.sumo {
            keys.insert("sumo_version".into(), json!(sumo.name));
        }
        keys
    }

    /// Prints the figures of one player, or compares all. `about`: further keys of the JSON object.
    fn print(
        &self,
        findings: &[Finding],
        compares: bool,
        about: &[(&str, Value)],
        lights: &LightFigures,
    ) -> Result<()> {
        let found = if self.output.json {
            let mut object = match compares {
                true => json::of_all(self.domain, findings),
                false => json::of_one(self.domain, &findings[0]),
            };
            lights.add_to(&mut object);
            object.extend(self.keys(about));
            in_json(Value::Object(object))
        } else {
            let table = if compares { comparison(findings) } else { table(self.domain, &findings[0]) };
            table + &lights.table(findings).map_or(String::new(), |table| format!("\n\n{table}"))
        };
        answer(found).map_err(Error::Run)
    }

    fn draw(&self, plots: Option<&Plots>, finding: &Finding, subject: String) -> Result<()> {
        let Some(plots) = plots else { return Ok(()) };
        let evaluation = Evaluation::new(self.domain, &finding.episodes);
        plots.draw(&evaluation, &About { subject, seed: self.seed }).map_err(Error::Run)
    }
}

/// The CSV files of `--csv`. The lines of each player are written as soon as it has played.
pub(super) struct CsvFiles {
    directory: Directory,
    episodes: GrowingFile,
    agents: GrowingFile,
    lights: Option<GrowingFile>,
}

impl CsvFiles {
    /// Makes the directory. If one of the files exists, `existing` says what becomes of it. `beside`: names of further files.
    fn create(dir: &Path, existing: Existing, beside: &[&'static str]) -> anyhow::Result<CsvFiles> {
        let names = ["episodes.csv", "agents.csv"];
        let paths: Vec<PathBuf> = names.iter().chain(beside).map(|name| dir.join(name)).collect();
        paths.iter().try_for_each(|file| outputs::check_free(file, "--csv", existing))?;
        outputs::check_writable(dir)?;
        paths.iter().try_for_each(|file| places::clear(file, existing))?;
        let [episodes, agents] = names.map(|name| GrowingFile::new(name, Mark::default()));
        let lights = beside.contains(&LIGHTS).then(|| GrowingFile::new(LIGHTS, Mark::default()));
        Ok(CsvFiles { directory: Directory::open(dir)?, episodes, agents, lights })
    }

    /// Writes the table of variants, from which `report` makes a section.
    pub(super) fn write_variants(&self, table: &[u8]) -> anyhow::Result<()> {
        self.directory.write(VARIANTS, table)
    }

    /// `columns`: further names and values of all lines of episodes and agents. `lights`: lines of the lights' own file.
    pub(super) fn append(
        &mut self,
        finding: &Finding,
        columns: &[(&str, String)],
        lights: Option<&Lines>,
    ) -> anyhow::Result<()> {
        self.episodes.append_lines(&self.directory, &by_episode(finding).with(columns))?;
        self.agents.append_lines(&self.directory, &by_agent(finding).with(columns))?;
        match (&mut self.lights, lights) {
            (Some(file), Some(lines)) => file.append_lines(&self.directory, lines),
            _ => Ok(()),
        }
    }
}

/// Draws the first evaluation episode of the seed `run` as `step_NNN.svg` for every step, and `episode.gif`.
fn render(
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    run: Seed,
    dir: &Path,
    existing: Existing,
) -> anyhow::Result<()> {
    ensure!(
        simulator.scene().is_some(),
        "--render: this domain draws no pictures; try --plot, or `replay` for sumo-gui"
    );
    let (mut drawn, mut titles) = (Vec::new(), Vec::new());
    play_watched(simulator, controller, episode_seed(run, 0), &mut |simulator| {
        drawn.push(simulator.scene().context("the domain drew no picture of a step")?);
        titles.push(title(titles.len(), &simulator.measures()?));
        Ok(())
    })?;
    places::make(dir, existing, |dir| scenes::write(&drawn, &titles, dir))
        .with_context(|| format!("{}: cannot be written", dir.display()))
        .map(drop)
}

/// Returns the title of a step: its number, and what the agents have together in each figure.
fn title(step: usize, measures: &Measures) -> String {
    let figures = measures.per_agent.iter().map(|(name, values)| format!(", {name} {:.0}", values.iter().sum::<f64>()));
    format!("step {step}{}", figures.collect::<String>())
}

const FOLDER: &str = "tuned";
const TUNED: [&str; 2] = [FIXED_TIME, COORDINATED];

/// Replaces every `fixed-time` and `coordinated` without parameters by the best timings that the search finds.
pub(super) fn tune(config: &RunConfig, episodes: usize, subjects: &mut [Subject]) -> Result<()> {
    let is = |subject: &Subject, name: &str| *subject == Subject::Controller(name.to_owned());
    let untuned = TUNED.into_iter().filter(|name| subjects.iter().any(|subject| is(subject, name)));
    let untuned: Vec<&str> = untuned.collect();
    if untuned.is_empty() {
        let timed = subjects.iter().find_map(|subject| match subject {
            Subject::Controller(name) => Some((name, TUNED.into_iter().find(|tuned| name.starts_with(tuned))?)),
            Subject::Run { .. } => None,
        });
        return Err(Error::Usage(match timed {
            Some((name, tuned)) => {
                anyhow!("--tune: searches all timings of {tuned}, but `{name}` already sets some of them")
            }
            None => anyhow!("--tune: tunes {}, which are no controllers of this command", TUNED.join(" and ")),
        }));
    }
    for controller in untuned {
        let file = tuned_file(config, controller, episodes)?;
        let tuned = Subject::Controller(format!("{controller}:file={}", file.display()));
        subjects.iter_mut().filter(|subject| is(subject, controller)).for_each(|subject| *subject = tuned.clone());
    }
    Ok(())
}

/// Returns the file of timings for this network, horizon, seed, search and SUMO; makes it if there is none.
fn tuned_file(config: &RunConfig, controller: &str, episodes: usize) -> Result<PathBuf> {
    let Some(traffic) = domains::traffic(config).map_err(Error::Usage)? else {
        return Err(Error::Usage(anyhow!("--tune: only traffic lights can be tuned")));
    };
    let wanted = TunedOn::of(&traffic, controller, episodes, config.learning.seed).map_err(Error::Usage)?;
    let key = crc32fast::hash(&serde_json::to_vec(&wanted).expect("names and numbers are JSON"));
    // A comma in a path would end the parameter of the controller that reads the file.
    let name = format!("{}-{controller}-{key:08x}.toml", wanted.network.replace(',', "_"));
    let path = Path::new(FOLDER).join(FileName::new(name).map_err(Error::Usage)?);
    if path.exists() {
        let kept = TimingFile::read(&path).map_err(Error::Usage)?;
        if kept.tuned_on != wanted {
            return Err(Error::Usage(anyhow!("{}: was tuned for another setting; move it away", path.display())));
        }
        note(format_args!("{}: uses the timings of an earlier search", path.display()));
        return Ok(path);
    }
    outputs::check_writable(Path::new(FOLDER)).map_err(Error::Usage)?;
    note(format_args!(
        "{FOLDER}: has no timings of {controller} for this network, horizon, seed, search and SUMO version; searching for \
         them"
    ));
    let bar = EpisodeBar::of(1, "episodes");
    let found = tuning::tune(&traffic, wanted, config.learning.seed, &mut |progress| {
        bar.set_length(progress.at_most);
        bar.set(progress.played);
        bar.set_message(format_args!("(at most); best {} so far", progress.best));
    });
    bar.finish();
    let found = found.map_err(Error::Run)?;
    found
        .to_toml()
        .and_then(|text| write_together(Path::new(FOLDER), &[(path.clone(), text.into_bytes())]))
        .map_err(Error::Run)?;
    note(format_args!("{}: tuned on {}, {}", path.display(), counted(episodes, "episode"), found.score()));
    Ok(path)
}
