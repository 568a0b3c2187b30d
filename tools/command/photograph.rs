//! `eyebox photograph`.

use crate::Failure;
use crate::args::Photograph;
use crate::common::{self, Form};
use eyebox::low_level::optics::depth_in_words;
use eyebox::low_level::produce::is_larger_than_memory;
use eyebox::low_level::reconstruction::{Sampling, SceneSource};

/// Takes one photograph of a scene.
pub fn run(args: &Photograph) -> Result<(), Failure> {
    let form = common::form(&args.out, &[Form::Png, Form::Npy])?;
    let mut display = common::display(&args.display)?;
    // What is seen, wherever the display has to show it.
    display.picture = Default::default();
    let colors = common::colors(&args.display, &display)?;
    let check = |pupil| colors.iter().try_fold(pupil, |pupil, color| display.check_pupil(*color, pupil));
    let pupil = common::pupil(&args.pupil, display.focal_length, check, args.display.force)?;
    let mut engine = common::engine(&args.engine)?;
    let scene = match is_larger_than_memory(&display, 1) {
        true => SceneSource::Around(common::scene_around(&args.scene, &display, &colors)?),
        false => SceneSource::new(common::scene(&args.scene, &display, &colors)?, &display)?,
    };
    let mut planes = Vec::new();
    for color in 0..scene.colors() {
        planes.append(&mut scene.photographs(color, &[pupil], Sampling::Pupil, engine.as_mut())?);
    }
    let names: Vec<_> = colors.iter().map(|c| Some(*c)).collect();
    common::write_image(&args.out, form, &planes, &names, &vec![1.0; planes.len()])?;
    let ([x, y, d, _], focus) =
        (pupil.to_mm().map(|mm| (mm * 1e6).round() / 1e6), depth_in_words(pupil.depth, display.focal_length));
    eprintln!("wrote {}: the photograph from ({x}, {y}) mm through {d} mm, focused at {focus}", args.out.display());
    Ok(())
}
