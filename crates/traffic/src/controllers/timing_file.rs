//! Timings that the tuner found, in a file that says what they were tuned on.

use std::collections::BTreeSet;
use std::fmt;
use std::path::Path;

use anyhow::{Context, Result, anyhow, bail, ensure};
use serde::{Deserialize, Serialize};

use super::are_of_a_grid;
use super::arguments::GREENS;
use super::clock::{ClockPlan, Leeway, Timing};
use crate::agents::plan::AgentPlan;
use dials_core::outside::{Printable, read_bytes, read_text};

const WAY_OUT: &str = "`dials-traffic baseline CONFIG --controller NAME --tune` makes one that fits";

/// Largest file. Offsets of 10 000 intersections have 50 kB.
const MOST_BYTES: u64 = 1 << 20;

/// A TOML file, for readers and for `fixed-time:file=PATH` or `coordinated:file=PATH`. All times are in steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimingFile {
    /// Green of a grid for the cars from south and north, and from west and east; the same at all intersections.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) vertical: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) horizontal: Option<u32>,
    /// Number of steps from the beginning of an episode to the beginning of the first green, for each agent of a grid.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) offsets: Vec<u32>,
    /// Rows and columns of the grid; `None` for a net that is no grid.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) shape: Option<[usize; 2]>,
    /// Leeway of `coordinated`: 0 for `fixed-time`.
    #[serde(default)]
    pub(crate) early: u32,
    #[serde(default)]
    pub(crate) late: u32,
    /// Mean return on the episodes of the tuning, if that was the score.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mean_return: Option<f64>,
    /// Mean delay on the episodes of the tuning in seconds, if that was the score.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) mean_delay_s: Option<f64>,
    pub tuned_on: TunedOn,
    /// Timings of the lights of a net that is no grid.
    #[serde(default, rename = "light", skip_serializing_if = "Vec::is_empty")]
    pub(crate) lights: Vec<LightTiming>,
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LightTiming {
    pub(crate) name: String,
    pub(crate) greens: Vec<u32>,
    pub(crate) offset: u32,
}

/// Everything that timings depend on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TunedOn {
    pub(crate) controller: String,
    /// Name of the network, without its folder, because the folder can change.
    pub network: String,
    /// CRC-32 of the net and the routes.
    pub(crate) network_crc32: String,
    pub(crate) horizon: usize,
    pub(crate) episodes: usize,
    /// Seed as text, because TOML's numbers end at 2^63.
    pub(crate) seed: String,
    pub(crate) search_version: u32,
    pub(crate) sumo_version: String,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Score {
    /// Mean return of an agent.
    Return(f64),
    /// Mean delay of a car in seconds.
    DelaySeconds(f64),
}

impl fmt::Display for Score {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Score::Return(mean) => write!(f, "return {mean:.1}"),
            Score::DelaySeconds(mean) => write!(f, "delay {mean:.1} s"),
        }
    }
}

impl TimingFile {
    pub(crate) fn new(plans: &[AgentPlan], found: &ClockPlan, score: Score, tuned_on: TunedOn) -> TimingFile {
        let ClockPlan { timings, leeway } = found;
        let is_grid = are_of_a_grid(plans);
        let green = |green: usize| is_grid.then(|| timings[0].greens()[green]);
        let light = |(plan, timing): (&AgentPlan, &Timing)| LightTiming {
            name: plan.light.clone(),
            greens: timing.greens().to_vec(),
            offset: timing.offset(),
        };
        let (mean_return, mean_delay_s) = match score {
            Score::Return(mean) => (Some(mean), None),
            Score::DelaySeconds(mean) => (None, Some(mean)),
        };
        TimingFile {
            vertical: green(0),
            horizontal: green(1),
            offsets: if is_grid { timings.iter().map(Timing::offset).collect() } else { Vec::new() },
            shape: is_grid.then(|| shape(plans)),
            early: leeway.early,
            late: leeway.late,
            mean_return,
            mean_delay_s,
            tuned_on,
            lights: if is_grid { Vec::new() } else { plans.iter().zip(timings).map(light).collect() },
        }
    }

    pub fn read(path: &Path) -> Result<TimingFile> {
        let place = path.display();
        let text = read_text(path, MOST_BYTES).with_context(|| format!("{place}: cannot be read; {WAY_OUT}"))?;
        let foreign = || format!("{place}: is not a file of tuned timings of this version; {WAY_OUT}");
        let file: TimingFile =
            toml::from_str(&text).map_err(|error| anyhow!(reason(&error, &text))).with_context(foreign)?;
        file.check().map_err(|error| anyhow!("{place}: {error}; {WAY_OUT}"))?;
        Ok(file)
    }

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

