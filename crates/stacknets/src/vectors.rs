//! The width of the vector registers that matrix products use.
//!
//! Only the bits of products depend on the width, because products add up several sums side by side. All other loops
//! work element by element, without fused multiply-add, and give the same bits everywhere: `product` says why.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Result, ensure};
use pulp::{Arch, WithSimd};

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

/// One setting for the whole process. As an argument it would go through every call down to the products, and nobody needs
/// two widths in one program.
static ARE_256_BITS: AtomicBool = AtomicBool::new(false);

/// Sets the register width for all products of this process. Returns an error if the machine does not have it.
///
/// Call it before the first network is computed. Until then the width is [`VectorWidth::Widest`].
pub fn use_vectors(width: VectorWidth) -> Result<()> {
    check(width)?;
    ARE_256_BITS.store(width == VectorWidth::Bits256, Ordering::Relaxed);
    Ok(())
}

/// Returns the width of the registers in use.
pub(crate) fn vector_width() -> VectorWidth {
    if ARE_256_BITS.load(Ordering::Relaxed) { VectorWidth::Bits256 } else { VectorWidth::Widest }
}

/// Returns the name of the instructions that products of this width use on this machine, such as `avx512f` or
/// `avx2+fma`. The same name means the same bits. Returns an error if the machine does not have them.
pub fn vector_instructions(width: VectorWidth) -> Result<String> {
    check(width)?;
    Ok(match width {
        VectorWidth::Bits256 => AVX2.to_owned(),
        VectorWidth::Widest => widest(),
    })
}

const AVX512: &str = "avx512f";
const AVX2: &str = "avx2+fma";

fn check(width: VectorWidth) -> Result<()> {
    ensure!(
        width == VectorWidth::Widest || has_avx2_and_fma(),
        "this machine has no AVX2 and FMA, which products of 256 bits need"
    );
    Ok(())
}

#[cfg(target_arch = "x86_64")]
fn has_avx2_and_fma() -> bool {
    pulp::x86::V3::try_new().is_some()
}

#[cfg(not(target_arch = "x86_64"))]
fn has_avx2_and_fma() -> bool {
    false
}

/// Returns the names of the widest instructions. The crates `gemm` and `pulp` each choose for themselves, and a few
/// CPUs have only some of the instructions that `pulp` needs.
#[cfg(target_arch = "x86_64")]
fn widest() -> String {
    let of_gemm = match () {
        () if is_x86_feature_detected!("avx512f") => AVX512,
        () if is_x86_feature_detected!("fma") => AVX2,
        () => "scalar",
    };
    let of_few_rows = match Arch::new() {
        Arch::V4(_) => AVX512,
        Arch::V3(_) => AVX2,
        _ => "scalar",
    };
    if of_gemm == of_few_rows { of_gemm.to_owned() } else { format!("{of_gemm}, {of_few_rows} for few rows") }
}

#[cfg(not(target_arch = "x86_64"))]
fn widest() -> String {
    std::env::consts::ARCH.to_owned()
}

/// Does `work` with registers of this width.
pub(crate) fn dispatch<W: WithSimd>(width: VectorWidth, work: W) -> W::Output {
    match width {
        VectorWidth::Widest => Arch::new().dispatch(work),
        #[cfg(target_arch = "x86_64")]
        VectorWidth::Bits256 => {
            let simd = pulp::x86::V3::try_new().expect("`use_vectors` found AVX2 and FMA");
            pulp::Simd::vectorize(simd, work)
        }
        #[cfg(not(target_arch = "x86_64"))]
        VectorWidth::Bits256 => unreachable!("`use_vectors` refuses it here"),
    }
}
