//! The progress of things that are counted.

use std::cell::Cell;
use std::fmt::Display;
use std::time::{Duration, Instant};

use indicatif::ProgressBar;

use super::{note, shows_bars};
use dials_core::outside::Printable;

const PLAIN_LINE_EVERY: Duration = Duration::from_secs(60);

/// The progress of episodes or other things that are counted: a bar on a terminal, elsewhere a line every minute.
pub struct EpisodeBar {
    bar: ProgressBar,
    things: String,
    last_line: Cell<Instant>,
}

impl EpisodeBar {
    /// Makes a bar for `count` things. `things`: their name, in the plural.
    pub fn of(count: usize, things: &str) -> Self {
        let template = format!("{{bar:20.cyan/blue}} {{pos}}/{{len}} {things}  {{eta}} left  {{wide_msg}}");
        EpisodeBar {
            bar: super::bar(Some(count as u64), &template),
            things: things.to_owned(),
            last_line: Cell::new(Instant::now()),
        }
    }

    pub fn set(&self, done: usize) {
        self.bar.set_position(done as u64);
        if !shows_bars()
            && let Some(line) = self.line_at(Instant::now(), done)
        {
            note(line);
        }
    }

    pub fn set_length(&self, episodes: usize) {
        self.bar.set_length(episodes as u64);
    }

    pub fn set_message(&self, message: impl Display) {
        self.bar.set_message(Printable(message).to_string());
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }

    /// Returns the line that is due without a terminal, if one is.
    fn line_at(&self, now: Instant, done: usize) -> Option<String> {
        if now.duration_since(self.last_line.get()) < PLAIN_LINE_EVERY {
            return None;
        }
        self.last_line.set(now);
        let line = format!("{done} of {} {} {}", self.bar.length().unwrap_or(0), self.things, self.bar.message());
        Some(line.trim_end().to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_terminal_a_line_is_due_every_minute() {
        let bar = EpisodeBar::of(1, "episodes");
        let begun = bar.last_line.get();
        let at = |seconds: u64, done: usize| bar.line_at(begun + Duration::from_secs(seconds), done);
        assert_eq!(at(59, 1), None);
        bar.set_length(40);
        assert_eq!(at(60, 2).unwrap(), "2 of 40 episodes");
        bar.set_message("(at most); best 205.3 so far");
        assert_eq!(at(119, 3), None);
        assert_eq!(at(125, 4).unwrap(), "4 of 40 episodes (at most); best 205.3 so far");
    }
}
