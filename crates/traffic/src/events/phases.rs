//! From what a light shows, second by second, to the events of its phases.

use super::code;
use super::site::{PhaseKind, Site};
use libsumo::SignalState;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Colour {
    Green,
    Yellow,
    /// Also red and yellow before green, a green arrow after a stop, and a light that is off.
    Red,
}

/// What the phases of a light showed last. Nothing before the first second of an episode.
#[derive(Clone, Debug)]
pub(super) struct PhaseClock {
    shown: Vec<Option<Colour>>,
    /// Whether each phase of cars has ended its yellow, and no other one has begun since.
    clears: Vec<bool>,
    /// Whether the walk of each crossing has ended, and no phase of cars has changed since.
    walk_ended: Vec<bool>,
}

impl PhaseClock {
    pub(super) fn new(site: &Site) -> PhaseClock {
        let [clears, walk_ended] = [(); 2].map(|()| vec![false; site.phases.len()]);
        PhaseClock { shown: vec![None; site.phases.len()], clears, walk_ended }
    }

    /// Returns codes and phases of the events at the beginning of a second in which the light shows `state`.
    ///
    /// The red clearance of a phase ends when another one gets green. That of people on foot ends when a phase of cars changes. A
    /// phase that is red when the episode begins has no event until its green.
    pub(super) fn second(&mut self, site: &Site, state: &SignalState) -> Vec<(u16, u16)> {
        use Colour::{Green, Red, Yellow};
        let now: Vec<Colour> = site.phases.iter().map(|phase| colour(state, &phase.letters)).collect();
        let mut events = Vec::new();
        let mut opens = false;
        let keeps = |number: usize| self.shown[number] == Some(now[number]);
        let mut of_cars = (0..now.len()).filter(|&number| site.phases[number].kind == PhaseKind::Vehicles);
        let cars_keep = of_cars.all(keeps);
        for (number, phase) in site.phases.iter().enumerate() {
            let parameter = u16::try_from(number + 1).expect("a light has fewer phases than letters");
            let codes: &[u16] = match (phase.kind, self.shown[number], now[number]) {
                (PhaseKind::Pedestrians, Some(Red), Red) if self.walk_ended[number] && !cars_keep => {
                    &[code::PEDESTRIAN_BEGIN_DONT_WALK]
                }
                (_, before, now) if before == Some(now) => &[],
                (PhaseKind::Vehicles, None | Some(Red), Green) => &[code::PHASE_BEGIN_GREEN],
                (PhaseKind::Vehicles, Some(Green), Yellow) => {
                    &[code::PHASE_GREEN_TERMINATION, code::PHASE_BEGIN_YELLOW]
                }
                (PhaseKind::Vehicles, Some(Green), Red) => {
                    &[code::PHASE_GREEN_TERMINATION, code::PHASE_BEGIN_RED_CLEARANCE]
                }
                (PhaseKind::Vehicles, Some(Yellow), Red) => &[code::PHASE_END_YELLOW, code::PHASE_BEGIN_RED_CLEARANCE],
                (PhaseKind::Vehicles, Some(Yellow), Green) => &[code::PHASE_END_YELLOW, code::PHASE_BEGIN_GREEN],
                (PhaseKind::Pedestrians, _, Green) => &[code::PEDESTRIAN_BEGIN_WALK],
                (PhaseKind::Pedestrians, Some(Green), Yellow) => &[code::PEDESTRIAN_BEGIN_CLEARANCE],
                (PhaseKind::Pedestrians, Some(Green), Red) if cars_keep => &[code::PEDESTRIAN_BEGIN_CLEARANCE],
                (PhaseKind::Pedestrians, Some(_), Red) => &[code::PEDESTRIAN_BEGIN_DONT_WALK],
                _ => &[],
            };
            let begins = codes.contains(&code::PHASE_BEGIN_GREEN);
            if begins && self.clears[number] {
                events.push((code::PHASE_END_RED_CLEARANCE, parameter));
                self.clears[number] = false;
            }
            opens |= begins;
            self.clears[number] |= codes.contains(&code::PHASE_BEGIN_RED_CLEARANCE);
            if !codes.is_empty() {
                self.walk_ended[number] = codes == [code::PEDESTRIAN_BEGIN_CLEARANCE];
            }
            events.extend(codes.iter().map(|&code| (code, parameter)));
        }
        if opens {
            for (number, clears) in self.clears.iter_mut().enumerate().filter(|(_, clears)| **clears) {
                *clears = false;
                events.push((code::PHASE_END_RED_CLEARANCE, number as u16 + 1));
            }
        }
        self.shown = now.into_iter().map(Some).collect();
        events
    }
}

