//! Tests: what is missing or no number in a net is an error with element, id and attribute.

use super::Roads;
use super::example::changed;
use crate::network::tree::parse;

fn error(old: &str, new: &str) -> String {
    format!("{:#}", Roads::read(&parse(&changed(&[(old, new)])).unwrap()).expect_err(new))
}

#[test]
fn what_cannot_be_read_is_named_with_element_id_and_attribute() {
    let unknown = "the net has none of this name; make the net again with netconvert";
    for (old, new, told) in [
        (
            "length=\"240\" shape",
            "length=\"far\" shape",
            "<lane id=\"far_0\">: length=\"far\": must be a number of at least 0",
        ),
        ("length=\"240\" shape", "length=\"0\" shape", "<lane id=\"far_0\">: length=\"0\": must be more than 0"),
        (
            "length=\"240\" shape",
            "length=\"nan\" shape",
            "<lane id=\"far_0\">: length=\"nan\": must be a number of at least 0",
        ),
        (
            "length=\"240\" shape",
            "shape",
            "<lane id=\"far_0\">: has no attribute length; every net of netconvert has it",
        ),
        ("-60,0,7", "-60;0", "<lane id=\"far_0\">: shape=\"-300,0 -60;0\": must be points such as `0.5,10 20,30`"),
        ("from=\"W\" to=\"U\"", "from=\"V\" to=\"U\"", "<edge id=\"far\">: from=\"V\": UNKNOWN"),
        (
            "from=\"W\" to=\"U\"",
            "function=\"x\"",
            "<edge id=\"far\">: function=\"x\": is none of SUMO's functions of edges",
        ),
        ("x=\"200\"", "x=\"inf\"", "<junction id=\"E\">: x=\"inf\": must be a number"),
        ("incLanes=\"out_0\"", "incLanes=\"out_9\"", "<junction id=\"E\">: incLanes=\"out_9\": UNKNOWN"),
        ("foes=\"1100\"", "foes=\"1120\"", "<request index=\"1\">: foes=\"1120\": must be digits 0 and 1"),
        (
            "duration=\"2\"",
            "duration=\"-2\"",
            "<tlLogic id=\"J\">: <phase state=\"rrrr\">: duration=\"-2\": must be a number of at least 0",
        ),
        (
            "state=\"rrrr\"",
            "state=\"rrr\"",
            "<tlLogic id=\"J\">: phase 2: its state has 3 letters, but that of phase 0 has 4",
        ),
        (
            "state=\"rrrr\"",
            "state=\"rrrr\" next=\"5\"",
            "<tlLogic id=\"J\">: phase 2: next: names a phase that is not there",
        ),
    ] {
        assert_eq!(error(old, new), told.replace("UNKNOWN", unknown));
    }
    let bad = error("state=\"rrrr\"", "state=\"rrxr\"");
    assert!(
        bad.starts_with("<tlLogic id=\"J\">: <phase state=\"rrxr\">: signal state `rrxr`: `x` is not a signal"),
        "{bad}"
    );
    let turn = "<connection from=\"near\" fromLane=\"1\" to=\"back\" toLane=\"0\">";
    let (north, out) = ("<connection from=\"north\" fromLane=\"0\" to=\"out\"", "toLane=\"0\"");
    for (old, new, told) in [
        (
            "linkIndex=\"3\"",
            "linkIndex=\"4\"",
            format!("{turn}: linkIndex=\"4\": the states of light `J` have 4 letters only"),
        ),
        ("tl=\"J\" linkIndex=\"3\"", "tl=\"K\" linkIndex=\"3\"", format!("{turn}: tl=\"K\": {unknown}")),
        (
            north,
            "<connection from=\"north\" fromLane=\"1\" to=\"out\"",
            format!("<connection from=\"north\" fromLane=\"1\" to=\"out\" {out}>: fromLane=\"1\": {unknown}"),
        ),
        (
            north,
            "<connection from=\"norht\" fromLane=\"0\" to=\"out\"",
            format!("<connection from=\"norht\" fromLane=\"0\" to=\"out\" {out}>: from=\"norht\": {unknown}"),
        ),
        (
            "via=\":U_3_0\"",
            "via=\":U_4_0\"",
            format!("<connection from=\"back\" fromLane=\"0\" to=\"west\" {out}>: via=\":U_4_0\": {unknown}"),
        ),
    ] {
        assert_eq!(error(old, new), told);
    }
    let other = parse("<routes/>").unwrap();
    assert_eq!(Roads::read(&other).unwrap_err().to_string(), "is not a SUMO network: its root is <routes>, not <net>");
}

#[test]
fn a_program_has_an_end() {
    let phases = "<phase duration=\"9\" state=\"GGrr\"/>".repeat(496) + "</tlLogic>";
    assert_eq!(error("</tlLogic>", &phases), "<tlLogic id=\"J\">: has more than 500 phases, the limit");
    let told = error("GGrr", &"G".repeat(1001));
    assert_eq!(told, "<tlLogic id=\"J\">: has states of more than 1000 letters, the limit");
}
