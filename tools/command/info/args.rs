//! Reads the arguments of `eyebox info`.

use crate::args::{DisplayArgs, SceneOptions};
use clap::Args;
use std::path::PathBuf;

/// The arguments of `eyebox info`.
#[derive(Args)]
pub struct Info {
    /// A scene, a hologram or a sequence (NAME.zarr), phases (NAME.npy), the folder of encode, a recording (.hid,
    /// .jsonl), or a display (a preset or a TOML file)
    #[arg(value_name = "FILE|NAME")]
    pub what: String,
    #[command(flatten)]
    pub options: SceneOptions,
    #[command(flatten)]
    pub display: DisplayArgs,
    /// Output file (PNG) of all views of a scene side by side, as they are read
    #[arg(help_heading = "Output", short, long, value_name = "OUT.png")]
    pub out: Option<PathBuf>,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}
