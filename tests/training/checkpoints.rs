//! What a resume accepts: checkpoints of this run alone, and only those changes of the config that training cannot see.

use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::{Path, PathBuf};

use dials_core::base::{Dice, Ragged};
use dials_core::outside::Directory;
use dials_learn::state::stream::{AgentStream, RowStream};
use dials_session::domains::DomainConfig;
use dials_session::records::checkpoint::owner::{NotOfThisRun, Owner};
use dials_session::records::checkpoint::{self, Checkpoint, Tensors, flat, seal};
use dials_session::records::growing::Mark;
use dials_warehouse::Warehouse;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde_json::{Value, json};

use crate::place::Place;

/// A warehouse of four robots, five updates. The horizon divides no period, so checkpoints lie within episodes.
const WAREHOUSE: &str = "total_steps = 640\n[warehouse]\nagents_per_side = 2\nhorizon = 23\n\
                         [local_simulators]\ncopies = 4\nstagger = true\n[policy]\nrecurrent = 5\nhidden = [6]\n\
                         [ppo]\nrollout_steps = 8\n\
                         [aip]\nhidden = [7]\nretrain_every_steps = 300\ndataset_steps = 64\nbatch = 16\nepochs = 2\n\
                         [evaluation]\nevery_steps = 256\nepisodes = 2\nfinal_episodes = 3\n\
                         [checkpoints]\nevery_steps = 128\n";

fn traffic() -> String {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets").display().to_string();
    format!(
        "total_steps = 256\n[traffic]\nnetwork = '{nets}/grid_2x2'\nlocal_network = '{nets}/local'\nhorizon = 20\n\
         [local_simulators]\ncopies = 4\n[policy]\nhidden = [6]\n\
         [aip]\nhidden = [7]\nretrain_every_steps = 256\ndataset_steps = 40\nbatch = 8\nepochs = 1\n\
         [evaluation]\nevery_steps = 128\nepisodes = 1\nfinal_episodes = 1\n"
    )
}

/// Replaces a line of the config in a run directory.
fn edit(run: &Path, from: &str, to: &str) {
    let path = run.join("config.toml");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from), "`{from}` is not in {text}");
    fs::write(&path, text.replacen(from, to, 1)).unwrap();
}

/// Returns all files of a run directory with their contents.
fn contents(dir: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(dir).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(contents(&path));
        } else {
            files.insert(path.clone(), fs::read(&path).unwrap());
        }
    }
    files
}

fn policies(run: &Path) -> Vec<u8> {
    fs::read(run.join("policies.safetensors")).unwrap()
}

fn checkpoint(run: &Path, steps: u64) -> PathBuf {
    run.join(format!("checkpoints/step_{steps:012}.safetensors"))
}

/// Asserts that a resume ends with this exit code, says all of this, and changes no file.
fn assert_refused(place: &Place, run: &str, code: i32, parts: &[&str]) {
    let dir = place.dir.path().join(run);
    let before = contents(&dir);
    let output = place.resume(run).assert().code(code).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("error: ") && !said.contains("panicked"), "{said}");
    parts.iter().for_each(|part| assert!(said.contains(part), "`{part}` is not in: {said}"));
    let after = contents(&dir);
    assert!(before == after, "files were changed: {:?} {:?}", before.keys(), after.keys());
}

#[test]
fn only_names_that_this_program_gives_count_as_checkpoints() {
    let place = Place::new(WAREHOUSE);
    let undisturbed = policies(&place.train("whole", &[]));
    let run = place.train("run", &["--steps", "128"]);
    let strangers = ["best", "step_old_copy", "step_00000000064", "step_0000000000999", "step_00000000999x"]
        .map(|name| run.join(format!("checkpoints/{name}.safetensors")));
    strangers.iter().for_each(|path| fs::write(path, "mine").unwrap());
    edit(&run, "stop_at_steps = 128\n", "");
    place.resume("run").assert().success();
    assert!(policies(&run) == undisturbed);
    strangers.iter().for_each(|path| assert_eq!(fs::read(path).unwrap(), b"mine", "{}", path.display()));
    let ours = fs::read_dir(run.join("checkpoints")).unwrap().count() - strangers.len();
    assert_eq!(ours, 3, "the newest three are kept");
}

