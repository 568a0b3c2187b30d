//! Lets the refinements of two eyes agree on the next set, so that both work for the same light.

use crate::session::playback::scheduler::Target;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The interval at which a waiting eye checks for the end of its session.
const LOOK: Duration = Duration::from_millis(20);

#[derive(Default)]
struct State {
    /// The time that the next set of an eye needs (ns), while the eye waits for the other one.
    needs: [Option<i64>; 2],
    /// The set that an eye agreed on while the other one waited.
    agreed: [Option<Target>; 2],
    /// True for an eye that makes no sets now.
    is_away: [bool; 2],
}

/// One of the two eyes in an agreement. An eye that is dropped leaves the agreement.
pub(crate) struct Member {
    eye: usize,
    shared: Arc<(Mutex<State>, Condvar)>,
}

/// The absence of an eye, which ends when this is dropped.
pub(crate) struct Away {
    eye: usize,
    shared: Arc<(Mutex<State>, Condvar)>,
}

fn locked(state: &Mutex<State>) -> MutexGuard<'_, State> {
    // No call between two changes of the state can panic.
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Member {
    /// Starts an agreement of the left and the right eye.
    pub(crate) fn both() -> [Self; 2] {
        let shared = Arc::<(Mutex<State>, Condvar)>::default();
        [0, 1].map(|eye| Self { eye, shared: Arc::clone(&shared) })
    }

    /// Agrees on the next set and waits for the other eye. `decide` returns the set that work of some length (ns) can
    /// reach. The last eye decides for the longer work of both. Returns `None` as soon as `goes_on` returns false.
    pub(crate) fn agree(
        &self,
        need_ns: i64,
        decide: impl Fn(i64) -> Target,
        goes_on: impl Fn() -> bool,
    ) -> Option<Target> {
        let (state, changed) = &*self.shared;
        let (own, other) = (self.eye, 1 - self.eye);
        let mut now = locked(state);
        if let Some(needed) = now.needs[other].take() {
            let target = decide(need_ns.max(needed));
            now.agreed[other] = Some(target);
            changed.notify_all();
            return Some(target);
        }
        now.needs[own] = Some(need_ns);
        loop {
            if let Some(target) = now.agreed[own].take() {
                return Some(target);
            }
            let (is_alone, ends) = (now.is_away[other], !goes_on());
            if is_alone || ends {
                now.needs[own] = None;
                return (!ends).then(|| decide(need_ns));
            }
            now = changed.wait_timeout(now, LOOK).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// States that this eye makes no sets until the result is dropped. The other eye does not wait for it.
    pub(crate) fn leave(&self) -> Away {
        set_away(&self.shared, self.eye, true);
        Away { eye: self.eye, shared: Arc::clone(&self.shared) }
    }
}

fn set_away(shared: &(Mutex<State>, Condvar), eye: usize, is_away: bool) {
    locked(&shared.0).is_away[eye] = is_away;
    shared.1.notify_all();
}

impl Drop for Away {
    fn drop(&mut self) {
        set_away(&self.shared, self.eye, false);
    }
}

impl Drop for Member {
    fn drop(&mut self) {
        set_away(&self.shared, self.eye, true);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::thread;

    fn target(need_ns: i64) -> Target {
        Target { start_ns: need_ns, ..Target::default() }
    }

    #[test]
    fn both_eyes_work_for_the_set_that_the_slower_one_reaches() {
        let [left, right] = Member::both();
        thread::scope(|threads| {
            let slow = threads.spawn(|| (0..1000).map(|i| right.agree(2 * i + 1, target, || true)).collect::<Vec<_>>());
            let fast: Vec<_> = (0..1000).map(|i| left.agree(i, target, || true)).collect();
            let slow = slow.join().unwrap();
            assert_eq!(fast, slow);
            assert!(fast.iter().enumerate().all(|(i, t)| t.unwrap().start_ns == 2 * i as i64 + 1));
        });
    }

    #[test]
    fn an_eye_that_is_away_is_not_waited_for() {
        let [left, right] = Member::both();
        let away = right.leave();
        assert_eq!(left.agree(3, target, || true), Some(target(3)));
        drop(away);
        // The other eye is back, so the wait lasts until the session ends.
        let ends = AtomicBool::new(false);
        thread::scope(|threads| {
            let waits = threads.spawn(|| left.agree(3, target, || !ends.load(Ordering::Acquire)));
            thread::sleep(3 * LOOK);
            assert!(!waits.is_finished());
            ends.store(true, Ordering::Release);
            assert_eq!(waits.join().unwrap(), None);
        });
        // An eye that waits is released when the other one leaves for good.
        thread::scope(|threads| {
            let waits = threads.spawn(|| left.agree(4, target, || true));
            thread::sleep(2 * LOOK);
            drop(right);
            assert_eq!(waits.join().unwrap(), Some(target(4)));
        });
    }
}
