//! The progress of `train` and of `bench`: a bar on a terminal, plain lines elsewhere.

use std::cell::{Cell, RefCell};
use std::fmt::Display;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use super::{Talk, Wish, doing, duration, note, shows_bars, stop_on_signals, talks, warn};
use crate::config::RunConfig;
use dials_core::base::statistics::{Interval, mean};
use dials_core::base::{Activity, counted, decimals};
use dials_learn::algorithms::imitation::ImitationLoss;
use dials_learn::evaluation::Evaluation;
use dials_learn::observer::Observer;
use dials_learn::predictors::{AipLoss, FreshLoss, mean_loss};
use dials_learn::progress::Drift;

/// Interval between plain lines while policies train.
const PLAIN_LINE_EVERY: Duration = Duration::from_secs(10);

pub struct Progress {
    bar: ProgressBar,
    agents: usize,
    end: u64,
    begun: Instant,
    rate: RefCell<Rate>,
    last_line: Cell<Instant>,
    /// Last return, and the step at which it was measured.
    mean_return: Cell<Option<(u64, f64)>>,
    /// Number of episodes of an evaluation, and of the last one.
    episodes: [usize; 2],
    aip_loss: Cell<Option<f64>>,
    stop: Arc<AtomicBool>,
    doing: Doing,
}

/// The current activity of the run. `None`: it is starting.
type Doing = Arc<Mutex<Option<Activity>>>;

/// Measures the speed of the policies' training, and that of the whole run.
#[derive(Default)]
struct Rate {
    /// Time and steps of the policies' training so far, without any other work.
    trained: Duration,
    steps: u64,
    /// Time of the last report. `None`: the clock is stopped.
    since: Option<Instant>,
    /// Step of the last report.
    at: u64,
    /// Time and step of the first report.
    first: Option<(Instant, u64)>,
}

impl Rate {
    fn note(&mut self, steps: u64, now: Instant) {
        self.first.get_or_insert((now, steps));
        // The first report of a period only starts the clock. After a lost worker the step may go back.
        if let Some(since) = self.since.replace(now)
            && steps >= self.at
        {
            self.trained += now - since;
            self.steps += steps - self.at;
        }
        self.at = steps;
    }

    /// Returns the timesteps per agent and second while policies train.
    fn per_second(&self) -> Option<f64> {
        // Two reports in a row may be of the same step, which is that of the slowest worker.
        let known = self.steps > 0 && !self.trained.is_zero();
        known.then(|| self.steps as f64 / self.trained.as_secs_f64())
    }

    /// Returns the time until the last step, if the rest, with AIPs and evaluations, takes as long as all so far.
    fn left(&self, last_step: u64, now: Instant) -> Option<Duration> {
        let (begun, first) = self.first?;
        let done = self.at.checked_sub(first).filter(|&done| done > 0)?;
        let left = last_step.saturating_sub(self.at) as f64 / done as f64;
        Some(Duration::try_from_secs_f64((now - begun).as_secs_f64() * left).unwrap_or(Duration::MAX))
    }
}

impl Progress {
    /// Starts the display. Ctrl-C asks to stop where nothing is lost; a later one prints `last_words` and ends.
    pub fn new(
        config: &RunConfig,
        agents: usize,
        last_words: impl Fn() -> String + Send + Sync + 'static,
    ) -> anyhow::Result<Self> {
        let bar = super::bar(Some(config.learning.end()), "{bar:8.cyan/blue} {percent:>3} %  {wide_msg}");
        let doing = Doing::default();
        let (place, now_doing) = (bar.clone(), doing.clone());
        let stop = stop_on_signals(move |wish| match wish {
            Wish::Stop => place.suspend(|| note(stopping(*now_doing.lock().unwrap_or_else(PoisonError::into_inner)))),
            Wish::StopNow => place.suspend(|| warn(last_words())),
        })?;
        let now = Instant::now();
        Ok(Progress {
            bar,
            agents,
            end: config.learning.end(),
            begun: now,
            rate: RefCell::default(),
            last_line: Cell::new(now),
            mean_return: Cell::default(),
            episodes: [config.learning.evaluation.episodes, config.learning.evaluation.final_episodes],
            aip_loss: Cell::default(),
            stop,
            doing,
        })
    }

