//! `report`: writes the figures and tables of run directories.

use crate::cli;
use dials_core::base::{counted, for_terminal};
use dials_core::outside::{Directory, Printable, quoted};
use dials_report::{MARKDOWN, PAGE};
use dials_session::error::{Error, Result};
use dials_session::outputs::check_not_a_run;
use dials_session::places::{self, Existing};
use dials_session::terminal::{answer, warn};

pub(super) fn report(args: &cli::ReportArgs) -> Result<()> {
    let existing = Existing::of_named(args.force);
    check_not_a_run("--out", &args.out).map_err(Error::Usage)?;
    let out = places::place(&args.out, existing).map_err(Error::Usage)?;
    let report = dials_report::report(&args.folders, args.title.as_deref()).map_err(Error::Usage)?;
    let write = |dir: &Directory| report.files.iter().try_for_each(|(name, text)| dir.put(name, text.as_bytes()));
    places::make(&out, existing, write).map_err(Error::Usage)?;
    report.warnings.iter().for_each(|warning| warn(for_terminal(&format!("warning: {}", Printable(warning)))));
    let (page, markdown) = (out.join(PAGE), out.join(MARKDOWN));
    let (runs, groups) = (report.runs, report.groups);
    let of_runs = (runs > 0).then(|| format!("{} in {}", counted(runs, "run"), counted(groups, "group")));
    let slides: Vec<String> = report.slides.iter().map(|name| quoted(&out.join(name))).collect();
    let of_cities = (!slides.is_empty()).then(|| format!("lights in {}", counted(slides.len(), "comparison")));
    let what = of_cities.into_iter().chain(of_runs).collect::<Vec<_>>().join(", ");
    let slides = match slides.len() {
        0 => String::new(),
        1 => format!("; {} is for a presentation", slides[0]),
        _ => format!("; {} are for presentations, in the order of the page", slides.join(" and ")),
    };
    let message = format!("{what}; open {} or read {}{slides}", quoted(&page), quoted(&markdown));
    answer(message).map_err(Error::Run)
}
