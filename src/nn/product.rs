//! Products of small matrices: the crate `gemm`, and for few rows a kernel of our own.
//!
//! `gemm` multiplies the shapes of these networks (32 x 256 by 256 x 128) about twice as fast as libtorch with OpenBLAS:
//! it has kernels for 512-bit registers and no cost per call worth naming. One case it has no kernel for: the gradient
//! that goes back through the state weight of a GRU, a few rows by a transposed matrix.

use gemm::{Parallelism, gemm};
use pulp::{Arch, Simd, WithSimd};

/// Up to so many rows our own kernel multiplies by a transposed matrix faster; measured for 256 x 768.
const FEW_ROWS: usize = 6;

/// A matrix in somebody's memory, row after row or, transposed, column after column.
#[derive(Clone, Copy)]
pub struct Matrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    transposed: bool,
}

impl<'a> Matrix<'a> {
    /// `values`: whole rows of `columns` each, one after another.
    pub fn new(values: &'a [f32], columns: usize) -> Self {
        assert!(values.len().is_multiple_of(columns), "{} values are no rows of {columns}", values.len());
        Matrix { values, rows: values.len() / columns, columns, transposed: false }
    }

    pub fn transposed(self) -> Self {
        Matrix { rows: self.columns, columns: self.rows, transposed: !self.transposed, ..self }
    }

    /// How far the next row and the next column are.
    fn strides(self) -> (isize, isize) {
        if self.transposed { (1, self.rows as isize) } else { (self.columns as isize, 1) }
    }
}

/// What happens to the numbers that stand where a product goes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Before {
    Overwrite,
    Add,
}

/// `out = left x right`, or `out += left x right`. `out`: row after row.
pub fn multiply(left: Matrix<'_>, right: Matrix<'_>, out: &mut [f32], before: Before) {
    let (rows, depth, columns) = (left.rows, left.columns, right.columns);
    assert_eq!(depth, right.rows, "{rows} x {depth} by {} x {columns}", right.rows);
    assert_eq!(out.len(), rows * columns, "{rows} x {columns} values come out");
    if rows <= FEW_ROWS && right.transposed && !left.transposed && before == Before::Overwrite {
        Arch::new().dispatch(DotProducts { left: left.values, right: right.values, depth, out });
        return;
    }
    let ((left_row, left_column), (right_row, right_column)) = (left.strides(), right.strides());
    // SAFETY: `Matrix` holds `rows x columns` values that its strides stay within, the shapes fit each other, and `out`
    // has room for all of the product and is nobody else's.
    unsafe {
        gemm(
            rows,
            columns,
            depth,
            out.as_mut_ptr(),
            1,
            columns as isize,
            before == Before::Add,
            left.values.as_ptr(),
            left_column,
            left_row,
            right.values.as_ptr(),
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

/// Adds the rows up: the gradient of a bias.
pub fn sum_rows(rows: &[f32], sums: &mut [f32]) {
    sums.fill(0.0);
    for row in rows.chunks_exact(sums.len()) {
        sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += value);
    }
}

/// `out = left x right^T`: every number is the dot product of two rows, each as it lies in memory.
struct DotProducts<'a> {
    /// `[rows, depth]`
    left: &'a [f32],
    /// `[columns, depth]`
    right: &'a [f32],
    depth: usize,
    /// `[rows, columns]`
    out: &'a mut [f32],
}

impl WithSimd for DotProducts<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let rows = self.left.len() / self.depth;
        let mut row = 0;
        while row < rows {
            row += match rows - row {
                4.. => self.rows::<S, 4>(simd, row),
                2..4 => self.rows::<S, 2>(simd, row),
                _ => self.rows::<S, 1>(simd, row),
            };
        }
    }
}

