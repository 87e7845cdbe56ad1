//! A bell that wakes the coordinator when a worker has sent something.

use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::time::Duration;

/// A bell that any number of [`Cord`]s ring. Several rings before a wait count as one.
pub(super) struct Bell {
    rings: Receiver<()>,
    cord: SyncSender<()>,
}

/// A cord that rings its bell.
#[derive(Clone)]
pub(super) struct Cord(SyncSender<()>);

impl Bell {
    pub(super) fn new() -> Bell {
        let (cord, rings) = sync_channel(1);
        Bell { rings, cord }
    }

    pub(super) fn cord(&self) -> Cord {
        Cord(self.cord.clone())
    }

    /// Waits until the bell rings, if it has not since the last call, but not longer than `at_most`.
    pub(super) fn wait(&self, at_most: Duration) {
        let _ = self.rings.recv_timeout(at_most);
    }
}

impl Cord {
    pub(super) fn ring(&self) {
        // If the bell rings already, another ring is not needed. If the bell is gone, nobody waits.
        let _ = self.0.try_send(());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn a_ring_before_the_wait_is_heard_and_two_are_one() {
        let bell = Bell::new();
        let cords = [bell.cord(), bell.cord()];
        cords.iter().for_each(Cord::ring);
        let begun = Instant::now();
        bell.wait(Duration::from_secs(3600));
        assert!(begun.elapsed() < Duration::from_secs(1800));
        // Nobody rings again, so this waits until the time is over.
        let begun = Instant::now();
        bell.wait(Duration::from_millis(5));
        assert!(begun.elapsed() >= Duration::from_millis(5));
    }
}
