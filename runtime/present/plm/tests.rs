//! Tests the bytes, the order of steps and the faults, against a simulated controller.

mod bytes;
mod random;
mod steps;
