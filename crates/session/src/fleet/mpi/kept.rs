//! What MPI is sending and must not be moved or freed meanwhile.

use std::cell::OnceCell;

use crate::fleet::link::Frame;

/// A list of frames that only grows. A frame stays at its place as long as the list, so MPI may read it there.
pub(super) struct Kept {
    pub(crate) frame: Frame,
    next: OnceCell<Box<Kept>>,
}

impl Kept {
    pub(super) fn new(frame: Frame) -> Kept {
        Kept { frame, next: OnceCell::new() }
    }

    /// Appends a frame and returns the new end of the list. To be called at the end of the list.
    pub(super) fn append(&self, frame: Frame) -> &Kept {
        debug_assert!(self.next.get().is_none(), "this is not the end of the list");
        self.next.get_or_init(|| Box::new(Kept::new(frame)))
    }
}

impl Drop for Kept {
    /// One after another: the list may be too long for a drop of one inside the other.
    fn drop(&mut self) {
        let mut next = self.next.take();
        while let Some(mut kept) = next {
            next = kept.next.take();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_stay_in_place_and_a_list_of_a_million_is_freed() {
        let list = Kept::new(Frame::new(vec![1]));
        let second = list.append(Frame::new(vec![2]));
        let place = second.frame.as_ptr();
        let mut end = second;
        for _ in 0..1_000_000 {
            end = end.append(second.frame.clone());
        }
        assert_eq!((list.frame[0], second.frame[0], second.frame.as_ptr()), (1, 2, place));
        let frame = second.frame.clone();
        drop(list);
        assert_eq!(Frame::strong_count(&frame), 1);
    }
}
