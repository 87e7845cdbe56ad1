//! The mean of policies: agents of a kind learn apart for a while, and then go on from the mean of what they have learnt.
//! So each also learns from the samples of the others, and they still train in parallel.
//!
//! Source: McMahan et al. 2017, algorithm 1 (FederatedAveraging), with all agents each time and equal weights. Here the
//! moments of the optimisers are averaged, too.

use crate::algorithms;
use crate::config::Config;
use crate::state::AgentsState;
use dials_core::base::{AgentId, Ragged};
use dials_core::domain::Kinds;

/// Gives all agents of a kind the mean of their policies, and of the tables of their learners that go with them.
///
/// Where the values of an agent are no longer finite, those of its kind stay as they are. A mean would spread NaN to
/// all of them, and nobody could name the agent that diverged.
pub(crate) fn average(agents: &mut AgentsState, config: &Config, kinds: &Kinds) {
    let steps = agents.steps;
    for kind in kinds.iter() {
        average_rows(&mut agents.policies, &kind.agents);
        let layout = algorithms::of(config).layout(config, kind, steps);
        for table in layout.numbers.iter().filter(|table| table.averaged) {
            let rows = agents.learners.numbers.get_mut(table.name).expect("a learner has the tables of its layout");
            average_rows(rows, &kind.agents);
        }
    }
}

/// Overwrites the rows of some agents with their mean, if it is finite. All of them have the same width.
fn average_rows(table: &mut Ragged<f32>, agents: &[AgentId]) {
    let mut sums = vec![0.0_f64; table.row(agents[0].0).len()];
    for agent in agents {
        sums.iter_mut().zip(table.row(agent.0)).for_each(|(sum, value)| *sum += f64::from(*value));
    }
    let mean: Vec<f32> = sums.into_iter().map(|sum| (sum / agents.len() as f64) as f32).collect();
    if mean.iter().all(|value| value.is_finite()) {
        agents.iter().for_each(|agent| table.row_mut(agent.0).copy_from_slice(&mean));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::algorithms::Tables;
    use dials_core::domain::Domain;
    use dials_testkit::toy::CoinsAndDice;

    #[test]
    fn agents_of_a_kind_get_their_mean_and_other_kinds_stay_apart() {
        // Agents 0 and 2 are of one kind, 1 and 3 of the other.
        let domain = CoinsAndDice::new(20);
        let rows = |scale: f32| {
            let values = [[1.0, 2.0].as_slice(), &[10.0], &[2.0, 6.0], &[40.0]].concat();
            Ragged::from_vec(values.into_iter().map(|value| scale * value).collect(), [2, 1, 2, 1]).unwrap()
        };
        let means = |scale: f32| [1.5, 4.0, 25.0, 1.5, 4.0, 25.0].map(|value| scale * value);
        let mut agents = AgentsState {
            steps: 128,
            policies: rows(1.0),
            learners: Tables {
                numbers: [("first_moments", 2.0), ("second_moments", 3.0), ("states", 5.0)]
                    .map(|(name, scale)| (name.to_owned(), rows(scale)))
                    .into(),
                ..Tables::default()
            },
            aips: rows(4.0),
            ..AgentsState::nobody()
        };
        average(&mut agents, &Config::default(), domain.kinds());
        let values = |table: &Ragged<f32>| table.iter().flatten().copied().collect::<Vec<_>>();
        assert_eq!(values(&agents.policies), means(1.0));
        assert_eq!(values(&agents.learners.numbers["first_moments"]), means(2.0));
        assert_eq!(values(&agents.learners.numbers["second_moments"]), means(3.0));
        assert_eq!(agents.learners.numbers["states"], rows(5.0), "hidden states are every agent's own");
        assert_eq!((agents.aips, agents.steps), (rows(4.0), 128));
    }

    #[test]
    fn an_agent_that_has_diverged_does_not_spoil_the_others() {
        for bad in [f32::NAN, f32::INFINITY] {
            let mut table = Ragged::from_vec(vec![1.0, 2.0, 1.0, bad, 3.0, 4.0], [2, 2, 2]).unwrap();
            average_rows(&mut table, &AgentId::all(3));
            let finite: Vec<bool> = table.iter().map(|row| row.iter().all(|value| value.is_finite())).collect();
            assert_eq!(finite, [true, false, true]);
            assert_eq!((table.row(0), table.row(2)), ([1.0, 2.0].as_slice(), [3.0, 4.0].as_slice()));
        }
    }
}
