//! Where there is no memory that can be sealed: both sides refuse.

use crate::{FrameInfo, LiveError, Offer, Request};
use std::time::Duration;

/// There is none.
#[derive(Debug)]
enum Never {}

/// Nothing: see [`open`](Self::open).
#[derive(Debug)]
pub struct Display(#[allow(dead_code, reason = "so that there is none")] Never);

impl Display {
    /// # Errors
    /// [`LiveError::Unsupported`], always.
    pub fn open(_name: &str, _offer: Offer) -> Result<Self, LiveError> {
        Err(LiveError::Unsupported)
    }
}

/// Nothing: see [`connect`](Self::connect).
#[derive(Debug)]
pub struct Application(Never);

impl Application {
    /// # Errors
    /// [`LiveError::Unsupported`], always.
    pub fn connect(_name: &str) -> Result<Self, LiveError> {
        Err(LiveError::Unsupported)
    }

    /// Never called.
    pub fn offer(&self) -> &Offer {
        match self.0 {}
    }

    /// Never called.
    pub fn request(&self) -> Option<Request> {
        match self.0 {}
    }

    /// Never called.
    pub fn wait(&mut self, _patience: Duration) -> Result<bool, LiveError> {
        match self.0 {}
    }

    /// Never called.
    pub fn send(&mut self, _info: &FrameInfo, _samples: &[u8], _dioptres: &[f32]) -> Result<u64, LiveError> {
        match self.0 {}
    }
}
