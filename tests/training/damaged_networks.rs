//! The networks of a run, damaged file by file before it is resumed: refused with the file's name, or the same results.

use std::fs;
use std::path::{Path, PathBuf};

use super::place::Place;

/// Only every ninth pair of a file and a way to damage it is tried, unless `DAMAGE=all`.
const SAMPLE: usize = 9;

const LEARNING: &str = "total_steps = 240\nstop_at_steps = 120\npolicy.hidden = [16]\n\
    [ppo]\nmemory = 120\nrollout_steps = 60\nminibatch = 20\n\
    [aip]\nhidden = [8]\ndataset_steps = 120\nbatch = 20\nepochs = 1\n\
    [evaluation]\nevery_steps = 120\nepisodes = 1\nfinal_episodes = 1\n";

/// Returns the bytes of a file after some accident; `None`: it is gone. `other`: the bytes of another file of the run.
fn damaged(way: usize, bytes: &[u8], other: &[u8]) -> Option<Vec<u8>> {
    let half = bytes.len() / 2;
    let (line_begin, line_end) = {
        let begin = bytes[..half].iter().rposition(|&byte| byte == b'\n').map_or(0, |at| at + 1);
        (begin, bytes[half..].iter().position(|&byte| byte == b'\n').map_or(bytes.len(), |at| half + at + 1))
    };
    let line = &bytes[line_begin..line_end];
    let changed = |change: &dyn Fn(u8) -> Option<u8>| {
        let at = (half..bytes.len()).find(|&at| change(bytes[at]).is_some())?;
        let mut bytes = bytes.to_vec();
        bytes[at] = change(bytes[at])?;
        Some(bytes)
    };
    let other_digit = |byte: u8| byte.is_ascii_digit().then(|| if byte == b'9' { b'1' } else { byte + 1 });
    Some(match way {
        0 => return None,
        1 => Vec::new(),
        2 => bytes[..half].to_vec(),
        3 => [&bytes[..half], &vec![0; bytes.len() - half]].concat(),
        4 => [&bytes[..line_begin], &bytes[line_end..]].concat(),
        5 => [&bytes[..line_end], line, &bytes[line_end..]].concat(),
        6 => changed(&other_digit)?,
        7 => changed(&|byte| Some(byte ^ 0x40))?,
        8 => other.to_vec(),
        9 => String::from_utf8_lossy(bytes).replace('\n', "\r\n").into_bytes(),
        _ => unreachable!("there are ten ways"),
    })
}

const WAYS: usize = 10;

/// Returns the files in a folder, by name.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Trains half of a run. Damages its networks in many ways, one at a time, and resumes it each time.
fn assert_refused_or_equal(config: &str) {
    let place = Place::new(config);
    let whole = place.train("whole", &["--steps", "240"]);
    let run = place.train("run", &[]);
    let results = |run: &Path| ["policies.safetensors", "returns.csv"].map(|file| fs::read(run.join(file)).unwrap());
    let undisturbed = results(&whole);
    let networks = files(&run.join("networks"));
    let all = std::env::var("DAMAGE").is_ok_and(|which| which == "all");
    let tries = (0..networks.len() * WAYS).filter(|number| all || number % SAMPLE == networks.len() % SAMPLE);
    let mut refused = 0;
    for number in tries {
        let (file, way) = (&networks[number / WAYS], number % WAYS);
        let copy = place.dir.path().join("copy");
        let copied = std::process::Command::new("cp").args(["-r".as_ref(), run.as_os_str(), copy.as_os_str()]).status();
        assert!(copied.unwrap().success());
        let other = fs::read(&networks[(number / WAYS + 1) % networks.len()]).unwrap();
        let victim = copy.join("networks").join(file.file_name().unwrap());
        match damaged(way, &fs::read(file).unwrap(), &other) {
            Some(bytes) => fs::write(&victim, bytes).unwrap(),
            None => fs::remove_file(&victim).unwrap(),
        }
        let output = place.resume("copy").args(["--steps", "240"]).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr);
        let name = file.file_name().unwrap().to_str().unwrap();
        if output.status.success() {
            assert!(results(&copy) == undisturbed, "{name}, damaged in way {way}, trains something else: {said}");
        } else {
            let is_named = said.contains(name) || said.contains("networks/") || said.contains("scenario.");
            assert!(matches!(output.status.code(), Some(1 | 2)) && is_named, "{name}, damaged in way {way}: {said}");
            refused += 1;
        }
        fs::remove_dir_all(&copy).unwrap();
    }
    assert!(refused > 0, "no damage was noticed");
}

#[test]
fn damaged_networks_of_a_grid_are_refused_or_mean_the_same() {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").display().to_string();
    let traffic = format!("[traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 60\n");
    assert_refused_or_equal(&format!("{LEARNING}{traffic}"));
}

#[test]
fn damaged_networks_of_a_scenario_are_refused_or_mean_the_same() {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").display().to_string();
    let place = Place::new("");
    let agents = place.dir.path().join("agents.toml");
    fs::write(&agents, "[light.a1]\nyellow_s = 5\n\n[light.a2]\nall_red_s = 2\n").unwrap();
    let traffic = format!(
        "[traffic]\nscenario = '{nets}/arterial/arterial.sumocfg'\nend_s = 300\nagents = '{}'\n",
        agents.display()
    );
    assert_refused_or_equal(&format!("simulator = 'local'\npredictor = 'marginals'\n{LEARNING}{traffic}"));
}
