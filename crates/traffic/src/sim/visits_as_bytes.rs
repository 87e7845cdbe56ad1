//! Visits as bytes, for other processes of the same program. Each driver is there once.

use std::collections::HashMap;
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};

use super::visits::{Driver, Visits};

#[derive(Serialize, Deserialize)]
struct Sent {
    /// Visits without their drivers.
    visits: Visits,
    drivers: Vec<Driver>,
    /// Number of the driver of each visit.
    numbers: Vec<Vec<usize>>,
}

/// Returns visits as bytes.
pub(crate) fn to_bytes(visits: &Visits) -> Result<Vec<u8>> {
    let mut known: HashMap<*const Driver, usize> = HashMap::new();
    let mut drivers = Vec::new();
    let mut number = |driver: &Arc<Driver>| {
        *known.entry(Arc::as_ptr(driver)).or_insert_with(|| {
            drivers.push(Driver::clone(driver));
            drivers.len() - 1
        })
    };
    let of_agents = visits.of_agents.iter();
    let numbers: Vec<Vec<usize>> =
        of_agents.map(|visits| visits.iter().map(|visit| number(&visit.driver)).collect()).collect();
    postcard::to_stdvec(&Sent { visits: visits.clone(), drivers, numbers }).context("visits cannot be encoded")
}

/// Reads the bytes of [`to_bytes`].
pub(crate) fn from_bytes(bytes: &[u8]) -> Result<Visits> {
    let broken = "these bytes are no visits";
    let Sent { mut visits, drivers, numbers } = postcard::from_bytes(bytes).context(broken)?;
    let drivers: Vec<Arc<Driver>> = drivers.into_iter().map(Arc::new).collect();
    ensure!(visits.of_agents.len() == numbers.len(), broken);
    for (visits, numbers) in visits.of_agents.iter_mut().zip(numbers) {
        ensure!(visits.len() == numbers.len(), broken);
        for (visit, number) in visits.iter_mut().zip(numbers) {
            visit.driver = drivers.get(number).context(broken)?.clone();
        }
    }
    Ok(visits)
}
