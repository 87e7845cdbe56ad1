//! Tests: every fault of a net is told with element, id and attribute.

use super::Roads;
use super::example::changed;
use crate::network::tree::parse;

#[test]
fn every_fault_is_told_with_element_id_and_attribute() {
    let remake = "make the net again with netconvert";
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
        (
            "id=\"near_1\" index=\"1\"",
            "id=\"near_1\" index=\"2\"",
            "<lane id=\"near_1\">: index=\"2\": is lane 1 of its edge; REMAKE",
        ),
        ("id=\"near_1\"", "id=\"near_0\"", "<lane id=\"near_0\">: there are two lanes of this id; REMAKE"),
        ("edge id=\"out\"", "edge id=\"far\"", "<edge id=\"far\">: there are two edges of this id; REMAKE"),
        (
            "junction id=\"E\" type=\"dead_end\"",
            "junction id=\"E\" type=\"rail_crossing\"",
            "<junction id=\"E\">: type=\"rail_crossing\": this program does not simulate trains; remove the track from the \
             net, for example with netconvert's --remove-edges.by-vclass",
        ),
        ("junction id=\"E\"", "junction id=\"N\"", "<junction id=\"N\">: there are two junctions of this id; REMAKE"),
        (
            "from=\"W\" to=\"U\"",
            "from=\"V\" to=\"U\"",
            "<edge id=\"far\">: from=\"V\": there is no junction of this id; REMAKE",
        ),
        (
            "from=\"W\" to=\"U\"",
            "function=\"x\"",
            "<edge id=\"far\">: function=\"x\": is none of SUMO's functions of edges",
        ),
        ("x=\"200\"", "x=\"inf\"", "<junction id=\"E\">: x=\"inf\": must be a number"),
        (
            "incLanes=\"out_0\"",
            "incLanes=\"out_9\"",
            "<junction id=\"E\">: incLanes=\"out_9\": there is no lane `out_9`; REMAKE",
        ),
        ("foes=\"1100\"", "foes=\"1120\"", "<request index=\"1\">: foes=\"1120\": must be digits 0 and 1"),
        ("foes=\"1100\"", "foes=\"1x00\"", "<request index=\"1\">: foes=\"1x00\": must be digits 0 and 1"),
        (
            "state=\"rrrr\"",
            "state=\"rrr\"",
            "<tlLogic id=\"J\">: phase 2: state=\"rrr\": has 3 letters, but phase 0 has 4; give all phases one \
             letter per link",
        ),
        (
            "state=\"rrrr\"",
            "state=\"rrxr\"",
            "<tlLogic id=\"J\">: <phase state=\"rrxr\">: state=\"rrxr\": `x` is no signal; SUMO's signals are \
             r, y, Y, g, G, s, u, o, O",
        ),
        (
            "state=\"rrrr\"",
            "state=\"\"",
            "<tlLogic id=\"J\">: <phase state=\"\">: state=\"\": is empty; SUMO's signals are r, y, Y, g, G, s, \
             u, o, O",
        ),
        (
            "state=\"rrrr\"",
            "state=\"rrrr\" next=\"5\"",
            "<tlLogic id=\"J\">: phase 2: next: there is no phase 5; the last one is 4",
        ),
        (
            "duration=\"2\"",
            "duration=\"-2\"",
            "<tlLogic id=\"J\">: <phase state=\"rrrr\">: duration=\"-2\": must be a number of at least 0",
        ),
        (
            "linkIndex=\"3\"",
            "linkIndex=\"4\"",
            "<connection from=\"near\" fromLane=\"1\" to=\"back\" toLane=\"0\">: linkIndex=\"4\": the states of \
             light `J` have 4 letters only; add the missing ones",
        ),
        (
            "tl=\"J\" linkIndex=\"3\"",
            "tl=\"K\" linkIndex=\"3\"",
            "<connection from=\"near\" fromLane=\"1\" to=\"back\" toLane=\"0\">: tl=\"K\": there is no \
             <tlLogic> of this id; add its program",
        ),
        (
            "tl=\"J\" linkIndex=\"3\"",
            "tl=\"J\"",
            "<connection from=\"near\" fromLane=\"1\" to=\"back\" toLane=\"0\">: has no attribute linkIndex; \
             every net of netconvert has it",
        ),
        (
            "<connection from=\"north\" fromLane=\"0\" to=\"out\"",
            "<connection from=\"north\" fromLane=\"1\" to=\"out\"",
            "<connection from=\"north\" fromLane=\"1\" to=\"out\" toLane=\"0\">: fromLane=\"1\": its edge has \
             no such lane; REMAKE",
        ),
        (
            "<connection from=\"north\" fromLane=\"0\" to=\"out\"",
            "<connection from=\"norht\" fromLane=\"0\" to=\"out\"",
            "<connection from=\"norht\" fromLane=\"0\" to=\"out\" toLane=\"0\">: from=\"norht\": there is no \
             edge of this id; REMAKE",
        ),
        (
            "via=\":U_3_0\"",
            "via=\":U_4_0\"",
            "<connection from=\"back\" fromLane=\"0\" to=\"west\" toLane=\"0\">: via=\":U_4_0\": there is no \
             lane of this id; REMAKE",
        ),
    ] {
        let net = parse(&changed(&[(old, new)])).unwrap();
        let error = format!("{:#}", Roads::read(&net).expect_err(told));
        assert_eq!(error, told.replace("REMAKE", remake));
    }
    let other = parse("<routes/>").unwrap();
    assert_eq!(Roads::read(&other).unwrap_err().to_string(), "is not a SUMO network: its root is <routes>, not <net>");
}

#[test]
fn a_program_has_an_end() {
    let phases = "<phase duration=\"9\" state=\"GGrr\"/>".repeat(496) + "</tlLogic>";
    let error = |old: &str, new: &str| {
        let net = parse(&changed(&[(old, new)])).unwrap();
        Roads::read(&net).unwrap_err().to_string()
    };
    assert_eq!(error("</tlLogic>", &phases), "<tlLogic id=\"J\">: has more than 500 phases, the limit");
    let told = error("GGrr", &"G".repeat(1001));
    assert_eq!(told, "<tlLogic id=\"J\">: has states of more than 1000 letters, the limit");
}
