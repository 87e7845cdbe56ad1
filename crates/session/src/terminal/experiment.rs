//! The progress of `experiment`: a bar per running process and one for the whole. Without a terminal: plain lines.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget};

use super::training::plain_line;
use super::{duration, note, shows_bars, style};
use dials_core::outside::Printable;

/// Interval between plain lines about all running processes.
const PLAIN_LINES_EVERY: Duration = Duration::from_secs(60);
/// Length of the bar of a task that has no timesteps.
const NO_STEPS: u64 = 1;

pub struct Planned {
    pub name: String,
    /// Estimated time of the whole task.
    pub seconds: f64,
    pub width: usize,
    /// Share that was done earlier, from 0 to 1.
    pub share: f64,
    /// Timesteps per agent of the whole run; 0 for a baseline.
    pub steps: u64,
}

pub struct Display {
    bars: MultiProgress,
    whole: ProgressBar,
    begun: Instant,
    last_plain: Instant,
    /// State of each task, by name. Running tasks have a bar.
    tasks: BTreeMap<String, State>,
}

struct State {
    planned: Planned,
    /// Share of the task that is done now.
    share: f64,
    /// Whether it ended, well or with an error. Then nothing of it is left.
    ended: bool,
    bar: Option<ProgressBar>,
}

impl Display {
    pub fn new(tasks: Vec<Planned>) -> Self {
        let target = if shows_bars() { ProgressDrawTarget::stderr() } else { ProgressDrawTarget::hidden() };
        let bars = MultiProgress::with_draw_target(target);
        let style = style("{bar:8.green/blue} {pos} of {len} done  {wide_msg}");
        let whole = bars.add(ProgressBar::new(tasks.len() as u64).with_style(style));
        whole.set_position(0);
        let state =
            |planned: Planned| (planned.name.clone(), State { share: planned.share, planned, ended: false, bar: None });
        let tasks = tasks.into_iter().map(state).collect();
        let now = Instant::now();
        Display { bars, whole, begun: now, last_plain: now, tasks }
    }

    pub fn say(&self, line: &str) {
        self.bars.suspend(|| note(line));
    }

    pub fn began(&mut self, task: &str) {
        let Some(state) = self.tasks.get_mut(task) else { return };
        let style = style("{bar:8.cyan/blue} {percent:>3} %  {prefix}  {wide_msg}");
        let bar = ProgressBar::new(state.planned.steps.max(NO_STEPS)).with_style(style);
        let bar = self.bars.insert_before(&self.whole, bar).with_prefix(Printable(task).to_string());
        bar.set_message("running");
        bar.set_position((state.share * state.planned.steps as f64) as u64);
        if !shows_bars() {
            let resumed = if state.share > 0.0 { "resumed" } else { "began" };
            note(format_args!("{resumed} {task}"));
        }
        state.bar = Some(bar);
    }

    /// Updates the bar of a task from a line that its process printed on standard error.
    pub fn heard(&mut self, task: &str, line: &str) {
        let Some(state) = self.tasks.get_mut(task) else { return };
        if let (Some((steps, words)), Some(bar)) = (plain_line(line), &state.bar) {
            let steps = steps.min(state.planned.steps);
            state.share = steps as f64 / state.planned.steps.max(NO_STEPS) as f64;
            bar.set_position(steps);
            bar.set_message(Printable(words).to_string());
        }
    }

    /// Reports the end of a task. `why`: its error, if it failed.
    pub fn ended(&mut self, task: &str, why: Option<&str>) {
        let Some(state) = self.tasks.get_mut(task) else { return };
        let words = state.bar.take().map_or(String::new(), |bar| {
            let words = if state.planned.steps > 0 { format!(": {}", bar.message()) } else { String::new() };
            bar.finish_and_clear();
            self.bars.remove(&bar);
            words
        });
        state.ended = true;
        match why {
            None => {
                state.share = 1.0;
                self.whole.inc(1);
                self.say(&format!("finished {task}{words}"));
            }
            Some(why) => self.say(&format!("{task}: {why}")),
        }
    }

    pub fn tick(&mut self) {
        let left = self.left_per_done().map(|ratio| duration(self.begun.elapsed().mul_f64(ratio)));
        self.whole.set_message(left.as_ref().map_or(String::new(), |left| format!("about {left} left")));
        if !shows_bars() && self.last_plain.elapsed() >= PLAIN_LINES_EVERY {
            self.last_plain = Instant::now();
            for (name, state) in &self.tasks {
                if let Some(bar) = &state.bar {
                    note(format_args!("{name}: {:.0} %, {}", 100.0 * state.share, bar.message()));
                }
            }
            let left = left.map_or(String::new(), |left| format!(", about {left} left"));
            note(format_args!("{} of {} done{left}", self.whole.position(), self.tasks.len()));
        }
    }

    /// Returns how much is left for what was done since the beginning. Tasks are weighted by their core-seconds.
    fn left_per_done(&self) -> Option<f64> {
        let core_seconds = |state: &State| state.planned.seconds * state.planned.width as f64;
        let sum = |share: &dyn Fn(&State) -> f64| {
            self.tasks.values().map(|state| core_seconds(state) * share(state)).sum::<f64>()
        };
        let done = sum(&|state| state.share - state.planned.share);
        let left = sum(&|state| if state.ended { 0.0 } else { 1.0 - state.share });
        // Below one percent an estimate would be too rough.
        (done > 0.01 * (done + left)).then_some(left / done)
    }

    pub fn finish(&self) {
        self.whole.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A display of tasks of an hour each, with these cores. Their names are their numbers.
    fn of_widths(widths: &[usize]) -> Display {
        let task = |(number, &width): (usize, &usize)| Planned {
            name: number.to_string(),
            seconds: 3600.0,
            width,
            share: 0.0,
            steps: 100,
        };
        Display::new(widths.iter().enumerate().map(task).collect())
    }

    #[test]
    fn what_is_left_is_counted_in_core_hours_and_nothing_is_left_of_a_task_that_failed() {
        let half_done = |display: &mut Display, task: &str| {
            display.began(task);
            display.heard(task, "step 50/100: 900 agent-steps/s");
        };
        // Eight runs of one core are at half, and one of eight cores comes after them: 4 core-hours done, 4 + 8 left.
        let mut display = of_widths(&[1, 1, 1, 1, 1, 1, 1, 1, 8]);
        (0..8).for_each(|task| half_done(&mut display, &task.to_string()));
        assert_eq!(display.left_per_done(), Some(3.0));

        let mut display = of_widths(&[1, 1, 1]);
        // One cannot begin, and one fails at half. The third is at half: 1 hour done, half an hour left.
        display.ended("0", Some("error: damaged"));
        half_done(&mut display, "1");
        display.ended("1", Some("error: broken"));
        half_done(&mut display, "2");
        assert_eq!(display.left_per_done(), Some(0.5));
        display.ended("2", None);
        assert_eq!(display.left_per_done(), Some(0.0));
    }
}
