//! How many cars take each route, so that places are passed as often as counted.

/// Number of rounds. Counts that agree with each other are met to some tenths of a percent after far fewer.
const ROUNDS: usize = 500;

/// Returns a whole number of cars for each route. `passed`: places that each route passes. `counted`: cars at each place.
///
/// It begins with one car on every route, and multiplies the cars of all routes of a place by counted over made, place by place.
/// That comes to the most even numbers that fit, if there are any. Then it rounds: car by car as long as the squared errors,
/// divided by the counts, become smaller.
pub(super) fn fit(passed: &[Vec<usize>], counted: &[f64]) -> Vec<usize> {
    let mut through: Vec<Vec<usize>> = vec![Vec::new(); counted.len()];
    for (route, places) in passed.iter().enumerate() {
        places.iter().for_each(|&place| through[place].push(route));
    }
    // What passes no count is not known, so nobody drives there.
    let mut cars: Vec<f64> = passed.iter().map(|places| if places.is_empty() { 0.0 } else { 1.0 }).collect();
    for _ in 0..ROUNDS {
        for (routes, &counted) in through.iter().zip(counted) {
            let made: f64 = routes.iter().map(|&route| cars[route]).sum();
            if made > 0.0 {
                routes.iter().for_each(|&route| cars[route] *= counted / made);
            }
        }
    }
    let mut whole: Vec<usize> = cars.iter().map(|cars| cars.floor() as usize).collect();
    let mut made = vec![0.0; counted.len()];
    for (places, &cars) in passed.iter().zip(&whole) {
        places.iter().for_each(|&place| made[place] += cars as f64);
    }
    // The gain of one more car on a route, or of one fewer.
    let gain = |made: &[f64], route: usize, change: f64| -> f64 {
        let of_place = |&place: &usize| {
            let (missing, weight) = (counted[place] - made[place], 1.0 / counted[place].max(1.0));
            weight * (missing.powi(2) - (missing - change).powi(2))
        };
        passed[route].iter().map(of_place).sum()
    };
    let most = counted.iter().sum::<f64>() as usize + counted.len();
    for _ in 0..most {
        let more = (0..passed.len()).map(|route| (route, 1.0));
        let fewer = (0..passed.len()).filter(|&route| whole[route] > 0).map(|route| (route, -1.0));
        let rated = more.chain(fewer).map(|(route, change)| {
            // Of equal gains the route that lost most by rounding is first.
            let lost = (cars[route] - whole[route] as f64) * change;
            (gain(&made, route, change), lost, route, change)
        });
        let best = rated.max_by(|one, other| one.0.total_cmp(&other.0).then(one.1.total_cmp(&other.1)));
        let Some((_, _, route, change)) = best.filter(|(gain, ..)| *gain > 1e-9) else { break };
        whole[route] = if change > 0.0 { whole[route] + 1 } else { whole[route] - 1 };
        passed[route].iter().for_each(|&place| made[place] += change);
    }
    whole
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_that_agree_are_met_and_cars_are_spread_evenly() {
        // Two entries with 30 and 10 cars, two exits with 20 each: half of each entry goes to each exit.
        let passed = [vec![0, 2], vec![0, 3], vec![1, 2], vec![1, 3], vec![]];
        assert_eq!(fit(&passed, &[30.0, 10.0, 20.0, 20.0]), [15, 15, 5, 5, 0]);
        assert_eq!(fit(&[vec![0], vec![0], vec![0]], &[0.0]), [0, 0, 0]);
    }

    #[test]
    fn counts_that_contradict_each_other_are_missed_by_about_the_same() {
        // The only route passes both places.
        let [cars] = fit(&[vec![0, 1]], &[100.0, 120.0])[..] else { panic!("one route") };
        // (100 - n)^2 / 100 + (120 - n)^2 / 120 is least at n = 109.1.
        assert_eq!(cars, 109);
    }
}
