//! Limits of the machine and of the command line: each ends with one clear error, and nobody is left behind.

use std::ffi::{OsStr, OsString};
use std::fs;
use std::io::{Read, Write};
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::process::{CommandExt, ExitStatusExt};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::thread;
use std::time::{Duration, Instant};

/// Time limit. However slow the machine is, a command that lasts longer will never end.
const FOR_EVER: Duration = Duration::from_secs(120);
const PROGRAM: &str = env!("CARGO_BIN_EXE_dials-traffic");
/// User without any other process, for limits that count those of a user.
const NOBODY: u32 = 54_321;

/// Writes a config of two short periods in the warehouse, with four agents.
fn write_config(dir: &Path) -> PathBuf {
    let path = dir.join("small.toml");
    let text = "total_steps = 512\n[warehouse]\nagents_per_side = 2\nhorizon = 20\n\
                [local_simulators]\ncopies = 8\n[policy]\nhidden = [16, 8]\n\
                [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 160\nbatch = 32\nepochs = 2\n\
                [evaluation]\nevery_steps = 256\nseed = 7\nepisodes = 1\nfinal_episodes = 2\n";
    fs::write(&path, text).unwrap();
    path
}

/// What a command left behind.
struct Ended {
    status: ExitStatus,
    stdout: String,
    stderr: String,
}

impl Ended {
    /// Asserts that the command ended by itself, with at most one error and without a panic.
    fn assert_orderly(&self) {
        let Ended { status, stderr, .. } = self;
        assert!(matches!(status.code(), Some(0..=2)), "{status}: {stderr}");
        let errors = stderr.lines().filter(|line| line.starts_with("error: ")).count();
        assert_eq!(errors, usize::from(!status.success()), "{status}: {stderr}");
        assert!(!stderr.contains("panicked") && !stderr.contains("RUST_BACKTRACE"), "{stderr}");
    }

    /// Asserts that the command did what it should.
    fn assert_done(&self) {
        self.assert_orderly();
        assert!(self.status.success(), "{}", self.stderr);
    }

    /// Asserts that the command failed with this exit code and one error that has all of `parts`.
    fn assert_failed(&self, code: i32, parts: &[&str]) {
        self.assert_orderly();
        assert_eq!(self.status.code(), Some(code), "{}", self.stderr);
        for part in parts {
            assert!(self.stderr.contains(part), "`{part}` is not in: {}", self.stderr);
        }
    }
}

/// Runs a command that must end, and collects what it prints. Whatever it started must end with it.
fn run(command: &mut Command) -> Ended {
    let mut child =
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).process_group(0).spawn().unwrap();
    let read = |stream: Box<dyn Read + Send>| {
        thread::spawn(move || {
            let (mut stream, mut bytes) = (stream, Vec::new());
            stream.read_to_end(&mut bytes).unwrap();
            String::from_utf8_lossy(&bytes).into_owned()
        })
    };
    let stdout = read(Box::new(child.stdout.take().unwrap()));
    let stderr = read(Box::new(child.stderr.take().unwrap()));
    let status = wait(&mut child);
    Ended { status, stdout: stdout.join().unwrap(), stderr: stderr.join().unwrap() }
}

fn wait(child: &mut Child) -> ExitStatus {
    let begun = Instant::now();
    loop {
        if let Some(status) = child.try_wait().unwrap() {
            return status;
        }
        if begun.elapsed() > FOR_EVER {
            child.kill().unwrap();
            panic!("a command waited for ever: {:?}", child.wait());
        }
        thread::sleep(Duration::from_millis(5));
    }
}

fn program<S: AsRef<OsStr>>(args: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new(PROGRAM);
    command.args(args);
    command
}

/// Returns the program under a limit of `prlimit`, such as `--nofile=16`.
fn limited<S: AsRef<OsStr>>(limit: &str, args: impl IntoIterator<Item = S>) -> Command {
    let mut command = Command::new("prlimit");
    command.args([limit, PROGRAM]).args(args);
    command
}

fn train(config: &Path, out: &Path, more: &[&str]) -> Vec<OsString> {
    let words = [OsStr::new("train"), config.as_os_str(), OsStr::new("--out"), out.as_os_str()];
    words.into_iter().chain(more.iter().map(OsStr::new)).map(OsStr::to_owned).collect()
}

