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
pub(crate) const NET: &str = include_str!("example.net.xml");

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
