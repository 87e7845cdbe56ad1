//! The launcher that started this process as one of several ranks: `mpirun` or Slurm's `srun`.

use std::env;

/// Variables with the number of ranks: of Open MPI's `mpirun`, and of MPICH's `mpiexec` and Slurm's PMI-2.
const SIZES: [&str; 2] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"];
/// Variables of `srun --mpi=pmix`: the rank of this process, and the number of ranks.
const PMIX: [&str; 2] = ["PMIX_RANK", "SLURM_STEP_NUM_TASKS"];

/// Returns the number of ranks of the MPI job that this process belongs to. A process without a launcher: 1.
pub fn ranks() -> usize {
    ranks_in(|name| env::var(name).ok())
}

fn ranks_in(variable: impl Fn(&str) -> Option<String>) -> usize {
    let number = |name: &str| variable(name)?.parse().ok();
    let [rank, size] = PMIX;
    let by_pmix = || variable(rank).and_then(|_| number(size));
    SIZES.into_iter().find_map(number).or_else(by_pmix).unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn every_launcher_says_how_many_ranks_it_starts_and_without_one_a_process_is_alone() {
        for (variables, ranks) in [
            (&[("OMPI_COMM_WORLD_SIZE", "9")][..], 9),
            (&[("PMI_SIZE", "4"), ("PMI_RANK", "0")], 4),
            (&[("PMIX_RANK", "2"), ("SLURM_STEP_NUM_TASKS", "3")], 3),
            (&[], 1),
            // Inside a Slurm job, but not started by srun.
            (&[("SLURM_STEP_NUM_TASKS", "3")], 1),
        ] {
            let variables = BTreeMap::from_iter(variables.iter().copied());
            assert_eq!(ranks_in(|name| variables.get(name).map(|&text| text.to_owned())), ranks, "{variables:?}");
        }
    }
}