fn colour(state: &SignalState, letters: &[usize]) -> Colour {
    let shown = state.as_str().as_bytes();
    let has =
        |wanted: &[u8]| letters.iter().any(|&letter| shown.get(letter).is_some_and(|shown| wanted.contains(shown)));
    if has(b"Gg") {
        Colour::Green
    } else if has(b"yY") {
        Colour::Yellow
    } else {
        Colour::Red
    }
}

#[cfg(test)]
mod tests {
    use super::super::site::Phase;
    use super::*;

    fn phase(kind: PhaseKind, letters: &[usize]) -> Phase {
        Phase {
            kind,
            edge: String::new(),
            street: String::new(),
            directions: Default::default(),
            lanes: Vec::new(),
            letters: letters.to_vec(),
            greens: Vec::new(),
        }
    }

    /// Returns the events of a light with phases 1 (letters 0 and 1), 2 (letter 2) and a crossing, 3 (letter 3).
    fn events(states: &[&str]) -> Vec<(usize, u16, u16)> {
        let phases = vec![
            phase(PhaseKind::Vehicles, &[0, 1]),
            phase(PhaseKind::Vehicles, &[2]),
            phase(PhaseKind::Pedestrians, &[3]),
        ];
        let site = Site { light: "J".into(), phases, detectors: Vec::new(), greens: Vec::new() };
        let mut clock = PhaseClock::new(&site);
        let mut all = Vec::new();
        for (second, state) in states.iter().enumerate() {
            let events = clock.second(&site, &SignalState::new(*state).unwrap());
            all.extend(events.into_iter().map(|(code, phase)| (second, code, phase)));
        }
        all
    }

    #[test]
    fn a_phase_goes_through_green_yellow_and_red_clearance_until_another_one_begins() {
        let found = events(&["GGrG", "GGrG", "yyrr", "rrrr", "rrGr", "rryr", "GGrG"]);
        let expected = [
            (0, 1, 1),
            (0, 21, 3),
            (2, 7, 1),
            (2, 8, 1),
            (2, 23, 3),
            (3, 9, 1),
            (3, 10, 1),
            (4, 1, 2),
            (4, 11, 1),
            (5, 7, 2),
            (5, 8, 2),
            // No red between two greens: the clearance of phase 2 has no length.
            (6, 1, 1),
            (6, 9, 2),
            (6, 10, 2),
            (6, 21, 3),
            (6, 11, 2),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn people_on_foot_have_a_clearance_while_cars_keep_their_green() {
        let found = events(&["GGrG", "GGrr", "GGrr", "yyrr", "rrGr", "GGrG"]);
        let of_crossing: Vec<(usize, u16)> =
            found.into_iter().filter(|&(.., phase)| phase == 3).map(|(second, code, _)| (second, code)).collect();
        assert_eq!(of_crossing, [(0, 21), (1, 22), (3, 23), (5, 21)]);
    }

    #[test]
    fn a_phase_has_green_while_one_of_its_ways_has() {
        // A way of phase 1 loses green, then the other one gets yellow.
        assert_eq!(events(&["GGrr", "yGrr", "rgrr", "ryrr"]), [(0, 1, 1), (3, 7, 1), (3, 8, 1)]);
        // Red and yellow before green is red, and the same phase may come again.
        assert_eq!(
            events(&["ggrr", "rrrr", "uurr", "GGrr"]),
            [(0, 1, 1), (1, 7, 1), (1, 10, 1), (3, 11, 1), (3, 1, 1)]
        );
    }
}