    pub(crate) fn checksum(path: &Path) -> Result<u32> {
        let bytes =
            read_bytes(path, MOST_BYTES).with_context(|| format!("{}: cannot be read; {WAY_OUT}", path.display()))?;
        Ok(crc32fast::hash(&bytes))
    }

    fn check(&self) -> Result<()> {
        let of_a_grid = self.vertical.is_some() && self.horizontal.is_some() && self.lights.is_empty();
        let of_a_net = self.vertical.is_none() && self.horizontal.is_none() && self.offsets.is_empty();
        ensure!(of_a_grid || of_a_net, "must have either vertical, horizontal and offsets, or a [[light]] per light");
        for (name, green) in [("vertical", self.vertical), ("horizontal", self.horizontal)] {
            let Some(green) = green else { continue };
            ensure!(GREENS.contains(&green), "{name} = {green}: must be from 1 to 3600 steps");
        }
        for LightTiming { name, greens, .. } in &self.lights {
            let good = greens.iter().all(|&green| green == 0 || GREENS.contains(&green));
            let some = greens.iter().any(|&green| green > 0);
            ensure!(good && some, "light {}: greens must be from 0 to 3600 steps, and not all 0", Printable(name));
        }
        for (name, steps) in [("early", self.early), ("late", self.late)] {
            let most = Leeway::MOST;
            ensure!(steps <= most, "{name} = {steps}: must be at most {most} steps");
        }
        let means = [("mean_return", self.mean_return), ("mean_delay_s", self.mean_delay_s)];
        for (name, mean) in means {
            let Some(mean) = mean else { continue };
            ensure!(mean.is_finite(), "{name} = {mean}: must be a finite number");
        }
        ensure!(
            means.iter().filter(|(_, mean)| mean.is_some()).count() == 1,
            "must have one of mean_return and mean_delay_s"
        );
        Ok(())
    }

    pub fn score(&self) -> Score {
        let of_return = self.mean_return.map(Score::Return);
        of_return.or(self.mean_delay_s.map(Score::DelaySeconds)).expect("one of the two is there")
    }

