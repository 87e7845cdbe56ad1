//! Tests of the whole derivation, on the net of [`crate::network::roads::example`].

use super::*;
use crate::agents::phase_plan::Interval;
use crate::agents::region_plan::{Approach, Link};
use crate::network::roads::example::{LIGHT_AT_U, roads};

fn derived(changes: &[(&str, &str)], rules: Rules, overrides: &str) -> Result<Derived> {
    derive(&roads(changes), &rules, &Overrides::parse(overrides).unwrap())
}

fn plan(changes: &[(&str, &str)], rules: Rules, overrides: &str) -> AgentPlan {
    let derived = derived(changes, rules, overrides).unwrap();
    derived.agents.into_iter().find(|agent| agent.plan.light == "J").unwrap().plan
}

fn error(changes: &[(&str, &str)], overrides: &str) -> String {
    derived(changes, Rules::default(), overrides).unwrap_err().to_string()
}

/// Lanes and their distances to the stop line.
fn approaches(plan: &AgentPlan) -> Vec<(&str, f64)> {
    plan.region.approaches.iter().map(|approach| (approach.lane.as_str(), approach.ahead_m)).collect()
}

#[test]
fn an_agent_sees_lanes_for_cars_back_through_junctions_without_a_light() {
    let plan = plan(&[], Rules::default(), "");
    assert_eq!(plan.place_m, [0.0, 0.0]);
    // `near` is 50 m long. Before it are 10 m within U from `far`, and 7 + 12 m from `side`. `back` turns around.
    let expected = [("north_0", 0.0), ("near_0", 0.0), ("near_1", 0.0), ("far_0", 60.0), ("side_1", 69.0)];
    assert_eq!(approaches(&plan), expected);
    // Letters and links are in the same order here. Cars on `far` come to both lanes of `near`.
    let links: Vec<&[usize]> = plan.region.approaches.iter().map(|approach| &approach.links[..]).collect();
    assert_eq!(links, [&[0, 1][..], &[2], &[3], &[2, 3], &[2]]);
    let link =
        |letter, from, to, crosses: &[usize]| Link { letter, from, to, inside: Vec::new(), crosses: crosses.to_vec() };
    // As the `foes` of J say. The ways from `near` to `out` and from `north` to `out` end on one lane.
    let links = [link(0, 0, 0, &[3]), link(1, 0, 1, &[2, 3]), link(2, 1, 1, &[1]), link(3, 2, 0, &[0, 1])];
    assert_eq!(plan.region.links, links);
    let exits: Vec<(&str, f64, bool)> =
        plan.region.exits.iter().map(|exit| (exit.lane.as_str(), exit.length_m, exit.leaves_the_net)).collect();
    assert_eq!(exits, [("back_0", 50.0, true), ("out_0", 190.0, true)]);
    let north =
        Approach { lane: "north_0".to_owned(), length_m: 95.0, speed_limit_mps: 13.9, ahead_m: 0.0, links: vec![0, 1] };
    assert_eq!(plan.region.approaches[0], north);
}