#[test]
fn a_key_that_determines_training_cannot_change_on_resume() {
    let place = Place::new(WAREHOUSE);
    let run = place.train("run", &["--steps", "128"]);
    let original = fs::read_to_string(run.join("config.toml")).unwrap();
    for (from, to, told) in [
        ("seed = 1", "seed = 2", "seed: 1 there, 2 here"),
        ("total_steps = 640", "total_steps = 1280", "total_steps: 640 there, 1280 here"),
        ("agents_per_side = 2", "agents_per_side = 3", "warehouse.agents_per_side: 2 there, 3 here"),
        ("horizon = 23", "horizon = 22", "warehouse.horizon: 23 there, 22 here"),
        ("hidden = [6]", "hidden = [5]", "policy.hidden: [6] there, [5] here"),
        ("recurrent = 5\n", "", "policy.recurrent: 5 there, not set here"),
        ("hidden = [7]", "hidden = [8]", "aip.hidden: [7] there, [8] here"),
        ("copies = 4", "copies = 2", "local_simulators.copies: 4 there, 2 here"),
        ("simulator = \"local\"", "simulator = \"gs\"", "simulator: \"local\" there, \"gs\" here"),
        ("clip = 0.1", "clip = 0.2", "ppo.clip: 0.1 there, 0.2 here"),
    ] {
        edit(&run, from, to);
        assert_refused(&place, "run", 2, &[told, "step_000000000128.safetensors", "begin a new run"]);
        fs::write(run.join("config.toml"), &original).unwrap();
    }
    edit(&run, "stop_at_steps = 128", "stop_at_steps = 100");
    assert_refused(&place, "run", 2, &["stop_at_steps = 100", "128"]);
}

#[test]
fn networks_that_were_edited_after_the_checkpoint_are_noticed() {
    let place = Place::new(&traffic());
    let run = place.train("run", &["--steps", "128"]);
    edit(&run, "stop_at_steps = 128\n", "");
    for (file, key) in
        [("global.rou.xml", "scenario.checksum"), ("local.net.xml", "scenario.files.traffic.local_network")]
    {
        let path = run.join("networks").join(file);
        let original = fs::read(&path).unwrap();
        fs::write(&path, [&original[..], b"<!-- edited -->\n"].concat()).unwrap();
        assert_refused(&place, "run", 2, &[key, " there, ", "begin a new run"]);
        fs::write(&path, original).unwrap();
    }
    place.resume("run").assert().success();
}

#[test]
fn a_checkpoint_of_another_run_is_not_resumed_from() {
    let place = Place::new(WAREHOUSE);
    let run = place.train("run", &["--steps", "128"]);
    for (out, setting, told) in [
        ("seed", "seed=7", "seed: 7 there, 1 here"),
        ("agents", "warehouse.agents_per_side=3", "warehouse.agents_per_side: 3 there, 2 here"),
        ("wide", "policy.hidden=[9]", "policy.hidden: [9] there, [6] here"),
    ] {
        let other = place.train(out, &["--steps", "256", "--set", setting]);
        fs::copy(checkpoint(&other, 256), checkpoint(&run, 256)).unwrap();
        assert_refused(&place, "run", 2, &["step_000000000256.safetensors", told]);
        fs::remove_file(checkpoint(&run, 256)).unwrap();
    }
    fs::rename(checkpoint(&run, 128), checkpoint(&run, 512)).unwrap();
    assert_refused(&place, "run", 1, &["step_000000000512.safetensors", "128"]);
}

