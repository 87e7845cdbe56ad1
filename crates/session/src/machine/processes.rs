//! The option that says how many processes a command starts, for advice when the machine has too little for them.

use std::sync::OnceLock;

/// The option of this command, such as `--workers`.
static OPTION: OnceLock<&str> = OnceLock::new();

/// Notes the option by which a user can make this command start fewer processes. Commands that start none need no call.
pub fn note_option_for_processes(option: &'static str) {
    OPTION.get_or_init(|| option);
}

/// Returns the option that was noted. Takes no memory.
pub(super) fn option_for_processes() -> Option<&'static str> {
    OPTION.get().copied()
}
