//! Cuts the local net of a light out of a whole net, as text.
//!
//! Nothing is converted. Everything inside keeps its exact elements; netconvert would change lengths and shapes.
//! Junctions at the border become dead ends.

use std::collections::{BTreeSet, HashMap, HashSet};

use anyhow::{Result, ensure};

use super::beyond::{Beyond, Reach, dead_end};
use super::local_net::{KINDS, LocalNet};
use crate::agents::derive::region::Region;
use crate::network::roads::{Connection, EdgeNo, Function, JunctionNo, Roads, program};
use crate::network::tree::Element;
use dials_core::outside::excerpt;

pub(crate) struct Source<'a> {
    pub(crate) net: &'a Element,
    pub(crate) roads: &'a Roads,
    /// Programs of lights in other files, which SUMO loads after the net.
    pub(crate) programs: Vec<&'a Element>,
    /// Elements by their numbers in `roads`.
    pub(super) junctions: Vec<&'a Element>,
    pub(super) edges: Vec<&'a Element>,
    pub(super) connections: Vec<&'a Element>,
    /// All names in the net.
    pub(super) names: HashSet<&'a str>,
    /// Numbers of the connections from each edge, and of those that obey each light.
    from_edge: Vec<Vec<usize>>,
    of_light: HashMap<&'a str, Vec<usize>>,
    /// Edges within each junction.
    inside: HashMap<&'a str, Vec<EdgeNo>>,
}

impl<'a> Source<'a> {
    /// `net`: the root element that `roads` was read from.
    pub(crate) fn new(net: &'a Element, roads: &'a Roads, programs: Vec<&'a Element>) -> Source<'a> {
        let [junctions, edges, connections] =
            ["junction", "edge", "connection"].map(|kind| net.all(kind).collect::<Vec<_>>());
        let counts = [roads.junctions.len(), roads.edges.len(), roads.connections.len()];
        assert_eq!([junctions.len(), edges.len(), connections.len()], counts, "the roads of this net");
        let mut from_edge = vec![Vec::new(); edges.len()];
        let mut of_light: HashMap<&str, Vec<usize>> = HashMap::new();
        for (number, link) in roads.connections.iter().enumerate() {
            from_edge[roads.lane(link.from).edge.0].push(number);
            if let Some(signal) = &link.signal {
                of_light.entry(&signal.light).or_default().push(number);
            }
        }
        let mut inside: HashMap<&str, Vec<EdgeNo>> = HashMap::new();
        for (number, edge) in roads.edges.iter().enumerate().filter(|(_, edge)| edge.function != Function::Road) {
            if let Some(junction) = junction_of(&edge.id) {
                inside.entry(junction).or_default().push(EdgeNo(number));
            }
        }
        let names = net.children.iter().filter_map(|element| element.attribute("id")).collect();
        Source { net, roads, programs, junctions, edges, connections, names, from_edge, of_light, inside }
    }

    /// Returns the numbers of the connections from an edge, in the order of the net.
    pub(super) fn links_from(&self, edge: EdgeNo) -> &[usize] {
        &self.from_edge[edge.0]
    }

    pub(super) fn end(&self, road: EdgeNo) -> &'a Element {
        let [_, end] = self.roads.edge(road).ends.expect("a road has two ends");
        self.junctions[end.0]
    }
}

impl LocalNet {
    /// Cuts out the region of a light, with copies of edges behind its exits.
    ///
    /// Errors: the light controls no cars; it controls something outside of the region; another light controls
    /// something within it; a connection leads out of its junction.
    pub(crate) fn cut(source: &Source<'_>, light: &str, region: &Region, reach: Reach) -> Result<LocalNet> {
        let cut = Cut::new(source, light, region);
        cut.check()?;
        let mut beyond = Beyond::new(source, light, reach);
        cut.exits().for_each(|exit| beyond.add(exit));
        let gate = beyond.finish();
        let begins_within =
            |edge: EdgeNo| source.roads.edge(edge).ends.is_some_and(|[begin, _]| cut.within.contains(&begin));
        let entries = cut.edges.iter().filter(|&&edge| !begins_within(edge));
        let entry_lanes = entries.flat_map(|&edge| &source.roads.edge(edge).lanes).map(|&lane| source.roads.lane(lane));
        let entry_lanes = entry_lanes.filter(|lane| lane.carries_cars).map(|lane| lane.id.clone()).collect();
        let Beyond { exits, elements, .. } = beyond;
        let mut children = cut.elements();
        children.extend(elements);
        // Behind what has no place in this order, and otherwise as before.
        children.sort_by_key(|element| KINDS.iter().position(|kind| *kind == element.name));
        let root = Element { name: "net".to_owned(), attributes: source.net.attributes.clone(), children };
        Ok(LocalNet { light: light.to_owned(), entry_lanes, exits, gate, root })
    }
}

