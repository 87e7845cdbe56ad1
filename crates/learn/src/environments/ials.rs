//! Algorithm 3: trajectories of the influence-augmented local simulators (IALS).

use std::slice::from_ref;
use std::time::Instant;

use anyhow::ensure;

use super::{Environment, Experience, add_steps};
use crate::predictors::InfluencePredictor;
use crate::state::stream::{AgentStream, Part, Trail, fingerprint};
use dials_core::base::{Dice, Phase, Rows, Stopwatch};
use dials_core::domain::{Action, Beginning, LocalSimulator, Percept, Result};

/// Local simulators of one kind, and the influence predictor that drives them. Every row has its own episode.
pub struct Ials<'a, S: ?Sized = dyn LocalSimulator> {
    simulator: Box<S>,
    part: Part,
    predictor: &'a mut dyn InfluencePredictor,
    dice: Vec<Dice>,
    /// Number of steps by which the first episode of each row is shorter.
    head_starts: Vec<usize>,
    trails: Vec<Trail>,
    percept: Percept,
    sources: Rows<u8>,
    experience: Experience,
    /// Totals of the simulator that belong to earlier periods.
    counted: Vec<u64>,
}

impl<'a, S: LocalSimulator + ?Sized> Ials<'a, S> {
    /// Brings new simulators to the state in which `streams` left the old ones, and continues from there.
    ///
    /// `streams`: one per agent, all with the same number of copies; `part`: all copies of the agents whose rows these are.
    /// With `stagger`, the first episode of copy c begins as if `c / copies` of the horizon had passed. So the copies of an
    /// agent end at different times, and its memory holds all parts of an episode.
    ///
    /// The predictor sees the d-sets (its inputs) of the trails again. So an AIP that was trained since then has the
    /// hidden state that it would have had itself. `alive` is called at every step of them.
    pub fn resume(
        mut simulator: Box<S>,
        predictor: &'a mut dyn InfluencePredictor,
        part: Part,
        streams: &[AgentStream],
        stagger: bool,
        alive: &mut dyn FnMut(),
    ) -> Result<Self> {
        let trails: Vec<Trail> = part.of(streams).map(|row| row.trail.clone()).collect();
        predictor.begin(trails.len())?;
        let percept = retrace(&mut *simulator, predictor, (&part, &trails), alive)?;
        let counted = simulator.counters().into_iter().map(|(_, count)| count).collect();
        // The caller has timed this; it is not part of the steps to come.
        simulator.take_watch();
        let spec = simulator.spec();
        let horizon = if stagger { spec.local_horizon } else { 0 };
        let copies = part.copies.len();
        let head_starts = (0..trails.len()).map(|row| head_start(part.place(row).1, copies, horizon));
        Ok(Ials {
            predictor,
            dice: part.of(streams).map(|row| row.influence.clone()).collect(),
            head_starts: head_starts.collect(),
            part,
            percept,
            sources: Rows::new(trails.len(), spec.sources.count()),
            experience: Experience::new(trails.len(), spec),
            counted,
            trails,
            simulator,
        })
    }

    /// Returns what the local simulators counted since [`Ials::resume`].
    pub fn counters(&self) -> Vec<(String, u64)> {
        let totals = self.simulator.counters().into_iter().zip(&self.counted);
        totals.map(|((name, total), before)| (name, total - before)).collect()
    }

    /// Returns what the rows show at their next decision.
    pub fn percept(&self) -> &Percept {
        &self.percept
    }

    /// Returns what the last decision brought the rows.
    pub fn experience(&self) -> &Experience {
        &self.experience
    }

    /// Makes one decision in every row.
    pub fn decide(&mut self, actions: &[Action], watch: &mut Stopwatch) -> Result<()> {
        // u_t ~ I(. | l_t): the AIP sees the d-set from before the step.
        watch.time(Phase::AipSampling, || {
            self.predictor.sample(&self.percept.d_set, &mut self.dice, &mut self.sources)
        })?;
        // x_{t+1} ~ T(. | x_t, a_t, u_t)
        let horizon = self.simulator.spec().local_horizon;
        let begun = Instant::now();
        let transition = self.simulator.step(actions, &self.sources)?;
        let steps = begun.elapsed();
        self.experience.rewards.copy_from_slice(&transition.rewards);
        let mut over = Vec::new();
        for (row, (trail, end)) in self.trails.iter_mut().zip(&mut self.experience.ends).enumerate() {
            trail.push(actions[row], self.sources.row(row));
            let head_start = if trail.episode == 0 { self.head_starts[row] } else { 0 };
            *end = trail.steps() + head_start == horizon;
            if *end {
                trail.end_episode();
                over.push(Beginning { row, episode: trail.episode });
                self.experience.last_obs.row_mut(row).copy_from_slice(transition.percept.obs.row(row));
                if let (Some(last), Some(masks)) = (&mut self.experience.last_masks, &transition.percept.masks) {
                    last.row_mut(row).copy_from_slice(masks.row(row));
                }
            }
        }
        let percept = if over.is_empty() {
            &transition.percept
        } else {
            self.predictor.forget(&over.iter().map(|beginning| beginning.row).collect::<Vec<_>>())?;
            let begun = Instant::now();
            let percept = self.simulator.reset(&over)?;
            watch.note(Phase::Reset, begun.elapsed());
            percept
        };
        self.percept.clone_from(percept);
        add_steps(watch, &self.simulator.take_watch(), steps);
        Ok(())
    }
}

