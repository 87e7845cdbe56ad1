//! Products with one row or a few. No library that was measured is fast at them.
//!
//! Libraries first copy a matrix into a better order. For few rows it is faster to read it once, as it is.

use pulp::{Simd, WithSimd};

/// Largest number of rows for which [`DotProducts`] are faster than the library; measured for 256 x 768.
pub(crate) const FEW_ROWS: usize = 6;

/// Computes `out += row x matrix` for one row, as when each network has a single input at a time.
pub(crate) struct RowByMatrix<'a> {
    pub(crate) row: &'a [f32],
    /// `[row.len(), out.len()]`
    pub(crate) matrix: &'a [f32],
    pub(crate) out: &'a mut [f32],
}

impl WithSimd for RowByMatrix<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let width = self.out.len();
        let mut column = 0;
        while column + S::F32_LANES <= width {
            column += match (width - column) / S::F32_LANES {
                16.. => self.columns::<S, 16>(simd, column),
                8.. => self.columns::<S, 8>(simd, column),
                4.. => self.columns::<S, 4>(simd, column),
                _ => self.columns::<S, 1>(simd, column),
            };
        }
        if column < width {
            let mut sum = simd.partial_load_f32s(&self.out[column..]);
            for (&x, weights) in self.row.iter().zip(self.matrix.chunks_exact(width)) {
                sum = simd.mul_add_f32s(simd.splat_f32s(x), simd.partial_load_f32s(&weights[column..]), sum);
            }
            simd.partial_store_f32s(&mut self.out[column..], sum);
        }
    }
}

impl RowByMatrix<'_> {
    /// Computes `LANES` registers of the product from `column` on. They are kept while all rows of the matrix pass.
    #[inline(always)]
    fn columns<S: Simd, const LANES: usize>(&mut self, simd: S, column: usize) -> usize {
        let (width, count) = (self.out.len(), LANES * S::F32_LANES);
        let out = S::as_mut_simd_f32s(&mut self.out[column..column + count]).0;
        let mut sums: [S::f32s; LANES] = std::array::from_fn(|lane| out[lane]);
        for (&x, weights) in self.row.iter().zip(self.matrix.chunks_exact(width)) {
            let x = simd.splat_f32s(x);
            let weights = S::as_simd_f32s(&weights[column..column + count]).0;
            for (sum, &weight) in sums.iter_mut().zip(weights) {
                *sum = simd.mul_add_f32s(x, weight, *sum);
            }
        }
        out.copy_from_slice(&sums);
        count
    }
}

/// Computes `out = rows x matrix`, or `out += rows x matrix`, for 2 to [`FEW_ROWS`] rows, as when each network has the inputs of a few
/// copies. Every number of the matrix is read once. It adds up one after the other, as `gemm` does here.
pub(crate) struct RowsByMatrix<'a> {
    /// `[count, depth]`
    pub(crate) rows: &'a [f32],
    pub(crate) count: usize,
    /// `[depth, columns]`
    pub(crate) matrix: &'a [f32],
    /// `[count, columns]`
    pub(crate) out: &'a mut [f32],
    pub(crate) adds: bool,
}

impl WithSimd for RowsByMatrix<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        match self.count {
            2 => self.all::<S, 2, 4>(simd),
            3 => self.all::<S, 3, 4>(simd),
            4 => self.all::<S, 4, 2>(simd),
            5 => self.all::<S, 5, 2>(simd),
            6 => self.all::<S, 6, 2>(simd),
            count => unreachable!("{count} rows are not few"),
        }
    }
}

impl RowsByMatrix<'_> {
    /// Computes the product of `ROWS` rows, `LANES` registers of columns at once.
    #[inline(always)]
    fn all<S: Simd, const ROWS: usize, const LANES: usize>(&mut self, simd: S) {
        let columns = self.out.len() / ROWS;
        let mut column = 0;
        while column + LANES * S::F32_LANES <= columns {
            self.tile::<S, ROWS, LANES, true>(simd, column, LANES * S::F32_LANES);
            column += LANES * S::F32_LANES;
        }
        while column < columns {
            let width = S::F32_LANES.min(columns - column);
            self.tile::<S, ROWS, 1, false>(simd, column, width);
            column += width;
        }
    }

    /// Computes `width` columns from `column` on: `LANES` registers of them, or, if not `WHOLE`, a part of one. The sums stay in
    /// registers.
    #[inline(always)]
    fn tile<S: Simd, const ROWS: usize, const LANES: usize, const WHOLE: bool>(
        &mut self,
        simd: S,
        column: usize,
        width: usize,
    ) {
        let load = |values: &[f32]| -> [S::f32s; LANES] {
            let whole = S::as_simd_f32s(values).0;
            std::array::from_fn(|lane| if WHOLE { whole[lane] } else { simd.partial_load_f32s(values) })
        };
        let (depth, columns) = (self.rows.len() / ROWS, self.out.len() / ROWS);
        let rows: [&[f32]; ROWS] = std::array::from_fn(|row| &self.rows[row * depth..][..depth]);
        let mut sums = [[simd.splat_f32s(0.0); LANES]; ROWS];
        for (k, weights) in self.matrix.chunks_exact(columns).enumerate() {
            let weights = load(&weights[column..column + width]);
            for (sums, row) in sums.iter_mut().zip(rows) {
                let x = simd.splat_f32s(row[k]);
                sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum = simd.mul_add_f32s(x, weight, *sum));
            }
        }
        for (row, sums) in sums.into_iter().enumerate() {
            let out = &mut self.out[row * columns + column..][..width];
            let mut after = sums;
            if self.adds {
                after.iter_mut().zip(load(out)).for_each(|(sum, before)| *sum = simd.add_f32s(before, *sum));
            }
            if WHOLE {
                S::as_mut_simd_f32s(out).0.copy_from_slice(&after);
            } else {
                simd.partial_store_f32s(out, after[0]);
            }
        }
    }
}

/// Computes `out = left x right^T`: every number is the dot product of two rows.
///
/// It serves the gradient through the state weight of a GRU, for the few sequences of a minibatch.
pub(crate) struct DotProducts<'a> {
    /// `[rows, depth]`
    pub(crate) left: &'a [f32],
    /// `[columns, depth]`
    pub(crate) right: &'a [f32],
    pub(crate) depth: usize,
    /// `[rows, columns]`
    pub(crate) out: &'a mut [f32],
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
    /// Computes `ROWS` rows of the product from `row` on.
    #[inline(always)]
    fn rows<S: Simd, const ROWS: usize>(&mut self, simd: S, row: usize) -> usize {
        let columns = self.right.len() / self.depth;
        let in_fours = columns / 4 * 4;
        (0..in_fours).step_by(4).for_each(|column| self.tile::<S, ROWS, 4>(simd, row, column));
        (in_fours..columns).for_each(|column| self.tile::<S, ROWS, 1>(simd, row, column));
        ROWS
    }

    /// Computes several sums at once. Each loaded number serves several of them, and no sum waits for itself.
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
