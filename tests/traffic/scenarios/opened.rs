//! What is said when a command begins: of a run directory whose scenario was changed, and of lights that cannot have a
//! local simulator.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;

use super::room::{CARS, MORE, NET, Room, SUMOCFG};

/// A short training on the global simulator.
const CONFIG: &str = "simulator = 'gs'\ntotal_steps = 60\n[traffic]\nscenario = 'x.sumocfg'\nagents = 'agents.toml'\n\
                      [policy]\nhidden = [4]\n\
                      [ppo]\nrollout_steps = 20\nmemory = 20\nminibatch = 20\nepochs = 1\n\
                      [evaluation]\nevery_steps = 60\nepisodes = 1\nfinal_episodes = 1\n";

fn dials_traffic() -> Command {
    assert_cmd::cargo::cargo_bin_cmd!("dials-traffic")
}

/// Returns what a command that is refused says.
fn refused(command: &mut Command) -> String {
    String::from_utf8(command.assert().code(2).get_output().stderr.clone()).unwrap()
}

fn trained(room: &Room) -> PathBuf {
    fs::write(room.path("c.toml"), CONFIG).unwrap();
    fs::write(room.path("agents.toml"), "keep = [\"r1c1\"]\n").unwrap();
    let run = room.path("run");
    dials_traffic()
        .arg("train")
        .arg(room.path("c.toml"))
        .arg("--out")
        .arg(&run)
        .args(["--workers", "1"])
        .assert()
        .success();
    run
}

/// Replaces a text in a file and returns the file as it was.
fn edit(file: &Path, from: &str, to: &str) -> String {
    let text = fs::read_to_string(file).unwrap();
    assert!(text.contains(from), "{from} is not in {}", file.display());
    fs::write(file, text.replacen(from, to, 1)).unwrap();
    text
}

#[test]
fn everything_that_opens_a_run_notices_a_scenario_that_was_changed_since() {
    let room = Room::new();
    let run = trained(&room);
    let evaluate = || {
        let mut command = dials_traffic();
        command.arg("evaluate").arg(&run).args(["--episodes", "1"]);
        command
    };
    evaluate().assert().success();
    let check = || {
        let mut command = dials_traffic();
        command.arg("check").arg(run.join("config.toml")).args(["--from", "0", "--seconds", "30", "--sigma", "0"]);
        command
    };
    check().assert().success();
    // A remark changes nothing that SUMO reads.
    let routes = run.join("networks/scenario.1.rou.xml");
    let original = edit(&routes, "<routes>", "<routes><!-- a remark -->");
    evaluate().assert().success();
    fs::write(&routes, original).unwrap();

    for (file, from, to, told) in [
        ("networks/scenario.1.rou.xml", "period=\"8\"", "period=\"9\"", "networks/scenario.1.rou.xml: \""),
        ("networks/scenario.net.xml", "speed=\"10.00\"", "speed=\"10.50\"", "networks/scenario.net.xml: \""),
        ("networks/agents.toml", "keep", "# by hand\nkeep", "networks/agents.toml: \""),
        ("config.toml", "end_s = 400", "end_s = 390", "traffic.end_s: 400 there, 390 here"),
        ("config.toml", "observation = \"cells\"", "observation = \"queues\"", "traffic.observation: \"cells\" there"),
    ] {
        let original = edit(&run.join(file), from, to);
        let mut others = [(); 4].map(|()| dials_traffic());
        let [export, replay, controller, compare] = &mut others;
        export.arg("export").arg(&run).arg("--out").arg(room.path("policies.pt"));
        replay.arg("replay").arg(&run).arg("--out").arg(room.path("replay"));
        controller.arg("replay").arg(&run).args(["--controller", "program", "--out"]).arg(room.path("replay"));
        compare.arg("baseline").arg(room.path("c.toml")).args(["--episodes", "1", "--compare"]).arg(&run);
        let others = others.iter_mut().skip(usize::from(!cfg!(feature = "torch"))); // `export` needs libtorch.
        for command in [&mut evaluate(), &mut check()].into_iter().chain(others) {
            let said = refused(command);
            assert!(said.contains("run.json: was written with other settings or networks"), "{file}: {said}");
            assert!(said.contains(told) && said.contains("put them back"), "{file}: {said}");
            assert!(!said.contains("scenario.checksum: "), "{file}: the file or the key says more: {said}");
        }
        fs::write(run.join(file), original).unwrap();
    }
    assert!(!room.path("replay").exists() && !room.path("policies.pt").exists());
}

