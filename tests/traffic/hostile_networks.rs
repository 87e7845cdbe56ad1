//! Networks and run directories from strangers: no file of the user is touched, and no network crashes the program.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::Write;
use std::mem::MaybeUninit;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::{Duration, Instant};

use assert_cmd::Command;
use dials_core::base::Seed;
use dials_core::domain::Domain;
use dials_session::config::{RunConfig, load};
use dials_session::domains::DomainConfig;
use dials_traffic::Traffic;
use dials_traffic::config::TrafficTable;
use rustix::fs::inotify;
use tempfile::TempDir;

const NET: &str = ".net.xml";
const ROUTES: &str = ".rou.xml";
const ACTUATED: &str = ".actuated.add.xml";

/// A folder with a config, the networks that it names and a file of the user outside of them.
struct Room {
    dir: TempDir,
}

impl Room {
    fn new() -> Room {
        let room = Room { dir: tempfile::tempdir().unwrap() };
        fs::create_dir(room.path("nets")).unwrap();
        fs::create_dir(room.path("tmp")).unwrap();
        fs::create_dir(room.path("here")).unwrap();
        room.restore("grid_2x2", "nets/grid_2x2");
        room.restore("local", "nets/local");
        fs::write(room.victim(), "precious").unwrap();
        let config = "total_steps = 512\n[traffic]\nnetwork = 'nets/grid_2x2'\nlocal_network = 'nets/local'\nhorizon = 40\n\
                      [local_simulators]\ncopies = 8\n[policy]\nhidden = [16, 8]\n\
                      [aip]\nhidden = [8]\nretrain_every_steps = 256\ndataset_steps = 160\nbatch = 32\nepochs = 2\n\
                      [evaluation]\nevery_steps = 256\nseed = 7\nepisodes = 1\nfinal_episodes = 1\n";
        fs::write(room.path("c.toml"), config).unwrap();
        room
    }

    fn path(&self, name: &str) -> PathBuf {
        self.dir.path().join(name)
    }

    fn victim(&self) -> PathBuf {
        self.path("victim.txt")
    }

    /// Copies a saved network to a prefix in this room.
    fn restore(&self, saved: &str, prefix: &str) {
        let nets = Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets");
        for ending in [NET, ROUTES, ACTUATED, ".sumocfg"] {
            fs::copy(nets.join(format!("{saved}{ending}")), self.path(&format!("{prefix}{ending}"))).unwrap();
        }
    }

    /// Changes a file of a network once.
    fn damage(&self, prefix: &str, Damage { ending, from, to }: &Damage) -> PathBuf {
        let path = self.path(&format!("{prefix}{ending}"));
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from), "{from} is not in {}", path.display());
        let to = to.replace("VICTIM", self.victim().to_str().unwrap());
        fs::write(&path, text.replacen(from, &to, 1)).unwrap();
        path
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
        command.args(words).current_dir(self.path("here")).env("TMPDIR", self.path("tmp"));
        command.timeout(Duration::from_secs(120));
        command
    }

    /// Returns the bytes of every file outside of the networks.
    fn files(&self) -> BTreeMap<PathBuf, Vec<u8>> {
        let (mut found, mut folders) = (BTreeMap::new(), vec![self.dir.path().to_owned()]);
        while let Some(folder) = folders.pop() {
            for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
                match path.is_dir() {
                    true => folders.push(path),
                    false => drop(found.insert(path.clone(), fs::read(&path).unwrap())),
                }
            }
        }
        found
    }

    /// Asserts that every one of `commands` refuses the file with one error, and writes nothing anywhere.
    fn assert_refused(&self, commands: &[&[&str]], file: &Path, told: &str) {
        let before = self.files();
        for words in commands {
            let output = self.command(words).output().unwrap();
            let said: String = String::from_utf8(output.stderr).unwrap().chars().take(3000).collect();
            let name = file.file_name().unwrap().to_str().unwrap();
            assert_eq!(output.status.code(), Some(2), "{words:?} {told}: {said}");
            assert_eq!(said.matches("error: ").count(), 1, "{said}");
            assert!(said.contains(name) && said.contains(told), "{words:?}: `{told}` is not in: {said}");
            assert!(!said.contains("panicked") && said.len() < 3000, "{said}");
            assert!(self.files() == before, "{words:?} wrote something: {told}");
        }
    }
}

