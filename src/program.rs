//! What this build is.

use dials_session::build::Program;

pub(crate) const PROGRAM: Program = Program {
    version: env!("CARGO_PKG_VERSION"),
    git_commit: env!("DIALS_GIT_COMMIT"),
    libtorch: env!("DIALS_LIBTORCH_VERSION"),
};
