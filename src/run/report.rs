//! `report`: writes the figures and tables of run directories.

use std::fs;
use std::path::Path;

use anyhow::Context;

use super::places::{self, Existing};
use crate::cli;
use crate::error::{Error, Result};
use crate::outside::Printable;
use crate::report::{self, MARKDOWN, PAGE};
use crate::terminal::{answer, quoted, tell};

pub fn report(args: &cli::ReportArgs) -> Result<()> {
    let existing = if args.force { Existing::MoveAside } else { Existing::Refuse };
    let out = places::place(&args.out, existing).map_err(Error::Usage)?;
    let report = report::report(&args.folders).map_err(Error::Usage)?;
    places::make(&out, existing, |dir| report.files.iter().try_for_each(|(name, text)| write(&dir.join(name), text)))
        .map_err(Error::Usage)?;
    report.warnings.iter().for_each(|warning| tell(format_args!("warning: {}", Printable(warning))));
    let (page, markdown) = (out.join(PAGE), out.join(MARKDOWN));
    let (runs, groups) = (report.runs, report.groups);
    let told = format!("{runs} runs in {groups} groups; open {} or read {}", quoted(&page), quoted(&markdown));
    answer(told).map_err(Error::Run)
}

fn write(path: &Path, text: &str) -> anyhow::Result<()> {
    fs::write(path, text).with_context(|| format!("{}: cannot be written", path.display()))
}
