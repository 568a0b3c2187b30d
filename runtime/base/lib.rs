//! Has the parts of [eyebox](https://github.com/eyebox/eyebox) that do not depend on optics.
//!
//! [`files`] reads files in one way and writes them completely or not at all. [`memory`] checks memory before it is
//! allocated. A [`mailbox`] connects threads. There are a [`steady`] clock, [`random`] numbers that are the same on
//! every machine, [`quantity`]s with the units that people write, and [`error`]s as data.

pub mod error;
pub mod files;
pub mod mailbox;
pub mod memory;
pub mod quantity;
pub mod random;
pub mod steady;

pub use error::Reason;