#[test]
fn a_run_without_a_checkpoint_begins_again_as_the_run_that_was_described() {
    let place = Place::new(WAREHOUSE);
    let run = place.train("run", &["--steps", "128"]);
    fs::remove_dir_all(run.join("checkpoints")).unwrap();
    // As after a kill in the first period.
    ["returns.csv", "training.csv"].iter().for_each(|file| fs::remove_file(run.join(file)).unwrap());
    for (from, to, told) in [
        ("seed = 1", "seed = 2", "run.json: was written with other settings"),
        ("agents_per_side = 2", "agents_per_side = 3", "scenario.agents: 4 there, 9 here"),
    ] {
        edit(&run, from, to);
        assert_refused(&place, "run", 2, &[told, " there, ", "begin a new run"]);
        edit(&run, to, from);
    }
    edit(&run, "stop_at_steps = 128", "stop_at_steps = 256");
    place.resume("run").assert().success();
    assert!(checkpoint(&run, 256).exists());
}

#[test]
fn what_training_cannot_see_may_change_on_resume() {
    let place = Place::new(WAREHOUSE);
    let undisturbed = policies(&place.train("whole", &[]));
    for (index, (from, to)) in [
        ("stop_at_steps = 150\n", "stop_at_steps = 640\n"),
        ("[evaluation]\nevery_steps = 256", "[evaluation]\nevery_steps = 170"),
        ("\nepisodes = 2", "\nepisodes = 1"),
        ("final_episodes = 3", "final_episodes = 1"),
        ("aip_loss_episodes = 0", "aip_loss_episodes = 1"),
        ("every_minutes = 5.0\nevery_steps = 128", "every_minutes = 5.0\nevery_steps = 200"),
        ("every_minutes = 5.0\nevery_steps = 128", "every_minutes = 5.0"),
        ("every_minutes = 5.0\nevery_steps = 128", "every_minutes = 1e-9"),
        ("tensorboard = false", "tensorboard = true"),
        // An evaluation is due at step 140, after the same update as at 170.
        ("[evaluation]\nevery_steps = 140", "[evaluation]\nevery_steps = 170"),
    ]
    .into_iter()
    .enumerate()
    {
        let out = format!("run{index}");
        let often = if from.contains("140") { "evaluation.every_steps=140" } else { "evaluation.every_steps=256" };
        let run = place.train(&out, &["--steps", "150", "--set", often]);
        edit(&run, from, to);
        if index > 0 {
            edit(&run, "stop_at_steps = 150\n", "");
        }
        place.resume(&out).assert().success();
        assert!(policies(&run) == undisturbed, "{from} -> {to}");
        let returns = fs::read_to_string(run.join("returns.csv")).unwrap();
        let of_all = returns.lines().filter_map(|line| line.split_once(",all,"));
        let mut steps: Vec<&str> = of_all.map(|(steps, _)| steps).collect();
        let all = steps.len();
        steps.dedup();
        assert_eq!(steps.len(), all, "no step is evaluated twice: {steps:?}");
    }
}

/// F is 300, and an update has 128 steps. So at step 384, where the run stopped, the AIPs are to be trained.
#[test]
fn a_run_that_stopped_where_aips_are_to_be_trained_trains_them_when_it_goes_on() {
    let place = Place::new(WAREHOUSE);
    let whole = place.train("whole", &[]);
    let run = place.train("run", &["--steps", "384"]);
    place.resume("run").args(["--steps", "640"]).assert().success();
    for file in ["policies.safetensors", "aips.safetensors", "returns.csv", "training.csv", "aip_loss.csv"] {
        assert!(fs::read(run.join(file)).unwrap() == fs::read(whole.join(file)).unwrap(), "{file}");
    }
}

