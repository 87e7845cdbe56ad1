//! Figures of the lights of a road network: of each light, of each approach to it, and of each movement through it.
//!
//! A domain with lights says once what they are ([`LightPlace`]), and after an episode what happened there
//! ([`LightsEpisode`]), in the same order. An *approach* is an edge that ends at the light, a *movement* the way from an
//! approach to an edge behind the light.

/// What sentences call the lights' own programs. A warning about them begins with it.
pub const TODAYS_PLAN: &str = "today's plan";

/// A light and the ways through it.
#[derive(Clone, Debug, PartialEq)]
pub struct LightPlace {
    pub id: String,
    /// Names of the streets that meet there, as far as the net names them, without repetitions.
    pub streets: Vec<String>,
    /// Place in the coordinates of the net, in metres.
    pub place_m: [f64; 2],
    pub approaches: Vec<ApproachPlace>,
}

/// An edge that ends at a light.
#[derive(Clone, Debug, PartialEq)]
pub struct ApproachPlace {
    pub edge: String,
    pub street: Option<String>,
    pub lanes: usize,
    pub movements: Vec<MovementPlace>,
}

/// A way from an approach to an edge behind the light.
#[derive(Clone, Debug, PartialEq)]
pub struct MovementPlace {
    pub edge: String,
    pub street: Option<String>,
}

/// Sums over the cars that crossed a light, or were on their way to it when the episode ended.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CarSums {
    pub cars: u64,
    /// Time that they lost there, in seconds.
    pub delay_s: f64,
    /// How often they came to a stand there.
    pub stops: u64,
    /// The buses and trams among the cars, and the time that these lost.
    pub buses: u64,
    pub bus_delay_s: f64,
}

impl CarSums {
    pub fn add(&mut self, other: &CarSums) {
        self.cars += other.cars;
        self.delay_s += other.delay_s;
        self.stops += other.stops;
        self.buses += other.buses;
        self.bus_delay_s += other.bus_delay_s;
    }
}

/// What happened at a light in an episode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightEpisode {
    pub sums: CarSums,
    pub approaches: Vec<ApproachEpisode>,
}

impl LightEpisode {
    /// Returns the longest queue, that of its worst approach, in cars; 0 without approaches.
    pub fn queue_p95_cars(&self) -> f64 {
        self.approaches.iter().map(|approach| approach.queue_p95_cars).fold(0.0, f64::max)
    }
}

/// What happened on an approach in an episode.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ApproachEpisode {
    pub sums: CarSums,
    /// Number of standing cars on the approach, all lanes together, that is exceeded in a twentieth of the seconds.
    pub queue_p95_cars: f64,
    /// Movements in the order of [`ApproachPlace::movements`].
    pub movements: Vec<CarSums>,
}

/// What happened at all lights in an episode. The delays of the lights and the two others together are the delay of all cars
/// that are counted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LightsEpisode {
    pub lights: Vec<LightEpisode>,
    /// Number of cars that are counted, and the number of times that they came to a stand anywhere.
    pub cars: u64,
    pub stops: u64,
    /// Time that they lost on other roads, and before they entered, in seconds.
    pub elsewhere_s: f64,
    pub before_entering_s: f64,
}

impl LightsEpisode {
    /// Returns the time that all cars lost, in seconds.
    pub fn delay_s(&self) -> f64 {
        self.lights.iter().map(|light| light.sums.delay_s).sum::<f64>() + self.elsewhere_s + self.before_entering_s
    }
}
