//! A progress bar for things that are counted.

use std::fmt::Display;

use indicatif::{ProgressBar, ProgressStyle};

use super::{Talk, talks};
use crate::outside::Printable;

/// A progress bar for episodes or other things that are counted. It is shown on a terminal only.
pub struct EpisodeBar {
    bar: ProgressBar,
}

impl EpisodeBar {
    pub fn new(episodes: usize) -> Self {
        EpisodeBar::of(episodes, "episodes")
    }

    /// Makes a bar for `count` things. `things`: their name, in the plural.
    pub fn of(count: usize, things: &str) -> Self {
        // indicatif draws to standard error, and only if that is a terminal.
        let style = ProgressStyle::with_template(&format!(
            "{{bar:20.cyan/blue}} {{pos}}/{{len}} {things}  {{eta}} left  {{wide_msg}}"
        ));
        let bar = if talks(Talk::Normal) { ProgressBar::new(count as u64) } else { ProgressBar::hidden() };
        let bar = bar.with_style(style.expect("the template is well-formed"));
        EpisodeBar { bar }
    }

    pub fn set(&self, done: usize) {
        self.bar.set_position(done as u64);
    }

    pub fn set_length(&self, episodes: usize) {
        self.bar.set_length(episodes as u64);
    }

    pub fn tell(&self, message: impl Display) {
        self.bar.set_message(Printable(message).to_string());
    }

    pub fn finish(&self) {
        self.bar.finish_and_clear();
    }
}
