//! Longest reds of one light: no link stays without green for longer than its limit, whatever the agent does.
//!
//! A light that is asked to serve a link only when its time is over may be too late: another green may have to last its
//! shortest time first, and others may be due as well. So the light looks ahead. It knows a *rota*: greens that together
//! open all links, each at its shortest, one after the other, for ever. A move is safe if the light can begin the rota
//! after it and no link waits too long. From a safe place the rota itself is safe, so some safe move is always there.

use super::phase_plan::PhasePlan;
use libsumo::SignalState;

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct RedLimits {
    links: Vec<Link>,
    /// Greens that together open all links with a limit, in the order of the rota. Green 0, which begins an episode, is
    /// among them.
    rota: Vec<usize>,
    /// Number of steps from the beginning of a green of the rota to the first green of each link, `[place in rota][link]`.
    until_green: Vec<Vec<u32>>,
    /// Whether only the next green of all may follow a green. The rota then has all greens.
    in_order: bool,
}

/// A link with a limit.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Link {
    letter: usize,
    most_steps: u32,
    /// Whether each green opens it.
    opened: Vec<bool>,
}

/// The rota of a light is too long for a limit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct TooShort {
    pub(crate) letter: usize,
    pub(crate) most_steps: u32,
    /// Longest red of this link in the rota.
    pub(crate) needed_steps: u32,
    /// Greens of the rota, each with its shortest duration and the steps between it and the next one.
    pub(crate) rota: Vec<(usize, u32, u32)>,
}

fn is_open(state: &SignalState, letter: usize) -> bool {
    matches!(state.as_str().as_bytes()[letter], b'G' | b'g')
}

impl RedLimits {
    /// Returns the limits of a light. `limits`: letters with the most steps for which each may be without green. Letters
    /// that no green opens are left out; `None`: no letter is left. Errors: the rota needs longer than a limit.
    pub(crate) fn of(plan: &PhasePlan, limits: &[(usize, u32)]) -> Result<Option<RedLimits>, TooShort> {
        let opened = |letter: usize| plan.greens().iter().map(|green| is_open(green, letter)).collect::<Vec<_>>();
        let links = limits.iter().map(|&(letter, most_steps)| Link { letter, most_steps, opened: opened(letter) });
        let links: Vec<Link> = links.filter(|link| link.opened.contains(&true)).collect();
        if links.is_empty() {
            return Ok(None);
        }
        let in_order = plan.keeps_order();
        let mut rota = if in_order { (0..plan.greens().len()).collect() } else { cover(plan.greens().len(), &links) };
        if rota.len() == 1 && plan.max_green_steps()[0].is_some() {
            // The light must leave the green that opens all links, so it must be able to come back.
            let away = |&green: &usize| {
                plan.clearing_steps(0, green) + plan.least_before(green, 0) + plan.clearing_steps(green, 0)
            };
            rota.extend((1..plan.greens().len()).min_by_key(away));
        }
        let mut found = RedLimits { until_green: Vec::new(), links, rota, in_order };
        found.until_green = (0..found.rota.len()).map(|place| found.until_green(plan, place)).collect();
        found.check(plan).map(|()| Some(found))
    }

    /// Returns the steps from the beginning of a green of the rota to the first green of each link.
    fn until_green(&self, plan: &PhasePlan, place: usize) -> Vec<u32> {
        let of_link = |link: &Link| {
            let mut steps = 0;
            for ahead in 0..self.rota.len() {
                let [green, next] = [0, 1].map(|more| self.rota[(place + ahead + more) % self.rota.len()]);
                if link.opened[green] {
                    break;
                }
                steps += plan.least_before(green, next) + plan.clearing_steps(green, next);
            }
            steps
        };
        self.links.iter().map(of_link).collect()
    }

    /// Errors: the link of which the rota misses the limit by most; the first of equals.
    fn check(&self, plan: &PhasePlan) -> Result<(), TooShort> {
        let places = self.rota.len();
        let mut worst: Option<TooShort> = None;
        for (number, link) in self.links.iter().enumerate() {
            // Between two greens that both open it, a link stays open.
            let red_after = |place: usize| {
                let [green, next] = [self.rota[place], self.rota[(place + 1) % places]];
                if link.opened[green] && !link.opened[next] {
                    plan.closed_steps(green, next, link.letter) + self.until_green[(place + 1) % places][number]
                } else {
                    0
                }
            };
            let needed_steps = (0..places).map(red_after).max().unwrap_or(0);
            let misses = |it: &TooShort| it.needed_steps - it.most_steps;
            if needed_steps > link.most_steps + worst.as_ref().map_or(0, misses) {
                let step = |place: usize| {
                    let [green, next] = [self.rota[place], self.rota[(place + 1) % places]];
                    (green, plan.min_green_steps()[green], plan.lost_steps(green, next))
                };
                let rota = (0..places).map(step).collect();
                worst = Some(TooShort { letter: link.letter, most_steps: link.most_steps, needed_steps, rota });
            }
        }
        worst.map_or(Ok(()), Err)
    }

