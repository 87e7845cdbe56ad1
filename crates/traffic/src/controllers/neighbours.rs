//! Lights that are joined by a road.

use std::collections::HashMap;

use crate::agents::plan::AgentPlan;

/// Returns for each light whether it is an odd number of roads away from the first light that it is joined to. Two
/// lights are joined if an exit of one is an approach of the other.
pub fn every_other(plans: &[AgentPlan]) -> Vec<bool> {
    let joined = joined(plans);
    let mut odd: Vec<Option<bool>> = vec![None; plans.len()];
    for first in 0..plans.len() {
        if odd[first].is_some() {
            continue;
        }
        odd[first] = Some(false);
        let mut reached = vec![(first, false)];
        let mut done = 0;
        while let Some(&(light, is_odd)) = reached.get(done) {
            done += 1;
            for &other in &joined[light] {
                if odd[other].is_none() {
                    odd[other] = Some(!is_odd);
                    reached.push((other, !is_odd));
                }
            }
        }
    }
    odd.into_iter().map(|odd| odd.expect("every light was reached")).collect()
}

/// Returns the lights that each light is joined to.
fn joined(plans: &[AgentPlan]) -> Vec<Vec<usize>> {
    let mut behind: HashMap<&str, Vec<usize>> = HashMap::new();
    for (light, plan) in plans.iter().enumerate() {
        plan.region.approaches.iter().for_each(|lane| behind.entry(&lane.lane).or_default().push(light));
    }
    let mut joined = vec![Vec::new(); plans.len()];
    for (light, plan) in plans.iter().enumerate() {
        let ahead = plan.region.exits.iter().filter_map(|exit| behind.get(exit.lane.as_str())).flatten();
        for &other in ahead {
            joined[light].push(other);
            joined[other].push(light);
        }
    }
    joined
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::TrafficConfig;
    use crate::controllers::examples::crossing;
    use crate::paper_grid::grid::Grid;
    use crate::paper_grid::plans::plans;

    #[test]
    fn a_grid_becomes_a_checkerboard_and_lights_alone_are_even() {
        let grid = plans(Grid::new(2, 3).unwrap(), &TrafficConfig::new("", ""));
        assert_eq!(every_other(&grid), [false, true, false, true, false, true]);
        assert_eq!(every_other(&[crossing(), crossing()]), [false, false]);
    }
}
