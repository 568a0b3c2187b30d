//! Tests that cross rooms; the helpers that they share live here.

pub mod both;
