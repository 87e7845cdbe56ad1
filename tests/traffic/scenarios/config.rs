//! The ways to name a scenario, and what is listed of it.

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use dials_learn::config::{Config, Simulator};
use dials_session::config::load;
use dials_traffic::scenario::SumoScenario;

use super::room::{Room, SUMOCFG, table};
use crate::plain_sumo;

#[test]
fn a_sumocfg_stands_for_a_config_with_default_settings() {
    let room = Room::new();
    let config = room.config(&["traffic.decision_s=10", "ppo.clip=0.3", "total_steps=40000"]).unwrap();
    assert_eq!((config.learning.simulator, config.horizon()), (Simulator::Global, 30));
    assert_eq!((config.learning.ppo.clip, config.learning.ppo.memory, config.learning.total_steps), (0.3, 120, 40_000));
    let table = table(config);
    assert_eq!((table.scenario, table.begin_s, table.end_s), (room.path(SUMOCFG), Some(100), Some(400)));
}

#[test]
fn defaults_last_as_many_seconds_where_lights_decide_more_often() {
    let room = Room::new();
    let config = |settings: &[&str]| room.config(settings).unwrap().learning;
    let (every_5_s, every_2_s) = (config(&[]), config(&["traffic.decision_s=2"]));
    let counts = |config: &Config| {
        let (ppo, aip) = (&config.ppo, &config.aip);
        let in_steps = [config.total_steps, config.evaluation.every_steps, aip.retrain_every_steps];
        (in_steps, [aip.dataset_steps, ppo.rollout_steps, ppo.memory, ppo.minibatch])
    };
    assert_eq!(counts(&every_5_s), ([216_000, 21_600, 54_000], [4320, 30, 120, 30]));
    assert_eq!(counts(&every_2_s), ([540_000, 54_000, 135_000], [10_800, 75, 300, 75]));
    // What comes in ten seconds counts as before: five decisions of 2 s, two of 5 s.
    assert!((every_2_s.ppo.gamma.powi(5) - every_5_s.ppo.gamma.powi(2)).abs() < 1e-12);
    // Rarer decisions would leave an update too few samples. Counts of one's own stay, and those that belong to them.
    assert_eq!(counts(&config(&["traffic.decision_s=10"])), counts(&every_5_s));
    let own = config(&["traffic.decision_s=2", "ppo.memory=600", "total_steps=1000"]);
    assert_eq!((own.ppo.memory, own.ppo.rollout_steps, own.total_steps), (600, 30, 1000));
}

#[test]
fn an_end_that_is_missing_or_absurd_follows_from_the_departures() {
    for end in ["", "<end value=\"99999999\"/>"] {
        let room = Room::new();
        room.change(SUMOCFG, "<end value=\"400\"/>", end);
        let scenario = room.read().unwrap();
        let (begin, end) = scenario.window_s();
        assert!(end % 60 == 0 && (begin + 600..begin + 7200).contains(&end), "{begin} to {end}");
        let note = format!("x.sumocfg: the episode ends at {end} s, because no end is named");
        assert!(scenario.notes().left_out.iter().any(|left| left.contains(&note)), "{:?}", scenario.notes().left_out);
    }
}

#[test]
fn a_parameter_that_only_names_an_output_is_left_out_with_a_note() {
    let room = Room::new();
    let light = "<tlLogic id=\"r0c0\" type=\"actuated\" programID=\"1\"><phase duration=\"9\" state=\"GGGG\"/>\
                 <param key=\"file\" value=\"NULL\"/></tlLogic></additional>";
    room.change(super::room::MORE, "</additional>", light);
    let scenario = room.read().unwrap();
    let note = "1 x <param key=\"file\">: this program measures and writes by itself";
    assert!(scenario.notes().left_out.iter().any(|left| left.contains(note)), "{:?}", scenario.notes().left_out);
    assert!(!scenario.additional().any(|root| format!("{root:?}").contains("NULL")));
}