#[test]
fn a_longer_run_says_that_it_loses_the_evaluation_of_its_earlier_end() {
    let place = Place::new(WAREHOUSE);
    for (run, every, loses) in [("between", "256", true), ("at_one", "128", false)] {
        place.train(run, &["--steps", "128", "--set", &format!("evaluation.every_steps={every}")]);
        let output = place.resume(run).args(["--steps", "384"]).assert().success().get_output().clone();
        let said = String::from_utf8(output.stderr).unwrap();
        let told = "note: returns.csv loses the evaluation at step 128, the earlier end of this run.";
        assert_eq!(said.contains(told), loses, "{said}");
        let returns = fs::read_to_string(place.dir.path().join(run).join("returns.csv")).unwrap();
        assert_eq!(returns.contains("\n128,all,"), !loses, "{returns}");
    }
}

/// A checkpoint of a run, and all that makes another one out of it.
struct Sound {
    place: Place,
    owner: Owner,
    bytes: Vec<u8>,
    checkpoint: Checkpoint,
}

/// Timesteps of the checkpoint: its period ends at 300, and an update has 128.
const AT: u64 = 384;

impl Sound {
    /// Trains until the middle of an episode.
    fn new(simulator: &str) -> Sound {
        let place = Place::new(WAREHOUSE);
        let run = place.train("run", &["--steps", "300", "--simulator", simulator]);
        let config = dials_session::config::load(&run.join("config.toml"), &[]).unwrap();
        let Some(DomainConfig::Warehouse(table)) = &config.domain else { panic!("this config is of the warehouse") };
        let owner = Owner::of(&config, &Warehouse::new(table)).unwrap();
        let bytes = fs::read(checkpoint(&run, AT)).unwrap();
        let checkpoint = Checkpoint::from_bytes(&bytes, &owner).unwrap();
        assert!(checkpoint.agents.streams.iter().flat_map(|stream| &stream.rows).all(|row| row.trail.steps() > 0));
        Sound { place, owner, bytes, checkpoint }
    }

    /// Returns the file of another state, with its right digest.
    fn file_of(&self, change: impl Fn(&mut Checkpoint)) -> Vec<u8> {
        let mut other = self.checkpoint.clone();
        change(&mut other);
        let dir = tempfile::tempdir().unwrap();
        let Checkpoint { agents, progress } = other;
        checkpoint::write(&Directory::open(dir.path()).unwrap(), &self.owner, &agents, progress).unwrap();
        let file = fs::read_dir(dir.path()).unwrap().next().unwrap().unwrap();
        fs::read(file.path()).unwrap()
    }

    /// Returns the file of another text or of other tensors, with its right digest.
    fn crafted(&self, change: impl Fn(&mut Value, &mut Tensors<'_>)) -> Vec<u8> {
        self.resealed(change, |_, _| ())
    }

    /// The same, with other metadata after the digest was made.
    fn resealed(
        &self,
        change: impl Fn(&mut Value, &mut Tensors<'_>),
        after: impl Fn(&mut HashMap<String, String>, &mut Tensors<'_>),
    ) -> Vec<u8> {
        let (_, header) = SafeTensors::read_metadata(&self.bytes).unwrap();
        let mut text = serde_json::from_str(&header.metadata().as_ref().unwrap()["checkpoint"]).unwrap();
        let file = SafeTensors::deserialize(&self.bytes).unwrap();
        let mut tensors: Tensors<'_> = file.tensors().into_iter().collect();
        change(&mut text, &mut tensors);
        let mut metadata = seal(text.to_string(), &tensors);
        after(&mut metadata, &mut tensors);
        safetensors::serialize(tensors, Some(metadata)).unwrap()
    }

    fn error_of(&self, bytes: &[u8]) -> anyhow::Error {
        match Checkpoint::from_bytes(bytes, &self.owner) {
            Ok(_) => panic!("it was accepted"),
            Err(error) => error,
        }
    }

    fn assert_error(&self, bytes: &[u8], told: &str) {
        let error = format!("{:#}", self.error_of(bytes));
        assert!(error.contains(told), "`{told}` is not in: {error}");
    }
}

/// Replaces a tensor by one of one dimension.
fn put<'a>(tensors: &mut Tensors<'a>, name: &str, dtype: Dtype, bytes: &'a [u8]) {
    tensors.insert(name.to_owned(), flat(dtype, bytes).unwrap());
}

/// Gives a tensor another shape.
fn shape(tensors: &mut Tensors<'_>, name: &str, of: impl Fn(usize) -> Vec<usize>) {
    let tensor = &tensors[name];
    let other = TensorView::new(tensor.dtype(), of(tensor.shape()[0]), tensor.data()).unwrap();
    tensors.insert(name.to_owned(), other);
}

fn row(checkpoint: &mut Checkpoint) -> &mut RowStream {
    &mut checkpoint.agents.streams[2].rows[1]
}

fn numbers<'a>(checkpoint: &'a mut Checkpoint, name: &str) -> &'a mut Ragged<f32> {
    checkpoint.agents.learners.numbers.get_mut(name).unwrap()
}