/// Makes the light r0c0 control a connection of the junction r0c1. So the regions of both hold a light of the other.
fn tangle(room: &Room) {
    let link = "from=\"e0_r0c1\" to=\"r0c1_r0c0\" fromLane=\"0\" toLane=\"0\" via=\":r0c1_1_0\" tl=";
    room.change(NET, &format!("{link}\"r0c1\""), &format!("{link}\"r0c0\""));
}

#[test]
fn lights_that_cannot_have_a_local_simulator_are_all_named_before_a_run_begins() {
    let room = Room::new();
    tangle(&room);
    let scenario = room.path(SUMOCFG);
    let train = |more: &[&str]| {
        let mut command = dials_traffic();
        command.arg("train").arg(&scenario).arg("--out").arg(room.path("run")).args(["--workers", "1"]).args(more);
        command
    };
    let mut bench = dials_traffic();
    bench.arg("bench").arg(&scenario).args(["--seconds", "1", "--set", "simulator=dials"]);
    for command in [&mut train(&["--simulator", "dials"]), &mut bench] {
        let said = refused(command);
        assert!(said.contains("net.net.xml: 2 of 4 lights cannot have a local simulator:\n  light `r0c0`: "), "{said}");
        assert!(said.contains("\n  light `r0c1`: its region holds ") && said.contains("--simulator gs"), "{said}");
    }
    assert!(!room.path("run").exists());
    // The whole network needs no local simulator.
    let mut baseline = dials_traffic();
    baseline.arg("baseline").arg(&scenario).args(["--controller", "program", "--episodes", "1"]).assert().success();
    let short = [
        "total_steps=20",
        "local_simulators.copies=1",
        "policy.hidden=[4]",
        "ppo.rollout_steps=20",
        "ppo.memory=20",
        "ppo.minibatch=20",
        "aip.hidden=[4]",
        "aip.dataset_steps=120",
        "aip.epochs=1",
        "aip.batch=30",
        "evaluation.episodes=1",
        "evaluation.final_episodes=1",
    ];
    let settings: Vec<&str> = short.iter().flat_map(|setting| ["--set", setting]).collect();
    train(&[&settings[..], &["--simulator", "gs"]].concat()).assert().success();
    fs::remove_dir_all(room.path("run")).unwrap();
    // The other way out that the message names.
    fs::write(room.path("agents.toml"), "keep = [\"r0c0\", \"r0c1\"]\n").unwrap();
    let agents = format!("traffic.agents={}", room.path("agents.toml").display());
    train(&[&settings[..], &["--simulator", "dials", "--set", &agents]].concat()).assert().success();
    assert!(room.path("run/aips.safetensors").is_file(), "it trained on local simulators");
    // `replay` itself compares what SUMO plays with what was recorded.
    let replay = room.path("replay");
    let mut command = dials_traffic();
    command.arg("replay").arg(room.path("run")).args(["--local", "1", "--out"]).arg(&replay);
    command.arg("--plot").arg(room.path("plots"));
    let said = String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap();
    // An episode of the local simulators is not longer than the scenario: 60 decisions of 5 s.
    assert!(said.contains(": 300 seconds, "), "{said}");
    let net = fs::read_to_string(replay.join("replay.net.xml")).unwrap();
    let signals = fs::read_to_string(room.path("plots/signals.svg")).unwrap();
    assert!(signals.contains("run in its local simulator, first episode of seed "), "{signals}");
    assert!(net.contains("<tlLogic id=\"r1c1\"") && !net.contains("<tlLogic id=\"r1c0\""), "the net of one light");
}

