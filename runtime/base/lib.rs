//! **eyebox-base**: what every part of [eyebox](https://github.com/eyebox/eyebox) stands on and what knows nothing of optics: [`files`] read in one
//! way and written whole or not at all, [`memory`] that is asked for before it is taken, a [`mailbox`] between threads, a
//! [`steady`] clock, [`random`] numbers that are the same everywhere, [`quantity`]s with units as people write them, and [`error`]s as data.

pub mod error;
pub mod files;
pub mod mailbox;
pub mod memory;
pub mod quantity;
pub mod random;
pub mod steady;

pub use error::Reason;