fn dice<'a>(checkpoint: &'a mut Checkpoint, name: &str) -> &'a mut Vec<Vec<Dice>> {
    checkpoint.agents.learners.dice.get_mut(name).unwrap()
}

fn count(checkpoint: &mut Checkpoint) -> &mut u64 {
    checkpoint.agents.learners.counts.get_mut("gradient_steps").unwrap()
}

fn zeros() -> Dice {
    serde_json::from_value(json!({ "s": [0, 0, 0, 0] })).unwrap()
}

#[test]
fn a_flipped_bit_is_an_error_or_changes_nothing() {
    let sound = Sound::new("dials");
    let header = 8 + u64::from_le_bytes(sound.bytes[..8].try_into().unwrap()) as usize;
    let (mut errors, mut same) = (0, 0);
    let mut flip = |place: usize, bit: usize| {
        let mut bytes = sound.bytes.clone();
        bytes[place] ^= 1 << bit;
        match Checkpoint::from_bytes(&bytes, &sound.owner) {
            Ok(read) => {
                assert_eq!(read, sound.checkpoint, "bit {bit} of byte {place}");
                same += 1;
            }
            Err(_) => errors += 1,
        }
    };
    (0..header).for_each(|place| (0..8).for_each(|bit| flip(place, bit)));
    (header..sound.bytes.len()).step_by(13).for_each(|place| flip(place, place % 8));
    assert!(errors > 8 * 1000 && same < 100, "{errors} errors, {same} without a difference");
    for length in [0, 7, 8, 100, header, sound.bytes.len() - 1] {
        sound.error_of(&sound.bytes[..length]);
    }
    sound.assert_error(&[&sound.bytes[..], b"x"].concat(), "not a safetensors file");
}

