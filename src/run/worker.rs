//! `worker`: the hidden command that `train` starts as its worker processes.

use dials_session::domains;
use dials_session::error::{Error, Result};
use dials_session::fleet::children::serve_the_parent;

pub(super) fn worker() -> Result<()> {
    serve_the_parent(domains::open_tried).map_err(Error::Run)
}
