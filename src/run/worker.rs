//! `worker`: the hidden command that `train` starts as its worker processes.

use super::domain;
use crate::error::{Error, Result};
use crate::fleet::children::serve_the_parent;

pub fn worker() -> Result<()> {
    serve_the_parent(domain::open_tried).map_err(Error::Run)
}
