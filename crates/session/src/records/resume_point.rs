//! Where a run goes on: at the newest checkpoint whose files are all still what they were when it was written.

use anyhow::Result;

use super::checkpoint::owner::Owner;
use super::checkpoint::{self, Checkpoint};
use super::columns;
use super::csv_table::CsvTable;
use super::files;
use super::growing::{Mark, misfit};
use dials_core::outside::{Directory, sweep};

pub struct ResumePoint {
    /// `None`: there is no checkpoint, so the run begins again.
    pub checkpoint: Option<Checkpoint>,
    /// Names of the checkpoints after it, which no longer fit the files.
    pub(crate) newer: Vec<String>,
    /// Line for the user, if something was lost.
    pub warning: Option<String>,
}

/// The error if no checkpoint fits the files, or there is none. It names the first file that differs.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct NothingFits(String);

impl ResumePoint {
    /// Prepares a run directory, which this process has locked, for writing. Then finds where its run goes on.
    /// What is not a file of the run itself, such as a link, is an error. What killed writes left behind is removed.
    pub fn find(directory: &Directory, owner: &Owner) -> Result<ResumePoint> {
        files::WRITTEN.iter().chain(&files::GROWING).try_for_each(|name| directory.check(name))?;
        sweep(directory.path())?;
        let Some(folder) = directory.subdirectory(files::CHECKPOINTS)? else {
            return ResumePoint::beginning(directory, owner);
        };
        sweep(folder.path())?;
        let names = checkpoint::list(&folder)?;
        let (mut newer, mut first_misfit) = (Vec::new(), None);
        for name in names.iter().rev() {
            let checkpoint = Checkpoint::read(&folder, name, owner)?;
            if let Some(misfit) = misfit_of(directory, &checkpoint)? {
                first_misfit.get_or_insert(misfit);
                newer.push(name.clone());
                continue;
            }
            if newer.is_empty() {
                checkpoint::remove_old(&folder)?;
            }
            let steps = checkpoint.agents.steps;
            let warning = first_misfit.map(|misfit| {
                format!("warning: {misfit}; the run goes on from step {steps}, and trains again from there")
            });
            return Ok(ResumePoint { checkpoint: Some(checkpoint), newer, warning });
        }
        match first_misfit {
            Some(misfit) => Err(NothingFits(format!(
                "{misfit}; none of the {} checkpoints fits the files, so the run cannot be resumed",
                names.len()
            ))
            .into()),
            None => ResumePoint::beginning(directory, owner),
        }
    }

    fn beginning(directory: &Directory, owner: &Owner) -> Result<ResumePoint> {
        owner.check_described(directory.path())?;
        let path = directory.path().display();
        // In its first period a run has one evaluation at most, and no line of training but of this period.
        for file in [files::RETURNS, files::TRAINING] {
            if blocks_in(directory, file)? > 1 {
                let what = "has results, but no checkpoint any more, so it cannot be resumed";
                return Err(NothingFits(format!("{path}: {what}")).into());
            }
        }
        // The policies are written shortly before the first checkpoint.
        let trained = directory.open_file(files::POLICIES)?.is_some();
        let warning =
            trained.then(|| format!("warning: {path}: has no checkpoint, so the run begins again from step 0"));
        Ok(ResumePoint { checkpoint: None, newer: Vec::new(), warning })
    }

    /// Returns how far a growing file had come.
    pub(crate) fn mark(&self, file: &str) -> Mark {
        self.checkpoint.as_ref().map_or(Mark::default(), |checkpoint| mark_in(checkpoint, file))
    }
}

/// Returns of how many numbers of timesteps a CSV file of the run has lines.
fn blocks_in(directory: &Directory, file: &str) -> Result<usize> {
    let table = CsvTable::read(&directory.path_of(file))?;
    let mut steps: Vec<_> = table.lines().map(|line| line.text(columns::STEPS)).collect();
    steps.dedup();
    Ok(steps.len())
}

fn mark_in(checkpoint: &Checkpoint, file: &str) -> Mark {
    checkpoint.progress.growing.get(file).copied().unwrap_or_default()
}

/// Says which file differs first from what a checkpoint says, and how. `None`: all fit.
fn misfit_of(directory: &Directory, checkpoint: &Checkpoint) -> Result<Option<String>> {
    for name in files::GROWING {
        if let Some(what) = misfit(directory, name, mark_in(checkpoint, name))? {
            let path = directory.path_of(name);
            let steps = checkpoint.agents.steps;
            return Ok(Some(format!("{}: {what} since the checkpoint of step {steps}", path.display())));
        }
    }
    Ok(None)
}
