//! The program `eyebox`. `lib.rs` has the command.

use std::process::ExitCode;

fn main() -> ExitCode {
    ExitCode::from(eyebox_command::main(std::env::args_os().collect()))
}
