//! The plan that fits what lights have shown best: the fixed timing of a policy, or of a rule that looks at the traffic.
//!
//! For each light it takes the greens that were shown, in the cyclic order in which they followed each other most often.
//! The lengths are the mean lengths. Where the order varies, some greens were shown more often than others. A second
//! candidate gives each green its share of all green. Two more give all lights a common cycle, with offsets that suit
//! the traffic. The caller plays all candidates and takes the best one.

use std::sync::Arc;

use anyhow::Result;

use super::coordinate::{Coordination, of_common_cycle};
use super::day::DayPlan;
use crate::Traffic;
use crate::agents::phase_plan::PhasePlan;
use crate::agents::plan::AgentPlan;
use crate::controllers::webster::is_enough;
use crate::controllers::{Timing, split};
use crate::sim::global::GlobalTraffic;
use crate::sim::lights::Stay;

/// Least number of starts of a green, as a share of the starts of the green that starts most often. Rarer greens are left
/// out if the others serve everything.
const RARE: f64 = 0.1;
/// Largest number of greens of which all orders are tried.
const FEW: usize = 8;
/// Shares of the lengths of a green below which its shortest and its longest length are for actuated lights.
const LIMITS: [f64; 2] = [0.05, 0.95];

/// What the lights of a simulator have shown in some episodes.
#[derive(Clone, Debug)]
pub struct Watched(Vec<Seen>);

/// What one light has shown.
#[derive(Clone, Debug, PartialEq)]
struct Seen {
    phases: Arc<PhasePlan>,
    /// Seconds for which cars had each green, of all whole stays. The first and the last stay of an episode are not whole.
    stays_s: Vec<Vec<u32>>,
    /// How often a green followed another one, `[from][to]`.
    follows: Vec<Vec<u32>>,
    /// Seconds of each green, of stays that are not whole, too.
    all_s: Vec<u64>,
}

impl Watched {
    pub fn nothing(traffic: &Traffic) -> Watched {
        Watched(traffic.plans().iter().map(|plan| Seen::nothing(&plan.phases)).collect())
    }

    /// Makes a simulator keep what its lights show.
    pub fn prepare(simulator: &mut GlobalTraffic) {
        simulator.keep_history();
    }

    /// Adds the episode that a simulator has just played.
    pub fn note(&mut self, simulator: &GlobalTraffic) {
        self.0.iter_mut().zip(simulator.history()).for_each(|(seen, stays)| seen.note(stays));
    }

    /// Returns plans that fit what was shown, at least one. A light that never left a green keeps it for good.
    pub fn candidates(&self, traffic: &Traffic) -> Result<Vec<DayPlan>> {
        let plans = traffic.plans();
        let lights = || plans.iter().zip(&self.0);
        let own: [Vec<Timing>; 2] =
            [Lengths::Means, Lengths::Shares].map(|how| lights().map(|(plan, seen)| seen.timing(plan, how)).collect());
        let mut found = own.to_vec();
        if plans.len() > 1 {
            let coordination = Coordination::measure(traffic)?;
            for timings in &own {
                let common = of_common_cycle(plans, timings, mean_cycle(timings));
                found.push(coordination.with_offsets(plans, common));
            }
        }
        found.dedup();
        Ok(found.into_iter().map(|timings| DayPlan::of_all_day(timings, traffic.window_s())).collect())
    }

    /// Returns the shortest and the longest length of each green of each light in seconds, `[lights][greens]`: the lengths
    /// below which 5 and 95 % of the stays are, and not below the light's own minimum.
    pub(super) fn limits_s(&self, plans: &[AgentPlan]) -> Vec<Vec<[u32; 2]>> {
        let of_light = |(plan, seen): (&AgentPlan, &Seen)| {
            let greens = plan.phases.min_green_steps().iter().zip(&seen.stays_s);
            greens.map(|(&least, stays)| limits_s(stays, least)).collect()
        };
        plans.iter().zip(&self.0).map(of_light).collect()
    }
}

fn limits_s(stays: &[u32], least: u32) -> [u32; 2] {
    let mut stays = stays.to_vec();
    stays.sort_unstable();
    let rank = |share: f64| ((share * stays.len() as f64).ceil() as usize).clamp(1, stays.len().max(1)) - 1;
    let [shortest, longest] = LIMITS.map(|share| stays.get(rank(share)).copied().unwrap_or(0).max(least));
    [shortest, longest.max(shortest)]
}

