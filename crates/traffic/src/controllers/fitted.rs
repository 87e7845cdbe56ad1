//! Timings of a file, put on the lights of a net.

use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};

use super::are_of_a_grid;
use super::timing::{ClockPlan, Leeway, Timing};
use super::timing_file::{LightTiming, TimingFile, WAY_OUT, shape};
use crate::agents::plan::AgentPlan;
use dials_core::outside::Printable;

impl TimingFile {
    /// Reads what a controller follows at these lights from a file that was tuned for it.
    pub fn plan(path: &Path, controller: &str, plans: &[AgentPlan]) -> Result<ClockPlan> {
        let file = TimingFile::read(path)?;
        let timings =
            file.timings(controller, plans).map_err(|error| anyhow!("{}: {error}; {WAY_OUT}", path.display()))?;
        Ok(ClockPlan { timings, leeway: Leeway { early: file.early, late: file.late } })
    }

    fn timings(&self, controller: &str, plans: &[AgentPlan]) -> Result<Vec<Timing>> {
        let TimingFile { vertical, horizontal, offsets, lights, tuned_on, .. } = self;
        ensure!(
            tuned_on.controller == controller,
            "has timings of {}, not of {controller}",
            Printable(&tuned_on.controller)
        );
        let network = Printable(&tuned_on.network);
        if let (Some(vertical), Some(horizontal)) = (*vertical, *horizontal) {
            ensure!(are_of_a_grid(plans), "timings for the grid {network} do not fit a net that is none");
            ensure!(
                offsets.len() == plans.len(),
                "timings for the {} intersections of {network} do not fit the {} intersections of this grid",
                offsets.len(),
                plans.len()
            );
            let [own_rows, own_columns] = shape(plans);
            if let Some([rows, columns]) = self.shape.filter(|tuned| *tuned != [own_rows, own_columns]) {
                bail!("timings for the {rows}x{columns} grid {network} do not fit this {own_rows}x{own_columns} grid");
            }
            let timing =
                |(plan, &offset): (&AgentPlan, &u32)| Timing::new(&plan.phases, &[vertical, horizontal], offset);
            return Ok(plans.iter().zip(offsets).map(timing).collect());
        }
        ensure!(
            lights.len() == plans.len(),
            "timings for the {} lights of {network} do not fit the {} lights of this net",
            lights.len(),
            plans.len()
        );
        plans.iter().zip(lights).map(|(plan, light)| of_light(plan, light)).collect()
    }
}

fn of_light(plan: &AgentPlan, LightTiming { name, greens, offset }: &LightTiming) -> Result<Timing> {
    let wanted = Printable(&plan.light);
    ensure!(*name == plan.light, "has light {} in the place of light {wanted}", Printable(name));
    ensure!(
        greens.len() == plan.greens(),
        "has {} greens for light {wanted}, which has {}",
        greens.len(),
        plan.greens()
    );
    Ok(Timing::new(&plan.phases, greens, *offset))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrafficConfig;
    use crate::controllers::examples::crossing;
    use crate::controllers::timing_file::Score;
    use crate::controllers::timing_file::tests::tuned_on;
    use crate::paper_grid::grid::Grid;
    use crate::paper_grid::plans::plans;

    fn grid(rows: usize, cols: usize) -> Vec<AgentPlan> {
        plans(Grid::new(rows, cols).unwrap(), &TrafficConfig::new("", ""))
    }

    fn error(file: &TimingFile, controller: &str, plans: &[AgentPlan]) -> String {
        file.timings(controller, plans).unwrap_err().to_string()
    }

    #[test]
    fn timings_of_a_grid_fit_a_grid_with_as_many_intersections() {
        let lights = grid(2, 2);
        let timings: Vec<Timing> =
            [0, 13, 13, 0].map(|offset| Timing::new(&lights[0].phases, &[9, 11], offset)).to_vec();
        let found = ClockPlan { timings: timings.clone(), leeway: Leeway { early: 3, late: 1 } };
        let file = TimingFile::new(&lights, &found, Score::Return(1.0), tuned_on("coordinated"));
        assert_eq!(file.timings("coordinated", &lights).unwrap(), timings);
        assert_eq!(error(&file, "fixed-time", &lights), "has timings of coordinated, not of fixed-time");
        assert_eq!(
            error(&file, "coordinated", &grid(2, 3)),
            "timings for the 4 intersections of grid_2x2 do not fit the 6 intersections of this grid"
        );
        let turned = error(&file, "coordinated", &grid(1, 4));
        assert_eq!(turned, "timings for the 2x2 grid grid_2x2 do not fit this 1x4 grid");
        let older = TimingFile { shape: None, ..file.clone() };
        assert!(older.timings("coordinated", &grid(1, 4)).is_ok(), "older versions did not write it");
        assert_eq!(
            error(&file, "coordinated", &[crossing()]),
            "timings for the grid grid_2x2 do not fit a net that is none"
        );
    }

    #[test]
    fn timings_of_a_net_fit_lights_with_their_names_and_greens() {
        let lights = [crossing()];
        let timings = vec![Timing::new(&lights[0].phases, &[9, 0, 7, 5], 3)];
        let found = ClockPlan { timings: timings.clone(), leeway: Leeway::NONE };
        let file = TimingFile::new(&lights, &found, Score::DelaySeconds(1.0), tuned_on("fixed-time"));
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        std::fs::write(&path, file.to_toml().unwrap()).unwrap();
        assert_eq!(TimingFile::plan(&path, "fixed-time", &lights).unwrap(), found);
        assert_eq!(
            error(&file, "fixed-time", &grid(1, 2)),
            "timings for the 1 lights of grid_2x2 do not fit the 2 lights of this net"
        );
        let renamed = [AgentPlan { light: "other".to_owned(), ..crossing() }];
        assert_eq!(error(&file, "fixed-time", &renamed), "has light crossing in the place of light other");
        let mut short = file.clone();
        short.lights[0].greens.pop();
        assert_eq!(error(&short, "fixed-time", &lights), "has 3 greens for light crossing, which has 4");
    }
}
