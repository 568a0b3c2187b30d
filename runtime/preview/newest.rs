//! A cell in which the newest value wins.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// What one thread leaves and another takes; what was not taken is replaced, or changed.
pub(super) struct Newest<T> {
    value: Mutex<Option<T>>,
    changed: Condvar,
}

impl<T> Default for Newest<T> {
    fn default() -> Self {
        Self { value: Mutex::new(None), changed: Condvar::new() }
    }
}

impl<T> Newest<T> {
    fn lock(&self) -> MutexGuard<'_, Option<T>> {
        // A value is whole whenever the lock is free.
        self.value.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Leaves a value.
    pub(super) fn put(&self, value: T) {
        self.change(|_| value);
    }

    /// Leaves what `change` makes of the value that is still there.
    pub(super) fn change(&self, change: impl FnOnce(Option<T>) -> T) {
        let mut value = self.lock();
        let changed = change(value.take());
        *value = Some(changed);
        drop(value);
        self.changed.notify_one();
    }

    /// Takes the value, if there is one.
    pub(super) fn take(&self) -> Option<T> {
        self.lock().take()
    }

    /// Whether there is one, or comes within this time. It stays.
    pub(super) fn comes(&self, within: Duration) -> bool {
        let waited = self.changed.wait_timeout_while(self.lock(), within, |value| value.is_none());
        let (value, _) = waited.unwrap_or_else(PoisonError::into_inner);
        value.is_some()
    }

    /// Takes the next value, and waits for it.
    pub(super) fn wait(&self) -> T {
        let mut value = self.lock();
        loop {
            match value.take() {
                Some(value) => return value,
                None => value = self.changed.wait(value).unwrap_or_else(PoisonError::into_inner),
            }
        }
    }
}
