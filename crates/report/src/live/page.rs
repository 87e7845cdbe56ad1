//! The page: a table of the runs with their progress, the figures of a report, and maps of the agents.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::Result;

use super::status::{RunStatus, State};
use crate::city::DelayMap;
use crate::compared_figures;
use crate::document::{Block, Figure, Table, to_html};
use crate::drawing::Svg;
use crate::words::{duration, figure, of_versions};
use dials_core::outside::Printable;
use dials_session::records::files::{AIP_LOSS, RETURNS, RUN, TIMING};
use dials_session::records::find::{DEPTH, Found, LeftOut, find};
use dials_session::records::run_record::{EvaluationRecord, RunRecord, Status};

const NONE: &str = "-";
/// Most maps on the page. Runs that are being written come first.
const MAPS: usize = 4;
/// Beginnings of the names of figures about the ends of runs. They are shown when all runs have ended.
const OF_ENDS: [&str; 2] = ["final_return", "ablation"];

/// Draws the maps of runs.
pub trait Maps {
    /// Draws the agents of a run at their places, in the colours of their returns; `None` if the report's own picture of them says
    /// as much.
    fn returns(&mut self, run: &RunRecord) -> Option<Svg>;

    /// Returns where cars lose time, beside today's plan, as far as it is known now; `None` if the run has no such map.
    fn delays(&mut self, run: &RunRecord) -> Option<DelayView>;
}

/// Where cars lose time in a run.
pub struct DelayView {
    /// Sentences: the step that the map belongs to, and what is being played.
    pub words: String,
    /// `None`: nothing has been played yet.
    pub map: Option<DelayMap>,
}

/// The view of a folder. It reads the runs again only when one of their files has changed.
pub struct Page {
    folder: PathBuf,
    maps: Box<dyn Maps>,
    /// Files of the runs as they were when `runs` and `figures` were made.
    seen: Option<Vec<Trace>>,
    runs: Vec<RunRecord>,
    left_out: Vec<LeftOut>,
    /// Figures, as HTML.
    figures: String,
    /// The runs that have a map, by their place in `runs`, with the map of their returns as HTML.
    mapped: Vec<(usize, String)>,
}

/// A file at a time: path, length in bytes and time of its last change.
type Trace = (PathBuf, u64, Option<SystemTime>);

impl Page {
    /// `folder`: a run directory, or a folder of some.
    pub fn new(folder: &Path, maps: Box<dyn Maps>) -> Page {
        let (folder, figures) = (folder.to_owned(), String::new());
        Page { folder, maps, seen: None, runs: Vec::new(), left_out: Vec::new(), figures, mapped: Vec::new() }
    }

    pub(crate) fn now(&mut self) -> String {
        let mut there = Vec::new();
        traces(&self.folder, DEPTH, &mut there);
        if self.seen.as_ref() != Some(&there) {
            self.seen = Some(there);
            self.look().unwrap_or_else(|error| self.figures = to_html(&[Block::Paragraph(format!("{error:#}"))]));
        }
        let mut blocks = vec![Block::Table(progress(&self.runs))];
        let mut warnings: Vec<String> = self.left_out.iter().map(ToString::to_string).collect();
        warnings.extend(of_versions(self.runs.iter().flat_map(|run| run.about.sumo())));
        if !warnings.is_empty() {
            blocks.push(Block::List(warnings));
        }
        let (mut before, mut behind) = (to_html(&blocks), String::new());
        for (place, returns) in &self.mapped {
            let run = &self.runs[*place];
            let delays = self.maps.delays(run);
            if let Some(DelayView { words, .. }) = &delays
                && !words.is_empty()
            {
                let name = Printable(run.dir.display());
                before += &to_html(&[Block::Paragraph(format!("{name}: {words}"))]);
            }
            match delays.and_then(|view| view.map) {
                Some(map) => before += &map.html,
                None => behind += returns,
            }
        }
        before + &self.figures + &behind
    }

