//! Takes the pictures of a film: sumo-gui plays a replay on a virtual screen. Then joins them.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};

use super::captions::{PAPER, caption};
use super::picture_file::Picture;
use super::programs::{Program, Screen, log_file, logged, tied};
use super::{Format, Replay, Shape, sumo_gui};
use dials_session::terminal::check_stop;
use dials_session::terminal::counting::EpisodeBar;

const STEPS_PER_SECOND: u16 = 10;

/// Number of steps that sumo-gui plays after the last picture. If it ends with a picture, it often crashes (SUMO 1.15).
const REST_STEPS: usize = 30;

/// Longest time that sumo-gui may need for one picture. Usually it takes several per second.
const PATIENCE: Duration = Duration::from_secs(60);

/// Longest time that sumo-gui may need for a step before the first picture.
const UNSEEN: Duration = Duration::from_millis(500);

/// Width and height of sumo-gui's window minus those of the roads, in pixels (measured with SUMO 1.15).
const FRAME: (usize, usize) = (10, 215);

/// Takes one picture per step in the empty directory `folder`. Ends with an error soon after `stop` is set.
pub(crate) fn take(replay: &Replay, folder: &Path, stop: &AtomicBool) -> Result<Vec<PathBuf>> {
    let frames: Vec<PathBuf> = (0..replay.steps.len()).map(|number| folder.join(format!("{number:06}.png"))).collect();
    let settings = folder.join("view.xml");
    fs::write(&settings, (replay.settings)(&frames)).context("the temporary directory cannot be written to")?;
    let (width, height) = canvas(replay.shape);
    let (width, height) = (width + FRAME.0, height + FRAME.1);
    let screen = Screen::open(width, height, folder)?;
    let log = folder.join("sumo-gui.txt");
    let mut gui = tied(sumo_gui()?);
    gui.arg("-c").arg(replay.config).arg("--gui-settings-file").arg(&settings);
    let end_s = replay.begin_s + (replay.steps.end + REST_STEPS) as u64;
    gui.args(["--end", &end_s.to_string(), "--start", "--quit-on-end"]);
    gui.args(["--window-size", &format!("{width},{height}")]).env("DISPLAY", &screen.name);
    gui.stdout(Stdio::null()).stderr(log_file(&log)?);
    let patience = PATIENCE + UNSEEN * replay.steps.start as u32;
    let end = wait_for(&mut Program::start(gui)?, &frames, patience, stop)?;
    let missing = frames.iter().filter(|frame| !frame.exists()).count();
    // If all pictures are there, it does not matter how sumo-gui ended.
    ensure!(
        missing == 0,
        "sumo-gui took {} of {} pictures and {end}: {}",
        frames.len() - missing,
        frames.len(),
        logged(&log)
    );
    add_captions(replay, &frames, stop)?;
    Ok(frames)
}

/// Adds the captions to all pictures. On a busy machine sumo-gui takes the first pictures before its window has its size.
/// Such a picture becomes one without roads, so that all have one size.
fn add_captions(replay: &Replay, files: &[PathBuf], stop: &AtomicBool) -> Result<()> {
    let sizes = files.iter().map(|file| Picture::size(file)).collect::<Result<Vec<_>>>()?;
    let largest = sizes.iter().copied().max_by_key(|[width, height]| width * height).unwrap_or_default();
    for ((file, size), step) in files.iter().zip(sizes).zip(replay.steps.clone()) {
        check_stop(stop)?;
        let roads = if size == largest { Picture::read(file)? } else { Picture::plain(largest, PAPER) };
        caption(&roads, replay.title, replay.begin_s + step as u64, replay.speeds).write(file)?;
    }
    Ok(())
}

/// Waits until sumo-gui has ended, or has taken no picture for `patience`. Returns which of them it was, in words.
fn wait_for(gui: &mut Program, frames: &[PathBuf], patience: Duration, stop: &AtomicBool) -> Result<String> {
    let bar = EpisodeBar::of(frames.len(), "pictures");
    let (mut taken, mut since) = (0, Instant::now());
    let end = loop {
        check_stop(stop)?;
        if let Some(status) = gui.0.try_wait().context("cannot wait for sumo-gui")? {
            break format!("ended with {status}");
        }
        let new = frames[taken..].iter().take_while(|frame| frame.exists()).count();
        if new > 0 {
            (taken, since) = (taken + new, Instant::now());
            bar.set(taken);
        } else if since.elapsed() > patience {
            break format!("then none for {} s", patience.as_secs());
        }
        thread::sleep(Duration::from_millis(50));
    };
    bar.finish();
    Ok(end)
}

