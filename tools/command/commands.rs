//! The command line: the commands, what they are for, and examples of them.

use crate::args::{Bench, Demo, Devices, Encode, Export, Photograph, Score, Solve, View};
use crate::trackers::Trackers;
use clap::{Parser, Subcommand};

/// How numbers are written.
const UNITS: &str = "Numbers are in the unit that the help of an option states, or have one, such as 4mm, 0.5D, 520nm, 30Hz, 10s, 4GiB.";

/// Phase holograms that look right from anywhere in the eyebox.
#[derive(Parser)]
#[command(name = "eyebox", version, max_term_width = 100, after_help = UNITS)]
pub struct Cli {
    /// Increase log detail on stderr (-v, -vv). RUST_LOG overrides
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub verbose: u8,
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// The commands.
#[derive(Subcommand)]
pub enum Command {
    /// Solve the built-in still life, show it through several pupils, and measure it
    #[command(after_help = "Example:\n  eyebox demo --out demo --size 256")]
    Demo(Demo),
    /// Turn a light field into a hologram
    #[command(after_help = "Examples:\n  eyebox solve lightfield/ --size 512x512 --color green -o lightfield.zarr\n  \
                      eyebox solve builtin:still-life --size 512x512 --seconds 10 -o still-life.zarr\n  \
                      eyebox solve builtin:still-life --size 512x512 --quality accurate -o still-life.zarr\n  \
                      eyebox solve builtin:still-life --display far-field-16k --color green --frames 1 --memory 4GiB -o large.zarr\n  \
                      eyebox solve photo.png --depth-map depth.png --depth=-3..3 -o photo.npy\n  \
                      eyebox solve frame-00/ frame-01/ frame-02/ --size 512x512 --rate 30 -o moving.zarr\n  eyebox solve builtin:still-life --prescription '-0.3 -0.1 30' --pupil-diameter 2..6 -o mine.zarr\n\nSeveral scenes, or a folder of light-field folders, make a sequence; one that was interrupted is resumed by the same command.\nBuilt-in scenes: still-life, still-life-dark, still-life-bright, dense-grass, points, plane, chart; as a camera sees them that\nstands so many mm to the right: builtin:still-life?camera=2")]
    Solve(Solve),
    /// Say what of a scene will be computed and why, and what time and memory it will take
    #[command(
        after_help = "Examples:\n  eyebox plan builtin:still-life --size 512x512\n  eyebox plan lightfield/ --size 512x512 --json\n  eyebox plan builtin:still-life --size 512x512 --prescription '-0.1'\n\nIt takes the arguments of solve. The first plan on a machine times its engine for a few seconds; the rates are kept in\n$XDG_CACHE_HOME/eyebox, else ~/.cache/eyebox."
    )]
    Plan(Box<crate::plan::Plan>),
    /// Say what a scene is as it is read: grid, order, parallax, depth, light; with a picture of all views
    #[command(
        after_help = "Examples:\n  eyebox inspect lightfield/ -o views.png\n  eyebox inspect lightfield/ --order flip-rows --json"
    )]
    Inspect(Box<crate::inspect::Inspect>),
    /// Show what an eye sees of a hologram through one pupil
    #[command(after_help = "Examples:\n  eyebox view still-life.zarr --pupil=4,0,4,1.5 -o view.png\n  \
                      eyebox view phases.npy --pupil=0,0,6,0 --pitch 8 --wavelength 520 --focal-length 400 -o view.npy\n  \
                      eyebox view --encoded frames --display bench.toml --pupil=0,0,4,0 -o view.png\n  \
                      eyebox view mine.zarr --pupil=2,0,4,0 --prescription none -o others.png")]
    View(View),
    /// Show what an eye should see of a scene through one pupil
    #[command(
        after_help = "Example:\n  eyebox photograph lightfield/ --size 512x512 --color green --pupil=0,0,18,1 -o photograph.png"
    )]
    Photograph(Photograph),
    /// Refine a hologram for where the eye is, and say what each step gains
    #[command(
        after_help = "Examples:\n  eyebox refine still-life.zarr builtin:still-life --pupil=4,0,4,1 --steps 16\n  eyebox refine still-life.zarr builtin:still-life --pupil=4,0,4,1 --spread 1 -o seen-there.zarr --json\n  eyebox refine still-life.zarr builtin:still-life --pupil=4,0,4,1 --prescription '-0.1' -o mine.zarr"
    )]
    Refine(Box<crate::live::Refine>),
    /// Show a hologram on a display, and refine it for where the eye is while it is shown
    #[command(
        after_help = "Examples:\n  eyebox live still-life.zarr --display planes24 --tracker simulated --duration 10 --stats stats.json\n  eyebox live builtin:still-life --display slm.toml --output window --tracker hid\n  eyebox live still-life.zarr --display slm.toml --tracker pupil://127.0.0.1 --calibration me.toml\n  eyebox live builtin:still-life --display slm.toml --prescription '-0.1 -0.05 90'"
    )]
    Live(Box<crate::live::Live>),
    /// Measure what steering by a simulated eye gains
    #[command(
        after_help = "Examples:\n  eyebox study still-life.zarr --display planes24 --duration 6 -o study\n  eyebox study builtin:still-life --display planes24 --size 256x256 --color green -o study\n  eyebox study mine.zarr --display planes24 --prescription none -o others\n\nTime is counted, not waited for: it passes by what refining and encoding take on this machine, and stands still while\nquality is judged."
    )]
    Study(Box<crate::live::Study>),
    /// Measure a hologram against its scene over many pupils
    #[command(
        after_help = "Examples:\n  eyebox score still-life.zarr builtin:still-life --pupils random:16\n  eyebox score mine.zarr builtin:still-life --prescription none"
    )]
    Score(Score),
    /// Measure what quality costs on this machine, and which settings are worth it: for --quality and --deadline
    #[command(after_help = "Examples:\n  eyebox tradeoff builtin:still-life --size 256x256 -o tradeoff\n  \
                      eyebox tradeoff lightfield/ --size 512x512 --budget 600 --engine vulkan -o tradeoff\n  \
                      eyebox tradeoff builtin:still-life --size 256x256 --seed 1 --check tradeoff/tradeoff.json --no-store -o again\n\n\
                      What is recommended is kept in $XDG_CACHE_HOME/eyebox, else ~/.cache/eyebox, for each device.")]
    Tradeoff(crate::tradeoff::Tradeoff),
    /// Compare methods over every group of pupils, and write a report of it
    #[command(
        after_help = "Examples:\n  eyebox evaluate builtin:still-life --size 256x256 -o comparison\n  eyebox evaluate lightfield/ builtin:dense-grass --size 256x256 --methods slfh,lf2fs --frames 1,8 -o comparison\n  eyebox evaluate builtin:still-life --hologram mine=still-life.zarr -o comparison\n\nMethods: slfh, lf2fs, stft, stft-unfiltered, stft-exact, smooth, dpac, pupil-aware"
    )]
    Evaluate(Box<crate::evaluate::Evaluate>),
    /// Write a hologram's phases as an array, or as grey pictures
    #[command(
        after_help = "Examples:\n  eyebox export still-life.zarr -o phases.npy\n  eyebox export still-life.zarr -o frames"
    )]
    Export(Export),
    /// Make a hologram of phases from any program: an array, or grey pictures
    #[command(
        after_help = "Examples:\n  eyebox import phases.npy --display bench.toml --color green -o mine.zarr\n  eyebox import phases.npy --display bench.toml --color green --scene lightfield/ -o mine.zarr\n  eyebox import frames --display bench.toml -o mine.zarr\n\nA .npy is (row, column), (sub-frame, row, column) or (colour, sub-frame, row, column); colours come in the order red, green, blue."
    )]
    Import(crate::import::Import),
    /// Write what a display receives: video frames with levels or bit-planes, as PNG
    #[command(
        after_help = "Examples:\n  eyebox encode still-life.zarr --display planes24 --size 256x256 -o frames\n  \
                      eyebox encode phases.npy --display bench.toml -o frames --json\n\nFrames come in the order in which they are shown. A .npy is (sub-frame, row, column) or (colour, sub-frame, row, column), float, radians.\nDisplay files: docs/displays.md"
    )]
    Encode(Encode),
    /// Show a hologram or a sequence on a display, on time, and say what was shown
    #[command(
        after_help = "Examples:\n  eyebox play moving.zarr --display planes24 --size 512x512 --loop --duration 10 --stats played.json\n  \
                      eyebox play moving.zarr --display plm --record shown --trace trace.json\n\nEnds with 0 at the end, after --duration, and on ctrl-C; with 2 when it cannot be played, with 3 when the display is lost, with 130 at once on a second ctrl-C. The display is left on the idle picture: the phase 0, or with --sync the sync picture."
    )]
    Play(Box<crate::play::Play>),
    /// Show whatever there is on a display, steered where there is an eye tracker: holograms, scenes, applications
    #[command(
        after_help = "Examples:\n  eyebox show moving.zarr --display planes24 --size 512x512 --loop --duration 10\n  \
                      eyebox show moving.zarr --display planes24 --tracker simulated --stats shown.json\n  \
                      eyebox show builtin:still-life --size 256x256 --display planes24 --tracker simulated\n  \
                      eyebox show live:demo --size 256x256 --color green --display planes8 --tracker simulated --duration 60\n\nWHAT is a hologram, a sequence or a far field in tiles; bare phases; a scene, or several of them, which are solved first; or\nlive:NAME, an application in another process (docs/live-input.md). Without --tracker holograms are played as eyebox play does, and\nan application's frames are refined for the whole eyebox. Ends as play does."
    )]
    Show(Box<crate::show::Show>),
    /// Give frames of scenes to a display that takes them from other programs, as an application would: for tests
    #[command(after_help = "Examples:\n  eyebox feed builtin:still-life --name demo --rate 30 --path=camera=-2..2\n  \
                      eyebox feed builtin:plane --name demo --path=depth=-1..1 --frames 300 --json\n  \
                      eyebox feed frames/ --name demo --rate 24\n\nThe display takes them as live:NAME: docs/live-input.md. --display says its optics. Ends when the display does.")]
    Feed(Box<crate::feed::Feed>),
    /// Film what an eye sees while it moves, focuses and blinks, beside what it should see
    #[command(
        after_help = "Examples:\n  eyebox film still-life.zarr --path path.json -o still-life.y4m\n  eyebox film moving.zarr --path path.json --binning 2 -o frames\n  eyebox film builtin:still-life --size 512x512 --path path.json --alone -o alone.y4m\n\npath.json, at its least {\"keys\": [{\"t_s\": 0, \"x_mm\": -4}, {\"t_s\": 2, \"x_mm\": 4}]}: keys by rising t_s (s) with x_mm, y_mm, diameter_mm, focus (mm, or\n\"0.01D\") and jump (true: at once), beside them rate_hz (30) and blinks_s. The same path gives the same film."
    )]
    Film(Box<crate::film::Film>),
    /// Show what an eye sees in a window, live: the mouse moves the pupil, the wheel changes focus
    #[command(after_help = "Examples:\n  eyebox preview still-life.zarr --scene builtin:still-life\n  \
                      eyebox preview moving.zarr --pupil=2,0,6,1 --zoom 2\n  \
                      eyebox preview mine.zarr --prescription none\n  \
                      eyebox preview phases.npy --pitch 8 --wavelength 520 --focal-length 400\n\nIn the window: the mouse moves the pupil over the eyebox, the wheel changes focus, + and - the diameter, a switches\nspeckle averaging, p shows the photograph of --scene, s saves a PNG, i shows a line and a map, h all keys, escape closes.\nEnds with 0 when it is closed and on ctrl-C; with 2 when it cannot be shown, with 3 when the desktop is lost.")]
    Preview(Box<crate::preview::Preview>),
    /// List the monitors that a window can cover
    #[command(after_help = "Example:\n  eyebox monitors --json")]
    Monitors(crate::play::Monitors),
    /// Time the steps of a solve, and each kernel, beside another program in the same run
    #[command(
        after_help = "Example:\n  eyebox bench builtin:still-life --size 512x512 --color green --steps 20 --beside 'python3 mine.py'"
    )]
    Bench(Bench),
    /// List engines and devices, and which one is taken
    #[command(
        after_help = "Example:\n  eyebox devices --json\n\nWhat a Vulkan driver compiled is kept in $XDG_CACHE_HOME/eyebox, else ~/.cache/eyebox."
    )]
    Devices(Devices),
    /// List the displays that are built in, show one, or begin a file of your own from it
    #[command(
        after_help = "Examples:\n  eyebox displays\n  eyebox displays show holoeye-pluto-2.1\n  eyebox displays new holoeye-pluto-2.1 -o bench.toml"
    )]
    Displays(crate::displays::Displays),
    /// Fit a model of the display as it is to pictures of it
    #[command(
        after_help = "Examples:\n  eyebox calibrate --display bench.toml --camera 'python3 my_camera.py' -o calibrated.toml\n  \
                      eyebox calibrate --display bench.toml --camera 'python3 my_camera.py' --keep pictures -o calibrated.toml\n  \
                      eyebox calibrate --display bench.toml --captures pictures -o calibrated.toml\n  \
                      eyebox calibrate --display bench.toml --camera 'python3 my_camera.py' --output window --iris=0,0,6 -o calibrated.toml\n\nThe command and its fifteen lines of Python: docs/calibrate.md. Ends with 3 where the bench or ctrl-C ended it."
    )]
    Calibrate(Box<crate::calibrate::Calibrate>),
    /// List eye trackers, explain a report descriptor, or show and record what a tracker says
    #[command(after_help = "Examples:\n  eyebox trackers\n  eyebox trackers --describe descriptor.bin --json\n  \
                      eyebox trackers --watch hid --duration 10 --record session.hid\n  \
                      eyebox trackers --watch session.hid --json\n  \
                      eyebox trackers --watch simulated:7 --rate 500 --duration 2 --pupil 20\n  \
                      eyebox trackers --watch pupil://localhost --calibrate ada.toml\n\n\
                      Sources: hid, FILE.hid, FILE.jsonl, pupil://HOST[:PORT], udp://[HOST]:PORT, simulated[:SEED]")]
    Trackers(Trackers),
    /// Print what a shell completes the command line by
    #[command(
        after_help = "Examples:\n  eyebox completions bash > ~/.local/share/bash-completion/completions/eyebox\n  eyebox completions zsh > ~/.zfunc/_eyebox\n  eyebox completions fish > ~/.config/fish/completions/eyebox.fish"
    )]
    Completions(crate::generate::Completions),
    /// Write the manual's pages
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
        for sub in command.get_subcommands() {
            let help = sub.get_after_help().expect("an example").to_string();
            assert!(help.contains(&format!("eyebox {}", sub.get_name())), "{help}");
        }
    }
}
