//! The width of the vector registers that networks compute with.

use serde::{Deserialize, Serialize};

/// Width of the vector registers. The order of sums of products depends on it, and so does their rounding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VectorWidth {
    /// The widest that the machine has. Fastest, but different CPUs give different bits.
    #[default]
    Widest,
    /// 256 bits, with AVX2 and FMA. Every x86-64 machine that has these gives the same bits.
    #[serde(rename = "256-bit")]
    Bits256,
}
