//! `doctor`: what is installed here, what is missing, and the command that cures it.
//!
//! - `finding`: one line of the answer. `parts`: libraries, programs and limits. `trial`: a short training of each
//!   domain.

mod finding;
mod parts;
mod trial;

use anyhow::anyhow;

use dials_core::base::counted;
use dials_session::error::{Error, Result};
use dials_session::terminal::answer;
use finding::{Finding, State};

pub(super) fn doctor() -> Result<()> {
    let mut findings = parts::find();
    findings.extend(trial::find());
    let lines: Vec<String> = findings.iter().map(Finding::to_string).collect();
    answer(lines.join("\n")).map_err(Error::Run)?;
    let count = |state| findings.iter().filter(|finding| finding.state == state).count();
    let errors = count(State::Error);
    if errors > 0 {
        return Err(Error::Run(anyhow!("training cannot work here: {}; see `cure:` above", counted(errors, "error"))));
    }
    let missing = match count(State::Missing) {
        0 => String::new(),
        1 => "; one part is missing, which some commands need".to_owned(),
        missing => format!("; {missing} parts are missing, which some commands need"),
    };
    answer(format_args!("\ntraining works here{missing}")).map_err(Error::Run)
}
