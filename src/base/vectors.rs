//! How wide the vector registers are that networks compute with.

use serde::{Deserialize, Serialize};

/// Width of the vector registers. Sums of products are added up in an order that depends on it, and so are rounded
/// differently.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VectorWidth {
    /// The widest that the machine has. Fastest, but CPUs of different kinds give different bits.
    #[default]
    Widest,
    /// 256 bits, with AVX2 and FMA. Every x86-64 machine that has these gives the same bits.
    #[serde(rename = "256-bit")]
    Bits256,
}
