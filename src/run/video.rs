//! `replay --video`: sumo-gui plays a replay on a screen that nobody sees, a picture per step, joined to a film.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use rustix::process::{Pid, Signal, kill_process_group};

use super::places::{self, Existing};
use super::progress::EpisodeBar;
use super::stop::stop_on_signals;
use super::terminal::on_the_path;
use crate::error::{self, Error};
use crate::records::atomic::{folder_of, write_beside};
use crate::traffic::grid::Grid;
use crate::traffic::recording::Recording;
use crate::traffic::replay::{Snapshot, view};

pub const SUMO_GUI: &str = "sumo-gui";
const XVFB: &str = "Xvfb";
const SETPRIV: &str = "setpriv";

/// Steps that are shown in a second.
const STEPS_PER_SECOND: u16 = 10;

/// Steps that sumo-gui plays beyond the last picture: where it ends with one it often crashes (SUMO 1.15).
const REST_STEPS: usize = 30;

/// How long sumo-gui may take for a picture; it takes some of them in a second.
const PATIENCE: Duration = Duration::from_secs(60);

/// What sumo-gui's window has beside the roads, in pixels (measured on SUMO 1.15).
const FRAME: (usize, usize) = (10, 215);

/// A film that can be made: tools and place are there.
pub struct Video {
    file: PathBuf,
    format: Format,
    existing: Existing,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Format {
    Gif,
    Mp4,
}

impl Video {
    /// Checks tools and place before any work begins.
    pub fn asked_for(file: &Path, existing: Existing) -> Result<Video> {
        let format = match file.extension().and_then(|ending| ending.to_str()) {
            Some("gif") => Format::Gif,
            Some("mp4") => Format::Mp4,
            _ => bail!("--video {}: must end in .gif or .mp4", file.display()),
        };
        let mut tools = vec![(SUMO_GUI, "sumo"), (XVFB, "xvfb"), (SETPRIV, "util-linux")];
        if format == Format::Mp4 {
            tools.push(("ffmpeg", "ffmpeg"));
        }
        for (tool, package) in tools {
            let gif = if tool == "ffmpeg" { ", or film a .gif, which needs none" } else { "" };
            let way_out = format!("install Debian's package {package}{gif}");
            ensure!(on_the_path(tool).is_some(), "--video: {tool} is not on the PATH: {way_out}");
        }
        ensure!(
            existing != Existing::Refuse || places::is_free(file),
            "{}: exists already; name another one with --video, or move it aside with --force",
            file.display()
        );
        let folder = folder_of(file);
        ensure!(folder.is_dir(), "{}: no such directory for the film", folder.display());
        Ok(Video { file: file.to_owned(), format, existing })
    }

    pub fn file(&self) -> &Path {
        &self.file
    }

    /// Films the replay of `recording` that `config` plays. Ctrl-C ends that and leaves nothing behind.
    pub fn make(&self, recording: &Recording, config: &Path) -> error::Result<()> {
        let stop = stop_on_signals(|_| ()).map_err(Error::Run)?;
        match self.film(recording, config, &stop) {
            Err(_) if stop.load(Ordering::Relaxed) => {
                Err(Error::Interrupted(format!("stopped; {} was not made", self.file.display())))
            }
            done => done.map_err(Error::Run),
        }
    }

