//! The map of delays on the page: for each run a process that plays for it, and what it said last.

use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread;

use anyhow::{Context, Result};

use super::messages::{Said, Wish};
use dials_report::city::DelayMap;
use dials_report::live::page::DelayView;
use dials_session::domains;
use dials_session::parent::END_WITH;
use dials_session::records::run_record::{RunRecord, Status};

/// The maps of the runs on the page. One process plays at a time, so that trainings keep their cores.
#[derive(Default)]
pub(super) struct DelayMaps {
    players: BTreeMap<PathBuf, MapPlayer>,
}

/// An evaluation of a run: its timesteps per agent and its number of episodes.
type Evaluated = (u64, usize);

struct MapPlayer {
    /// Its process; `None`: it has ended, or could not be started.
    process: Option<(Child, ChildStdin)>,
    said: Receiver<Said>,
    /// Evaluation for which it was last asked to play.
    asked: Option<Evaluated>,
    /// What it is doing.
    doing: Option<String>,
    drawn: Option<Drawn>,
    /// Why the newest map is missing.
    failed: Option<String>,
}

struct Drawn {
    map: DelayMap,
    /// Timesteps per agent of the policies; `None`: it shows today's plan alone.
    steps: Option<u64>,
}

impl DelayMaps {
    /// Returns what is known now, and lets the newest policies play if there was an evaluation since. `None`: the run is not
    /// on a scenario, or has no evaluation.
    pub(super) fn of(&mut self, run: &RunRecord) -> Option<DelayView> {
        let last = run.evaluations.last()?;
        if !domains::is_scenario(&run.config) {
            return None;
        }
        self.players.values_mut().for_each(MapPlayer::listen);
        let is_busy = self.players.values().any(|player| player.doing.is_some());
        let evaluated = (last.steps, last.episode_returns.len());
        let player = self.players.entry(run.dir.clone()).or_insert_with(|| MapPlayer::start(&run.dir));
        if player.asked != Some(evaluated) && !is_busy {
            player.ask(evaluated);
        }
        Some(player.view(run.status() == Status::Finished, evaluated))
    }
}

impl MapPlayer {
    fn start(run: &Path) -> MapPlayer {
        let (say, said) = channel();
        let mut player = MapPlayer { process: None, said, asked: None, doing: None, drawn: None, failed: None };
        // Not the path of the program: another build may be there by now.
        let mut command = Command::new("/proc/self/exe");
        command.args([END_WITH, &std::process::id().to_string(), "--quiet", "map-player"]).arg(run);
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null());
        match command.spawn() {
            Err(error) => player.failed = Some(format!("no process to play it can be started: {error}")),
            Ok(mut child) => {
                let (input, output) = (child.stdin.take(), child.stdout.take());
                let (input, output) = (input.expect("it was asked for"), output.expect("it was asked for"));
                player.process = Some((child, input));
                thread::spawn(move || {
                    for line in BufReader::new(output).lines().map_while(Result::ok) {
                        let said = serde_json::from_str(&line).unwrap_or_else(|error| Said::Failed(error.to_string()));
                        if say.send(said).is_err() {
                            return;
                        }
                    }
                });
            }
        }
        player
    }

    fn ask(&mut self, evaluated: Evaluated) {
        self.asked = Some(evaluated);
        let Some((_, input)) = &mut self.process else { return };
        let written = wish(input, evaluated.1);
        (self.doing, self.failed) = match written {
            Ok(()) => (Some("today's plan and the newest policies are about to play for the map".to_owned()), None),
            Err(error) => (None, Some(format!("{error:#}"))),
        };
    }

    /// Takes what the process has said since the last call.
    fn listen(&mut self) {
        while let Ok(said) = self.said.try_recv() {
            match said {
                Said::Playing { who, episode, of } => {
                    self.doing = Some(format!("{who} is playing episode {episode} of {of} for the map"));
                }
                Said::City { steps, city } => {
                    self.doing = None;
                    let policies = match steps {
                        Some(steps) => format!("the policies of step {steps}"),
                        None => "the newest policies".to_owned(),
                    };
                    match DelayMap::of(&city.to_string(), &policies) {
                        Ok(map) => self.drawn = Some(Drawn { map, steps }),
                        Err(error) => self.failed = Some(format!("{error:#}")),
                    }
                }
                Said::Failed(why) => (self.doing, self.failed) = (None, Some(why)),
            }
        }
        let has_ended = |(child, _): &mut (Child, ChildStdin)| child.try_wait().ok().flatten();
        if let Some(status) = self.process.as_mut().and_then(has_ended) {
            self.process = None;
            (self.doing, self.failed) = (None, Some(format!("the process that played it has ended ({status})")));
        }
    }

    fn view(&self, is_finished: bool, (steps, _): Evaluated) -> DelayView {
        let mut words = Vec::new();
        match &self.drawn {
            Some(Drawn { steps: Some(of), .. }) if is_finished && *of == steps => {
                words.push(format!("Map of step {of}, the end of this run: its final policies."));
            }
            Some(Drawn { steps: Some(of), .. }) => words.push(format!("Map of step {of}. It is not final.")),
            Some(Drawn { steps: None, .. }) => words.push("Map of today's plan: there are no policies yet.".to_owned()),
            None => (),
        }
        words.extend(self.doing.as_ref().map(|doing| format!("Now {doing} (newest evaluation: step {steps}).")));
        words.extend(self.failed.as_ref().map(|why| format!("No map of step {steps}: {why}.")));
        DelayView { words: words.join(" "), map: self.drawn.as_ref().map(|drawn| drawn.map.clone()) }
    }
}

