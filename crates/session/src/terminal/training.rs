//! The progress of `train`: a bar on a terminal, plain lines elsewhere.

use std::cell::{Cell, RefCell};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};

use super::activity::doing;
use super::duration::duration;
use super::{Talk, Wish, note, shows_bars, stop_on_signals, talks, warn};
use crate::config::RunConfig;
use dials_core::base::Activity;
use dials_core::base::statistics::{Interval, mean};
use dials_core::base::{counted, decimals};
use dials_learn::algorithms::imitation::ImitationLoss;
use dials_learn::evaluation::Evaluation;
use dials_learn::influence::{AipLoss, FreshLoss, mean_loss};
use dials_learn::training::drift::Drift;
use dials_learn::training::observer::Observer;

/// Interval between plain lines while policies train.
const PLAIN_LINE_EVERY: Duration = Duration::from_secs(10);

/// The progress of `train`.
pub struct Progress {
    bar: Option<ProgressBar>,
    agents: usize,
    end: u64,
    begun: Instant,
    rate: RefCell<Rate>,
    last_line: Cell<Instant>,
    found: RefCell<Latest>,
    /// Flag that Ctrl-C sets.
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
    /// Notes that the policies are trained to this step.
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

    /// Returns the time until the last step, if the rest goes on as all so far: with AIPs, datasets, evaluations and
    /// exchanges.
    fn left(&self, last_step: u64, now: Instant) -> Option<Duration> {
        let (begun, first) = self.first?;
        let done = self.at.checked_sub(first).filter(|&done| done > 0)?;
        let left = last_step.saturating_sub(self.at) as f64 / done as f64;
        Some(Duration::try_from_secs_f64((now - begun).as_secs_f64() * left).unwrap_or(Duration::MAX))
    }
}

/// The newest figures of the run.
#[derive(Default)]
struct Latest {
    mean_return: Option<f64>,
    aip_loss: Option<f64>,
}

impl Progress {
    /// Starts the display, and listens for Ctrl-C from here on.
    ///
    /// The first Ctrl-C asks to stop where nothing is lost, the second ends the process. `last_words` returns the
    /// line that is printed after the second.
    pub fn new(
        config: &RunConfig,
        agents: usize,
        last_words: impl Fn() -> String + Send + Sync + 'static,
    ) -> anyhow::Result<Self> {
        let bar = shows_bars().then(|| {
            let style = "{bar:8.cyan/blue} {percent:>3} %  {wide_msg}";
            let style = ProgressStyle::with_template(style).expect("the template is well-formed");
            ProgressBar::new(config.learning.end()).with_style(style)
        });
        let doing = Doing::default();
        let (place, now_doing) = (bar.clone(), doing.clone());
        let stop = stop_on_signals(move |wish| match wish {
            Wish::Stop => say(place.as_ref(), &stopping(*now_doing.lock().unwrap_or_else(PoisonError::into_inner))),
            Wish::StopNow => insist(place.as_ref(), &last_words()),
        })?;
        let now = Instant::now();
        Ok(Progress {
            bar,
            agents,
            end: config.learning.end(),
            begun: now,
            rate: RefCell::default(),
            last_line: Cell::new(now),
            found: RefCell::default(),
            stop,
            doing,
        })
    }

    /// Removes the bar. `done`: whether the training came to its end, so that its time is told.
    pub fn finish(&self, done: bool) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        if done {
            note(format_args!("done in {}", duration(self.begun.elapsed())));
        }
    }

    fn say(&self, line: &str) {
        say(self.bar.as_ref(), line);
    }

    fn note(&self, activity: Activity) {
        let before = self.doing.lock().unwrap_or_else(PoisonError::into_inner).replace(activity);
        if talks(Talk::Verbose) && before != Some(activity) {
            self.say(&format!("  {}", doing(activity)));
        }
    }

    /// Returns a message such as `12345 agent-steps/s, 3 min 20 s left, return 201.2, AIP 0.301`.
    /// With the bar before it, it fits 80 columns.
    fn message(&self) -> String {
        let rate = self.rate.borrow();
        let mut parts = Vec::new();
        parts.extend(rate.per_second().map(|speed| format!("{:.0} agent-steps/s", speed * self.agents as f64)));
        parts.extend(rate.left(self.end, Instant::now()).map(|left| format!("{} left", duration(left))));
        let found = self.found.borrow();
        parts.extend(found.mean_return.map(|value| format!("return {value:.0$}", decimals(value, None))));
        parts.extend(found.aip_loss.map(|value| format!("AIP {value:.3}")));
        parts.join(", ")
    }
}

