//! `bench`: measures how fast a config trains, with several numbers of workers.

use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, anyhow};
use serde_json::json;

use super::train::{cores, settings_with};
use crate::program::{PROGRAM, command_for_feature};
use crate::{cli, libtorch};
use dials_core::base::counted;
use dials_core::domain::Domain;
use dials_core::outside::{Directory, temporary_dir};
use dials_learn::config::Predictor;
use dials_learn::observer::Interrupted;
use dials_session::bench::costs::{Costs, Steps};
use dials_session::bench::measure::{MeasurePlan, expected, measure, short_orders};
use dials_session::bench::table;
use dials_session::build;
use dials_session::config::{RunConfig, load};
use dials_session::domains;
use dials_session::error::{Error, Result};
use dials_session::fleet::children::{Children, FILES_PER_WORKER};
use dials_session::fleet::{Coordinator, MostGrowth, Options};
use dials_session::machine::allow_open_files;
use dials_session::records::checkpoint::owner::Owner;
use dials_session::records::networks::Layouts;
use dials_session::records::prepared::prepare;
use dials_session::records::run_log::RunLog;
use dials_session::terminal::training::BenchProgress;
use dials_session::terminal::{answer, json as in_json, note, warn};
use stacknets::peak;

/// Time for measuring matrix products at peak speed, of each kind.
const PEAK_TIME: Duration = Duration::from_millis(500);
const PATIENCE: Duration = Duration::from_secs(600);

/// Peak speed of matrix products on one core, in floating-point operations per second.
#[derive(Clone, Copy)]
struct Peak {
    ours: f64,
    /// Speed of libtorch, which most software of this kind uses; `None` in a build without it.
    libtorch: Option<f64>,
}

pub(super) fn bench(args: &cli::BenchArgs) -> Result<()> {
    let config =
        load(&args.config, &settings_with(&args.settings.all(), args.simulator.as_deref())).map_err(Error::Usage)?;
    if config.learning.predictor_in_use() == Some(Predictor::Marginals) {
        let reason = "marginal-dials costs the same as dials without the training of AIPs; measure dials instead";
        return Err(Error::Usage(anyhow!("{}: {reason}", args.config.display())));
    }
    let domain = domains::open_untried(&config).map_err(Error::Usage)?;
    domains::check_for_training(&config, &*domain).map_err(Error::Usage)?;
    let most = args.workers.unwrap_or_else(cores);
    allow_open_files(most, FILES_PER_WORKER, "--workers").map_err(Error::Usage)?;
    let progress = Rc::new(BenchProgress::new().map_err(Error::Run)?);
    let time = Duration::from_secs(args.seconds);
    let of_fleet = |workers| expected(&config, domain.agents(), &domain.rough_costs(), workers, time);
    let whole: Duration = doubling(most).into_iter().map(of_fleet).sum();
    note(format_args!(
        "measuring {} for about {} s each; the whole takes about {:.0} s",
        counted(doubling(most).len(), "fleet"),
        args.seconds,
        (2 * PEAK_TIME + whole).as_secs_f64().ceil()
    ));
    let peak = Peak { ours: peak(PEAK_TIME), libtorch: libtorch::peak(PEAK_TIME).map_err(Error::Run)? };
    let mut costs = Vec::new();
    let mut interrupted = false;
    for workers in doubling(most) {
        progress.begin(workers, most);
        match run(&config, &domain, workers, time, peak.ours, &progress) {
            Ok(of_fleet) => costs.push(of_fleet),
            Err(error) if error.is::<Interrupted>() => {
                interrupted = true;
                break;
            }
            Err(error) => return Err(Error::Run(error)),
        }
    }
    progress.finish();
    if !costs.is_empty() {
        let found = match args.json {
            true => as_json(args, &config, &*domain, peak, &costs).map_err(Error::Run)?,
            false => as_text(args, &config, &*domain, peak, &costs),
        };
        answer(found).map_err(Error::Run)?;
    }
    if interrupted {
        return Err(Error::Interrupted("stopped".to_owned()));
    }
    Ok(())
}

fn run(
    config: &RunConfig,
    domain: &Arc<dyn Domain>,
    workers: usize,
    time: Duration,
    peak_flops: f64,
    progress: &Rc<BenchProgress>,
) -> anyhow::Result<Costs> {
    let short = short_orders(config, workers);
    let dir = temporary_dir().context("the files of the measured run have no place")?;
    let directory = Directory::lock(dir.path())?;
    let crew = Children(directory.clone());
    let prepared = prepare(&**domain, config, &directory)?;
    let options =
        Options { workers, threads: workers, patience: PATIENCE, most_growth: MostGrowth::default(), prepared };
    let mut log =
        RunLog::begin(directory, Owner::of(config, &**domain)?, Layouts::of(&config.learning, domain.kinds()));
    let mut fleet = Coordinator::start(domain.clone(), &short, Box::new(crew), options, progress.clone())?;
    let plan = MeasurePlan { config: &short, kinds: domain.kinds(), workers, time, peak_flops };
    let measured = measure(&plan, &mut fleet, &mut log)?;
    let share = measured.share_of_an_episode(config, domain.agents());
    if share < 1.0 {
        warn(format_args!(
            "warning: {workers} workers: only {:.0} % of an episode was simulated, and episodes begin empty; a larger \
             --seconds gives a better estimate of a whole run",
            100.0 * share
        ));
    }
    let steps =
        Steps { foreign: domain.foreign_simulator().is_some(), per_timestep: domain.simulator_steps_per_timestep() };
    Ok(Costs::of(config, domain.kinds(), steps, peak_flops, &measured))
}

/// Returns 1, 2, 4, ... and `most`.
fn doubling(most: usize) -> Vec<usize> {
    let powers = std::iter::successors(Some(1), |workers| Some(workers * 2)).take_while(|&workers| workers < most);
    powers.chain([most]).collect()
}

fn as_text(args: &cli::BenchArgs, config: &RunConfig, domain: &dyn Domain, peak: Peak, costs: &[Costs]) -> String {
    format!(
        "{}: {}, {} timesteps each; about {} s per column\n\
         one core: {:.0} GFLOP/s in matrix products at peak (1024 x 1024 x 1024, f32{}\n\n{}",
        args.config.display(),
        counted(domain.agents(), "agent"),
        config.learning.last_step(),
        args.seconds,
        peak.ours / 1e9,
        by_libtorch(peak),
        table::text(costs)
    )
}

/// Returns the end of the line of speeds: that of libtorch, or how to get a build that can measure it.
fn by_libtorch(peak: Peak) -> String {
    match peak.libtorch {
        Some(libtorch) => format!("; by libtorch {:.0})", libtorch / 1e9),
        None => format!(
            ")\nlibtorch's speed is not measured: this program was built without it; build it with libtorch: {}",
            command_for_feature("torch")
        ),
    }
}

fn as_json(
    args: &cli::BenchArgs,
    config: &RunConfig,
    domain: &dyn Domain,
    peak: Peak,
    costs: &[Costs],
) -> anyhow::Result<String> {
    let object = json!({
        "config": dials_core::outside::path_as_text(&args.config),
        "simulator": config.learning.short_form().name,
        "agents": domain.agents(),
        "timesteps_per_agent": config.learning.last_step(),
        "seconds_per_fleet": args.seconds,
        "cores": cores(),
        "peak_gflops_of_a_core": peak.ours / 1e9,
        "peak_gflops_by_libtorch": peak.libtorch.map(|libtorch| libtorch / 1e9),
        "versions": build::here(PROGRAM, config)?,
        "fleets": table::json(costs),
    });
    Ok(in_json(object))
}
