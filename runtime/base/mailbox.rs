//! A bounded queue between threads that allocates nothing after it is made.
//!
//! A full queue refuses a value ([`put`](Mailbox::put)), drops the oldest ([`push`](Mailbox::push)), or keeps one value
//! up to date ([`update`](Mailbox::update)). With capacity 1 it is a cell in which the newest value wins. Channels of
//! other crates keep lists of waiting threads. These lists grow when a thread first has to wait, at a time that depends
//! on the load of the machine. Here waiting is a condition variable, and the lock is held only while one value moves.

use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// One end of the queue. All ends are alike.
pub struct Mailbox<T> {
    shared: Arc<(Mutex<VecDeque<T>>, Condvar)>,
    capacity: usize,
}

impl<T> Clone for Mailbox<T> {
    fn clone(&self) -> Self {
        Self { shared: Arc::clone(&self.shared), capacity: self.capacity }
    }
}

impl<T> std::fmt::Debug for Mailbox<T> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Mailbox of {}", self.capacity)
    }
}

impl<T> Mailbox<T> {
    /// Makes a queue for at most `capacity` values, at least one.
    pub fn new(capacity: usize) -> Self {
        let capacity = capacity.max(1);
        Self { shared: Arc::new((Mutex::new(VecDeque::with_capacity(capacity)), Condvar::new())), capacity }
    }

    /// Returns the largest number of values.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Puts a value in, or gives it back if there is no room.
    pub fn put(&self, value: T) -> Result<(), T> {
        self.added(self.lock(), value)
    }

    /// Puts a value in, and waits for room up to `patience`.
    pub fn put_within(&self, value: T, patience: Duration) -> Result<(), T> {
        self.added(self.wait_while(patience, |values| values.len() == self.capacity), value)
    }

    /// Puts a value in. If there is no room, the oldest value comes out.
    pub fn push(&self, value: T) -> Option<T> {
        let mut values = self.lock();
        let oldest = if values.len() == self.capacity { values.pop_front() } else { None };
        self.add(values, value);
        oldest
    }

    /// Replaces the newest value that is still there by the result of `change`.
    pub fn update(&self, change: impl FnOnce(Option<T>) -> T) {
        let mut values = self.lock();
        let newest = values.pop_back();
        self.add(values, change(newest));
    }

    /// Takes the oldest value.
    pub fn take(&self) -> Option<T> {
        self.taken(self.lock())
    }

    /// Takes the oldest value, and waits for one up to `patience`.
    pub fn take_within(&self, patience: Duration) -> Option<T> {
        self.taken(self.wait_while(patience, VecDeque::is_empty))
    }

    /// Takes the next value, and waits for it.
    pub fn wait(&self) -> T {
        loop {
            if let Some(value) = self.take_within(Duration::from_secs(3600)) {
                return value;
            }
        }
    }

    /// Returns true if there is a value, or one arrives within this time. The value stays in the queue.
    pub fn comes(&self, within: Duration) -> bool {
        !self.wait_while(within, VecDeque::is_empty).is_empty()
    }

    /// Returns true if the queue is empty.
    pub fn is_empty(&self) -> bool {
        self.lock().is_empty()
    }

    /// Returns true if all other ends are gone, so that no more values can arrive.
    pub fn is_alone(&self) -> bool {
        Arc::strong_count(&self.shared) == 1
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<T>> {
        // The queue is valid whenever the lock is free.
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn added(&self, values: MutexGuard<'_, VecDeque<T>>, value: T) -> Result<(), T> {
        if values.len() == self.capacity {
            return Err(value);
        }
        self.add(values, value);
        Ok(())
    }

    fn add(&self, mut values: MutexGuard<'_, VecDeque<T>>, value: T) {
        values.push_back(value);
        drop(values);
        self.shared.1.notify_all();
    }

    fn taken(&self, mut values: MutexGuard<'_, VecDeque<T>>) -> Option<T> {
        let value = values.pop_front()?;
        drop(values);
        self.shared.1.notify_all();
        Some(value)
    }

    fn wait_while(&self, patience: Duration, blocked: impl Fn(&VecDeque<T>) -> bool) -> MutexGuard<'_, VecDeque<T>> {
        let (until, mut values) = (Instant::now() + patience, self.lock());
        while blocked(&values) {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                break;
            }
            values = self.shared.1.wait_timeout(values, left).unwrap_or_else(PoisonError::into_inner).0;
        }
        values
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_goes_in_comes_out_in_order_and_no_more_than_fits() {
        let mailbox = Mailbox::new(2);
        assert_eq!((mailbox.put(1), mailbox.put(2), mailbox.put(3)), (Ok(()), Ok(()), Err(3)));
        assert_eq!(mailbox.put_within(3, Duration::from_millis(1)), Err(3));
        assert_eq!(mailbox.push(3), Some(1), "the oldest makes room");
        let got = (mailbox.take(), mailbox.take_within(Duration::from_secs(60)), mailbox.take());
        assert_eq!(got, (Some(2), Some(3), None));
        assert!(mailbox.is_empty() && mailbox.take_within(Duration::from_millis(1)).is_none());
    }

    #[test]
    fn with_room_for_one_the_newest_wins() {
        let mailbox = Mailbox::new(1);
        assert!(!mailbox.comes(Duration::from_millis(1)));
        mailbox.update(|before| before.map_or(1, |n: u32| n + 1));
        mailbox.update(|before| before.map_or(1, |n| n + 1));
        assert!(mailbox.comes(Duration::ZERO));
        assert_eq!((mailbox.push(7), mailbox.wait(), mailbox.take()), (Some(2), 7, None));
        let other = mailbox.clone();
        assert!(!mailbox.is_alone());
        drop(other);
        assert!(mailbox.is_alone());
    }

    #[test]
    fn both_ends_wait_for_each_other() {
        let long = Duration::from_secs(60);
        let mailbox = Mailbox::new(3);
        let other = mailbox.clone();
        let sum = std::thread::spawn(move || (0..10_000u64).filter(|i| other.take_within(long) == Some(*i)).count());
        (0..10_000).for_each(|i| mailbox.put_within(i, long).expect("room in time"));
        assert_eq!(sum.join().expect("the other end"), 10_000);
    }
}
