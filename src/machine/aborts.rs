//! Why a process of this program aborted.

use super::processes::option_for_processes;
use super::way_out::LessMemory;

/// Returns why a process ended by signal 6, from its last lines.
pub fn why_aborted(log: &str) -> String {
    if log.contains("bad_alloc") || log.contains("memory allocation of ") {
        format!("out of memory; {}", LessMemory(option_for_processes()))
    } else if log.contains("ssertion") {
        "an assertion inside SUMO or another library".to_owned()
    } else {
        "aborted; its log may say why".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_lines_tell_one_abort_from_another() {
        for (log, why) in [
            (
                "terminate called after throwing an instance of 'std::bad_alloc'\n  what():  std::bad_alloc",
                "out of memory",
            ),
            ("memory allocation of 48 bytes failed", "out of memory"),
            ("./src/microsim/MSLane.cpp:7: Assertion `false' failed.", "an assertion"),
            ("/usr/include/c++/12/bits/stl_vector.h:1123: Assertion '__n < this->size()' failed.", "an assertion"),
            ("process 7 owns agents 0 to 3", "aborted"),
        ] {
            assert!(why_aborted(log).starts_with(why), "{log}");
        }
    }
}
