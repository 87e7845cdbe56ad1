//! What every domain must hold, as one check that a test of the domain calls.
//!
//! Shapes and ranges, repeatability from the seed, the alignment of influence samples, that a reset of one row of a
//! local simulator leaves the others alone, and that a row can be retraced in another simulator to the bit. How well the LS reproduces the GS when it is driven by the recorded sources
//! is returned as shares of equal observation entries, which are 1 for domains whose local transition is exact, and the
//! error of its rewards, which is 0 for them; others have measured bounds (traffic loses a car's exact position at the
//! entry).

use anyhow::ensure;
use rand::Rng;

use super::{Action, Beginning, Domain, Result};
use crate::base::{AgentId, Dice, RandomPurpose, Rows, Seed};

/// What [`check`] measured with the LS driven by the GS's recorded sources and actions.
#[derive(Clone, Copy, Debug)]
pub struct Conformance {
    /// Share of the GS's non-zero observation entries that the LS had too.
    pub recall: f64,
    /// Share of the LS's non-zero observation entries that the GS had too.
    pub precision: f64,
    /// Mean absolute difference of the rewards, over agents and steps.
    pub reward_error: f64,
}

/// Runs the checks; an error says which promise is broken.
pub fn check(domain: &dyn Domain, seed: Seed) -> Result<Conformance> {
    let recording = record(domain, seed)?;
    ensure!(record(domain, seed)? == recording, "the GS does not repeat an episode from its seed");
    check_shapes(domain, &recording)?;
    check_single_resets(domain, &recording, seed)?;
    check_that_rows_can_be_retraced(domain, &recording, seed)?;
    replay_locally(domain, &recording, seed)
}

/// An episode of the GS under random actions.
#[derive(PartialEq)]
struct Recording {
    obs: Vec<Rows<f32>>,
    actions: Vec<Vec<Action>>,
    d_sets: Vec<Rows<f32>>,
    sources: Vec<Rows<u8>>,
    rewards: Vec<Vec<f32>>,
}

fn random_actions(dice: &mut Dice, rows: usize, n_actions: usize) -> Vec<Action> {
    (0..rows).map(|_| dice.random_range(0..n_actions) as Action).collect()
}

fn record(domain: &dyn Domain, seed: Seed) -> Result<Recording> {
    let spec = domain.spec();
    let mut gs = domain.global_simulator()?;
    let mut dice = seed.fork(RandomPurpose::Actions).dice();
    let mut d_set = {
        let percept = gs.reset(seed.for_episode(0))?;
        percept.d_set.clone()
    };
    let mut recording = Recording { obs: vec![], actions: vec![], d_sets: vec![], sources: vec![], rewards: vec![] };
    for _ in 0..spec.horizon {
        let actions = random_actions(&mut dice, domain.agents(), spec.n_actions);
        let transition = gs.step(&actions)?;
        recording.obs.push(transition.percept.obs.clone());
        recording.rewards.push(transition.rewards.clone());
        let after = transition.percept.d_set.clone();
        let sample = gs.influence_sample();
        ensure!(*sample.d_set == d_set, "an influence sample does not hold the d-set from before the step");
        recording.d_sets.push(sample.d_set.clone());
        recording.sources.push(sample.sources.clone());
        recording.actions.push(actions);
        d_set = after;
    }
    Ok(recording)
}

fn check_shapes(domain: &dyn Domain, recording: &Recording) -> Result<()> {
    let spec = domain.spec();
    let classes = spec.sources.classes() as u8;
    for (obs, (sources, rewards)) in recording.obs.iter().zip(recording.sources.iter().zip(&recording.rewards)) {
        ensure!((obs.len(), obs.width()) == (domain.agents(), spec.obs_dim), "observations of a wrong shape");
        ensure!(sources.width() == spec.sources.count(), "influence sources of a wrong shape");
        ensure!(sources.as_slice().iter().all(|&u| u < classes), "an influence source out of range");
        ensure!(rewards.iter().all(|r| r.is_finite()), "a reward that is not finite");
    }
    Ok(())
}