fn returns(run: &Path) -> String {
    fs::read_to_string(run.join("returns.csv")).unwrap()
}

#[test]
fn a_number_outside_its_range_is_refused_with_the_range() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path());
    let config = config.to_str().unwrap();
    let most = u64::MAX.to_string();
    let cases: &[(&[&str], &str)] = &[
        (&["train", config, "--workers", &most], "from 0 to 4096"),
        (&["train", config, "--workers", "1000000000"], "from 0 to 4096"),
        (&["train", config, "--workers", "100000"], "from 0 to 4096"),
        (&["train", config, "--workers", "-1"], "from 0 to 4096"),
        (&["train", config, "--workers=nan"], "from 0 to 4096"),
        (&["train", config, "--patience", "0"], "from 1 to 31536000"),
        (&["train", config, "--patience", &most], "from 1 to 31536000"),
        (&["train", config, "--steps", "0"], "stop_at_steps = 0: must be at least 1"),
        (&["train", config, "--steps", "1000000"], "is larger than total_steps = 512"),
        (&["train", config, "--steps", "1e6"], "stop_at_steps = 1000000: is larger"),
        (&["train", config, "--steps", "1_000"], "stop_at_steps = 1000: is larger"),
        (&["train", config, "--steps", "1.5"], "a whole number such as 1000000 or 1e6"),
        (&["train", config, "--steps", &most], "a whole number such as 1000000 or 1e6"),
        (&["train", config, "--seed", "-1"], "from 0 to 18446744073709551615"),
        (&["train", config, "--set", "local_simulators.copies=0"], "must be at least 1"),
        (&["train", config, "--set", "local_simulators.copies=100000000000"], "must be at most 10000"),
        (&["train", config, "--set", "ppo.gamma=nan"], "ppo.gamma"),
        (&["bench", config, "--workers", "0"], "from 1 to 4096"),
        (&["bench", config, "--workers", &most], "from 1 to 4096"),
        (&["bench", config, "--seconds", "0"], "from 1 to 86400"),
        (&["bench", config, "--seconds", &most], "from 1 to 86400"),
        (&["check", config, "--seconds", "0"], "from 1 to 31536000"),
        (&["check", config, "--from", &most], "from 0 to 31536000"),
        (&["check", config, "--sigma", "nan"], "must be from 0 to 1"),
        (&["check", config, "--sigma", "much"], "must be a number such as 0.5"),
        (&["experiment", config, "--cores", "0"], "from 1 to 4096"),
        (&["experiment", config, "--cores", &most], "from 1 to 4096"),
        (&["baseline", config, "--controller", "oldest-item", "--episodes", "0"], "from 1 to 100000"),
        (&["baseline", config, "--controller", "oldest-item", "--episodes", "4294967296"], "from 1 to 100000"),
        (&["baseline", config, "--controller", "fixed-time", "--tune", "--tune-episodes", "0"], "from 1 to 10000"),
        (&["compare", "a", "b", "--reach", "nan"], "must be a finite number"),
        (&["nets", "grid", "--rows", "0", "--cols", "2", "--out", "n"], "from 1 to 10000"),
        (&["nets", "grid", "--rows", &most, "--cols", "2", "--out", "n"], "from 1 to 10000"),
        (&["nets", "grid", "--rows", "1", "--cols", "2", "--inflow=nan", "--out", "n"], "must be a probability"),
        (&["nets", "grid", "--rows", "1", "--cols", "2", "--inflow=-0.1", "--out", "n"], "must be a probability"),
        (
            &["nets", "grid", "--rows=1", "--cols=2", "--inflow-at=w0=0.1", "--inflow-at=w0=0.2", "--out", "n"],
            "--inflow-at: w0 is given twice",
        ),
    ];
    for (args, part) in cases {
        run(program(args.iter()).current_dir(dir.path())).assert_failed(2, &[part]);
    }
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "nothing is made");
}

