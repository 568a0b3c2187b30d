//! Where there is no memory that can be sealed: both sides refuse.

use crate::{FrameInfo, LiveError, Offer, Request};
use std::time::Duration;

/// Nothing: see [`open`](Self::open).
#[derive(Debug)]
pub enum Display {}

impl Display {
    /// # Errors
    /// [`LiveError::Unsupported`], always.
    pub fn open(_name: &str, _offer: Offer) -> Result<Self, LiveError> {
        Err(LiveError::Unsupported)
    }
}

/// Nothing: see [`connect`](Self::connect).
#[derive(Debug)]
pub enum Application {}

impl Application {
    /// # Errors
    /// [`LiveError::Unsupported`], always.
    pub fn connect(_name: &str) -> Result<Self, LiveError> {
        Err(LiveError::Unsupported)
    }

    /// Never called.
    pub fn offer(&self) -> &Offer {
        match *self {}
    }

    /// Never called.
    pub fn request(&self) -> Option<Request> {
        match *self {}
    }

    /// Never called.
    ///
    /// # Errors
    /// None.
    pub fn wait(&mut self, _patience: Duration) -> Result<bool, LiveError> {
        match *self {}
    }

    /// Never called.
    ///
    /// # Errors
    /// None.
    pub fn send(&mut self, _info: &FrameInfo, _samples: &[u8], _dioptres: &[f32]) -> Result<u64, LiveError> {
        match *self {}
    }
}