impl DotProducts<'_> {
    /// `ROWS` rows of the product from `row` on.
    #[inline(always)]
    fn rows<S: Simd, const ROWS: usize>(&mut self, simd: S, row: usize) -> usize {
        let columns = self.right.len() / self.depth;
        let in_fours = columns / 4 * 4;
        (0..in_fours).step_by(4).for_each(|column| self.tile::<S, ROWS, 4>(simd, row, column));
        (in_fours..columns).for_each(|column| self.tile::<S, ROWS, 1>(simd, row, column));
        ROWS
    }

    /// Several sums at once: each number that is loaded serves several, and none waits for itself.
    #[inline(always)]
    fn tile<S: Simd, const ROWS: usize, const COLUMNS: usize>(&mut self, simd: S, row: usize, column: usize) {
        let (depth, columns) = (self.depth, self.right.len() / self.depth);
        let whole = depth / S::F32_LANES;
        let left: [&[f32]; ROWS] = std::array::from_fn(|i| &self.left[(row + i) * depth..][..depth]);
        let right: [&[f32]; COLUMNS] = std::array::from_fn(|i| &self.right[(column + i) * depth..][..depth]);
        let left_lanes = left.map(|row| &S::as_simd_f32s(row).0[..whole]);
        let right_lanes = right.map(|row| &S::as_simd_f32s(row).0[..whole]);
        let mut sums = [[simd.splat_f32s(0.0); COLUMNS]; ROWS];
        for chunk in 0..whole {
            for (sums, left) in sums.iter_mut().zip(left_lanes) {
                for (sum, right) in sums.iter_mut().zip(right_lanes) {
                    *sum = simd.mul_add_f32s(left[chunk], right[chunk], *sum);
                }
            }
        }
        let rest = whole * S::F32_LANES;
        for (i, (sums, left)) in sums.into_iter().zip(left).enumerate() {
            for (j, (sum, right)) in sums.into_iter().zip(right).enumerate() {
                let tail = left[rest..].iter().zip(&right[rest..]).map(|(l, r)| l * r).sum::<f32>();
                self.out[(row + i) * columns + column + j] = simd.reduce_sum_f32s(sum) + tail;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{Dice, Seed};
    use rand::Rng;

    fn random(count: usize, dice: &mut Dice) -> Vec<f32> {
        (0..count).map(|_| dice.random_range(-1.0..1.0)).collect()
    }

    /// As the definition says, in double precision.
    fn by_definition(left: Matrix<'_>, right: Matrix<'_>, row: usize, column: usize) -> f64 {
        let at = |matrix: Matrix<'_>, row: usize, column: usize| {
            let (down, across) = matrix.strides();
            f64::from(matrix.values[row * down as usize + column * across as usize])
        };
        (0..left.columns).map(|k| at(left, row, k) * at(right, k, column)).sum()
    }

    #[test]
    fn products_of_all_shapes_and_orders_are_what_the_definition_says() {
        let mut dice = Seed::new(1).dice();
        for (rows, depth, columns) in
            [(1, 1, 1), (2, 3, 5), (3, 5, 7), (4, 256, 37), (5, 40, 33), (7, 19, 8), (32, 40, 3)]
        {
            let (a, b) = (random(rows * depth, &mut dice), random(depth * columns, &mut dice));
            for left in [Matrix::new(&a, depth), Matrix::new(&a, rows).transposed()] {
                for right in [Matrix::new(&b, columns), Matrix::new(&b, depth).transposed()] {
                    let mut out = vec![0.5; rows * columns];
                    for (before, start) in [(Before::Add, 0.5), (Before::Overwrite, 0.0)] {
                        multiply(left, right, &mut out, before);
                        for (i, &value) in out.iter().enumerate() {
                            let exact = start + by_definition(left, right, i / columns, i % columns);
                            assert!(
                                (f64::from(value) - exact).abs() < 1e-5,
                                "{rows} x {depth} x {columns}: {value} {exact}"
                            );
                        }
                    }
                }
            }
        }
    }

    #[test]
    #[should_panic(expected = "2 x 3 by 2 x 3")]
    fn shapes_that_do_not_fit_are_refused() {
        multiply(Matrix::new(&[0.0; 6], 3), Matrix::new(&[0.0; 6], 3), &mut [0.0; 6], Before::Overwrite);
    }

    #[test]
    fn rows_add_up_column_by_column() {
        let mut sums = [9.0; 2];
        sum_rows(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &mut sums);
        assert_eq!(sums, [9.0, 12.0]);
    }
}
