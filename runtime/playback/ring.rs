//! A bounded queue between two threads that allocates nothing once it is made.
//!
//! Channels of other crates keep lists of who waits, which grow when a thread first has to: at a time that depends on how
//! busy the machine is. Here waiting is a futex. The lock is held for as long as moving one item takes.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Both ends.
pub(super) struct Ring<T> {
    items: Arc<(Mutex<VecDeque<T>>, Condvar)>,
    capacity: usize,
}

impl<T> Clone for Ring<T> {
    fn clone(&self) -> Self {
        Self { items: Arc::clone(&self.items), capacity: self.capacity }
    }
}

impl<T> Ring<T> {
    /// For so many items.
    pub(super) fn new(capacity: usize) -> Self {
        Self { items: Arc::new((Mutex::new(VecDeque::with_capacity(capacity)), Condvar::new())), capacity }
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<T>> {
        self.items.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts an item in, or gives it back where there is no room.
    pub(super) fn put(&self, item: T) -> Result<(), T> {
        self.added(self.lock(), item)
    }

    /// The same, waiting for room that long.
    pub(super) fn put_within(&self, item: T, patience: Duration) -> Result<(), T> {
        self.added(self.wait_while(patience, |items| items.len() == self.capacity), item)
    }

    /// Takes the oldest item.
    pub(super) fn take(&self) -> Option<T> {
        self.taken(self.lock())
    }

    /// The same, waiting for one that long.
    pub(super) fn take_within(&self, patience: Duration) -> Option<T> {
        self.taken(self.wait_while(patience, |items| items.is_empty()))
    }

    /// Whether nothing is in it.
    pub(super) fn is_empty(&self) -> bool {
        self.lock().is_empty()
    }

    fn added(&self, mut items: MutexGuard<'_, VecDeque<T>>, item: T) -> Result<(), T> {
        if items.len() == self.capacity {
            return Err(item);
        }
        items.push_back(item);
        drop(items);
        self.items.1.notify_all();
        Ok(())
    }

    fn taken(&self, mut items: MutexGuard<'_, VecDeque<T>>) -> Option<T> {
        let item = items.pop_front()?;
        drop(items);
        self.items.1.notify_all();
        Some(item)
    }

    fn wait_while(&self, patience: Duration, blocked: impl Fn(&VecDeque<T>) -> bool) -> MutexGuard<'_, VecDeque<T>> {
        let (until, mut items) = (Instant::now() + patience, self.lock());
        while blocked(&items) {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            items = self.items.1.wait_timeout(items, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        items
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_goes_in_comes_out_in_order_and_no_more_than_fits() {
        let ring = Ring::new(2);
        assert_eq!((ring.put(1), ring.put(2), ring.put(3)), (Ok(()), Ok(()), Err(3)));
        assert_eq!(ring.put_within(3, Duration::from_millis(1)), Err(3));
        assert_eq!((ring.take(), ring.take_within(Duration::from_secs(60)), ring.take()), (Some(1), Some(2), None));
        assert!(ring.is_empty() && ring.take_within(Duration::from_millis(1)).is_none());
    }

    #[test]
    fn both_ends_wait_for_each_other() {
        let long = Duration::from_secs(60);
        let ring = Ring::new(3);
        let other = ring.clone();
        let sum = std::thread::spawn(move || (0..10_000u64).filter(|i| other.take_within(long) == Some(*i)).count());
        (0..10_000).for_each(|i| ring.put_within(i, long).expect("room in time"));
        assert_eq!(sum.join().expect("the other end"), 10_000);
    }
}
