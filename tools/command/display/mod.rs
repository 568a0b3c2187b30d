//! `eyebox display` has commands for presets, display files, monitors and calibration.

mod calibrate;
mod check;
mod connect;
mod link;
mod monitors;
pub mod patterns;
mod plm;
mod presets;
mod test_picture;

pub use check::check;

use crate::Failure;
use clap::Subcommand;

/// The commands of `eyebox display`.
#[derive(Subcommand)]
pub enum Display {
    /// List the displays that are built in
    #[command(after_help = "Example:\n  eyebox display list --json")]
    List(presets::List),
    /// Print a display as its file, with its source
    #[command(after_help = "Example:\n  eyebox display show holoeye-pluto-2.1")]
    Show(presets::ShowDisplay),
    /// Write a display file from a preset, with further keys as comments
    #[command(after_help = "Example:\n  eyebox display new holoeye-pluto-2.1 -o bench.toml")]
    New(presets::New),
    /// Check a display and its link, and print what it can show
    #[command(
        after_help = "Examples:\n  eyebox display check bench.toml\n  eyebox display check bench.toml --output window\n  eyebox display check bench.toml --captured capture.png\n\nWithout a controller, eyebox checks the monitor or the direct display of --output (docs/link.md).\nWith --output and a display file with [device], eyebox starts the controller and shows its planes and levels one after\nthe other. It reads an answer for each picture from standard input (docs/plm.md)."
    )]
    Check(check::Check),
    /// List the monitors that a window can cover, and the displays that no desktop drives
    #[command(after_help = "Example:\n  eyebox display monitors --json")]
    Monitors(monitors::Monitors),
    /// Make a picture that shows what a link changes, and show it
    #[command(
        name = "test-picture",
        after_help = "Examples:\n  eyebox display test-picture bench.toml -o test.png\n  eyebox display test-picture bench.toml --output window\n\nCapture the picture at the end of the cable, and give the capture to eyebox display check --captured (docs/link.md)."
    )]
    TestPicture(test_picture::TestPicture),
    /// Set the controller of a display up and run it, for pictures of other programs
    #[command(
        after_help = "Examples:\n  eyebox display connect bench.toml\n  eyebox display connect plm --duration 60 --json\n\nWithout [device] in its file, the display has a DLPC900 on DisplayPort (docs/plm.md). The controller sleeps again on ctrl-C\nand after --duration. Ends with 3 if the controller is\nstill lost."
    )]
    Connect(connect::Connect),
    /// Fit a model of the display to pictures of it
    #[command(
        after_help = "Examples:\n  eyebox display calibrate bench.toml --camera 'python3 my_camera.py' -o calibrated.toml\n  \
                      eyebox display calibrate bench.toml --camera 'python3 my_camera.py' --keep pictures -o calibrated.toml\n  \
                      eyebox display calibrate bench.toml --captures pictures -o calibrated.toml\n  \
                      eyebox display calibrate bench.toml --camera 'python3 my_camera.py' --output window --set camera.iris=0,0,6 -o calibrated.toml\n\ndocs/calibrate.md has the command and its fifteen lines of Python. Ends with 3 if the bench or ctrl-C ended it."
    )]
    Calibrate(Box<calibrate::Calibrate>),
}

/// Runs one of these commands.
pub fn run(display: &Display) -> Result<(), Failure> {
    match display {
        Display::List(args) => presets::list(args),
        Display::Show(args) => presets::show(args),
        Display::New(args) => presets::new(args),
        Display::Check(args) => check::run(args),
        Display::TestPicture(args) => test_picture::run(args),
        Display::Connect(args) => connect::run(args),
        Display::Monitors(args) => monitors::monitors(args),
        Display::Calibrate(args) => calibrate::run(args),
    }
}
