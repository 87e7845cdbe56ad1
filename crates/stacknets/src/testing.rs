//! What the tests of this crate share.

use rand::SeedableRng;
use rand_xoshiro::Xoshiro256PlusPlus;

use super::{Shape, Stack};

pub(crate) type Dice = Xoshiro256PlusPlus;

pub(crate) fn dice(seed: u64) -> Dice {
    Dice::seed_from_u64(seed)
}

/// Makes networks from the seeds of these numbers.
pub(crate) fn stack(shape: Shape, numbers: &[u64]) -> Stack {
    Stack::new(shape, numbers.iter().map(|&number| dice(number)))
}
