//! `report`: writes the figures and tables of run directories.

use crate::cli;
use dials_core::base::{counted, for_terminal};
use dials_core::outside::{Directory, Printable, quoted};
use dials_report::city::SLIDE;
use dials_report::{MARKDOWN, PAGE};
use dials_session::error::{Error, Result};
use dials_session::outputs::check_not_a_run;
use dials_session::places::{self, Existing};
use dials_session::terminal::{answer, warn};

pub(super) fn report(args: &cli::ReportArgs) -> Result<()> {
    let existing = Existing::of_named(args.force);
    check_not_a_run("--out", &args.out).map_err(Error::Usage)?;
    let out = places::place(&args.out, existing).map_err(Error::Usage)?;
    let report = dials_report::report(&args.folders).map_err(Error::Usage)?;
    let write = |dir: &Directory| report.files.iter().try_for_each(|(name, text)| dir.put(name, text.as_bytes()));
    places::make(&out, existing, write).map_err(Error::Usage)?;
    report.warnings.iter().for_each(|warning| warn(for_terminal(&format!("warning: {}", Printable(warning)))));
    let (page, markdown) = (out.join(PAGE), out.join(MARKDOWN));
    let (runs, groups) = (report.runs, report.groups);
    let of_runs = (runs > 0).then(|| format!("{} in {}", counted(runs, "run"), counted(groups, "group")));
    let of_cities = (report.cities > 0).then(|| format!("lights in {}", counted(report.cities, "comparison")));
    let what = of_cities.into_iter().chain(of_runs).collect::<Vec<_>>().join(", ");
    let has_slide = report.files.iter().any(|(name, _)| name == SLIDE);
    let slide = if has_slide { format!("; {} is for a presentation", quoted(&out.join(SLIDE))) } else { String::new() };
    let message = format!("{what}; open {} or read {}{slide}", quoted(&page), quoted(&markdown));
    answer(message).map_err(Error::Run)
}
