//! A test: the order in which products of 256 bits add up, in plain Rust.
//!
//! These products only multiply, add, and multiply and add in one operation (`mul_add`, rounded once). Each of these
//! has exactly one right result by IEEE 754. So this order gives the same bits on every machine.

use rand::Rng;

use super::few_rows::FEW_ROWS;
use super::product::{Before, Matrix, multiply_with};
use super::testing::{Dice, dice};
use super::vectors::{VectorWidth, vector_instructions};

const LANES: usize = 8;
/// Numbers of the inner dimension that are added up in one call.
const DEPTH: usize = 512;
/// Largest product, in numbers of the output, for the kernels that add up across a register.
const ACROSS: usize = 16 * 16;

/// A product whose numbers can be computed one by one.
struct TestProduct<'a> {
    left: Matrix<'a>,
    right: Matrix<'a>,
    transposed: [bool; 2],
}

impl TestProduct<'_> {
    /// Returns the row and the column of the factors, along the inner dimension.
    fn factors(&self, row: usize, column: usize) -> Vec<(f32, f32)> {
        let ((left_row, left_column), (right_row, right_column)) = (self.left.strides(), self.right.strides());
        let left = |k: usize| self.left.values[row * left_row as usize + k * left_column as usize];
        let right = |k: usize| self.right.values[k * right_row as usize + column * right_column as usize];
        (0..self.left.columns).map(|k| (left(k), right(k))).collect()
    }

    /// Computes one number of the product. `start`: the old number, if the product is added to it.
    fn number(&self, factors: &[(f32, f32)], start: Option<f32>) -> f32 {
        if self.left.rows <= FEW_ROWS && self.transposed == [false, true] && start.is_none() {
            return few_rows(factors);
        }
        if self.left.rows == 1 && !self.transposed[1] {
            return in_a_row(factors, start.unwrap_or(0.0));
        }
        let mut sum = start;
        for part in factors.chunks(DEPTH) {
            sum = Some(self.part(part, sum));
        }
        sum.expect("there are factors")
    }

    /// Adds up a part of the inner dimension in the order of the crate `gemm`.
    fn part(&self, factors: &[(f32, f32)], start: Option<f32>) -> f32 {
        let ((left_row, left_column), (right_row, right_column)) = (self.left.strides(), self.right.strides());
        let (rows, columns) = (self.left.rows, self.right.columns);
        let added = |sum: f32| start.map_or(sum, |start| start + sum);
        if left_column == 1 && right_row == 1 && rows * columns <= ACROSS {
            return added(across(factors));
        }
        if factors.len() <= 2 {
            return not_fused(factors, start);
        }
        let right_lies_along = right_column == 1 && rows == 1;
        let left_lies_along = left_row == 1 && columns == 1;
        match () {
            () if right_lies_along || left_lies_along => in_a_row(factors, start.unwrap_or(0.0)),
            () if (rows == 1 || columns == 1) && left_column == 1 && right_row == 1 => added(eight_registers(factors)),
            () => added(in_a_row(factors, 0.0)),
        }
    }
}

/// Adds up one after the other.
fn in_a_row(factors: &[(f32, f32)], start: f32) -> f32 {
    factors.iter().fold(start, |sum, (l, r)| l.mul_add(*r, sum))
}

/// Adds up one after the other, and also rounds after each multiplication.
fn not_fused(factors: &[(f32, f32)], start: Option<f32>) -> f32 {
    let sum = factors.iter().fold(start, |sum, (l, r)| Some(sum.map_or(l * r, |sum| l * r + sum)));
    sum.expect("there are factors")
}

/// Adds up every lane of a register separately.
fn lanes(factors: &[(f32, f32)], mut sums: [f32; LANES]) -> [f32; LANES] {
    for chunk in factors.chunks(LANES) {
        sums.iter_mut().zip(chunk).for_each(|(sum, (l, r))| *sum = l.mul_add(*r, *sum));
    }
    sums
}

/// Adds the upper half to the lower half, and repeats.
fn halved(x: [f32; LANES]) -> f32 {
    let four: [f32; 4] = std::array::from_fn(|i| x[i] + x[i + 4]);
    (four[0] + four[2]) + (four[1] + four[3])
}

fn across(factors: &[(f32, f32)]) -> f32 {
    halved(lanes(factors, [0.0; LANES]))
}

/// Adds up few rows. What does not fill a register comes last, not fused.
fn few_rows(factors: &[(f32, f32)]) -> f32 {
    let (whole, rest) = factors.split_at(factors.len() / LANES * LANES);
    across(whole) + rest.iter().map(|(l, r)| l * r).sum::<f32>()
}

