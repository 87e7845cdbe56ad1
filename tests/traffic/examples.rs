//! The examples run to their end. They can share this process: whoever needs SUMO waits for its turn.

#[path = "../../examples/custom_controller.rs"]
mod custom_controller;
#[path = "../../examples/custom_domain.rs"]
mod custom_domain;
#[path = "../../examples/local_ranking.rs"]
mod local_ranking;
#[path = "../../examples/one_decision.rs"]
mod one_decision;
#[path = "../../examples/stale_influence.rs"]
mod stale_influence;

use local_ranking::Behaviour;

#[test]
fn a_controller_of_ones_own_is_compared_with_gap_out() {
    custom_controller::main().unwrap();
}

#[test]
fn a_domain_of_ones_own_conforms_and_trains() {
    custom_domain::main().unwrap();
}

#[test]
fn a_decision_of_a_coordinated_light_taken_the_other_way_round_costs_itself_and_others() {
    let [itself, neighbours, two_roads] = one_decision::run(1).unwrap();
    assert!(itself < -1.0 && neighbours < itself && two_roads < neighbours, "{itself} {neighbours} {two_roads}");
}

#[test]
fn aips_of_untrained_lights_send_too_few_cars_in_platoons() {
    let [gs, stale_aips, stale_constants, aips, constants] = stale_influence::run("traffic_4", 8).unwrap();
    println!("{gs:?}\n{stale_aips:?}\n{stale_constants:?}\n{aips:?}\n{constants:?}");
    assert!(stale_aips.arrivals < 0.95 * gs.arrivals && stale_aips.arrivals < stale_constants.arrivals);
    assert!(stale_aips.nobody > gs.nobody && stale_aips.dispersion > gs.dispersion);
    assert!((aips.arrivals / gs.arrivals - 1.0).abs() < 0.05 && (constants.arrivals / gs.arrivals - 1.0).abs() < 0.05);
    assert!(constants.dispersion < gs.dispersion);
}

#[test]
fn local_simulators_with_random_aips_do_not_tell_a_good_light_from_a_slow_one() {
    let returns = local_ranking::run("paper/traffic_4", 4, &[Behaviour::Switches(0.02), Behaviour::GapOut]).unwrap();
    let [slow, good] = returns[..] else { panic!("two behaviours were played: {returns:?}") };
    println!("{slow:?}\n{good:?}");
    assert!(good.gs - slow.gs > 100.0 && good.trained - slow.trained > 90.0);
    assert!((good.untrained - slow.untrained).abs() < 6.0 && good.untrained < 100.0);
}
