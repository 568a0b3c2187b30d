//! Light fields: what the eye should see. May import `optics` and the kernels' tables.

mod pyramid;

pub use pyramid::{Level, Pyramid};