fn wish(input: &mut ChildStdin, episodes: usize) -> Result<()> {
    let line = serde_json::to_string(&Wish { episodes })? + "\n";
    input.write_all(line.as_bytes()).and_then(|()| input.flush()).context("the process that plays it does not listen")
}

impl Drop for MapPlayer {
    fn drop(&mut self) {
        if let Some((child, _)) = &mut self.process {
            // It may have ended before.
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns what the page says with a map of this step.
    fn words(of: Option<u64>, doing: Option<&str>, failed: Option<&str>, is_finished: bool) -> String {
        let figures = r#"{"delay_s": {"mean": 20.0, "half_width_95": 1.0}}"#;
        let player = |learned| {
            format!(
                r#"{{"label": "a", "learned": {learned}, "figures": {figures}, "differences": {figures}, "lights": []}}"#
            )
        };
        let city = format!(
            r#"{{"seed": 0, "episodes": 2, "left_out": [], "warnings": [], "settings": {{}}, "streets": [], "players": [{}, {}]}}"#,
            player(false),
            player(true)
        );
        let map = DelayMap::of(&city, "the policies").unwrap();
        let player = MapPlayer {
            process: None,
            said: channel().1,
            asked: None,
            doing: doing.map(str::to_owned),
            drawn: Some(Drawn { map, steps: of }),
            failed: failed.map(str::to_owned),
        };
        player.view(is_finished, (200, 2)).words
    }

    #[test]
    fn nothing_is_called_final_before_it_is() {
        assert_eq!(words(Some(200), None, None, true), "Map of step 200, the end of this run: its final policies.");
        assert_eq!(words(Some(200), None, None, false), "Map of step 200. It is not final.");
        assert_eq!(
            words(Some(100), Some("it plays"), None, true),
            "Map of step 100. It is not final. Now it plays (newest evaluation: step 200)."
        );
        assert_eq!(words(None, None, None, false), "Map of today's plan: there are no policies yet.");
        assert_eq!(
            words(Some(100), None, Some("SUMO has ended"), false),
            "Map of step 100. It is not final. No map of step 200: SUMO has ended."
        );
    }
}
