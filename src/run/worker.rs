//! `worker`: what `train` starts its worker processes with.

use super::domain;
use crate::error::{Error, Result};
use crate::processes::serve;

pub fn worker() -> Result<()> {
    serve(domain::open).map_err(Error::Run)
}
