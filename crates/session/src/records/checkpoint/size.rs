//! How large a checkpoint can be, so that a reader takes no more memory than one needs.

use super::owner::Owner;
use dials_core::domain::Kind;
use dials_learn::algorithms;
use dials_learn::state::fits::Widths;

/// Returns the largest number of bytes that a checkpoint of this run can have.
pub(super) fn most_bytes(owner: &Owner) -> u64 {
    /// Room for the header: names, config, scenario and progress.
    const HEADER: u64 = 1 << 20;
    /// The longest number in postcard's format.
    const NUMBER: u64 = 10;
    let Widths { policies, aips } = Widths::of(&owner.config.learning, &owner.kinds);
    let sum = |widths: &[usize]| widths.iter().map(|&width| width as u64).sum::<u64>();
    let dice = 4 * NUMBER;
    let of_kind = |kind: &Kind| {
        let learner =
            algorithms::of(&owner.config.learning).layout(&owner.config.learning, kind, owner.config.learning.end());
        let numbers: u64 = learner.numbers.iter().map(|table| 4 * table.width as u64).sum();
        let learner = numbers + learner.dice.iter().map(|(_, count)| NUMBER + *count as u64 * dice).sum::<u64>();
        let spec = &kind.spec;
        let trail = 5 * NUMBER + (spec.horizon.max(spec.local_horizon) * (1 + spec.sources.count())) as u64;
        let row = trail + dice + NUMBER + 8;
        kind.agents.len() as u64 * (learner + NUMBER + owner.config.learning.copies() as u64 * row)
    };
    HEADER + 4 * (sum(&policies) + sum(&aips)) + NUMBER + owner.kinds.iter().map(of_kind).sum::<u64>()
}
