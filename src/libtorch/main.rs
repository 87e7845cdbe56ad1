//! `dials-traffic-torch`: what needs libtorch, in a program of its own.
//!
//! libtorch and the eighty libraries under it take a third of a second at every start of a program that is linked with
//! them, and 110 MB. `dials-traffic` starts many processes and needs libtorch in two rare commands. So it starts this
//! one for them: see `dials_cli::libtorch`.
//!
//! | words | reads | writes |
//! |---|---|---|
//! | `script NAME` | networks as safetensors | a TorchScript module; its archive gets this name |
//! | `peak SECONDS` | | floating-point operations per second, as text |
//! | `maps` | | its own /proc/self/maps, which names the libraries that it has loaded |

mod script;

use std::io::{Read, Write, stdin, stdout};
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Result, bail};
use stacknets::{SIDE, fastest_product};
use tch::{Device, Kind, Tensor};

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    match answer(&words).and_then(|bytes| Ok(stdout().write_all(&bytes)?)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprint!("{error:#}");
            ExitCode::FAILURE
        }
    }
}

fn answer(words: &[&str]) -> Result<Vec<u8>> {
    match words {
        ["script", name] => {
            let mut networks = Vec::new();
            stdin().read_to_end(&mut networks)?;
            script::script(&networks, name)
        }
        ["peak", seconds] => Ok(peak(Duration::try_from_secs_f64(seconds.parse()?)?).to_string().into_bytes()),
        ["maps"] => Ok(std::fs::read("/proc/self/maps")?),
        _ => bail!("this program is for dials-traffic, not for people"),
    }
}

/// Returns the operations per second of libtorch's products in one thread, at their best.
fn peak(time: Duration) -> f64 {
    tch::set_num_threads(1);
    let size = [SIDE as i64, SIDE as i64];
    let tensor = Tensor::rand(&size, (Kind::Float, Device::Cpu));
    let out = Tensor::empty(&size, (Kind::Float, Device::Cpu));
    fastest_product(time, || drop(tensor.matmul_out(&out, &tensor)))
}
