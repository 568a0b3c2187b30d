//! `eyebox info` prints the contents of a file.

mod args;
mod hologram;
mod recording;
mod scene;

pub use args::Info;

use crate::subject::is_hologram;
use crate::{Failure, display};
use eyebox::low_level::encoded::is_encoded;
use eyebox::low_level::optics::PRESETS;
use std::path::Path;

/// Prints the contents of the file.
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
        // An array may be phases or views. Any other array is refused as a scene, whose readers know more kinds of
        // files.
        return hologram::run(args, path).or_else(|_| scene::run(args));
    }
    if is_encoded(path) || is_hologram(path) {
        return hologram::run(args, path);
    }
    scene::run(args)
}