#[test]
fn a_configuration_is_known_by_its_root_whatever_its_name_ends_in() {
    let room = Room::new();
    let other = room.path("x.sumo.cfg");
    fs::copy(room.path(SUMOCFG), &other).unwrap();
    assert_eq!(table(load(&other, &[]).unwrap()).scenario, other);
}

#[test]
fn a_config_names_a_scenario_beside_it_and_may_narrow_its_time() {
    let room = Room::new();
    fs::write(room.path("c.toml"), "[traffic]\nscenario = 'x.sumocfg'\nend_s = 200\nreward = { queue = 0.5 }\n")
        .unwrap();
    let config = load(&room.path("c.toml"), &[]).unwrap();
    assert_eq!(config.horizon(), 20);
    let kept = dials_session::config::to_toml(&config).unwrap();
    fs::write(room.path("kept.toml"), kept).unwrap();
    assert_eq!(load(&room.path("kept.toml"), &[]).unwrap(), config);
    assert_eq!(SumoScenario::read(&table(config)).unwrap().window_s(), (100, 200));
}

#[test]
fn a_config_that_names_nothing_but_a_scenario_is_a_sumocfg_in_other_words() {
    let room = Room::new();
    let written = |text: &str, settings: &[&str]| {
        fs::write(room.path("c.toml"), text).unwrap();
        load(&room.path("c.toml"), &settings.iter().map(|&setting| setting.to_owned()).collect::<Vec<_>>()).unwrap()
    };
    let bare = "[traffic]\nscenario = 'x.sumocfg'\n";
    let config = written(bare, &[]);
    assert_eq!(config, room.config(&[]).unwrap());
    assert_eq!(
        (config.learning.total_steps, config.learning.ppo.memory, config.learning.aip.patience),
        (216_000, 120, Some(3))
    );
    // Every key that is left out has the default of a scenario, also beside others of its table.
    let longer = written(&format!("{bare}[ppo]\nclip = 0.3\n"), &["ppo.epochs=4"]);
    assert_eq!((longer.learning.ppo.clip, longer.learning.ppo.epochs, longer.learning.ppo.memory), (0.3, 4, 120));
    // Who names the epochs and no patience wants all of them. So does the kept config of such a run.
    let patient = written(&format!("{bare}[aip]\nepochs = 9\n"), &[]);
    assert_eq!(
        (patient.learning.aip.epochs, patient.learning.aip.patience, patient.learning.aip.held_out),
        (9, None, 0.2)
    );
    assert_eq!(written(&dials_session::config::to_toml(&patient).unwrap(), &[]), patient);
    assert_eq!(room.config(&["aip.epochs=9"]).unwrap().learning.aip.patience, None);
    assert_eq!(room.config(&["aip.epochs=9", "aip.patience=2"]).unwrap().learning.aip.patience, Some(2));
    // A grid has the defaults of the paper.
    let grid = written("[traffic]\nnetwork = 'n'\nlocal_network = 'l'\n", &[]);
    assert_eq!((grid.learning.total_steps, grid.learning.aip.patience), (4_000_000, None));
}

#[test]
fn keys_of_the_other_way_are_refused() {
    let room = Room::new();
    for (table, told) in [
        ("horizon = 3", "traffic names nothing to simulate"),
        (
            "scenario = 'x.sumocfg'\nnetwork = 'n'",
            "traffic.network is for a grid, but the table names a .sumocfg by `scenario`; remove one of them",
        ),
        ("scenario = 'x.sumocfg'\nhorizon = 3", "traffic.horizon is for a grid"),
        (
            "network = 'n'\nlocal_network = 'l'\nyellow_s = 4",
            "traffic.yellow_s is for a scenario, but the table names a grid by `network`; remove one of them",
        ),
        ("network = 'n'", "missing field `local_network`: a grid needs `network` and `local_network`"),
        ("scenario = 'x.sumocfg'\nreward = 'money'", "`money` is no allowed value; allowed: `mean-speed`, "),
        ("scenario = 'x.sumocfg'\nsenario = 'y'", "unknown field `senario`"),
        ("scenario = 'x.sumocfg'\nbegin_s = 500", "traffic.begin_s = 500: must be before traffic.end_s = 400"),
        ("scenario = 'x.sumocfg'\ndecision_s = 301", "traffic.decision_s = 301: must be from 1 to 300 seconds"),
    ] {
        fs::write(room.path("c.toml"), format!("[traffic]\n{table}\n")).unwrap();
        let error = load(&room.path("c.toml"), &[]).unwrap_err().to_string();
        assert!(error.replace(['[', ']'], "").contains(told), "{table}: {error}");
    }
}