fn mean_cycle(timings: &[Timing]) -> u32 {
    let sum: u32 = timings.iter().map(Timing::cycle).sum();
    (f64::from(sum) / timings.len() as f64).round() as u32
}

#[derive(Clone, Copy)]
enum Lengths {
    Means,
    Shares,
}

impl Seen {
    fn nothing(phases: &Arc<PhasePlan>) -> Seen {
        let greens = phases.greens().len();
        Seen {
            phases: phases.clone(),
            stays_s: vec![Vec::new(); greens],
            follows: vec![vec![0; greens]; greens],
            all_s: vec![0; greens],
        }
    }

    fn note(&mut self, stays: &[Stay]) {
        let greens = stays.iter().filter_map(|stay| Some((stay.shown.green()?, stay.seconds)));
        let greens: Vec<(usize, u32)> = greens.collect();
        for (number, &(green, seconds)) in greens.iter().enumerate() {
            let next = greens.get(number + 1).map(|&(next, _)| next);
            let seconds = seconds + next.map_or(0, |next| self.phases.walk_end_steps(green, next));
            self.all_s[green] += u64::from(seconds);
            let Some(next) = next else { continue };
            self.follows[green][next] += 1;
            if number > 0 {
                self.stays_s[green].push(seconds);
            }
        }
    }

    fn timing(&self, plan: &AgentPlan, lengths: Lengths) -> Timing {
        let order = self.order(&self.chosen(plan));
        let least = plan.phases.min_green_steps();
        let means = |green: usize| mean_s(&self.stays_s[green]).max(f64::from(least[green]));
        let mut steps = vec![0; plan.greens()];
        order.iter().for_each(|&green| steps[green] = means(green).round() as u32);
        if let Lengths::Shares = lengths {
            let sum: u32 = steps.iter().sum();
            let mut weights = vec![0.0; steps.len()];
            order.iter().for_each(|&green| weights[green] = self.all_s[green].max(1) as f64);
            steps = split(sum, &weights, least).expect("the means are no shorter than the least greens");
        }
        Timing::in_order(&plan.phases, &plan.phases.fitted(&steps), &order, 0)
    }

    /// Returns the greens of the plan: those that were shown often, and what else is needed to serve every link.
    fn chosen(&self, plan: &AgentPlan) -> Vec<usize> {
        let starts: Vec<u32> =
            (0..plan.greens()).map(|to| self.follows.iter().map(|follows| follows[to]).sum()).collect();
        let most = starts.iter().copied().max().unwrap_or(0);
        if most == 0 {
            // It never left a green, or hardly: then it is that one.
            let longest = (0..plan.greens()).max_by_key(|&green| (self.all_s[green], std::cmp::Reverse(green)));
            return longest.into_iter().collect();
        }
        let mut by_starts: Vec<usize> = (0..plan.greens()).collect();
        by_starts.sort_by_key(|&green| std::cmp::Reverse(starts[green]));
        let often = |&green: &usize| f64::from(starts[green]) >= RARE * f64::from(most);
        let mut chosen: Vec<usize> = by_starts.iter().copied().filter(often).collect();
        for green in by_starts {
            if is_enough(plan, &chosen) {
                break;
            }
            if !chosen.contains(&green) {
                chosen.push(green);
            }
        }
        chosen.sort_unstable();
        chosen
    }

    /// Returns the cyclic order of these greens in which they followed each other most often. The first one stays first.
    fn order(&self, greens: &[usize]) -> Vec<usize> {
        let follows = |order: &[usize]| -> u32 {
            let next = |place: usize| order[(place + 1) % order.len()];
            order.iter().enumerate().map(|(place, &green)| self.follows[green][next(place)]).sum()
        };
        if greens.len() > FEW {
            let mut left = greens[1..].to_vec();
            let mut order = vec![greens[0]];
            while !left.is_empty() {
                let last = order[order.len() - 1];
                let places = 0..left.len();
                let place = places.max_by_key(|&place| (self.follows[last][left[place]], std::cmp::Reverse(place)));
                order.push(left.remove(place.expect("some are left")));
            }
            return order;
        }
        let mut best = greens.to_vec();
        permute(&mut greens.to_vec(), 1, &mut |order| {
            if follows(order) > follows(&best) {
                best = order.to_vec();
            }
        });
        best
    }
}

