//! The default name of a run directory. It says what differs between runs, so that one pattern finds one method.

use std::path::{Path, PathBuf};

use dials_session::config::{CHANGEABLE, RunConfig};

/// Folder whose name says nothing about its configs.
const CONFIGS: &str = "configs";
/// Longest part of the name that lists settings, in bytes. A name may have 255 on Linux.
const LONGEST_SETTINGS: usize = 120;

/// Returns `runs/[FOLDER-]CONFIG-SIMULATOR[-KEY=VALUE...]-seedN`.
///
/// `FOLDER` is the folder of the config, unless that is `configs`, the current folder, or named like the config.
/// `settings`: those of `--set`. Only keys that the trained policies depend on are in the name.
pub(super) fn default_dir(config_path: &Path, config: &RunConfig, settings: &[String]) -> PathBuf {
    let name = config_path.file_stem().unwrap_or_default().to_string_lossy();
    let folder = folder(config_path).filter(|folder| *folder != name).map_or(String::new(), |folder| folder + "-");
    let settings = listed(settings);
    Path::new("runs").join(format!(
        "{folder}{name}-{}{settings}-seed{}",
        config.learning.short_form().name,
        config.learning.seed
    ))
}

/// Returns the name of the config's folder, if it says something.
fn folder(config_path: &Path) -> Option<String> {
    let folder = config_path.parent()?.canonicalize().ok()?;
    if std::env::current_dir().is_ok_and(|here| here.canonicalize().is_ok_and(|here| here == folder)) {
        return None;
    }
    let name = folder.file_name()?.to_string_lossy();
    // A name that begins with a dot would hide the run.
    let name = name.trim_start_matches('.');
    (name != CONFIGS && !name.is_empty()).then(|| name.to_owned())
}

/// Returns `-KEY=VALUE` for each setting, in the order of the keys. The last value of a key counts.
fn listed(settings: &[String]) -> String {
    let mut kept: Vec<(&str, &str)> = Vec::new();
    for (key, value) in settings.iter().filter_map(|setting| setting.split_once('=')) {
        let (key, value) = (key.trim(), value.trim());
        // The name says the first three elsewhere.
        let said = ["seed", "simulator", "predictor"].contains(&key) || CHANGEABLE.contains(&key);
        kept.retain(|(other, _)| *other != key);
        if !said {
            kept.push((key, value));
        }
    }
    kept.sort_unstable();
    let words: String = kept.iter().map(|(key, value)| format!("-{key}={}", plain(value))).collect();
    if words.len() <= LONGEST_SETTINGS {
        return words;
    }
    let end = (0..=LONGEST_SETTINGS).rev().find(|&end| words.is_char_boundary(end)).expect("0 is a boundary");
    format!("{}-and-more", &words[..end])
}

/// Returns a value without letters that a shell or a pattern would read in its own way: `[8, 4]` becomes `8_4`.
fn plain(value: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "-_.=+".contains(letter);
    let value: String = value.split_whitespace().collect();
    let parts = value.split(|letter| !is_plain(letter)).filter(|part| !part.is_empty());
    parts.collect::<Vec<_>>().join("_")
}

#[cfg(test)]
mod tests {
    use super::*;
    use dials_session::config::load;

    fn name(config: &str, settings: &[&str]) -> String {
        let settings: Vec<String> = settings.iter().map(|&setting| setting.to_owned()).collect();
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(config);
        let config = load(&path, &settings).unwrap();
        default_dir(&path, &config, &settings).to_str().unwrap().to_owned()
    }

    #[test]
    fn a_name_has_what_differs_and_changes_the_policies_and_needs_no_quotes() {
        let four = "configs/traffic_4.toml";
        let clip = ["ppo.clip=0.3", "seed = 7", "policy.hidden=[8, 4]", "ppo.clip = 0.2"];
        let reward = ["traffic.reward={queue = 0.5, wait = 0.5}", "policy.hidden=[16]"];
        let changeable = ["stop_at_steps=1000", "evaluation.episodes=3", "logging.tensorboard=true"];
        for (config, settings, expected) in [
            (four, &[][..], "traffic_4-dials-seed1"),
            ("configs/paper/traffic_4.toml", &["simulator=gs"], "paper-traffic_4-gs-seed1"),
            (four, &clip, "traffic_4-dials-policy.hidden=8_4-ppo.clip=0.2-seed7"),
            ("sumo_nets/town/town.sumocfg", &["total_steps=1000000"], "town-gs-total_steps=1000000-seed1"),
            (four, &reward, "traffic_4-dials-policy.hidden=16-traffic.reward=queue=0.5_wait=0.5-seed1"),
            (four, &changeable, "traffic_4-dials-seed1"),
        ] {
            assert_eq!(name(config, settings), format!("runs/{expected}"));
        }
        assert_eq!(["a*?", "'b'", "{c=1,d=-2}", "~/$x;(y)", "ü"].map(plain), ["a", "b", "c=1_d=-2", "x_y", "ü"]);
    }

    #[test]
    fn many_settings_are_cut() {
        let settings: Vec<String> = (0..40).map(|number| format!("key{number}=ü")).collect();
        let words = listed(&settings);
        assert!(words.len() <= LONGEST_SETTINGS + 10 && words.ends_with("-and-more"), "{words}");
    }
}
