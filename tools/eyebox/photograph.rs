//! `eyebox photograph`.

use crate::Failure;
use crate::args::Photograph;
use crate::common::{self, Form};
use crate::tiled;
use eyebox::evaluate;
use eyebox::optics::{Padding, WindowFactor};
use eyebox::plan::Purpose;
use eyebox::solve::Problem;
use std::sync::Arc;

/// Takes one photograph of a scene.
pub fn run(args: &Photograph) -> Result<(), Failure> {
    let form = common::form(&args.out, &[Form::Png, Form::Npy])?;
    let display = common::display(&args.display)?;
    if tiled::is_too_large(&display) {
        return tiled::photograph(args, &display);
    }
    let colors = common::colors(&args.display, &display)?;
    for &color in &colors {
        args.pupil.check_within(&display.optics(color)?)?;
    }
    let mut engine = common::engine(&args.engine)?;
    let field = common::scene(&args.scene, &display, &colors)?;
    let mut planes = Vec::new();
    for &color in &colors {
        let problem = Problem::new(&field, color, &display, Padding::default())?;
        let planner = problem.planner(1, WindowFactor::Full);
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
        planes.append(&mut evaluate::photographs(engine.as_mut(), &planner, &[args.pupil])?);
    }
    let names: Vec<_> = colors.iter().map(|c| Some(*c)).collect();
    common::write_image(&args.out, form, display.picture_size().into(), &planes, &names, &vec![1.0; planes.len()])?;
    let [x, y, d, z] = args.pupil.to_mm();
    eprintln!("wrote {}: the photograph from ({x}, {y}) mm through {d} mm, focused at {z} mm", args.out.display());
    Ok(())
}
