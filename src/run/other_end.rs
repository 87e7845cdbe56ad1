//! The end of a resumed run: `train --resume RUN --steps N` gives it another one.

use std::path::Path;

use anyhow::{Result, ensure};

use dials_core::outside::{Directory, quoted, read_text};
use dials_learn::config::rest_of_schedule;
use dials_session::config::resume::with_end;
use dials_session::config::{LARGEST_FILE as LARGEST_CONFIG, RunConfig, load};
use dials_session::records::files;
use dials_session::records::resume_point::ResumePoint;
use dials_session::records::run_record::{EvaluationRecord, RunRecord};
use dials_session::terminal::{note, program};

/// Makes the run end at step `steps`, by its config. Returns the text of the config before.
pub(super) fn end_at(directory: &Directory, steps: u64) -> Result<String> {
    let path = directory.path().join(files::CONFIG);
    let config = load(&path, &[])?;
    ensure!(
        steps <= config.learning.total_steps,
        "--steps {steps}: this run can go to step {0} only, because its learning rate and clip range have decayed to \
         nothing there (total_steps = {0}); for a longer one begin a new run with --set total_steps={steps}",
        config.learning.total_steps
    );
    let text = read_text(&path, LARGEST_CONFIG)?;
    directory.write(files::CONFIG, with_end(&text, steps).as_bytes())?;
    Ok(text)
}

/// Returns whether nothing is left to do, and then says how to train further.
pub(super) fn has_ended(directory: &Directory, config: &RunConfig, point: &ResumePoint) -> bool {
    let Some(checkpoint) = &point.checkpoint else { return false };
    let dir = directory.path();
    let (steps, until) = (checkpoint.agents.steps, checkpoint.progress.standing.until);
    let is_final = |last: &EvaluationRecord| last.episode_returns.len() == config.learning.evaluation.final_episodes;
    let all_is_there = |run: RunRecord| run.evaluation_at(steps).is_some_and(is_final) && run.is_whole();
    if !rest_of_schedule(&config.learning, until).is_empty() || !RunRecord::read(dir).is_ok_and(all_is_there) {
        return false;
    }
    let further = if steps < config.learning.total_steps {
        format!(
            "train it further with: {} train --resume {} --steps {}",
            program(),
            quoted(dir),
            config.learning.total_steps
        )
    } else {
        "for a longer one begin a new run with a larger total_steps".to_owned()
    };
    note(format_args!("note: this run has ended, at step {steps}\n  {further}"));
    true
}

/// Says so if the resumed run loses an evaluation: that of an earlier end at which the longer run is not evaluated. The
/// files of a resumed run are those of a run that was never stopped.
pub(super) fn tell_of_lost_evaluation(dir: &Path, config: &RunConfig, point: &ResumePoint) {
    let Some(checkpoint) = &point.checkpoint else { return };
    let (steps, standing) = (checkpoint.agents.steps, &checkpoint.progress.standing);
    let rest = rest_of_schedule(&config.learning, standing.until);
    // Without a rest the run ends here, with an evaluation.
    let comes_again = rest.first().is_none_or(|next| next.evaluate) || standing.evaluated_at == Some(steps);
    let was_evaluated = || RunRecord::read(dir).is_ok_and(|run| run.evaluation_at(steps).is_some());
    if !comes_again && was_evaluated() {
        note(format_args!(
            "note: {} loses the evaluation at step {steps}, the earlier end of this run.\n  A run that goes on is not \
             evaluated there (evaluation.every_steps = {}).",
            files::RETURNS,
            config.learning.evaluation.every_steps
        ));
    }
}
