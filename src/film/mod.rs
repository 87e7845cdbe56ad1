//! Films of episodes: GIF and mp4.
//!
//! - `replay`: what is filmed; `format`: GIF or mp4, and what each needs.
//! - `pictures`: sumo-gui takes a picture per step on a `screen` that nobody sees, and `gif` or `mp4` joins them.
//! - `gui`: sumo-gui itself, and how it is opened for a person.
//! - `helper`: programs that end with this one.
//! - [`scenes`]: pictures that a domain draws itself, as SVG and as one GIF.
//!
//! A replay is a folder that sumo-gui plays; how it came about is unknown here.

mod format;
mod gif;
mod gui;
mod helper;
mod mp4;
mod pictures;
mod replay;
pub mod scenes;
mod screen;

pub use format::Format;
pub use gui::{check_screen, watch};
pub use pictures::Pictures;
pub use replay::Replay;
