//! The properties that every domain must have, as one check that a test of the domain calls.
//!
//! For the GS: shapes and ranges, repeatability from the seed, and the alignment of influence samples. For the LS of
//! every kind: a reset of one row leaves the others alone, and a row can be retraced in another simulator, to the bit.
//!
//! The check also returns how well the LS reproduces the GS when the recorded sources drive it. Shares of equal
//! observation entries are 1 for domains whose local transition is exact, and the error of the rewards is 0 for them.
//! Others have measured bounds: traffic loses a car's exact position at the entry.

use anyhow::ensure;
use rand::Rng;

use dials_core::base::{Dice, Ragged, RandomPurpose, Rows, Seed};
use dials_core::domain::{Action, Beginning, Domain, JointPercept, Kind, LocalSimulator, Result};

/// The figures that [`check`] measured with the LS, driven by the GS's recorded sources and actions.
#[derive(Clone, Copy, Debug)]
pub struct Conformance {
    /// Share of the GS's non-zero observation entries that the LS had too.
    pub recall: f64,
    /// Share of the LS's non-zero observation entries that the GS had too.
    pub precision: f64,
    /// Mean absolute difference of the rewards, over agents and steps.
    pub reward_error: f64,
}

/// Runs the checks. An error says which property does not hold.
pub fn check(domain: &dyn Domain, seed: Seed) -> Result<Conformance> {
    let recording = record(domain, seed)?;
    ensure!(record(domain, seed)? == recording, "the GS does not repeat an episode from its seed");
    check_shapes(domain, &recording)?;
    let mut likeness = Likeness::default();
    for kind in domain.kinds().iter() {
        let of_kind = recording.of_kind(kind);
        check_rows(domain, kind, &of_kind, seed)?;
        replay_locally(domain, kind, &of_kind, seed, &mut likeness)?;
    }
    likeness.conformance()
}

/// An episode of the GS under random actions.
#[derive(PartialEq)]
struct GsRecording {
    /// Percepts after every step.
    percepts: Vec<JointPercept>,
    actions: Vec<Vec<Action>>,
    sources: Vec<Ragged<u8>>,
    rewards: Vec<Vec<f32>>,
}

/// The recording of the agents of one kind.
struct KindRecording {
    obs: Vec<Rows<f32>>,
    actions: Vec<Vec<Action>>,
    sources: Vec<Rows<u8>>,
    rewards: Vec<Vec<f32>>,
}

impl GsRecording {
    fn of_kind(&self, kind: &Kind) -> KindRecording {
        let agents = || kind.agents.iter().map(|agent| agent.0);
        KindRecording {
            obs: self.percepts.iter().map(|percept| percept.obs.pick(agents()).into_rows()).collect(),
            actions: self.actions.iter().map(|actions| agents().map(|agent| actions[agent]).collect()).collect(),
            sources: self.sources.iter().map(|sources| sources.pick(agents()).into_rows()).collect(),
            rewards: self.rewards.iter().map(|rewards| agents().map(|agent| rewards[agent]).collect()).collect(),
        }
    }
}

/// Returns one of the allowed actions per agent; an empty mask allows all.
fn random_actions(dice: &mut Dice, domain: &dyn Domain, percept: &JointPercept) -> Vec<Action> {
    let of_agent = |(n_actions, mask): (usize, &[bool])| {
        let allowed: Vec<usize> =
            (0..n_actions).filter(|&action| mask.get(action).is_none_or(|&allowed| allowed)).collect();
        allowed[dice.random_range(0..allowed.len())] as Action
    };
    domain.kinds().specs().map(|spec| spec.n_actions).zip(percept.masks.iter()).map(of_agent).collect()
}

