//! The judge of networks and demand: SUMO, in a child process.
//!
//! SUMO aborts, hangs or reads foreign memory on some networks, and a process that does so cannot say why. So a child of
//! this program loads the files and plays a step, with limits on time and memory. What SUMO says there, or how the child
//! dies, is an error like any other. It costs a tenth of a second, and more for large networks.
//!
//! # Why not otherwise
//!
//! **Why not check the files here, and spare SUMO the bad ones?** Because the checks would be a second SUMO, and would
//! disagree with the first. What they missed would still end the process. What they refused by mistake would lock out
//! networks that SUMO plays well. So this program checks what it reads itself, and SUMO judges the rest.
//!
//! **Why not catch the crash?** Debian's SUMO has its `assert`s on, and they abort. A handler of that signal runs on a
//! stack with locks held and objects half made, where nothing may be allocated. The one in `libsumo` says what was simulated,
//! and that is all it can do. A process that only waits for another one can go on, and ask about the next file.
//!
//! **Why not load every network in a child, always?** It is so, once per config and command. The workers then load what
//! was tried.

use std::collections::BTreeSet;
use std::io::{Read, Write};
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::PathBuf;
use std::process::{Command, ExitStatus, Stdio};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, anyhow};

use super::domains;
use super::parent::END_WITH;
use crate::config::RunConfig;
use crate::error;
use crate::machine::{limit_cpu, limit_memory, ran_out_of_memory};
use crate::terminal::warn;
use dials_core::base::for_terminal;
use dials_core::domain::Domain;
use dials_core::outside::Printable;

/// The hidden subcommand of the child.
const TRY_OUT: &str = "try-out";
/// Longest time that a trial may compute. A grid of 10 000 intersections, the largest, takes 30 s.
const CPU_SECONDS: u64 = 60;
/// Longest time for a trial on a busy machine.
const PATIENCE: Duration = Duration::from_secs(600);
/// Memory that a trial may take, in GiB.
const MEMORY_GIB: u64 = 4;
/// Time between two looks at the child.
const LOOK_EVERY: Duration = Duration::from_millis(5);
/// Bytes of the child's words that are kept, from the end.
const LAST_WORDS: usize = 2000;

/// Beginning of the lines in which the child passes on what the simulator warns of.
const WARNING: &str = "warning: ";

/// Configs whose files were tried, as JSON. A command opens the same files several times and tries them once.
static SURVIVED: Mutex<BTreeSet<String>> = Mutex::new(BTreeSet::new());

/// The hidden command: tries the files of the config on standard input.
pub fn try_out() -> error::Result<()> {
    limit_memory(MEMORY_GIB << 30).and_then(|()| limit_cpu(CPU_SECONDS)).map_err(error::Error::Run)?;
    let config = || -> Result<RunConfig> {
        let mut json = String::new();
        std::io::stdin().read_to_string(&mut json).context("no config on standard input")?;
        serde_json::from_str(&json).context("this command is for the program itself, not for people")
    };
    let config = config().map_err(error::Error::Usage)?;
    let tried = domains::find(&config).and_then(|domain| domain.try_out()).map_err(error::Error::Usage)?;
    tried.iter().for_each(|warning| warn(format_args!("{WARNING}{}", warning.replace('\n', " "))));
    Ok(())
}

/// Lets a child try the files of a domain, once per config. The error names them, and how the child ended.
pub(crate) fn survive(config: &RunConfig, domain: &dyn Domain) -> Result<()> {
    let files = domain.strange_files();
    if files.is_empty() {
        return Ok(());
    }
    let config = serde_json::to_string(config)?;
    let survived = || SURVIVED.lock().unwrap_or_else(PoisonError::into_inner);
    if survived().contains(&config) {
        return Ok(());
    }
    let mut command = Command::new("/proc/self/exe");
    command.args([TRY_OUT, END_WITH, &std::process::id().to_string()]);
    // Ctrl-C at the terminal ends this process, and the child ends with it.
    command.process_group(0);
    let simulator = domain.foreign_simulator().unwrap_or("the simulator");
    let end = watch(command, config.clone(), PATIENCE)?;
    let said = end.said.clone();
    let names: Vec<String> = files.iter().map(|file: &PathBuf| file.display().to_string()).collect();
    judge(end, &names.join(" or "), simulator)?;
    let warnings = said.lines().filter_map(|line| line.strip_prefix(WARNING));
    warnings.for_each(|warning| warn(for_terminal(&format!("{WARNING}{simulator}: {warning}"))));
    survived().insert(config);
    Ok(())
}

pub struct End {
    /// Nothing if the child had not ended in time. It is killed then.
    pub status: Option<ExitStatus>,
    pub said: String,
}

