//! `plan`: a plan of all lights that plain SUMO loads. It makes the timings, plays them by the file that it will write, and
//! compares them with today's programs on the same traffic.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, anyhow, bail, ensure};
use serde_json::json;

use super::evaluate::tune;
use super::lights::{CITY, LIGHTS, LightFigures};
use super::plan_files::{Outcome, files};
use super::subject::Subject;
use crate::cli;
use dials_core::base::statistics::{Interval, mean};
use dials_core::base::{RandomPurpose, Seed};
use dials_core::domain::{Baseline, BuiltInControl, Controller, Domain};
use dials_learn::evaluation::{EpisodeReport, Finding, Player, episode_seed, play};
use dials_session::config::{RunConfig, load};
use dials_session::directory;
use dials_session::domains::{self, DomainConfig};
use dials_session::error::{Error, Result};
use dials_session::outputs::{check_can_be_made, check_not_a_run};
use dials_session::places::{self, Existing};
use dials_session::records::files::{CONFIG, is_run_dir};
use dials_session::terminal::counting::EpisodeBar;
use dials_session::terminal::{answer, json as in_json, note};
use dials_traffic::Traffic;
use dials_traffic::config::TrafficTable;
use dials_traffic::config::sumocfg::Sumocfg;
use dials_traffic::controllers::{FIXED_TIME, HandCoded};
use dials_traffic::sim::control::SignalControl;
use dials_traffic::timing::freeze::Watched;
use dials_traffic::timing::programs::{Programs, actuated, fixed};
use dials_traffic::timing::sheets::sheets;
use dials_traffic::timing::{self, DayPlan, plain_run};

/// Today's programs, with which plans are compared.
const TODAY: &str = "program";
/// Key of a player that plays a plan.
pub(super) const PLAN: &str = "plan";
/// Number of episodes in which the candidates of a frozen plan are compared.
const TRIALS: usize = 3;

pub(super) fn plan(args: &cli::PlanArgs) -> Result<()> {
    let (file, controller) = named(args).map_err(Error::Usage)?;
    if Sumocfg::is_one(&args.config) {
        Subject::check_names(&controller).map_err(Error::Usage)?;
    }
    let existing = Existing::of_named(args.force);
    check_not_a_run("--out", &args.out).map_err(Error::Usage)?;
    let place = places::place(&args.out, existing).map_err(Error::Usage)?;
    check_can_be_made(&args.out).map_err(Error::Usage)?;
    let config = load(&file, &args.settings.all()).map_err(Error::Usage)?;
    check_that_sumo_can_repeat_it(&config).map_err(Error::Usage)?;
    let traffic = domains::open_traffic_untried(&config).map_err(Error::Usage)?;
    let traffic = traffic.ok_or_else(|| Error::Usage(anyhow!("plan: only traffic lights have plans")))?;
    // What is asked for is checked before the files are tried, which may take long.
    let subject = subject(args, &controller, &traffic).map_err(Error::Usage)?;
    domains::check(&config, &traffic).map_err(Error::Usage)?;
    let (label, name) = (subject.label(), programs_called(args, &subject));
    domains::note_left_out(&traffic);
    let work = Work { args, controller: &controller, config: &config, traffic: &traffic };
    let made = work.make(subject, &name)?;
    let mut lights = LightFigures::for_a_city();
    let findings = work.measure(&made, &mut lights)?;
    let plain = plain_run(&traffic, episode_seed(Seed::new(work.seed()), 0)).map_err(Error::Run)?;
    let sheets = sheets(&traffic, &made.plan, &made.programs).map_err(Error::Run)?;
    let outcome = Outcome::new(&sheets, &plain, &place, &findings, work.seed(), &label, &made.plan);
    let outcome = outcome.with_route_files(|episode| traffic.route_file_of(episode));
    let outcome = outcome.with_warnings(traffic.warnings());
    let mut written = files(&made.programs, &outcome).map_err(Error::Run)?;
    let city = lights.city(&config, &traffic, &findings, work.seed()).map_err(Error::Run)?;
    written.push((LIGHTS, lights.csv(&findings).map_err(Error::Run)?));
    written.push((CITY, city.to_string()));
    let names: Vec<&str> = written.iter().map(|(name, _)| *name).collect();
    places::make(&args.out, existing, |dir| written.iter().try_for_each(|(name, text)| dir.put(name, text.as_bytes())))
        .map_err(Error::Run)?;
    let found = if args.json {
        let mut object = outcome.json(&traffic);
        object.insert("config".into(), json!(dials_core::outside::path_as_text(&args.config)));
        object.insert("directory".into(), json!(dials_core::outside::path_as_text(&place)));
        object.insert("files".into(), json!(names));
        in_json(serde_json::Value::Object(object))
    } else {
        outcome.text(&names)
    };
    answer(found).map_err(Error::Run)
}

