//! Work in threads that says from time to time how far it is.

use std::sync::mpsc;
use std::thread;

use stacknets::Threads;

/// Makes one thing from each item in these threads, in the order of the items. While they are at work, `alive` is called in this
/// thread whenever one of them calls what it is given.
///
/// Each thread keeps one `Scratch`, working memory for all of its items.
pub(crate) fn in_threads<I: Send, Scratch: Default + Send, T: Send>(
    threads: &Threads,
    items: Vec<I>,
    alive: &mut dyn FnMut(),
    make: impl Fn(&mut Scratch, I, &mut dyn FnMut()) -> T + Send + Sync,
) -> Vec<T> {
    if threads.count() == 1 {
        let mut scratch = Scratch::default();
        return items.into_iter().map(|item| make(&mut scratch, item, alive)).collect();
    }
    let (signs, signs_of_life) = mpsc::channel();
    thread::scope(|scope| {
        let items = items.into_iter().map(|item| (item, signs.clone())).collect();
        drop(signs);
        let made = scope.spawn(|| {
            threads.map(items, 1, |scratch, (item, signs): (I, mpsc::Sender<()>)| {
                make(scratch, item, &mut || signs.send(()).expect("it is heard until the last one is gone"))
            })
        });
        signs_of_life.into_iter().for_each(|()| alive());
        made.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_are_in_the_order_of_their_items_and_every_sign_is_heard() {
        for threads in [Threads::one(), Threads::new(3).unwrap()] {
            let mut heard = 0;
            let made = in_threads(&threads, (0..20).collect(), &mut || heard += 1, |_: &mut (), item: u32, alive| {
                (0..item).for_each(|_| alive());
                2 * item
            });
            assert_eq!(made, (0..20).map(|item| 2 * item).collect::<Vec<_>>());
            assert_eq!(heard, 190);
        }
    }
}