pub fn watch(mut command: Command, input: String, patience: Duration) -> Result<End> {
    command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
    let mut child = command.spawn().context("cannot start a process that tries it")?;
    let mut stdin = child.stdin.take().expect("it was piped");
    let mut stderr = child.stderr.take().expect("it was piped");
    // A child that has died does not read. Its end says more than this error would.
    let write = thread::spawn(move || drop(stdin.write_all(input.as_bytes())));
    let read = thread::spawn(move || last_words(&mut stderr));
    let begun = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(None) if begun.elapsed() < patience => thread::sleep(LOOK_EVERY),
            ended => break ended,
        }
    };
    if !matches!(status, Ok(Some(_))) {
        drop(child.kill());
        drop(child.wait());
    }
    // Both pipes are closed with the child, so both threads end.
    drop(write.join());
    let said = read.join().map_err(|_| anyhow!("cannot read what the process that tries it says"))?;
    Ok(End { status: status.context("cannot wait for the process that tries it")?, said })
}

fn last_words(stderr: &mut impl Read) -> String {
    let (mut kept, mut piece) = (Vec::new(), [0; LAST_WORDS]);
    while let Ok(length @ 1..) = stderr.read(&mut piece) {
        kept.extend_from_slice(&piece[..length]);
        kept.drain(..kept.len().saturating_sub(LAST_WORDS));
    }
    String::from_utf8_lossy(&kept).trim().to_owned()
}

/// Returns the error of a child that failed, died or did not end. `files`: the strange files that it tried.
fn judge(End { status, said }: End, files: &str, simulator: &str) -> Result<()> {
    let died_with = |how: String, said: &str| {
        let words =
            if said.is_empty() { String::new() } else { format!("; its last words: {}", said.replace('\n', " ")) };
        anyhow!("{}", Printable(format!("{how}{words}")))
            .context(format!("{files}: {simulator} cannot simulate this network; use another one"))
    };
    let died = |how: String| died_with(how, &said);
    let Some(status) = status else {
        return Err(died(format!("it was not loaded within {} s; the machine may be busy", PATIENCE.as_secs())));
    };
    if !status.success() && ran_out_of_memory(&said) {
        return Err(died(format!(
            "memory ran out; it may take {MEMORY_GIB} GiB, or less if a limit (ulimit -v) says so"
        )));
    }
    if let Some(signal) = status.signal() {
        // Its own message about the signal would come twice.
        let own = format!(": {simulator} died ");
        let before = said.lines().take_while(|line| !(line.starts_with("error: ") && line.contains(&own)));
        let before = before.collect::<Vec<_>>().join("\n");
        let died = |how: String| died_with(how, &before);
        let how = match signal {
            6 => " (aborted, for example by an assertion)",
            9 => " (killed, for example because memory ran out)",
            11 => " (it read foreign memory)",
            24 => return Err(died(format!("it was not loaded within {CPU_SECONDS} s of computing"))),
            _ => "",
        };
        return Err(died(format!("{simulator} died of signal {signal}{how}")));
    }
    match (status.success(), said.strip_prefix("error: ")) {
        (true, _) => Ok(()),
        // The child found the same error that this process would have found.
        (false, Some(error)) => {
            let mut causes = error.rsplit("\n  caused by: ").map(|cause| Printable(cause).to_string());
            let root = anyhow!(causes.next().unwrap_or_default());
            Err(causes.fold(root, anyhow::Error::context))
        }
        (false, None) => Err(died(format!("it ended with {status}"))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns what is said of a child that runs this script.
    fn said_of(script: &str, patience: Duration) -> String {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        let end = watch(command, "x".repeat(1 << 20), patience).unwrap();
        judge(end, "a.net.xml", "SUMO").map_or_else(|error| format!("{error:#}"), |()| "survived".to_owned())
    }

    #[test]
    fn the_death_of_the_child_is_an_error_like_any_other() {
        let long = Duration::from_secs(60);
        assert_eq!(said_of("cat > /dev/null", long), "survived");
        assert_eq!(said_of("printf 'error: a\\n  caused by: b\\n' >&2; exit 2", long), "a: b");
        for (script, patience, how) in [
            ("echo 'a failed' >&2; kill -ABRT $$", long, "SUMO died of signal 6 (aborted, for example by an "),
            ("kill -SEGV $$", long, "SUMO died of signal 11 (it read foreign memory)"),
            (
                "echo 'a failed' >&2; echo 'error: a.net.xml: SUMO died while it loaded' >&2; kill -SEGV $$",
                long,
                "SUMO died of signal 11 (it read foreign memory); its last words: a failed",
            ),
            ("echo 'a failed' >&2; exit 101", long, "it ended with exit status: 101; its last words: a failed"),
            ("exec sleep 1000", Duration::from_millis(50), "it was not loaded within 600 s; the machine may be busy"),
            ("echo 'error: (os error 12)' >&2; exit 2", long, "memory ran out; it may take 4 GiB, or less if a limit"),
        ] {
            let said = said_of(script, patience);
            let said = said.strip_prefix("a.net.xml: SUMO cannot simulate this network; use another one: ").unwrap();
            assert!(said.starts_with(how), "{script}: {said}");
        }
        let said = said_of("yes 'no end' | head -n 100000 >&2; kill -SEGV $$", long);
        assert!(said.len() < LAST_WORDS + 200 && said.ends_with("no end"), "{}", said.len());
    }
}
