//! The elements of a `.net.xml`, read into [`Roads`].

use std::collections::HashMap;
use std::path::Path;

use anyhow::{Result, anyhow, ensure};

use super::attributes::{count, number, tag, text, wrong};
use super::carries::Classes;
use super::program::Program;
use super::{Connection, Edge, EdgeNo, Function, Junction, JunctionNo, Lane, LaneNo, Place, Request, Roads, Signal};
use crate::network::contents::Content;
use crate::network::osm;
use crate::network::tree::Element;

/// What is said of a name that leads nowhere. Only an editor or another program leaves such a net behind.
const UNKNOWN: &str = "the net has none of this name; make the net again with netconvert";

/// Speed limit of a lane that has less, in m/s.
const SLOWEST_MPS: f64 = 0.1;

impl Roads {
    /// Reads a `.net.xml`. An error names file, element, id and attribute.
    pub fn of_file(net: &Path) -> Result<Roads> {
        ensure!(!osm::is_one(net), "{}: {}", net.display(), osm::way_out(net));
        let content = Content::parse(net)?;
        Roads::read(&content.root).map_err(|error| anyhow!("{}: {error:#}", net.display()))
    }

    pub(crate) fn read(net: &Element) -> Result<Roads> {
        ensure!(net.name == "net", "is not a SUMO network: its root is {}, not <net>", tag(net));
        let mut roads = Roads::default();
        let mut junction_numbers = HashMap::new();
        for (number, element) in net.all("junction").enumerate() {
            junction_numbers.insert(text(element, "id")?, JunctionNo(number));
        }
        for element in net.all("edge") {
            roads.read_edge(element, &junction_numbers)?;
        }
        for element in net.all("junction") {
            let junction = roads.read_junction(element)?;
            roads.junctions.push(junction);
        }
        roads.programs = net.all("tlLogic").map(Program::read).collect::<Result<_>>()?;
        roads.from_lane = vec![Vec::new(); roads.lanes.len()];
        roads.to_lane = vec![Vec::new(); roads.lanes.len()];
        let mut letters: HashMap<String, usize> = HashMap::new();
        for program in &roads.programs {
            let least = letters.entry(program.light.clone()).or_insert(usize::MAX);
            *least = program.letters().unwrap_or(usize::MAX).min(*least);
        }
        let has_rails =
            net.all("junction").any(|it| it.attribute("type").is_some_and(|kind| kind.starts_with("rail_")));
        for element in net.all("connection") {
            let connection = roads.read_connection(element, &letters, has_rails)?;
            roads.from_lane[connection.from.0].push(roads.connections.len());
            roads.to_lane[connection.to.0].push(roads.connections.len());
            if let Some(signal) = &connection.signal {
                roads.of_light.entry(signal.light.clone()).or_default().push(roads.connections.len());
            }
            roads.connections.push(connection);
        }
        Ok(roads)
    }

