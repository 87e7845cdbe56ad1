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

/// Returns a value without brackets, braces, blanks and other letters that a shell or a pattern would read in its own
/// way: `[8, 4]` becomes `8_4`.
fn plain(value: &str) -> String {
    let is_plain = |letter: char| letter.is_alphanumeric() || "-_.=+".contains(letter);
    let value: String = value.split_whitespace().collect();
    let parts = value.split(|letter| !is_plain(letter)).filter(|part| !part.is_empty());
    parts.collect::<Vec<_>>().join("_")
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    use dials_session::config::load;

    fn root() -> &'static Path {
        Path::new(env!("CARGO_MANIFEST_DIR"))
    }

    fn name(config: &str, settings: &[&str]) -> String {
        let settings: Vec<String> = settings.iter().map(|&setting| setting.to_owned()).collect();
        let path = root().join(config);
        let config = load(&path, &settings).unwrap();
        default_dir(&path, &config, &settings).to_str().unwrap().to_owned()
    }

    #[test]
    fn what_differs_is_in_the_name() {
        assert_eq!(name("configs/traffic_4.toml", &[]), "runs/traffic_4-dials-seed1");
        assert_eq!(name("configs/paper/traffic_4.toml", &["simulator=gs"]), "runs/paper-traffic_4-gs-seed1");
        let settings = ["ppo.clip=0.3", "seed = 7", "policy.hidden=[8, 4]", "ppo.clip = 0.2"];
        assert_eq!(
            name("configs/traffic_4.toml", &settings),
            "runs/traffic_4-dials-policy.hidden=8_4-ppo.clip=0.2-seed7"
        );
        assert_eq!(
            name("sumo_nets/town/town.sumocfg", &["total_steps=1000000"]),
            "runs/town-dials-total_steps=1000000-seed1"
        );
    }

    #[test]
    fn no_name_needs_quotes_and_none_is_a_pattern() {
        let settings = ["traffic.reward={queue = 0.5, wait = 0.5}", "policy.hidden=[16]"];
        assert_eq!(
            name("configs/traffic_4.toml", &settings),
            "runs/traffic_4-dials-policy.hidden=16-traffic.reward=queue=0.5_wait=0.5-seed1"
        );
        assert_eq!(["a*?", "'b'", "{c=1,d=-2}", "~/$x;(y)", "ü"].map(plain), ["a", "b", "c=1_d=-2", "x_y", "ü"]);
    }

    #[test]
    fn what_does_not_change_the_policies_is_not() {
        let settings = ["stop_at_steps=1000", "evaluation.episodes=3", "logging.tensorboard=true"];
        assert_eq!(name("configs/traffic_4.toml", &settings), "runs/traffic_4-dials-seed1");
    }

    #[test]
    fn many_settings_are_cut() {
        let settings: Vec<String> = (0..40).map(|number| format!("key{number}=ü")).collect();
        let words = listed(&settings);
        assert!(words.len() <= LONGEST_SETTINGS + 10 && words.ends_with("-and-more"), "{words}");
    }

    /// Every command of README and guide that trains without `--out`: two that train something else have two names.
    #[test]
    fn the_documented_runs_have_names_of_their_own() {
        let mut found: BTreeMap<String, String> = BTreeMap::new();
        for page in ["README.md", "docs/guide.md"] {
            let text = std::fs::read_to_string(root().join(page)).unwrap();
            for line in text.lines().filter(|line| !line.contains("--out")) {
                let Some((_, words)) = line.split_once(" train configs/") else { continue };
                let words: Vec<&str> = words.split('#').next().unwrap().split_whitespace().collect();
                let Some(config) = words.first().filter(|word| word.ends_with(".toml")) else { continue };
                let mut settings = Vec::new();
                for pair in words.windows(2) {
                    match pair[0] {
                        "--set" => settings.push(pair[1].to_owned()),
                        "--seed" => settings.push(format!("seed={}", pair[1])),
                        "--simulator" => settings.push(format!("simulator={}", pair[1])),
                        _ => (),
                    }
                }
                settings.sort();
                // The default seed is 1.
                settings.retain(|setting| setting != "seed=1");
                let what = format!("{config} {settings:?}");
                let settings: Vec<&str> = settings.iter().map(String::as_str).collect();
                let other = found.insert(name(&format!("configs/{config}"), &settings), what.clone());
                assert!(other.as_ref().is_none_or(|other| *other == what), "{other:?} and {what} have one name");
            }
        }
        assert!(found.len() >= 4, "{found:?}");
    }
}