#[test]
fn lights_that_keep_their_program_for_the_same_reason_share_one_note() {
    let room = Room::new();
    fs::write(room.path("c.toml"), CONFIG).unwrap();
    fs::write(room.path("agents.toml"), "keep = [\"r1c1\", \"r0c1\"]\n").unwrap();
    let mut baseline = dials_traffic();
    baseline.arg("baseline").arg(room.path("c.toml")).args(["--controller", "program", "--episodes", "1"]);
    let said = String::from_utf8(baseline.assert().success().get_output().stderr.clone()).unwrap();
    let notes: Vec<&str> = said.lines().filter(|line| line.contains(" keep")).collect();
    assert_eq!(notes.len(), 1, "{said}");
    assert!(notes[0].starts_with("note: 2 lights keep their program (`r0c1`, `r1c1`), each because "), "{said}");
}

/// SUMO's names of the files that this program hands to it mean nothing to a user.
#[test]
fn no_error_shows_a_file_in_memory_and_a_scenario_may_have_a_program_called_actuated() {
    let room = Room::new();
    let more = |text: &str| room.change(MORE, "</additional>", &format!("{text}</additional>"));
    let mut baseline = dials_traffic();
    baseline.arg("baseline").arg(room.path(SUMOCFG)).args(["--controller", "actuated", "--episodes", "1"]);
    more(
        "<tlLogic id=\"r0c0\" type=\"static\" programID=\"actuated\" offset=\"0\">\
         <phase duration=\"20\" state=\"GrGr\"/><phase duration=\"3\" state=\"yryr\"/>\
         <phase duration=\"20\" state=\"rGrG\"/><phase duration=\"3\" state=\"ryry\"/></tlLogic>",
    );
    baseline.assert().success();
    // A type that SUMO alone refuses.
    more("<vType id=\"odd\" carFollowModel=\"nobody\"/>");
    let said = refused(&mut baseline);
    assert!(said.contains("SUMO: Unknown car following model 'nobody' when parsing vType 'odd'"), "{said}");
    assert!(!said.contains("/proc/self/fd"), "{said}");
}

/// SUMO checks programs that it loads later more strictly than those of the net.
#[test]
fn a_net_whose_programs_sumo_takes_from_the_net_alone_can_be_used_without_actuated_lights() {
    let room = Room::new();
    // Cars from the south and from the west yield to each other, and have `g` at once.
    room.change(NET, "state=\"GrGr\"", "state=\"Grgg\"");
    for index in [2, 3] {
        let net = fs::read_to_string(room.path(NET)).unwrap();
        let (before, request) = net.split_once(&format!("<request index=\"{index}\" ")).unwrap();
        let (_, after) = request.split_once("/>").unwrap();
        let mutual = ["1000", "0100"][index - 2];
        let request = format!("<request index=\"{index}\" response=\"{mutual}\" foes=\"{mutual}\" cont=\"0\"/>");
        fs::write(room.path(NET), [before, &request, after].concat()).unwrap();
    }
    let baseline = |controller: &str| {
        let mut command = dials_traffic();
        command.arg("baseline").arg(room.path(SUMOCFG)).args(["--controller", controller, "--episodes", "1"]);
        command
    };
    baseline("program").assert().success();
    baseline("max-pressure").assert().success();
    let said = refused(&mut baseline("actuated"));
    let expected = "light `r0c0` gives `g` to the letters 2 and 3 at once, whose cars yield to each other";
    assert!(said.contains(expected) && said.contains("choose another controller"), "{said}");
}

#[test]
fn what_is_not_played_and_cars_that_may_vanish_are_told_when_a_command_begins() {
    let room = Room::new();
    room.change(CARS, "<vehicle id=\"v\" type=\"car\"", "<vehicle id=\"v\" type=\"car\" departSpeed=\"desired\"");
    room.change(CARS, "<trip id=\"t\" type=\"car\"", "<trip id=\"t\" type=\"car\" departSpeed=\"0.00\"");
    room.change(SUMOCFG, "<end value=\"400\"/>", "<end value=\"403\"/>");
    let mut inspect = dials_traffic();
    inspect.args(["nets", "inspect"]).arg(room.path(SUMOCFG));
    let output = inspect.assert().success().get_output().clone();
    let said = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
    let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("the last 3 s before 403 s are left out, because a decision takes 5 s"), "{said}");
    assert!(
        said.contains("<vehicle id=\"v\"> with departSpeed=\"desired\" (1 in this file): SUMO removes it"),
        "{said}"
    );
}