#[test]
fn a_link_knows_its_lanes_within_the_junction_and_the_links_across_if_masks_mind_them() {
    // As if cars from `north` waited within J as those from `side` do within U.
    let way = [(r#"tl="J" linkIndex="1""#, r#"via=":U_1_0" tl="J" linkIndex="1""#)];
    let inside = |rules| -> Vec<(Vec<String>, usize)> {
        let links = plan(&way, rules, "").region.links;
        links.into_iter().map(|link| (link.inside, link.crosses.len())).collect()
    };
    let lanes = [":U_1_0", ":U_2_0"].map(str::to_owned).to_vec();
    assert_eq!(inside(Rules::default()), [(vec![], 1), (lanes, 2), (vec![], 1), (vec![], 2)]);
    let minds_nobody = Rules { minds_trapped: false, ..Rules::default() };
    assert_eq!(inside(minds_nobody), vec![(vec![], 0); 4]);
}

#[test]
fn an_agent_sees_cells_or_queues_up_to_the_limit_of_sight() {
    let plan_of = |rules| plan(&[], rules, "");
    let cells = plan_of(Rules::default());
    // 95 m; 50 m twice; 90 of 240 m, because 60 m are before them; 80 m, all within 150 - 69 = 81 m.
    assert_eq!(cells.sensor.cars, super::super::sensor::CarColumns::Cells(vec![10, 5, 5, 9, 8]));
    let names = cells.columns();
    assert_eq!((names.len(), cells.width()), (41, 41));
    assert_eq!([&names[0], &names[9], &names[10], &names[36]], ["north_0[0]", "north_0[9]", "near_0[0]", "side_1[7]"]);
    assert_eq!(names[37..], ["green[0]", "green[1]", "between greens", "time since change"]);
    let queues = plan_of(Rules { cars: Observation::Queues, ..Rules::default() });
    let names = queues.columns();
    assert_eq!((names.len(), queues.width()), (14, 14));
    assert_eq!(names[..3], ["queue north_0", "density north_0", "queue near_0"]);
    let near = plan_of(Rules { approach_m: 50.0, ..Rules::default() });
    assert_eq!(approaches(&near), [("north_0", 0.0), ("near_0", 0.0), ("near_1", 0.0)]);
}

#[test]
fn a_region_ends_at_another_light_and_so_does_the_way_out() {
    let derived = derived(&LIGHT_AT_U, Rules::default(), "").unwrap();
    let [u, j] = ["U", "J"].map(|light| derived.agents.iter().find(|agent| agent.plan.light == light).unwrap());
    assert_eq!(approaches(&j.plan), [("north_0", 0.0), ("near_0", 0.0), ("near_1", 0.0)]);
    assert!(j.region.passed.is_empty());
    assert_eq!(j.plan.region.exits.iter().map(|exit| exit.leaves_the_net).collect::<Vec<_>>(), [false, true]);
    // The order of the elements <tlLogic>: J, then U.
    assert_eq!(derived.plans().iter().map(|plan| plan.light.as_str()).collect::<Vec<_>>(), ["J", "U"]);
    assert_eq!(approaches(&u.plan), [("far_0", 0.0), ("side_1", 0.0), ("back_0", 0.0)]);
}

#[test]
fn a_road_between_two_junctions_of_one_light_does_not_leave_the_net() {
    let joined = (r#"via=":U_1_0" dir="r"/>"#, r#"via=":U_1_0" tl="J" linkIndex="4" dir="r"/>"#);
    let states = ["GGrr", "yyrr", "rrrr", "rrGG", "rryy"]
        .map(|state| (format!("state=\"{state}\""), format!("state=\"{state}G\"")));
    let states = states.iter().map(|(old, new)| (old.as_str(), new.as_str()));
    let plan = plan(&[joined].into_iter().chain(states).collect::<Vec<_>>(), Rules::default(), "");
    let exits: Vec<_> = plan.region.exits.iter().map(|exit| (exit.lane.as_str(), exit.leaves_the_net)).collect();
    assert!(exits.contains(&("near_0", false)) && exits.contains(&("out_0", true)), "{exits:?}");
}

#[test]
fn a_region_has_at_most_eight_junctions() {
    // `far` as a chain of ten edges of 10 m, with junctions between them.
    let junction = |number: usize| if number == 0 { "U".to_owned() } else { format!("C{number}") };
    let (mut edges, mut junctions, mut ways) = (String::new(), String::new(), String::new());
    for number in 1..=10 {
        let (begin, end) = (junction(number), junction(number - 1));
        let lane = format!("<lane id='c{number}_0' index='0' speed='9' length='10'/>");
        edges += &format!("<edge id='c{number}' from='{begin}' to='{end}'>{lane}</edge>");
        let next = if number == 1 { "near".to_owned() } else { format!("c{}", number - 1) };
        ways += &format!("<connection from='c{number}' fromLane='0' to='{next}' toLane='0'/>");
        let lane = if number < 10 { format!("c{}_0", number + 1) } else { String::new() };
        junctions += &format!("<junction id='{begin}' type='priority' x='-{number}' y='0' incLanes='{lane}'/>");
    }
    edges += "<edge id='far'";
    junctions += "<junction id='W'";
    ways += "</net>";
    let changes = [("<edge id='far'", &*edges), ("<junction id='W'", &*junctions), ("</net>", &*ways)];
    let plan = plan(&changes, Rules { approach_m: 500.0, ..Rules::default() }, "");
    // J, U and C1 to C6 are eight, so c7 is the last edge.
    let chain: Vec<&str> =
        approaches(&plan).iter().map(|(lane, _)| *lane).filter(|lane| lane.starts_with('c')).collect();
    assert_eq!(chain, ["c1_0", "c2_0", "c3_0", "c4_0", "c5_0", "c6_0", "c7_0"]);
}

#[test]
fn lights_without_a_choice_keep_their_program() {
    const UNUSED: (&str, &str) = LIGHT_AT_U[0];
    let links = |changes: &[_]| [&LIGHT_AT_U[..], changes].concat();
    let on_foot = r#"<connection from="side" fromLane="0" to="near" toLane="0" tl="U" linkIndex="0"/></net>"#;
    for (changes, why) in [
        (links(&[(r#"state="Grr""#, r#"state="rGG""#)]), Why::Greens(1)),
        (
            links(&[(r#"<tlLogic id="U">"#, r#"<tlLogic id="U" type="rail_crossing">"#)]),
            Why::Kind("rail_crossing".to_owned()),
        ),
        (vec![UNUSED], Why::NoLink),
        (vec![UNUSED, ("</net>", on_foot)], Why::NoCars),
    ] {
        let kept = derived(&changes, Rules::default(), "").unwrap().keeping;
        assert_eq!(kept, [Keeping { light: "U".to_owned(), why }]);
    }
}

#[test]
fn a_phase_for_a_cycle_path_alone_is_a_green_and_one_for_a_footpath_is_not() {
    let with_path_for = |class: &str| {
        let lane = format!(r#"allow="{class}""#);
        plan(
            &[
                ("state=\"GGrr\"", "state=\"GGrrr\""),
                ("state=\"yyrr\"", "state=\"yyrrr\""),
                ("state=\"rrrr\"", "state=\"rrrrr\""),
                ("state=\"rrGG\"", "state=\"rrGGr\""),
                ("state=\"rryy\"", "state=\"rryyr\""),
                ("</tlLogic>", r#"<phase duration="9" state="rrrrG"/></tlLogic>"#),
                ("</net>", r#"<connection from="side" fromLane="0" to="near" toLane="0" tl="J" linkIndex="4"/></net>"#),
                (r#"allow="pedestrian""#, &lane),
            ],
            Rules::default(),
            "",
        )
    };
    let greens =
        |plan: &AgentPlan| plan.phases.greens().iter().map(|green| green.to_string()).collect::<Vec<_>>().join(" ");
    let [cycles, on_foot] = ["bicycle", "pedestrian"].map(with_path_for);
    assert_eq!([greens(&cycles), greens(&on_foot)], ["GGrrr rrGGr rrrrG", "GGrrr rrGGr"]);
    assert_eq!(approaches(&cycles), approaches(&on_foot), "an agent does not see bicycles");
    let [cycles, on_foot] = [cycles, on_foot].map(|plan| plan.phases.recognise(&"GGrrG".parse().unwrap(), 0));
    assert_eq!([cycles.green(), on_foot.green()], [None, Some(0)], "a program shows the path green, too");
}

#[test]
fn the_last_program_of_a_light_counts_as_in_sumo() {
    let other = |id: &str, state: &str| {
        let phase = |state: &str| format!(r#"<phase duration="9" state="{state}"/>"#);
        format!(r#"<tlLogic id="J" programID="{id}">{}{}</tlLogic>"#, phase(state), phase("rrGG"))
    };
    let later = format!("</tlLogic>{}{}", other("night", "Grrr"), other("day", "rGrr"));
    let derived = derived(&[("</tlLogic>", &later)], Rules::default(), "").unwrap();
    assert_eq!(derived.agents.iter().map(|agent| agent.program.id.as_str()).collect::<Vec<_>>(), ["day"]);
    assert_eq!(derived.agents[0].plan.phases.greens()[0].as_str(), "rGrr");
}

#[test]
fn a_light_with_too_many_greens_keeps_its_program() {
    // Seven links at U. Letters are binary numbers from 1 on.
    let phase = |number: usize| {
        let state: String = (0..7).map(|bit| if number >> bit & 1 == 1 { 'G' } else { 'r' }).collect();
        format!("<phase duration='9' state='{state}'/>")
    };
    let link =
        |letter| format!("<connection from='far' fromLane='0' to='near' toLane='0' tl='U' linkIndex='{letter}'/>");
    let links = (0..7).map(link).collect::<String>() + "</net>";
    let with = |greens: usize| {
        let phases: String = (1..=greens).map(phase).collect();
        let program = format!("<tlLogic id='U'>{phases}</tlLogic><junction id='W'");
        derived(&[("<junction id='W'", &program), ("</net>", &links)], Rules::default(), "").unwrap()
    };
    assert_eq!(with(64).agents[1].plan.phases.greens().len(), 64);
    assert_eq!(with(65).keeping[0].why.to_string(), "its program has more than 64 greens, the limit");
}

#[test]
fn a_net_without_a_light_that_can_learn_is_refused() {
    let one_green = [("state=\"GGrr\"", "state=\"rrGG\"")];
    let derived = derived(&one_green, Rules::default(), "").unwrap();
    assert_eq!(
        derived.check_learning(&roads(&one_green)).unwrap_err().to_string(),
        "has no light that can learn: light `J`: its program has one green only, so there is nothing to choose; give \
         its program a second green in netedit, or name its greens in agents.toml; a dead end needs none"
    );
    let none = Roads::default();
    let message = derive(&none, &Rules::default(), &Overrides::default()).unwrap_err().to_string();
    assert!(message.starts_with("has no traffic light: no element <tlLogic>; "), "{message}");
}

#[test]
fn a_file_says_otherwise() {
    let file = r#"
        keep = ["U"]
        [light.J]
        greens = ["rrGG", "GGrr", "rrgr"]
        approaches = ["near", "side"]
        yellow_s = 5
        all_red_s = 1
    "#;
    let derived = derived(&LIGHT_AT_U, Rules::default(), &file.replace(", \"side\"", "")).unwrap();
    assert_eq!(derived.keeping, [Keeping { light: "U".to_owned(), why: Why::Excluded }]);
    let plan = plan(&[], Rules::default(), &file.replace("keep = [\"U\"]", ""));
    assert_eq!(approaches(&plan), [("near_0", 0.0), ("near_1", 0.0), ("side_1", 69.0)]);
    assert_eq!(plan.region.links.iter().map(|link| link.letter).collect::<Vec<_>>(), [2, 3], "`north` is not seen");
    let interval = |letters: &str, steps| Interval { state: letters.parse().unwrap(), steps };
    assert_eq!(plan.phases.clearing(0, 1), [interval("rryy", 5), interval("rrrr", 1)]);
    assert_eq!(plan.phases.clearing(2, 0), [], "g becomes G");
    assert_eq!(plan.phases.actions(), 3);
}

#[test]
fn what_a_file_says_wrongly_is_refused_with_the_light_and_the_key() {
    for (file, message) in [
        ("learn = ['K']", "agents.toml: learn: the net has no light `K`; remove it"),
        (
            "[light.J]\ngreens = ['GGr', 'rrG']",
            "agents.toml: light `J`: greens: `GGr` has 3 letters, but its program has 4; give one letter per link",
        ),
        (
            "[light.J]\ngreens = ['rrGG', 'rGGr']",
            "agents.toml: light `J`: state `rGGr` gives `G` to the letters 1 and 2, whose cars cross each other, and \
             no phase of its program does; give `g` to the one that yields, or `r`",
        ),
        ("[light.J]\napproaches = ['nowhere']", "agents.toml: light `J`: approaches: the net has no road `nowhere`"),
        (
            "[light.J]\napproaches = ['north', 'far']",
            "agents.toml: light `J`: approaches: no lane of edge `far` leads to it within 150 m of the stop line, \
             over edges of this list; add the edges between, or leave it out",
        ),
    ] {
        assert_eq!(error(&[], file), message);
    }
    let one_green = error(&[("state=\"GGrr\"", "state=\"rrGG\"")], "learn = ['J']");
    let cannot = "agents.toml: learn: light `J` cannot learn: its program has one green only";
    assert!(one_green.starts_with(cannot), "{one_green}");
}
