//! The ways past SUMO's interface change no byte of a result.

use std::fs;
use std::path::Path;

use super::place::Place;
use dials_session::records::files;
use libsumo::shortcuts;

/// Trains a few steps on the local simulators of a config, or a scenario, with the shortcuts and without. Compares what is learnt
/// and measured, and what a controller reaches.
fn assert_alike(config: &str, settings: &[&str]) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = root.join(config).to_str().unwrap().to_owned();
    let place = Place::new("");
    let settings: Vec<&str> = settings.iter().flat_map(|setting| ["--set", *setting]).collect();
    let results = ["on", "off"].map(|shortcuts| {
        let command = |words: &[&str]| {
            let mut command = place.command(words);
            command.env(shortcuts::VARIABLE, shortcuts).args(&settings);
            command.assert().success().get_output().stdout.clone()
        };
        command(&["train", &config, "--out", shortcuts, "--workers", "0", "--simulator", "marginal-dials"]);
        let file = |name: &str| fs::read(place.dir.path().join(shortcuts).join(name)).unwrap();
        let measured = command(&["baseline", &config, "--controller", "max-pressure", "--episodes", "1", "--json"]);
        [file(files::POLICIES), file(files::RETURNS), measured]
    });
    assert!(results[0] == results[1], "the shortcuts change results");
}

#[test]
fn the_shortcuts_change_nothing_on_a_grid() {
    assert_alike(
        "configs/smoke_traffic.toml",
        &[
            "total_steps=256",
            "evaluation.every_steps=256",
            "evaluation.episodes=1",
            "evaluation.final_episodes=1",
            "aip.dataset_steps=600",
        ],
    );
}

#[test]
fn the_shortcuts_change_nothing_in_a_town() {
    assert_alike(
        "sumo_nets/town/town.sumocfg",
        &[
            "traffic.end_s=300",
            "total_steps=240",
            "ppo.memory=120",
            "ppo.rollout_steps=60",
            "ppo.minibatch=20",
            "evaluation.every_steps=240",
            "evaluation.episodes=1",
            "evaluation.final_episodes=1",
            "aip.dataset_steps=120",
            "aip.batch=20",
            "policy.hidden=[16]",
        ],
    );
}