    pub(crate) fn links(&self) -> usize {
        self.links.len()
    }

    /// Returns the letters with their limits in steps.
    pub(crate) fn letters(&self) -> impl Iterator<Item = (usize, u32)> {
        self.links.iter().map(|link| (link.letter, link.most_steps))
    }

    /// Counts a step in which a light shows `state`. `red`: steps since each link had green.
    pub(crate) fn note(&self, state: &SignalState, red: &mut [u32]) {
        for (link, red) in self.links.iter().zip(red) {
            *red = if is_open(state, link.letter) { 0 } else { *red + 1 };
        }
    }

    /// Returns whether a light may show `green` for one more step. `shown`: steps that it is then shown. `red`: steps
    /// since each link had green.
    pub(crate) fn may_stay(&self, plan: &PhasePlan, green: usize, shown: u32, red: &[u32]) -> bool {
        let left = |next: usize| plan.least_before(green, next).saturating_sub(shown);
        let of_link = |link: usize, next: usize| (!self.links[link].opened[green]).then(|| red[link] + 1 + left(next));
        self.is_safe(plan, green, of_link)
    }

    /// Returns whether a light may leave the green `from` for the green `to` now.
    pub(crate) fn may_go(&self, plan: &PhasePlan, from: usize, to: usize, red: &[u32]) -> bool {
        if self.in_order && to != plan.next(from) {
            return false;
        }
        let clearing = plan.clearing_steps(from, to);
        let in_time = self.links.iter().zip(red).all(|(link, &red)| {
            let waits = link.opened[to] && !link.opened[from];
            !waits || red + clearing <= link.most_steps
        });
        let of_link = |number: usize, next: usize| {
            let link = &self.links[number];
            let cleared = || match link.opened[from] {
                true => plan.closed_steps(from, to, link.letter),
                false => red[number] + clearing,
            };
            (!link.opened[to]).then(|| cleared() + plan.least_before(to, next))
        };
        in_time && self.is_safe(plan, to, of_link)
    }

    /// Returns whether the rota can follow a green so that no link waits too long. `red(link, next)`: the steps since a link
    /// had green when that green can be left for the next one; `None`: it has green.
    fn is_safe(&self, plan: &PhasePlan, green: usize, red: impl Fn(usize, usize) -> Option<u32>) -> bool {
        let follows = |next: usize| if self.in_order { next == plan.next(green) } else { next != green };
        let in_time = |place: usize| {
            let next = self.rota[place];
            self.links.iter().enumerate().all(|(number, link)| {
                let until = self.until_green[place][number];
                let keeps = link.opened[green] && link.opened[next];
                let red = match red(number, next) {
                    Some(red) => red + plan.clearing_steps(green, next),
                    None => plan.closed_steps(green, next, link.letter),
                };
                keeps || red + until <= link.most_steps
            })
        };
        let mut places = (0..self.rota.len()).filter(|&place| follows(self.rota[place])).peekable();
        // A rota of this green alone: it opens all links.
        places.peek().is_none() || places.any(in_time)
    }

    /// Returns the longest time for which a link that a green opens has waited, in steps.
    pub(crate) fn longest_wait(&self, green: usize, red: &[u32]) -> u32 {
        let opened = self.links.iter().zip(red).filter(|(link, _)| link.opened[green]);
        opened.map(|(_, &red)| red).max().unwrap_or(0)
    }
}

/// Returns greens that together open all links, in their order: green 0, then always the one that opens most of the rest.
fn cover(greens: usize, links: &[Link]) -> Vec<usize> {
    let mut rota = vec![0];
    loop {
        let closed = links.iter().filter(|link| !rota.iter().any(|&green| link.opened[green]));
        let closed: Vec<&Link> = closed.collect();
        if closed.is_empty() {
            break;
        }
        let opens = |green: &usize| closed.iter().filter(|link| link.opened[*green]).count();
        let most = (0..greens).rev().max_by_key(opens).expect("a light has greens");
        rota.push(most);
    }
    rota.sort_unstable();
    rota
}