    fn film(&self, recording: &Recording, config: &Path, stop: &AtomicBool) -> Result<()> {
        let room = tempfile::tempdir().context("no temporary directory for the pictures")?;
        let frames = take_pictures(recording, config, room.path(), stop)?;
        write_beside(&self.file, |film| {
            match self.format {
                Format::Gif => join_to_gif(&frames, film, stop)?,
                Format::Mp4 => join_to_mp4(room.path(), film)?,
            }
            // Now that the new one is whole.
            if self.existing == Existing::MoveAside && !places::is_free(&self.file) {
                places::tell_moved(&self.file, &places::move_aside(&self.file)?);
            }
            Ok(())
        })
    }
}

fn picture(number: usize) -> String {
    format!("{number:06}.png")
}

/// Lets sumo-gui play and take a picture before every step.
fn take_pictures(recording: &Recording, config: &Path, room: &Path, stop: &AtomicBool) -> Result<Vec<PathBuf>> {
    let frames: Vec<PathBuf> = (0..recording.steps.len()).map(|step| room.join(picture(step))).collect();
    let snapshots: Vec<Snapshot> =
        frames.iter().enumerate().map(|(step, file)| Snapshot { file: file.clone(), step }).collect();
    let settings = room.join("view.xml");
    fs::write(&settings, view(0, &snapshots)).context("the temporary directory cannot be written to")?;
    let (width, height) = canvas(recording.roads.grid);
    let (width, height) = (width + FRAME.0, height + FRAME.1);
    let screen = Screen::open(width, height, room)?;
    let said = room.join("said.txt");
    let mut gui = tied(SUMO_GUI);
    gui.arg("-c").arg(config).arg("--gui-settings-file").arg(&settings);
    gui.args(["--end", &(frames.len() + REST_STEPS).to_string(), "--start", "--quit-on-end"]);
    gui.args(["--window-size", &format!("{width},{height}")]).env("DISPLAY", &screen.name);
    gui.stdout(Stdio::null()).stderr(listener(&said)?);
    let end = wait_for(&mut Helper::start(gui)?, &frames, PATIENCE, stop)?;
    let missing = frames.iter().filter(|frame| !frame.exists()).count();
    // How it ended is nothing to us where all pictures are there.
    ensure!(
        missing == 0,
        "sumo-gui took {} of {} pictures and {end}: {}",
        frames.len() - missing,
        frames.len(),
        fs::read_to_string(&said).unwrap_or_default().trim()
    );
    Ok(frames)
}

fn listener(file: &Path) -> Result<File> {
    File::create(file).context("the temporary directory cannot be written to")
}

/// Waits until sumo-gui has ended, or has taken no picture for so long; tells which.
fn wait_for(gui: &mut Helper, frames: &[PathBuf], patience: Duration, stop: &AtomicBool) -> Result<String> {
    let bar = EpisodeBar::of(frames.len(), "pictures");
    let (mut taken, mut since) = (0, Instant::now());
    let end = loop {
        check(stop)?;
        if let Some(status) = gui.0.try_wait().context("sumo-gui cannot be waited for")? {
            break format!("ended with {status}");
        }
        let new = frames[taken..].iter().take_while(|frame| frame.exists()).count();
        if new > 0 {
            (taken, since) = (taken + new, Instant::now());
            bar.set(taken);
        } else if since.elapsed() > patience {
            break format!("no other for {} s", patience.as_secs());
        }
        thread::sleep(Duration::from_millis(50));
    };
    bar.finish();
    Ok(end)
}

/// An error after Ctrl-C.
fn check(stop: &AtomicBool) -> Result<()> {
    ensure!(!stop.load(Ordering::Relaxed), "stopped");
    Ok(())
}

/// A program that ends with this one, however that ends: setpriv asks the system for it and then becomes the program.
fn tied(program: &str) -> Command {
    let mut command = Command::new(SETPRIV);
    // Ctrl-C at the terminal is for this program, which ends its helpers in its own time.
    command.args(["--pdeathsig", "TERM", "--", program]).process_group(0).stdin(Stdio::null());
    command
}

/// A program that works for this one. Dropping it ends it and what it has started.
struct Helper(Child);

impl Helper {
    fn start(mut command: Command) -> Result<Helper> {
        Ok(Helper(command.spawn().context("setpriv could not be started")?))
    }
}

impl Drop for Helper {
    fn drop(&mut self) {
        // First in a way that lets it clear up, as Xvfb does.
        for signal in [Signal::TERM, Signal::KILL] {
            for _ in 0..40 {
                if !matches!(self.0.try_wait(), Ok(None)) {
                    return;
                }
                let _ = kill_process_group(Pid::from_child(&self.0), signal);
                thread::sleep(Duration::from_millis(50));
            }
        }
    }
}

/// A screen that nobody sees.
struct Screen {
    /// Among X's screens.
    name: String,
    _server: Helper,
}

impl Screen {
    fn open(width: usize, height: usize, room: &Path) -> Result<Screen> {
        let said = room.join("screen.txt");
        let mut server = tied(XVFB);
        // It takes a number that is free and writes it to its standard output when it is ready.
        server.args(["-displayfd", "1", "-nolisten", "tcp", "-screen", "0", &format!("{width}x{height}x24")]);
        server.stdout(Stdio::piped()).stderr(listener(&said)?);
        let mut server = Helper::start(server)?;
        let mut number = String::new();
        let out = server.0.stdout.take().expect("it is piped");
        BufReader::new(out).read_line(&mut number).context("Xvfb cannot be heard")?;
        let said = fs::read_to_string(&said).unwrap_or_default();
        ensure!(!number.trim().is_empty(), "Xvfb opened no screen: {}", said.trim());
        Ok(Screen { name: format!(":{}", number.trim()), _server: server })
    }
}

/// Pixels of the roads: the longer side grows with the grid, within what a film can have.
fn canvas(grid: Grid) -> (usize, usize) {
    let (cols, rows) = (grid.cols() + 1, grid.rows() + 1);
    let scale = (200 * cols.max(rows)).clamp(800, 1200) as f64 / cols.max(rows) as f64;
    let side = |count: usize| ((count as f64 * scale) as usize).max(400).next_multiple_of(2);
    (side(cols), side(rows))
}

fn join_to_gif(frames: &[PathBuf], film: &Path, stop: &AtomicBool) -> Result<()> {
    let bar = EpisodeBar::of(frames.len(), "pictures joined");
    let file = File::create(film).context("the film cannot be written")?;
    let mut encoder: Option<gif::Encoder<File>> = None;
    for (number, frame) in frames.iter().enumerate() {
        check(stop)?;
        let (width, height, mut pixels) = read_picture(frame)?;
        let encoder = match &mut encoder {
            Some(encoder) => encoder,
            None => {
                let mut first = gif::Encoder::new(file.try_clone()?, width, height, &[])?;
                first.set_repeat(gif::Repeat::Infinite)?;
                encoder.insert(first)
            }
        };
        let mut frame = gif::Frame::from_rgba_speed(width, height, &mut pixels, 10);
        frame.delay = 100 / STEPS_PER_SECOND;
        encoder.write_frame(&frame).context("the film cannot be written")?;
        bar.set(number + 1);
    }
    bar.finish();
    Ok(())
}

/// Width, height and pixels of four bytes.
fn read_picture(path: &Path) -> Result<(u16, u16, Vec<u8>)> {
    let failed = || format!("{}: is no picture of sumo-gui's", path.display());
    let file = BufReader::new(File::open(path).with_context(failed)?);
    let mut decoder = png::Decoder::new(file);
    decoder.set_transformations(png::Transformations::ALPHA | png::Transformations::STRIP_16);
    let mut reader = decoder.read_info().with_context(failed)?;
    let mut pixels = vec![0; reader.output_buffer_size().with_context(failed)?];
    let info = reader.next_frame(&mut pixels).with_context(failed)?;
    ensure!(info.color_type == png::ColorType::Rgba, "{}: is not in colour", path.display());
    Ok((u16::try_from(info.width)?, u16::try_from(info.height)?, pixels))
}

fn join_to_mp4(room: &Path, film: &Path) -> Result<()> {
    let output = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-framerate", &STEPS_PER_SECOND.to_string(), "-i"])
        .arg(room.join("%06d.png"))
        // What every player shows: sides of even length, and this format of pixels.
        .args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2", "-pix_fmt", "yuv420p", "-movflags", "+faststart"])
        .arg(film)
        .stdin(Stdio::null())
        .output()
        .context("ffmpeg could not be started")?;
    let said = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "ffmpeg failed ({}): {}", output.status, said.trim());
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nobody_waits_for_ever_for_a_picture() {
        let mut command = tied("sleep");
        command.arg("600");
        let mut hung = Helper::start(command).unwrap();
        let frames = [PathBuf::from("/no/such.png")];
        let wait = |hung: &mut Helper, stop| wait_for(hung, &frames, Duration::ZERO, &AtomicBool::new(stop));
        assert_eq!(wait(&mut hung, false).unwrap(), "no other for 0 s");
        assert_eq!(wait(&mut hung, true).unwrap_err().to_string(), "stopped");
        let place = PathBuf::from(format!("/proc/{}", hung.0.id()));
        assert!(place.exists());
        drop(hung);
        assert!(!place.exists());
    }
}
