//! `eyebox info`: what a file is.

mod hologram;
mod recording;
mod scene;

use crate::args::{DisplayArgs, SceneOptions};
use crate::subject::is_hologram;
use crate::{Failure, display};
use clap::Args;
use eyebox::low_level::encoded::is_encoded;
use eyebox::low_level::optics::PRESETS;
use std::path::{Path, PathBuf};

/// `eyebox info`
#[derive(Args)]
pub struct Info {
    /// A scene, a hologram or a sequence (NAME.zarr), phases (NAME.npy), the folder of encode, a recording (.hid, .jsonl), a display (a preset
    /// or a TOML file)
    #[arg(value_name = "FILE|NAME")]
    pub what: String,
    /// How a scene is read
    #[command(flatten)]
    pub options: SceneOptions,
    /// Display that a scene is read for
    #[command(flatten)]
    pub display: DisplayArgs,
    /// Output for a scene: all views beside each other, as they are read (PNG)
    #[arg(help_heading = "Output", short, long, value_name = "OUT.png")]
    pub out: Option<PathBuf>,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Prints what it is.
pub fn run(args: &Info) -> Result<(), Failure> {
    let path = Path::new(&args.what);
    let ends = |ending: &str| path.extension().is_some_and(|end| end.eq_ignore_ascii_case(ending));
    if ends("hid") || ends("jsonl") {
        return recording::run(&args.what, args.json);
    }
    if ends("toml") || PRESETS.contains(&&*args.what) {
        return display::check(&args.what, args.display.force, args.json);
    }
    if ends("npy") {
        // An array may be phases or views. What is neither is refused as a scene, whose readers know more kinds of files.
        return hologram::run(args, path).or_else(|_| scene::run(args));
    }
    if is_encoded(path) || is_hologram(path) {
        return hologram::run(args, path);
    }
    scene::run(args)
}
