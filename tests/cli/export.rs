//! Exported policies give the same results outside of this program.

use std::collections::HashMap;
use std::fs;
use std::io::Write;
use std::path::Path;
use std::process::Command;

use dials_core::base::{AgentId, Rows, Seed};
use dials_core::domain::{RegionSpec, SourceSpec};
use dials_learn::config::PolicyConfig;
use dials_learn::policy::PolicyStack;
use rand::Rng;
use safetensors::tensor::{Dtype, TensorView};
#[cfg(feature = "torch")]
use stacknets::stack_as_bytes;
use stacknets::{StackToWrite, write_stacks};
#[cfg(feature = "torch")]
use tch::{CModule, IValue, Tensor};

const AGENTS: usize = 3;
const BATCH: usize = 5;
const OBS: usize = 7;
const ACTIONS: usize = 4;
const STATE: usize = 6;

/// Policies, recurrent or not, and their outputs for fixed observations.
struct Case {
    stack: PolicyStack,
    obs: Rows<f32>,
    /// States before and after the step.
    states: [Rows<f32>; 2],
    logits: Vec<f32>,
    values: Vec<f32>,
}

fn random_rows(rows: usize, width: usize, name: &str) -> Rows<f32> {
    let mut dice = Seed::new(7).fork_named(name).dice();
    Rows::from_vec((0..rows * width).map(|_| dice.random_range(-1.0..1.0)).collect(), width)
}

/// Returns policies without and with a memory, each with one network and with a critic of its own.
fn cases() -> [Case; 4] {
    [(false, false), (true, false), (false, true), (true, true)].map(|(recurrent, separate_critic)| {
        let sources = SourceSpec::bits(1);
        let spec = RegionSpec {
            obs_dim: OBS,
            d_set_dim: 1,
            n_actions: ACTIONS,
            sets: None,
            masks: false,
            sources,
            horizon: 1,
            local_horizon: 1,
        };
        let config = PolicyConfig {
            recurrent: recurrent.then_some(STATE),
            hidden: if recurrent { vec![8] } else { vec![9, 8] },
            separate_critic,
            ..PolicyConfig::default()
        };
        let stack = PolicyStack::new(&AgentId::all(AGENTS), &spec, &config, &[0.0; ACTIONS], Seed::new(2));
        let obs = random_rows(AGENTS * BATCH, OBS, "obs");
        let width = if separate_critic { 2 * STATE } else { STATE };
        let before = random_rows(AGENTS * BATCH, width, "states");
        let mut states = stack.states(AGENTS * BATCH);
        if recurrent {
            before.iter().enumerate().for_each(|(row, state)| states.set_row(row, state));
        }
        let judgement = stack.judge(0..AGENTS, &stacknets::Threads::one(), &obs, &mut states);
        let (logits, values): (Vec<_>, Vec<_>) =
            judgement.rows().map(|(logits, value)| (logits.to_vec(), value)).unzip();
        let mut after = before.clone();
        if recurrent {
            (0..AGENTS * BATCH).for_each(|row| after.row_mut(row).copy_from_slice(states.row(row)));
        }
        Case { stack, obs, states: [before, after], logits: logits.concat(), values }
    })
}

#[cfg(feature = "torch")]
fn assert_close(found: &[f32], expected: &[f32], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{what}: {found:?} {expected:?}");
}

#[cfg(feature = "torch")]
fn tensor(rows: &Rows<f32>) -> Tensor {
    Tensor::of_slice(rows.as_slice()).view([AGENTS as i64, BATCH as i64, rows.width() as i64])
}