#[test]
fn what_is_not_simulated_is_listed() {
    let room = Room::new();
    let dir = room.dir.path().display();
    assert_eq!(
        room.read().unwrap().notes().left_out,
        [
            "option tripinfo-output: this program writes its own measurements".to_owned(),
            format!("{dir}/more.add.xml: 1 x <edgeData>: this program measures and writes by itself"),
            format!("{dir}/more.add.xml: 1 x <inductionLoop>: this program measures and writes by itself"),
            format!("{dir}/cars.rou.xml: 1 of its vehicles and flows depart before 100 s or from 400 s on"),
        ]
    );
}

#[test]
fn a_file_of_overrides_that_is_not_there_is_refused() {
    let room = Room::new();
    let config = room.config(&[&format!("traffic.agents={}", room.path("no.toml").display())]).unwrap();
    let error = format!("{:#}", SumoScenario::read(&table(config)).unwrap_err());
    assert!(error.contains("/no.toml: cannot be read; traffic.agents names it: No such file"), "{error}");
}

/// SUMO lists its options itself. A .sumocfg may set any of them, and this program has an answer to each.
#[test]
fn every_option_of_sumo_is_known() {
    let help = Command::new(plain_sumo()).arg("--help").output().unwrap();
    let help = String::from_utf8(help.stdout).unwrap();
    let long = |line: &str| {
        let (_, rest) = line.split_at_checked(2)?;
        let name = rest.split_once("--")?.1;
        Some(name.split_whitespace().next()?.to_owned())
    };
    let options: Vec<String> = help.lines().filter(|line| line.starts_with("  -")).filter_map(long).collect();
    assert!(options.len() > 300, "{}", options.len());
    let of_the_command_line = [
        "configuration-file",
        "save-configuration",
        "save-template",
        "save-schema",
        "save-commented",
        "help",
        "version",
    ];
    for option in options.iter().filter(|option| !of_the_command_line.iter().any(|other| option.starts_with(other))) {
        let room = Room::new();
        room.change(SUMOCFG, "<processing>", &format!("<processing><{option} value=\"7\"/>"));
        let known = room.config(&[]).map_or_else(|error| format!("{error:#}"), |_| String::new());
        assert!(!known.contains("no option of SUMO that this program knows"), "{option}: {known}");
    }
}

/// Real maps, where somebody has them: the variable names their folder.
#[test]
fn real_maps_are_read() {
    let Some(folder) = std::env::var_os("DIALS_NETWORKS").map(PathBuf::from) else {
        eprintln!("skipped: DIALS_NETWORKS names no folder with real maps");
        return;
    };
    for (map, begin) in
        [("cologne1", 25_200), ("cologne3", 25_200), ("ingolstadt1", 57_600), ("ingolstadt7", 57_600), ("grid4x4", 0)]
    {
        let config = load(&folder.join(format!("{map}/{map}.sumocfg")), &[]).unwrap();
        assert_eq!(config.horizon(), 720, "{map}");
        let scenario = SumoScenario::read(&table(config)).unwrap();
        assert_eq!(scenario.window_s(), (begin, begin + 3600), "{map}");
    }
}
