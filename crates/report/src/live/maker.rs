//! Makes one page at a time, however many ask for it.
//!
//! A page of many runs may take seconds. So one thread makes pages, and those who ask wait. Whoever asks while a page is
//! being made gets the next one, together with all others who wait. So no page is older than the request for it, and a
//! thousand requests at once cost no more than two pages.
//!
//! Keeping a page for a second would not do: what was trained within this second would be missing.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

use tokio::sync::watch;
use tokio::sync::watch::error::RecvError;

/// The newest page. Pages are numbered from 1.
#[derive(Default)]
struct Newest {
    number: u64,
    text: String,
}

/// The side that asks for pages.
pub(super) struct Pages {
    bell: SyncSender<()>,
    /// Number of the page that was begun last.
    begun: Arc<AtomicU64>,
    newest: watch::Receiver<Newest>,
}

/// The side that makes them.
pub(super) struct Maker {
    bell: Receiver<()>,
    begun: Arc<AtomicU64>,
    newest: watch::Sender<Newest>,
}

pub(super) fn pages() -> (Pages, Maker) {
    // More than one ring that nobody has heard yet would ask for the same page.
    let (ring, bell) = sync_channel(1);
    let (sender, newest) = watch::channel(Newest::default());
    let begun = Arc::new(AtomicU64::new(0));
    (Pages { bell: ring, begun: begun.clone(), newest }, Maker { bell, begun, newest: sender })
}

impl Pages {
    /// Returns a page whose making begins after this call. The maker has ended: an error.
    pub(super) async fn page(&self) -> Result<String, RecvError> {
        let begun = self.begun.load(Ordering::SeqCst);
        // If it is full, somebody has rung for the same page.
        let _ = self.bell.try_send(());
        let mut newest = self.newest.clone();
        let page = newest.wait_for(|newest| newest.number > begun).await?;
        Ok(page.text.clone())
    }
}

impl Maker {
    /// Makes pages when they are asked for, until nobody can ask any more.
    pub(super) fn run(self, mut make: impl FnMut() -> String) {
        for number in 1.. {
            if self.bell.recv().is_err() {
                return;
            }
            self.begun.store(number, Ordering::SeqCst);
            self.newest.send_replace(Newest { number, text: make() });
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;
    use std::thread;

    use tokio::runtime::Builder;
    use tokio::task::{JoinHandle, yield_now};

    #[test]
    fn all_who_ask_while_a_page_is_made_share_the_next_one() {
        let (pages, maker) = pages();
        let pages = Arc::new(pages);
        let (begins, has_begun) = channel();
        let (allow, allowed) = channel::<()>();
        let making = thread::spawn(move || {
            let mut made = 0;
            maker.run(|| {
                made += 1;
                begins.send(()).unwrap();
                allowed.recv().unwrap();
                format!("page {made}")
            });
            made
        });
        let asked = Arc::new(AtomicU64::new(0));
        let ask = || {
            let (pages, asked) = (pages.clone(), asked.clone());
            tokio::spawn(async move {
                asked.fetch_add(1, Ordering::SeqCst);
                pages.page().await.unwrap()
            })
        };
        // All tasks are in one thread: who is counted waits for a page when another task goes on.
        let have_asked = async |number| {
            while asked.load(Ordering::SeqCst) < number {
                yield_now().await;
            }
        };
        Builder::new_current_thread().build().unwrap().block_on(async {
            let first = ask();
            have_asked(1).await;
            has_begun.recv().unwrap();
            let others: Vec<JoinHandle<String>> = (0..1000).map(|_| ask()).collect();
            have_asked(1001).await;
            allow.send(()).unwrap();
            assert_eq!(first.await.unwrap(), "page 1");
            allow.send(()).unwrap();
            for other in others {
                assert_eq!(other.await.unwrap(), "page 2");
            }
        });
        drop(pages);
        assert_eq!(making.join().unwrap(), 2);
    }
}
