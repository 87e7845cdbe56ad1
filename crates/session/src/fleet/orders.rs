//! The steps of Algorithm 1 as orders to the workers, and the results put together from their answers.

use std::ops::Range;

use anyhow::{Result, ensure};

use super::channel::encode;
use super::coordinator::{Coordinator, Stop};
use super::expected::same_names;
use super::footprint::footprint;
use super::link::{Crew, Frame};
use super::message::{Answer, Order};
use super::shares::share;
use super::task::Frames;
use dials_core::base::Activity;
use dials_learn::config::Period;
use dials_learn::evaluation::Evaluation;
use dials_learn::influence::{AipLoss, Dataset, FreshLoss};
use dials_learn::policy::Demonstrations;
use dials_learn::training::answers::{FleetLoad, PolicyTraining, WorkerLoad};
use dials_learn::training::averaging::average;
use dials_learn::training::collect::Purpose;
use dials_learn::training::fleet::Fleet;
use dials_learn::training::imitation::ImitationLoss;
use dials_learn::training::state::AgentsState;

impl<C: Crew> Coordinator<C> {
    /// Makes an order for every worker that gets a share of `episodes`, and sends the joint policy first.
    fn by_episode(&mut self, episodes: usize, order: impl Fn(Range<usize>) -> Order) -> Result<Vec<(usize, Frames)>> {
        // Lent and not copied: with a thousand agents the copy would be a fifth of this process.
        let order_of_all = Order::TakePolicies(std::mem::take(&mut self.agents.policies));
        let encoded = encode(&order_of_all);
        let Order::TakePolicies(policies) = order_of_all else { unreachable!("it was made two lines above") };
        self.agents.policies = policies;
        let policies = Frame::new(encoded?);
        let shares = self.shares(episodes).into_iter();
        shares.map(|(worker, share)| Ok((worker, Frames::after(policies.clone(), &order(share))?))).collect()
    }

    /// Shares `episodes` out among the workers. Returns the workers that get some.
    fn shares(&self, episodes: usize) -> Vec<(usize, Range<usize>)> {
        let shares = (0..self.workers.len()).map(|worker| (worker, share(episodes, self.workers.len(), worker)));
        shares.filter(|(_, share)| !share.is_empty()).collect()
    }

    /// Makes an order with the data of its agents for every worker that owns some. `data`: one item per agent.
    fn by_owner<T>(&self, mut data: Vec<T>, order: impl Fn(Vec<T>) -> Order) -> Result<Vec<(usize, Frames)>> {
        let of_worker = |worker: usize| {
            let theirs = data.drain(..self.workers[worker].agents.len()).collect();
            Ok((worker, Frames::of(&order(theirs))?))
        };
        self.owners().into_iter().map(of_worker).collect()
    }
}

impl<C: Crew> Fleet for Coordinator<C> {
    fn agents(&self) -> &AgentsState {
        &self.agents
    }

    fn restore(&mut self, agents: AgentsState) -> Result<()> {
        self.put_back(agents)
    }

