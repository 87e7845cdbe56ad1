//! The examples run to their end. They can share this process, because only one of them uses SUMO.

#[path = "../examples/custom_controller.rs"]
mod custom_controller;
#[path = "../examples/custom_domain.rs"]
mod custom_domain;

#[test]
fn a_controller_of_ones_own_is_compared_with_gap_out() {
    custom_controller::main().unwrap();
}

#[test]
fn a_domain_of_ones_own_conforms_and_trains() {
    custom_domain::main().unwrap();
}
