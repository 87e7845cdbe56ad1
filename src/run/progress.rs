//! What a person sees of a run: a bar on a terminal, plain lines elsewhere.

use std::cell::{Cell, RefCell};
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressStyle};
use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

use super::terminal::tell;
use crate::base::Phase;
use crate::config::Config;
use crate::evaluation::Evaluation;
use crate::influence::{AipLoss, FreshLoss};
use crate::training::drift::Drift;
use crate::training::observer::Observer;

/// How often a plain line is printed while policies train.
const PLAIN_LINE_EVERY: Duration = Duration::from_secs(10);

/// The progress of `train`.
pub struct Progress {
    bar: Option<ProgressBar>,
    agents: usize,
    last_step: u64,
    begun: Instant,
    /// Time and steps of the policies' training so far, without everything else.
    rate: RefCell<Rate>,
    last_line: Cell<Instant>,
    found: RefCell<Found>,
    /// Set by Ctrl-C.
    stop: Arc<AtomicBool>,
    stop_announced: Cell<bool>,
}

#[derive(Default)]
struct Rate {
    trained: Duration,
    steps: u64,
    /// When and at which step the last report came.
    since: Option<Instant>,
    at: u64,
}

/// The last figures.
#[derive(Default)]
struct Found {
    mean_return: Option<f64>,
    aip_loss: Option<f64>,
}

impl Progress {
    /// Listens for Ctrl-C from here on: the first one asks to stop where nothing is lost, the second ends the process.
    pub fn new(config: &Config, agents: usize) -> anyhow::Result<Self> {
        let stop = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM] {
            // In this order: the second one finds the flag that the first one has set.
            flag::register_conditional_shutdown(signal, 130, stop.clone())?;
            flag::register(signal, stop.clone())?;
        }
        let bar = std::io::stderr().is_terminal().then(|| {
            let style = "{bar:30.cyan/blue} {human_pos}/{human_len} steps  {msg}";
            let style = ProgressStyle::with_template(style).expect("the template is well-formed");
            ProgressBar::new(config.last_step()).with_style(style)
        });
        let now = Instant::now();
        Ok(Progress {
            bar,
            agents,
            last_step: config.last_step(),
            begun: now,
            rate: RefCell::default(),
            last_line: Cell::new(now),
            found: RefCell::default(),
            stop,
            stop_announced: Cell::new(false),
        })
    }

    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        tell(format_args!("done in {}", duration(self.begun.elapsed())));
    }

    fn say(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| tell(line)),
            None => tell(line),
        }
    }

    /// `12 345 agent-steps/s, 3 min left, return 201.2, AIP loss 0.301`
    fn message(&self, steps: u64) -> String {
        let rate = self.rate.borrow();
        let mut parts = Vec::new();
        // Two reports in a row may tell of the same step: that of the slowest worker.
        if rate.steps > 0 && !rate.trained.is_zero() {
            let per_second = rate.steps as f64 / rate.trained.as_secs_f64();
            parts.push(format!("{:.0} agent-steps/s", per_second * self.agents as f64));
            let left = self.last_step.saturating_sub(steps) as f64 / per_second;
            parts.push(format!("{} left", duration(Duration::from_secs_f64(left))));
        }
        let found = self.found.borrow();
        parts.extend(found.mean_return.map(|value| format!("return {value:.1}")));
        parts.extend(found.aip_loss.map(|value| format!("AIP loss {value:.3}")));
        parts.join(", ")
    }
}

impl Observer for Progress {
    fn trained(&self, steps: u64) {
        let mut rate = self.rate.borrow_mut();
        let now = Instant::now();
        // The first report of a period only starts the clock. A lost worker's replay steps back.
        if let Some(since) = rate.since.replace(now)
            && steps >= rate.at
        {
            rate.trained += now - since;
            rate.steps += steps - rate.at;
        }
        rate.at = steps;
        drop(rate);
        if self.stop_requested() && !self.stop_announced.replace(true) {
            self.say("stopping at the end of this period; Ctrl-C again stops at once and loses the period");
        }
        match &self.bar {
            Some(bar) => {
                bar.set_position(steps.min(self.last_step));
                bar.set_message(self.message(steps));
            }
            None if now - self.last_line.get() >= PLAIN_LINE_EVERY => {
                self.last_line.set(now);
                tell(format_args!("step {steps}/{}: {}", self.last_step, self.message(steps)));
            }
            None => (),
        }
    }

