//! `eyebox display test-picture` makes the test picture of a link, and the check of its capture names the faults.

use crate::Failure;
use crate::common;
use crate::progress;
use crate::show::args::{OutputTo, output};
use crate::talk::print_report;
use clap::Args;
use eyebox::low_level::files;
use eyebox::low_level::optics::Display;
use eyebox::low_level::present::{Link, LinkFault, PresentError, judge_capture, test_picture};
use eyebox::low_level::reason;
use eyebox::low_level::session::{PictureOutput, video_frame_size};
use serde_json::json;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The time between two checks for ctrl-C.
const LOOK: Duration = Duration::from_millis(20);

/// The arguments of `eyebox display test-picture`.
#[derive(Args)]
pub struct TestPicture {
    /// Display preset or TOML file
    #[arg(value_name = "PRESET|FILE")]
    pub display: String,
    /// Output file of the picture
    #[arg(help_heading = "Output", short, long, value_name = "OUT.png", required_unless_present = "output")]
    pub out: Option<PathBuf>,
    /// Output that shows the picture until ctrl-C (window, window:MONITOR, direct or direct:DISPLAY)
    #[arg(help_heading = "Display", long, value_name = "OUTPUT", value_parser = output)]
    pub output: Option<OutputTo>,
}

/// Writes the test picture, and shows it until ctrl-C.
pub fn run(args: &TestPicture) -> Result<(), Failure> {
    if let Some(out) = &args.out {
        common::check_output(out, "png")?;
    }
    if args.output.as_ref().is_some_and(|to| !to.is_shown()) {
        return Err(Failure::Arguments(reason!(
            "not-shown",
            "--output: the test picture is shown on a display. Give --output window or --output direct"
        )));
    }
    let size = video_frame_size(&common::display_of_size(&args.display, None, false)?)?;
    let picture = test_picture(size).map_err(PresentError::from)?;
    if let Some(out) = &args.out {
        files::write_file(out, |to| files::encode_png8(to, size[0], size[1], 3, &picture))?;
        eprintln!("wrote {} with {}x{} pixels", out.display(), size[0], size[1]);
    }
    match &args.output {
        Some(to) => show(to, size, &picture),
        None => Ok(()),
    }
}

fn show(to: &OutputTo, size: [usize; 2], picture: &[u8]) -> Result<(), Failure> {
    progress::catch_interrupt();
    let mut output = PictureOutput::open(&to.output(false), size)?;
    output.link().map(Link::notes).into_iter().flatten().for_each(|note| eprintln!("note: {note}"));
    output.show(picture)?;
    eprintln!("the test picture is on. Press ctrl-C to end");
    while !progress::interrupted() && output.is_open() {
        output.pump()?;
        output.notes().iter().for_each(|note| eprintln!("note: {note}"));
        std::thread::sleep(LOOK);
    }
    Ok(())
}

fn in_words(fault: &LinkFault) -> String {
    match fault {
        LinkFault::LimitedRange => {
            "the link sends the limited range of levels, 16 to 235. Set 'Broadcast RGB' to Full (xrandr)".into()
        }
        LinkFault::Levels { shift: [red, green, blue] } => format!(
            "levels are shifted by up to {red:.0} (red), {green:.0} (green) and {blue:.0} (blue). Load a linear gamma \
             ramp, and switch color profiles and picture modes off"
        ),
        LinkFault::ColorsMixed { levels } => {
            format!("a channel that should be dark has the level {levels:.0}. Switch color matrices off")
        }
        LinkFault::ChromaSubsampled { rows } => {
            let kind = if *rows { "4:2:0" } else { "4:2:2" };
            format!("colors have a lower resolution ({kind}). Select RGB output, or fewer bits per channel")
        }
        LinkFault::Dither { share, levels } => format!(
            "the link dithers. {:.0} % of pixels are off by up to {levels:.0} levels. Switch dithering off",
            100.0 * share
        ),
        LinkFault::Scaled { size: [rows, columns], inside } => {
            let inside = inside.map_or_else(String::new, |[top, left, bottom, right]| {
                format!(", and the picture fills the rows {top} to {bottom} and the columns {left} to {right}")
            });
            format!(
                "the picture was scaled or moved. The capture has {rows}x{columns} pixels{inside}. Switch scaling and underscan off"
            )
        }
        LinkFault::Turned { degrees, mirrored } => {
            let mirrored = if *mirrored { ", then mirrored left to right" } else { "" };
            format!("turned by {degrees} degrees clockwise{mirrored}")
        }
        LinkFault::ChannelsSwapped { order } => format!("channels are exchanged: red, green, blue arrive as {order}"),
        _ => "another fault".into(),
    }
}

/// Compares a capture with the test picture of a display, and prints the faults of the link.
pub fn check_capture(display: &Display, capture: &Path, as_json: bool) -> Result<(), Failure> {
    let size = video_frame_size(display)?;
    let opened =
        File::open(capture).map_err(|source| files::FileError::Read { file: capture.display().to_string(), source })?;
    let (height, width, channels, bytes) = files::read_png8(opened, capture)?;
    let rgb = if channels == 1 { bytes.iter().flat_map(|gray| [*gray; 3]).collect() } else { bytes };
    let report = judge_capture(size, &rgb, [height, width]).map_err(PresentError::from)?;
    if as_json {
        print_report(json!({
            "kind": "capture", "name": display.name, "faults": report.faults, "merged_levels": report.merged_levels,
        }));
        return Ok(());
    }
    report.faults.iter().for_each(|fault| println!("{}", in_words(fault)));
    if report.faults.is_empty() {
        println!("the link changes nothing");
    }
    if let Some(merged) = report.merged_levels.filter(|merged| *merged > 0) {
        println!("{merged} of 255 pairs of neighboring levels are equal");
    }
    Ok(())
}
