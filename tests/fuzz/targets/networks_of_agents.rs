//! The networks of a run: `policies.safetensors` and `aips.safetensors`.

use std::fs;
use std::path::Path;

use dials_core::domain::Domain;
use dials_session::config::RunConfig;
use dials_session::domains::DomainConfig;
use dials_session::records::files::{AIPS, CONFIG, POLICIES};
use dials_session::records::joint_layout::JointLayout;
use dials_warehouse::Warehouse;

use crate::place::work;
use crate::run;
use crate::verdict::Verdict;

fn files(name: &str) -> Vec<Vec<u8>> {
    ["whole", "other"].iter().map(|dir| fs::read(run::dir(dir).join(name)).expect("the run wrote it")).collect()
}

pub fn policies_seeds() -> Vec<Vec<u8>> {
    files(POLICIES)
}

pub fn aips_seeds() -> Vec<Vec<u8>> {
    files(AIPS)
}

pub fn policies(bytes: &[u8]) -> Verdict {
    read(bytes, |config, domain| JointLayout::of_policies(domain.kinds(), &config.learning.policy))
}

pub fn aips(bytes: &[u8]) -> Verdict {
    read(bytes, |config, domain| {
        JointLayout::of_aips(domain.kinds(), config.learning.predictor(), &config.learning.aip)
    })
}

/// Accepted networks have finite parameters, one row for each agent.
fn read(bytes: &[u8], layout: impl Fn(&RunConfig, &Warehouse) -> JointLayout) -> Verdict {
    let path = work().join("networks.safetensors");
    fs::write(&path, bytes).expect("a file to work with");
    let config = dials_session::config::load(&run::dir("whole").join(CONFIG), &[]).expect("the run has a config");
    let Some(DomainConfig::Warehouse(table)) = &config.domain else { unreachable!("the run is of the warehouse") };
    let domain = Warehouse::new(table);
    match layout(&config, &domain).read(Path::new(&path)) {
        Err(error) => Verdict::refused(error),
        Ok(networks) => {
            assert_eq!(networks.len(), domain.agents(), "one network for each agent");
            assert!(networks.as_slice().iter().all(|value| value.is_finite()), "a parameter is not a finite number");
            Verdict::Accepted
        }
    }
}
