//! `worker`: what `train` starts its worker processes with.

use std::sync::Arc;

use crate::config::Config;
use crate::domain::Domain;
use crate::error::{Error, Result};
use crate::processes::serve;
use crate::traffic::Traffic;

pub fn worker() -> Result<()> {
    serve(open_domain).map_err(Error::Run)
}

fn open_domain(config: &Config) -> anyhow::Result<Arc<dyn Domain>> {
    Ok(Arc::new(Traffic::open(&config.traffic, &config.policy)?))
}
