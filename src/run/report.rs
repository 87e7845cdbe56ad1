//! `report`: writes the figures and tables of run directories.

use super::outputs::check_not_a_run;
use super::places::{self, Existing};
use crate::base::{counted, for_terminal};
use crate::cli;
use crate::error::{Error, Result};
use crate::outside::{Directory, Printable, quoted};
use crate::report::{self, MARKDOWN, PAGE};
use crate::terminal::{answer, warn};

pub fn report(args: &cli::ReportArgs) -> Result<()> {
    let existing = Existing::of_named(args.force);
    check_not_a_run("--out", &args.out).map_err(Error::Usage)?;
    let out = places::place(&args.out, existing).map_err(Error::Usage)?;
    let report = report::report(&args.folders).map_err(Error::Usage)?;
    let write = |dir: &Directory| report.files.iter().try_for_each(|(name, text)| dir.put(name, text.as_bytes()));
    places::make(&out, existing, write).map_err(Error::Usage)?;
    report.warnings.iter().for_each(|warning| warn(for_terminal(&format!("warning: {}", Printable(warning)))));
    let (page, markdown) = (out.join(PAGE), out.join(MARKDOWN));
    let (runs, groups) = (report.runs, report.groups);
    let (runs, groups) = (counted(runs, "run"), counted(groups, "group"));
    let told = format!("{runs} in {groups}; open {} or read {}", quoted(&page), quoted(&markdown));
    answer(told).map_err(Error::Run)
}
