//! Why a process of this program aborted.

use super::processes::option_for_processes;
use super::way_out::LessMemory;

/// Words of a process whose memory ran out: of C++, of Rust, of this program and of the system.
const OUT_OF_MEMORY: [&str; 4] = ["bad_alloc", "memory allocation of ", "out of memory", "(os error 12)"];

/// Returns whether the last lines of a process that failed say that its memory ran out.
pub fn ran_out_of_memory(log: &str) -> bool {
    OUT_OF_MEMORY.iter().any(|words| log.contains(words))
}

/// Returns why a process ended by signal 6, from its last lines.
pub fn why_aborted(log: &str) -> String {
    if ran_out_of_memory(log) {
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
            ("error: out of memory: the system refused 48 more bytes", "out of memory"),
            ("error: no thread: Cannot allocate memory (os error 12)", "out of memory"),
            ("./src/microsim/MSLane.cpp:7: Assertion `false' failed.", "an assertion"),
            ("/usr/include/c++/12/bits/stl_vector.h:1123: Assertion '__n < this->size()' failed.", "an assertion"),
            ("process 7 owns agents 0 to 3", "aborted"),
        ] {
            assert!(why_aborted(log).starts_with(why), "{log}");
        }
    }
}