/// Returns the file of the config, and who controls. A run directory is both, if it is named alone.
fn named(args: &cli::PlanArgs) -> anyhow::Result<(PathBuf, String)> {
    if !is_run_dir(&args.config) {
        let controller = args.controller.clone();
        let controller = controller.context(
            "--controller: is missing; name `fixed-time`, `webster`, `coordinated`, another rule or a run directory",
        )?;
        return Ok((args.config.clone(), controller));
    }
    let run = args.config.to_str().with_context(|| format!("{}: is not UTF-8; rename it", args.config.display()))?;
    Ok((args.config.join(CONFIG), args.controller.clone().unwrap_or_else(|| run.to_owned())))
}

/// Checks that plain SUMO measures what this program measures, with the files of the scenario and its own options.
fn check_that_sumo_can_repeat_it(config: &RunConfig) -> anyhow::Result<()> {
    let (changes, warm_up_s) = match &config.domain {
        Some(DomainConfig::Traffic(TrafficTable::Scenario(table))) => {
            (table.demand != 1.0 || !table.closed.is_empty(), table.warm_up_s)
        }
        Some(DomainConfig::Traffic(TrafficTable::Grid(table))) => (false, table.warm_up_s),
        _ => return Ok(()),
    };
    ensure!(
        !changes && warm_up_s == 0,
        "plan: plain SUMO knows no traffic.demand, traffic.closed and traffic.warm_up_s; leave them out. `baseline` tries a plan's \
         controller with them"
    );
    Ok(())
}

fn subject(args: &cli::PlanArgs, controller: &str, domain: &dyn Domain) -> anyhow::Result<Subject> {
    let mut subjects = Subject::list(controller, args.greedy, domain)?;
    let subject = subjects.remove(0);
    if !subjects.is_empty() {
        bail!("--controller `{controller}`: names several; a plan is made of one");
    }
    if args.greedy && matches!(subject, Subject::Controller(_)) {
        bail!("--greedy: is for the policies of a run directory, and `{controller}` is a controller");
    }
    subject.check(domain)?;
    subject.warn(domain)?;
    Ok(subject)
}

/// Returns the name of the programs in SUMO's files.
fn programs_called(args: &cli::PlanArgs, subject: &Subject) -> String {
    let base = match subject {
        Subject::Controller(name) => name.split(':').next().unwrap_or_default(),
        Subject::Run { .. } => "learned",
    };
    let ending = if args.tune { "-tuned" } else { "" };
    if args.actuated { format!("{base}-actuated") } else { format!("{base}{ending}") }
}

struct Work<'a> {
    args: &'a cli::PlanArgs,
    controller: &'a str,
    config: &'a RunConfig,
    traffic: &'a Traffic,
}

/// A plan with its programs.
struct Made {
    plan: DayPlan,
    programs: Programs,
    /// Who was watched and frozen, if somebody was.
    watched: Option<Subject>,
}

