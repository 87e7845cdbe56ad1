//! A traffic controller of your own against gap-out, on the same traffic.
//!
//! ```sh
//! cargo run --release --example custom_controller
//! ```

use std::path::Path;

use anyhow::Result;
use dials_traffic::base::Seed;
use dials_traffic::config::{PolicyConfig, TrafficConfig};
use dials_traffic::domain::{Action, Controller, Domain, Percept};
use dials_traffic::evaluation::{Evaluation, evaluate};
use dials_traffic::traffic::Traffic;
use dials_traffic::traffic::grid::Side;
use dials_traffic::traffic::region::{CELLS, OCCUPANCY};
use dials_traffic::traffic::signals::{KEEP, Light, SWITCH};

/// Cells before the line in which cars count: 30 m.
const NEAR: usize = 3;

/// Gives green to whichever road has more cars near the line, but not before some seconds have passed.
struct MoreCars {
    min_green: usize,
    /// Steps since the light last changed, per intersection.
    green_for: Vec<usize>,
}

impl Controller for MoreCars {
    fn begin(&mut self, _episode: Seed) {
        self.green_for.clear();
    }

    /// `percept.obs`: one row per intersection, as `traffic::region` lays it out: for each edge (west, south, east,
    /// north) nine cells from the stop line on, 1 where a car is, and then what the light shows.
    fn act(&mut self, percept: &Percept, actions: &mut [Action]) -> Result<()> {
        self.green_for.resize(actions.len(), 0);
        for ((action, obs), green_for) in actions.iter_mut().zip(percept.obs.iter()).zip(&mut self.green_for) {
            let cars = |sides: [Side; 2]| -> f32 {
                let edges = (0..Side::ALL.len()).filter(|&edge| sides.contains(&Side::ALL[edge]));
                edges.map(|edge| obs[edge * CELLS..][..NEAR].iter().sum::<f32>()).sum()
            };
            let (horizontal, vertical) = (cars([Side::West, Side::East]), cars([Side::South, Side::North]));
            let shows = |light: Light| obs[OCCUPANCY + light as usize] == 1.0;
            let wanted = (shows(Light::HorizontalGreen) && vertical > horizontal)
                || (shows(Light::VerticalGreen) && horizontal > vertical);
            *action = if wanted && *green_for >= self.min_green { SWITCH } else { KEEP };
            *green_for = if *action == SWITCH { 0 } else { *green_for + 1 };
        }
        Ok(())
    }
}

pub fn main() -> Result<()> {
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let config = TrafficConfig {
        network: nets.join("grid_2x2"),
        local_network: nets.join("local"),
        horizon: 300,
        d_set: Default::default(),
        entry: Default::default(),
    };
    let traffic = Traffic::open(&config, &PolicyConfig::default())?;

    // The seed is the traffic: both controllers meet the same cars. SUMO allows one simulation per process, so that of
    // the first one is dropped before the second begins.
    let play = |controller: &mut dyn Controller| -> Result<Evaluation> {
        let mut simulator = traffic.global_simulator()?;
        evaluate(&traffic, &mut *simulator, controller, Seed::new(1), 10, &mut |_| ())
    };
    let mine = play(&mut MoreCars { min_green: 3, green_for: Vec::new() })?;
    let gap_out = play(&mut dials_traffic::traffic::controllers::GapOut)?;
    for (name, found) in [("more-cars", &mine), ("gap-out", &gap_out)] {
        let all = found.of_all();
        println!("{name:>10}: return {:.1} +- {:.1}", all.mean, all.std_error);
    }

    // What differs within an episode is the controllers' doing alone, so the difference is known better than either.
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let pairs = mine.returns.iter().zip(gap_out.returns.iter());
    let differences: Vec<f64> = pairs.map(|(mine, theirs)| mean(mine) - mean(theirs)).collect();
    let (difference, count) = (mean(&differences), differences.len() as f64);
    let variance = differences.iter().map(|d| (d - difference).powi(2)).sum::<f64>() / (count - 1.0);
    println!("difference: {difference:+.1} +- {:.1} (standard error over {count} episodes)", (variance / count).sqrt());
    Ok(())
}
