//! Programs that netconvert has invented for a net without any: a word about them where today's plan is compared.

use std::fs;

use dials_core::domain::Domain;
use dials_traffic::Traffic;

use super::room::{MORE, NET, Room, table};

/// The comment that netconvert writes, with this input.
fn made_of(input: &str) -> Room {
    let room = Room::new();
    let comment = format!(
        "<!-- generated on 2026-01-01 12:00:00 by Eclipse SUMO netconvert Version 1.20.0\n<netconvertConfiguration>\n\
         <input>{input}</input>\n</netconvertConfiguration>\n-->\n<net "
    );
    room.change(NET, "<net ", &comment);
    room
}

/// Returns the sentences about a guess.
fn guesses(room: &Room) -> usize {
    let traffic = Traffic::open_scenario(&table(room.config(&[]).unwrap())).unwrap();
    traffic.warnings().iter().filter(|what| what.starts_with("today's plan (`program`) may be a guess")).count()
}

#[test]
fn a_net_of_a_map_has_guessed_programs_until_somebody_brings_others() {
    let map = "<osm-files value=\"map.osm\"/>";
    let room = made_of(map);
    assert_eq!(guesses(&room), 1);
    // A program of another file is the one that runs.
    let net = fs::read_to_string(room.path(NET)).unwrap();
    let begin = net.find("<tlLogic").unwrap();
    let end = begin + net[begin..].find("</tlLogic>").unwrap() + "</tlLogic>".len();
    let program = net[begin..end].replace("programID=\"0\"", "programID=\"street\"");
    room.change(MORE, "</additional>", &format!("{program}</additional>"));
    assert_eq!(guesses(&room), 0);
    // A name that netconvert does not give.
    let room = made_of(map);
    room.change(NET, "programID=\"0\"", "programID=\"morning\"");
    assert_eq!(guesses(&room), 0);
}

#[test]
fn where_the_programs_come_from_is_not_known_of_other_nets() {
    for input in [
        "<sumo-net-file value=\"old.net.xml\"/>",
        "<edge-files value=\"a.edg.xml\"/><tllogic-files value=\"a.tll.xml\"/>",
        "<visum-file value=\"a.net\"/>",
    ] {
        assert_eq!(guesses(&made_of(input)), 0, "{input}");
    }
    assert_eq!(guesses(&Room::new()), 0, "a net that says nothing");
}
