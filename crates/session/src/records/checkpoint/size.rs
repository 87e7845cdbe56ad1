//! How large a checkpoint can be, so that a reader takes no more memory than one needs.

use super::owner::Owner;
use dials_learn::policy::PolicyStack;
use dials_learn::training::fits::Widths;

/// Returns the largest number of bytes that a checkpoint of this run can have.
pub fn most_bytes(owner: &Owner) -> u64 {
    /// Room for the header: names, config, scenario and progress.
    const HEADER: u64 = 1 << 20;
    /// The longest number in postcard's format.
    const NUMBER: u64 = 10;
    let Widths { policies, aips } = Widths::of(&owner.config.learning, &owner.kinds);
    let sum = |widths: &[usize]| widths.iter().map(|&width| width as u64).sum::<u64>();
    let dice = 4 * NUMBER;
    let streams = owner.kinds.specs().map(|spec| {
        let trail = 5 * NUMBER + (spec.horizon.max(spec.local_horizon) * (1 + spec.sources.count())) as u64;
        let state = 4 * PolicyStack::shape(spec, &owner.config.learning.policy).state_width() as u64;
        let row = trail + 2 * dice + NUMBER + state + 8;
        dice + NUMBER + owner.config.learning.copies() as u64 * row
    });
    HEADER + 4 * (3 * sum(&policies) + sum(&aips)) + NUMBER + streams.sum::<u64>()
}