    fn evaluate(&mut self, episodes: usize) -> Result<Evaluation> {
        self.observer.busy(Activity::Evaluation, 0.0);
        let orders = self.by_episode(episodes, |episodes| Order::Evaluate { episodes })?;
        let parts = self.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::Evaluated(part) => part,
            other => unreachable!("`expected` lets only episodes pass, not {other:?}"),
        })?;
        let reports = parts.concat();
        let alike = reports.iter().all(|report| same_names(&reports[0], &report.measures));
        ensure!(alike, "the workers played episodes with different measures");
        Ok(Evaluation::new(&*self.domain, &reports))
    }

    fn collect_demonstrations(&mut self, controller: &str) -> Result<Vec<Demonstrations>> {
        self.observer.busy(Activity::Collection, 0.0);
        let episodes = self.config.learning.imitation.episodes(self.domain.kinds().horizon());
        let order = |episodes| Order::Demonstrate { controller: controller.to_owned(), episodes };
        let shares = self.shares(episodes).into_iter();
        let orders = shares.map(|(worker, share)| Ok((worker, Frames::of(&order(share))?))).collect::<Result<_>>()?;
        let made = self.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::Demonstrated(parts) => parts,
            other => unreachable!("demonstrations were requested, not {other:?}"),
        })?;
        let mut all = Demonstrations::of_all(self.domain.kinds());
        for parts in made {
            all.iter_mut().zip(&parts).for_each(|(whole, part)| whole.extend(part));
        }
        Ok(all)
    }

    fn imitate(&mut self, demonstrations: Vec<Demonstrations>) -> Result<Vec<ImitationLoss>> {
        self.observer.busy(Activity::Training, 0.0);
        let orders = self.by_owner(demonstrations, |demonstrations| Order::Imitate { demonstrations })?;
        let parts = self.ask(orders, Stop::AtOnce, |state, agents, answer| match answer {
            Answer::Imitated { losses, policies } => {
                state.policies.replace(agents.start, &policies);
                losses
            }
            other => unreachable!("policies were requested, not {other:?}"),
        })?;
        Ok(parts.into_iter().flatten().collect())
    }

    fn collect_datasets(&mut self, purpose: Purpose) -> Result<Vec<Dataset>> {
        self.observer.busy(purpose.activity(&self.config.learning), 0.0);
        let horizon = self.domain.kinds().horizon();
        let order = |episodes| Order::Collect { purpose, episodes };
        let orders = self.by_episode(purpose.episodes(&self.config.learning, horizon), order)?;
        let collected = self.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::Collected(parts) => parts,
            other => unreachable!("`expected` lets only datasets pass, not {other:?}"),
        })?;
        let mut datasets = Dataset::of_all(self.domain.kinds());
        for parts in collected {
            datasets.iter_mut().zip(&parts).for_each(|(dataset, part)| dataset.extend(part));
        }
        Ok(datasets)
    }

    fn train_aips(&mut self, datasets: Vec<Dataset>, period: &Period) -> Result<Vec<AipLoss>> {
        self.observer.busy(Activity::AipTraining, 0.0);
        let orders = self.by_owner(datasets, |datasets| Order::TrainAips { datasets, period: *period })?;
        let parts = self.ask(orders, Stop::AtOnce, |state, agents, answer| match answer {
            Answer::AipsTrained { losses, aips } => {
                state.aips.replace(agents.start, &aips);
                losses
            }
            other => unreachable!("`expected` lets only AIPs pass, not {other:?}"),
        })?;
        Ok(parts.into_iter().flatten().collect())
    }

    fn measure_aips(&mut self, datasets: Vec<Dataset>) -> Result<Vec<FreshLoss>> {
        self.observer.busy(Activity::Evaluation, 0.0);
        let orders = self.by_owner(datasets, |datasets| Order::MeasureAips { datasets })?;
        let parts = self.ask(orders, Stop::AtOnce, |_, _, answer| match answer {
            Answer::AipsMeasured(losses) => losses,
            other => unreachable!("`expected` lets only losses pass, not {other:?}"),
        })?;
        Ok(parts.into_iter().flatten().collect())
    }

    fn train_policies(&mut self, period: &Period) -> Result<PolicyTraining> {
        self.observer.trained(self.agents.steps);
        let order = Frames::of(&Order::TrainPolicies { period: *period })?;
        let orders = self.owners().into_iter().map(|worker| (worker, order.clone())).collect();
        let parts = self.ask(orders, Stop::Later, |whole, agents, answer| match answer {
            Answer::PoliciesTrained { training, state } => {
                whole.replace(agents.start, &state);
                training
            }
            other => unreachable!("`expected` lets only policies pass, not {other:?}"),
        })?;
        self.end_those_that_grew();
        Ok(PolicyTraining::joined(parts))
    }

    fn average_policies(&mut self) -> Result<()> {
        average(&mut self.agents, self.domain.kinds());
        self.send_states()
    }

    fn take_load(&mut self) -> FleetLoad {
        let workers = self
            .workers
            .iter_mut()
            .map(|slot| WorkerLoad { timesheet: slot.load.timesheet.take(), footprint: slot.load.footprint });
        FleetLoad {
            workers: workers.collect(),
            at_work: std::mem::take(&mut self.at_work),
            coordinator: Some(footprint()),
            coordinator_cpu: self.clock.lap(),
        }
    }
}
