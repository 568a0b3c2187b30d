//! Holds a hologram that may be replaced during playback, and the version that is on the screen.

use super::Hologram;
use crossbeam_utils::atomic::AtomicCell;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// A hologram in memory that may be replaced during playback. The next multiplex set is made of the newest version.
/// Clones share it.
#[derive(Debug, Clone)]
pub struct NewestHologram(Arc<State>);

#[derive(Debug)]
struct State {
    /// The number of the version, from 0, and the hologram.
    newest: Mutex<(u64, Hologram)>,
    on_screen: AtomicCell<Option<OnScreen>>,
}

/// A version of a hologram that is on the screen. If two values are equal, the screen showed nothing else between them.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OnScreen {
    /// The number of the version, from 0.
    pub version: u64,
    /// The number of the video frame with which it appeared.
    pub since: u64,
}

impl NewestHologram {
    /// Creates it with version 0.
    pub fn new(hologram: Hologram) -> Self {
        Self(Arc::new(State { newest: Mutex::new((0, hologram)), on_screen: AtomicCell::new(None) }))
    }

    pub(super) fn get(&self) -> MutexGuard<'_, (u64, Hologram)> {
        self.0.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns a copy of the newest version.
    pub fn load(&self) -> Hologram {
        self.get().1.clone()
    }

    /// Replaces the hologram by another of the same shape, and returns the number of the new version.
    ///
    /// # Errors
    /// Returns the other hologram if it has another shape.
    pub fn replace(&self, hologram: Hologram) -> Result<u64, Box<Hologram>> {
        let shape =
            |h: &Hologram| ([h.frames, h.height, h.width], h.colors.iter().map(|c| c.phases.len()).collect::<Vec<_>>());
        let mut now = self.get();
        if shape(&now.1) != shape(&hologram) {
            return Err(Box::new(hologram));
        }
        *now = (now.0 + 1, hologram);
        Ok(now.0)
    }

    /// Returns the version that is on the screen, from its second set on, so that nothing of the previous set is left
    /// in the pixels. Returns none while versions change, and while something else is shown.
    pub fn on_screen(&self) -> Option<OnScreen> {
        self.0.on_screen.load()
    }

    /// Returns a copy of the newest version, if it is the one on the screen.
    pub fn shown(&self) -> Option<(OnScreen, Hologram)> {
        let newest = self.get();
        let shown = self.on_screen().filter(|shown| shown.version == newest.0)?;
        Some((shown, newest.1.clone()))
    }

    /// Stores the version that is on the screen. The presenting side calls it.
    pub fn put_on_screen(&self, shown: Option<OnScreen>) {
        self.0.on_screen.store(shown);
    }
}
