//! One line of the answer of `doctor`.

use std::fmt;

/// Whether all is well.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum State {
    Good,
    /// Some commands do not work, but training does.
    Missing,
    /// Training cannot work.
    Error,
}

/// A thing that was looked at.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Finding {
    pub state: State,
    pub what: String,
    /// What to do about it, a command if there is one.
    pub cure: Option<String>,
}

impl Finding {
    pub(super) fn good(what: impl Into<String>) -> Finding {
        Finding { state: State::Good, what: what.into(), cure: None }
    }

    pub(super) fn missing(what: impl Into<String>, cure: impl Into<String>) -> Finding {
        Finding { state: State::Missing, what: what.into(), cure: Some(cure.into()) }
    }

    pub(super) fn error(what: impl Into<String>, cure: impl Into<String>) -> Finding {
        Finding { state: State::Error, what: what.into(), cure: Some(cure.into()) }
    }
}

/// A line, and one below it with the cure.
impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let state = match self.state {
            State::Good => "ok",
            State::Missing => "missing",
            State::Error => "error",
        };
        write!(f, "{state:<9}{}", self.what)?;
        self.cure.as_ref().map_or(Ok(()), |cure| write!(f, "\n{:9}cure: {cure}", ""))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cure_stands_below() {
        let missing = Finding::missing("ffmpeg: needed for films as .mp4", "apt-get install ffmpeg");
        assert_eq!(
            missing.to_string(),
            "missing  ffmpeg: needed for films as .mp4\n         cure: apt-get install ffmpeg"
        );
        assert_eq!(Finding::good("12 GiB are free").to_string(), "ok       12 GiB are free");
    }
}