/// Calls `visit` with every order of the items from a place on. The order given comes first.
fn permute(items: &mut Vec<usize>, from: usize, visit: &mut impl FnMut(&[usize])) {
    if from + 1 >= items.len() {
        return visit(items);
    }
    for place in from..items.len() {
        items[from..=place].rotate_right(1);
        permute(items, from + 1, visit);
        items[from..=place].rotate_left(1);
    }
}

fn mean_s(stays: &[u32]) -> f64 {
    stays.iter().map(|&seconds| f64::from(seconds)).sum::<f64>() / stays.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::phase_plan::Shown;
    use crate::controllers::examples::crossing;

    /// A light that showed these greens for these seconds, with four seconds between two of them.
    fn seen(greens: &[(usize, u32)]) -> Seen {
        let mut seen = Seen::nothing(&crossing().phases);
        let pairs = greens.iter().zip(&greens[1..]);
        let mut stays: Vec<Stay> = pairs
            .flat_map(|(&(from, seconds), &(to, _))| {
                [Stay { shown: Shown::Green(from), seconds }, Stay { shown: Shown::Between { from, to }, seconds: 4 }]
            })
            .collect();
        let &(last, seconds) = &greens[greens.len() - 1];
        stays.push(Stay { shown: Shown::Green(last), seconds });
        seen.note(&stays);
        seen
    }

    #[test]
    fn a_light_that_goes_round_is_frozen_with_its_order_and_its_mean_greens() {
        let rounds = [(0, 90), (2, 10), (1, 7), (3, 20), (0, 30), (2, 14), (1, 8), (3, 24), (0, 34), (2, 1)];
        let seen = seen(&rounds);
        // The first and the last stay do not count: 30 and 34, 10 and 14, 7 and 8, 20 and 24.
        let timing = seen.timing(&crossing(), Lengths::Means);
        assert_eq!(timing.order().collect::<Vec<_>>(), [0, 2, 1, 3]);
        assert_eq!((timing.greens(), timing.cycle()), (&[32, 8, 12, 22][..], 74 + 16));
    }

    #[test]
    fn a_green_that_is_shown_more_often_than_others_has_a_larger_share() {
        // 0, 1, 2, 0, 1, 3 and so on; each for 10 s.
        let rounds: Vec<(usize, u32)> =
            [0, 1, 2, 0, 1, 3].into_iter().cycle().take(61).map(|green| (green, 10)).collect();
        let seen = seen(&rounds);
        assert_eq!(seen.timing(&crossing(), Lengths::Means).greens(), [10; 4]);
        // 210, 200, 100 and 100 of 610 s, of 40: 13.8, 13.1, 6.6, 6.6.
        assert_eq!(seen.timing(&crossing(), Lengths::Shares).greens(), [14, 13, 7, 6]);
    }

    #[test]
    fn a_rare_green_stays_only_if_no_other_serves_its_cars() {
        let mut rounds: Vec<(usize, u32)> = [0, 2, 3].into_iter().cycle().take(90).map(|green| (green, 10)).collect();
        rounds[45] = (1, 10);
        // Green 1 alone has priority for the left turn from the west.
        assert_eq!(seen(&rounds).chosen(&crossing()), [0, 1, 2, 3]);
        // Without the link from the south to the west, nobody needs green 3.
        let mut plan = crossing();
        plan.region.links[3].letter = 2;
        plan.phases = Arc::new((*plan.phases).clone().for_cars([0, 1, 2, 4].into()));
        let mut rounds: Vec<(usize, u32)> = [0, 1, 2].into_iter().cycle().take(90).map(|green| (green, 10)).collect();
        rounds[45] = (3, 10);
        assert_eq!(seen(&rounds).chosen(&plan), [0, 1, 2]);
    }

    #[test]
    fn a_light_that_never_changed_keeps_its_green() {
        let timing = seen(&[(2, 600)]).timing(&crossing(), Lengths::Means);
        assert_eq!(timing.order().collect::<Vec<_>>(), [2]);
    }

    #[test]
    fn actuated_limits_are_those_between_which_nine_of_ten_greens_are() {
        let stays: Vec<u32> = (1..=100).collect();
        assert_eq!(limits_s(&stays, 3), [5, 95]);
        assert_eq!(limits_s(&stays, 12), [12, 95]);
        assert_eq!((limits_s(&[40], 5), limits_s(&[], 5), limits_s(&[2], 5)), ([40, 40], [5, 5], [5, 5]));
    }
}