    pub fn finish(&self, done: bool) {
        self.bar.finish_and_clear();
        if done {
            note(format_args!("done in {}", duration(self.begun.elapsed())));
        }
    }

    /// Prints a line, above the bar if there is one.
    fn say(&self, line: &str) {
        self.bar.suspend(|| note(line));
    }

    /// Notes what the run does. Returns whether it did something else before.
    fn note(&self, activity: Activity) -> bool {
        let before = self.doing.lock().unwrap_or_else(PoisonError::into_inner).replace(activity);
        if talks(Talk::Verbose) && before != Some(activity) {
            self.say(&format!("  {}", doing(activity)));
        }
        before != Some(activity)
    }

    /// Says how far an evaluation is, where no bar shows it. The last one may take long, so its beginning is said, too.
    fn evaluating(&self, begins: bool, share: f64) {
        let is_last = self.rate.borrow().at >= self.end;
        let now = Instant::now();
        if shows_bars() || !(begins && is_last || now - self.last_line.get() >= PLAIN_LINE_EVERY) {
            return;
        }
        self.last_line.set(now);
        let episodes = self.episodes[usize::from(is_last)];
        note(evaluating(is_last, episodes, share));
    }

    /// Returns `12345 agent-steps/s, 3 min 20 s left, return 201.2, AIP 0.301`: with the bar, it fits 80 columns.
    fn message(&self) -> String {
        let rate = self.rate.borrow();
        let mut parts = Vec::new();
        parts.extend(rate.per_second().map(|speed| format!("{:.0} agent-steps/s", speed * self.agents as f64)));
        parts.extend(rate.left(self.end, Instant::now()).map(|left| format!("{} left", duration(left))));
        parts.extend(self.mean_return.get().map(|(steps, value)| {
            let step = if shows_bars() { String::new() } else { format!(" at step {steps}") };
            format!("return {value:.0$}{step}", decimals(value, None))
        }));
        parts.extend(self.aip_loss.get().map(|value| format!("AIP {value:.3}")));
        parts.join(", ")
    }
}

impl Observer for Progress {
    fn trained(&self, steps: u64) {
        self.note(Activity::Training);
        let now = Instant::now();
        self.rate.borrow_mut().note(steps, now);
        self.bar.set_position(steps.min(self.end));
        self.bar.set_message(self.message());
        if !shows_bars() && now - self.last_line.get() >= PLAIN_LINE_EVERY {
            self.last_line.set(now);
            note(format_args!("step {steps}/{}: {}", self.end, self.message()));
        }
    }

    fn busy(&self, activity: Activity, share: f64) {
        let begins = self.note(activity);
        if activity == Activity::Evaluation {
            self.evaluating(begins, share);
        }
        self.rate.borrow_mut().since = None;
        self.bar.set_message(format!("{} {:.0} %", doing(activity), 100.0 * share));
    }

    fn imitated(&self, controller: &str, losses: &[ImitationLoss]) {
        let ImitationLoss { cross_entropy, accuracy } = ImitationLoss::mean_of(losses);
        self.say(&format!(
            "imitated {controller}: the same action on held-out episodes in {:.1} % -> {:.1} % of the decisions, \
             cross-entropy {:.3} -> {:.3}",
            100.0 * accuracy[0],
            100.0 * accuracy[1],
            cross_entropy[0],
            cross_entropy[1]
        ));
    }

    fn evaluated(&self, steps: u64, evaluation: &Evaluation) {
        let all = evaluation.of_all();
        let stuck = evaluation.stuck.iter().filter(|&&stuck| stuck).count();
        let stuck = match stuck {
            0 => String::new(),
            stuck => format!("; bad: {stuck} of {} stuck", counted(self.agents, "agent")),
        };
        let episodes: Vec<f64> = evaluation.returns.iter().map(mean).collect();
        let half_width = Interval::of(&episodes).half_width;
        let digits = decimals(all.mean, half_width);
        let half_width = half_width.map_or(String::new(), |width| format!(" +- {width:.digits$}"));
        self.say(&format!(
            "step {steps}: return {:.digits$}{half_width}, median agent {:.digits$}{stuck}",
            all.mean, all.median
        ));
        self.mean_return.set(Some((steps, all.mean)));
    }

