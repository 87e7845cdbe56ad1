//! What this build is, and how to get another one.

use dials_session::build::Program;

pub(crate) const PROGRAM: Program = Program {
    version: env!("CARGO_PKG_VERSION"),
    git_commit: env!("DIALS_GIT_COMMIT"),
    libtorch: env!("DIALS_LIBTORCH_VERSION"),
};

/// Features that `setup.sh` knows, with whether this program was built with them.
const FEATURES: [(&str, bool); 2] = [("torch", cfg!(feature = "torch")), ("mpi", cfg!(feature = "mpi"))];

/// Returns the command that installs what a feature needs, and builds this program with it. Features that it has are kept.
pub(crate) fn command_for_feature(feature: &str) -> String {
    let wanted = FEATURES.into_iter().filter(|&(name, built)| built || name == feature).map(|(name, _)| name);
    let wanted: Vec<&str> = wanted.collect();
    format!("./setup.sh {feature} && cargo install --path . --features {}", wanted.join(","))
}
