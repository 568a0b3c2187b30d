//! Light fields: what the eye should see. May import `optics` and the kernels' tables.

mod photograph;
mod pyramid;

pub use photograph::ViewGrid;
pub use pyramid::{Level, Pyramid};