    /// Reads the runs, and draws what only changes with their files.
    fn look(&mut self) -> Result<()> {
        let Found { runs, unreadable, .. } = find(std::slice::from_ref(&self.folder))?;
        (self.runs, self.left_out) = (runs, unreadable);
        self.figures.clear();
        self.mapped.clear();
        let evaluated = self.runs.iter().enumerate().filter(|(_, run)| !run.evaluations.is_empty());
        let mut order: Vec<(RunStatus, usize)> = evaluated.map(|(place, run)| (RunStatus::of(run), place)).collect();
        order.sort_by_key(|(status, _)| status.state != State::Running);
        let found = Found { runs: self.runs.clone(), ..Found::default() };
        let mut figures = compared_figures(found)?;
        if self.runs.iter().any(|run| run.status() != Status::Finished) {
            figures.retain(|figure| !OF_ENDS.iter().any(|of_end| figure.name.starts_with(of_end)));
        }
        for (_, place) in order.into_iter().take(MAPS) {
            let run = &self.runs[place];
            let caption = format!("{}: every agent at the last evaluation.", Printable(run.dir.display()));
            let returns = self.maps.returns(run).map(|svg| Figure { name: "map".to_owned(), caption, svg });
            self.mapped.push((place, returns.map_or(String::new(), |map| to_html(&[Block::Figure(map)]))));
        }
        let mut blocks: Vec<Block> = figures.into_iter().map(Block::Figure).collect();
        if blocks.is_empty() {
            blocks.push(Block::Paragraph("The curves begin with the first evaluation.".to_owned()));
        }
        self.figures = to_html(&blocks);
        Ok(())
    }
}

fn progress(runs: &[RunRecord]) -> Table {
    let row = |run: &RunRecord| {
        let status = RunStatus::of(run);
        let state = match status.state {
            State::Running => "running",
            State::Finished => "finished",
            State::Stopped => "stopped",
        };
        let about = if status.about_steps > status.steps { "about " } else { "" };
        let (first, last) = (run.evaluations.first(), run.evaluations.last());
        let mean = |evaluation: Option<&EvaluationRecord>| {
            evaluation.map_or(NONE.to_owned(), |evaluation| figure(evaluation.all.mean))
        };
        let aip = status.aip_loss.map_or(NONE.to_owned(), |[loss, marginals]| format!("{loss:.3} ({marginals:.3})"));
        vec![
            run.dir.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            state.to_owned(),
            format!("{about}{} of {}", status.about_steps, status.end),
            status.left.map_or(NONE.to_owned(), |left| duration(left.as_secs_f64())),
            last.map_or(NONE.to_owned(), |last| last.steps.to_string()),
            status.agent_steps_per_s.map_or(NONE.to_owned(), |speed| format!("{speed:.0}")),
            mean(first),
            mean(last),
            aip,
        ]
    };
    Table {
        caption:
            "Steps: timesteps per agent; those of a run that has stopped are of its last checkpoint. Speed: timesteps \
                  of all agents per second of the last period, with its evaluation and AIPs. AIP: cross-entropy, and \
                  that of constants in brackets; lower is better. As on the terminal it is of new episodes, or of \
                  held-out ones if the AIPs have been trained since."
                .to_owned(),
        header: ["run", "state", "steps", "time left", "evaluated at", "speed", "return at first", "return now", "AIP"]
            .map(str::to_owned)
            .to_vec(),
        rows: runs.iter().map(row).collect(),
    }
}

fn traces(folder: &Path, depth: usize, into: &mut Vec<Trace>) {
    let Ok(entries) = fs::read_dir(folder) else { return };
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    for path in paths {
        let Ok(about) = path.symlink_metadata() else { continue };
        if about.is_dir() && depth > 0 {
            traces(&path, depth - 1, into);
        } else if path.file_name().is_some_and(|name| [RETURNS, AIP_LOSS, TIMING, RUN].iter().any(|own| name == *own)) {
            into.push((path, about.len(), about.modified().ok()));
        }
    }
}