impl Work<'_> {
    fn seed(&self) -> u64 {
        self.args.episodes.seed.unwrap_or(self.config.learning.evaluation.seed)
    }

    fn episodes(&self) -> usize {
        let given = self.args.episodes.episodes.map(|count| count as usize);
        given.unwrap_or(self.config.learning.evaluation.final_episodes)
    }

    /// Returns the seed of an episode in which plans are made. None is an evaluation episode.
    fn seed_of_making(&self, episode: usize) -> Seed {
        Seed::new(self.config.learning.seed).fork(RandomPurpose::Tuning).for_episode(episode)
    }

    fn make(&self, subject: Subject, name: &str) -> Result<Made> {
        let mut subjects = [subject];
        let mut searched = false;
        if self.args.tune && self.traffic.grid().is_none() && subjects[0] == Subject::Controller(FIXED_TIME.to_owned())
        {
            tune(self.config, self.args.tune_episodes as usize, &mut subjects)?;
            searched = true;
        }
        let [subject] = subjects;
        if let Subject::Controller(controller) = &subject
            && let Some(plan) = timing::timed(self.traffic, controller).map_err(Error::Run)?
        {
            if self.args.actuated {
                return Err(Error::Usage(anyhow!(
                    "--actuated: needs greens that vary, and those of `{controller}` do not; name a run directory, or a rule \
                     such as max-pressure"
                )));
            }
            let plan = if self.args.tune && !searched { self.tuned(&plan)? } else { plan };
            let programs = fixed(self.traffic, &plan, name).map_err(Error::Usage)?;
            return Ok(Made { plan, programs, watched: None });
        }
        let watched = self.watch(&subject).map_err(Error::Run)?;
        let candidates = watched.candidates(self.traffic).map_err(Error::Run)?;
        let (plan, programs) = if self.args.actuated {
            let plan = candidates.into_iter().next().expect("there is a plan with the mean greens");
            let programs = actuated(self.traffic, &plan, &watched, name).map_err(Error::Usage)?;
            (plan, programs)
        } else {
            let plan = self.best(candidates, name)?;
            let plan = if self.args.tune { self.tuned(&plan)? } else { plan };
            let programs = fixed(self.traffic, &plan, name).map_err(Error::Usage)?;
            (plan, programs)
        };
        Ok(Made { plan, programs, watched: Some(subject) })
    }

    fn tuned(&self, plan: &DayPlan) -> Result<DayPlan> {
        let bar = EpisodeBar::of(1, "episodes");
        let found = timing::tune(
            self.traffic,
            plan,
            self.args.tune_episodes as usize,
            self.config.learning.seed,
            &mut |progress| {
                bar.set_length(progress.at_most);
                bar.set(progress.played);
                bar.set_message(format_args!("(at most); best {} so far", progress.best));
            },
        );
        bar.finish();
        found.map_err(if plan.periods() > 1 { Error::Usage } else { Error::Run })
    }

    /// Lets somebody play, and notes what the lights show.
    fn watch(&self, subject: &Subject) -> anyhow::Result<Watched> {
        let (control, mut controller): (_, Box<dyn Controller>) = match subject {
            Subject::Controller(name) => {
                let by = self.traffic.hand_coded(name)?;
                (self.traffic.everywhere(by), Box::new(BuiltInControl))
            }
            Subject::Run { dir, greedy, .. } => {
                let run = directory::open(dir)?;
                run.note_still_trained(dir);
                (SignalControl::Agents, Box::new(run.controller(super::subject::selection(*greedy))))
            }
        };
        let episodes = self.args.watch_episodes as usize;
        note(format_args!("watching the greens of {}", subject.label()));
        let bar = EpisodeBar::of(episodes, "episodes");
        let mut simulator = self.traffic.global(control)?;
        Watched::prepare(&mut simulator);
        let mut watched = Watched::nothing(self.traffic);
        for episode in 0..episodes {
            play(&mut simulator, &mut *controller, self.seed_of_making(episode))?;
            watched.note(&simulator);
            bar.set(episode + 1);
        }
        bar.finish();
        Ok(watched)
    }

    /// Returns the candidate with the least mean delay.
    fn best(&self, candidates: Vec<DayPlan>, name: &str) -> Result<DayPlan> {
        let bar = EpisodeBar::of(candidates.len() * TRIALS, "episodes");
        let mut best: Option<(f64, DayPlan)> = None;
        for (number, candidate) in candidates.into_iter().enumerate() {
            let programs = fixed(self.traffic, &candidate, name).map_err(Error::Usage)?;
            let delay = self.trial(&programs, &mut |done| bar.set(number * TRIALS + done)).map_err(Error::Run)?;
            if best.as_ref().is_none_or(|(least, _)| delay < *least) {
                best = Some((delay, candidate));
            }
        }
        bar.finish();
        Ok(best.expect("there is a candidate").1)
    }

    fn trial(&self, programs: &Programs, progress: &mut dyn FnMut(usize)) -> anyhow::Result<f64> {
        let Baseline { mut simulator, mut controller } = self.player(programs)?;
        simulator.measure_in_full()?;
        let mut delays = Vec::new();
        for episode in 0..TRIALS {
            let report = play(&mut *simulator, &mut *controller, self.seed_of_making(episode))?;
            delays.push(delay_s(&report).context("SUMO measured no delay")?);
            progress(episode + 1);
        }
        Ok(mean(&delays))
    }

    fn player(&self, programs: &Programs) -> anyhow::Result<Baseline> {
        let by = HandCoded::Programs(Arc::from(&*programs.text));
        let simulator = Box::new(self.traffic.global(self.traffic.everywhere(by))?);
        Ok(Baseline { simulator, controller: Box::new(BuiltInControl) })
    }

    /// Lets today's programs, who was watched, and the plan play the same episodes, in this order. `lights` notes what happens at
    /// each light.
    fn measure(&self, made: &Made, lights: &mut LightFigures) -> Result<Vec<Finding>> {
        let today = Subject::Controller(TODAY.to_owned());
        let watched = made.watched.iter().filter(|subject| **subject != today);
        let subjects: Vec<&Subject> = [&today].into_iter().chain(watched).collect();
        let episodes = self.episodes();
        let bar = EpisodeBar::of((subjects.len() + 1) * episodes, "episodes");
        let mut findings: Vec<Finding> = Vec::new();
        let mut add = |player: Player, opened: anyhow::Result<Baseline>| -> Result<()> {
            let Baseline { mut simulator, mut controller } = opened.map_err(Error::Run)?;
            let before = findings.len() * episodes;
            lights.begin(&mut *simulator, false).map_err(Error::Run)?;
            let mut played = Vec::with_capacity(episodes);
            for episode in 0..episodes {
                let report = lights.play(&mut *simulator, &mut *controller, self.seed(), episode);
                played.push(report.map_err(Error::Run)?);
                bar.set(before + episode + 1);
            }
            findings.push(Finding { player, episodes: played });
            Ok(())
        };
        for subject in subjects {
            let player = subject.player(self.traffic).map_err(Error::Usage)?;
            add(player, subject.open(self.traffic))?;
        }
        let label = format!("plan of {}", self.controller);
        let keys = vec![(PLAN, json!(self.controller))];
        add(Player { label, keys, policies: None, others: None }, self.player(&made.programs))?;
        bar.finish();
        Ok(findings)
    }
}

fn delay_s(episode: &EpisodeReport) -> Option<f64> {
    episode.measures.system.iter().find(|(name, _)| name == "delay_s").map(|&(_, seconds)| seconds)
}

/// Returns the delay of a player in each episode, in seconds.
pub(super) fn delays_s(finding: &Finding) -> Vec<f64> {
    finding.episodes.iter().map(|episode| delay_s(episode).expect("SUMO measures the delay")).collect()
}

/// Returns the differences between two players, paired by episode.
pub(super) fn difference(finding: &Finding, reference: &Finding) -> Interval {
    Interval::of_differences(&delays_s(finding), &delays_s(reference))
}
