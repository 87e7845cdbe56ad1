//! Compares your own traffic controller with gap-out, on the same traffic.
//!
//! ```sh
//! cargo run --release --example custom_controller
//! ```

use std::path::Path;

use anyhow::Result;
use dials_core::base::Seed;
use dials_core::base::statistics::Interval;
use dials_core::domain::{BuiltInControl, Domain, GlobalSimulator};
use dials_learn::evaluation::{Evaluation, play_episodes};
use dials_traffic::Traffic;
use dials_traffic::config::TrafficConfig;
use dials_traffic::controllers::{Each, HandCoded, Intersection};

const EPISODES: usize = 10;

/// Gives green to the lanes with more cars, but keeps every green for at least three steps. It returns the green that
/// the light should show, and knows nothing of the shape of the intersection.
fn more_cars(at: &Intersection<'_>) -> usize {
    let Some(green) = at.green().filter(|_| at.shown_steps() >= 3) else { return at.target() };
    let cars = |green| at.plan().served(green).map(|approach| at.cars(approach).len()).sum::<usize>();
    let best = at.others(green).max_by_key(|&other| cars(other)).unwrap_or(green);
    if cars(best) > cars(green) { best } else { green }
}

pub(crate) fn main() -> Result<()> {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let config = TrafficConfig::new(nets.join("grid_2x2"), nets.join("local"));
    let traffic = Traffic::open(&config)?;

    // The seed determines the traffic, so both controllers see the same cars. SUMO allows one simulation per process,
    // so the first simulator is dropped before the second one starts.
    let play = |mut simulator: Box<dyn GlobalSimulator>| -> Result<Evaluation> {
        let episodes = play_episodes(&mut *simulator, &mut BuiltInControl, Seed::new(1), EPISODES, &mut |_| ())?;
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
