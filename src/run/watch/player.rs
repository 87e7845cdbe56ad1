//! The process that plays for the map of `watch`: today's plan, and the newest policies of a run that may still train.
//!
//! It plays the episodes of the run's evaluations and measures each light. The run does not know of it: it writes nothing, and has
//! a lower priority than the training. Today's plan is played once, and again only if more episodes are asked for. SUMO may end a
//! process, so this is not done in the one that serves the page.

use std::io::{Write, stdin, stdout};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result as Anyhow};
use rustix::process::nice;

use super::messages::{Said, Wish};
use crate::run::lights::LightFigures;
use dials_core::domain::light_figures::TODAYS_PLAN;
use dials_core::domain::{Baseline, Controller, GlobalSimulator};
use dials_learn::evaluation::{Finding, Player};
use dials_learn::policy::Selection;
use dials_session::directory::{self, TrainedRun};
use dials_session::domains;
use dials_session::error::{Error, Result};
use dials_session::records::files;
use dials_traffic::controllers::PROGRAM;

/// Added to the nice value of this process, so that a training goes first where both need the same core.
const NICENESS: i32 = 10;

/// Plays what is asked for on standard input, until it is closed.
pub(in crate::run) fn play_for_the_map(run: &Path) -> Result<()> {
    // A system that refuses lets it play as fast as the training.
    let _ = nice(NICENESS);
    let mut map = Players { run: run.to_owned(), lights: LightFigures::for_a_city(), today: None };
    for line in stdin().lines() {
        let wish = line.context("standard input").and_then(|line| Ok(serde_json::from_str::<Wish>(&line)?));
        let said = wish.and_then(|wish| map.play(wish.episodes));
        say(&said.unwrap_or_else(|error| Said::Failed(format!("{error:#}")))).map_err(Error::Run)?;
    }
    Ok(())
}

fn say(said: &Said) -> Anyhow<()> {
    let mut out = stdout().lock();
    serde_json::to_writer(&mut out, said)?;
    out.write_all(b"\n")?;
    Ok(out.flush()?)
}

struct Players {
    run: PathBuf,
    lights: LightFigures,
    /// What today's plan did. Its lights are the first ones in `lights`.
    today: Option<Finding>,
}

impl Players {
    /// Plays this many episodes of the run's evaluations.
    fn play(&mut self, episodes: usize) -> Anyhow<Said> {
        let (config, domain) = directory::open_unchanged(&self.run, domains::open_untried)?;
        let seed = config.learning.evaluation.seed;
        let today = match self.today.take().filter(|today| today.episodes.len() == episodes) {
            Some(today) => today,
            None => {
                self.lights.keep(0);
                let Baseline { mut simulator, mut controller } = domain.baseline(PROGRAM)?;
                let player = player(PROGRAM, None);
                episodes_of(player, &mut *simulator, &mut *controller, &mut self.lights, seed, episodes)?
            }
        };
        self.lights.keep(1);
        let mut findings = vec![today];
        let mut steps = None;
        if self.run.join(files::POLICIES).is_file() {
            let run = directory::open_with(&self.run, domains::open_untried)?;
            steps = run.steps;
            findings.push(self.policies(&run, seed, episodes)?);
        }
        let city = self.lights.city(&config, &*domain, &findings, seed)?;
        self.today = Some(findings.swap_remove(0));
        Ok(Said::City { steps, city })
    }

    fn policies(&mut self, run: &TrainedRun, seed: u64, episodes: usize) -> Anyhow<Finding> {
        let mut simulator = run.domain.global_simulator()?;
        let mut controller = run.controller(Selection::Sampled);
        let player = player("policies", Some(Selection::Sampled));
        episodes_of(player, &mut *simulator, &mut controller, &mut self.lights, seed, episodes)
    }
}

fn player(label: &str, policies: Option<Selection>) -> Player {
    Player { label: label.to_owned(), keys: Vec::new(), policies, others: None }
}

fn episodes_of(
    player: Player,
    simulator: &mut dyn GlobalSimulator,
    controller: &mut dyn Controller,
    lights: &mut LightFigures,
    seed: u64,
    count: usize,
) -> Anyhow<Finding> {
    lights.begin(simulator, false)?;
    let mut episodes = Vec::with_capacity(count);
    for episode in 0..count {
        let who = if player.policies.is_none() { TODAYS_PLAN } else { "the newest policies" };
        say(&Said::Playing { who: who.to_owned(), episode: episode + 1, of: count })?;
        episodes.push(lights.play(simulator, controller, seed, episode)?);
    }
    Ok(Finding { player, episodes })
}
