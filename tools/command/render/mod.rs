//! `eyebox render` renders the image that an eye sees through one pupil, or a film along a path.

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
