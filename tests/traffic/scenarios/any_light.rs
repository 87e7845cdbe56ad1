//! One policy for any light: as a controller, as a file, and on networks that are the same in other words.

use std::fs;
use std::path::Path;

use dials_core::base::Seed;
use dials_core::domain::Domain;

use super::play::{dials_traffic, json, opened, shipped};

/// Settings of a run whose policy fits any light, on ten minutes of the town.
/// With this seed, lanes are red for more than 120 s.
const OF_ANY: [&str; 8] = [
    "seed=3",
    "traffic.observation=lanes",
    "traffic.end_s=600",
    "policy.share=kind",
    "policy.hidden=[8,8]",
    "total_steps=240",
    "evaluation.every_steps=240",
    "evaluation.final_episodes=1",
];

type Change = fn(&str) -> String;

/// Plays an episode. Returns the returns of all lights by their names, and the mean delay in seconds.
fn played(scenario: &Path, controller: &str) -> (Vec<(String, f64)>, f64) {
    let traffic = opened(scenario, 900);
    let mut baseline = traffic.baseline(controller).unwrap();
    let gs = &mut *baseline.simulator;
    gs.measure_in_full().unwrap();
    gs.reset(Seed::new(5)).unwrap();
    let mut returns = vec![0.0; traffic.agents()];
    for _ in 0..traffic.kinds().horizon() {
        let rewards = &gs.step(&vec![0; traffic.agents()]).unwrap().rewards;
        returns.iter_mut().zip(rewards).for_each(|(sum, &reward)| *sum += f64::from(reward));
    }
    let measures = gs.measures().unwrap();
    let delay_s = measures.system.iter().find(|(name, _)| name == "delay_s").unwrap().1;
    let names = traffic.plans().iter().map(|plan| plan.light.clone());
    let mut returns: Vec<(String, f64)> = names.zip(returns).collect();
    returns.sort_by(|one, other| one.0.cmp(&other.0));
    (returns, delay_s)
}

/// Returns a text with the values of an XML attribute changed.
fn with_attribute(text: &str, name: &str, change: impl Fn(&str) -> String) -> String {
    let attribute = format!(" {name}=\"");
    let mut parts = text.split(&attribute);
    let first = parts.next().unwrap().to_owned();
    parts.fold(first, |text, part| {
        let (value, rest) = part.split_once('"').unwrap();
        format!("{text}{attribute}{}\"{rest}", change(value))
    })
}

/// Returns the net with all programs in the opposite order.
fn reordered(net: &str) -> String {
    let begin = net.find("<tlLogic").unwrap();
    let end = net.rfind("</tlLogic>").unwrap() + "</tlLogic>".len();
    let mut programs: Vec<&str> = net[begin..end].split_inclusive("</tlLogic>").map(str::trim).collect();
    programs.reverse();
    format!("{}{}{}", &net[..begin], programs.join("\n"), &net[end..])
}

/// Returns the net with other names of its lights, in another order of the alphabet.
fn renamed(net: &str) -> String {
    let new_name = |name: &str| name.chars().rev().collect::<String>() + "_light";
    let net = with_attribute(net, "tl", new_name);
    let mut parts = net.split("<tlLogic id=\"");
    let first = parts.next().unwrap().to_owned();
    parts.fold(first, |text, part| {
        let (name, rest) = part.split_once('"').unwrap();
        format!("{text}<tlLogic id=\"{}\"{rest}", new_name(name))
    })
}

/// Returns a number, or the first one of several, with the other sign.
fn minus(number: &str) -> String {
    number.strip_prefix('-').map_or_else(|| format!("-{number}"), str::to_owned)
}

/// Returns the net turned to the left by a right angle.
fn rotated(net: &str) -> String {
    let turned = |points: &str| {
        let points = points.split_whitespace().map(|point| {
            let (x, y) = point.split_once(',').unwrap();
            format!("{},{x}", minus(y))
        });
        points.collect::<Vec<_>>().join(" ")
    };
    let net = with_attribute(net, "shape", turned);
    let net = net.replace(" x=\"", " old_x=\"").replace(" y=\"", " x=\"").replace(" old_x=\"", " y=\"");
    with_attribute(&net, "x", minus)
}

/// Returns the net in a mirror: traffic keeps left, and left turns are right turns.
fn mirrored(net: &str) -> String {
    let turned = |points: &str| points.split_whitespace().map(minus).collect::<Vec<_>>().join(" ");
    let net = with_attribute(&with_attribute(net, "shape", turned), "x", minus);
    let other_side = |direction: &str| {
        let sides = [("l", "r"), ("r", "l"), ("L", "R"), ("R", "L")];
        sides.iter().find(|side| side.0 == direction).map_or(direction, |side| side.1).to_owned()
    };
    with_attribute(&net, "dir", other_side).replacen("<net ", "<net lefthand=\"true\" ", 1)
}

