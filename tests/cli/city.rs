//! Lights before and after: what `baseline --compare` prints and writes, and the page that `report` makes of it.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use serde_json::Value;

fn dials_traffic(args: &[&str]) -> Command {
    let mut command = assert_cmd::cargo::cargo_bin_cmd!("dials-traffic");
    command.args(args);
    command
}

fn town() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("sumo_nets/town/town.sumocfg")
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn compare(more: &[&str]) -> String {
    let town = town();
    let args =
        ["baseline", town.to_str().unwrap(), "--compare", "program,max-pressure", "--episodes", "2", "--end", "300"];
    let assert = dials_traffic(&[&args[..], more].concat()).assert().success();
    text(&assert.get_output().stdout)
}

#[test]
fn a_comparison_shows_the_worst_lights_and_json_and_csv_have_all_of_them() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("city");
    let said = compare(&["--csv", out.to_str().unwrap()]);
    assert!(said.contains("lights where cars lose the most time under program"), "{said}");
    assert!(said.contains("LOS: level of service"), "{said}");
    let json: Value = serde_json::from_str(&compare(&["--json"])).unwrap();
    let [before, after] = [0, 1].map(|player| &json["controllers"][player]);
    let lights = before["lights"].as_array().unwrap();
    assert!(lights.len() >= 20 && lights[0].get("difference").is_none());
    // All delays together are that of the cars.
    let shares = &before["lost_time"];
    let number = |value: &Value| value.as_f64().unwrap();
    let parts = ["at_lights_s", "elsewhere_s", "before_entering_s"].map(|key| number(&shares[key]));
    assert!((parts.iter().sum::<f64>() - number(&shares["all_s"])).abs() < 1e-6, "{shares}");
    let worst = &after["lights"][0];
    assert!(worst["difference"]["delay_s"]["mean"].is_number(), "{worst}");
    let movements = worst["approaches"][0]["movements"].as_array().unwrap();
    assert!(movements.iter().any(|movement| movement["to"].is_string() && movement["delay_s"].is_number()), "{worst}");
    let csv = fs::read_to_string(out.join("lights.csv")).unwrap();
    let count = |level: &str| csv.lines().filter(|line| line.split(',').nth(1) == Some(level)).count();
    assert_eq!(count("light"), 2 * lights.len());
    assert!(count("approach") > count("light") && count("movement") > count("approach"), "{csv}");
    // The same file again is refused, and a page stands alone.
    dials_traffic(&["baseline", town().to_str().unwrap(), "--controller", "program", "--csv", out.to_str().unwrap()])
        .assert()
        .code(2);
    let page = dir.path().join("page");
    let assert = dials_traffic(&["report", out.to_str().unwrap(), "--out", page.to_str().unwrap()]).assert().success();
    assert!(text(&assert.get_output().stdout).starts_with("lights in 1 comparison; open "));
    let html = fs::read_to_string(page.join("report.html")).unwrap();
    for words in [">today's plan<", "rule: max-pressure", "What was assumed", "LOS", "<svg role=\"img\""] {
        assert!(html.contains(words), "{words} is not on the page");
    }
    // One rule has no rival, and no policy was rewarded.
    for words in ["best rule", "Policies are rewarded", "Not simulated"] {
        assert!(!html.contains(words), "{words} is on the page");
    }
    for outside in ["src=", "<link", "@import", "url("] {
        assert!(!html.contains(outside), "{outside} would need another file");
    }
}

