//! Returns of hand-coded controllers, compared with those of an independent implementation of the same specification.

use std::path::Path;

use dials_core::base::Seed;
use dials_core::domain::Domain;
use dials_learn::evaluation::{Evaluation, play_episodes};
use dials_traffic::Traffic;
use dials_traffic::config::{EntryRule, TrafficConfig};

/// Asserts that the mean return over 40 episodes differs from the reference by less than 4 standard errors of the
/// difference.
fn assert_return(grid: &str, controller: &str, reference: f64, reference_error: f64) {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let config = TrafficConfig { entry: EntryRule::Max, ..TrafficConfig::new(nets.join(grid), nets.join("local")) };
    let domain = Traffic::open(&config).unwrap();
    let mut baseline = domain.baseline(controller).unwrap();
    let (simulator, acting) = (&mut *baseline.simulator, &mut *baseline.controller);
    let reports = play_episodes(simulator, acting, Seed::new(1), 40, &mut |_| ()).unwrap();
    let all = Evaluation::new(&domain, &reports).of_all();
    let error = all.std_error.hypot(reference_error);
    println!(
        "{grid} {controller}: {:.1} +- {:.1}, reference {reference} +- {reference_error}",
        all.mean, all.std_error
    );
    assert!((all.mean - reference).abs() < 4.0 * error, "{grid} {controller}: {all:?}, reference {reference}");
}

#[test]
fn random_control_on_2x2() {
    assert_return("grid_2x2", "random", 143.9, 1.2);
}

#[test]
fn actuated_control_on_2x2() {
    assert_return("grid_2x2", "actuated", 171.5, 1.0);
}

#[test]
fn switching_every_10_steps_on_2x2() {
    assert_return("grid_2x2", "switch-every-10", 175.6, 0.8);
}

#[test]
fn gap_out_on_2x2() {
    // "about 215"
    assert_return("grid_2x2", "gap-out", 215.0, 1.0);
}

#[test]
fn fixed_time_with_checkerboard_offsets_on_2x2() {
    // "205"
    assert_return("grid_2x2", "fixed-time:green=10,offsets=checkerboard", 205.0, 1.0);
}

#[test]
fn random_control_on_5x5() {
    assert_return("grid_5x5", "random", 159.5, 0.7);
}

#[test]
fn actuated_control_on_5x5() {
    assert_return("grid_5x5", "actuated", 166.2, 1.1);
}
