//! The threads that networks may use.

use std::iter;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, Result};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Threads that share networks among them. Networks are independent, so the number of threads changes no result.
///
/// A clone shares the same threads.
#[derive(Clone, Default)]
pub struct Threads {
    pool: Option<Arc<ThreadPool>>,
}

impl Threads {
    /// Uses the calling thread only.
    pub fn one() -> Self {
        Threads::default()
    }

    /// Starts this number of threads; none for 0 or 1, as [`Threads::one`]. Returns an error if the system refuses them.
    pub fn new(count: usize) -> Result<Self> {
        if count < 2 {
            return Ok(Threads::one());
        }
        let pool = ThreadPoolBuilder::new().num_threads(count).build().context("no threads for the networks")?;
        Ok(Threads { pool: Some(Arc::new(pool)) })
    }

    /// Returns their number; 1 for [`Threads::one`].
    pub fn count(&self) -> usize {
        self.pool.as_ref().map_or(1, |pool| pool.current_num_threads())
    }

    /// Does `work` for every item and returns the results in the order of the items.
    ///
    /// Each thread keeps one `Scratch`, working memory for all of its items. Fewer than `worth` items stay in this thread,
    /// because waking another one takes time, too.
    pub fn map<I: Send, Scratch: Default + Send, T: Send>(
        &self,
        items: Vec<I>,
        worth: usize,
        work: impl Fn(&mut Scratch, I) -> T + Sync + Send,
    ) -> Vec<T> {
        match &self.pool {
            Some(pool) if items.len() >= worth => {
                let count = items.len();
                // One by one, so that no thread has many left while another one is idle.
                let left = Mutex::new(items.into_iter().enumerate());
                let done = pool.broadcast(|_| {
                    let mut scratch = Scratch::default();
                    let next = || left.lock().unwrap_or_else(PoisonError::into_inner).next();
                    iter::from_fn(next).map(|(index, item)| (index, work(&mut scratch, item))).collect::<Vec<_>>()
                });
                let mut results: Vec<Option<T>> = (0..count).map(|_| None).collect();
                done.into_iter().flatten().for_each(|(index, result)| results[index] = Some(result));
                results.into_iter().map(|result| result.expect("every item was done")).collect()
            }
            _ => {
                let mut scratch = Scratch::default();
                items.into_iter().map(|item| work(&mut scratch, item)).collect()
            }
        }
    }
}
