//! Statistics of a few values: means and their errors, intervals, and tests of differences.
//!
//! - `summary`: mean, median, variance, standard error.
//! - `student`: quantiles of Student's t distribution.
//! - `interval`: a mean with the half-width of its interval, over episodes.
//! - `spread`: one figure over several seeds, with an interval if there are enough of them.
//! - `welch`: the interval of a difference between two groups of unequal variance.
//! - [`difference`]: differences of final returns, paired by episode and by seed if both sides played the same
//!   episodes.
//!
//! Every interval is a 95 % confidence interval.

pub mod difference;
mod interval;
mod spread;
mod student;
mod summary;
mod welch;

pub use interval::Interval;
pub use spread::{Bounds, ENOUGH_SEEDS, Spread, interval_of};
pub use student::student_t;
pub use summary::{mean, median, std_error, variance};
pub use welch::{UncertainMean, welch};
