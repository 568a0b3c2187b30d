//! Where there is no memory that can be sealed: both sides refuse.

use crate::{LiveError, Offer};

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
}
