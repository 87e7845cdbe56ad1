//! Where the workers of a run are: in processes of this machine, in this process, or on the other ranks of an MPI job that
//! `mpirun` or `srun` started.

use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

#[cfg(feature = "mpi")]
use anyhow::Context;
use anyhow::{anyhow, ensure};

use super::train::cores;
use crate::cli;
#[cfg(feature = "mpi")]
use crate::program::PROGRAM;
use dials_core::domain::Domain;
use dials_core::outside::Directory;
use dials_learn::observer::Observer;
#[cfg(feature = "mpi")]
use dials_session::build;
use dials_session::config::RunConfig;
use dials_session::error::{Error, Result};
use dials_session::fleet::children::Children;
use dials_session::fleet::{self, Coordinator, MostGrowth, Options};
#[cfg(feature = "mpi")]
use dials_session::fleet::{End, Job, Part, Prepared, Ranks, Relay};
#[cfg(feature = "mpi")]
use dials_session::machine::{end_now, leave_signals_to_another};
use dials_session::records::prepared::prepare;
#[cfg(feature = "mpi")]
use dials_session::records::{files, run_json::Versions};

pub(super) enum Team {
    /// Processes of this machine, or this process.
    Here,
    /// The other ranks, each with this number of workers. This is rank 0.
    #[cfg(feature = "mpi")]
    Ranks(Ranks, usize),
}

pub(super) struct Plan<'a> {
    pub domain: &'a Arc<dyn Domain>,
    pub config: &'a RunConfig,
    pub directory: &'a Directory,
    pub workers: usize,
    pub patience: Duration,
}

impl Team {
    /// Takes part in the MPI job, if any. A rank that is not 0 works here until the run has ended, and returns `None`.
    pub(super) fn join(args: &cli::TrainArgs) -> Result<Option<Team>> {
        let ranks = fleet::ranks();
        check_flags(args, ranks).map_err(Error::Usage)?;
        if ranks == 1 {
            return Ok(Some(Team::Here));
        }
        #[cfg(feature = "mpi")]
        return take_part(args);
        #[cfg(not(feature = "mpi"))]
        Err(Error::Usage(anyhow!(
            "{ranks} ranks were started, but this program was built without MPI, so each would train a run of its own; \
             build it with MPI: {}",
            crate::program::command_for_feature("mpi")
        )))
    }

    /// Returns the number of workers that was asked for, with the words that asked for it.
    pub(super) fn asked(&self, args: &cli::TrainArgs) -> Option<(usize, String)> {
        match self {
            Team::Here => args.workers.map(|workers| (workers, format!("--workers {workers}"))),
            #[cfg(feature = "mpi")]
            Team::Ranks(ranks, each) => {
                let relays = ranks.relays();
                Some((relays * each, format!("{relays} ranks with {each} workers each")))
            }
        }
    }

    pub(super) fn fleet(self, plan: &Plan, observer: Rc<dyn Observer>) -> anyhow::Result<Coordinator> {
        let Plan { domain, config, directory, workers, patience } = *plan;
        let (most_growth, prepared) = (MostGrowth::default(), prepare(&**domain, config, directory)?);
        match self {
            Team::Here if workers == 0 => fleet::in_process(domain.clone(), config.clone(), observer),
            Team::Here => {
                // The only worker of a learner outside still has all cores, for copies of the GS and AIPs.
                let threads = if config.learning.learns_outside() { cores() } else { workers };
                let options = Options { workers, threads, patience, most_growth, prepared };
                let crew = Box::new(Children(directory.clone()));
                Coordinator::start(domain.clone(), config, crew, options, observer)
            }
            #[cfg(feature = "mpi")]
            Team::Ranks(mut ranks, each) => {
                let config = prepare_ranks(&mut ranks, plan)?;
                let options = Options { workers, threads: each, patience, most_growth, prepared };
                Coordinator::start(domain.clone(), &config, Box::new(ranks), options, observer)
            }
        }
    }
}

/// Returns an error for a command that would do the same on every rank.
pub(super) fn check_alone(command: &str) -> Result<()> {
    match fleet::ranks() {
        1 => Ok(()),
        ranks => Err(Error::Usage(anyhow!("{command}: cannot be shared by {ranks} ranks: only train can"))),
    }
}

fn check_flags(args: &cli::TrainArgs, ranks: usize) -> anyhow::Result<()> {
    ensure!(
        ranks > 1 || args.workers_per_rank.is_none(),
        "--workers-per-rank: is for several ranks of mpirun or srun, and this process is alone; use --workers"
    );
    ensure!(
        ranks == 1 || args.workers.is_none(),
        "--workers: counts the workers of one machine, but {ranks} ranks were started; use --workers-per-rank"
    );
    Ok(())
}

#[cfg(feature = "mpi")]
fn take_part(args: &cli::TrainArgs) -> Result<Option<Team>> {
    match fleet::join_the_job().map_err(Error::Run)? {
        Part::Coordinator(ranks) => Ok(Some(Team::Ranks(ranks, args.workers_per_rank.unwrap_or(1)))),
        Part::Relay(relay) => serve(relay).map(|()| None),
    }
}

#[cfg(feature = "mpi")]
fn serve(relay: Relay) -> Result<()> {
    // mpirun and srun pass Ctrl-C on to all ranks. Rank 0 stops the run where nothing is lost.
    leave_signals_to_another().map_err(Error::Run)?;
    let describe = |config_json: &str| {
        let config: RunConfig = serde_json::from_str(config_json)?;
        Ok(serde_json::to_string(&build::here(PROGRAM, &config)?)?)
    };
    match relay.serve(describe) {
        End::Ordered => Ok(()),
        // Rank 0 has said why, if it could. MPI has no way out for a single rank.
        End::Orphaned => end_now(1),
    }
}

/// Prepares the ranks for a run. Returns the config that their workers need.
#[cfg(feature = "mpi")]
fn prepare_ranks(ranks: &mut Ranks, plan: &Plan) -> anyhow::Result<RunConfig> {
    let Plan { domain, config, directory, workers, patience } = *plan;
    let here = build::here(PROGRAM, config)?;
    let agents = fleet::agents_of_workers(&config.learning, domain.agents(), workers);
    let (prepared, config) = ranks.prepare(Job { config, directory, networks: files::NETWORKS, agents, patience })?;
    prepared.iter().try_for_each(|rank| check_build(rank, &here))?;
    Ok(config)
}

/// Returns an error if a rank would compute other numbers than rank 0.
#[cfg(feature = "mpi")]
fn check_build(rank: &Prepared, here: &Versions) -> anyhow::Result<()> {
    let there: Versions = serde_json::from_str(&rank.build).context("a rank has described its build wrongly")?;
    let differences = here.differences(&there);
    ensure!(
        differences.is_empty(),
        "rank {} on {}: computes other numbers than rank 0:\n  {}\n  start all ranks with the same program on \
         machines of the same kind; numerics.vector_width = \"256-bit\" makes x86-64 machines alike",
        rank.rank,
        rank.host,
        differences.join("\n  ")
    );
    Ok(())
}