struct Cut<'a> {
    source: &'a Source<'a>,
    light: &'a str,
    within: BTreeSet<JunctionNo>,
    names_within: HashSet<&'a str>,
    /// Roads that begin or end at one of them.
    edges: BTreeSet<EdgeNo>,
}

impl<'a> Cut<'a> {
    fn new(source: &'a Source<'a>, light: &'a str, region: &Region) -> Cut<'a> {
        let within: BTreeSet<JunctionNo> = region.own.iter().chain(&region.passed).copied().collect();
        let names_within = within.iter().map(|&junction| source.roads.junction(junction).id.as_str()).collect();
        Cut { source, light, within, names_within, edges: region.edges(source.roads) }
    }

    fn check(&self) -> Result<()> {
        let light = excerpt(self.light);
        ensure!(
            !self.within.is_empty(),
            "light `{light}`: controls no cars, so there is nothing to cut out; choose another light"
        );
        let of_light = self.source.of_light.get(self.light).into_iter().flatten();
        let numbers: BTreeSet<usize> =
            self.kept().flat_map(|edge| self.source.links_from(edge)).chain(of_light).copied().collect();
        for link in numbers.into_iter().map(|number| &self.source.roads.connections[number]) {
            let [from, to] = [link.from, link.to].map(|lane| self.source.roads.lane(lane).edge);
            let named = || {
                let [from, to] = [from, to].map(|edge| excerpt(&self.source.roads.edge(edge).id));
                format!("the connection from edge `{from}` to edge `{to}`")
            };
            let obeys = link.signal.as_ref().map(|signal| signal.light.as_str());
            if !self.is_within(link) {
                ensure!(
                    obeys != Some(self.light),
                    "light `{light}`: controls {}, too, which is not at the junctions where it controls cars; give \
                     that connection a light of its own in netedit",
                    named()
                );
                continue;
            }
            ensure!(
                obeys.is_none_or(|obeyed| obeyed == self.light),
                "light `{light}`: its region holds {}, which obeys light `{}`; join the two lights in netedit, or \
                 choose another light",
                named(),
                excerpt(obeys.unwrap_or_default())
            );
            ensure!(
                self.keeps(to),
                "light `{light}`: {} leads to an edge that does not begin at its junction; make the net again with \
                 netconvert",
                named()
            );
        }
        Ok(())
    }

    fn is_within(&self, link: &Connection) -> bool {
        match self.source.roads.end_of(link.from) {
            Some(end) => self.within.contains(&end),
            None => self.keeps(self.source.roads.lane(link.from).edge),
        }
    }

    /// Returns the edges that it keeps.
    fn kept(&self) -> impl Iterator<Item = EdgeNo> {
        let inside = self.names_within.iter().filter_map(|junction| self.source.inside.get(junction)).flatten();
        let roads = self.edges.iter().filter(|&&edge| self.source.roads.edge(edge).function == Function::Road);
        roads.chain(inside).copied()
    }

    fn keeps(&self, edge: EdgeNo) -> bool {
        let road = self.source.roads.edge(edge);
        match road.function {
            Function::Road => self.edges.contains(&edge),
            _ => junction_of(&road.id).is_some_and(|junction| self.names_within.contains(junction)),
        }
    }

    fn exits(&self) -> impl Iterator<Item = EdgeNo> {
        let ends_within = |road| self.source.roads.edge(road).ends.is_some_and(|[_, end]| self.within.contains(&end));
        self.edges.iter().copied().filter(move |&road| !ends_within(road))
    }

    /// Returns the elements of the region, each kind in the order of the whole net.
    fn elements(&self) -> Vec<Element> {
        let Source { net, roads, programs, connections, .. } = self.source;
        let kept: BTreeSet<EdgeNo> = self.kept().collect();
        let edges: Vec<&Element> = kept.iter().map(|edge| self.source.edges[edge.0]).collect();
        let used: HashSet<&str> = edges.iter().filter_map(|edge| edge.attribute("type")).collect();
        let types = net.all("type").filter(|kind| kind.attribute("id").is_some_and(|id| used.contains(id)));
        let lights = net.all("tlLogic").chain(programs.iter().copied());
        let own = lights.filter(|light| light.attribute("id") == Some(self.light));
        let (whole, offsets): (Vec<_>, Vec<_>) = own.partition(|light| light.all("phase").next().is_some());
        let mut lights: Vec<Element> = whole.into_iter().cloned().collect();
        offsets.into_iter().for_each(|offset| set_offset(&mut lights, offset));
        let links: BTreeSet<usize> = kept.iter().flat_map(|&edge| self.source.links_from(edge)).copied().collect();
        let links = links.into_iter().filter(|&number| self.is_within(&roads.connections[number]));
        let links = links.map(|number| connections[number]);
        let mut elements: Vec<Element> = net.all("location").chain(types).chain(edges).chain(links).cloned().collect();
        elements.extend(lights);
        elements.extend(self.junctions());
        elements.extend(self.roundabouts());
        elements
    }

    fn junctions(&self) -> Vec<Element> {
        let roads = self.source.roads;
        let ends: BTreeSet<JunctionNo> = self.edges.iter().flat_map(|&edge| roads.edge(edge).ends).flatten().collect();
        let is_left = |lane: &str| roads.lane_named(lane).is_some_and(|lane| self.keeps(roads.lane(lane).edge));
        let junctions = self.source.junctions.iter().enumerate().filter_map(|(number, &junction)| {
            let (id, number) = (&roads.junctions[number].id, JunctionNo(number));
            // A junction inside of another one has the name of a lane.
            let around = id.rsplit_once('_').and_then(|(edge, _)| junction_of(edge));
            if self.within.contains(&number) || around.is_some_and(|around| self.names_within.contains(around)) {
                Some(junction.clone())
            } else {
                ends.contains(&number).then(|| dead_end(junction, is_left))
            }
        });
        junctions.collect()
    }

    fn roundabouts(&self) -> Vec<Element> {
        let roads = self.source.roads;
        let mut roundabouts: Vec<Element> = self.source.net.all("roundabout").cloned().collect();
        for roundabout in &mut roundabouts {
            for (key, value) in &mut roundabout.attributes {
                let names = value.split_whitespace().filter(|name| match key.as_str() {
                    "nodes" => self.names_within.contains(name),
                    "edges" => roads.edge_named(name).is_some_and(|edge| self.keeps(edge)),
                    _ => true,
                });
                *value = names.collect::<Vec<_>>().join(" ");
            }
        }
        roundabouts.retain(|roundabout| roundabout.attribute("edges").is_some_and(|edges| !edges.is_empty()));
        roundabouts
    }
}

/// Returns the junction that an edge within it has its name from, such as `J` for `:J_3`.
fn junction_of(internal: &str) -> Option<&str> {
    internal.strip_prefix(':')?.rsplit_once('_').map(|(junction, _)| junction)
}

/// Gives the program that an element without phases names the element's offset.
fn set_offset(programs: &mut [Element], offset: &Element) {
    const KEY: &str = "offset";
    for program in programs.iter_mut().filter(|program| program::name(program) == program::name(offset)) {
        program.attributes.retain(|(key, _)| key != KEY);
        program.attributes.push((KEY.to_owned(), offset.attribute(KEY).unwrap_or("0").to_owned()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::agents::derive::region::lit_junctions;
    use crate::network::roads::example::changed;
    use crate::network::tree::parse;

    /// Cuts a light out of the example with some texts replaced. At 10 m, the region is the junction J alone.
    fn cut(light: &str, approach_m: f64, changes: &[(&str, &str)]) -> Result<LocalNet> {
        let net = parse(&changed(changes)).unwrap();
        let roads = Roads::read(&net).unwrap();
        let region = Region::of(&roads, &lit_junctions(&roads), light, approach_m, None)?;
        LocalNet::cut(&Source::new(&net, &roads, Vec::new()), light, &region, Reach { hops: 1, ..Reach::default() })
    }

    /// Returns the edges of the continuations: copies behind the exits.
    fn copies(net: &LocalNet) -> Vec<&str> {
        net.exits.iter().flat_map(|exit| &exit.ways).flat_map(|way| &way.copies).map(String::as_str).collect()
    }

    #[test]
    fn lanes_at_the_border_are_entries_and_exits_have_copies_of_what_follows() {
        let net = cut("J", 10.0, &[]).unwrap();
        assert_eq!(net.entry_lanes, ["near_0", "near_1", "north_0"]);
        // Behind `out` there is nothing. From `back` cars go to `west`, or turn around.
        assert_eq!([&*net.exits[0].edge, &*net.exits[1].edge], ["out", "back"]);
        let ends: Vec<f64> = net.exits.iter().flat_map(|exit| &exit.ways).map(|way| way.end_m).collect();
        assert_eq!(ends, [190.0, 15.0, 15.0]);
        assert_eq!(copies(&net), ["back+west", "back+near"]);
        let gate = net.gate.as_ref().unwrap();
        assert_eq!((&*gate.light, &gate.lanes[..]), ("J+exits", &["back_0".to_owned()][..]));
        let lanes = ["near_0", "near_1", "north_0", "out_0", "back_0", "back+west_0", "back+near_0", "back+near_1"];
        assert_eq!(net.lanes().collect::<Vec<_>>(), lanes);
    }

    #[test]
    fn an_offset_of_another_file_is_that_of_the_program_that_it_names() {
        let net = parse(&changed(&[])).unwrap();
        let roads = Roads::read(&net).unwrap();
        let region = Region::of(&roads, &lit_junctions(&roads), "J", 10.0, None).unwrap();
        let offset = parse("<tlLogic id=\"J\" programID=\"0\" offset=\"12\"/>").unwrap();
        let source = Source::new(&net, &roads, vec![&offset]);
        let cut = LocalNet::cut(&source, "J", &region, Reach::default()).unwrap();
        let offsets: Vec<f64> = Roads::read(cut.root()).unwrap().programs.iter().map(|own| own.offset_s).collect();
        assert_eq!(offsets, [12.0, 0.0], "the light and the gate");
    }

    #[test]
    fn a_name_that_is_taken_is_not_taken_again() {
        let net = cut("J", 10.0, &[("id=\"far\"", "id=\"back+west\""), ("from=\"far\"", "from=\"back+west\"")]);
        assert_eq!(copies(&net.unwrap()), ["back+west+", "back+near"]);
    }

    #[test]
    fn what_cannot_be_cut_out_is_refused_with_the_connection_and_the_way_out() {
        let other = [("<junction id='W'", "<tlLogic id='K'><phase duration='9' state='G'/></tlLogic><junction id='W'")];
        let tangled = [&other[..], &[("tl='J' linkIndex='3'", "tl='K' linkIndex='0'")]].concat();
        let back = "<connection from='back' fromLane='0' to='west'";
        let on_foot =
            "<connection from='side' fromLane='0' to='near' toLane='0' tl='J' linkIndex='3'/>".to_owned() + back;
        let jump = ["to='out' toLane='0' tl='J' linkIndex='1'", "to='west' toLane='0' tl='J' linkIndex='1'"];
        for (light, changes, message) in [
            ("K", &other[..], "controls no cars, so there is nothing to cut out; choose another light"),
            (
                "J",
                &tangled,
                "its region holds the connection from edge `near` to edge `back`, which obeys light `K`; join the two \
                 lights in netedit, or choose another light",
            ),
            // People on foot cross under the same light elsewhere.
            (
                "J",
                &[(back, &on_foot)],
                "controls the connection from edge `side` to edge `near`, too, which is not at the junctions where it \
                 controls cars; give that connection a light of its own in netedit",
            ),
            (
                "J",
                &[(jump[0], jump[1])],
                "the connection from edge `north` to edge `west` leads to an edge that does not begin at its junction; \
                 make the net again with netconvert",
            ),
        ] {
            let error = format!("{:#}", cut(light, 10.0, changes).unwrap_err());
            let found = error.strip_prefix(&format!("light `{light}`: "));
            assert_eq!(found, Some(message));
        }
    }
}