    fn aips_trained(&self, steps: u64, losses: &[AipLoss]) {
        let mean_of = |pick: fn(&AipLoss) -> &Vec<f64>| {
            mean_loss(&losses.iter().map(|loss| mean_loss(pick(loss))).collect::<Vec<_>>())
        };
        let (before, after, marginals) =
            (mean_of(|loss| &loss.held_out[0]), mean_of(|loss| &loss.held_out[1]), mean_of(|loss| &loss.marginals));
        self.say(&format!("step {steps}: held-out AIP loss {before:.3} -> {after:.3} ({})", judged(after, marginals)));
        self.aip_loss.set(Some(after));
    }

    fn aips_measured(&self, losses: &[FreshLoss], drift: &Drift) {
        let [loss, marginals] = FreshLoss::means_of_all(losses);
        let grown = match drift.percent() {
            percent if percent.is_finite() => {
                let worse = if percent < 0.0 { "better" } else { "worse" };
                format!("\n  relative to constants: {:.1} % {worse} than right after the last training", percent.abs())
            }
            _ => String::new(),
        };
        self.say(&format!("  AIP loss on new episodes {loss:.3} ({}){grown}", judged(loss, marginals)));
        self.aip_loss.set(Some(loss));
    }

    fn worker_lost(&self, message: &str) {
        self.bar.suspend(|| warn(format_args!("warning: {message}")));
    }

