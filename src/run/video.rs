//! `replay --video`: sumo-gui plays a replay on a screen that nobody sees, a picture per step, joined to a film.

use std::fs::{self, File};
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};

use super::directory::{self, Existing};
use super::progress::EpisodeBar;
use super::terminal::on_the_path;
use crate::traffic::grid::Grid;
use crate::traffic::recording::Recording;
use crate::traffic::replay::{Snapshot, view};

/// Steps that are shown in a second.
const STEPS_PER_SECOND: u16 = 10;

/// Steps that sumo-gui plays beyond the last picture: where it ends with one it often crashes (SUMO 1.15).
const REST_STEPS: usize = 30;

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
        let mut tools = vec![("sumo-gui", "sumo"), ("xvfb-run", "xvfb"), ("xauth", "xauth")];
        if format == Format::Mp4 {
            tools.push(("ffmpeg", "ffmpeg"));
        }
        for (tool, package) in tools {
            let gif = if tool == "ffmpeg" { ", or film a .gif, which needs none" } else { "" };
            let way_out = format!("install Debian's package {package}{gif}");
            ensure!(on_the_path(tool).is_some(), "--video: {tool} is not on the PATH: {way_out}");
        }
        ensure!(
            existing != Existing::Refuse || directory::is_free(file),
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

    /// Films the replay of `recording` that `config` plays.
    pub fn make(&self, recording: &Recording, config: &Path) -> Result<()> {
        let room = tempfile::tempdir().context("no temporary directory for the pictures")?;
        let frames = take_pictures(recording, config, room.path())?;
        // Beside its place, so that a film is there whole or not at all.
        let beside = tempfile::Builder::new().prefix(".new-").tempdir_in(folder_of(&self.file));
        let beside = beside.with_context(|| format!("{}: cannot be written", self.file.display()))?;
        let film = beside.path().join(if self.format == Format::Gif { "film.gif" } else { "film.mp4" });
        match self.format {
            Format::Gif => join_to_gif(&frames, &film)?,
            Format::Mp4 => join_to_mp4(room.path(), &film)?,
        }
        if self.existing == Existing::MoveAside && !directory::is_free(&self.file) {
            directory::tell_moved(&self.file, &directory::move_aside(&self.file)?);
        }
        fs::rename(&film, &self.file).with_context(|| format!("{}: cannot be written", self.file.display()))
    }
}

fn folder_of(file: &Path) -> &Path {
    file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

fn picture(number: usize) -> String {
    format!("{number:06}.png")
}

/// Lets sumo-gui play and take a picture before every step.
fn take_pictures(recording: &Recording, config: &Path, room: &Path) -> Result<Vec<PathBuf>> {
    let frames: Vec<PathBuf> = (0..recording.steps.len()).map(|step| room.join(picture(step))).collect();
    let snapshots: Vec<Snapshot> =
        frames.iter().enumerate().map(|(step, file)| Snapshot { file: file.clone(), step }).collect();
    let settings = room.join("view.xml");
    fs::write(&settings, view(0, &snapshots)).context("the temporary directory cannot be written to")?;
    let (width, height) = canvas(recording.roads.grid);
    let (width, height) = (width + FRAME.0, height + FRAME.1);
    let said = room.join("said.txt");
    let listener = || File::create(&said).context("the temporary directory cannot be written to");
    let mut child = Command::new("xvfb-run")
        .args(["-a", "-s", &format!("-screen 0 {width}x{height}x24"), "sumo-gui", "-c"])
        .arg(config)
        .arg("--gui-settings-file")
        .arg(&settings)
        .args(["--end", &(frames.len() + REST_STEPS).to_string(), "--start", "--quit-on-end"])
        .args(["--window-size", &format!("{width},{height}")])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(listener()?)
        .spawn()
        .context("xvfb-run could not be started")?;
    let bar = EpisodeBar::of(frames.len(), "pictures");
    let mut taken = 0;
    let status = loop {
        if let Some(status) = child.try_wait().context("sumo-gui cannot be waited for")? {
            break status;
        }
        taken += frames[taken..].iter().take_while(|frame| frame.exists()).count();
        bar.set(taken);
        thread::sleep(Duration::from_millis(50));
    };
    bar.finish();
    let missing = frames.iter().filter(|frame| !frame.exists()).count();
    // How it ended is nothing to us where all pictures are there.
    ensure!(
        missing == 0,
        "sumo-gui took {} of {} pictures and ended with {status}: {}",
        frames.len() - missing,
        frames.len(),
        fs::read_to_string(&said).unwrap_or_default().trim()
    );
    Ok(frames)
}

/// Pixels of the roads: the longer side grows with the grid, within what a film can have.
fn canvas(grid: Grid) -> (usize, usize) {
    let (cols, rows) = (grid.cols() + 1, grid.rows() + 1);
    let scale = (200 * cols.max(rows)).clamp(800, 1200) as f64 / cols.max(rows) as f64;
    let side = |count: usize| ((count as f64 * scale) as usize).max(400).next_multiple_of(2);
    (side(cols), side(rows))
}

fn join_to_gif(frames: &[PathBuf], film: &Path) -> Result<()> {
    let bar = EpisodeBar::of(frames.len(), "pictures joined");
    let file = File::create(film).context("the film cannot be written")?;
    let mut encoder: Option<gif::Encoder<File>> = None;
    for (number, frame) in frames.iter().enumerate() {
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
