//! Films of episodes: GIF and mp4.
//!
//! - `replay`: the episode that is filmed. `format`: GIF or mp4, and the programs that each needs.
//! - `pictures`: sumo-gui takes one picture per step on a virtual `screen`. `gif` and `mp4` join them.
//! - `captions`: what pictures show besides the roads, in `letters`. `picture_file`: their files.
//! - `gui`: opens sumo-gui for a person.
//! - `helper`: helper programs, which end together with this one.
//! - [`scenes`]: pictures that a domain draws itself, as SVG files and as one GIF.
//!
//! A replay is a folder that sumo-gui plays. This room does not know how the episode was made.

mod captions;
mod format;
mod gif;
mod gui;
mod helper;
mod letters;
mod mp4;
mod picture_file;
mod pictures;
mod replay;
pub(crate) mod scenes;
mod screen;

pub(crate) use format::Format;
pub(crate) use gui::{check_screen, watch};
pub(crate) use pictures::Pictures;
pub(crate) use replay::{Replay, Shape};