#[test]
fn workers_without_any_work_are_not_started() {
    let dir = tempfile::tempdir().unwrap();
    let (config, few, many) = (write_config(dir.path()), dir.path().join("few"), dir.path().join("many"));
    run(&mut program(train(&config, &few, &["--workers", "1"]))).assert_orderly();
    let ended = run(&mut program(train(&config, &many, &["--workers", "4096"])));
    ended.assert_orderly();
    // 160 steps of a dataset are 8 episodes of 20.
    let note = "note: --workers 4096: starting 8, because there are 4 agents";
    assert!(ended.stderr.contains(note), "{}", ended.stderr);
    assert!(many.join("worker_7.log").exists() && !many.join("worker_8.log").exists());
    assert_eq!(returns(&few), returns(&many));
}

#[test]
fn the_limit_on_open_files_is_raised_where_that_helps() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path()), dir.path().join("run"));
    let args = train(&config, &out, &["--workers", "8"]);
    let refused = run(&mut limited("--nofile=36:47", &args));
    refused.assert_failed(2, &["--workers 8: needs about 48 open files", "at most 47", "ulimit -Hn"]);
    assert!(!out.exists());
    let ended = run(&mut limited("--nofile=12:48", &args));
    ended.assert_done();
    // Eight workers have work, and only they need files.
    let ended = run(&mut limited("--nofile=12:48", train(&config, &dir.path().join("many"), &["--workers", "4096"])));
    ended.assert_done();
}

#[test]
fn too_few_open_files_are_one_error_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path()), dir.path().join("run"));
    run(&mut program(train(&config, &out, &["--workers", "0"]))).assert_orderly();
    let mut told = 0;
    for files in 4..12 {
        let limit = format!("--nofile={files}:{files}");
        for args in
            [vec!["evaluate", "run", "--csv", "csv"], vec!["replay", "run", "--out", "x"], vec!["report", "run"]]
        {
            let ended = run(limited(&limit, &args).current_dir(dir.path()));
            ended.assert_orderly();
            if ended.stderr.contains("Too many open files") {
                told += 1;
                ended.assert_failed(ended.status.code().unwrap(), &["way out: ", "ulimit -n"]);
                assert!(!ended.stderr.contains("workers"), "{args:?} starts none: {}", ended.stderr);
            }
            ["csv", "x", "report"].iter().for_each(|made| drop(fs::remove_dir_all(dir.path().join(made))));
        }
    }
    assert!(told > 0);
}

#[test]
fn a_disk_that_is_full_for_csv_files_costs_no_figure_that_was_played() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path());
    let args = ["baseline", config.to_str().unwrap(), "--compare", "random,oldest-item", "--csv", "csv"];
    let ended = run(limited("--fsize=64", args).current_dir(dir.path()));
    ended.assert_failed(1, &["episodes.csv", "way out: "]);
    assert!(ended.stdout.contains("\nrandom ") && ended.stdout.contains("\noldest-item "), "{}", ended.stdout);
}

/// Says what this machine cannot test, even if the output of tests that pass is hidden.
fn not_tested(what: &str, why: &str) {
    let line = format!("not tested: {what}: {}\n", why.trim());
    std::io::stderr().write_all(line.as_bytes()).unwrap();
}

/// Returns the program as a user with nothing else running and at most `most` processes and threads. Only root can do
/// that.
fn with_processes(most: u32, args: &[OsString]) -> Command {
    let mut command = limited(&format!("--nproc={most}"), args);
    // OpenBLAS, where SUMO's libraries use it, would start a thread per core and interrupt the process if it cannot.
    command.uid(NOBODY).env("OPENBLAS_NUM_THREADS", "1");
    command
}

fn processes_of_nobody() -> usize {
    let owned = |pid: &OsString| {
        let status = fs::read_to_string(Path::new("/proc").join(pid).join("status")).unwrap_or_default();
        let of_nobody = status.lines().any(|line| line.starts_with(&format!("Uid:\t{NOBODY}\t")));
        of_nobody && !status.lines().any(|line| line.starts_with("State:\tZ"))
    };
    fs::read_dir("/proc").unwrap().map(|entry| entry.unwrap().file_name()).filter(owned).count()
}

