//! A car that drives freely through the local net: recorded on SUMO 1.15 with the authors' geometry and vehicle type.

/// The lane, 0 for the one that leads in, 1 for the junction, 2 for the one that leads out; the position in metres; the
/// speed in m/s. One entry per second. It enters at 6 m with 9.5 m/s, and its light is green.
///
/// The edge is 100 m, the junction 18.8 m: 95.769 + 10 - 100 = 5.769, and 15.769 + 10 - 18.8 = 6.969. One second after the
/// last entry it would be at 106.969 m, beyond the end of the net.
pub(crate) const FREE_CAR: [(usize, f64, f64); 22] = [
    (0, 6.0, 9.5),
    (0, 15.839, 9.839),
    (0, 25.79, 9.951),
    (0, 35.775, 9.985),
    (0, 45.77, 9.996),
    (0, 55.769, 9.999),
    (0, 65.769, 10.0),
    (0, 75.769, 10.0),
    (0, 85.769, 10.0),
    (0, 95.769, 10.0),
    (1, 5.769, 10.0),
    (1, 15.769, 10.0),
    (2, 6.969, 10.0),
    (2, 16.969, 10.0),
    (2, 26.969, 10.0),
    (2, 36.969, 10.0),
    (2, 46.969, 10.0),
    (2, 56.969, 10.0),
    (2, 66.969, 10.0),
    (2, 76.969, 10.0),
    (2, 86.969, 10.0),
    (2, 96.969, 10.0),
];
