//! The `eyebox` command.
fn main() {}
