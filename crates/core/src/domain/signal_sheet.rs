//! The timing of lights as an engineer reads it: programs, phases, and who has green when. Has no simulator's types.

/// Name of the file with a plan's programs for SUMO, in the plan's directory.
pub const PROGRAMS: &str = "programs.add.xml";

/// A light with its programs of the day, one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalSheet {
    pub light: String,
    /// Names of the streets that meet at the light, each once. Empty: the net has none.
    pub streets: Vec<String>,
    pub programs: Vec<ProgramSheet>,
}

/// A program that repeats, from one second of the simulation to another.
#[derive(Clone, Debug, PartialEq)]
pub struct ProgramSheet {
    /// Name of the program in SUMO's files.
    pub id: String,
    pub from_s: u64,
    pub to_s: u64,
    pub cycle_s: u32,
    /// Second of the simulation at which a cycle begins with the first phase, from 0 to the cycle.
    pub offset_s: u32,
    pub phases: Vec<PhaseSheet>,
    pub groups: Vec<SignalGroup>,
}

/// A green and what is shown until the next one.
#[derive(Clone, Debug, PartialEq)]
pub struct PhaseSheet {
    /// Seconds in which cars have green.
    pub green_s: u32,
    /// Those of them, the last ones, in which people on foot have red already and end their way across.
    pub pedestrian_clearance_s: u32,
    pub yellow_s: u32,
    pub all_red_s: u32,
    /// Shortest and longest green, if the light is actuated.
    pub limits_s: Option<[u32; 2]>,
    /// Letters of the green, as in SUMO's files.
    pub state: String,
    /// Names of the groups that have green.
    pub serves: Vec<String>,
}

impl PhaseSheet {
    /// Returns what engineers call the split: green, yellow and all red.
    pub fn split_s(&self) -> u32 {
        self.green_s + self.yellow_s + self.all_red_s
    }
}

/// Links that always show the same, such as all lanes of an approach.
#[derive(Clone, Debug, PartialEq)]
pub struct SignalGroup {
    pub name: String,
    /// Whether it is a crossing for people on foot.
    pub on_foot: bool,
    /// What it shows during a cycle, with the seconds.
    pub bars: Vec<(Aspect, u32)>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Aspect {
    /// Green with the right of way.
    Green,
    /// Green that yields to others.
    YieldingGreen,
    Yellow,
    Red,
}
