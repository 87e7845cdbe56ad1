//! `replay`: writes one episode as a folder that SUMO plays; on request opens it in sumo-gui or films it.

use std::path::PathBuf;

use anyhow::{Result, ensure};

use super::cast::ReplayedEpisode;
use super::plot::draw_recording;
use super::video::Video;
use crate::cli;
use crate::film::{Replay, Shape, check_screen, watch};
use dials_core::base::counted;
use dials_core::outside::quoted;
use dials_report::plot::About;
use dials_session::error::Error;
use dials_session::outputs::{check_apart, check_can_be_made, check_free, check_not_a_run};
use dials_session::places::{self, Existing};
use dials_session::terminal::answer;
use dials_traffic::sim::replay::{self, SPEED_COLOURS, Snapshot, view};

pub(crate) fn replay(args: &cli::ReplayArgs) -> dials_session::error::Result<()> {
    let existing = Existing::of_named(args.force);
    if !args.subject.exists() {
        // Told before anything about the outputs, which would only be the next error.
        ReplayedEpisode::choose(args).map_err(Error::Usage)?;
    }
    check_not_a_run("--out", &args.out).map_err(Error::Usage)?;
    let dir = places::place(&args.out, existing).map_err(Error::Usage)?;
    replay::check_place(&dir).map_err(Error::Usage)?;
    let places = [("--out", Some(&*args.out)), ("--video", args.video.as_deref()), ("--plot", args.plot.as_deref())];
    check_apart(&places).map_err(Error::Usage)?;
    args.plot.iter().try_for_each(|plot| check_free(plot, "--plot", existing)).map_err(Error::Usage)?;
    check_seconds_are_shown(args).map_err(Error::Usage)?;
    // Told now, not when the episode has been played.
    places.iter().filter_map(|(_, path)| *path).try_for_each(check_can_be_made).map_err(Error::Usage)?;
    let video = args.video.as_deref().map(|file| Video::asked_for(file, existing)).transpose().map_err(Error::Usage)?;
    if args.gui {
        check_screen().map_err(Error::Usage)?;
    }
    let episode = ReplayedEpisode::choose(args).map_err(Error::Usage)?;
    let about = About { subject: subject(args), seed: episode.seed_of_episodes() };
    let recording = episode.play().map_err(Error::Run)?;
    places::make(&dir, existing, |staged| {
        replay::write(&recording, staged.path())?;
        replay::check(&recording, staged.path())
    })
    .map_err(Error::Run)?;
    let config = replay::config_in(&dir);
    answer(format_args!(
        "written to {}: {}, {}; SUMO replays it to the last bit\nwatch it with: sumo-gui -c {}",
        dir.display(),
        counted(recording.steps.len(), "second"),
        counted(recording.entries.len(), "car"),
        quoted(&config)
    ))
    .map_err(Error::Run)?;
    if let Some(plot) = &args.plot {
        draw_recording(&recording, args.seconds.clone(), &about, (plot, existing)).map_err(Error::Run)?;
    }
    if let Some(video) = video {
        let steps = args.seconds.clone().unwrap_or(0..recording.steps.len());
        let snapshots = |pictures: &[PathBuf]| {
            let snapshot = |(step, file): (usize, &PathBuf)| Snapshot { file: file.clone(), step };
            view(&recording.roads, 0, &steps.clone().zip(pictures).map(snapshot).collect::<Vec<_>>())
        };
        let shape = match recording.roads.grid() {
            Some(grid) => Shape::Grid { columns: grid.cols(), rows: grid.rows() },
            None => {
                let [wide_m, tall_m] = recording.roads.extent_m();
                Shape::Map { wide_m, tall_m }
            }
        };
        let begin_s = recording.roads.begin_s();
        let (title, speeds) = (&*about.subject, &SPEED_COLOURS[..]);
        let settings = &snapshots;
        video.make(&Replay { title, speeds, config: &config, begin_s, steps: steps.clone(), shape, settings })?;
        answer(format_args!("wrote the film {}", video.file().display())).map_err(Error::Run)?;
    }
    if args.gui { watch(&config).map_err(Error::Run) } else { Ok(()) }
}

/// Returns an error if seconds are named, but no output that shows them.
fn check_seconds_are_shown(args: &cli::ReplayArgs) -> Result<()> {
    ensure!(
        args.seconds.is_none() || args.video.is_some() || args.plot.is_some(),
        "--seconds: is for --video and --plot, and a replay always has the whole episode; add one of them"
    );
    Ok(())
}

/// Returns who plays, for pictures.
fn subject(args: &cli::ReplayArgs) -> String {
    let name = args.subject.display();
    match (&args.controller, &args.local) {
        (Some(controller), _) => format!("controller {controller} on {name}"),
        (None, Some(agent)) => format!("agent {agent} of {name} in its local simulator"),
        (None, None) => format!("policies of {name}"),
    }
}
