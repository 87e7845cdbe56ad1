//! Which lanes a green serves.

use super::plan::AgentPlan;

impl AgentPlan {
    /// Returns the share of an approach's links that have green, from 0 to 1. Cars on a lane that several links share
    /// may want any of them.
    pub(crate) fn share(&self, green: usize, approach: usize) -> f64 {
        let links = &self.region.approaches[approach].links;
        let served = links.iter().filter(|&&link| self.opens(green, link)).count();
        // An approach without links leads nowhere that a light could open.
        served as f64 / links.len().max(1) as f64
    }

    /// Returns whether some link of an approach has green.
    pub(crate) fn serves(&self, green: usize, approach: usize) -> bool {
        self.share(green, approach) > 0.0
    }

    /// Returns the approaches with a link that has green, in their order.
    pub fn served(&self, green: usize) -> impl Iterator<Item = usize> + '_ {
        (0..self.region.approaches.len()).filter(move |&approach| self.serves(green, approach))
    }

    /// Returns whether a link has green.
    pub(crate) fn opens(&self, green: usize, link: usize) -> bool {
        self.letter(green, link).eq_ignore_ascii_case(&b'g')
    }

    /// Returns whether a link has green and no green serves it better: `G`, or `g` if it never has `G`.
    pub(crate) fn serves_best(&self, green: usize, link: usize) -> bool {
        let has_priority = |green: usize| self.letter(green, link) == b'G';
        has_priority(green) || self.letter(green, link) == b'g' && !(0..self.greens()).any(has_priority)
    }

    /// Returns the number of greens.
    pub(crate) fn greens(&self) -> usize {
        self.phases.greens().len()
    }

    /// Returns the letter of a link in a green.
    fn letter(&self, green: usize, link: usize) -> u8 {
        self.phases.greens()[green].as_str().as_bytes()[self.region.links[link].letter]
    }
}

#[cfg(test)]
mod tests {
    use crate::controllers::examples::crossing;

    #[test]
    fn a_shared_lane_is_served_in_part() {
        let plan = crossing();
        let shares = |green| [0, 1, 2, 3, 4].map(|approach| plan.share(green, approach));
        assert_eq!(shares(0), [1.0, 0.0, 0.0, 1.0, 1.0]);
        assert_eq!(shares(2), [0.0, 0.0, 0.5, 0.0, 0.0]);
        assert_eq!(plan.served(3).collect::<Vec<_>>(), [1, 2]);
    }

    #[test]
    fn a_link_with_priority_somewhere_is_served_best_there() {
        let plan = crossing();
        // The left turn from the west: `G` in green 1, `g` in green 3.
        assert_eq!([0, 1, 2, 3].map(|green| plan.serves_best(green, 1)), [false, true, false, false]);
        assert!(plan.serves_best(3, 3));
    }
}