struct Damage {
    ending: &'static str,
    from: &'static str,
    to: &'static str,
}

const fn damage(ending: &'static str, from: &'static str, to: &'static str) -> Damage {
    Damage { ending, from, to }
}

/// Ways to make SUMO open another file, and what the error says of each.
const ATTACKS: [(Damage, &str); 33] = [
    // Elements of an additional file.
    (damage(ACTUATED, "</additional>", r#"<edgeData id="x" file="VICTIM"/></additional>"#), "<edgeData"),
    (damage(ACTUATED, "</additional>", r#"<laneData id="x" file="VICTIM"/></additional>"#), "<laneData"),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<e1Detector id="x" lane="w0_r0c0_0" pos="1" freq="1" file="VICTIM"/></additional>"#,
        ),
        "<e1Detector",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<inductionLoop id="x" lane="w0_r0c0_0" pos="1" freq="1" file="VICTIM"/></additional>"#,
        ),
        "<inductionLoop",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<instantInductionLoop id="x" lane="w0_r0c0_0" pos="1" file="VICTIM"/></additional>"#,
        ),
        "<instantInductionLoop",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<e2Detector id="x" lane="w0_r0c0_0" pos="1" endPos="9" freq="1" file="VICTIM"/></additional>"#,
        ),
        "<e2Detector",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<laneAreaDetector id="x" lane="w0_r0c0_0" pos="1" endPos="9" freq="1" file="VICTIM"/></additional>"#,
        ),
        "<laneAreaDetector",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<e3Detector id="x" freq="1" file="VICTIM"><detEntry lane="w0_r0c0_0" pos="1"/><detExit lane="r0c0_r0c1_0" pos="9"/></e3Detector></additional>"#,
        ),
        "<e3Detector",
    ),
    (
        damage(ACTUATED, "</additional>", r#"<entryExitDetector id="x" freq="1" file="VICTIM"/></additional>"#),
        "<entryExitDetector",
    ),
    (
        damage(ACTUATED, "</additional>", r#"<vTypeProbe id="x" type="car" freq="1" file="VICTIM"/></additional>"#),
        "<vTypeProbe",
    ),
    (
        damage(ACTUATED, "</additional>", r#"<routeProbe id="x" edge="w0_r0c0" freq="1" file="VICTIM"/></additional>"#),
        "<routeProbe",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<timedEvent type="SaveTLSStates" source="r0c0" dest="VICTIM"/></additional>"#,
        ),
        "<timedEvent",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<timedEvent type="SaveTLSSwitchTimes" source="r0c0" dest="VICTIM"/></additional>"#,
        ),
        "<timedEvent",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<calibrator id="x" edge="w0_r0c0" pos="1" output="VICTIM"/></additional>"#,
        ),
        "<calibrator",
    ),
    (
        damage(ACTUATED, "</additional>", r#"<rerouter id="x" edges="w0_r0c0" file="VICTIM"/></additional>"#),
        "<rerouter",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<variableSpeedSign id="x" lanes="w0_r0c0_0" file="VICTIM"/></additional>"#,
        ),
        "<variableSpeedSign",
    ),
    (damage(ACTUATED, "</additional>", r#"<include href="VICTIM"/></additional>"#), "<include"),
    (damage(ACTUATED, "</additional>", r#"<poly id="x" imgFile="VICTIM" shape="0,0 1,1"/></additional>"#), "imgFile="),
    // Parameters of lights and cars.
    (
        damage(ACTUATED, r#"<param key="max-gap""#, r#"<param key="file" value="VICTIM"/><param key="max-gap""#),
        r#"<param key="file">"#,
    ),
    (damage(ACTUATED, r#"type="actuated""#, r#"type="swarm""#), r#"type="swarm""#),
    (
        damage(ACTUATED, r#"<param key="max-gap""#, r#"<param key="SWARMLOG" value="VICTIM"/><param key="max-gap""#),
        "SWARMLOG",
    ),
    (
        damage(ROUTES, r#"speedDev="0"/>"#, r#"speedDev="0"><param key="has.ssm.device" value="true"/></vType>"#),
        "has.ssm.device",
    ),
    (
        damage(ROUTES, r#"speedDev="0"/>"#, r#"speedDev="0"><param key="device.ssm.file" value="VICTIM"/></vType>"#),
        "device.ssm.file",
    ),
    (
        damage(ROUTES, r#"speedDev="0"/>"#, r#"speedDev="0"><param key="device.toc.file" value="VICTIM"/></vType>"#),
        "device.toc.file",
    ),
    (damage(ROUTES, r#"speedDev="0"/>"#, r#"speedDev="0" emissionClass="PHEMlight/PC_D_EU4"/>"#), "emissionClass="),
    (damage(ROUTES, r#"speedDev="0"/>"#, r#"speedDev="0" imgFile="VICTIM"/>"#), "imgFile="),
    // The same in the other files of a network, which SUMO reads with the same code.
    (damage(NET, "</net>", r#"<edgeData id="x" file="VICTIM"/></net>"#), "<edgeData"),
    (damage(NET, r#"<phase "#, r#"<param key="file" value="VICTIM"/><phase "#), r#"<param key="file">"#),
    (damage(ROUTES, "</routes>", r#"<edgeData id="x" file="VICTIM"/></routes>"#), "<edgeData"),
    // Files that SUMO's reader of XML and this program's would understand differently.
    (damage(ACTUATED, r#"encoding="UTF-8"?>"#, r#"encoding="UTF-7"?><!-- -->"#), r#"encoding="UTF-7""#),
    (
        damage(
            ACTUATED,
            "<additional>",
            r#"<!DOCTYPE additional [<!ENTITY e SYSTEM "file://VICTIM">]><additional>&e;"#,
        ),
        "document type",
    ),
    (
        damage(ACTUATED, "</additional>", r#"<q:edgeData xmlns:q="u" id="x" file="VICTIM"/></additional>"#),
        "whose name has a prefix",
    ),
    (
        damage(
            ACTUATED,
            "</additional>",
            r#"<xi:include xmlns:xi="http://www.w3.org/2001/XInclude" href="VICTIM"/></additional>"#,
        ),
        "whose name has a prefix",
    ),
];

#[test]
fn a_network_of_a_stranger_opens_no_other_file() {
    let room = Room::new();
    let config = &*room.path("c.toml").display().to_string();
    let replay = ["replay", config, "--controller", "actuated", "--out", "replay"];
    let commands: [&[&str]; 5] = [
        &["baseline", config, "--controller", "actuated", "--episodes", "1"],
        &["check", config],
        &["train", config, "--out", "run", "--workers", "0"],
        &["bench", config, "--seconds", "1", "--workers", "1"],
        &replay,
    ];
    for (number, (attack, told)) in ATTACKS.iter().enumerate() {
        let file = room.damage("nets/grid_2x2", attack);
        // All commands read networks in the same way; a few attacks go through each.
        let commands = if number % 8 == 0 { &commands[..] } else { &commands[..1] };
        room.assert_refused(commands, &file, told);
        room.restore("grid_2x2", "nets/grid_2x2");
    }
    room.command(&["baseline", config, "--controller", "actuated", "--episodes", "1"]).assert().success();
    assert_eq!(fs::read_to_string(room.victim()).unwrap(), "precious");
}

#[test]
fn text_in_another_encoding_is_not_an_element_for_sumo() {
    let room = Room::new();
    let path = room.path("nets/grid_2x2.actuated.add.xml");
    let text = fs::read_to_string(&path).unwrap().replace("UTF-8", "UTF-7");
    // In UTF-7 these are `<`, `"`, `/` and `>`. SUMO's reader of XML knows this encoding.
    let element = format!("+ADw-edgeData id=+ACI-x+ACI- file=+ACI-{}+ACI-+AC8-+AD4-", room.victim().display());
    fs::write(&path, text.replace("</additional>", &format!("{element}</additional>"))).unwrap();
    let config = room.path("c.toml").display().to_string();
    let baseline = ["baseline", &config, "--controller", "actuated", "--episodes", "1"];
    room.assert_refused(&[&baseline], &path, "declares encoding=\"UTF-7\"");
}

#[test]
fn a_run_directory_of_a_stranger_opens_no_other_file() {
    let room = Room::new();
    let config = room.path("c.toml").display().to_string();
    room.command(&["train", &config, "--out", "../run", "--workers", "0"]).assert().success();
    let (run, kept) = (room.path("run").display().to_string(), room.path("run/config.toml").display().to_string());
    let commands: [&[&str]; 6] = [
        &["evaluate", &run, "--episodes", "1"],
        &["evaluate", &run, "--background", "actuated", "--agents", "0"],
        &["replay", &run, "--out", "replay"],
        &["replay", &run, "--local", "0", "--out", "replay"],
        &["train", "--resume", &run],
        &["baseline", &kept, "--controller", "actuated"],
    ];
    for (prefix, saved) in [("run/networks/global", "grid_2x2"), ("run/networks/local", "local")] {
        for (attack, told) in [&ATTACKS[0], &ATTACKS[22], &ATTACKS[26], &ATTACKS[29]] {
            let file = room.damage(prefix, attack);
            room.assert_refused(&commands, &file, told);
            room.restore(saved, prefix);
        }
    }
}

#[test]
fn a_configuration_for_sumo_is_never_read() {
    let room = Room::new();
    let path = room.path("nets/grid_2x2.sumocfg");
    let text = fs::read_to_string(&path).unwrap();
    let output = format!("<output><tripinfo-output value='{}'/></output></configuration>", room.victim().display());
    fs::write(&path, text.replace("</configuration>", &output)).unwrap();
    let config = room.path("c.toml").display().to_string();
    room.command(&["train", &config, "--out", "../run", "--workers", "0"]).assert().success();
    assert_eq!(fs::read_to_string(room.victim()).unwrap(), "precious");
    let kept = fs::read_to_string(room.path("run/networks/global.sumocfg")).unwrap();
    assert!(!kept.contains("<output>"), "{kept}");
}

#[test]
fn a_file_that_changes_after_the_check_is_not_loaded() {
    let room = Room::new();
    let config: RunConfig = load(&room.path("c.toml"), &[]).unwrap();
    let Some(DomainConfig::Traffic(TrafficTable::Grid(table))) = &config.domain else { panic!("a config of traffic") };
    let traffic = Traffic::open(table).unwrap();
    room.damage("nets/grid_2x2", &ATTACKS[0].0);
    fs::write(room.path("nets/local.net.xml"), "<net/>").unwrap();
    let mut played = traffic.baseline("actuated").unwrap();
    for _ in 0..2 {
        played.simulator.reset(Seed::new(1)).unwrap();
        (0..5).for_each(|_| drop(played.simulator.step(&[0; 4]).unwrap().clone()));
    }
    drop(played);
    traffic.try_out().unwrap();
    traffic.keep_files(&room.path("kept")).unwrap();
    let kept = fs::read_to_string(room.path("kept/global.actuated.add.xml")).unwrap();
    assert!(!kept.contains("edgeData"));
    assert_eq!(fs::read_to_string(room.victim()).unwrap(), "precious");
}

/// Broken nets, on which SUMO aborts, reads foreign memory, complains or goes on in silence.
const BROKEN: [Damage; 38] = [
    damage(NET, r#"<request index="0" response="0000" foes="1010" cont="0"/>"#, ""),
    damage(NET, r#"<request index="3""#, r#"<request index="99999""#),
    damage(NET, r#"response="0000""#, r#"response="""#),
    damage(NET, r#"foes="1010""#, r#"foes="101010101010101010101010""#),
    damage(NET, r#"length="100.00""#, r#"length="nan""#),
    damage(NET, r#"length="100.00""#, r#"length="-1""#),
    damage(NET, r#"length="100.00""#, r#"length="0""#),
    damage(NET, r#"length="100.00""#, r#"length="1e308""#),
    damage(NET, r#"length="18.80""#, r#"length="inf""#),
    damage(NET, r#"speed="10.00""#, r#"speed="nan""#),
    damage(NET, r#"speed="10.00""#, r#"speed="-5""#),
    damage(NET, r#"index="0" speed"#, r#"index="4294967296" speed"#),
    damage(NET, r#"shape="-1.60,9.40 -1.60,-9.40""#, r#"shape="""#),
    damage(NET, r#"shape="-1.60,9.40 -1.60,-9.40""#, r#"shape="nan,nan nan,nan""#),
    damage(NET, r#"id=":r0c0_1""#, r#"id=":r0c0_0""#),
    damage(NET, r#"<lane id=":r0c0_1_0""#, r#"<lane id=":r0c0_0_0""#),
    damage(NET, r#"<junction id="e1""#, r#"<junction id="e0""#),
    damage(NET, r#"<tlLogic id="r0c1""#, r#"<tlLogic id="r0c0""#),
    damage(NET, r#"intLanes=":r0c0_0_0 "#, r#"intLanes=":nowhere_0_0 "#),
    damage(NET, r#"incLanes=""#, r#"incLanes="nowhere_0 "#),
    damage(NET, r#"via=":r0c0_0_0""#, r#"via=":nowhere_0_0""#),
    damage(NET, r#"tl="r0c0""#, r#"tl="nowhere""#),
    damage(NET, r#"linkIndex="0""#, r#"linkIndex="100000""#),
    damage(NET, r#"linkIndex="0""#, r#"linkIndex="-7""#),
    damage(NET, r#"fromLane="0""#, r#"fromLane="9""#),
    damage(NET, r#"toLane="0""#, r#"toLane="-1""#),
    damage(NET, r#"from="w0" to="r0c0""#, r#"from="w0" to="w0""#),
    damage(NET, r#"state="GrGr""#, r#"state="""#),
    damage(NET, r#"state="GrGr""#, r#"state="G""#),
    damage(NET, r#"duration="10""#, r#"duration="-10""#),
    damage(NET, r#"type="static""#, r#"type="delay_based""#),
    damage(NET, r#"type="traffic_light""#, r#"type="internal""#),
    damage(NET, "<net ", r#"<net version="x" "#),
    damage(ROUTES, r#"edges="w0_r0c0 "#, r#"edges="nowhere "#),
    damage(ROUTES, r#"decel="7.5""#, r#"decel="nan""#),
    damage(ROUTES, r#"probability="0.1""#, r#"probability="1e9""#),
    damage(ACTUATED, r#"minDur="8""#, r#"minDur="99999999999999999999""#),
    damage(ACTUATED, "<phase", "<phas"),
];

#[test]
fn broken_networks_are_one_error_that_names_the_file() {
    let room = Room::new();
    let config = room.path("c.toml").display().to_string();
    let baseline = ["baseline", &config, "--controller", "actuated", "--episodes", "1"];
    for broken in &BROKEN {
        let file = room.damage("nets/grid_2x2", broken);
        room.assert_refused(&[&baseline], &file, "");
        room.restore("grid_2x2", "nets/grid_2x2");
    }
}

#[test]
fn what_only_sumo_can_judge_is_tried_in_another_process() {
    let room = Room::new();
    let config = room.path("c.toml").display().to_string();
    let baseline = ["baseline", &config, "--controller", "never", "--episodes", "1"];
    // Harmless: a name for a junction, and another version of netconvert.
    for (from, to) in
        [(r#"<junction id="e0""#, r#"<junction name="Main St" id="e0""#), ("<net ", "<net walkingareas=\"1\" ")]
    {
        room.damage("nets/grid_2x2", &damage(NET, from, to));
        room.command(&baseline).assert().success();
        room.restore("grid_2x2", "nets/grid_2x2");
    }
    let file = room.damage("nets/grid_2x2", &damage(NET, "origBoundary=\"-", "origBoundary=\"x"));
    let train = ["train", &config, "--out", "run"];
    room.assert_refused(&[&baseline, &train], &file, "Attribute 'origBoundary' in definition of a location");
}

#[test]
fn an_error_in_a_local_net_of_any_name_has_its_path_and_the_command_that_makes_another() {
    let room = Room::new();
    room.restore("local", "nets/cross");
    let text = fs::read_to_string(room.path("c.toml")).unwrap().replace("nets/local", "nets/cross");
    fs::write(room.path("c.toml"), text).unwrap();
    let file = room.damage("nets/cross", &damage(NET, "origBoundary=\"-", "origBoundary=\"x"));
    let config = room.path("c.toml").display().to_string();
    let baseline = ["baseline", &config, "--controller", "never", "--episodes", "1"];
    let told = "cross.net.xml: this network cannot be simulated; make one with: dials-traffic nets local --out DIR";
    room.assert_refused(&[&baseline], &file, told);
    let said = String::from_utf8(room.command(&baseline).output().unwrap().stderr).unwrap();
    assert!(said.contains("Attribute 'origBoundary'") && !said.contains("/proc/self/fd"), "{said}");
}

/// Runs a command and returns how many processes of the program there were, itself included.
fn processes_of(room: &Room, words: &[&str]) -> usize {
    // A copy that no other test starts. The system opens it once for each process. Another process makes it: a test beside this
    // one, which starts a program meanwhile, would hold it open for writing, and then nobody could start it.
    let program = room.path("program");
    Command::new("cp").arg(env!("CARGO_BIN_EXE_dials-traffic")).arg(&program).assert().success();
    let watch = inotify::init(inotify::CreateFlags::NONBLOCK | inotify::CreateFlags::CLOEXEC).unwrap();
    // Without reads in between, the system would count two openings as one.
    inotify::add_watch(&watch, &program, inotify::WatchFlags::OPEN | inotify::WatchFlags::ACCESS).unwrap();
    let mut command = Command::new(&program);
    command.args(words).current_dir(room.path("here")).timeout(Duration::from_secs(120)).assert().success();
    let mut buffer = [MaybeUninit::uninit(); 4096];
    let mut events = inotify::Reader::new(&watch, &mut buffer);
    let mut openings = 0;
    while let Ok(event) = events.next() {
        openings += usize::from(event.events().contains(inotify::ReadFlags::OPEN));
    }
    openings
}

#[test]
fn a_strange_network_is_tried_once_per_command() {
    let room = Room::new();
    room.damage("nets/grid_2x2", &damage(NET, r#"<junction id="e0""#, r#"<junction name="Main St" id="e0""#));
    let config = room.path("c.toml").display().to_string();
    let (run, pictures) = (room.path("run").display().to_string(), room.path("pictures").display().to_string());
    for words in [
        &["train", &config, "--out", &run, "--workers", "0"][..],
        &["evaluate", &run, "--episodes", "1", "--plot", &pictures],
        &["baseline", &config, "--compare", &format!("never,{run}"), "--episodes", "1"],
        &["baseline", &config, "--controller", "never", "--episodes", "1", "--plot", &format!("{pictures}2")],
        &["replay", &run, "--out", &room.path("replay").display().to_string()],
    ] {
        // The run has its own copy of the networks, so a comparison with it has two scenarios to try.
        let trials = if words.contains(&"--compare") { 2 } else { 1 };
        assert_eq!(processes_of(&room, words), 1 + trials, "{words:?}");
    }
}

#[test]
fn a_trial_has_a_limit_on_its_memory() {
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_dials-traffic"));
    let mut trial = command.arg("try-out").stdin(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    // It waits for its config now, with the limit or before it.
    let limits = format!("/proc/{}/limits", trial.id());
    let begun = Instant::now();
    loop {
        let text = fs::read_to_string(&limits).unwrap();
        let memory = text.lines().find_map(|line| line.strip_prefix("Max address space")).unwrap();
        let most: Option<u64> = memory.split_whitespace().nth(1).unwrap().parse().ok();
        if most.is_some_and(|bytes| (4 << 30..64 << 30).contains(&bytes)) {
            break;
        }
        assert!(begun.elapsed() < Duration::from_secs(60), "{text}");
        std::thread::sleep(Duration::from_millis(5));
    }
    drop(trial.stdin.take());
    assert!(!trial.wait().unwrap().success(), "it had no config");
}

#[test]
fn elements_in_another_order_do_not_crash_the_program() {
    let room = Room::new();
    let config = room.path("c.toml").display().to_string();
    let baseline = ["baseline", &config, "--controller", "actuated", "--episodes", "1"];
    let path = room.path("nets/grid_2x2.net.xml");
    let net = fs::read_to_string(&path).unwrap();
    let moved_to_the_front = |begin: &str, end: &str| {
        let from = net.find(begin).unwrap();
        let to = from + net[from..].find(end).unwrap() + end.len();
        let front = net.find("<edge ").unwrap();
        [&net[..front], &net[from..to], &net[front..from], &net[to..]].concat()
    };
    // SUMO needs the edges before their connections, and dies without them.
    for changed in
        [moved_to_the_front("<connection ", "/>"), moved_to_the_front("<junction id=\"r0c0\"", "</junction>")]
    {
        fs::write(&path, changed).unwrap();
        let output = room.command(&baseline).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        let refused = output.status.code() == Some(2) && said.contains("nets/grid_2x2.net.xml");
        assert!(refused || output.status.success(), "{}: {said}", output.status);
    }
}

#[test]
fn a_file_without_end_is_refused_at_once() {
    let room = Room::new();
    let config = room.path("c.toml").display().to_string();
    let baseline = ["baseline", &config, "--controller", "actuated", "--episodes", "1"];
    let net = room.path("nets/grid_2x2.net.xml");
    let refused = |content: &[u8], told: &str| {
        fs::write(&net, content).unwrap();
        room.assert_refused(&[&baseline], &net, told);
    };
    refused(["<a>".repeat(500_000), "</a>".repeat(500_000)].concat().as_bytes(), "elements inside of elements");
    let attributes: String = (0..300_000).map(|number| format!(" a{number}=''")).collect();
    refused(format!("<net{attributes}/>").as_bytes(), "more than 256 attributes");
    let bomb = "<!DOCTYPE net [<!ENTITY a 'xxxxxxxx'><!ENTITY b '&a;&a;&a;&a;&a;&a;&a;&a;'>]><net>&b;</net>";
    refused(bomb.as_bytes(), "document type");
    refused(b"<net \xff/>", "not UTF-8 text from byte 5 on");
    refused(b"\x1f\x8b\x08\x00", "it is packed with gzip, but damaged");
    refused(b"", "is not XML");
    let spaces: String = (0..50_000).map(|number| format!("<a xmlns:q{number}='u'>")).collect();
    refused(spaces.as_bytes(), "namespaces");
    // 300 MB that take no room on the disk.
    fs::remove_file(&net).unwrap();
    File::create(&net).unwrap().set_len(300 << 20).unwrap();
    let output = room.command(&baseline).output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.code() == Some(2) && said.contains("has more than 268435456 bytes"), "{said}");
    // Neither a device nor a pipe is read.
    for place in ["/dev/zero", "pipe"] {
        fs::remove_file(&net).unwrap();
        match place {
            "pipe" => {
                rustix::fs::mknodat(rustix::fs::CWD, &net, rustix::fs::FileType::Fifo, 0o600.into(), 0).unwrap();
            }
            place => symlink(place, &net).unwrap(),
        }
        let output = room.command(&baseline).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.code() == Some(2) && said.contains("grid_2x2.net.xml"), "{said}");
    }
}

#[test]
fn timings_without_end_are_refused() {
    let room = Room::new();
    let config = room.path("c.toml").display().to_string();
    let mut file = File::create(room.path("t.toml")).unwrap();
    file.write_all("offsets = [".repeat(200_000).as_bytes()).unwrap();
    let controller = format!("fixed-time:file={}", room.path("t.toml").display());
    let baseline = ["baseline", &config, "--controller", &controller, "--episodes", "1"];
    room.assert_refused(&[&baseline], &room.path("t.toml"), "has more than 1048576 bytes, the limit");
    fs::write(room.path("t.toml"), format!("offsets = {}", "[".repeat(200_000))).unwrap();
    room.assert_refused(&[&baseline], &room.path("t.toml"), "is not a file of tuned timings");
}

#[test]
fn without_a_temporary_directory_the_error_names_it() {
    let room = Room::new();
    let config = room.path("c.toml").display().to_string();
    let nowhere = room.path("nowhere").display().to_string();
    // Training needs none.
    let train = ["train", &config, "--out", "../run", "--workers", "0"];
    room.command(&train).env("TMPDIR", &nowhere).assert().success();
    let told = format!("{nowhere}: temporary files cannot be written there (entity not found); set TMPDIR");
    let commands: [&[&str]; 3] = [
        &["baseline", &config, "--controller", "actuated", "--episodes", "1"],
        &["nets", "local", "--out", "nets"],
        &["bench", &config, "--seconds", "1", "--workers", "1"],
    ];
    for words in commands {
        let output = room.command(words).env("TMPDIR", &nowhere).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(matches!(output.status.code(), Some(1 | 2)), "{said}");
        assert!(said.contains(&told) && !said.contains("cannot be simulated"), "{words:?}: {said}");
    }
}
