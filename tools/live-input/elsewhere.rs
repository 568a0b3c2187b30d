//! Refuses both sides on systems without memory that can be sealed.

use crate::{FrameInfo, LiveError, Offer, Request};
use std::time::Duration;

/// A type without values.
#[derive(Debug)]
enum Never {}

/// A display that [`open`](Self::open) always refuses.
#[derive(Debug)]
pub struct Display(#[allow(dead_code, reason = "so that there is none")] Never);

impl Display {
    /// Always fails on this system.
    ///
    /// # Errors
    /// Returns [`LiveError::Unsupported`] on each call.
    pub fn open(_name: &str, _offer: Offer) -> Result<Self, LiveError> {
        Err(LiveError::Unsupported)
    }
}

/// An application that [`connect`](Self::connect) always refuses.
#[derive(Debug)]
pub struct Application(Never);

impl Application {
    /// Always fails on this system.
    ///
    /// # Errors
    /// Returns [`LiveError::Unsupported`] on each call.
    pub fn connect(_name: &str) -> Result<Self, LiveError> {
        Err(LiveError::Unsupported)
    }

    /// Cannot be called, because no value exists.
    pub fn offer(&self) -> &Offer {
        match self.0 {}
    }

    /// Cannot be called, because no value exists.
    pub fn request(&self) -> Option<Request> {
        match self.0 {}
    }

    /// Cannot be called, because no value exists.
    pub fn wait(&mut self, _patience: Duration) -> Result<bool, LiveError> {
        match self.0 {}
    }

    /// Cannot be called, because no value exists.
    pub fn send(&mut self, _info: &FrameInfo, _samples: &[u8], _dioptres: &[f32]) -> Result<u64, LiveError> {
        match self.0 {}
    }
}
