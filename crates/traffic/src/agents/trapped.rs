//! Cars that are trapped within a junction, and the greens that would send others across their way.
//!
//! A car that turns may wait within the junction until others have passed. If its green ends before it got away, the next cars
//! drive into its way. Soon all of them block each other, because SUMO's cars do not drive around each other. Without teleports
//! such a jam stays.

use super::phase_plan::Shown;
use super::plan::AgentPlan;
use crate::cars_at::CarsAt;

impl AgentPlan {
    /// Returns the lanes within the junctions, link by link. There are none if masks do not mind trapped cars.
    pub(crate) fn lanes_inside(&self) -> Vec<&String> {
        self.region.links.iter().flat_map(|link| &link.inside).collect()
    }

    /// Forbids the greens that send cars across the way of a trapped one, unless they also let it go. If no other green is
    /// allowed, it forbids none. `inside`: the cars on [`AgentPlan::lanes_inside`]; `allowed`: of each green.
    pub(crate) fn mind_trapped(&self, inside: CarsAt<'_>, shown: Shown, allowed: &mut [bool]) {
        if inside.cars() == 0 {
            return;
        }
        let has_green = |link: usize| shown.green().is_some_and(|green| self.opens(green, link));
        let mut lanes = inside.iter();
        let standing: Vec<usize> = (self.region.links.iter())
            .map(|link| lanes.by_ref().take(link.inside.len()).map(|lane| lane.halting()).sum())
            .collect();
        let trapped: Vec<usize> = (0..standing.len()).filter(|&link| standing[link] > 0 && !has_green(link)).collect();
        let crosses = |green: usize| {
            let crossed = |&link: &usize| self.region.links[link].crosses.iter().any(|&other| self.opens(green, other));
            trapped.iter().any(|link| !self.opens(green, *link) && crossed(link))
        };
        let minding: Vec<bool> = allowed.iter().enumerate().map(|(green, &may)| may && !crosses(green)).collect();
        if minding.contains(&true) {
            allowed.copy_from_slice(&minding);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::phase_plan::Choice;
    use crate::controllers::examples::{crossing, phases};
    use crate::observe;
    use libsumo::{CarId, CarTable};
    use std::sync::Arc;

    const ALL: [bool; 4] = [true; 4];

    /// Returns which of the greens are left with a car of this speed within the junction on the way of a link.
    fn left(link: usize, mps: f64, shown: Shown, mut allowed: [bool; 4]) -> [bool; 4] {
        let mut plan = crossing();
        let links = plan.region.links.len();
        for (number, way) in plan.region.links.iter_mut().enumerate() {
            way.inside = vec![format!(":{number}_0"), format!(":{number}_1")];
            // The way from the south to the west crosses both from the west.
            way.crosses = [&[3][..], &[3], &[], &[0, 1], &[]][number].to_vec();
        }
        let mut cars = vec![Vec::new(); 2 * links];
        cars[2 * link + 1].push((CarId(1), 3.0, mps));
        plan.mind_trapped(CarsAt::all(&CarTable::of(cars)), shown, &mut allowed);
        allowed
    }

    #[test]
    fn a_light_that_keeps_the_order_of_its_greens_always_has_an_action() {
        let mut plan = crossing();
        // A car from the south to the west is trapped. All greens are allowed, the shown one and the next are across its way.
        plan.phases = Arc::new(phases(&["GGrrr", "Grrrr", "rrrGr"], Choice::InOrder));
        plan.region.links[3].inside = vec![":3_0".to_owned()];
        plan.region.links[3].crosses = vec![0];
        let cars = CarTable::of([vec![(CarId(1), 3.0, 0.0)]]);
        let mut mask = [false; 3];
        observe::mask(&plan, Shown::Green(0), CarsAt::all(&cars), |_| true, &mut mask);
        assert_eq!(mask, [true, true, false], "keep, next, and room for others");
    }

    #[test]
    fn no_green_opens_a_way_across_that_of_a_car_that_is_trapped() {
        let plan = crossing();
        let opens = |link: usize| [0, 1, 2, 3].map(|green| plan.opens(green, link));
        let [from_west, left_from_west, to_west] = [opens(0), opens(1), opens(3)];
        let without = Shown::Green(to_west.iter().position(|opens| !opens).unwrap());
        let barred = [0, 1, 2, 3].map(|green| (from_west[green] || left_from_west[green]) && !to_west[green]);
        assert!(barred.contains(&true) && barred.contains(&false));
        assert_eq!(left(3, 0.0, without, ALL), barred.map(|bars| !bars));
        assert_eq!(left(3, 0.2, without, ALL), ALL, "it drives");
        assert_eq!(left(2, 0.0, without, ALL), ALL, "nobody crosses its way");
        let with = Shown::Green(to_west.iter().position(|&opens| opens).unwrap());
        assert_eq!(left(3, 0.0, with, ALL), ALL, "it has green");
        assert_eq!(left(3, 0.0, without, barred), barred, "no other green is left");
    }
}
