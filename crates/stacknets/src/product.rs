//! Products of small matrices: the crate `gemm`, and for few rows kernels of our own.
//!
//! `gemm` multiplies the shapes of these networks (32 x 256 by 256 x 128) about twice as fast as libtorch with
//! OpenBLAS: it has kernels for 512-bit registers and little cost per call.
//!
//! # Why not otherwise
//!
//! **Why network by network, and not one batched product over the whole stack?** It looks natural: the parameters already
//! lie in one block, and every tensor library has a call for `[networks, rows, in] x [networks, in, out]`. There are
//! three reasons against it.
//!
//! 1. *There is nothing to share.* A large product is fast because a loaded weight serves many rows. Here each network
//!    has weights of its own, so a batched product is a loop over small products, too. It only moves the loop into the
//!    library, where nobody sees its order.
//! 2. *The cache.* A network of 40 x 256 x 128 x 3 has 44 000 parameters: 175 kB, and with gradient and moments 700 kB.
//!    That stays in the second-level cache of a core while the network takes all its gradient steps. Layer by layer over
//!    a thousand networks, each of these steps would stream 700 MB from memory.
//! 3. *The bits.* A library chooses its kernel, its blocks and its threads by the size of the whole batch. Then a
//!    network would compute other bits beside 99 others than alone, and results would depend on how networks are shared
//!    among processes. Here a product sees the shape of one network and nothing else.
//!
//! Threads, then, share networks and never a product.
//!
//! **Why is the order of sums fixed?** Adding floating-point numbers is not associative. In `f32`, `(1e8 + 1) - 1e8` is 0,
//! and `(1e8 - 1e8) + 1` is 1. One changed bit after one gradient step is another network after a thousand, so a result
//! repeats only if every sum has one order. The order of a dot product depends on three things:
//!
//! - the kernel, which is chosen by the shape, that is, the same for a network alone and in a stack;
//! - where the inner dimension is cut. `gemm` cuts it by the size of the caches that it finds. So no call gets more than
//!   [`DEPTH`] at once, which it never cuts;
//! - the number of lanes of a register, each of which is a sum of its own. [`VectorWidth::Bits256`] fixes it for all
//!   machines, and costs speed on those that have more. With [`VectorWidth::Widest`] only machines with the same
//!   registers agree.
//!
//! The test `order_of_sums` writes this order down in plain Rust and compares to the bit. Sums in `f64` would halve the
//! speed and still depend on the order, only so rarely that no test would notice.
//!
//! **Why fused multiply-add here, and nowhere else?** It rounds once where a multiplication and an addition round twice, so
//! code with it and code without it give different bits. The compiler never fuses by itself, which makes plain loops the
//! same everywhere. In products it doubles the speed, and the kernels ask for it by name, so it is there or the kernel is
//! another one, which [`VectorWidth`] accounts for. The other loops (Adam, gates, activations) work element by element. They are
//! compiled for several register widths, some of them without the instruction, and must agree. They wait for memory and
//! divisions, not for additions: there is nothing to gain.

#![allow(unsafe_code, reason = "the kernels of `gemm` take pointers")]

use std::ops::Range;

use gemm_common::Parallelism;

use super::few_rows::{DotProducts, FEW_ROWS, RowByMatrix, RowsByMatrix};
use super::vectors::{VectorWidth, dispatch, vector_width};

/// Largest inner dimension of one call of `gemm`, which adds up that many numbers in one go. `gemm` cuts longer ones by
/// the size of the machine's caches, and then the order of sums would depend on the machine.
const DEPTH: usize = 512;

/// A borrowed matrix: row after row or, if transposed, column after column.
#[derive(Clone, Copy)]
pub(crate) struct Matrix<'a> {
    pub(crate) values: &'a [f32],
    pub(crate) rows: usize,
    pub(crate) columns: usize,
    transposed: bool,
}

impl<'a> Matrix<'a> {
    /// Makes a matrix. `values`: whole rows of `columns` each, one after another.
    pub(crate) fn new(values: &'a [f32], columns: usize) -> Self {
        assert!(values.len().is_multiple_of(columns), "{} values do not make rows of {columns}", values.len());
        Matrix { values, rows: values.len() / columns, columns, transposed: false }
    }

    pub(crate) fn transposed(self) -> Self {
        Matrix { rows: self.columns, columns: self.rows, transposed: !self.transposed, ..self }
    }

    /// Returns the distances to the next row and to the next column.
    pub(crate) fn strides(self) -> (isize, isize) {
        if self.transposed { (1, self.rows as isize) } else { (self.columns as isize, 1) }
    }

    /// Returns the address of a number. It must not be read outside the matrix.
    fn at(self, row: usize, column: usize) -> *const f32 {
        let (down, across) = self.strides();
        self.values.as_ptr().wrapping_offset(row as isize * down + column as isize * across)
    }
}

/// Treatment of the old numbers of the output.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Before {
    Overwrite,
    Add,
}

/// Computes `out = left x right`, or `out += left x right`. `out`: row after row.
pub(crate) fn multiply(left: Matrix<'_>, right: Matrix<'_>, out: &mut [f32], before: Before) {
    multiply_with(vector_width(), left, right, out, before);
}

