//! Films that are stopped while they are made: no helper goes on, and no file stays.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::PoisonError;

use super::{SCREEN, has_xvfb, text, write_config};

/// Programs that stand in for those that make films. Each writes its process id to a file.
struct StandIns(PathBuf);

impl StandIns {
    /// `programs`: names, and what the shell does in their place.
    fn make(folder: PathBuf, programs: &[(&str, &str)]) -> StandIns {
        fs::create_dir(&folder).unwrap();
        for (name, work) in programs {
            let script = format!("#!/bin/sh\necho $$ > $0.tmp && mv $0.tmp $0.pid\nexec {work}\n");
            fs::write(folder.join(name), script).unwrap();
            fs::set_permissions(folder.join(name), fs::Permissions::from_mode(0o755)).unwrap();
        }
        let lib = folder.with_file_name("lib");
        fs::create_dir_all(&lib).unwrap();
        std::os::unix::fs::symlink(&libsumo::load().unwrap().file, lib.join("libsumocpp.so")).unwrap();
        StandIns(folder)
    }

    /// Begins to film three seconds. `places`: the replay, the film, and the folder for temporary files, which is made.
    fn film(&self, config: &Path, [out, film, room]: &[PathBuf; 3]) -> Child {
        fs::create_dir(room).unwrap();
        let path = format!("{}:{}", self.0.display(), std::env::var("PATH").unwrap());
        Command::new(assert_cmd::cargo::cargo_bin!("dials-traffic"))
            .args(["replay", text(config), "--controller", "never", "--out", text(out), "--video", text(film)])
            .args(["--seconds", "0,3"])
            .envs([("PATH", path.as_str()), ("TMPDIR", text(room))])
            // sumo-gui is taken from the SUMO of the library.
            .env("DIALS_SUMO_LIBRARY", self.0.with_file_name("lib").join("libsumocpp.so"))
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap()
    }

    /// Waits until a program has begun, and returns its process id.
    fn process_of(&self, name: &str) -> String {
        let file = self.0.join(format!("{name}.pid"));
        wait_until(|| file.exists());
        let id = fs::read_to_string(&file).unwrap().trim().to_owned();
        fs::remove_file(file).unwrap();
        assert!(runs(&id));
        id
    }
}

fn send(signal: &str, child: &Child) {
    assert!(Command::new("kill").args(["-s", signal, &child.id().to_string()]).status().unwrap().success());
}

#[test]
fn a_film_that_is_stopped_leaves_nothing_behind() {
    if !has_xvfb() {
        return;
    }
    let _screen = SCREEN.lock().unwrap_or_else(PoisonError::into_inner);
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), "");
    // A sumo-gui that hangs, and an Xvfb.
    let hanging =
        StandIns::make(dir.path().join("bin"), &[("sumo-gui", "sleep 600"), ("Xvfb", "/usr/bin/Xvfb \"$@\"")]);
    for (signal, code) in [("TERM", Some(130)), ("INT", Some(130)), ("KILL", None)] {
        let places = ["replay", "film.gif", "room"].map(|name| dir.path().join(format!("{signal}-{name}")));
        let mut child = hanging.film(&config, &places);
        let helpers = ["Xvfb", "sumo-gui"].map(|name| hanging.process_of(name));
        send(signal, &child);
        assert_eq!(child.wait().unwrap().code(), code, "{signal}");
        wait_until(|| !helpers.iter().any(|id| runs(id)));
        let [out, film, room] = places;
        assert!(out.join("replay.sumocfg").is_file() && !film.exists(), "{signal}");
        if code.is_some() {
            assert_eq!(fs::read_dir(&room).unwrap().count(), 0, "{signal}");
        }
    }
}

#[test]
fn a_film_that_ffmpeg_joins_can_be_stopped_too() {
    if !has_xvfb() {
        return;
    }
    let _screen = SCREEN.lock().unwrap_or_else(PoisonError::into_inner);
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path(), "");
    let hanging = StandIns::make(dir.path().join("bin"), &[("ffmpeg", "sleep 600")]);
    let places = ["replay", "film.mp4", "room"].map(|name| dir.path().join(name));
    let mut child = hanging.film(&config, &places);
    let ffmpeg = hanging.process_of("ffmpeg");
    send("INT", &child);
    assert_eq!(child.wait().unwrap().code(), Some(130));
    wait_until(|| !runs(&ffmpeg));
    let [_, film, room] = places;
    assert!(!film.exists() && fs::read_dir(&room).unwrap().count() == 0);
}

/// Waits for something that should happen soon.
fn wait_until(happened: impl Fn() -> bool) {
    for _ in 0..1200 {
        if happened() {
            return;
        }
        std::thread::sleep(std::time::Duration::from_millis(50));
    }
    panic!("it does not happen");
}

/// Returns whether a process with this id exists and is not a zombie.
fn runs(id: &str) -> bool {
    fs::read_to_string(format!("/proc/{id}/stat")).is_ok_and(|state| !state.contains(") Z "))
}