impl Observer for Progress {
    fn trained(&self, steps: u64) {
        self.note(Activity::Training);
        let now = Instant::now();
        self.rate.borrow_mut().note(steps, now);
        match &self.bar {
            Some(bar) => {
                bar.set_position(steps.min(self.end));
                bar.set_message(self.message());
            }
            None if now - self.last_line.get() >= PLAIN_LINE_EVERY => {
                self.last_line.set(now);
                note(format_args!("step {steps}/{}: {}", self.end, self.message()));
            }
            None => (),
        }
    }

    fn busy(&self, activity: Activity, share: f64) {
        self.note(activity);
        self.rate.borrow_mut().since = None;
        let what = doing(activity);
        if let Some(bar) = &self.bar {
            bar.set_message(format!("{what} {:.0} %", 100.0 * share));
        }
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
        self.found.borrow_mut().mean_return = Some(all.mean);
    }

    fn aips_trained(&self, steps: u64, losses: &[AipLoss]) {
        let mean_of = |pick: fn(&AipLoss) -> &Vec<f64>| {
            mean_loss(&losses.iter().map(|loss| mean_loss(pick(loss))).collect::<Vec<_>>())
        };
        let (before, after, marginals) =
            (mean_of(|loss| &loss.held_out[0]), mean_of(|loss| &loss.held_out[1]), mean_of(|loss| &loss.marginals));
        self.say(&format!("step {steps}: held-out AIP loss {before:.3} -> {after:.3} ({})", judged(after, marginals)));
        self.found.borrow_mut().aip_loss = Some(after);
    }

    fn aips_measured(&self, losses: &[FreshLoss], drift: &Drift) {
        let [loss, marginals] = FreshLoss::means_of_all(losses);
        let grown = match drift.percent() {
            percent if percent.is_finite() => {
                let worse = if percent < 0.0 { "better" } else { "worse" };
                format!("\n  as a share of theirs {:.1} % {worse} than after the last training", percent.abs())
            }
            _ => String::new(),
        };
        self.say(&format!("  AIP loss on new episodes {loss:.3} ({}){grown}", judged(loss, marginals)));
        self.found.borrow_mut().aip_loss = Some(loss);
    }

    fn worker_lost(&self, message: &str) {
        insist(self.bar.as_ref(), &format!("warning: {message}"));
    }

    fn stop_requested(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
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

/// Prints a line, above the bar if there is one.
fn say(bar: Option<&ProgressBar>, line: &str) {
    match bar {
        Some(bar) => bar.suspend(|| note(line)),
        None => note(line),
    }
}

/// Prints a line like [`say`], also if the process is quiet.
fn insist(bar: Option<&ProgressBar>, line: &str) {
    match bar {
        Some(bar) => bar.suspend(|| warn(line)),
        None => warn(line),
    }
}

/// Returns the line that is printed after the first Ctrl-C.
fn stopping(now: Option<Activity>) -> String {
    let place = match now {
        Some(Activity::Training) => "at the end of this period, where nothing is lost".to_owned(),
        other => format!("as soon as nothing is lost by it (now {})", other.map_or("starting", doing)),
    };
    format!("stopping {place}; press Ctrl-C again to stop now and lose at most this period")
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
    fn an_aip_loss_is_compared_with_constants_and_not_blamed() {
        assert_eq!(judged(0.3, 0.316), "better than constants, which have 0.316");
        assert_eq!(judged(0.4, 0.316), "no better than constants, which have 0.316");
        assert_eq!(judged(0.3159, 0.3161), "as good as constants, which have 0.316");
    }

    #[test]
    fn the_same_step_twice_in_a_row_is_no_reason_to_guess_the_time_left() {
        let config: RunConfig = toml::from_str("warehouse = { agents_per_side = 2 }").unwrap();
        let progress = Progress::new(&config, 4, String::new).unwrap();
        progress.trained(128);
        std::thread::sleep(Duration::from_millis(1));
        progress.trained(128);
        assert_eq!(progress.message(), "");
        progress.trained(256);
        assert!(progress.message().contains("agent-steps/s, "), "{}", progress.message());
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
    }

    #[test]
    fn without_a_step_done_the_time_left_is_unknown() {
        let begun = Instant::now();
        let mut rate = Rate::default();
        assert_eq!(rate.left(1000, begun), None);
        rate.note(200, begun);
        assert_eq!(rate.left(1000, begun + Duration::from_secs(5)), None);
        // After a lost worker.
        rate.note(100, begun + Duration::from_secs(6));
        assert_eq!(rate.left(1000, begun + Duration::from_secs(7)), None);
    }
}
