//! `eyebox render`: what an eye sees, as a picture through one pupil or as a film along a path.

mod args;
mod film;
pub mod picture;

pub use args::Render;

use crate::Failure;

/// Renders a picture or a film.
pub fn run(args: &Render) -> Result<(), Failure> {
    if args.how.experiment.printed(&[])? {
        return Ok(());
    }
    args.check()?;
    match (&args.pupil, &args.path) {
        (Some(pupil), _) => picture::run(args, pupil),
        (None, Some(path)) => film::run(args, path),
        // clap requires one of them.
        (None, None) => Ok(()),
    }
}