/// Returns the number of steps by which the first episode of a staggered copy is shorter.
pub(crate) fn head_start(copy: usize, copies: usize, horizon: usize) -> usize {
    copy * horizon / copies
}

/// Replays the trails in new simulators. Returns what the rows show at their ends.
///
/// All trails end together. A row whose episode is younger than the oldest one waits, and is reset when its episode
/// begins.
///
/// # Why not otherwise
///
/// **Why not save the state of the simulator?** SUMO can write its state and read it again. But the state that is read
/// is not the state that was written: lights begin anew, and in the middle of an episode cars drive on with other bits.
/// A run that was resumed would then differ from one that was not.
///
/// **Why not keep the simulators from period to period?** libsumo holds one simulation per process, and between two
/// periods a worker may play episodes of the GS. A worker that died has no simulators either, and a resumed run may
/// share the agents otherwise. So there is one way, and every period tests it.
///
/// **Why not end all episodes with the period?** That is simple. But a period need not be a multiple of the horizon,
/// and staggered copies never end together. No episode would be longer than a period, and its end would mean nothing.
///
/// A trail is small: an action and some bits per step. Playing it costs simulation but no learning, half an episode per
/// copy on average.
fn retrace(
    simulator: &mut (impl LocalSimulator + ?Sized),
    predictor: &mut dyn InfluencePredictor,
    (part, trails): (&Part, &[Trail]),
    alive: &mut dyn FnMut(),
) -> Result<Percept> {
    let count = simulator.spec().sources.count();
    let steps = trails.iter().map(Trail::steps).max().unwrap_or(0);
    let beginning = |row: usize| Beginning { row, episode: trails[row].episode };
    let mut percept = simulator.reset(&(0..trails.len()).map(beginning).collect::<Vec<_>>())?.clone();
    let mut actions = vec![0; trails.len()];
    let mut influences = Rows::new(trails.len(), count);
    for step in 0..steps {
        alive();
        for (row, trail) in trails.iter().enumerate() {
            if let Some(step) = (step + trail.steps()).checked_sub(steps) {
                actions[row] = trail.actions[step];
                influences.row_mut(row).copy_from_slice(&trail.sources[step * count..][..count]);
            }
        }
        predictor.watch(&percept.d_set)?;
        percept.clone_from(&simulator.step(&actions, &influences)?.percept);
        let due: Vec<usize> = (0..trails.len()).filter(|&row| trails[row].steps() + step + 1 == steps).collect();
        if !due.is_empty() {
            predictor.forget(&due)?;
            percept.clone_from(simulator.reset(&due.into_iter().map(beginning).collect::<Vec<_>>())?);
        }
    }
    for (row, trail) in trails.iter().enumerate() {
        let (agent, copy) = part.place(row);
        ensure!(
            trail.steps() == 0 || trail.shown == fingerprint(&percept, row),
            "local simulator {copy} of agent {agent} of a block did not come back to where training left it after {} steps of its \
             episode {}; \
             possible causes: another build of SUMO or of this program, or a simulator whose state depends on more than \
             its actions and sources",
            trail.steps(),
            trail.episode
        );
    }
    Ok(percept)
}