    fn stop_requested(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// The progress of `bench`: a status line on a terminal, elsewhere one line per fleet.
/// The first Ctrl-C stops at once, because nothing can be lost.
pub struct BenchProgress {
    line: ProgressBar,
    fleet: RefCell<String>,
    stop: Arc<AtomicBool>,
}

impl BenchProgress {
    /// Starts the display, and listens for Ctrl-C from here on.
    pub fn new() -> anyhow::Result<Self> {
        let line = super::bar(None, "{spinner} {elapsed}  {wide_msg}");
        line.set_message("peak speed of matrix products");
        let place = line.clone();
        let stop = stop_on_signals(move |wish| match wish {
            Wish::Stop => (), // `bench` stops at once
            Wish::StopNow => place.suspend(|| warn("stopped")),
        })?;
        Ok(BenchProgress { line, fleet: RefCell::default(), stop })
    }

    /// Shows that the fleet with this number of workers is measured. `most`: the largest number that will be.
    pub fn begin(&self, workers: usize, most: usize) {
        let fleet = format!("{workers} of {}", counted(most, "worker"));
        if !shows_bars() {
            note(format_args!("measuring with {fleet}"));
        }
        self.line.set_message(fleet.clone());
        self.fleet.replace(fleet);
    }

    pub fn finish(&self) {
        self.line.finish_and_clear();
    }

    fn show(&self, doing: impl Display) {
        self.line.set_message(format!("{}: {doing}", self.fleet.borrow()));
        self.line.tick();
    }
}

impl Observer for BenchProgress {
    fn trained(&self, steps: u64) {
        self.show(format_args!("{}, step {steps}", doing(Activity::Training)));
    }

    fn busy(&self, activity: Activity, share: f64) {
        self.show(format_args!("{} {:.0} %", doing(activity), 100.0 * share));
    }

    fn worker_lost(&self, message: &str) {
        self.line.suspend(|| warn(format_args!("warning: {message}")));
    }

    fn stop_requested(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn keeps_results(&self) -> bool {
        false
    }
}

/// Returns the line about an evaluation of which this share is done.
fn evaluating(is_last: bool, episodes: usize, share: f64) -> String {
    let what = if is_last { "final evaluation" } else { "evaluation" };
    let done = (share * episodes as f64).round();
    format!("{what}: {done} of {} played", counted(episodes, "episode"))
}

/// Compares an AIP loss with that of the best constants. After a short training AIPs are often no better than these.
fn judged(loss: f64, constants: f64) -> String {
    let [shown, of_constants] = [loss, constants].map(|loss| format!("{loss:.3}"));
    let better = if shown == of_constants {
        "as good as"
    } else if loss < constants {
        "better than"
    } else {
        "no better than"
    };
    format!("{better} constants, which have {of_constants}")
}

/// Returns the line that is printed after the first Ctrl-C.
fn stopping(now: Option<Activity>) -> String {
    let place = match now {
        Some(Activity::Training) => "at the next checkpoint, where nothing is lost".to_owned(),
        other => format!("as soon as nothing is lost by it (now {})", other.map_or("starting", doing)),
    };
    format!(
        "stopping {place}; press Ctrl-C again, two seconds later or more, to stop now and lose what came since the last checkpoint"
    )
}

/// Reads a plain line about a step: returns the timesteps per agent and the words after them. Any other line: `None`.
pub(crate) fn plain_line(line: &str) -> Option<(u64, &str)> {
    let (steps, words) = line.strip_prefix("step ")?.split_once(": ")?;
    let done = steps.split_once('/').map_or(steps, |(done, _)| done);
    Some((done.parse().ok()?, words))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plain_lines_are_read_as_they_are_written() {
        assert_eq!(plain_line("step 128/512: 900 agent-steps/s"), Some((128, "900 agent-steps/s")));
        assert_eq!(plain_line("step 256: return 1.0 +- 0.1, median 1.0"), Some((256, "return 1.0 +- 0.1, median 1.0")));
        assert_eq!(plain_line("warning: step 3: x"), None);
    }

    #[test]
    fn a_line_about_an_evaluation_counts_its_episodes() {
        assert_eq!(evaluating(true, 100, 0.0), "final evaluation: 0 of 100 episodes played");
        assert_eq!(evaluating(false, 1, 1.0), "evaluation: 1 of 1 episode played");
    }

    #[test]
    fn durations_have_two_units() {
        let texts = [42, 200, 7500].map(|seconds| duration(Duration::from_secs(seconds)));
        assert_eq!(texts, ["42 s", "3 min 20 s", "2 h 5 min"]);
    }

    #[test]
    fn an_aip_loss_is_compared_with_constants_and_not_blamed() {
        assert_eq!(judged(0.3, 0.316), "better than constants, which have 0.316");
        assert_eq!(judged(0.4, 0.316), "no better than constants, which have 0.316");
        assert_eq!(judged(0.3159, 0.3161), "as good as constants, which have 0.316");
    }

    #[test]
    fn the_time_left_counts_all_work_and_the_speed_only_training() {
        let begun = Instant::now();
        let at = |second| begun + Duration::from_secs(second);
        let mut rate = Rate::default();
        // A resumed run, from step 200 to 400 of 1000. A period of 100 steps trains for 10 s. Other work takes 15 s.
        for (steps, second) in [(200, 0), (300, 10)] {
            rate.note(steps, at(second));
        }
        rate.since = None;
        for (steps, second) in [(300, 25), (400, 35)] {
            rate.note(steps, at(second));
        }
        rate.since = None;
        assert_eq!(rate.per_second(), Some(10.0));
        // 200 steps took 50 s, so 600 steps take 150 s.
        assert_eq!(rate.left(1000, at(50)), Some(Duration::from_secs(150)));
        assert_eq!(rate.left(400, at(50)), Some(Duration::ZERO));
        // Without a step done it is unknown. After a lost worker the step goes back.
        let mut rate = Rate::default();
        assert_eq!(rate.left(1000, begun), None);
        for (steps, second) in [(200, 0), (200, 5), (100, 6)] {
            rate.note(steps, at(second));
            assert_eq!((rate.left(1000, at(second)), rate.per_second()), (None, None), "{second} s");
        }
    }
}