#[test]
fn networks_that_are_reordered_renamed_rotated_or_mirrored_give_the_same_delay_to_the_last_digit() {
    let town = shipped("town");
    let folder = town.parent().unwrap();
    let controller = "any-light:choice=greedy";
    let (returns, delay_s) = played(&town, controller);
    let changes: [(&str, Change); 4] =
        [("reordered", reordered), ("renamed", renamed), ("rotated", rotated), ("mirrored", mirrored)];
    let net = fs::read_to_string(folder.join("town.net.xml")).unwrap();
    for (name, change) in changes {
        let dir = tempfile::tempdir().unwrap();
        for file in ["town.rou.xml", "town.sumocfg"] {
            fs::copy(folder.join(file), dir.path().join(file)).unwrap();
        }
        let changed = change(&net);
        assert_ne!(changed, net);
        fs::write(dir.path().join("town.net.xml"), changed).unwrap();
        let (found, found_delay_s) = played(&dir.path().join("town.sumocfg"), controller);
        assert_eq!(found_delay_s, delay_s, "{name}");
        if name == "renamed" {
            assert_ne!(found[0].0, returns[0].0);
        } else {
            assert_eq!(found, returns, "{name}");
        }
    }
    assert_ne!(played(&town, "max-pressure").1, delay_s);
}

#[test]
fn a_run_becomes_a_file_that_plays_like_it() {
    let dir = tempfile::tempdir().unwrap();
    let (run, file) = (dir.path().join("run"), dir.path().join("any.safetensors"));
    let config = shipped("town").with_extension("sumocfg");
    let settings = OF_ANY.iter().flat_map(|setting| ["--set", setting]);
    let mut train = dials_traffic();
    train.arg("train").arg(&config).args(settings).arg("--out").arg(&run).arg("--quiet").assert().success();
    dials_traffic().arg("export").arg(&run).arg("--out").arg(&file).assert().success();

    let delay = |command: &[&str]| {
        let options = ["--episodes", "1", "--json"];
        let output = dials_traffic().args(command).args(options).assert().success();
        json(&output.get_output().stdout)["delay_s"].as_f64().unwrap()
    };
    let short = dir.path().join("short.toml");
    fs::write(&short, format!("[traffic]\nscenario = '{}'\nend_s = 600\n", config.display())).unwrap();
    let [run, file, short] = [&run, &file, &short].map(|path| path.to_str().unwrap());
    // A lane that is red for long is the controller's own care.
    let [as_network, as_controller] = [3600, 120].map(|longest_red| {
        let controller = format!("any-light:file={file},choice=greedy,longest-red={longest_red}");
        delay(&["baseline", short, "--controller", &controller])
    });
    assert_eq!(as_network, delay(&["evaluate", run, "--greedy"]));
    assert_eq!(as_controller, delay(&["evaluate", file, "--on", short, "--greedy"]));
    assert_ne!(as_controller, as_network);

    // The run alone is enough for a plan, too.
    let plan = dir.path().join("plan");
    let options = ["--episodes", "1", "--watch-episodes", "1", "--out", plan.to_str().unwrap()];
    dials_traffic().args(["plan", run]).args(options).assert().success();
    assert!(fs::read_to_string(plan.join("programs.add.xml")).unwrap().contains("programID=\"learned\""));

    // Another run starts from it, and keeps it.
    let (next, given) = (dir.path().join("next"), dir.path().join("given.safetensors"));
    fs::copy(file, &given).unwrap();
    let named = format!("traffic.any_light='{}'", given.display());
    let begin = |settings: &[&str]| {
        let mut train = dials_traffic();
        let settings = OF_ANY.iter().chain(settings).flat_map(|setting| ["--set", setting]);
        train
            .args(["train", short, "--steps", "120", "--quiet", "--out", next.to_str().unwrap()])
            .args(settings)
            .assert()
    };
    let refused = begin(&[&named]).code(2);
    let why = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(why.contains("traffic.any_light: set policy.start = \"any-light\", too"), "{why}");
    begin(&[&named, "policy.start='any-light'", "evaluation.episodes=1"]).success();
    fs::remove_file(given).unwrap();
    let returns = || fs::read_to_string(next.join("returns.csv")).unwrap();
    let at_the_beginning = returns().lines().find_map(|line| line.strip_prefix("0,all,").map(str::to_owned)).unwrap();
    let controller = format!("any-light:file={file},longest-red=3600");
    let output =
        dials_traffic().args(["baseline", short, "--controller", &controller, "--episodes", "1", "--json"]).assert();
    let mean = json(&output.success().get_output().stdout)["mean_return"].as_f64().unwrap();
    assert_eq!(at_the_beginning.split(',').next().unwrap(), format!("{mean:.4}"));
    dials_traffic().args(["train", "--quiet", "--steps", "240", "--resume"]).arg(&next).assert().success();
    let kept = next.join("networks/any_light.safetensors");
    assert_eq!(fs::read(&kept).unwrap(), fs::read(file).unwrap());
    fs::write(&kept, "").unwrap();
    let refused = dials_traffic().arg("evaluate").arg(&next).assert().code(2);
    let why = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(why.contains("any_light.safetensors"), "{why}");

    let error = |command: &[&str]| {
        let output = dials_traffic().args(command).assert().code(2);
        String::from_utf8_lossy(&output.get_output().stderr).replace(dir.path().to_str().unwrap(), "DIR")
    };
    assert!(error(&["evaluate", run, "--on", short]).contains("DIR/run: is a run directory; `export` writes"));
    let policies = format!("{run}/policies.safetensors");
    assert!(error(&["evaluate", &policies, "--on", short]).contains("holds no policy for any light"));
    assert!(error(&["evaluate", "nothing.safetensors", "--on", short]).contains("nothing.safetensors: cannot be read"));
}