#[test]
fn too_few_processes_are_one_error_with_the_way_out_and_no_orphans() {
    if !rustix::process::getuid().is_root() {
        return not_tested("too few processes", "only root can become a user without processes");
    }
    let dir = tempfile::tempdir().unwrap();
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o777)).unwrap();
    let config = write_config(dir.path());
    let mut told = 0;
    for most in [1, 2, 3, 4, 5, 6, 7, 9] {
        let out = |name: &str| dir.path().join(format!("{name}{most}"));
        let local = train(&config, &out("local"), &["--workers", "2"]);
        // On the global simulator, one worker has threads.
        let global = train(&config, &out("global"), &["--workers", "3", "--simulator", "gs"]);
        for args in [local, global] {
            let ended = run(&mut with_processes(most, &args));
            ended.assert_orderly();
            if !ended.status.success() {
                told += 1;
                assert!(ended.stderr.contains("(ulimit -u)"), "{most} processes: {}", ended.stderr);
            }
            let begun = Instant::now();
            while processes_of_nobody() > 0 {
                assert!(begun.elapsed() < FOR_EVER, "orphans");
                thread::sleep(Duration::from_millis(5));
            }
        }
    }
    assert!(told > 4, "{told}");
}

#[test]
fn memory_that_is_refused_is_one_error_and_no_abort() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path());
    let mut told = 0;
    // SUMO's libraries alone take about 350 MB of address space.
    let libraries: u64 = 350;
    for megabytes in [100, 200, 300, 400, 600].map(|more| libraries + more) {
        let out = dir.path().join(format!("run{megabytes}"));
        // Four agents with 4 million parameters each, and three copies of them for the optimiser.
        let args = train(&config, &out, &["--workers", "1", "--set", "policy.hidden=[2048, 2048]"]);
        let ended = run(limited(&format!("--as={}", megabytes * 1_000_000), &args).env("OPENBLAS_NUM_THREADS", "1"));
        ended.assert_orderly();
        if ended.stderr.contains("out of memory") {
            told += 1;
            assert!(ended.stderr.contains("local_simulators.copies"), "{}", ended.stderr);
        }
    }
    assert!(told > 0);
}

#[test]
fn too_little_memory_for_sumo_is_not_blamed_on_the_network() {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/traffic_4.toml");
    let dir = tempfile::tempdir().unwrap();
    let mut told = 0;
    for megabytes in (100..2000).step_by(50) {
        let args = train(&config, &dir.path().join("run"), &["--workers", "1", "--steps", "128"]);
        let ended = run(&mut limited(&format!("--as={}", megabytes * 1_000_000), &args));
        // With very little, the system does not even load the libraries that this program names.
        if ended.stderr.contains("SUMO's library") {
            told += 1;
            ended.assert_failed(2, &["allow this process more memory (ulimit -v)"]);
            assert!(!ended.stderr.contains("remake it"), "{}", ended.stderr);
        } else if told > 0 {
            break;
        }
    }
    assert!(told > 0);
}

#[test]
fn a_file_that_may_not_grow_is_named_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path());
    for (bytes, named) in [(0, "config.toml"), (2048, "run")] {
        let out = dir.path().join(format!("run{bytes}"));
        let args = train(&config, &out, &["--workers", "1"]);
        let ended = run(&mut limited(&format!("--fsize={bytes}"), &args));
        ended.assert_failed(ended.status.code().unwrap(), &[named, "File too large", "(ulimit -f)"]);
        assert!(!ended.status.success());
    }
}

/// libtorch would end its process.
#[cfg(feature = "torch")]
#[test]
fn policies_that_have_no_room_are_one_error_and_nothing_stays() {
    let dir = tempfile::tempdir().unwrap();
    let (config, out) = (write_config(dir.path()), dir.path().join("run"));
    run(&mut program(train(&config, &out, &["--workers", "0"]))).assert_done();
    let folder = dir.path().join(OsStr::from_bytes(b"exports\xff"));
    fs::create_dir(&folder).unwrap();
    let words = [OsStr::new("export"), out.as_os_str(), OsStr::new("--out"), folder.join("p.pt").as_os_str()]
        .map(OsStr::to_owned);
    run(&mut limited("--fsize=2048", &words)).assert_failed(1, &["p.pt: cannot be written", "(ulimit -f)"]);
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 0);
    run(&mut program(&words)).assert_done();
    assert_eq!(fs::read_dir(&folder).unwrap().count(), 1);
}

