//! Scenarios of users: what is read, what is refused with which words, and what a run directory keeps.
//!
//! - `room`: a folder with a scenario to break; `config`: the ways to name one; `broken`: what is refused; `kept`: copies
//!   and SUMO; `play`: the global simulator; `influence`: what it observes at the borders of regions;
//!   `local`: local simulators, and training on them; `fidelity`: how far they are like the global one;
//!   `lights`: where cars lose time; `guessed`: programs that netconvert invented; `plan`: plans that plain SUMO plays; `numbers`: those of which SUMO dies, or never comes back;
//!   `opened`: what is said when a command begins; `any_light`: one policy for all lights; `drawn`: route files of which each episode plays one.

mod admitted;
mod any_light;
mod broken;
mod config;
mod drawn;
mod fidelity;
mod guessed;
mod influence;
mod kept;
mod lights;
mod local;
mod numbers;
mod opened;
mod plan;
mod play;
mod room;
