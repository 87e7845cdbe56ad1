//! A small net for tests.
//!
//! ```text
//!                     N
//!                     | north
//!      far       near |
//!  W ------> U ------> J ------> E
//!    <------ ^ <------     out
//!     west   |   back
//!            | side (a footpath and a lane)
//!            X
//! ```
//!
//! J has a light, U has none. Cars on `near` may turn around at J, and cars on `back` at U.

use super::Roads;
use crate::network::tree::parse;

/// Letters of the light at J: north to back, north to out, near to out, near to back.
pub(crate) const NET: &str = r#"<net version="1.9">
  <edge id=":U_0" function="internal"><lane id=":U_0_0" index="0" speed="10" length="10" shape="-65,0 -55,0"/></edge>
  <edge id=":U_1" function="internal"><lane id=":U_1_0" index="0" speed="10" length="7"/></edge>
  <edge id=":U_2" function="internal"><lane id=":U_2_0" index="0" speed="10" length="12"/></edge>
  <edge id=":U_3" function="internal"><lane id=":U_3_0" index="0" speed="10" length="3"/></edge>
  <edge id="far" from="W" to="U"><lane id="far_0" index="0" speed="13.9" length="240" shape="-300,0 -60,0,7"/></edge>
  <edge id="side" from="X" to="U">
    <lane id="side_0" index="0" allow="pedestrian" speed="2" length="80"/>
    <lane id="side_1" index="1" speed="8" length="80"/>
  </edge>
  <edge id="near" from="U" to="J">
    <lane id="near_0" index="0" speed="13.9" length="50"/>
    <lane id="near_1" index="1" speed="13.9" length="50"/>
  </edge>
  <edge id="north" from="N" to="J"><lane id="north_0" index="0" speed="13.9" length="95"/></edge>
  <edge id="out" from="J" to="E"><lane id="out_0" index="0" speed="13.9" length="190"/></edge>
  <edge id="back" from="J" to="U"><lane id="back_0" index="0" speed="13.9" length="50"/></edge>
  <edge id="west" from="U" to="W"><lane id="west_0" index="0" speed="13.9" length="240"/></edge>
  <tlLogic id="J" type="static" programID="0" offset="0">
    <phase duration="20" state="GGrr"/>
    <phase duration="3" state="yyrr"/>
    <phase duration="2" state="rrrr"/>
    <phase duration="20" state="rrGG"/>
    <phase duration="3" state="rryy"/>
  </tlLogic>
  <junction id="W" type="dead_end" x="-300" y="0" incLanes="west_0"/>
  <junction id="U" type="priority" x="-60" y="0" incLanes="far_0 side_0 side_1 back_0"/>
  <junction id="X" type="dead_end" x="-60" y="-80" incLanes=""/>
  <junction id="J" type="traffic_light" x="0" y="0" incLanes="north_0 near_0 near_1">
    <request index="0" response="0000" foes="1000"/>
    <request index="1" response="1000" foes="1100"/>
    <request index="2" response="0010" foes="0010"/>
    <request index="3" response="0011" foes="0011"/>
  </junction>
  <junction id="N" type="dead_end" x="0" y="100" incLanes=""/>
  <junction id="E" type="dead_end" x="200" y="0" incLanes="out_0"/>
  <connection from="far" fromLane="0" to="near" toLane="0" via=":U_0_0" dir="s"/>
  <connection from="far" fromLane="0" to="near" toLane="1" via=":U_0_0" dir="s"/>
  <connection from="side" fromLane="1" to="near" toLane="0" via=":U_1_0" dir="r"/>
  <connection from="back" fromLane="0" to="west" toLane="0" via=":U_3_0" dir="s"/>
  <connection from="back" fromLane="0" to="near" toLane="1" dir="t"/>
  <connection from="north" fromLane="0" to="back" toLane="0" tl="J" linkIndex="0" dir="r"/>
  <connection from="north" fromLane="0" to="out" toLane="0" tl="J" linkIndex="1" dir="l"/>
  <connection from="near" fromLane="0" to="out" toLane="0" tl="J" linkIndex="2" dir="s"/>
  <connection from="near" fromLane="1" to="back" toLane="0" tl="J" linkIndex="3" dir="t"/>
  <connection from=":U_1" fromLane="0" to="near" toLane="0" via=":U_2_0" dir="r"/>
</net>"#;

/// Returns the net with some texts replaced, in which `'` stands for `"`. Each of them must be there.
pub(crate) fn changed(changes: &[(&str, &str)]) -> String {
    changes.iter().fold(NET.to_owned(), |net, (old, new)| {
        let [old, new] = [old, new].map(|text| text.replace('\'', "\""));
        assert!(net.contains(&old), "the net has no {old}");
        net.replace(&old, &new)
    })
}

pub(crate) fn roads(changes: &[(&str, &str)]) -> Roads {
    Roads::read(&parse(&changed(changes)).expect("XML of the test")).expect("a net of the test")
}

/// A light of its own at U, with greens for `far` and for `side`.
pub(crate) const LIGHT_AT_U: [(&str, &str); 5] = [
    (
        r#"<junction id="W""#,
        r#"<tlLogic id="U"><phase duration="9" state="Grr"/><phase duration="9" state="rGG"/></tlLogic><junction id="W""#,
    ),
    (r#"via=":U_0_0" dir="s"/>"#, r#"via=":U_0_0" tl="U" linkIndex="0" dir="s"/>"#),
    (r#"via=":U_1_0" dir="r"/>"#, r#"via=":U_1_0" tl="U" linkIndex="1" dir="r"/>"#),
    (r#"via=":U_3_0" dir="s"/>"#, r#"via=":U_3_0" tl="U" linkIndex="2" dir="s"/>"#),
    (r#"id="U" type="priority""#, r#"id="U" type="traffic_light""#),
];