/// Drives one LS per agent by the recorded actions and sources and compares what it shows.
fn replay_locally(domain: &dyn Domain, recording: &Recording, seed: Seed) -> Result<Conformance> {
    let regions = AgentId::all(domain.agents());
    let mut ls = domain.local_simulator(&regions, 1, seed.for_episode(0))?;
    ls.reset(&Beginning::first(0..regions.len()))?;
    let (mut of_global, mut of_local, mut of_both) = (0_u64, 0_u64, 0_u64);
    let (mut rewards, mut reward_error) = (0_u64, 0.0);
    for (t, actions) in recording.actions.iter().enumerate() {
        let local = ls.step(actions, &recording.sources[t])?;
        for (&global, &local) in recording.obs[t].as_slice().iter().zip(local.percept.obs.as_slice()) {
            of_global += u64::from(global != 0.0);
            of_local += u64::from(local != 0.0);
            of_both += u64::from(global != 0.0 && local == global);
        }
        for (global, local) in recording.rewards[t].iter().zip(&local.rewards) {
            rewards += 1;
            reward_error += f64::from((global - local).abs());
        }
    }
    ensure!(of_global > 0, "the GS showed nothing at all");
    ensure!(of_local > 0, "the LS showed nothing at all");
    let share = |part: u64, whole: u64| part as f64 / whole as f64;
    Ok(Conformance {
        recall: share(of_both, of_global),
        precision: share(of_both, of_local),
        reward_error: reward_error / rewards as f64,
    })
}

/// Two copies of every region in step with each other; one is reset alone, the other must not notice.
fn check_single_resets(domain: &dyn Domain, recording: &Recording, seed: Seed) -> Result<()> {
    let regions = AgentId::all(domain.agents());
    let trace = |reset_at: Option<usize>| -> Result<Vec<f32>> {
        let mut ls = domain.local_simulator(&regions, 2, seed)?;
        ls.reset(&Beginning::first(0..ls.rows()))?;
        let mut seen = Vec::new();
        for t in 0..recording.actions.len().min(60) {
            if reset_at == Some(t) {
                ls.reset(
                    &(0..regions.len()).map(|region| Beginning { row: 2 * region + 1, episode: 1 }).collect::<Vec<_>>(),
                )?;
            }
            let actions: Vec<Action> = recording.actions[t].iter().flat_map(|&action| [action; 2]).collect();
            let mut sources = Rows::new(0, recording.sources[t].width());
            recording.sources[t].iter().for_each(|row| (0..2).for_each(|_| sources.push(row)));
            let transition = ls.step(&actions, &sources)?;
            for region in 0..regions.len() {
                seen.extend_from_slice(transition.percept.obs.row(2 * region));
                seen.push(transition.rewards[2 * region]);
            }
        }
        Ok(seen)
    };
    ensure!(trace(None)? == trace(Some(25))?, "the reset of one row of the LS disturbed another");
    Ok(())
}

/// Two copies of every region, one of them reset on the way. A second simulator, in which the first copies never lived
/// through an earlier episode and the rows began at other times, must be led to the same place by the same actions and
/// sources, and go on from there in the same way.
fn check_that_rows_can_be_retraced(domain: &dyn Domain, recording: &Recording, seed: Seed) -> Result<()> {
    const COPIES: usize = 2;
    let regions = AgentId::all(domain.agents());
    let steps = recording.actions.len().min(60);
    let reset_at = steps / 3;
    let second_copies = |episode| (0..regions.len()).map(move |region| Beginning { row: COPIES * region + 1, episode });
    let first_copies = |episode| (0..regions.len()).map(move |region| Beginning { row: COPIES * region, episode });
    let play = |begin: Vec<Beginning>, from: usize| -> Result<Vec<(Vec<f32>, Vec<f32>)>> {
        let mut ls = domain.local_simulator(&regions, COPIES, seed)?;
        ls.reset(&begin)?;
        let mut seen = Vec::new();
        for t in from..steps {
            if t == reset_at && from < reset_at {
                ls.reset(&second_copies(1).collect::<Vec<_>>())?;
            }
            let actions: Vec<Action> = recording.actions[t].iter().flat_map(|&action| [action; COPIES]).collect();
            let mut sources = Rows::new(0, recording.sources[t].width());
            recording.sources[t].iter().for_each(|row| (0..COPIES).for_each(|_| sources.push(row)));
            let transition = ls.step(&actions, &sources)?;
            let values = |row: usize| {
                let mut values = transition.percept.obs.row(row).to_vec();
                values.extend(transition.percept.d_set.row(row));
                values.push(transition.rewards[row]);
                values
            };
            let of_copy = |copy: usize| (0..regions.len()).flat_map(|region| values(COPIES * region + copy)).collect();
            seen.push((of_copy(0), of_copy(1)));
        }
        Ok(seen)
    };
    let original = play(first_copies(0).chain(second_copies(0)).collect(), 0)?;
    let retraced = play(first_copies(7).chain(second_copies(1)).collect(), reset_at)?;
    let same = original[reset_at..].iter().zip(&retraced).all(|((_, original), (_, retraced))| original == retraced);
    ensure!(
        same,
        "an episode of an LS is another one in a new LS: it does not follow from its actions and sources alone"
    );
    Ok(())
}
