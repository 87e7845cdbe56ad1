//! What a person can do about an error of the system, and why a process of this program aborted.

use std::fmt;
use std::sync::OnceLock;

use rustix::io::Errno;
use rustix::process::{Resource, getrlimit};

/// The option of this command that decides how many processes it starts, such as `--workers`.
static OPTION: OnceLock<&str> = OnceLock::new();
/// Words of a process whose memory ran out: of C++, of Rust, of this program and of the system.
const OUT_OF_MEMORY: [&str; 4] = ["bad_alloc", "memory allocation of ", "out of memory", "(os error 12)"];

/// Notes the option by which a user can make this command start fewer processes. Commands that start none need no call.
pub fn note_option_for_processes(option: &'static str) {
    OPTION.get_or_init(|| option);
}

/// Returns the option that was noted. Takes no memory.
pub(super) fn option_for_processes() -> Option<&'static str> {
    OPTION.get().copied()
}

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

/// Returns the way out of the system's error in an error message, if there is one. Errors of workers are only text.
pub fn way_out(message: &str) -> Option<String> {
    way_out_with(message, option_for_processes())
}

/// Returns [`way_out`] for a command with this option for the number of its processes.
fn way_out_with(message: &str, option: Option<&str>) -> Option<String> {
    Some(match Errno::from_raw_os_error(error_number(message)?) {
        Errno::AGAIN => format!(
            "no more processes or threads are allowed{} (ulimit -u); end other programs, or {}",
            limit(Resource::Nproc, 1, ""),
            option.map_or("raise the limit".to_owned(), |option| format!("take fewer {option}"))
        ),
        Errno::NOMEM => format!("memory is exhausted; {}", LessMemory(option)),
        Errno::PERM | Errno::ACCESS => {
            "check with `ls -ld` who may read and write there, or name another place".to_owned()
        }
        Errno::NFILE => "all programs together have too many files open (fs.file-max); end other programs".to_owned(),
        Errno::MFILE => format!(
            "a process may have {} files open (ulimit -n), and this command needs about 32{}; raise the limit, for \
             example with `ulimit -n 4096`{}",
            getrlimit(Resource::Nofile).current.map_or("a limited number of".to_owned(), |files| files.to_string()),
            option.map_or("", |_| " and a few more for each process that it starts"),
            option.map_or(String::new(), |option| format!(", or take fewer {option}"))
        ),
        Errno::FBIG => {
            format!("a file may not grow further{} (ulimit -f); raise the limit", limit(Resource::Fsize, 1024, " KiB"))
        }
        Errno::NOSPC => "the disk is full; free space (`df -h`) or files (`df -i`), or name another place".to_owned(),
        Errno::ROFS => "this file system can only be read; name another place".to_owned(),
        Errno::DQUOT => {
            "your quota of this disk is used up (`quota -s`); remove files, or name another place".to_owned()
        }
        _ => return None,
    })
}

/// What to do about exhausted memory, with this option for the number of processes. Showing it takes no memory.
pub(super) struct LessMemory<'a>(pub Option<&'a str>);

impl fmt::Display for LessMemory<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(option) => write!(f, "take fewer {option} or a smaller local_simulators.copies")?,
            None => f.write_str("end other programs")?,
        }
        f.write_str(", or raise the limit (ulimit -v)")
    }
}

/// Returns ` than N`, or nothing if there is no limit.
fn limit(resource: Resource, unit: u64, name: &str) -> String {
    getrlimit(resource).current.map_or(String::new(), |limit| format!(" than {}{name}", limit / unit))
}

/// Returns the number of Linux in the last `(os error N)` of a text.
fn error_number(message: &str) -> Option<i32> {
    let (_, rest) = message.rsplit_once("(os error ")?;
    rest.split_once(')')?.0.parse().ok().filter(|number| (1..4096).contains(number))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::Error;

    #[test]
    fn errors_of_the_system_have_a_way_out_and_others_have_none() {
        for (number, way) in [
            (Errno::AGAIN, "ulimit -u"),
            (Errno::NOMEM, "ulimit -v"),
            (Errno::ACCESS, "ls -ld"),
            (Errno::NFILE, "fs.file-max"),
            (Errno::MFILE, "ulimit -n"),
            (Errno::FBIG, "ulimit -f"),
            (Errno::NOSPC, "df -h"),
            (Errno::ROFS, "only be read"),
            (Errno::DQUOT, "quota"),
        ] {
            let message = format!("run.json: cannot be written: {} at path \"/x\"", Error::from(number));
            assert!(way_out(&message).unwrap().contains(way), "{message}");
        }
        for number in [Errno::AGAIN, Errno::NOMEM, Errno::MFILE] {
            let way = |option| way_out_with(&Error::from(number).to_string(), option).unwrap();
            assert!(way(Some("--cores")).contains("take fewer --cores"), "{}", way(Some("--cores")));
            assert!(!way(None).contains("--") && way(None).contains("raise the limit"), "{}", way(None));
        }
        assert_eq!(way_out(&format!("x: {}", Error::from_raw_os_error(2))), None);
        assert_eq!(way_out("run.json: is no JSON"), None);
        assert_eq!(way_out("(os error "), None);
    }

    #[test]
    fn the_last_lines_say_why_a_process_aborted() {
        for (log, why) in [
            ("terminate called after throwing an instance of 'std::bad_alloc'\n  what():", "out of memory"),
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
