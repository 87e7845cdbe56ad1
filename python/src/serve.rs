//! The process of an environment: does what the Python process orders, until the channel is closed.

use std::os::fd::AsFd;
use std::os::unix::net::UnixStream;

use anyhow::{Context, Result, bail};
use dials_session::parent::end_with;

use crate::any_light::ReadAnyLight;
use crate::datasets::Datasets;
use crate::joint::Joint;
use crate::local::{Local, Running};
use crate::memory::Memory;
use crate::policies::Policies;
use crate::request::{Environment, Opened, Request, ResetRequest};
use crate::wire::{self, BEGIN, MEASURE, Order, RESET, STEP, TAKE};

/// Serves one environment. The control channel is standard input, a socket that keeps records apart. `memory`: the
/// descriptor of the shared memory. `parent`: the Python process.
pub(crate) fn serve(memory: i32, parent: u32) -> Result<()> {
    // The end of the control channel is no sign that the parent has ended: a copy of it, made by `fork`, may hold it open,
    // and a busy simulator does not read it. A process that is stopped reads nothing. The system kills it, too.
    // It counts the thread that started this process as the parent: `_starter.py` takes one that lasts.
    end_with(parent)?;
    let stdin = std::io::stdin().as_fd().try_clone_to_owned().context("no control channel")?;
    let mut stream = UnixStream::from(stdin);
    let Some(Order { number, tag, payload }) = wire::receive(&mut stream)? else { return Ok(()) };
    if tag != BEGIN {
        bail!("the first order must be to begin");
    }
    match begin(&payload, memory) {
        Err(error) => wire::answer(&mut stream, number, &Err(error)),
        Ok(Served::Joint(joint)) => {
            wire::answer(&mut stream, number, &Ok(joint.describe().to_string().into_bytes()))?;
            serve_joint(*joint, &mut stream)
        }
        Ok(Served::Datasets(datasets)) => {
            // They are in the memory already.
            wire::answer(&mut stream, number, &Ok(datasets.describe().to_string().into_bytes()))
        }
        Ok(Served::AnyLight(policy)) => {
            wire::answer(&mut stream, number, &Ok(policy.describe().to_string().into_bytes()))
        }
        Ok(Served::Policies(policies)) => {
            wire::answer(&mut stream, number, &Ok(policies.describe().to_string().into_bytes()))?;
            serve_policies(*policies, &mut stream)
        }
        Ok(Served::Local(local)) => {
            wire::answer(&mut stream, number, &Ok(local.describe().to_string().into_bytes()))?;
            serve_local(*local, &mut stream)
        }
    }
}

/// An environment that was opened.
enum Served {
    AnyLight(ReadAnyLight),
    Datasets(Datasets),
    Joint(Box<Joint>),
    Local(Box<Local>),
    Policies(Box<Policies>),
}

fn begin(payload: &[u8], memory: i32) -> Result<Served> {
    let Request { config, settings, environment } = wire::read(payload)?;
    let memory = Memory::open(memory)?;
    let opened = || Opened::open(&config, &settings);
    Ok(match environment {
        Environment::AnyLight(request) => Served::AnyLight(ReadAnyLight::open(&request, memory)?),
        Environment::Datasets(request) => Served::Datasets(Datasets::open(opened()?, &request, memory)?),
        Environment::Policies(request) => Served::Policies(Box::new(Policies::open(&config, &request, memory)?)),
        Environment::Joint(request) => Served::Joint(Box::new(Joint::open(opened()?, request, memory)?)),
        Environment::Local(request) => Served::Local(Box::new(Local::open(opened()?, request, memory)?)),
    })
}

fn serve_joint(mut joint: Joint, stream: &mut UnixStream) -> Result<()> {
    while let Some(Order { number, tag, payload }) = wire::receive(stream)? {
        wire::answer(stream, number, &joint.obey(tag, &payload))?;
    }
    Ok(())
}

fn serve_policies(mut policies: Policies, stream: &mut UnixStream) -> Result<()> {
    while let Some(Order { number, tag, payload }) = wire::receive(stream)? {
        let outcome = match tag {
            STEP => policies.step(),
            RESET => wire::read(&payload).and_then(|request| policies.reset(&request)),
            TAKE => policies.take(),
            other => bail!("policies have no order {other}"),
        };
        wire::answer(stream, number, &outcome.map(|()| Vec::new()))?;
    }
    Ok(())
}

/// Serves local simulators. Each reset makes new ones: the old ones are dropped first, because a process holds one SUMO.
fn serve_local(mut local: Local, stream: &mut UnixStream) -> Result<()> {
    let mut next = wire::receive(stream)?;
    while let Some(Order { number, tag, payload }) = next {
        if tag != RESET {
            wire::answer(stream, number, &Err(anyhow::anyhow!("there is no episode under way; call reset() first")))?;
            next = wire::receive(stream)?;
            continue;
        }
        next = match wire::read(&payload).and_then(|request: ResetRequest| local.reset(&request)) {
            Ok(mut running) => {
                wire::answer(stream, number, &running.show_roads())?;
                serve_running(running, stream)?
            }
            Err(error) => {
                wire::answer(stream, number, &Err(error))?;
                wire::receive(stream)?
            }
        };
    }
    Ok(())
}

/// Serves local simulators until they are reset. Returns the order that ended this.
fn serve_running(mut running: Running<'_>, stream: &mut UnixStream) -> Result<Option<Order>> {
    while let Some(order) = wire::receive(stream)? {
        let outcome = match order.tag {
            STEP => running.step(),
            MEASURE => Ok(running.counters().to_string().into_bytes()),
            _ => return Ok(Some(order)),
        };
        wire::answer(stream, order.number, &outcome)?;
    }
    Ok(None)
}
