//! The steps of Algorithm 1 that workers carry out, one type each: the request, what a worker does, its reply,
//! and how the replies of all workers are put together.
//!
//! A [`Fleet`](crate::fleet::Fleet) takes requests to workers, wherever they are. A worker that says what cannot be
//! right counts as lost, so each step has a check of its replies.
//!
//! - [`Evaluate`], [`Demonstrate`], [`Collect`]: episodes on the GS, shared out among all workers.
//! - [`Imitate`], [`TrainAips`], [`MeasureAips`], [`TrainPolicies`]: work of each worker on its own agents.
//! - [`ReportState`]: the state of a worker's agents.

pub mod collect;
pub mod evaluate;
pub mod imitate;
pub mod train_aips;
pub mod train_policies;

use anyhow::ensure;
use serde::{Deserialize, Serialize};

use crate::observer::Observer;
use crate::state::AgentsState;
use crate::state::fits::Fit;
use crate::worker::Worker;
use dials_core::domain::Result;

use collect::Collect;
use evaluate::Evaluate;
use imitate::{Demonstrate, Imitate};
use train_aips::{MeasureAips, TrainAips};
use train_policies::TrainPolicies;

/// A check of a reply: an error says why it cannot be right. [`Fit`]: the agents of the worker that sent it.
pub type Check<Reply> = Box<dyn Fn(&Reply, &Fit<'_>) -> Result<()>>;

/// A step of Algorithm 1, as one worker gets it.
pub trait Step: Route {
    type Reply;

    fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<Self::Reply>;

    fn check(&self) -> Check<Self::Reply>;

    /// Returns up to which timestep per agent it trains, if it does.
    fn trains_until(&self) -> Option<u64> {
        None
    }
}

/// The way of a step to a worker, and of its reply back.
pub trait Route: Sized {
    fn request(self) -> Request;

    /// Returns the reply to this step; `None` if it is the reply to another one.
    fn reply(reply: Reply) -> Option<Self::Reply>
    where
        Self: Step;
}

/// Asks for the state of the worker's agents before the first step.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct ReportState;

impl Step for ReportState {
    type Reply = AgentsState;

    fn run(self, worker: &mut Worker, _observer: &dyn Observer) -> Result<AgentsState> {
        Ok(worker.state())
    }

    fn check(&self) -> Check<AgentsState> {
        Box::new(|state, fit| {
            ensure!(state.steps == 0, "its agents are at step {}, not at 0", state.steps);
            fit.check(state)
        })
    }
}

/// Makes the two enums of all steps from their list. A new step is a file, and a line below.
macro_rules! steps {
    ($($Step:ident),* $(,)?) => {
        #[derive(Debug, Serialize, Deserialize)]
        pub enum Request {
            $($Step($Step),)*
        }

        #[derive(Debug, Serialize, Deserialize)]
        pub enum Reply {
            $($Step(<$Step as Step>::Reply),)*
        }

        impl Request {
            pub fn run(self, worker: &mut Worker, observer: &dyn Observer) -> Result<Reply> {
                match self {
                    $(Request::$Step(step) => step.run(worker, observer).map(Reply::$Step),)*
                }
            }
        }

        $(impl Route for $Step {
            fn request(self) -> Request {
                Request::$Step(self)
            }

            fn reply(reply: Reply) -> Option<<$Step as Step>::Reply> {
                match reply {
                    Reply::$Step(reply) => Some(reply),
                    _ => None,
                }
            }
        })*
    };
}

steps! {
    ReportState,
    Demonstrate,
    Imitate,
    Collect,
    TrainAips,
    MeasureAips,
    TrainPolicies,
    Evaluate,
}