#[test]
fn a_plan_stands_beside_the_rules_with_its_files_and_a_slide() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let (rules, plan, page) = (path("rules"), path("plan"), path("page"));
    compare(&["--csv", &rules]);
    let town = town();
    let args = ["plan", town.to_str().unwrap(), "--controller", "webster", "--end", "300", "--out"];
    let assert = dials_traffic(&[&args[..], &[&plan, "--episodes", "2"]].concat()).assert().success();
    let said = text(&assert.get_output().stdout);
    assert!(said.contains(&format!("report {plan}\n")), "{said}");
    let assert = dials_traffic(&["report", &plan, &rules, "--out", &page]).assert().success();
    let said = text(&assert.get_output().stdout);
    assert!(said.starts_with("lights in 1 comparison; open ") && said.contains("slide.svg"), "{said}");
    let html = fs::read_to_string(dir.path().join("page/report.html")).unwrap();
    for words in [">today's plan<", "rule: max-pressure", "<th>plan of webster</th>", "<a href=\"plan.html\">"] {
        assert!(html.contains(words), "{words} is not on the page");
    }
    for name in ["plan.html", "plan.csv", "programs.add.xml"] {
        let [kept, made] = ["page", "plan"].map(|folder| fs::read(dir.path().join(folder).join(name)).unwrap());
        assert!(kept == made, "{name}");
    }
    let slide = fs::read_to_string(dir.path().join("page/slide.svg")).unwrap();
    assert!(slide.contains("n = 2 episodes") && slide.contains(">plan of webster<"), "{slide}");
    // What the plan's own folder says of today is what the comparison says, to the last digit.
    let today = |folder: &str| -> Value {
        let city = fs::read_to_string(dir.path().join(folder).join("city.json")).unwrap();
        serde_json::from_str::<Value>(&city).unwrap()["players"][0].take()
    };
    assert_eq!(today("plan"), today("rules"));
    // Other traffic stays apart, with a word why.
    let other = path("other");
    let args =
        ["baseline", town.to_str().unwrap(), "--compare", "program,max-pressure", "--episodes", "1", "--end", "300"];
    dials_traffic(&[&args[..], &["--csv", &other]].concat()).assert().success();
    let assert = dials_traffic(&["report", &plan, &other, "--out", &path("apart")]).assert().success();
    assert!(text(&assert.get_output().stderr).contains("plan: stands alone, because "));
    assert!(text(&assert.get_output().stdout).starts_with("lights in 2 comparisons; "));
    assert!(dir.path().join("apart/slide_2.svg").is_file());
    // The folder of an older version has no figures.
    fs::remove_file(dir.path().join("plan/city.json")).unwrap();
    let assert = dials_traffic(&["report", &plan, "--out", &path("none")]).assert().code(2);
    let said = text(&assert.get_output().stderr);
    assert!(said.contains("is a plan without city.json") && said.contains("--force"), "{said}");
}

#[test]
fn a_long_id_is_whole_on_the_page_and_names_are_no_markup() {
    let long = format!("cluster_{}", "1234567890_".repeat(20));
    let light = |difference: &str| {
        format!(
            r#"{{"id":"{long}","name":"<b>High Street</b>","place_m":[5,5],"cars":10,"delay_s":30,"stops_per_car":1,
                "queue_p95_cars":4,"level_of_service":"C",{difference}"approaches":[{{"edge":"in","street":null,"lanes":1,
                "cars":10,"delay_s":30,"stops_per_car":1,"queue_p95_cars":4,"level_of_service":"C"}}]}}"#
        )
    };
    let after = light(r#""difference":{"delay_s":{"mean":-10,"half_width_95":3}},"#);
    let city = format!(
        r#"{{"name":"crossing","seed":0,"sumo_version":null,"episodes":3,"rules":null,"left_out":[],"warnings":[],
            "settings":{{"traffic":{{"begin_s":0,"end_s":3600}}}},
            "streets":[{{"edge":"in","street":null,"lanes":1,"shape_m":[[0,0],[5,5]]}}],
            "players":[
              {{"label":"program","learned":false,"figures":{{"delay_s":{{"mean":40,"half_width_95":2}}}},"differences":null,
                "lost_time":null,"lights":[{}]}},
              {{"label":"runs/a","learned":true,"figures":{{"delay_s":{{"mean":30,"half_width_95":2}}}},
                "differences":{{"delay_s":{{"mean":-10,"half_width_95":1}}}},"lost_time":null,"lights":[{after}]}}]}}"#,
        light("")
    );
    let dir = tempfile::tempdir().unwrap();
    fs::write(dir.path().join("city.json"), city).unwrap();
    let page = dir.path().join("page");
    dials_traffic(&["report", dir.path().to_str().unwrap(), "--out", page.to_str().unwrap()]).assert().success();
    let html = fs::read_to_string(page.join("report.html")).unwrap();
    assert!(html.contains(&long) && !html.contains("<b>High"), "{html}");
    assert!(html.contains("That is 25 % less."), "{html}");
    assert!(html.contains("\u{2212}10.0\u{a0}\u{b1}\u{a0}3.0"), "{html}");
    fs::write(dir.path().join("city.json"), "{}").unwrap();
    let assert = dials_traffic(&["report", dir.path().to_str().unwrap(), "--out", "x"]).assert().code(2);
    assert!(text(&assert.get_output().stderr).contains("city.json: is not a file of this program"));
}

#[test]
fn what_only_traffic_has_is_refused_elsewhere() {
    for option in ["--per-light", "--emissions"] {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/smoke_warehouse.toml");
        let args = ["baseline", config.to_str().unwrap(), "--controller", "random", option];
        let assert = dials_traffic(&args).assert().code(2);
        let said = text(&assert.get_output().stderr);
        assert!(said.contains(&format!("{option}: only traffic has that; leave the option out")), "{said}");
    }
}
