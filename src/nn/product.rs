//! Products of small matrices: the crate `gemm`, and for few rows kernels of our own.
//!
//! `gemm` multiplies the shapes of these networks (32 x 256 by 256 x 128) about twice as fast as libtorch with OpenBLAS:
//! it has kernels for 512-bit registers and little cost per call.

use gemm::{Parallelism, gemm};

use super::few_rows::{FEW_ROWS, add_row_by_matrix, dot_products};

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
        return dot_products(left.values, right.values, depth, out);
    }
    if rows == 1 && !right.transposed {
        if before == Before::Overwrite {
            out.fill(0.0);
        }
        return add_row_by_matrix(left.values, right.values, out);
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
        for (rows, depth, columns) in [
            (1, 1, 1),
            (1, 256, 128),
            (1, 37, 781),
            (2, 3, 5),
            (3, 5, 7),
            (4, 256, 37),
            (5, 40, 33),
            (7, 19, 8),
            (32, 40, 3),
        ] {
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
