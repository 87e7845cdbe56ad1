//! Where the programs of a net come from, as far as its file says: netconvert and netgenerate invent programs for nets that had
//! none, and nobody has measured those.

use super::SumoScenario;
use crate::network::roads::program::name;
use dials_core::domain::light_figures::TODAYS_PLAN;

/// Bytes at the beginning of a net in which its first comment is looked for.
const HEADER: usize = 1 << 16;
/// Kinds of files that netconvert makes a net of and that have no programs: maps of OpenStreetMap and plain XML.
const WITHOUT_PROGRAMS: [&str; 2] = ["osm-files", "edge-files"];
/// Kinds that may have some.
const WITH_PROGRAMS: [&str; 10] = [
    "sumo-net-file",
    "tllogic-files",
    "opendrive-files",
    "visum-file",
    "vissim-file",
    "dlr-navteq-prefix",
    "itsumo-files",
    "matsim-files",
    "shapefile-prefix",
    "robocup-dir",
];
/// Program that they invent.
const INVENTED: &str = "0";

impl SumoScenario {
    /// Returns a sentence if today's programs may be a guess. `None`: they come from somewhere else, or nothing says where from.
    ///
    /// It is one if the net says that it was made of files without programs, and nothing later has a program: netedit would stand
    /// in the net, a person's program has a name of its own or is in an additional file. Somebody may have changed the net by
    /// hand, so the sentence says `may`.
    pub(crate) fn guessed_programs(&self) -> Option<String> {
        let begin = &self.net.content.bytes[..self.net.content.bytes.len().min(HEADER)];
        let maker = inventor(&String::from_utf8_lossy(begin))?;
        let invented = self.net().all("tlLogic").all(|program| name(program) == INVENTED);
        let later = self
            .additional()
            .any(|root| ["tlLogic", "wautJunction"].iter().any(|kind| root.all(kind).next().is_some()));
        (invented && !later).then(|| {
            format!(
                "{TODAYS_PLAN} (`program`) may be a guess: {maker} made the lights' programs for a net that had none, so compare \
                 with care"
            )
        })
    }
}

/// Returns the program that invented programs for a net, by the comment at the beginning of its file.
fn inventor(begin: &str) -> Option<&'static str> {
    let (before, rest) = begin.split_once("<!--")?;
    let (comment, _) = rest.split_once("-->")?;
    let first = comment.lines().next()?;
    if before.contains("<net") || !first.contains("generated on") {
        return None;
    }
    if first.contains("SUMO netgenerate ") {
        return Some("netgenerate");
    }
    let has = |kind: &&str| comment.contains(&format!("<{kind} "));
    let is_made = first.contains("SUMO netconvert ") && WITHOUT_PROGRAMS.iter().any(has);
    (is_made && !WITH_PROGRAMS.iter().any(has)).then_some("netconvert")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made(by: &str, input: &str) -> Option<&'static str> {
        inventor(&format!(
            "<?xml version=\"1.0\"?>\n<!-- generated on 2025-01-01 by {by} Version 1.20\n<configuration>\n<input>{input}</input>\n\
             </configuration>\n-->\n<net version=\"1.20\">"
        ))
    }

    #[test]
    fn a_map_and_plain_xml_have_no_programs_so_netconvert_invents_them() {
        assert_eq!(made("Eclipse SUMO netconvert", "<osm-files value=\"map.osm\"/>"), Some("netconvert"));
        let plain = "<node-files value=\"a\"/><edge-files value=\"b\"/>";
        assert_eq!(made("Eclipse SUMO netconvert", plain), Some("netconvert"));
        assert_eq!(made("Eclipse SUMO netgenerate", ""), Some("netgenerate"));
    }

    #[test]
    fn programs_may_come_from_another_net_a_file_of_programs_or_an_editor() {
        let netconvert = "Eclipse SUMO netconvert";
        assert_eq!(made(netconvert, "<sumo-net-file value=\"a.net.xml\"/>"), None);
        assert_eq!(made(netconvert, "<edge-files value=\"b\"/><tllogic-files value=\"c\"/>"), None);
        assert_eq!(made(netconvert, "<opendrive-files value=\"a\"/>"), None);
        assert_eq!(made("Eclipse SUMO netedit", "<osm-files value=\"map.osm\"/>"), None);
        assert_eq!(inventor("<net version=\"1.9\"><!-- generated on by SUMO netgenerate --></net>"), None);
        assert_eq!(inventor("<net/>"), None);
    }
}