#[test]
fn a_full_disk_and_one_that_can_only_be_read_are_named_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path());
    let place = dir.path().join("disk");
    fs::create_dir(&place).unwrap();
    let on_a_disk = |options: &str, words: &[OsString]| {
        let script = format!("mount -t tmpfs -o {options} none \"$1\" && shift && exec \"$@\"");
        let mut command = Command::new("unshare");
        // In a user namespace of its own, everybody may mount where the system allows such namespaces.
        let namespaces = if rustix::process::getuid().is_root() { "-m" } else { "-rm" };
        command.args([namespaces, "sh", "-c", &script, "sh"]).arg(&place).args(words);
        run(&mut command)
    };
    let possible = on_a_disk("size=16k", &["true".into()]);
    if !possible.status.success() {
        return not_tested("full disks", &possible.stderr);
    }
    let words = [vec![PROGRAM.into()], train(&config, &place.join("run"), &["--workers", "1"])].concat();
    let on_a_disk = |options: &str| on_a_disk(options, &words);
    let full = on_a_disk("size=16k");
    full.assert_failed(full.status.code().unwrap(), &["disk/run", "No space left on device", "df -h"]);
    let fixed = on_a_disk("ro");
    fixed.assert_failed(2, &["disk/run", "Read-only file system", "can only be read"]);
}

#[test]
fn standard_output_on_a_full_disk_is_named_with_the_way_out() {
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let output = program(["info"]).stdout(full).output().unwrap();
    let told = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(
        told.contains("standard output: cannot be written") && told.contains("way out: the disk is full"),
        "{told}"
    );
}

#[test]
fn a_place_without_permission_is_named_with_the_way_out() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path());
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let mut command = program(train(&config, &dir.path().join("run"), &[]));
    if rustix::process::getuid().is_root() {
        command.uid(NOBODY);
    } else {
        fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o555)).unwrap();
    }
    run(&mut command).assert_failed(2, &["/run: cannot be made", "Permission denied", "way out: ", "ls -ld"]);
}

/// Returns the commands of this program among the lines that it printed.
fn commands_in(text: &str) -> Vec<String> {
    text.lines().filter_map(|line| line.find(&format!("{PROGRAM} ")).map(|begin| line[begin..].to_owned())).collect()
}

fn bash(command: &str, dir: &Path) -> Ended {
    run(Command::new("bash").args(["-c", command]).current_dir(dir))
}

#[test]
fn commands_to_copy_lead_to_the_same_bytes_whatever_is_in_a_path() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path());
    for name in [&b"a\xff7 it's"[..], b"two\nlines \x1b[31m", b"$HOME `id` \"\\"] {
        let place = dir.path().join(OsStr::from_bytes(name));
        fs::create_dir(&place).unwrap();
        let out = place.join("run");
        let ended = run(&mut program(train(&config, &out, &["--workers", "0"])));
        ended.assert_orderly();
        let commands = commands_in(&ended.stdout);
        assert_eq!(commands.len(), 2, "{}", ended.stdout);
        for command in commands {
            assert!(!command.contains('\u{FFFD}'), "{command}");
            let again = bash(&command, dir.path());
            assert!(again.status.success(), "{command}: {}", again.stderr);
        }
        // So does the command that a report prints.
        let pages = dir.path().join("report");
        run(&mut program([OsStr::new("report"), place.as_os_str(), OsStr::new("--out"), pages.as_os_str()]))
            .assert_orderly();
        let page = fs::read_to_string(pages.join("report.md")).unwrap();
        let words = page.lines().find_map(|line| line.strip_prefix("dials-traffic train ")).unwrap();
        let printed = Command::new("bash").args(["-c", &format!("printf '%s\\0' {words}")]).output().unwrap().stdout;
        let expected = [config.as_os_str(), OsStr::new("--out"), out.as_os_str(), "--workers".as_ref(), "0".as_ref()];
        let expected: Vec<u8> = expected.iter().flat_map(|word| [word.as_bytes(), b"\0"].concat()).collect();
        assert_eq!(printed, expected, "{words}");
        fs::remove_dir_all(pages).unwrap();
        // A run that fails prints how to resume it. Without its last times a run has not ended.
        let times = fs::read_to_string(out.join("timing.csv")).unwrap();
        fs::write(out.join("timing.csv"), &times[..=times.rfind("\n512,all,").unwrap()]).unwrap();
        let failed = run(&mut limited("--fsize=0", [OsStr::new("train"), OsStr::new("--resume"), out.as_os_str()]));
        failed.assert_orderly();
        let resume = commands_in(&failed.stderr);
        assert_eq!(resume.len(), 1, "{}", failed.stderr);
        let resumed = bash(&resume[0], dir.path());
        assert!(resumed.status.success(), "{}: {}", resume[0], resumed.stderr);
    }
}