impl<S: LocalSimulator + ?Sized> Environment for Ials<'_, S> {
    fn counters(&self) -> Vec<(String, u64)> {
        self.counters()
    }

    fn percepts(&self) -> &[Percept] {
        from_ref(&self.percept)
    }

    fn step(&mut self, actions: &[Vec<Action>], watch: &mut Stopwatch) -> Result<()> {
        self.decide(&actions[0], watch)
    }

    fn experiences(&self) -> &[Experience] {
        from_ref(&self.experience)
    }

    fn leave(&mut self, streams: &mut [&mut [AgentStream]]) {
        let rows = self.trails.iter_mut().zip(&self.dice).zip(self.part.of_mut(streams[0]));
        for (row, ((trail, dice), stream)) in rows.enumerate() {
            trail.shown = fingerprint(&self.percept, row);
            stream.trail.clone_from(trail);
            stream.influence.clone_from(dice);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::state::stream::RowStream;
    use dials_core::base::{AgentId, Seed};
    use dials_core::domain::Domain;
    use dials_testkit::toy::Coins;

    /// A predictor that predicts a constant and records what it was shown.
    #[derive(Default)]
    struct Spy {
        seen: Vec<Rows<f32>>,
        forgotten: Vec<Vec<usize>>,
    }

    impl InfluencePredictor for Spy {
        fn begin(&mut self, rows: usize) -> Result<()> {
            self.forget(&(0..rows).collect::<Vec<_>>())
        }

        fn forget(&mut self, rows: &[usize]) -> Result<()> {
            self.forgotten.push(rows.to_vec());
            Ok(())
        }

        fn watch(&mut self, d_set: &Rows<f32>) -> Result<()> {
            self.seen.push(d_set.clone());
            Ok(())
        }

        fn sample(&mut self, d_set: &Rows<f32>, _dice: &mut [Dice], sources: &mut Rows<u8>) -> Result<()> {
            sources.fill(1);
            self.watch(d_set)
        }
    }

    /// Returns the stream of an agent with two copies at the beginning of its training.
    fn fresh() -> [AgentStream; 1] {
        [AgentStream { rows: vec![RowStream::begin(Seed::new(0).dice()); 2] }]
    }

    fn resumed<'a>(spy: &'a mut Spy, stream: &[AgentStream], stagger: bool) -> Result<Ials<'a>> {
        let coins = Coins::new(4).local_simulator(&[AgentId(0)], 2, Seed::new(0))?;
        Ials::resume(coins, spy, Part { agents: 0..1, copies: 0..2 }, stream, stagger, &mut || ())
    }

    /// What rows went through: ends of episodes, and observations.
    type Seen = Vec<(Vec<bool>, Rows<f32>)>;

    fn step(ials: &mut Ials<'_>, actions: Vec<Action>, seen: &mut Seen) {
        ials.decide(&actions, &mut Stopwatch::default()).unwrap();
        seen.push((ials.experience().ends.clone(), ials.percept().obs.clone()));
    }

    fn run(stagger: bool, steps: usize) -> (Spy, Seen) {
        let (mut spy, mut seen) = (Spy::default(), Seen::new());
        let mut ials = resumed(&mut spy, &fresh(), stagger).unwrap();
        (0..steps).for_each(|_| step(&mut ials, vec![1, 1], &mut seen));
        (spy, seen)
    }

    #[test]
    fn a_stream_goes_on_in_new_simulators_as_if_in_the_old_ones() {
        let actions = |step: usize| vec![(step / 2 % 2) as Action, (step / 3 % 2) as Action];
        let (mut whole, mut parts) = (Seen::new(), Seen::new());
        let (mut spy, mut stream) = (Spy::default(), fresh());
        let mut undisturbed = resumed(&mut spy, &stream, true).unwrap();
        for number in 0..12 {
            step(&mut undisturbed, actions(number), &mut whole);
            let mut spy = Spy::default();
            let mut ials = resumed(&mut spy, &stream, true).unwrap();
            step(&mut ials, actions(number), &mut parts);
            ials.leave(&mut [&mut stream]);
        }
        assert_eq!(whole, parts);
        let trails: Vec<_> = stream[0].rows.iter().map(|row| (row.trail.episode, row.trail.steps())).collect();
        assert_eq!(trails, [(3, 0), (3, 2)], "twelve steps are three episodes of four, and a shorter one before two");

        stream[0].rows[1].trail.shown ^= 1;
        let error = resumed(&mut Spy::default(), &stream, true).err().unwrap().to_string();
        assert!(error.contains("local simulator 1 of agent 0 of a block did not come back"), "{error}");
    }

    #[test]
    fn the_predictor_sees_the_d_set_from_before_the_step_it_drives() {
        let (spy, seen) = run(false, 5);
        let (ends, shown): (Vec<_>, Vec<_>) = seen.into_iter().unzip();
        assert_eq!(spy.seen[0].as_slice(), [0.0; 4], "an episode begins with both coins at 0");
        assert_eq!(spy.seen[1], shown[0]);
        assert_eq!(shown[0].as_slice(), [1.0; 4], "action 1 and source 1 turn both coins to 1");
        assert_eq!(ends, [[false; 2], [false; 2], [false; 2], [true; 2], [false; 2]]);
        assert_eq!(spy.forgotten, [[0, 1], [0, 1]]);
        assert_eq!(shown[3].as_slice(), [0.0; 4], "after the end the next episode is shown");
    }

    #[test]
    fn staggered_copies_end_at_different_times() {
        let (spy, seen) = run(true, 6);
        let copy = |copy: usize| seen.iter().map(|(ends, _)| ends[copy]).collect::<Vec<_>>();
        assert_eq!(copy(0), [false, false, false, true, false, false]);
        assert_eq!(copy(1), [false, true, false, false, false, true]);
        assert_eq!(spy.forgotten, [vec![0, 1], vec![1], vec![0], vec![1]]);
    }
}
