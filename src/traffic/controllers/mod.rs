//! Hand-coded controllers of traffic lights, to compare policies with.
//!
//! All act through the same GS as a policy and see the same percepts; only `actuated` is SUMO's own program.

mod gap_out;
mod simple;

use anyhow::{Result, bail};

use super::global::SignalControl;
use crate::base::Seed;
use crate::domain::Controller;

pub use gap_out::GapOut;
pub use simple::{Constant, Random, SwitchEvery};

/// What [`by_name`] takes; K stands for a number of steps.
pub const NAMES: &[&str] = &["random", "never", "always", "switch-every-K", "actuated", "gap-out"];

const SWITCH_EVERY: &str = "switch-every-";

/// A controller and who runs the lights under it.
pub fn by_name(name: &str) -> Result<(Box<dyn Controller>, SignalControl)> {
    let controller: Box<dyn Controller> = match name {
        "random" => Box::new(Random::new(Seed::new(0))),
        "never" => Box::new(Constant::never()),
        "always" => Box::new(Constant::always()),
        "gap-out" => Box::new(GapOut),
        "actuated" => return Ok((Box::new(Constant::never()), SignalControl::Actuated)),
        _ => match name.strip_prefix(SWITCH_EVERY).map(str::parse::<usize>) {
            Some(Ok(steps)) if steps >= 1 => Box::new(SwitchEvery::new(steps)),
            Some(_) => bail!("controller `{name}`: K must be a number of steps, at least 1, as in {SWITCH_EVERY}10"),
            None => bail!("controller `{name}`: unknown; one of {}", NAMES.join(", ")),
        },
    };
    Ok((controller, SignalControl::Agents))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unknown_names_get_the_list_and_bad_numbers_the_reason() {
        let error = |name: &str| by_name(name).err().expect("a bad name").to_string();
        assert!(error("fixed").contains("unknown; one of random, never, always, switch-every-K, actuated, gap-out"));
        for name in ["switch-every-0", "switch-every-", "switch-every-ten"] {
            assert!(error(name).contains("K must be a number of steps"));
        }
    }

    #[test]
    fn only_actuated_runs_without_the_agents() {
        for name in ["random", "never", "always", "switch-every-10", "gap-out"] {
            assert_eq!(by_name(name).unwrap().1, SignalControl::Agents);
        }
        assert_eq!(by_name("actuated").unwrap().1, SignalControl::Actuated);
    }
}