#[test]
fn a_state_that_training_cannot_lead_to_is_refused_with_its_reason() {
    let sound = Sound::new("dials");
    assert_eq!(sound.file_of(|_| ()).len(), sound.bytes.len());
    assert_eq!(Checkpoint::from_bytes(&sound.file_of(|_| ()), &sound.owner).unwrap(), sound.checkpoint);
    type Change = fn(&mut Checkpoint);
    let cases: [(&str, Change); 45] = [
        ("agent 2: its table `policies` holds NaN", |c| c.agents.policies.row_mut(2)[0] = f32::NAN),
        ("agent 0: its table `aips` holds inf", |c| c.agents.aips.row_mut(0)[3] = f32::INFINITY),
        ("agent 3: its table `first_moments` holds -inf", |c| {
            numbers(c, "first_moments").row_mut(3)[0] = -f32::INFINITY
        }),
        ("`second_moments` holds -1, but they are squares", |c| numbers(c, "second_moments").row_mut(1)[0] = -1.0),
        ("its table `policies` has", |c| c.agents.policies = c.agents.policies.pick(0..3)),
        ("its table `aips` has 0 values", |c| c.agents.aips = Ragged::default()),
        ("its table `learners.second_moments` has", |c| numbers(c, "second_moments").push(&[0.0])),
        ("it has 3 streams for 4 agents", |c| drop(c.agents.streams.pop())),
        ("it has 0 streams for 4 agents", |c| c.agents.streams.clear()),
        ("it has 5 streams for 4 agents", |c| c.agents.streams.push(c.agents.streams[0].clone())),
        ("agent 1: it has 3 copies of its region, not 4", |c| drop(c.agents.streams[1].rows.pop())),
        ("agent 1: it has 0 copies", |c| c.agents.streams[1].rows.clear()),
        ("agent 1: it has 5 copies", |c| {
            let row = c.agents.streams[1].rows[0].clone();
            c.agents.streams[1].rows.push(row);
        }),
        ("agent 2: copy 1 of its region: it took action 200", |c| row(c).trail.actions[0] = 200),
        ("an influence source has the value 255", |c| row(c).trail.sources[0] = 255),
        ("values of influence sources in", |c| row(c).trail.sources.truncate(1)),
        ("values of influence sources in", |c| row(c).trail.sources.extend([0; 10_000])),
        ("values of influence sources in", |c| row(c).trail.sources.clear()),
        ("steps into episode", |c| row(c).trail.actions.truncate(1)),
        ("100000 steps into episode", |c| row(c).trail.actions = vec![0; 100_000]),
        ("into episode 18446744073709551615", |c| row(c).trail.episode = u64::MAX),
        ("into episode 0", |c| row(c).trail.episode = 0),
        ("its table `learners.states` has", |c| *numbers(c, "states") = numbers(c, "states").pick(0..3)),
        ("`states` holds NaN, which is not a finite number", |c| numbers(c, "states").row_mut(2)[0] = f32::NAN),
        ("is not a finite number", |c| row(c).rewards = f64::INFINITY),
        ("agent 2: the dice `acting` are all zeros", |c| dice(c, "acting")[2][1] = zeros()),
        ("the dice of its influence sources are all zeros", |c| row(c).influence = zeros()),
        ("agent 0: the dice `minibatches` are all zeros", |c| dice(c, "minibatches")[0][0] = zeros()),
        ("agent 1: it has 0 dice `acting`, not 4", |c| dice(c, "acting")[1].clear()),
        ("its table `acting` is of 3 agents, not of 4", |c| drop(dice(c, "acting").pop())),
        ("it has the dice [\"minibatches\"]", |c| drop(c.agents.learners.dice.remove("acting"))),
        ("it has the counts []", |c| c.agents.learners.counts.clear()),
        ("its count `gradient_steps` is", |c| *count(c) += 1),
        ("its count `gradient_steps` is 18446744073709551615", |c| *count(c) = u64::MAX),
        ("it is at step 0", |c| c.agents.steps = 0),
        ("it is at step 512", |c| c.agents.steps = 512),
        ("it is at step 18446744073709551615", |c| c.agents.steps = u64::MAX),
        ("training has come to step 640 already", |c| c.progress.standing.until = 640),
        ("training is at step 256, but it is at step 384", |c| c.progress.standing.until = 256),
        ("it ends a period at step 299, where its own", |c| c.progress.standing.until = 299),
        ("its last evaluation is at step 385", |c| c.progress.standing.evaluated_at = Some(385)),
        ("after -1 seconds, which cannot be", |c| c.progress.elapsed_s = -1.0),
        ("seconds, which cannot be", |c| c.progress.elapsed_s = 1e300),
        ("its metadata cannot be read", |c| c.progress.elapsed_s = f64::NAN),
        ("the bytes of a file that no run has", |c| c.progress.growing.extend([("../x".to_owned(), Mark::default())])),
    ];
    for (told, change) in cases {
        sound.assert_error(&sound.file_of(change), told);
    }
    let far = sound.file_of(|c| c.progress.standing.until = u64::MAX);
    assert!(sound.error_of(&far).is::<NotOfThisRun>(), "training has come further than this run ever will");
}