    fn read_edge(&mut self, element: &Element, junctions: &HashMap<&str, JunctionNo>) -> Result<()> {
        let id = text(element, "id")?;
        let number = EdgeNo(self.edges.len());
        self.edge_numbers.insert(id.to_owned(), number);
        let function = match element.attribute("function").unwrap_or("normal") {
            "normal" | "connector" => Function::Road,
            "internal" => Function::Internal,
            "crossing" => Function::Crossing,
            "walkingarea" => Function::WalkingArea,
            _ => return Err(wrong(element, "function", "is none of SUMO's functions of edges")),
        };
        let end = |name: &str| known(element, name, junctions.get(text(element, name)?).copied());
        let ends = if function == Function::Road { Some([end("from")?, end("to")?]) } else { None };
        let lanes = element.all("lane").map(|lane| self.read_lane(lane, number)).collect::<Result<Vec<_>>>()?;
        ensure!(!lanes.is_empty(), "{}: has no <lane>; remove it from the net", tag(element));
        let street = element.attribute("name").map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned);
        let crosses = element.attribute("crossingEdges").unwrap_or_default().split_whitespace();
        let crosses = crosses.map(str::to_owned).collect();
        self.edges.push(Edge { id: id.to_owned(), street, function, ends, lanes, crosses });
        Ok(())
    }

    fn read_lane(&mut self, element: &Element, edge: EdgeNo) -> Result<LaneNo> {
        let id = text(element, "id")?;
        let number = LaneNo(self.lanes.len());
        self.lane_numbers.insert(id.to_owned(), number);
        let length_m = self::number(element, "length", 0.0)?;
        ensure!(length_m > 0.0, wrong(element, "length", "must be more than 0"));
        let classes = Classes::of(element);
        self.lanes.push(Lane {
            id: id.to_owned(),
            edge,
            length_m,
            // Shares of the limit are taken, so that of a closed lane is no 0.
            speed_limit_mps: self::number(element, "speed", 0.0)?.max(SLOWEST_MPS),
            shape: shape(element)?,
            carries_cars: classes.has_cars(),
            carries_vehicles: classes.has_vehicles(),
            classes,
        });
        Ok(number)
    }

    fn read_junction(&self, element: &Element) -> Result<Junction> {
        let kind = text(element, "type")?;
        let names = element.attribute("incLanes").unwrap_or_default().split_whitespace();
        let lane = |id: &str| known(element, "incLanes", self.lane_named(id));
        // A junction within another one lists lanes in another order.
        let incoming = if kind == "internal" { Vec::new() } else { names.map(lane).collect::<Result<_>>()? };
        Ok(Junction {
            id: text(element, "id")?.to_owned(),
            place_m: [number(element, "x", f64::NEG_INFINITY)?, number(element, "y", f64::NEG_INFINITY)?],
            shape: shape(element)?,
            incoming,
            requests: element.all("request").map(read_request).collect::<Result<_>>()?,
        })
    }

    /// `letters`: the least number of letters in the states of each light. `has_rails`: signals of rails have no program in the
    /// net, because SUMO makes up what they show.
    fn read_connection(
        &self,
        element: &Element,
        letters: &HashMap<String, usize>,
        has_rails: bool,
    ) -> Result<Connection> {
        let lane = |edge: &str, index: &str| {
            let edge = known(element, edge, self.edge_named(text(element, edge)?))?;
            known(element, index, self.edge(edge).lanes.get(count(element, index)?).copied())
        };
        let via = element.attribute("via").map(|id| known(element, "via", self.lane_named(id)));
        let signal = |light: &str| -> Result<Signal> {
            Ok(Signal { light: light.to_owned(), letter: count(element, "linkIndex")? })
        };
        let light = element.attribute("tl").filter(|light| !has_rails || letters.contains_key(*light));
        let signal = light.map(signal).transpose()?;
        if let Some(signal) = &signal {
            let length = known(element, "tl", letters.get(&signal.light).copied())?;
            let why = || format!("the states of light `{}` have {length} letters only", signal.light);
            ensure!(signal.letter < length, wrong(element, "linkIndex", &why()));
        }
        Ok(Connection {
            from: lane("from", "fromLane")?,
            to: lane("to", "toLane")?,
            via: via.transpose()?,
            signal,
            has_priority: element.attribute("state") == Some("M"),
            direction: element.attribute("dir").and_then(|dir| dir.chars().next()),
        })
    }
}

fn known<T>(element: &Element, name: &str, found: Option<T>) -> Result<T> {
    found.ok_or_else(|| wrong(element, name, UNKNOWN))
}

fn read_request(element: &Element) -> Result<Request> {
    // The last digit is the first link.
    let bits = |name: &str| {
        let digits = text(element, name)?.chars().rev();
        let bits: Option<Vec<bool>> = digits.map(|digit| Some(digit.to_digit(2)? == 1)).collect();
        bits.ok_or_else(|| wrong(element, name, "must be digits 0 and 1"))
    };
    Ok(Request { yields_to: bits("response")?, crosses: bits("foes")? })
}

