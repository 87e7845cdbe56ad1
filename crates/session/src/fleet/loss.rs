//! Why the coordinator gives a worker up.

use std::time::Duration;

use super::link::Link;

/// Reason for giving a worker up.
pub(super) enum Loss {
    /// The stream has ended, or carries invalid data for this reason.
    Gone(Option<anyhow::Error>),
    /// The worker said what cannot be right, for this reason.
    Nonsense(anyhow::Error),
    /// The worker said nothing for longer than the patience.
    Silent,
}

impl Loss {
    /// Ends the worker and returns what happened to it.
    pub(super) fn describe(self, link: Box<dyn Link>, patience: Duration) -> String {
        match self {
            Loss::Gone(Some(reason)) => format!("died: {reason:#}; {}", link.end()),
            Loss::Gone(None) => format!("died: {}", link.end()),
            Loss::Nonsense(reason) => {
                format!("sent what cannot be right ({reason:#}) and was ended; {}", link.end_by_force())
            }
            Loss::Silent => {
                let state = link.state().unwrap_or_else(|| "unknown".to_owned());
                let end = link.end_by_force();
                format!(
                    "said nothing for {patience:?} (state: {state}) and was ended; if it needs more time, --patience gives \
                     it; {end}"
                )
            }
        }
    }
}
