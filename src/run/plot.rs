//! `--plot`: draws an evaluation, or the episode that `replay` records, as SVG files.

use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use crate::cli::OutputArgs;
use dials_core::domain::Domain;
use dials_core::domain::road_trace::RoadTrace;
use dials_core::outside::folder_of;
use dials_learn::evaluation::Evaluation;
use dials_report::drawing::Svg;
use dials_report::plot::{self, About};
use dials_session::config::RunConfig;
use dials_session::domains;
use dials_session::outputs::{self, check_seconds};
use dials_session::places::{self, Existing};
use dials_session::terminal::note;
use dials_traffic::Traffic;
use dials_traffic::events::EventLog;
use dials_traffic::sim::recording::{Recording, Tape};
use dials_traffic::sim::trace::route::Route;
use dials_traffic::sim::trace::trace;

/// The recording and the output directory of `--plot`. The pictures are drawn after the episodes.
pub(super) struct Plots {
    dir: PathBuf,
    existing: Existing,
    tape: Tape,
    /// Domain whose first episode is recorded on `tape`.
    traffic: Traffic,
    /// Way along which a scenario is drawn, if `--route` names one.
    route: Option<Route>,
    seconds: Option<Range<usize>>,
}

impl Plots {
    /// Checks that pictures can be made, before long work begins. `None`: the option was not given.
    pub(super) fn asked_for(output: &OutputArgs, config: &RunConfig) -> Result<Option<Plots>> {
        let Some(dir) = &output.plot else { return Ok(None) };
        let existing = Existing::of_named(output.force);
        outputs::check_free(dir, "--plot", existing)?;
        outputs::check_writable(folder_of(dir))?;
        let tape = Tape::default();
        let traffic = domains::open_recorded(config, &tape).context("--plot: nothing can be drawn")?;
        let route = output.route.as_deref().map(|edges| traffic.route(edges)).transpose().context("--route")?;
        let seconds = output.seconds.clone();
        seconds.iter().try_for_each(|seconds| check_seconds(seconds, traffic.seconds()))?;
        Ok(Some(Plots { dir: dir.clone(), existing, tape, traffic, route, seconds }))
    }

    /// Makes the episodes go into a log, too.
    pub(super) fn log_events(self, log: &EventLog) -> Plots {
        Plots { traffic: self.traffic.log_events(log), ..self }
    }

    pub(super) fn domain(&self) -> &dyn Domain {
        &self.traffic
    }

    pub(super) fn draw(&self, evaluation: &Evaluation, about: &About) -> Result<()> {
        let recording = self.tape.take().context("no episode was recorded")?;
        let trace = shown(&recording, self.route.as_ref(), self.seconds.clone())?;
        let mut pictures = of_episode(&trace, about)?;
        pictures.push(("returns.svg", plot::returns_map(&trace, &evaluation.returns, about)?));
        write(&pictures, &self.dir, self.existing)
    }
}

/// Draws the episode that `replay` recorded. `seconds`: those to show; `None`: all.
pub(super) fn draw_recording(
    recording: &Recording,
    seconds: Option<Range<usize>>,
    about: &About,
    (dir, existing): (&Path, Existing),
) -> Result<()> {
    write(&of_episode(&shown(recording, None, seconds)?, about)?, dir, existing)
}

fn shown(recording: &Recording, route: Option<&Route>, seconds: Option<Range<usize>>) -> Result<RoadTrace> {
    let trace = trace(recording, route)?;
    Ok(match seconds {
        Some(seconds) => trace.between(seconds),
        None => trace,
    })
}

fn of_episode(trace: &RoadTrace, about: &About) -> Result<Vec<(&'static str, Svg)>> {
    let mut pictures =
        vec![("queues.svg", plot::queues(trace, about)?), ("signals.svg", plot::signal_timing(trace, about)?)];
    // A grid has one per row, of which the middle one is drawn.
    match trace.corridors.get(trace.corridors.len().saturating_sub(1) / 2) {
        Some(corridor) => pictures.insert(0, ("space_time.svg", plot::space_time(corridor, &trace.seconds, about)?)),
        None => note(format_args!("note: no car entered, so there is no space_time.svg")),
    }
    Ok(pictures)
}

fn write(pictures: &[(&str, Svg)], dir: &Path, existing: Existing) -> Result<()> {
    places::make(dir, existing, |dir| {
        pictures.iter().try_for_each(|(name, svg)| dir.put(name, svg.file().as_bytes()))
    })?;
    let names: Vec<&str> = pictures.iter().map(|(name, _)| *name).collect();
    note(format_args!("drew {} into {}", names.join(", "), dir.display()));
    Ok(())
}