#[test]
fn an_experiment_in_an_odd_directory_prints_a_report_command_that_works() {
    let dir = tempfile::tempdir().unwrap();
    let place = dir.path().join(OsString::from_vec(b"b\xfe 'x'".to_vec()));
    fs::create_dir(&place).unwrap();
    write_config(&place);
    let file = place.join("e.toml");
    fs::write(&file, "seeds = [1]\n[[grid]]\nconfigs = ['small.toml']\nsimulators = ['untrained-dials']\n").unwrap();
    let ended = run(program([OsStr::new("experiment"), file.as_os_str(), OsStr::new("--out")]).arg(place.join("runs")));
    ended.assert_done();
    let commands = commands_in(&ended.stdout);
    assert_eq!(commands.len(), 1, "{}", ended.stdout);
    let report = bash(&commands[0], dir.path());
    assert!(report.status.success(), "{}: {}", commands[0], report.stderr);
}

#[test]
fn traffic_in_a_directory_that_sumo_cannot_name_is_refused_before_anything_is_made() {
    let dir = tempfile::tempdir().unwrap();
    let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
    let config = dir.path().join("t.toml");
    let text = format!("[traffic]\nnetwork = '{0}/grid_2x2'\nlocal_network = '{0}/local'\n", nets.display());
    fs::write(&config, text).unwrap();
    let out = dir.path().join(OsStr::from_bytes(b"run\xff"));
    let ended = run(&mut program(train(&config, &out, &["--workers", "1"])));
    ended.assert_failed(2, &["is not UTF-8, which SUMO's options must be; rename it"]);
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1, "nothing is made");
}

#[test]
fn closed_streams_and_an_empty_environment_change_no_number() {
    let dir = tempfile::tempdir().unwrap();
    let config = write_config(dir.path());
    let expected = dir.path().join("expected");
    run(&mut program(train(&config, &expected, &["--workers", "1"]))).assert_orderly();
    let command = "\"$0\" train small.toml --workers 1 --out";
    for (name, line) in [
        ("a", format!("{command} a >&-")),
        ("b", format!("{command} b 2>&-")),
        ("c", format!("{command} c <&-")),
        ("d", format!("{command} d <&- >&- 2>&-")),
        ("e", format!("{command} e | head -c 1")),
        ("f", format!("{command} f 2>&1 | head -n 1; exit ${{PIPESTATUS[0]}}")),
        ("g", format!("env -i {command} g")),
        ("h", format!("env -u HOME -u TERM LANG=xx_YY.nothing LC_ALL=xx TERM= {command} h")),
    ] {
        let mut bash = Command::new("bash");
        let ended = run(bash.args(["-c", &line, PROGRAM]).current_dir(dir.path()));
        assert!(ended.status.success() && ended.status.signal().is_none(), "{line}: {} {}", ended.status, ended.stderr);
        assert_eq!(returns(&dir.path().join(name)), returns(&expected), "{line}");
    }
    for line in ["\"$0\" info | head -c 1", "\"$0\" --help | head -c 1", "\"$0\" evaluate expected | head -c 1"] {
        let ended = run(Command::new("bash").args(["-c", line, PROGRAM]).current_dir(dir.path()));
        assert!(!ended.stderr.contains("panicked"), "{line}: {}", ended.stderr);
    }
}
