//! The features of this build, and how to get another one.

/// Features that `setup.sh` knows, with whether this program was built with them.
const FEATURES: [(&str, bool); 2] = [("torch", cfg!(feature = "torch")), ("mpi", cfg!(feature = "mpi"))];

/// Returns the command that installs what a feature needs, and builds this program with it. Features that it has are kept.
pub(crate) fn command_for_feature(feature: &str) -> String {
    command(feature, &FEATURES)
}

fn command(feature: &str, features: &[(&str, bool)]) -> String {
    let wanted = features.iter().filter(|(name, built)| *built || *name == feature).map(|(name, _)| *name);
    let wanted: Vec<&str> = wanted.collect();
    format!("./setup.sh {feature} && cargo install --path . --features {}", wanted.join(","))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_further_feature_does_not_cost_one_that_is_there() {
        let build = |torch| [("torch", torch), ("mpi", false)];
        assert_eq!(command("mpi", &build(false)), "./setup.sh mpi && cargo install --path . --features mpi");
        assert_eq!(command("mpi", &build(true)), "./setup.sh mpi && cargo install --path . --features torch,mpi");
    }
}