fn record(domain: &dyn Domain, seed: Seed) -> Result<GsRecording> {
    let mut gs = domain.global_simulator()?;
    gs.observe_influence()?;
    ensure!(gs.kinds() == domain.kinds(), "the GS has other kinds of agents than the domain");
    let mut dice = seed.fork(RandomPurpose::Actions).dice();
    let mut percept = gs.reset(seed.for_episode(0))?.clone();
    let mut recording = GsRecording { percepts: vec![], actions: vec![], sources: vec![], rewards: vec![] };
    for _ in 0..domain.kinds().horizon() {
        check_masks(domain, &percept)?;
        let actions = random_actions(&mut dice, domain, &percept);
        let transition = gs.step(&actions)?;
        recording.percepts.push(transition.percept.clone());
        recording.rewards.push(transition.rewards.clone());
        let after = transition.percept.clone();
        let sample = gs.influence_sample();
        ensure!(*sample.d_set == percept.d_set, "an influence sample does not hold the d-set from before the step");
        let mut done: Vec<Option<Action>> = actions.iter().copied().map(Some).collect();
        gs.carried_out(&mut done);
        ensure!(
            done.iter().zip(&actions).all(|(done, action)| done.is_none_or(|done| done == *action)),
            "without hand-coded control, the GS reports other actions than it was given"
        );
        recording.sources.push(sample.sources.clone());
        recording.actions.push(actions);
        percept = after;
    }
    check_masks(domain, &percept)?;
    Ok(recording)
}

fn check_masks(domain: &dyn Domain, percept: &JointPercept) -> Result<()> {
    ensure!(percept.masks.len() == domain.agents(), "the GS has masks for {} agents", percept.masks.len());
    for (agent, (spec, mask)) in domain.kinds().specs().zip(percept.masks.iter()).enumerate() {
        let width = if spec.masks { spec.n_actions } else { 0 };
        ensure!(mask.len() == width, "agent {agent}: a mask of {} actions instead of {width}", mask.len());
        ensure!(mask.is_empty() || mask.contains(&true), "agent {agent}: no action is allowed");
    }
    Ok(())
}

fn check_shapes(domain: &dyn Domain, recording: &GsRecording) -> Result<()> {
    let kinds = domain.kinds();
    let of_episode = recording.percepts.iter().zip(recording.sources.iter().zip(&recording.rewards));
    for (percept, (sources, rewards)) in of_episode {
        for (table, widths, what) in [
            (&percept.obs, kinds.specs().map(|spec| spec.obs_dim).collect::<Vec<_>>(), "observations"),
            (&percept.d_set, kinds.specs().map(|spec| spec.d_set_dim).collect(), "d-sets"),
        ] {
            ensure!(table.widths().eq(widths), "{what} have a wrong shape");
        }
        ensure!(
            sources.widths().eq(kinds.specs().map(|spec| spec.sources.count())),
            "influence sources have a wrong shape"
        );
        for (sources, spec) in sources.iter().zip(kinds.specs()) {
            ensure!(
                sources.iter().zip(&spec.sources.classes).all(|(u, classes)| u < classes),
                "an influence source is out of range"
            );
        }
        ensure!(rewards.len() == kinds.agents(), "there are rewards for a wrong number of agents");
        ensure!(rewards.iter().all(|r| r.is_finite()), "a reward is not finite");
    }
    Ok(())
}

/// Counts of observation entries that the GS and the LS showed, together and each on its own.
#[derive(Default)]
struct Likeness {
    /// Number of non-zero entries of observations.
    of_global: u64,
    of_local: u64,
    of_both: u64,
    rewards: u64,
    reward_error: f64,
}

impl Likeness {
    fn conformance(&self) -> Result<Conformance> {
        ensure!(self.of_global > 0, "the GS showed nothing at all");
        ensure!(self.of_local > 0, "the LS showed nothing at all");
        let share = |part: u64, whole: u64| part as f64 / whole as f64;
        Ok(Conformance {
            recall: share(self.of_both, self.of_global),
            precision: share(self.of_both, self.of_local),
            reward_error: self.reward_error / self.rewards as f64,
        })
    }
}

/// Makes local simulators of all regions of a kind.
fn local_simulator(domain: &dyn Domain, kind: &Kind, copies: usize, seed: Seed) -> Result<Box<dyn LocalSimulator>> {
    let ls = domain.local_simulator(&kind.agents, copies, seed)?;
    ensure!(*ls.spec() == kind.spec, "the LS of kind `{}` has another shape than the kind", kind.name);
    ensure!(ls.rows() == kind.agents.len() * copies, "the LS of kind `{}` has {} rows", kind.name, ls.rows());
    Ok(ls)
}