    fn busy(&self, phase: Phase, share: f64) {
        self.rate.borrow_mut().since = None;
        let what = match phase {
            Phase::Collection => "collecting datasets",
            Phase::AipTraining => "training AIPs",
            Phase::Evaluation => "evaluating",
            _ => phase.name(),
        };
        if let Some(bar) = &self.bar {
            bar.set_message(format!("{what} {:.0} %", 100.0 * share));
        }
    }

    fn evaluated(&self, steps: u64, evaluation: &Evaluation) {
        let all = evaluation.of_all();
        let stuck = evaluation.stuck.iter().filter(|&&stuck| stuck).count();
        let stuck = if stuck > 0 { format!(", {stuck} stuck") } else { String::new() };
        self.say(&format!(
            "step {steps}: return {:.1} +- {:.1}, median {:.1}{stuck}",
            all.mean, all.std_error, all.median
        ));
        self.found.borrow_mut().mean_return = Some(all.mean);
    }

    fn aips_trained(&self, steps: u64, losses: &[AipLoss]) {
        let mean = |pick: fn(&AipLoss) -> &Vec<f64>| {
            let losses: Vec<f64> = losses.iter().flat_map(|loss| pick(loss).iter().copied()).collect();
            losses.iter().sum::<f64>() / losses.len() as f64
        };
        let (before, after, marginals) =
            (mean(|loss| &loss.held_out[0]), mean(|loss| &loss.held_out[1]), mean(|loss| &loss.marginals));
        self.say(&format!(
            "step {steps}: AIP loss {before:.3} -> {after:.3} held out (constant marginals {marginals:.3})"
        ));
        self.found.borrow_mut().aip_loss = Some(after);
    }

    fn aips_measured(&self, losses: &[FreshLoss], drift: &Drift) {
        let [loss, marginals] = FreshLoss::means_of_all(losses);
        let grown = match drift.percent() {
            percent if percent.is_finite() => format!(", {percent:+.1} % since their training"),
            _ => String::new(),
        };
        self.say(&format!("  AIP loss {loss:.3} on fresh episodes (constant marginals {marginals:.3}){grown}"));
        self.found.borrow_mut().aip_loss = Some(loss);
    }

    fn worker_lost(&self, message: &str) {
        self.say(&format!("warning: {message}"));
    }

    fn stop_requested(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// A bar over episodes, on a terminal only.
pub struct EpisodeBar {
    bar: ProgressBar,
    episodes: usize,
}

impl EpisodeBar {
    pub fn new(episodes: usize) -> Self {
        // indicatif draws to standard error, and nothing where that is no terminal.
        let style = ProgressStyle::with_template("{bar:30.cyan/blue} {pos}/{len} episodes  {eta} left");
        let bar = ProgressBar::new(episodes as u64).with_style(style.expect("the template is well-formed"));
        EpisodeBar { bar, episodes }
    }

    pub fn set(&self, share: f64) {
        self.bar.set_position((share * self.episodes as f64).round() as u64);
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// `42 s`, `3 min 20 s`, `2 h 5 min`
fn duration(duration: Duration) -> String {
    let seconds = duration.as_secs();
    match (seconds / 3600, seconds / 60 % 60, seconds % 60) {
        (0, 0, seconds) => format!("{seconds} s"),
        (0, minutes, seconds) => format!("{minutes} min {seconds} s"),
        (hours, minutes, _) => format!("{hours} h {minutes} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_are_told_in_two_units() {
        assert_eq!(duration(Duration::from_secs(42)), "42 s");
        assert_eq!(duration(Duration::from_secs(200)), "3 min 20 s");
        assert_eq!(duration(Duration::from_secs(7500)), "2 h 5 min");
    }

    #[test]
    fn the_same_step_twice_in_a_row_is_no_reason_to_guess_the_time_left() {
        let config: Config = toml::from_str("warehouse = { agents_per_side = 2 }").unwrap();
        let progress = Progress::new(&config, 4).unwrap();
        progress.trained(128);
        std::thread::sleep(Duration::from_millis(1));
        progress.trained(128);
        assert_eq!(progress.message(128), "");
        progress.trained(256);
        assert!(progress.message(256).contains("agent-steps/s, "), "{}", progress.message(256));
    }
}