/// Returns the points of the attribute `shape`. Without the attribute there are none. Heights are left out.
fn shape(element: &Element) -> Result<Vec<Place>> {
    let written = element.attribute("shape").unwrap_or_default();
    let points: Option<Vec<Place>> = written.split_whitespace().map(point).collect();
    points.ok_or_else(|| wrong(element, "shape", "must be points such as `0.5,10 20,30`"))
}

fn point(written: &str) -> Option<Place> {
    let numbers: Vec<f64> = written.split(',').map(|number| number.parse().ok()).collect::<Option<_>>()?;
    let finite = numbers.iter().all(|number: &f64| number.is_finite());
    match numbers[..] {
        [x, y] | [x, y, _] if finite => Some([x, y]),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::super::example::{changed, roads};
    use super::*;
    use crate::network::tree::parse;

    #[test]
    fn letters_cross_as_the_requests_of_their_junction_say() {
        let pairs: Vec<[usize; 2]> = roads(&[]).crossing_letters("J").unwrap().into_iter().collect();
        assert_eq!(pairs, [[0, 3], [1, 2], [1, 3]]);
        let roads = roads(&[("<request index=\"3\" response=\"0011\" foes=\"0011\"/>", "")]);
        assert_eq!(
            roads.crossing_letters("J").unwrap_err().to_string(),
            "<junction id=\"J\">: has 3 elements <request>, but 4 links; make the net again with netconvert"
        );
    }

    #[test]
    fn what_cannot_be_read_is_named_with_element_id_and_attribute() {
        let error = |old: &str, new: &str| {
            let error = Roads::read(&parse(&changed(&[(old, new)])).unwrap()).expect_err(new);
            format!("{error:#}").replace('"', "'")
        };
        let phase_2 = "<tlLogic id='J'>: phase 2:";
        let turn = "<connection from='near' fromLane='1' to='back' toLane='0'>";
        for (old, new, message) in [
            ("length='240'", "length='nan'", "<lane id='far_0'>: length='nan': must be a number of at least 0"),
            ("length='240'", "length='0'", "<lane id='far_0'>: length='0': must be more than 0"),
            ("length='240'", "", "<lane id='far_0'>: has no attribute length; every net of netconvert has it"),
            ("-60,0,7", "-60;0", "<lane id='far_0'>: shape='-300,0 -60;0': must be points such as `0.5,10 20,30`"),
            ("from='W' to='U'", "from='V' to='U'", "<edge id='far'>: from='V': UNKNOWN"),
            ("from='W' to='U'", "function='x'", "<edge id='far'>: function='x': is none of SUMO's functions of edges"),
            ("foes='1100'", "foes='1120'", "<request index='1'>: foes='1120': must be digits 0 and 1"),
            ("'rrrr'", "'rrr'", "PHASE_2 its state has 3 letters, but that of phase 0 has 4"),
            ("'rrrr'", "'rrrr' next='5'", "PHASE_2 next: names a phase that is not there"),
            ("linkIndex='3'", "linkIndex='4'", "TURN: linkIndex='4': the states of light `J` have 4 letters only"),
            ("tl='J' linkIndex='3'", "tl='K' linkIndex='3'", "TURN: tl='K': UNKNOWN"),
            ("from='near' fromLane='1'", "from='near' fromLane='2'", "fromLane='2': UNKNOWN"),
        ] {
            let message = message.replace("UNKNOWN", UNKNOWN).replace("TURN", turn).replace("PHASE_2", phase_2);
            let error = error(old, new);
            assert!(error.ends_with(&message), "{error}");
        }
        let phases = "<phase duration=\"9\" state=\"GGrr\"/>".repeat(496) + "</tlLogic>";
        assert_eq!(error("</tlLogic>", &phases), "<tlLogic id='J'>: has more than 500 phases, the limit");
        let long = error("GGrr", &"G".repeat(1001));
        assert_eq!(long, "<tlLogic id='J'>: has states of more than 1000 letters, the limit");
    }
}
