//! `eyebox export`: phases for those who show them otherwise.

use crate::Failure;
use crate::args::Export;
use crate::common::{self, Form};
use eyebox::low_level::hologram::{self, Opening};

/// Writes the phases as one array, or as a folder of grey pictures.
pub fn run(args: &Export) -> Result<(), Failure> {
    let opening = args.phases.opening(&args.hologram, args.which.at)?;
    let opening = Opening { unfinished: args.unfinished.unfinished, ..opening };
    let hologram = opening.hologram(&args.hologram).map_err(|e| args.unfinished.failure(e))?;
    let count = hologram.colors.len() * hologram.frames;
    if args.out.extension().is_some() {
        common::form(&args.out, &[Form::Npy])?;
        hologram::save_phases(&hologram, &args.out)?;
        eprintln!(
            "wrote {}: {count} sub-frames of {}x{}, radians",
            args.out.display(),
            hologram.height,
            hologram.width
        );
    } else {
        hologram.save_pngs(&args.out)?;
        eprintln!(
            "wrote {}: {count} pictures of {}x{}, 256 levels a turn",
            args.out.display(),
            hologram.height,
            hologram.width
        );
    }
    Ok(())
}
