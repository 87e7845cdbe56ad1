//! Compares your own traffic controller with gap-out, on the same traffic.
//!
//! ```sh
//! cargo run --release --example custom_controller
//! ```

use std::path::Path;

use anyhow::Result;
use dials_traffic::base::Seed;
use dials_traffic::base::statistics::Interval;
use dials_traffic::config::TrafficConfig;
use dials_traffic::domain::{Action, Bystander, Domain, GlobalSimulator};
use dials_traffic::evaluation::{Evaluation, play_episodes};
use dials_traffic::traffic::Traffic;
use dials_traffic::traffic::agents::phases::Light;
use dials_traffic::traffic::controllers::{Each, HandCoded, Intersection};
use dials_traffic::traffic::light::{KEEP, SWITCH};
use dials_traffic::traffic::side::Side;

const EPISODES: usize = 10;

/// Gives green to the road with more incoming cars, but keeps every green for at least three steps.
fn more_cars(at: &Intersection<'_>) -> Action {
    let cars = |sides: [Side; 2]| sides.into_iter().map(|side| at.incoming(side).len()).sum::<usize>();
    let (horizontal, vertical) = (cars([Side::West, Side::East]), cars([Side::South, Side::North]));
    let wanted = match at.light() {
        Light::HorizontalGreen => vertical > horizontal,
        Light::VerticalGreen => horizontal > vertical,
        Light::HorizontalYellow | Light::VerticalYellow => false,
    };
    if wanted && at.shown_steps() >= 3 { SWITCH } else { KEEP }
}

pub fn main() -> Result<()> {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let config = TrafficConfig::new(nets.join("grid_2x2"), nets.join("local"));
    let traffic = Traffic::open(&config)?;

    // The seed determines the traffic, so both controllers see the same cars. SUMO allows one simulation per process,
    // so the first simulator is dropped before the second one starts.
    let play = |mut simulator: Box<dyn GlobalSimulator>| -> Result<Evaluation> {
        let episodes = play_episodes(&mut *simulator, &mut Bystander, Seed::new(1), EPISODES, &mut |_| ())?;
        Ok(Evaluation::new(&traffic, &episodes))
    };
    let rule = HandCoded::rule(Each(more_cars));
    let mine = play(Box::new(traffic.global(traffic.everywhere(rule))?))?;
    let gap_out = play(traffic.baseline("gap-out")?.simulator)?;
    for (name, found) in [("more-cars", &mine), ("gap-out", &gap_out)] {
        let all = found.of_all();
        println!(
            "{name:>10}: return {:.1} +- {:.1} (standard error over {EPISODES} episodes)",
            all.mean, all.std_error
        );
    }

    // Within an episode only the controllers differ, so the difference is more certain than either return.
    let mean = |found: &Evaluation| -> Vec<f64> {
        found.returns.iter().map(|agents| agents.iter().sum::<f64>() / agents.len() as f64).collect()
    };
    let difference = Interval::of_differences(&mean(&mine), &mean(&gap_out));
    let half_width = difference.half_width.expect("there are several episodes");
    println!("difference: {:+.1} +- {half_width:.1} (95 % interval, {EPISODES} pairs of episodes)", difference.mean);
    Ok(())
}