/// Computes the product of [`multiply`] with vector registers of this width.
pub(crate) fn multiply_with(
    width: VectorWidth,
    left: Matrix<'_>,
    right: Matrix<'_>,
    out: &mut [f32],
    mut before: Before,
) {
    let (rows, depth, columns) = (left.rows, left.columns, right.columns);
    assert_eq!(depth, right.rows, "{rows} x {depth} by {} x {columns}", right.rows);
    assert_eq!(out.len(), rows * columns, "{rows} x {columns} values come out");
    if rows <= FEW_ROWS && right.transposed && !left.transposed && before == Before::Overwrite {
        return dispatch(width, DotProducts { left: left.values, right: right.values, depth, out });
    }
    if rows == 1 && !right.transposed {
        if before == Before::Overwrite {
            out.fill(0.0);
        }
        return dispatch(width, RowByMatrix { row: left.values, matrix: right.values, out });
    }
    // `gemm` rounds otherwise with a depth of 2, and cuts a longer one than `DEPTH`; it adds up a single column across registers.
    if (2..=FEW_ROWS).contains(&rows)
        && !left.transposed
        && !right.transposed
        && columns > 1
        && (3..=DEPTH).contains(&depth)
    {
        let adds = before == Before::Add;
        return dispatch(width, RowsByMatrix { rows: left.values, count: rows, matrix: right.values, out, adds });
    }
    // Also once if there is nothing to add up: the result is zeros.
    for first in (0..depth.max(1)).step_by(DEPTH) {
        let inner = first..depth.min(first + DEPTH);
        match width {
            VectorWidth::Widest => by_widest(left, right, inner, out, before),
            VectorWidth::Bits256 => by_256_bits(left, right, inner, out, before),
        }
        before = Before::Add;
    }
}

/// Multiplies a part of the inner dimension. `gemm` chooses the registers.
fn by_widest(left: Matrix<'_>, right: Matrix<'_>, inner: Range<usize>, out: &mut [f32], before: Before) {
    let (left, right, [out_column, out_row]) = for_columns(left, right);
    let ((left_row, left_column), (right_row, right_column)) = (left.strides(), right.strides());
    let kernel = gemm_f32::gemm::f32::get_gemm_fn();
    // SAFETY: `Matrix` holds `rows x columns` values that its strides stay within, `inner` lies within the inner
    // dimension of both, and `out` has room for all of the product and is nobody else's.
    unsafe {
        kernel(
            left.rows,
            right.columns,
            inner.len(),
            out.as_mut_ptr(),
            out_column,
            out_row,
            before == Before::Add,
            left.at(0, inner.start),
            left_column,
            left_row,
            right.at(inner.start, 0),
            right_column,
            right_row,
            1.0,
            1.0,
            false,
            false,
            false,
            Parallelism::None,
        );
    }
}

/// Returns the factors as the kernels want them, with the distances to the next column and row of the output. The kernels
/// write columns, so they get `out^T = right^T x left^T`.
fn for_columns<'a>(left: Matrix<'a>, right: Matrix<'a>) -> (Matrix<'a>, Matrix<'a>, [isize; 2]) {
    match right.columns {
        0 | 1 => (left, right, [1, 1]),
        columns => (right.transposed(), left.transposed(), [columns as isize, 1]),
    }
}

/// Does what [`by_widest`] does on a machine that has AVX2 and FMA and nothing wider.
#[cfg(target_arch = "x86_64")]
fn by_256_bits(left: Matrix<'_>, right: Matrix<'_>, inner: Range<usize>, out: &mut [f32], before: Before) {
    use gemm_common::gemm::gemm_basic_generic;
    use gemm_common::simd::{MixedSimd, V3};
    use gemm_f32::microkernel::fma::f32::{H_M, H_N, H_UKR, MR_DIV_N, NR, UKR};
    const LANES: usize = 8;
    let simd = <V3 as MixedSimd<f32, f32, f32, f32>>::try_new().expect("`use_vectors` found AVX2 and FMA");
    let (left, right, [out_column, out_row]) = for_columns(left, right);
    let ((left_row, left_column), (right_row, right_column)) = (left.strides(), right.strides());
    // SAFETY: as in `by_widest`. Also, `simd` proves that the machine has the instructions of these kernels.
    unsafe {
        gemm_basic_generic::<_, f32, LANES, { MR_DIV_N * LANES }, NR, MR_DIV_N, H_M, H_N>(
            simd,
            left.rows,
            right.columns,
            inner.len(),
            out.as_mut_ptr(),
            out_column,
            out_row,
            before == Before::Add,
            left.at(0, inner.start),
            left_column,
            left_row,
            right.at(inner.start, 0),
            right_column,
            right_row,
            1.0,
            1.0,
            false,
            false,
            false,
            |a, b, c| a * b + c,
            &UKR,
            &H_UKR,
            false,
            Parallelism::None,
        );
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn by_256_bits(_: Matrix<'_>, _: Matrix<'_>, _: Range<usize>, _: &mut [f32], _: Before) {
    unreachable!("`use_vectors` refuses it here");
}

/// Computes `out = inputs x weight + bias`. `weight`: `[in, out]`; `bias`: `[out]`; `inputs`: `[rows, in]`; `out`:
/// `[rows, out]`.
pub(crate) fn affine(inputs: &[f32], weight: &[f32], bias: &[f32], out: &mut [f32]) {
    out.chunks_exact_mut(bias.len()).for_each(|row| row.copy_from_slice(bias));
    multiply(Matrix::new(inputs, weight.len() / bias.len()), Matrix::new(weight, bias.len()), out, Before::Add);
}

/// Adds up the rows, for the gradient of a bias.
pub(crate) fn sum_rows(rows: &[f32], sums: &mut [f32]) {
    sums.fill(0.0);
    for row in rows.chunks_exact(sums.len()) {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
}

/// Returns a buffer with this length, for passes that work in it one after another. Its contents are undefined.
pub(crate) fn resized(buffer: &mut Vec<f32>, length: usize) -> &mut [f32] {
    buffer.resize(length, 0.0);
    buffer
}
