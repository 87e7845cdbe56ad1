//! For authors of domains and algorithms: toy domains with known answers, and a check that a domain keeps its promises.
//!
//! - [`toy`]: the smallest domains.
//! - [`conformance`]: the properties that every domain must have.

pub mod conformance;
pub mod toy;
