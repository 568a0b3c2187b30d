//! The command line with its commands, their help and their examples.

use crate::args::Solve;
#[cfg(feature = "all-commands")]
use crate::args::{Bench, Demo, Encode};
use crate::device::Device;
#[cfg(feature = "all-commands")]
use crate::display::Display;
#[cfg(feature = "all-commands")]
use crate::eval::Eval;
#[cfg(feature = "all-commands")]
use crate::tracker::Tracker;
use clap::{Parser, Subcommand};

/// The note on units of numbers below each help.
const UNITS: &str = "Numbers are in the unit that the help of an option states, or have one, such as 4mm, 0.5D, 520nm, 30Hz, 10s, 4GiB.";

/// Compute phase holograms for near-eye displays.
#[derive(Parser)]
#[command(name = "eyebox", version, max_term_width = 100, after_help = UNITS)]
pub struct Cli {
    /// Increase log detail on stderr (-v, -vv). RUST_LOG overrides
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub verbose: u8,
    #[command(subcommand)]
    pub command: Command,
}

/// The commands of eyebox.
#[derive(Subcommand)]
pub enum Command {
    /// Solve the built-in still life, show it through several pupils, and measure it
    #[cfg(feature = "all-commands")]
    #[command(after_help = "Example:\n  eyebox demo --out demo --size 256")]
    Demo(Box<Demo>),
    /// Turn a light field into a hologram
    #[command(after_help = "Examples:\n  eyebox solve lightfield/ --size 512x512 --color green -o lightfield.zarr\n  \
                      eyebox solve builtin:still-life --size 512x512 --duration 10 -o still-life.zarr\n  \
                      eyebox solve builtin:still-life --size 512x512 --quality accurate -o still-life.zarr\n  \
                      eyebox solve builtin:still-life --size 512x512 --dry-run\n  \
                      eyebox solve builtin:still-life --display far-field-16k --color green --frames 1 --memory 4GiB -o large.zarr\n  \
                      eyebox solve photo.png --depth-map depth.png --depth=-3..3 -o photo.npy\n  \
                      eyebox solve frame-00/ frame-01/ frame-02/ --size 512x512 --rate 30 -o moving.zarr\n  \
                      eyebox solve builtin:still-life --prescription '-0.3 -0.1 30' --pupil-diameter 2..6 -o mine.zarr\n\n\
                      Several scenes, or a folder of light-field folders, make a sequence. The same command resumes one that was interrupted.\n\
                      The first --dry-run on a machine times its engine for some seconds. The rates are kept in $XDG_CACHE_HOME/eyebox, or\n\
                      ~/.cache/eyebox.\n\
                      The built-in scenes are still-life, still-life-dark, still-life-bright, dense-grass, points, plane and chart. With\n\
                      builtin:still-life?camera=2 the camera is 2 mm to the right.")]
    Solve(Box<Solve>),
    /// Refine a hologram for a pupil, and print what each step gains
    #[cfg(feature = "all-commands")]
    #[command(
        after_help = "Examples:\n  eyebox refine still-life.zarr --pupil=4,0,4,1 --steps 16\n  eyebox refine still-life.zarr builtin:still-life --pupil=4,0,4,1 --spread 1 -o seen-there.zarr --json\n  eyebox refine still-life.zarr builtin:still-life --pupil=4,0,4,1 --prescription '-0.1' -o mine.zarr"
    )]
    Refine(Box<crate::refine::Refine>),
    /// Render what an eye sees, as a picture through one pupil or as a film along a path
    #[cfg(feature = "all-commands")]
    #[command(after_help = "Examples:\n  eyebox render still-life.zarr --pupil=4,0,4,1.5 -o image.png\n  \
                      eyebox render still-life.zarr --pupil=4,0,4,1.5 --what both -o both.png\n  \
                      eyebox render lightfield/ --size 512x512 --color green --pupil=0,0,18,1 -o target.png\n  \
                      eyebox render phases.npy --pupil=0,0,6,0 --pitch 8 --wavelength 520 --focal-length 400 -o image.npy\n  \
                      eyebox render --encoded frames --display bench.toml --pupil=0,0,4,0 -o image.png\n  \
                      eyebox render mine.zarr --pupil=2,0,4,0 --prescription none -o others.png\n  \
                      eyebox render still-life.zarr --path path.json -o still-life.y4m\n  \
                      eyebox render builtin:still-life --size 512x512 --path path.json --what image -o image.y4m\n\n\
                      The smallest path.json is {\"keys\": [{\"t_s\": 0, \"x_mm\": -4}, {\"t_s\": 2, \"x_mm\": 4}]}. Keys have a rising t_s (s), x_mm, y_mm,\n\
                      diameter_mm, focus (mm, or \"0.01D\") and jump (true jumps at once). The file may also have rate_hz (30) and blinks_s. The same\n\
                      path gives the same film.")]
    Render(Box<crate::render::Render>),
    /// Show what an eye sees in a window. The mouse moves the pupil, the wheel changes focus
    #[cfg(feature = "all-commands")]
    #[command(after_help = "Examples:\n  eyebox preview builtin:still-life --size 256\n  \
                      eyebox preview still-life.zarr --scene builtin:still-life\n  \
                      eyebox preview moving.zarr --pupil=2,0,6,1 --zoom 2\n  \
                      eyebox preview mine.zarr --prescription none\n  \
                      eyebox preview phases.npy --pitch 8 --wavelength 520 --focal-length 400\n\n\
                      In the window the mouse moves the pupil over the eyebox, the wheel changes focus, + and - the diameter, a switches\n\
                      speckle averaging, p shows the target image of the scene, s saves a PNG, i shows a line and a map, h all keys, escape closes.\n\
                      Ends with 0 when it is closed and on ctrl-C, with 2 if it cannot be shown, with 3 if the desktop is lost.")]
    Preview(Box<crate::preview::Preview>),
    /// Show holograms, scenes or live content on a display, refined for the tracked pupil if there is a tracker
    #[command(
        after_help = "Examples:\n  eyebox show moving.zarr --display planes24 --loop --duration 10 --stats shown.json\n  \
                      eyebox show still-life.zarr --display planes24 --tracker simulated --duration 10\n  \
                      eyebox show still-life.zarr --display slm.toml --output window --tracker pupil://127.0.0.1 --calibration me.toml\n  \
                      eyebox show moving.zarr --display plm --record shown --trace trace.json\n  \
                      eyebox show builtin:still-life --size 256x256 --display planes24 --tracker simulated\n  \
                      eyebox show live:demo --size 256x256 --color green --display planes8 --tracker simulated --duration 60\n\n\
                      WHAT is a hologram, a sequence or a far field in tiles, bare phases, one or more scenes (which are solved first), or live:NAME,\n\
                      an application in another process (docs/live-input.md). Without --tracker holograms are shown as they were solved, and live\n\
                      content is refined for the whole eyebox.\n\
                      Ends with 0 at the end, after --duration, and on ctrl-C. Ends with 2 if it cannot be shown, with 3 if the display is lost, with\n\
                      130 at once on a second ctrl-C. The display keeps the idle picture, which is the phase 0, or with show.sync the sync picture."
    )]
    Show(Box<crate::show::Show>),
    /// Write the video frames that a display receives, with levels or bit planes, as PNG
    #[cfg(feature = "all-commands")]
    #[command(
        after_help = "Examples:\n  eyebox encode still-life.zarr --display planes24 --size 256x256 -o frames\n  \
                      eyebox encode phases.npy --display bench.toml -o frames --json\n\nFrames are in the order in which they are shown. A .npy is (sub-frame, row, column) or (color, sub-frame, row, column), float,\nradians. `eyebox convert frames phases.npy` converts back. docs/displays.md describes display files."
    )]
    Encode(Box<Encode>),
    /// Print the contents of a scene as it is read, a hologram, a sequence, a recording or a display
    #[cfg(feature = "all-commands")]
    #[command(
        after_help = "Examples:\n  eyebox info lightfield/ -o views.png\n  eyebox info lightfield/ --order flip-rows --json\n  eyebox info still-life.zarr\n  eyebox info session.hid"
    )]
    Info(Box<crate::info::Info>),
    /// Convert phases between holograms, arrays, gray pictures and video frames
    #[cfg(feature = "all-commands")]
    #[command(
        after_help = "Examples:\n  eyebox convert still-life.zarr phases.npy\n  eyebox convert still-life.zarr pictures\n  eyebox convert phases.npy mine.zarr --display bench.toml --color green\n  eyebox convert phases.npy mine.zarr --display bench.toml --color green --scene lightfield/\n  eyebox convert frames phases.npy\n\nA .npy is (row, column), (sub-frame, row, column) or (color, sub-frame, row, column). Colors are in the order red, green, blue."
    )]
    Convert(Box<crate::convert::Convert>),
    /// Measure holograms, methods, pupil steering and settings
    #[cfg(feature = "all-commands")]
    #[command(subcommand)]
    Eval(Eval),
    /// List, check and calibrate displays
    #[cfg(feature = "all-commands")]
    #[command(subcommand)]
    Display(Display),
    /// Watch, record and calibrate eye trackers
    #[cfg(feature = "all-commands")]
    #[command(subcommand)]
    Tracker(Tracker),
    /// List and test engines and devices
    #[command(subcommand)]
    Device(Device),
    /// Time the steps of a solve and each kernel, in turn with another program
    #[cfg(feature = "all-commands")]
    #[command(
        after_help = "Example:\n  eyebox bench builtin:still-life --size 512x512 --color green --steps 20 --beside 'python3 mine.py'"
    )]
    Bench(Box<Bench>),
    /// Send frames of scenes to a display that shows live content, as an application would
    #[cfg(feature = "all-commands")]
    #[command(after_help = "Examples:\n  eyebox feed builtin:still-life --name demo --rate 30 --move=camera=-2..2\n  \
                      eyebox feed builtin:plane --name demo --move=depth=-1..1 --count 300 --json\n  \
                      eyebox feed frames/ --name demo --rate 24\n\nThe display takes them as live:NAME (docs/live-input.md). --display gives its optics. Ends when the display does.")]
    Feed(Box<crate::feed::Feed>),
    /// Print the completions of a shell
    #[cfg(feature = "all-commands")]
    #[command(
        after_help = "Examples:\n  eyebox completions bash > ~/.local/share/bash-completion/completions/eyebox\n  eyebox completions zsh > ~/.zfunc/_eyebox\n  eyebox completions fish > ~/.config/fish/completions/eyebox.fish"
    )]
    Completions(crate::generate::Completions),
    /// Write the pages of the manual
    #[cfg(feature = "all-commands")]
    #[command(after_help = "Example:\n  eyebox man -o ~/.local/share/man/man1")]
    Man(crate::generate::Man),
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_sound_and_every_command_has_an_example() {
        let command = Cli::command();
        command.clone().debug_assert();
        for (path, sub) in crate::headings::leaves(&command) {
            let help = sub.get_after_help().unwrap_or_else(|| panic!("an example of {path}")).to_string();
            assert!(help.contains(&format!("eyebox {path}")), "{help}");
            // The examples use only options that the command has.
            let examples = help.lines().filter_map(|line| line.trim().strip_prefix(&format!("eyebox {path} ")));
            for word in examples.flat_map(str::split_whitespace) {
                let Some(option) = word.strip_prefix("--").and_then(|word| word.split('=').next()) else { continue };
                let is_known = sub.get_opts().any(|known| known.get_long() == Some(option));
                assert!(is_known, "{path}: --{option} of an example");
            }
        }
    }
}