/// Returns width and height of the roads, in pixels. On a map the longer side is 1200; with a grid it grows to that.
fn canvas(shape: Shape) -> (usize, usize) {
    let (wide, tall, longer) = match shape {
        Shape::Grid { columns, rows } => {
            let (columns, rows) = (columns + 1, rows + 1);
            (columns as f64, rows as f64, (200 * columns.max(rows)).clamp(800, 1200))
        }
        Shape::Map { wide_m, tall_m } => (wide_m, tall_m, 1200),
    };
    let scale = longer as f64 / wide.max(tall);
    let side = |length: f64| ((length * scale) as usize).max(400).next_multiple_of(2);
    (side(wide), side(tall))
}

pub(crate) fn join(pictures: &[PathBuf], format: Format, film: &Path, stop: &AtomicBool) -> Result<()> {
    match format {
        Format::Gif => join_gif(pictures, film, stop),
        Format::Mp4 => join_mp4(pictures, film, stop),
    }
}

fn join_gif(pictures: &[PathBuf], film: &Path, stop: &AtomicBool) -> Result<()> {
    let bar = EpisodeBar::of(pictures.len(), "pictures joined");
    let [width, height] = Picture::size(&pictures[0])?;
    let (width, height) = (u16::try_from(width)?, u16::try_from(height)?);
    let file = File::create(film).context("the film cannot be written")?;
    let mut encoder = gif::Encoder::new(file, width, height, &[])?;
    encoder.set_repeat(gif::Repeat::Infinite)?;
    for (number, picture) in pictures.iter().enumerate() {
        check_stop(stop)?;
        let mut frame = gif::Frame::from_rgba_speed(width, height, &mut Picture::read(picture)?.pixels, 10);
        frame.delay = 100 / STEPS_PER_SECOND;
        encoder.write_frame(&frame).context("the film cannot be written")?;
        bar.set(number + 1);
    }
    bar.finish();
    Ok(())
}

/// Joins the pictures in the folder of the first one, with ffmpeg.
fn join_mp4(pictures: &[PathBuf], film: &Path, stop: &AtomicBool) -> Result<()> {
    let folder = pictures[0].parent().expect("pictures are in a folder");
    let [red, green, blue] = PAPER;
    // Every player can show an even width and height with this pixel format.
    let even = format!("pad=ceil(iw/2)*2:ceil(ih/2)*2:color=0x{red:02x}{green:02x}{blue:02x}");
    let log = folder.join("ffmpeg.txt");
    let mut ffmpeg = tied("ffmpeg");
    ffmpeg.args(["-loglevel", "error", "-framerate", &STEPS_PER_SECOND.to_string(), "-i"]);
    ffmpeg.arg(folder.join("%06d.png")).args(["-vf", &even, "-pix_fmt", "yuv420p", "-movflags", "+faststart"]);
    ffmpeg.arg(film).stdout(Stdio::null()).stderr(log_file(&log)?);
    let mut ffmpeg = Program::start(ffmpeg)?;
    let status = loop {
        check_stop(stop)?;
        if let Some(status) = ffmpeg.0.try_wait().context("cannot wait for ffmpeg")? {
            break status;
        }
        thread::sleep(Duration::from_millis(20));
    };
    ensure!(status.success(), "ffmpeg failed ({status}): {}", logged(&log));
    check_stop(stop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_was_taken_too_early_becomes_as_large_as_the_others() {
        let folder = tempfile::tempdir().unwrap();
        let files = ["a.png", "b.png"].map(|name| folder.path().join(name));
        Picture::plain([10, 10], [1, 2, 3]).write(&files[0]).unwrap();
        Picture::plain([400, 300], [1, 2, 3]).write(&files[1]).unwrap();
        let replay = Replay {
            title: "a",
            speeds: &[],
            config: Path::new(""),
            steps: 0..2,
            begin_s: 0,
            shape: Shape::Grid { columns: 2, rows: 2 },
            settings: &|_| String::new(),
        };
        add_captions(&replay, &files, &AtomicBool::new(false)).unwrap();
        let [early, late] = files.map(|file| Picture::read(&file).unwrap());
        assert_eq!([early.width, early.height], [late.width, late.height]);
        assert_eq!(
            [&early, &late].map(|picture| picture.colours().nth(150 * 400 + 200)),
            [Some(&PAPER[..]), Some(&[1, 2, 3])]
        );
    }

    #[test]
    fn nobody_waits_for_ever_for_a_picture() {
        let mut command = tied("sleep");
        command.arg("600");
        let mut hung = Program::start(command).unwrap();
        let frames = [PathBuf::from("/no/such.png")];
        let wait = |hung: &mut Program, stop| wait_for(hung, &frames, Duration::ZERO, &AtomicBool::new(stop));
        assert_eq!(wait(&mut hung, false).unwrap(), "then none for 0 s");
        assert_eq!(wait(&mut hung, true).unwrap_err().to_string(), "stopped");
        let place = PathBuf::from(format!("/proc/{}", hung.0.id()));
        assert!(place.exists());
        drop(hung);
        assert!(!place.exists());
    }
}
