//! What a user's Python process adds to a run: functions and objects that stay in that process.
//!
//! `dials_traffic.train` and `dials_traffic.dials` start this program as a child and name a socket in the variable
//! [`LINK`]. Every process of the run may open any number of [`Link`]s to it.
//!
//! - `link`: the connection, its messages and their arrays. `rows`: rewards and observations over it.
//! - `learner`: the learner of `algorithm = "outside"`. [`predictor`]: the predictor of `predictor = "outside"`.

pub(crate) mod learner;
mod link;
pub mod predictor;
mod rows;

pub(crate) use rows::{PythonFunctions, described};

pub use link::{Answer, Array, LINK, Link, Number};