/// Drives one LS per agent by the recorded actions and sources, and compares its percepts with the recorded ones.
fn replay_locally(
    domain: &dyn Domain,
    kind: &Kind,
    recording: &KindRecording,
    seed: Seed,
    likeness: &mut Likeness,
) -> Result<()> {
    let mut ls = local_simulator(domain, kind, 1, seed.for_episode(0))?;
    ls.reset(&Beginning::first(0..kind.agents.len()))?;
    for (t, actions) in recording.actions.iter().enumerate() {
        let local = ls.step(actions, &recording.sources[t])?;
        check_local_masks(kind, local.percept.masks.as_ref())?;
        for (&global, &local) in recording.obs[t].as_slice().iter().zip(local.percept.obs.as_slice()) {
            likeness.of_global += u64::from(global != 0.0);
            likeness.of_local += u64::from(local != 0.0);
            likeness.of_both += u64::from(global != 0.0 && local == global);
        }
        for (global, local) in recording.rewards[t].iter().zip(&local.rewards) {
            likeness.rewards += 1;
            likeness.reward_error += f64::from((global - local).abs());
        }
    }
    Ok(())
}

fn check_local_masks(kind: &Kind, masks: Option<&Rows<bool>>) -> Result<()> {
    ensure!(masks.is_some() == kind.spec.masks, "the LS and its spec differ in whether there are masks");
    for mask in masks.into_iter().flat_map(Rows::iter) {
        ensure!(
            mask.len() == kind.spec.n_actions,
            "the LS of kind `{}` has a mask of {} actions",
            kind.name,
            mask.len()
        );
        ensure!(mask.contains(&true), "the LS of kind `{}` allows no action", kind.name);
    }
    Ok(())
}

/// Runs two copies of every region and resets the second ones on the way, which must not affect the first ones. In
/// another simulator, the first copies have no earlier episode, and the rows begin at other times. The same actions and
/// sources must lead it to the same state, and it must go on from there in the same way.
fn check_rows(domain: &dyn Domain, kind: &Kind, recording: &KindRecording, seed: Seed) -> Result<()> {
    let regions = kind.agents.len();
    let steps = recording.actions.len().min(60);
    let reset_at = steps / 3;
    let rows = |copy: usize, episode| (0..regions).map(move |region| Beginning { row: 2 * region + copy, episode });
    let play = |begin: Vec<Beginning>, from: usize, resets: bool| -> Result<[Vec<Vec<f32>>; 2]> {
        let mut ls = local_simulator(domain, kind, 2, seed)?;
        ls.reset(&begin)?;
        let mut seen = [Vec::new(), Vec::new()];
        for t in from..steps {
            if resets && t == reset_at {
                ls.reset(&rows(1, 1).collect::<Vec<_>>())?;
            }
            let actions: Vec<Action> = recording.actions[t].iter().flat_map(|&action| [action; 2]).collect();
            let mut sources = Rows::new(0, recording.sources[t].width());
            recording.sources[t].iter().for_each(|row| (0..2).for_each(|_| sources.push(row)));
            let transition = ls.step(&actions, &sources)?;
            let values = |row: usize| {
                let mut values = transition.percept.obs.row(row).to_vec();
                values.extend(transition.percept.d_set.row(row));
                values.push(transition.rewards[row]);
                let mask = transition.percept.masks.iter().flat_map(|masks| masks.row(row));
                values.extend(mask.map(|&allowed| f32::from(u8::from(allowed))));
                values
            };
            for (copy, seen) in seen.iter_mut().enumerate() {
                seen.push((0..regions).flat_map(|region| values(2 * region + copy)).collect());
            }
        }
        Ok(seen)
    };
    let both = || rows(0, 0).chain(rows(1, 0)).collect();
    let [undisturbed, _] = play(both(), 0, false)?;
    let [first, second] = play(both(), 0, true)?;
    ensure!(first == undisturbed, "the reset of one row of the LS disturbed another");
    let [_, retraced] = play(rows(0, 7).chain(rows(1, 1)).collect(), reset_at, false)?;
    ensure!(
        second[reset_at..] == retraced,
        "an episode of an LS differs in a new LS: it does not depend on its actions and sources alone"
    );
    Ok(())
}
