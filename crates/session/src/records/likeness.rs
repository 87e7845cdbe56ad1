//! Local simulators beside the global one (GS), as the files of a run have them.

use anyhow::Result;

use super::columns::{self, ALL};
use super::csv_table::{CsvTable, TableLine};

/// What the global simulator (GS) and the local ones show of the same lights: the GS in an evaluation, the local ones in
/// the training before it. Pairs are of the GS, then of the local ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LikenessRecord {
    /// Steps of the evaluation.
    pub(crate) steps: u64,
    /// Mean number of cars on the approaches of a light.
    pub cars: [f64; 2],
    /// Mean speed of these cars in metres per second.
    pub speed_mps: [f64; 2],
}

/// Reads what the GS showed in each evaluation beside what the local simulators showed since the one before it.
/// `training`: `training.csv`.
pub(super) fn read(returns: &CsvTable, training: &CsvTable) -> Result<Vec<LikenessRecord>> {
    let of_all = |line: &TableLine| line.text(columns::AGENT) == Some(ALL);
    let mut counted = Vec::new();
    for line in training.lines().filter(of_all) {
        let Some(decisions) = line.whole(columns::LOCAL_DECISIONS)? else { continue };
        let [cars, speed_mmps] = [columns::LOCAL_CARS, columns::LOCAL_SPEED_MMPS].map(|name| line.required_whole(name));
        counted.push((line.steps()?, [decisions, cars?, speed_mmps?]));
    }
    let (mut found, mut before) = (Vec::new(), 0);
    for line in returns.lines().filter(of_all) {
        let steps = line.steps()?;
        let since = counted.iter().filter(|(end, _)| (before + 1..=steps).contains(end));
        let [decisions, cars, speed_mmps] =
            since.fold([0.0; 3], |sums, (_, counts)| std::array::from_fn(|place| sums[place] + counts[place] as f64));
        before = steps;
        let [gs_cars, gs_speed] = [columns::CARS_PER_LIGHT, columns::MEAN_SPEED_MPS].map(|name| line.number(name));
        if let (Some(gs_cars), Some(gs_speed)) = (gs_cars?, gs_speed?)
            && cars > 0.0
        {
            let (cars, speed_mps) = ([gs_cars, cars / decisions], [gs_speed, speed_mmps / 1000.0 / cars]);
            found.push(LikenessRecord { steps, cars, speed_mps });
        }
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_evaluation_is_compared_with_all_periods_since_the_one_before() {
        let returns = CsvTable::of(
            "steps,agent,mean_speed_mps,cars_per_light\n0,all,9,2\n0,0,,\n20,all,8,4\n20,0,,\n30,all,5,10\n30,0,,\n",
        );
        let training = CsvTable::of(
            "steps,agent,local_decisions,local_cars,local_speed_mmps\n10,all,100,300,3000000\n10,0,,,\n\
             20,all,100,500,1000000\n20,0,,,\n30,all,0,0,0\n30,0,,,\n",
        );
        // 800 cars at 200 decisions, at 4 000 000 / 1000 / 800 m/s. Then the roads of no row were filled.
        let expected = LikenessRecord { steps: 20, cars: [4.0, 4.0], speed_mps: [8.0, 5.0] };
        assert_eq!(read(&returns, &training).unwrap(), [expected]);
    }

    #[test]
    fn a_run_that_counts_nothing_has_nothing_to_compare() {
        let returns = CsvTable::of("steps,agent,mean_speed_mps\n0,all,9\n10,all,9\n");
        let training = CsvTable::of("steps,agent,sampled_arrivals\n10,all,7\n");
        assert_eq!(read(&returns, &training).unwrap(), []);
    }
}
