//! What a target answers about an input. What must not happen is a panic, in the target or in what it calls.

/// The outcome of an input that did no harm.
pub enum Verdict {
    /// It was read, and means what it says.
    Accepted,
    /// It was refused, with this error.
    Refused(String),
}

impl Verdict {
    pub fn refused(error: impl std::fmt::Display) -> Verdict {
        Verdict::Refused(format!("{error:#}"))
    }

    /// Returns the outcome without what differs between similar inputs: digits, and what is quoted. A new kind of
    /// outcome makes its input a seed of further ones.
    pub fn kind(&self) -> String {
        match self {
            Verdict::Accepted => "accepted".to_owned(),
            Verdict::Refused(error) => kind_of(error),
        }
    }
}

/// Returns a message without digits and without what is quoted.
pub fn kind_of(message: &str) -> String {
    let unquoted = message.split(['"', '`', '\'']).step_by(2).collect::<Vec<_>>().join("_");
    let kept = unquoted.chars().filter(|letter| !letter.is_ascii_digit()).take(160);
    kept.map(|letter| if letter.is_control() { ' ' } else { letter }).collect()
}