#[test]
fn a_run_starts_from_the_policy_of_this_program() {
    let dir = tempfile::tempdir().unwrap();
    let (run, short) = (dir.path().join("run"), dir.path().join("short.toml"));
    fs::write(&short, format!("[traffic]\nscenario = '{}'\nend_s = 600\n", shipped("town").display())).unwrap();
    let start = |more: &[&'static str]| {
        let length = ["total_steps=60", "ppo.memory=60", "evaluation.every_steps=60", "evaluation.final_episodes=1"];
        let settings = ["policy.start=any-light", "evaluation.episodes=1"].into_iter().chain(more.iter().copied());
        let settings = length.into_iter().chain(settings);
        let mut train = dials_traffic();
        train.arg("train").arg(&short).args(settings.flat_map(|setting| ["--set", setting]));
        train.arg("--out").arg(&run).arg("--quiet").assert()
    };
    let refused = start(&["policy.hidden=[8,8]"]).code(2);
    let why = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(why.contains("that is another network; set traffic.observation = \"lanes\""), "{why}");
    // Its layers, what it sees and how often it decides come with it. So do the cars that it does not see, but not in local simulators.
    let partial = format!(
        ",seen=0,file={}",
        Path::new(env!("CARGO_MANIFEST_DIR")).join("models/any_light_partial.safetensors").display()
    );
    let views: [(&[&str], &str, u32); 4] = [
        (&[], "", 2),
        (&["traffic.seen_cars=0.5"], ",seen=0.5", 5),
        (&["traffic.seen_cars=[0.5,0.5]"], ",seen=0.5", 5),
        (&["traffic.seen_cars=0"], &partial, 5),
    ];
    for (settings, seen, decision_s) in views {
        start(settings).success();
        let returns = fs::read_to_string(run.join("returns.csv")).unwrap();
        let at_the_beginning = returns.lines().find_map(|line| line.strip_prefix("0,all,")).unwrap();
        let controller = format!("any-light:longest-red=3600,hold=1{seen}");
        let mut baseline = dials_traffic();
        baseline.arg("baseline").arg(&short).args(["--controller", &controller, "--episodes", "1", "--json"]);
        baseline.args(["--set", &format!("traffic.decision_s={decision_s}")]);
        let mean = json(&baseline.assert().success().get_output().stdout)["mean_return"].as_f64().unwrap();
        assert_eq!(at_the_beginning.split(',').next().unwrap(), format!("{mean:.4}"));
        fs::remove_dir_all(&run).unwrap();
    }
    let refused = start(&["traffic.seen_cars=[1,0.5]", "simulator=local"]).code(2);
    let why = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(why.contains("traffic.seen_cars: which cars are seen is drawn by their names"), "{why}");
    let mut baseline = dials_traffic();
    let refused = baseline.arg("baseline").arg(&short).args(["--controller", "any-light:seen=0"]).assert().code(2);
    let why = String::from_utf8_lossy(&refused.get_output().stderr).into_owned();
    assert!(why.contains("no policy of this program sees detectors only"), "{why}");
}
