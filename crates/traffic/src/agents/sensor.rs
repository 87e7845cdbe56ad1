//! The sensor of one agent: the columns of its observation.

use std::ops::Range;

use super::loops::Loop;
use super::others_plan::OthersPlan;
use super::region_plan::RegionPlan;
use crate::config::DSet;
use crate::lane_sets::LaneSets;
use crate::sim::readings::COLUMNS;

/// Which columns an observation has, in this order: cars, light, clock.
#[derive(Clone, Debug, PartialEq)]
pub struct Sensor {
    pub(crate) cars: CarColumns,
    pub(crate) light: LightColumns,
    /// Number of columns of the clock; 0 for none.
    pub(crate) clock: usize,
    /// Number of steps by which the clock is ahead of the episode.
    pub(crate) clock_ahead: usize,
    /// Whether it also sees buses, trams and persons: a column for each approach, track and crossing, behind all others.
    pub(crate) sees_others: bool,
    /// What the AIP of a grid sees. That of a scenario sees its borders.
    pub(crate) d_set: DSet,
}

#[derive(Clone, Debug, PartialEq)]
pub(crate) enum CarColumns {
    /// A bit for each cell of 10 m, from the lane's end on. One entry per approach: its number of visible cells.
    Cells(Vec<usize>),
    /// Two numbers from 0 to 1 for each approach: the share of it that a queue fills, and the share that cars fill.
    QueueAndDensity(usize),
    /// Three numbers from 0 to 1 for each detector: cars that came and the share of time with a car over it, since the
    /// last decision, and the time since a car was over it.
    Detectors(Vec<Loop>),
    /// Lanes and greens as sets, which is all that the agent sees.
    Sets(LaneSets),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum LightColumns {
    /// One-hot state of the paper's light, in the order of `Light`.
    FourStates,
    /// One-hot green that is shown or comes next, a bit for the time between greens, and the steps since the green began
    /// or the last one ended, as a share of a minute, at most 1. The entry: number of greens.
    TargetAndAge(usize),
    /// The light is seen with the lanes: [`CarColumns::Sets`].
    WithLanes,
}

impl Sensor {
    /// Returns the sets that the agent sees, if it sees sets.
    pub(crate) fn sets(&self) -> Option<&LaneSets> {
        match &self.cars {
            CarColumns::Sets(sets) => Some(sets),
            _ => None,
        }
    }

    /// Returns the detectors that the agent may see.
    pub(crate) fn detectors(&self) -> &[Loop] {
        match &self.cars {
            CarColumns::Detectors(detectors) => detectors,
            CarColumns::Sets(sets) => &sets.loops,
            CarColumns::Cells(_) | CarColumns::QueueAndDensity(_) => &[],
        }
    }

    pub(crate) fn see(&mut self, sets: LaneSets) {
        self.cars = CarColumns::Sets(sets);
    }

    /// Returns the name of every column: what it shows, and of which lane. The lanes are those of the agent's region.
    pub(crate) fn columns(&self, region: &RegionPlan, others: &OthersPlan) -> Vec<String> {
        let lanes = region.approaches.iter().map(|approach| &approach.lane);
        let mut names: Vec<String> = match &self.cars {
            CarColumns::Cells(cells) => {
                let cells = lanes.zip(cells);
                cells.flat_map(|(lane, &cells)| (0..cells).map(move |cell| format!("{lane}[{cell}]"))).collect()
            }
            CarColumns::QueueAndDensity(_) => {
                lanes.flat_map(|lane| [format!("queue {lane}"), format!("density {lane}")]).collect()
            }
            CarColumns::Detectors(detectors) => {
                let names = detectors.iter().map(|detector| detector.name(&region.approaches));
                names.flat_map(|name| ["count", "occupancy", "gap"].map(|what| format!("{what} {name}"))).collect()
            }
            CarColumns::Sets(sets) => sets.names(lanes),
        };
        names.extend(self.light.names());
        names.extend((0..self.clock).map(|column| format!("clock[{column}]")));
        if self.sees_others {
            names.extend(region.approaches.iter().map(|approach| format!("buses {}", approach.lane)));
            names.extend(others.tracks.iter().map(|track| format!("trams {}", track.lane)));
            names.extend(others.crossings.iter().map(|crossing| format!("persons {}", crossing.edge)));
        }
        names
    }

    pub(crate) fn width(&self, region: &RegionPlan, others: &OthersPlan) -> usize {
        self.clock_columns().end + self.other_columns(region, others)
    }

    fn other_columns(&self, region: &RegionPlan, others: &OthersPlan) -> usize {
        let all = region.approaches.len() + others.tracks.len() + others.crossings.len();
        if self.sees_others { all } else { 0 }
    }

    pub(crate) fn car_columns(&self) -> usize {
        match &self.cars {
            CarColumns::Cells(cells) => cells.iter().sum(),
            CarColumns::QueueAndDensity(approaches) => 2 * approaches,
            CarColumns::Detectors(detectors) => COLUMNS * detectors.len(),
            CarColumns::Sets(sets) => sets.columns(),
        }
    }

    pub(crate) fn light_columns(&self) -> Range<usize> {
        let first = self.car_columns();
        first..first + self.light.columns()
    }

    pub(crate) fn clock_columns(&self) -> Range<usize> {
        let first = self.light_columns().end;
        first..first + self.clock
    }
}

impl LightColumns {
    pub(crate) fn names(self) -> Vec<String> {
        match self {
            LightColumns::FourStates => {
                ["horizontal green", "horizontal yellow", "vertical yellow", "vertical green"].map(str::to_owned).into()
            }
            LightColumns::TargetAndAge(greens) => {
                let greens = (0..greens).map(|green| format!("green[{green}]"));
                greens.chain(["between greens", "time since change"].map(str::to_owned)).collect()
            }
            LightColumns::WithLanes => Vec::new(),
        }
    }

    pub(crate) fn columns(self) -> usize {
        match self {
            LightColumns::FourStates => 4,
            LightColumns::TargetAndAge(greens) => greens + 2,
            LightColumns::WithLanes => 0,
        }
    }
}
