//! What a worker may say, whatever its step is: a worker that says what cannot be right is lost, like one that dies. The
//! replies are checked by their [`Step`](dials_learn::steps::Step).

use std::time::Duration;

use anyhow::{Result, bail, ensure};

use super::message::WorkerReport;
use dials_learn::fleet::WorkerLoad;

/// Longest time that a worker may report, about ten years.
const LONGEST: Duration = Duration::from_secs(10 * 365 * 24 * 3600);
/// Largest memory that a worker may report.
const LARGEST_KIB: u64 = 1 << 50;

/// Returns an error if a report cannot be right. `most_steps`: up to which timestep its step may train; `None` if it does
/// not train.
pub(super) fn check_report(report: &WorkerReport, most_steps: Option<u64>) -> Result<()> {
    match report {
        WorkerReport::Begun | WorkerReport::Failed { .. } => Ok(()),
        WorkerReport::Trained { steps } => {
            let Some(most) = most_steps else { bail!("it trained without an order to") };
            ensure!(*steps <= most, "it trained for {steps} steps, of at most {most}");
            Ok(())
        }
        WorkerReport::Busy { share, .. } => {
            ensure!((0.0..1.01).contains(share), "it has done {share} of its work");
            Ok(())
        }
        WorkerReport::Done { load, .. } => check_load(load),
    }
}

fn check_load(load: &WorkerLoad) -> Result<()> {
    let WorkerLoad { timesheet, footprint } = load;
    ensure!(timesheet.longest() <= LONGEST, "it worked for {:?}", timesheet.longest());
    let largest = footprint.peak_rss_kib.max(footprint.pss_kib);
    ensure!(largest <= LARGEST_KIB, "it uses {largest} KiB of memory");
    Ok(())
}
