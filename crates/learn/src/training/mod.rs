//! What remains of the training: [`journal`], [`answers`], [`drift`] and [`collect`].

pub mod answers;
pub mod collect;
pub mod drift;
pub mod journal;
