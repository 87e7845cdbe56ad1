//! `train`

use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::Arc;

use clap::ValueEnum;

use super::directory::RunDirectory;
use super::progress::Progress;
use crate::base::AgentId;
use crate::cli;
use crate::config::{Config, SimulatorKind, load};
use crate::domain::Domain;
use crate::error::{Error, Result};
use crate::traffic::Traffic;
use crate::training::dials;
use crate::training::fleet::InlineFleet;
use crate::training::run_log::{Layouts, RunLog};
use crate::training::worker::{initial_aips, initial_policies};

pub fn train(args: &cli::Train) -> Result<()> {
    let config = load(&args.config, &settings(args)).map_err(Error::Usage)?;
    let traffic = Arc::new(Traffic::open(&config.traffic, &config.policy).map_err(Error::Usage)?);
    let dir = match &args.out {
        Some(dir) if args.force => RunDirectory::replace(dir),
        Some(dir) => RunDirectory::create(dir),
        None => RunDirectory::create_numbered(&default_dir(&args.config, &config)),
    };
    let dir = dir.map_err(Error::Usage)?;
    dir.describe(&config, traffic.networks()).map_err(Error::Usage)?;
    train_into(&dir, traffic, &config).map_err(Error::Run)?;
    say_how_to_go_on(dir.path(), &args.config, &config);
    Ok(())
}

fn train_into(dir: &RunDirectory, domain: Arc<Traffic>, config: &Config) -> anyhow::Result<()> {
    let everybody = AgentId::all(domain.agents());
    let layouts = Layouts {
        policies: initial_policies(&*domain, config, &everybody).into_parameters(),
        aips: initial_aips(&*domain, config, &everybody).into_parameters(),
    };
    let progress = Rc::new(Progress::new(config, everybody.len()));
    let mut fleet = InlineFleet::new(domain, config, progress.clone());
    let mut log = RunLog::new(dir.path(), layouts, progress.clone());
    dials::train(config, &mut fleet, &mut log)?;
    progress.finish();
    Ok(())
}

/// The flags that stand for keys of the config, as settings of these keys.
fn settings(args: &cli::Train) -> Vec<String> {
    let mut settings = args.settings.clone();
    settings.extend(args.seed.map(|seed| format!("seed={seed}")));
    settings.extend(args.steps.map(|steps| format!("stop_at_steps={steps}")));
    settings.extend(
        args.simulator.and_then(|kind| kind.to_possible_value()).map(|kind| format!("simulator={}", kind.get_name())),
    );
    settings
}

fn default_dir(config_path: &Path, config: &Config) -> PathBuf {
    let name = config_path.file_stem().unwrap_or_default().to_string_lossy();
    let simulator = match config.simulator {
        SimulatorKind::Dials => "dials",
        SimulatorKind::Gs => "gs",
        SimulatorKind::UntrainedDials => "untrained-dials",
    };
    Path::new("runs").join(format!("{name}-{simulator}-seed{}", config.seed))
}

fn say_how_to_go_on(dir: &Path, config_path: &Path, config: &Config) {
    let (dir, config_path) = (dir.display(), config_path.display());
    let (episodes, seed) = (config.evaluation.episodes, config.seed);
    println!("\nwritten to {dir}; evaluate it with:");
    println!("  dials-traffic evaluate {dir} --episodes {episodes} --seed {seed}");
    println!("and compare on the same traffic with:");
    println!("  dials-traffic baseline {config_path} --controller actuated --episodes {episodes} --seed {seed}");
}