#[cfg(feature = "torch")]
#[test]
fn a_script_says_what_the_policies_say_for_any_batch() {
    for case in cases() {
        let state_width = case.stack.state_width();
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("policies.pt");
        let parameters = case.stack.parameters();
        let rows = parameters.values().iter().collect();
        let networks = stack_as_bytes(&StackToWrite { prefix: "", layout: parameters.layout(), rows }).unwrap();
        let mut program = assert_cmd::Command::new(env!("CARGO_BIN_EXE_dials-traffic-torch"));
        let output = program.args(["script", "policies.pt"]).write_stdin(networks).assert().success();
        fs::write(&path, &output.get_output().stdout).unwrap();
        let module = CModule::load(&path).unwrap();
        let mut inputs = vec![IValue::Tensor(tensor(&case.obs))];
        if state_width > 0 {
            inputs.push(IValue::Tensor(tensor(&case.states[0])));
        }
        let out = Tensor::try_from(module.forward_is(&inputs).unwrap()).unwrap();
        assert_eq!(out.size(), [AGENTS, BATCH, ACTIONS + 1 + state_width].map(|n| n as i64));
        let columns = |from: usize, count: usize| {
            Vec::<f32>::from(&out.narrow(2, from as i64, count as i64).contiguous().view([-1]))
        };
        assert_close(&columns(0, ACTIONS), &case.logits, "logits");
        assert_close(&columns(ACTIONS, 1), &case.values, "values");
        if state_width > 0 {
            assert_close(&columns(ACTIONS + 1, state_width), case.states[1].as_slice(), "states");
        }
    }
}

/// Reads the policies with the Python example and compares its outputs with those of the Rust side.
const PYTHON: &str = "
import sys
sys.path.insert(0, sys.argv[1])
import numpy as np
from safetensors.numpy import load_file
from read_policies import judge
policies, case = load_file(sys.argv[2]), load_file(sys.argv[3])
logits, values, state = judge(policies, case['obs'], case['before'] if 'gru.input_weight' in policies else None)
assert logits.dtype == np.float32
np.testing.assert_allclose(logits, case['logits'], atol=1e-5)
np.testing.assert_allclose(values, case['values'], atol=1e-5)
if state is not None:
    np.testing.assert_allclose(state, case['after'], atol=1e-5)
";

#[test]
fn the_python_reader_says_what_the_policies_say() {
    let python = |args: &[&str]| Command::new("python3").args(args).output();
    if !python(&["-c", "import numpy, safetensors"]).is_ok_and(|output| output.status.success()) {
        // Write to standard error directly, because `println` and `eprintln` of a passing test are not shown.
        let message = b"skipped: needs python3 with numpy and safetensors (pip install numpy safetensors)\n";
        std::io::stderr().write_all(message).unwrap();
        return;
    }
    let examples = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples");
    for case in cases() {
        let dir = tempfile::tempdir().unwrap();
        let (policies, said) = (dir.path().join("policies.safetensors"), dir.path().join("said.safetensors"));
        let parameters = case.stack.parameters();
        let stack =
            StackToWrite { prefix: "", layout: parameters.layout(), rows: parameters.values().iter().collect() };
        write_stacks(&[stack], &HashMap::new(), &policies).unwrap();
        let tables = [
            ("obs", vec![AGENTS, BATCH, OBS], case.obs.as_slice()),
            ("before", vec![AGENTS, BATCH, case.states[0].width()], case.states[0].as_slice()),
            ("after", vec![AGENTS, BATCH, case.states[1].width()], case.states[1].as_slice()),
            ("logits", vec![AGENTS, BATCH, ACTIONS], &case.logits[..]),
            ("values", vec![AGENTS, BATCH], &case.values[..]),
        ];
        let views = tables.map(|(name, shape, values)| {
            (name, TensorView::new(Dtype::F32, shape, bytemuck::cast_slice(values)).unwrap())
        });
        fs::write(&said, safetensors::serialize(views, None).unwrap()).unwrap();
        let [examples, policies, said] = [&examples, &policies, &said].map(|path| path.to_str().unwrap());
        let output = python(&["-c", PYTHON, examples, policies, said]).unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let output = python(&[&format!("{examples}/read_policies.py"), policies]).unwrap();
        let told = String::from_utf8_lossy(&output.stdout).into_owned();
        assert!(told.starts_with("agent 0: shown nothing, it acts with probabilities [0."), "{told}");
    }
}
