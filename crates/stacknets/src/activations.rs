//! Sigmoid and tanh in plain arithmetic. So the compiler vectorises the loops around them, and a number gives the same
//! bits at any place in a table.

/// Computes `e^x` to about two units in the last place. It saturates outside `-87..=88`.
///
/// Source: the polynomial of Cephes' `expf` (Moshier), with the rounding done by adding 1.5 * 2^23.
#[inline(always)]
pub(crate) fn exp(x: f32) -> f32 {
    const ROUNDER: f32 = 12_582_912.0; // 1.5 * 2^23: its last bit is worth one
    const LN2_HIGH: f32 = 0.693_359_4;
    const LN2_LOW: f32 = -2.121_944_4e-4;
    let x = x.clamp(-87.0, 88.0);
    let rounded = x * std::f32::consts::LOG2_E + ROUNDER;
    let n = rounded - ROUNDER;
    let r = x - n * LN2_HIGH - n * LN2_LOW;
    let mut y = 1.987_569_1e-4;
    y = y * r + 1.398_199_9e-3;
    y = y * r + 8.333_452e-3;
    y = y * r + 4.166_579_6e-2;
    y = y * r + 1.666_666_5e-1;
    y = y * r + 5e-1;
    y = y * r * r + r + 1.0;
    // The low bits of `rounded` hold the integer n. Shifted into the exponent it gives 2^n.
    let exponent = rounded.to_bits().wrapping_sub(ROUNDER.to_bits()).wrapping_add(127);
    y * f32::from_bits(exponent << 23)
}

/// Returns `1 / (1 + e^-x)`, at most 2e-7 off.
///
/// The same bits as in the networks, and on every machine; the standard library's `exp` depends on the system.
#[inline(always)]
pub fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + exp(-x))
}

#[inline(always)]
pub(crate) fn tanh(x: f32) -> f32 {
    2.0 * sigmoid(2.0 * x) - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn they_agree_with_the_standard_library() {
        for i in -9000..=9000 {
            let x = i as f32 / 100.0;
            let exact = f64::from(x);
            if x > -87.0 && x < 88.0 {
                assert!((f64::from(exp(x)) / exact.exp() - 1.0).abs() < 3e-7, "exp {x}");
            }
            assert!((f64::from(sigmoid(x)) - 1.0 / (1.0 + (-exact).exp())).abs() < 2e-7, "sigmoid {x}");
            assert!((f64::from(tanh(x)) - exact.tanh()).abs() < 3e-7, "tanh {x}");
        }
    }
}