#[test]
fn a_file_of_another_form_is_refused_with_its_reason() {
    let sound = Sound::new("dials");
    type ChangeText = fn(&mut Value);
    let texts: [(&str, ChangeText); 19] = [
        ("unknown field `weather`", |text| text["weather"] = json!(1)),
        ("unknown field `weather`", |text| text["progress"]["weather"] = json!(1)),
        ("unknown field `weather`", |text| text["progress"]["standing"]["weather"] = json!(1)),
        ("unknown field `weather`", |text| text["progress"]["standing"]["drift"]["weather"] = json!(1)),
        ("its config cannot be read; if dials-traffic", |text| text["config"]["weather"] = json!(1)),
        ("evaluation.every_steps = 0", |text| text["config"]["evaluation"]["every_steps"] = json!(0)),
        ("checkpoints.every_steps = 1", |text| text["config"]["checkpoints"]["every_steps"] = json!(1)),
        ("it is not a checkpoint of this version", |text| text["format"] = json!("dials-traffic checkpoint 2")),
        ("it is not a checkpoint of this version", |text| *text = json!([])),
        ("missing field `steps`", |text| drop(text.as_object_mut().unwrap().remove("steps"))),
        ("invalid type: string", |text| text["steps"] = json!("384")),
        ("invalid value: integer `-1`", |text| text["steps"] = json!(-1)),
        ("invalid type: null", |text| text["config"] = json!(null)),
        ("its drift is", |text| text["progress"]["standing"]["drift"]["share_now"] = json!(-1.0)),
        ("invalid type", |text| text["progress"]["elapsed_s"] = json!("1")),
        ("warehouse.horizon: 24 there, 23 here", |text| text["config"]["warehouse"]["horizon"] = json!(24)),
        ("scenario.agents: 9 there, 4 here", |text| text["scenario"]["agents"] = json!(9)),
        ("scenario.weather: \"\\u001b[2J\" there, not set here", |text| {
            text["scenario"]["weather"] = json!("\u{1b}[2J")
        }),
        ("policy.recurrent: not set there, 5 here", |text| {
            drop(text["config"]["policy"].as_object_mut().unwrap().remove("recurrent"));
        }),
    ];
    for (told, change) in texts {
        sound.assert_error(&sound.crafted(|text, _| change(text)), told);
    }
    type ChangeTensors = fn(&mut Tensors<'_>);
    let tensors: [(&str, ChangeTensors); 12] = [
        ("it has no tensor `policies`", |tensors| drop(tensors.remove("policies"))),
        ("it has no tensor `streams`", |tensors| drop(tensors.remove("streams"))),
        ("it has tensors that no checkpoint of this run has", |tensors| put(tensors, "zz", Dtype::U8, b"1")),
        ("its tensor `policies` is I32", |tensors| {
            let bytes = tensors["policies"].data();
            put(tensors, "policies", Dtype::I32, bytes);
        }),
        ("not F32 of one dimension", |tensors| shape(tensors, "policies", |length| vec![1, length])),
        ("not F32 of one dimension", |tensors| shape(tensors, "learners.states", |length| vec![length, 1])),
        ("its table `policies` has", |tensors| {
            let bytes = tensors["aips"].data();
            put(tensors, "policies", Dtype::F32, bytes);
        }),
        ("its table `learners.first_moments` has 0 values", |tensors| {
            put(tensors, "learners.first_moments", Dtype::F32, b"");
        }),
        ("the state of training cannot be read", |tensors| put(tensors, "streams", Dtype::U8, b"")),
        // Lengths of 2^63 and more, of agents and of copies.
        ("the state of training cannot be read", |tensors| put(tensors, "streams", Dtype::U8, &[0xff; 9])),
        ("the state of training cannot be read", |tensors| {
            let bytes = &[1, 1, 2, 3, 4, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1];
            put(tensors, "streams", Dtype::U8, bytes);
        }),
        // No streams, no dice, no counts, and a byte.
        ("it has 1 bytes after the state of training", |tensors| put(tensors, "streams", Dtype::U8, &[0, 0, 0, 0])),
    ];
    for (expected, change) in tensors {
        sound.assert_error(&sound.crafted(|_, tensors| change(tensors)), expected);
    }
    type ChangeMetadata = fn(&mut HashMap<String, String>);
    let metadata: [(&str, ChangeMetadata); 5] = [
        ("it has no digest", |metadata| drop(metadata.remove("digest"))),
        ("its digest is wrong", |metadata| metadata.get_mut("digest").unwrap().make_ascii_uppercase()),
        ("its digest is wrong", |metadata| metadata.get_mut("checkpoint").unwrap().push(' ')),
        ("it is not a checkpoint", |metadata| metadata.clear()),
        ("it has metadata that no checkpoint has", |metadata| drop(metadata.insert("more".to_owned(), String::new()))),
    ];
    for (told, change) in metadata {
        sound.assert_error(&sound.resealed(|_, _| (), |metadata, _| change(metadata)), told);
    }
    let more = TensorView::new(Dtype::U8, vec![1], b"1").unwrap();
    let bytes = sound.resealed(|_, _| (), |_, tensors| drop(tensors.insert("more".to_owned(), more.clone())));
    sound.assert_error(&bytes, "its digest is wrong");
}

#[test]
fn other_simulators_have_other_states() {
    let on_gs = Sound::new("gs");
    on_gs.assert_error(&on_gs.file_of(|c| c.agents.streams[2].rows[0].trail.sources.push(0)), "not 0 in each");
    on_gs.assert_error(&on_gs.file_of(|c| c.agents.streams[2].rows[0].trail.episode += 1), "into episode");
    let drifted = |text: &mut Value| text["progress"]["standing"]["drift"]["share_after_training"] = json!(0.5);
    on_gs.assert_error(&on_gs.crafted(|text, _| drifted(text)), "this run trains none");
    let constant = Sound::new("marginal-dials");
    for row in [|row: &mut [f32]| row.fill(0.0), |row: &mut [f32]| row.fill(1.0), |row: &mut [f32]| row[0] = -row[0]] {
        let bytes = constant.file_of(|c| row(c.agents.aips.row_mut(1)));
        constant.assert_error(&bytes, "agent 1: the probabilities of influence source 0 are");
    }
}

#[test]
fn a_crafted_file_in_a_run_directory_is_an_error_that_names_it_and_the_way_out() {
    let sound = Sound::new("dials");
    let run = sound.place.dir.path().join("run");
    let path = checkpoint(&run, AT);
    let way_out =
        "step_000000000384.safetensors: cannot be resumed from; move it away to continue from the checkpoint before";
    for (bytes, told) in [
        (sound.file_of(|c| row(c).trail.actions[0] = 200), "it took action 200"),
        (sound.file_of(|c| c.agents.streams = Vec::<AgentStream>::new()), "0 streams for 4 agents"),
        (sound.crafted(|text, _| text["progress"]["standing"]["until"] = json!(256)), "but it is at step 384"),
        (b"mine".to_vec(), "not a safetensors file"),
    ] {
        fs::write(&path, bytes).unwrap();
        assert_refused(&sound.place, "run", 1, &[way_out, told]);
    }
    fs::File::create(&path).unwrap().set_len(1 << 40).unwrap();
    let output = sound.place.resume("run").assert().code(1).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("step_000000000384.safetensors: cannot be read"), "{said}");
    assert!(said.contains("it has more than 34359738368 bytes, the limit"), "{said}");
    edit(&run, "stop_at_steps = 300\n", "");
    // Numbers that are finite, but too large to compute with: nothing says that training did not lead to them.
    let huge = sound.file_of(|c| {
        c.agents.policies.fill(1e38);
        c.agents.aips.fill(1e38);
    });
    fs::write(&path, huge).unwrap();
    let output = sound.place.resume("run").assert().code(1).get_output().clone();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("diverged") && !said.contains("panicked"), "{said}");
    fs::write(&path, &sound.bytes).unwrap();
    sound.place.resume("run").assert().success();
}
