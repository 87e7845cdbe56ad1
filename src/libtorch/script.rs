//! Networks as TorchScript: a file that PyTorch and its C++ library open without this program.

use std::fs::File;
use std::io::{Read, Seek};
use std::os::fd::AsRawFd;
use std::os::unix::fs::symlink;
use std::path::Path;

use anyhow::{Context, Result, anyhow, ensure};
use rustix::fs::{MemfdFlags, memfd_create};
use rustix::process::{Resource, getrlimit};
use safetensors::SafeTensors;
use tch::{CModule, Device, Kind, Tensor};

/// More bytes than a module has beside its parameters.
const CODE: usize = 1 << 20;
/// Beginnings of the names of the tensors of each tower.
const TOWERS: [&str; 2] = ["", "critic."];

/// Returns all networks as one TorchScript module, parameters included. `networks`: bytes of a safetensors file.
pub(crate) fn script(networks: &[u8], name: &str) -> Result<Vec<u8>> {
    let file = SafeTensors::deserialize(networks).context("no networks on standard input")?;
    let towers: Vec<Tower> = TOWERS.iter().filter_map(|prefix| Tower::of(&file, prefix)).collect();
    let first = towers.first().context("no layers")?;
    let (count, inputs) = first.inputs();
    let states = first.gru.as_ref().map(|gru| gru.state_weight.size()[1] * towers.len() as i64);
    // Their values do not matter: only the operations on them are recorded.
    let table = |width: i64| Tensor::zeros(&[count, 2, width], (Kind::Float, Device::Cpu));
    let arguments: Vec<Tensor> = [inputs].into_iter().chain(states).map(table).collect();
    let mut forward = |arguments: &[Tensor]| match arguments {
        [inputs] => vec![side_by_side(towers.iter().map(|tower| tower.layers(inputs)).collect())],
        [inputs, states] => {
            let before = states.chunk(towers.len() as i64, 2);
            let states: Vec<Tensor> =
                towers.iter().zip(&before).map(|(tower, state)| tower.gru_step(inputs, state)).collect();
            let mut both: Vec<Tensor> = towers.iter().zip(&states).map(|(tower, state)| tower.layers(state)).collect();
            both.extend(states);
            vec![side_by_side(both)]
        }
        _ => unreachable!("the arguments are inputs and perhaps states"),
    };
    let module = tch::no_grad(|| CModule::create_by_tracing("Networks", "forward", &arguments, &mut forward))?;
    in_memory(name, networks.len(), |path| module.save(path))
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
    gru: Option<Gru>,
    /// Weights `[networks, in, out]` and biases `[networks, 1, out]` of the linear layers.
    layers: Vec<[Tensor; 2]>,
}

/// The recurrent part of a tower. Columns are those of the gates r, z and n.
struct Gru {
    input_weight: Tensor,
    state_weight: Tensor,
    input_bias: Tensor,
    state_bias: Tensor,
}

impl Tower {
    /// Returns the tower whose tensors have names that begin like this. If there is none: `None`.
    fn of(file: &SafeTensors<'_>, prefix: &str) -> Option<Tower> {
        let tensor = |name: &str| {
            let view = file.tensor(&format!("{prefix}{name}")).ok()?;
            let values: Vec<f32> =
                view.data().as_chunks::<4>().0.iter().map(|&value| f32::from_le_bytes(value)).collect();
            let shape: Vec<i64> = view.shape().iter().map(|&length| length as i64).collect();
            Some(Tensor::of_slice(&values).view(&shape[..]))
        };
        let layer = |number: usize| {
            Some([tensor(&format!("layers.{number}.weight"))?, tensor(&format!("layers.{number}.bias"))?])
        };
        let gru = || {
            Some(Gru {
                input_weight: tensor("gru.input_weight")?,
                state_weight: tensor("gru.state_weight")?,
                input_bias: tensor("gru.input_bias")?,
                state_bias: tensor("gru.state_bias")?,
            })
        };
        let layers: Vec<[Tensor; 2]> = (0..).map_while(layer).collect();
        (!layers.is_empty()).then(|| Tower { gru: gru(), layers })
    }

    fn inputs(&self) -> (i64, i64) {
        let first = self.gru.as_ref().map_or(&self.layers[0][0], |gru| &gru.input_weight).size();
        (first[0], first[1])
    }

    /// Computes the state after one step, with the same arithmetic as the crate `stacknets`.
    fn gru_step(&self, inputs: &Tensor, state: &Tensor) -> Tensor {
        let gru = self.gru.as_ref().expect("only networks with states are given states");
        let from_inputs = affine(inputs, &gru.input_weight, &gru.input_bias).chunk(3, 2); // r, z, n: [networks, batch, hidden] each
        let from_state = affine(state, &gru.state_weight, &gru.state_bias).chunk(3, 2);
        let r = (&from_inputs[0] + &from_state[0]).sigmoid();
        let z = (&from_inputs[1] + &from_state[1]).sigmoid();
        let n = (&from_inputs[2] + r * &from_state[2]).tanh();
        &n + z * (state - &n)
    }

    fn layers(&self, inputs: &Tensor) -> Tensor {
        let mut values = inputs.shallow_clone();
        for (layer, [weight, bias]) in self.layers.iter().enumerate() {
            values = affine(&values, weight, bias);
            if layer + 1 < self.layers.len() {
                values = values.relu();
            }
        }
        values
    }
}

/// Computes `bias + inputs x weight` for every network.
fn affine(inputs: &Tensor, weight: &Tensor, bias: &Tensor) -> Tensor {
    bias.baddbmm(inputs, weight, 1, 1)
}
