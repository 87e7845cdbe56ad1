//! A plan for the day: timings of all lights, and at which second each light goes from one to the next.

use crate::controllers::Timing;

/// Timings of all lights, in the order of the agents, for one period after the other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DayPlan {
    pub(super) periods: Vec<Period>,
    /// Second of the simulation at which the plan ends.
    pub(super) end_s: u64,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Period {
    /// Second of the simulation.
    pub(super) begin_s: u64,
    pub(super) timings: Vec<Timing>,
}

/// A timing of one light, from one second of the simulation to another.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Stage<'a> {
    pub(super) from_s: u64,
    pub(super) to_s: u64,
    /// Second of the simulation at which a cycle begins, from 0 to the cycle.
    pub(super) offset_s: u32,
    pub(super) timing: &'a Timing,
}

impl DayPlan {
    pub(super) fn of_all_day(timings: Vec<Timing>, window_s: (u64, u64)) -> DayPlan {
        DayPlan { periods: vec![Period { begin_s: window_s.0, timings }], end_s: window_s.1 }
    }

    /// Returns the number of periods with timings of their own.
    pub fn periods(&self) -> usize {
        self.periods.len()
    }

    /// Returns the stages of a light.
    ///
    /// A light goes to its next timing when a cycle ends, and begins that one at its first green. Both timings have the
    /// same first green. So no light leaves a green without its yellow, or shows one for too short. A timing that repeats the
    /// one before it has no stage of its own.
    pub(super) fn stages(&self, light: usize) -> Vec<Stage<'_>> {
        let mut stages: Vec<Stage<'_>> = Vec::new();
        for Period { begin_s, timings } in &self.periods {
            let timing = &timings[light];
            if stages.last().is_some_and(|before| before.timing.repeats(timing)) {
                continue;
            }
            let cycle = u64::from(timing.cycle());
            let from_s = match stages.last_mut() {
                None => *begin_s,
                Some(before) => {
                    let cycle_before = u64::from(before.timing.cycle());
                    let since = (begin_s + cycle_before - u64::from(before.offset_s)) % cycle_before;
                    before.to_s = begin_s + (cycle_before - since) % cycle_before;
                    before.to_s
                }
            };
            // The first timing counts its offset from the beginning, and a later one begins with a cycle.
            let begun_s = if stages.is_empty() { from_s + u64::from(timing.offset()) } else { from_s };
            stages.push(Stage { from_s, to_s: self.end_s, offset_s: (begun_s % cycle) as u32, timing });
        }
        stages
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::controllers::examples::crossing;

    #[test]
    fn a_light_changes_its_timing_when_a_cycle_ends() {
        let plan = crossing();
        let timing = |greens: [u32; 4], offset| Timing::new(&plan.phases, &greens, offset);
        // Four steps between two greens: cycles of 50, 60 and 50 s. The first one begins at 1007, 1057, 1107, ...
        let timings = [timing([10, 0, 32, 0], 7), timing([30, 0, 22, 0], 9), timing([10, 0, 32, 0], 0)];
        let periods = [1000, 1800, 2400].into_iter().zip(timings.clone());
        let periods = periods.map(|(begin_s, timing)| Period { begin_s, timings: vec![timing] }).collect();
        let day = DayPlan { periods, end_s: 3000 };
        let stages = day.stages(0);
        // 1807 is 16 cycles after 1007. From there 2407 is 10 cycles later.
        let times: Vec<_> = stages.iter().map(|stage| (stage.from_s, stage.to_s, stage.offset_s)).collect();
        assert_eq!(times, [(1000, 1807, 7), (1807, 2407, 7), (2407, 3000, 7)]);
        assert!(stages.iter().zip(&timings).all(|(stage, timing)| stage.timing == timing));
    }

    #[test]
    fn a_timing_that_does_not_change_goes_on() {
        let plan = crossing();
        let timing = |greens: [u32; 4], offset| Timing::new(&plan.phases, &greens, offset);
        let timings = [timing([10, 0, 32, 0], 7), timing([10, 0, 32, 0], 3), timing([30, 0, 22, 0], 0)];
        let periods = [1000, 1800, 2400].into_iter().zip(timings);
        let periods = periods.map(|(begin_s, timing)| Period { begin_s, timings: vec![timing] }).collect();
        let day = DayPlan { periods, end_s: 3000 };
        let times: Vec<_> = day.stages(0).iter().map(|stage| (stage.from_s, stage.to_s, stage.offset_s)).collect();
        assert_eq!(times, [(1000, 2407, 7), (2407, 3000, 7)]);
    }
}
