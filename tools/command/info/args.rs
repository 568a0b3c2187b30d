//! The arguments of `eyebox info`.

use crate::args::{DisplayArgs, SceneOptions};
use clap::Args;
use std::path::PathBuf;

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
