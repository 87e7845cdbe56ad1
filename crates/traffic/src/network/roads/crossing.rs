//! Which links of a light cross each other or yield to each other, from the right of way of its junctions.

use std::collections::BTreeSet;

use anyhow::{Result, ensure};

use super::{Connection, Function, Junction, JunctionNo, LaneNo, Roads};
use libsumo::SignalState;

impl Roads {
    /// Returns the links of a junction in the order of its requests.
    ///
    /// Source: SUMO 1.15, `MSRightOfWayJunction::postloadInit`: lane by lane, without the ways onto pavements.
    pub fn links_of(&self, junction: JunctionNo) -> Vec<&Connection> {
        let incoming = &self.junction(junction).incoming;
        let is = |lane: LaneNo, function| self.edge(self.lane(lane).edge).function == function;
        let on_foot = |link: &&Connection| {
            let [from, to] = [link.from, link.to].map(|lane| is(lane, Function::WalkingArea));
            to || (from && !is(link.to, Function::Crossing))
        };
        let links = incoming.iter().flat_map(|&lane| self.links_from(lane));
        links.filter(|link| !on_foot(link)).collect()
    }

    /// Returns the junctions at which a light controls cars, in the order of the file.
    pub fn junctions_of(&self, light: &str) -> BTreeSet<JunctionNo> {
        self.under_light(light).filter_map(|link| self.end_of(link.from)).collect()
    }

    /// Returns all pairs of letters of a light whose cars cross each other's way. The smaller letter comes first.
    ///
    /// Errors: a junction has another number of requests than of links.
    pub fn crossing_letters(&self, light: &str) -> Result<BTreeSet<[usize; 2]>> {
        self.crossing_letters_where(light, |link| self.carries_cars(link))
    }

    /// Returns all pairs of letters of a light whose ways cross, also those of people on foot.
    ///
    /// Errors: as those of [`Roads::crossing_letters`].
    pub(crate) fn crossing_letters_of_all(&self, light: &str) -> Result<BTreeSet<[usize; 2]>> {
        self.crossing_letters_where(light, |_| true)
    }

    fn crossing_letters_where(
        &self,
        light: &str,
        counts: impl Fn(&Connection) -> bool,
    ) -> Result<BTreeSet<[usize; 2]>> {
        let mut pairs = BTreeSet::new();
        for junction in self.junctions_of(light) {
            let links = self.links_of(junction);
            let Junction { id, requests, .. } = self.junction(junction);
            // A junction without rules has no requests.
            ensure!(
                requests.is_empty() || requests.len() == links.len(),
                "<junction id=\"{id}\">: has {} elements <request>, but {} links; make the net again with netconvert",
                requests.len(),
                links.len()
            );
            let letter = |link: &Connection| match &link.signal {
                Some(signal) if signal.light == light && counts(link) => Some(signal.letter),
                _ => None,
            };
            for (link, request) in links.iter().zip(requests) {
                let crossed = links.iter().zip(&request.crosses).filter(|(_, crosses)| **crosses);
                for (other, _) in crossed {
                    if let (Some(one), Some(two)) = (letter(link), letter(other)) {
                        pairs.insert([one.min(two), one.max(two)]);
                    }
                }
            }
        }
        Ok(pairs)
    }

    /// Returns two letters of a light whose cars yield to each other, and to which one of these states gives green that
    /// yields at once. SUMO refuses a program with such a state in an additional file, but not in the net.
    ///
    /// Source: SUMO 1.15, `MSTrafficLightLogic::init`.
    pub(crate) fn waiting_for_each_other(&self, light: &str, states: &[&SignalState]) -> Option<[usize; 2]> {
        let letter = |link: &Connection| link.signal.as_ref().filter(|is| is.light == light).map(|is| is.letter);
        let yields = |state: &SignalState, letter: usize| {
            matches!(state.as_str().as_bytes().get(letter), Some(b'g' | b'o' | b's'))
        };
        let at_once =
            |pair: [usize; 2]| states.iter().any(|state| pair.into_iter().all(|letter| yields(state, letter)));
        let controlled = self.of_light(light).filter_map(|link| self.end_of(link.from));
        controlled.collect::<BTreeSet<_>>().into_iter().find_map(|junction| {
            let letters: Vec<Option<usize>> = self.links_of(junction).into_iter().map(letter).collect();
            let requests = &self.junction(junction).requests;
            // A broken net may have requests that are too short.
            let yields_to = |one: usize, two: usize| requests[one].yields_to.get(two) == Some(&true);
            let is_mutual = |one: usize, two: usize| yields_to(one, two) && yields_to(two, one);
            let count = letters.len().min(requests.len());
            let pairs = (0..count).flat_map(|one| (one..count).map(move |two| (one, two)));
            let mutual = pairs.filter(|&(one, two)| is_mutual(one, two));
            mutual.filter_map(|(one, two)| Some([letters[one]?, letters[two]?])).find(|&pair| at_once(pair))
        })
    }
}
