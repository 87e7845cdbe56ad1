//! RESCO's maps and what others published about them.

/// A map of RESCO: what its protocol of 2021 says, and published figures.
///
/// Source: `resco_benchmark/config/map_config.py` of [`RESCO`].
#[derive(Debug, PartialEq)]
pub struct Map {
    pub name: &'static str,
    /// Begin and end of an episode, in seconds.
    pub window_s: [u64; 2],
    /// Seconds between two decisions, and those of them that are yellow.
    pub decision_s: u32,
    pub yellow_s: u32,
    /// Whether every episode has another file of demand, `NAME_1.rou.xml` and so on.
    pub many_demands: bool,
    /// Delays in seconds per car.
    pub published: &'static [Published],
}

#[derive(Debug, PartialEq)]
pub struct Published {
    pub player: &'static str,
    pub kind: Kind,
    pub delay_s: f64,
}

/// What a published figure is a figure of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The light's own program.
    Program,
    /// The mean of the last ten episodes.
    LastTen,
    /// The median of the last ten episodes.
    MedianOfLastTen,
    /// The best episode of training, which is what papers print.
    BestEpisode,
}

impl Kind {
    pub fn words(self) -> &'static str {
        match self {
            Kind::Program => "own program",
            Kind::LastTen => "last ten episodes",
            Kind::MedianOfLastTen => "median of the last ten episodes",
            Kind::BestEpisode => "best episode",
        }
    }
}

/// Where the figures are from.
pub const RESCO: &str = "Ault and Sharon, Reinforcement Learning Benchmarks for Traffic Signal Control, NeurIPS 2021 \
                         Datasets and Benchmarks; github.com/Pi-Star-Lab/RESCO, commit fc65e91. Best and last ten episodes \
                         were recomputed from the result files of that repository, five trials each: 100 episodes of IDQN \
                         and MPLight, 1400 of IPPO and FMA2C";
/// What its runs cost.
pub const CPU_SECONDS: &str =
    "an independent run of RESCO's learners (three seeds, not reviewed) took 7 989 s per run at the median";
/// Figures in other measures, which do not stand in the tables.
pub const OTHERS: &str = "X-Light (2024) prints trip time in the protocol of GESA (10 s of green and 5 s of yellow, final policy, \
                          one file of demand): 162.5 s on grid4x4, 349.6 on arterial4x4, 88.6 on cologne8 and 278.1 on \
                          ingolstadt21. RESCO's best in its own protocol have 144.1, 326, 85.7 and 197 s";

const MORNING: [u64; 2] = [25_200, 28_800];
const AFTERNOON: [u64; 2] = [57_600, 61_200];
const FIRST_HOUR: [u64; 2] = [0, 3600];
const GREEDY: &str = "max-wave (RESCO's greedy)";

const fn of(player: &'static str, kind: Kind, delay_s: f64) -> Published {
    Published { player, kind, delay_s }
}

const fn city(name: &'static str, window_s: [u64; 2], published: &'static [Published]) -> Map {
    Map { name, window_s, decision_s: 10, yellow_s: 3, many_demands: false, published }
}

use Kind::{BestEpisode, LastTen, MedianOfLastTen, Program};

const COLOGNE1: &[Published] = &[
    of("program", Program, 56.5),
    of(GREEDY, LastTen, 27.6),
    of("IDQN", BestEpisode, 26.1),
    of("IDQN", LastTen, 28.9),
];
const COLOGNE3: &[Published] = &[
    of("program", Program, 39.8),
    of(GREEDY, LastTen, 22.0),
    of("IDQN, IPPO", BestEpisode, 24.0),
    of("IDQN, IPPO", LastTen, 95.5),
];
const COLOGNE8: &[Published] = &[
    of("program", Program, 65.1),
    of(GREEDY, LastTen, 21.9),
    of("IPPO", BestEpisode, 21.6),
    of("IDQN", LastTen, 22.3),
];
const INGOLSTADT1: &[Published] = &[
    of("program", Program, 39.5),
    of(GREEDY, LastTen, 28.6),
    of("IPPO", BestEpisode, 20.9),
    of("IDQN", LastTen, 22.2),
];
const INGOLSTADT7: &[Published] = &[
    of("program", Program, 91.5),
    of(GREEDY, LastTen, 79.2),
    of("IDQN", BestEpisode, 31.2),
    of("IPPO", LastTen, 32.5),
];
const INGOLSTADT21: &[Published] = &[
    of("program", Program, 137.6),
    of(GREEDY, LastTen, 69.1),
    of("IDQN", BestEpisode, 59.6),
    of("IDQN", LastTen, 86.2),
];
const GRID4X4: &[Published] = &[of(GREEDY, LastTen, 34.2), of("IDQN", BestEpisode, 32.9), of("IDQN", LastTen, 34.1)];
const ARTERIAL4X4: &[Published] =
    &[of(GREEDY, MedianOfLastTen, 711.0), of("FMA2C", BestEpisode, 654.0), of("FMA2C", LastTen, 773.0)];

/// All maps. Those of a city are in the order of their lights.
pub static MAPS: [Map; 8] = [
    city("cologne1", MORNING, COLOGNE1),
    city("cologne3", MORNING, COLOGNE3),
    city("cologne8", MORNING, COLOGNE8),
    city("ingolstadt1", AFTERNOON, INGOLSTADT1),
    city("ingolstadt7", AFTERNOON, INGOLSTADT7),
    city("ingolstadt21", AFTERNOON, INGOLSTADT21),
    Map { many_demands: true, ..city("grid4x4", FIRST_HOUR, GRID4X4) },
    Map { decision_s: 5, yellow_s: 2, many_demands: true, ..city("arterial4x4", FIRST_HOUR, ARTERIAL4X4) },
];

impl Map {
    /// Returns the map of this name.
    pub fn called(name: &str) -> Option<&'static Map> {
        MAPS.iter().find(|map| map.name == name)
    }

    /// Returns the first published figure of a kind, without RESCO's greedy rule.
    pub fn figure(&self, kind: Kind) -> Option<&Published> {
        self.published.iter().find(|figure| figure.kind == kind && figure.player != GREEDY)
    }
}