/// Adds up in eight registers in turn, then in pairs; then in one; then lane by lane; last what does not fill a
/// register.
fn eight_registers(factors: &[(f32, f32)]) -> f32 {
    let (eights, rest) = factors.split_at(factors.len() / (8 * LANES) * 8 * LANES);
    let mut sums = [[0.0; LANES]; 8];
    for (i, register) in eights.chunks(LANES).enumerate() {
        sums[i % 8] = lanes(register, sums[i % 8]);
    }
    let pair = |a: [f32; LANES], b: [f32; LANES]| -> [f32; LANES] { std::array::from_fn(|i| a[i] + b[i]) };
    let [a, b, c, d, e, f, g, h] = sums;
    let sums = pair(pair(pair(a, b), pair(c, d)), pair(pair(e, f), pair(g, h)));
    let (whole, rest) = rest.split_at(rest.len() / LANES * LANES);
    let sum = lanes(whole, sums).into_iter().reduce(|sum, lane| sum + lane).expect("there are lanes");
    in_a_row(rest, sum)
}

/// Rows, depth and columns: few and many of each, whole registers and parts, and more depth than is added up in one
/// call.
const SHAPES: [[usize; 3]; 18] = [
    [1, 1, 1],
    [1, 2, 300],
    [1, 37, 300],
    [1, 1100, 300],
    [2, 256, 768],
    [3, 3, 1],
    [5, 513, 7],
    [6, 9, 5],
    [7, 19, 8],
    [32, 40, 3],
    [32, 256, 128],
    [33, 1, 17],
    [40, 2, 9],
    [64, 600, 64],
    [128, 8, 1],
    [300, 130, 1],
    [300, 1037, 1],
    [70, 1500, 90],
];

fn random(count: usize, dice: &mut Dice) -> Vec<f32> {
    (0..count).map(|_| dice.random_range(-1.0..1.0)).collect()
}

/// Calls `each` with every shape in every order of its factors, and with its name.
fn for_all_products(mut each: impl FnMut(&TestProduct<'_>, &str)) {
    let mut dice = dice(3);
    for [rows, depth, columns] in SHAPES {
        let (a, b) = (random(rows * depth, &mut dice), random(depth * columns, &mut dice));
        for transposed in [[false, false], [false, true], [true, false], [true, true]] {
            let left = if transposed[0] { Matrix::new(&a, rows).transposed() } else { Matrix::new(&a, depth) };
            let right = if transposed[1] { Matrix::new(&b, depth).transposed() } else { Matrix::new(&b, columns) };
            let name = format!("{rows} x {depth} x {columns}, transposed {transposed:?}");
            each(&TestProduct { left, right, transposed }, &name);
        }
    }
}

fn product(width: VectorWidth, of: &TestProduct<'_>, before: Before) -> Vec<f32> {
    let mut out: Vec<f32> = (0..of.left.rows * of.right.columns).map(|i| 0.1 * i as f32).collect();
    multiply_with(width, of.left, of.right, &mut out, before);
    out
}

#[test]
fn the_products_of_the_widest_registers_are_what_the_definition_says() {
    for_all_products(|of, name| {
        for before in [Before::Overwrite, Before::Add] {
            for (i, value) in product(VectorWidth::Widest, of, before).into_iter().enumerate() {
                let factors = of.factors(i / of.right.columns, i % of.right.columns);
                let start = if before == Before::Add { f64::from(0.1 * i as f32) } else { 0.0 };
                let exact = start + factors.iter().map(|(l, r)| f64::from(*l) * f64::from(*r)).sum::<f64>();
                assert!((f64::from(value) - exact).abs() < 1e-3, "{name}, number {i}: {value} {exact}");
            }
        }
    });
}

#[test]
fn products_of_256_bits_are_to_the_bit_those_of_plain_rust_and_the_widest_differ_if_they_are_wider() {
    let names = match vector_instructions(VectorWidth::Bits256) {
        Ok(name) => [name, vector_instructions(VectorWidth::Widest).unwrap()],
        Err(error) => return eprintln!("not tested: {error}"),
    };
    let mut different = 0;
    for_all_products(|of, name| {
        for before in [Before::Overwrite, Before::Add] {
            let [out, widest] = [VectorWidth::Bits256, VectorWidth::Widest].map(|width| product(width, of, before));
            for (i, (value, widest)) in out.iter().zip(widest).enumerate() {
                let factors = of.factors(i / of.right.columns, i % of.right.columns);
                let expected = of.number(&factors, (before == Before::Add).then_some(0.1 * i as f32));
                assert_eq!(value.to_bits(), expected.to_bits(), "{name}, number {i}: {value} {expected}");
                different += u32::from(value.to_bits() != widest.to_bits());
            }
        }
    });
    assert_eq!(different > 0, names[0] != names[1], "{names:?}: {different} numbers differ");
}
