//! Stacks as TorchScript: a file that PyTorch and its C++ library open without this program.

use std::fs::File;
use std::io::{Read, Seek};
use std::ops::Range;
use std::os::fd::AsRawFd;
use std::os::unix::fs::symlink;
use std::path::Path;

use anyhow::{Context, Result, anyhow, ensure};
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::process::{Resource, getrlimit};
use tch::{CModule, Device, Kind, Tensor};

use super::Stack;
use super::gru::{INPUT, INPUT_BIAS, STATE, STATE_BIAS};
use super::shape::Shape;

/// More bytes than a module has beside its parameters.
const CODE: usize = 1 << 20;

/// Returns an error if this build cannot write TorchScript: that takes the feature `torch`.
pub fn check_script() -> Result<()> {
    Ok(())
}

/// Returns all networks as one TorchScript module, parameters included: the bytes of a file that PyTorch and libtorch open.
/// The archive in it gets the name `name`. Takes the feature `torch`: see [`check_script`].
///
/// `forward(inputs)` takes `[networks, batch, in]`, for any batch, and returns the outputs, `[networks, batch, out]`. With
/// a GRU it is one step. `forward(inputs, states)` also takes the states before it, `[networks, batch, hidden]`. It
/// returns the outputs and then the states after it in one table, `[networks, batch, out + hidden]`, because a traced
/// function has a single result.
pub fn script(stack: &Stack, name: &str) -> Result<Vec<u8>> {
    let (shape, networks) = (stack.shape(), stack.parameters().networks() as i64);
    // Their values do not matter: only the operations on them are recorded.
    let table = |width: usize| Tensor::zeros(&[networks, 2, width as i64], (Kind::Float, Device::Cpu));
    let states = Some(shape.state_width()).filter(|&width| width > 0);
    let arguments: Vec<Tensor> = [shape.inputs].into_iter().chain(states).map(table).collect();
    let towers: Vec<Tower> =
        shape.towers().iter().enumerate().map(|(index, shape)| Tower::of(stack, shape, index)).collect();
    let mut forward = |arguments: &[Tensor]| match arguments {
        [inputs] => vec![side_by_side(towers.iter().map(|tower| tower.layers(inputs)).collect())],
        [inputs, states] => {
            let before = states.chunk(towers.len() as i64, 2);
            let states: Vec<Tensor> =
                towers.iter().zip(&before).map(|(tower, state)| tower.gru_step(inputs, state)).collect();
            let outputs = towers.iter().zip(&states).map(|(tower, state)| tower.layers(state));
            let both: Vec<Tensor> = outputs.collect();
            vec![side_by_side(both.into_iter().chain(states).collect())]
        }
        _ => unreachable!("the arguments are inputs and perhaps states"),
    };
    let module = tch::no_grad(|| CModule::create_by_tracing("Networks", "forward", &arguments, &mut forward))?;
    in_memory(name, size_of_val(stack.parameters().values().as_slice()), |path| module.save(path))
}

/// Returns the bytes that libtorch writes to a file.
///
/// On a full disk libtorch ends this process. So the file is in memory, and a link of the wanted name leads to it.
/// `bytes`: size of the parameters.
fn in_memory(name: &str, bytes: usize, save: impl FnOnce(&Path) -> Result<(), tch::TchError>) -> Result<Vec<u8>> {
    let most = (bytes + bytes / 8 + CODE) as u64;
    let allowed = getrlimit(Resource::Fsize).current.unwrap_or(u64::MAX);
    ensure!(
        most <= allowed,
        "it may have {most} bytes, and files may have {allowed} here; raise the limit (ulimit -f)"
    );
    let mut memory = File::from(memfd_create("script", MemfdFlags::CLOEXEC).context("no memory for the module")?);
    let folder = tempfile::tempdir().context("the folder for temporary files (TMPDIR) cannot be written to")?;
    symlink(format!("/proc/self/fd/{}", memory.as_raw_fd()), folder.path().join(name))?;
    // By its open directory: libtorch takes only paths of UTF-8.
    let opened = File::open(folder.path())?;
    let path = format!("/proc/self/fd/{}/{name}", opened.as_raw_fd());
    // The lines after the first one say where in C++ the error comes from.
    let first_line =
        |error: tch::TchError| anyhow!("{}", error.to_string().lines().next().unwrap_or_default().to_owned());
    save(Path::new(&path)).map_err(first_line)?;
    let mut written = Vec::new();
    memory.rewind()?;
    memory.read_to_end(&mut written)?;
    Ok(written)
}

/// Joins the last columns of tables with the same rows.
fn side_by_side(mut tables: Vec<Tensor>) -> Tensor {
    if tables.len() == 1 { tables.remove(0) } else { Tensor::cat(&tables, 2) }
}

/// One tower of all networks as tensors. They are made before the trace. If a tensor is made during the trace, the module records
/// how it is made and not its values.
struct Tower {
    /// Weights and biases in the order of the layout, `[networks, ...]`.
    blocks: Vec<Tensor>,
    first_layer: usize,
    hidden: usize,
}

impl Tower {
    /// `shape`: that of the tower alone; `index`: its number in the network.
    fn of(stack: &Stack, shape: &Shape, index: usize) -> Tower {
        let parameters = stack.parameters();
        let block = |(_, shape, place): (&str, Vec<usize>, Range<usize>)| {
            let values: Vec<f32> = parameters.values().iter().flat_map(|row| &row[place.clone()]).copied().collect();
            let shape: Vec<i64> = shape.into_iter().map(|n| n as i64).collect();
            Tensor::of_slice(&values).view(&shape[..])
        };
        let (first, count) = (index * shape.blocks_per_tower(), shape.blocks_per_tower());
        Tower {
            blocks: parameters.layout().blocks(parameters.networks()).skip(first).take(count).map(block).collect(),
            first_layer: shape.first_layer(),
            hidden: shape.hidden.len(),
        }
    }

    /// Computes `bias + inputs x weight` for every network.
    fn affine(&self, inputs: &Tensor, weight: usize, bias: usize) -> Tensor {
        self.blocks[bias].baddbmm(inputs, &self.blocks[weight], 1, 1)
    }

    /// Computes the state after one step, with the same arithmetic as [`super::gru::forward`].
    fn gru_step(&self, inputs: &Tensor, state: &Tensor) -> Tensor {
        let from_inputs = self.affine(inputs, INPUT, INPUT_BIAS).chunk(3, 2); // r, z, n: [networks, batch, hidden] each
        let from_state = self.affine(state, STATE, STATE_BIAS).chunk(3, 2);
        let r = (&from_inputs[0] + &from_state[0]).sigmoid();
        let z = (&from_inputs[1] + &from_state[1]).sigmoid();
        let n = (&from_inputs[2] + r * &from_state[2]).tanh();
        &n + z * (state - &n)
    }

    fn layers(&self, inputs: &Tensor) -> Tensor {
        let mut values = inputs.shallow_clone();
        for layer in 0..=self.hidden {
            let block = self.first_layer + 2 * layer;
            values = self.affine(&values, block, block + 1);
            if layer < self.hidden {
                values = values.relu();
            }
        }
        values
    }
}
