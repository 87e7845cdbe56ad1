//! What a disturbed run must have in common with an undisturbed one.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use dials_session::records::files;
use safetensors::SafeTensors;
use serde_json::Value;

use super::book::Fault;
use super::stage::Stage;

/// Keys of a checkpoint's metadata that depend on wall time, on the number of workers, or on when somebody said where to stop;
/// and what sums over them.
const UNDETERMINED: [&str; 6] = ["elapsed_s", "stop_at_steps", files::TIMING, files::MEMORY, files::EVENTS, "digest"];

/// Compares a run with an undisturbed one. Returns the faults, none if all is well.
pub(super) fn compare(undisturbed: &Stage, stage: &Stage) -> Vec<(Fault, String)> {
    let [mut expected, mut found] = [undisturbed, stage].map(|stage| names(&stage.runs()));
    // Those by time are at other steps each time. The last one ends the run.
    let newest = expected.iter().filter(|name| is_checkpoint(name)).max().cloned();
    let both = &expected & &found;
    [&mut expected, &mut found].into_iter().for_each(|names| {
        names.retain(|name| !is_checkpoint(name) || both.contains(name) || Some(name) == newest.as_ref());
    });
    let missing = expected.difference(&found).map(|name| (Fault::Different, format!("{}: missing", name.display())));
    let unknown = found.difference(&expected).map(|name| (Fault::Leftover, name.display().to_string()));
    let temporary = names(&stage.temporary());
    let temporary = temporary.iter().map(|name| (Fault::Leftover, format!("temporary file {}", name.display())));
    let common = expected.intersection(&found);
    let different = common.filter(|name| {
        let paths = [undisturbed, stage].map(|stage| stage.runs().join(name));
        // Evaluations and AIPs change no step, and a run that hurries may save only after them. The last one is after both.
        if Some(*name) != newest.as_ref() && is_checkpoint(name) {
            let [expected, found] = paths.each_ref().map(|path| last_done(path));
            if expected != found {
                return false;
            }
        }
        let [expected, found] = paths.map(|path| determined(&path));
        expected != found
    });
    let different = different.map(|name| (Fault::Different, format!("{}: differs", name.display())));
    missing.chain(unknown).chain(temporary).chain(different).collect()
}

/// Returns the paths of all files and folders within a folder, without the logs of workers and of an experiment.
fn names(folder: &Path) -> BTreeSet<PathBuf> {
    let mut names = BTreeSet::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in fs::read_dir(&next).unwrap().map(|entry| entry.unwrap()) {
            if entry.file_type().unwrap().is_dir() {
                open.push(entry.path());
            }
            names.insert(entry.path().strip_prefix(folder).expect("it is within").to_owned());
        }
    }
    names.retain(|name| !is_worker_log(&name.to_string_lossy()) && !name.starts_with("logs"));
    names
}

fn is_checkpoint(name: &Path) -> bool {
    name.parent().is_some_and(|folder| folder.ends_with(files::CHECKPOINTS))
}

fn is_worker_log(name: &str) -> bool {
    let number = name.split_once("/worker_").and_then(|(_, rest)| rest.strip_suffix(".log"));
    number.is_some_and(|number| number.parse::<u8>().is_ok())
}

/// Returns at which steps a checkpoint's run was last evaluated, and last trained its AIPs.
fn last_done(checkpoint: &Path) -> [Value; 2] {
    let metadata = metadata(&fs::read(checkpoint).unwrap());
    let standing = &metadata["checkpoint"]["progress"]["standing"];
    assert!(standing["until"].is_u64(), "{}: has no progress", checkpoint.display());
    ["evaluated_at", "aips_trained_at"].map(|key| standing[key].clone())
}

/// Returns what the config and the seed determine in a file.
fn determined(path: &Path) -> Vec<u8> {
    if path.is_dir() {
        return Vec::new();
    }
    let bytes = fs::read(path).unwrap();
    let file = path.file_name().expect("a file has a name").to_str().expect("names are plain");
    match file {
        // Wall times differ, but no period is missing and none is there twice.
        files::TIMING | files::MEMORY => periods(&bytes).into_bytes(),
        files::EVENTS => bytes.len().to_string().into_bytes(),
        // How a run was started is its own.
        files::RUN => without("workers", &without("command", &bytes)),
        // The path of its config is that of its stage.
        _ if file.ends_with(".json") && path.parent().is_some_and(|folder| folder.ends_with("baselines")) => {
            without("config", &bytes)
        }
        _ if is_checkpoint(path) => state(&bytes),
        _ => bytes,
    }
}

/// Returns a JSON object without one of its keys.
fn without(key: &str, json: &[u8]) -> Vec<u8> {
    let mut object: Value = serde_json::from_slice(json).unwrap();
    object.as_object_mut().expect("an object").remove(key);
    object.to_string().into_bytes()
}

/// Returns the steps of the lines for all processes together.
fn periods(csv: &[u8]) -> String {
    let text = String::from_utf8_lossy(csv);
    let steps = text.lines().filter_map(|line| line.split_once(",all,")).map(|(steps, _)| steps);
    steps.collect::<Vec<_>>().join("\n")
}

/// Returns the tensors of a checkpoint and the determined part of its metadata.
fn state(bytes: &[u8]) -> Vec<u8> {
    let file = SafeTensors::deserialize(bytes).expect("the checkpoint is whole");
    let mut metadata = metadata(bytes);
    remove_undetermined(&mut metadata);
    let mut tensors: Vec<_> = file.tensors();
    tensors.sort_by(|a, b| a.0.cmp(&b.0));
    let mut state = metadata.to_string().into_bytes();
    for (name, tensor) in tensors {
        state.extend(format!("\n{name} {:?} {:?}\n", tensor.dtype(), tensor.shape()).into_bytes());
        state.extend(tensor.data());
    }
    state
}

/// Returns the metadata of a checkpoint. Values in JSON become JSON.
fn metadata(bytes: &[u8]) -> Value {
    let (_, header) = SafeTensors::read_metadata(bytes).expect("the checkpoint is whole");
    let metadata = header.metadata().clone().unwrap_or_default();
    let metadata = metadata.into_iter().map(|(key, text)| (key, serde_json::from_str(&text).unwrap_or(text.into())));
    Value::Object(metadata.collect())
}

fn remove_undetermined(value: &mut Value) {
    if let Value::Object(map) = value {
        map.retain(|key, _| !UNDETERMINED.contains(&key.as_str()));
        map.values_mut().for_each(remove_undetermined);
    }
}