    pub fn to_toml(&self) -> Result<String> {
        Ok(format!(
            "# Timings of lights, in steps; play them with: --controller {}:file=FILE\n{}",
            self.tuned_on.controller,
            toml::to_string(self)?
        ))
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
    if let Some(why) = plan.phases.misfit(greens) {
        bail!("does not fit light {wanted}: {why}");
    }
    Ok(Timing::new(&plan.phases, greens, *offset))
}

/// Returns where and why a text is not TOML, without the line itself, which may be endless.
fn reason(error: &toml::de::Error, text: &str) -> String {
    const MOST: usize = 300;
    let before = error.span().and_then(|span| text.get(..span.start));
    let line = before.map_or(String::new(), |before| format!("line {}: ", before.matches('\n').count() + 1));
    let message: String = error.message().chars().take(MOST).collect();
    format!("{line}{}", Printable(message))
}

fn shape(plans: &[AgentPlan]) -> [usize; 2] {
    let places = |axis: usize| plans.iter().map(|plan| plan.place_m[axis].to_bits()).collect::<BTreeSet<_>>().len();
    [places(1), places(0)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::{crossing, grid};

    fn tuned_on(controller: &str) -> TunedOn {
        TunedOn {
            controller: controller.into(),
            network: "grid_2x2".into(),
            network_crc32: "00c0ffee".into(),
            horizon: 300,
            episodes: 10,
            seed: u64::MAX.to_string(),
            search_version: 1,
            sumo_version: "1.15.0".into(),
        }
    }

    fn read_again(file: &TimingFile, plans: &[AgentPlan]) -> (TimingFile, ClockPlan) {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        std::fs::write(&path, file.to_toml().unwrap()).unwrap();
        let plan = TimingFile::plan(&path, &file.tuned_on.controller, plans).unwrap();
        (TimingFile::read(&path).unwrap(), plan)
    }

    fn error(file: &TimingFile, controller: &str, plans: &[AgentPlan]) -> String {
        file.timings(controller, plans).unwrap_err().to_string()
    }

    #[test]
    fn timings_of_a_grid_come_back_and_fit_a_grid_of_this_shape_only() {
        let lights = grid(2, 2);
        let timings = [0, 13, 13, 0].map(|offset| Timing::new(&lights[0].phases, &[9, 11], offset)).to_vec();
        let found = ClockPlan { timings, leeway: Leeway { early: 3, late: 1 } };
        let file = TimingFile::new(&lights, &found, Score::Return(205.25), tuned_on("coordinated"));
        assert_eq!((file.vertical, file.horizontal, &file.offsets[..]), (Some(9), Some(11), &[0, 13, 13, 0][..]));
        assert_eq!(read_again(&file, &lights), (file.clone(), found));
        assert_eq!(error(&file, "fixed-time", &lights), "has timings of coordinated, not of fixed-time");
        let fits = |plans: &[AgentPlan]| error(&file, "coordinated", plans);
        let more = "timings for the 4 intersections of grid_2x2 do not fit the 6 intersections of this grid";
        assert_eq!(fits(&grid(2, 3)), more);
        assert_eq!(fits(&grid(1, 4)), "timings for the 2x2 grid grid_2x2 do not fit this 1x4 grid");
        assert_eq!(fits(&[crossing()]), "timings for the grid grid_2x2 do not fit a net that is none");
    }

    #[test]
    fn timings_of_a_net_come_back_and_fit_lights_with_their_names_and_greens() {
        let lights = [crossing()];
        let timings = vec![Timing::new(&lights[0].phases, &[9, 0, 7, 5], 3)];
        let found = ClockPlan { timings, leeway: Leeway::NONE };
        let file = TimingFile::new(&lights, &found, Score::DelaySeconds(31.5), tuned_on("fixed-time"));
        assert_eq!((file.vertical, file.score().to_string()), (None, "delay 31.5 s".to_owned()));
        assert_eq!(read_again(&file, &lights), (file.clone(), found));
        let more = "timings for the 1 lights of grid_2x2 do not fit the 2 lights of this net";
        assert_eq!(error(&file, "fixed-time", &grid(1, 2)), more);
        let renamed = [AgentPlan { light: "other".to_owned(), ..crossing() }];
        assert_eq!(error(&file, "fixed-time", &renamed), "has light crossing in the place of light other");
        let mut short = file.clone();
        short.lights[0].greens.pop();
        assert_eq!(error(&short, "fixed-time", &lights), "has 3 greens for light crossing, which has 4");
    }

    #[test]
    fn an_error_has_the_path_the_fault_and_the_way_out() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.toml");
        let about = toml::to_string(&tuned_on("fixed-time")).unwrap();
        let good =
            format!("vertical = 9\nhorizontal = 1\noffsets = [0, 0, 0, 0]\nmean_return = 1.0\n[tuned_on]\n{about}");
        let light = |greens: &str| format!("[[light]]\nname = 'a'\ngreens = {greens}\noffset = 0\n");
        let of_net = |greens: &str| {
            let text = good.replace("vertical = 9\nhorizontal = 1\noffsets = [0, 0, 0, 0]\n", "");
            text + &light(greens)
        };
        let either = "must have either vertical, horizontal and offsets, or a [[light]] per light";
        let greens = "light a: greens must be from 0 to 3600 steps, and not all 0";
        let one_mean = "must have one of mean_return and mean_delay_s";
        for (text, fault) in [
            (good.replace("horizon = 300", ""), "is not a file of tuned timings of this version"),
            // With 1 and the yellows of 6, the cycle would be 2^32, which is 0.
            (good.replace("= 9", "= 4294967289"), "vertical = 4294967289: must be from 1 to 3600 steps"),
            (good.replace("= 9", "= 0"), "vertical = 0: must be from 1 to 3600 steps"),
            (good.replace("1.0", "nan"), "mean_return = NaN: must be a finite number"),
            (good.replace("1.0", "-inf"), "mean_return = -inf: must be a finite number"),
            (good.replace("horizontal = 1\n", ""), either),
            (good.clone() + &light("[1]"), either),
            (of_net("[0, 0]"), greens),
            (of_net("[3601]"), greens),
            (of_net("[]"), greens),
            (of_net("[5]").replace("mean_return = 1.0\n", ""), one_mean),
            (good.replace("mean_return", "mean_delay_s = 1.0\nmean_return"), one_mean),
        ] {
            std::fs::write(&path, &text).unwrap();
            let error = TimingFile::read(&path).unwrap_err().to_string();
            assert_eq!(error, format!("{}: {fault}; {WAY_OUT}", path.display()), "{text}");
        }
    }
}
