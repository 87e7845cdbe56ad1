//! The live view: one page about the runs in a folder, for a browser on this machine. It reads run directories alone.
//!
//! - [`status`]: how far a run is, how fast it goes, and when it will end.
//! - [`page`]: the page, as text: statuses, maps, and the figures of a report.
//! - [`server`]: gives the page to browsers on this machine that know its address. `connections` limits what a
//!   connection may take, `answers` decides who gets what, and `maker` makes one page at a time.

mod answers;
mod connections;
mod maker;
pub mod page;
pub mod server;
pub(crate) mod status;
