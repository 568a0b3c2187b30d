//! Measures the speckle of an even gray plane against the number of sub-frames.
//!
//! One set of frames is solved one by one, each from its own seed. The other frames are solved together.

use super::measure::leading;
use super::results::SpeckleFigures;
use eyebox::low_level::engine::{Buffer, Engine};
use eyebox::low_level::evaluate;
use eyebox::low_level::optics::{Color, Display, Padding, Pupil, WindowFactor};
use eyebox::low_level::plan::Purpose;
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{self, Flow, Method, Problem, Settings};

/// The measured numbers of sub-frames.
pub(crate) const COUNTS: [usize; 5] = [1, 2, 4, 8, 16];
/// The number of independent groups of as many frames as the largest count. Several groups make the curve a property of
/// the method and not of chance.
const GROUPS: usize = 4;
/// The number of joint solves per count.
const REPEATS: usize = 2;
/// The largest side of the plane, in pixels. It holds hundreds of speckle grains of a pupil of 1/4 of the eyebox.
pub(super) const SIDE: usize = 128;
/// The linear light of the plane.
pub(super) const GREY: f32 = 0.5;
/// The share of the light that is aimed at the pupils, as for scenes of middle brightness.
pub(super) const EFFICIENCY: f64 = 0.4;

/// The number of solves per method.
pub(crate) const SOLVES: usize = GROUPS * COUNTS[COUNTS.len() - 1] + REPEATS * COUNTS.len();

/// Returns true if a method's frames differ from seed to seed. Smooth phase has no speckle to average, and a table has
/// no seed.
pub(crate) fn has_speckle(method: Method) -> bool {
    !matches!(method, Method::Smooth | Method::Dpac | Method::Table)
}

/// Measures one method. Returns `None` once `went` returns false. It is called after each solve.
pub fn speckle(
    method: Method,
    settings: &Settings,
    display: &Display,
    views: [usize; 2],
    engine: &mut dyn Engine,
    went: &mut dyn FnMut() -> bool,
) -> Result<Option<SpeckleFigures>, QualityError> {
    let side = SIDE.min(display.height).min(display.width);
    let display = Display { height: side, width: side, prescription: None, ..display.clone() };
    let color = leading(&display.wavelengths.iter().map(|w| w.color).collect::<Vec<_>>());
    let problem = Problem::new(&plane(side, color, views), color, &display, Padding::default())?;
    let problems = [problem.clone(), problem];
    let diameter = display.eyebox_min() / 4.0;
    let pupil = Pupil { x: 0.0, y: 0.0, diameter, depth: 0.0 };
    let mut view = |frames: usize, seed: u64| -> Result<Vec<f32>, QualityError> {
        let settings = Settings { method, frames, seed, efficiency: Some(EFFICIENCY), ..settings.clone() };
        Ok(seen_of(&problems, &settings, &[pupil], engine, &mut |_| Flow::Continue)?.remove(0))
    };
    let seed = |i: usize| settings.seed.wrapping_add(0x7370_6563 + i as u64);
    let mut images = Vec::new();
    for i in 0..GROUPS * COUNTS[COUNTS.len() - 1] {
        images.push(view(1, seed(i))?);
        if !went() {
            return Ok(None);
        }
    }
    let mut joint = Vec::new();
    for count in COUNTS {
        let mut sum = 0.0;
        for i in 0..REPEATS {
            sum += evaluate::contrast(&view(count, seed(1000 + i))?);
            if !went() {
                return Ok(None);
            }
        }
        joint.push((count, sum / REPEATS as f64));
    }
    let independent = COUNTS.iter().filter_map(|&n| Some((n, evaluate::averaged_contrast(&images, n)?))).collect();
    Ok(Some(SpeckleFigures {
        method: method.name().into(),
        independent,
        joint,
        side,
        color,
        diameter_mm: diameter * 1e3,
    }))
}

/// Solves the first problem and renders the hologram through these pupils in the light of the second, without exposure.
pub(super) fn seen_of(
    [solved, judging]: &[Problem; 2],
    settings: &Settings,
    pupils: &[Pupil],
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&solve::Progress) -> Flow,
) -> Result<Vec<Vec<f32>>, QualityError> {
    let solution = solve::solve(solved, settings, engine, observe)?;
    let planner = judging.planner(settings.frames, WindowFactor::Full);
    engine.load(&planner.shape(Purpose::View), None)?;
    engine.write(Buffer::Phases, &solution.phases)?;
    Ok(evaluate::views(engine, &planner, pupils)?)
}

/// Returns the same gray for all views.
pub(super) fn plane(side: usize, color: Color, views: [usize; 2]) -> LightField {
    LightField {
        name: "even plane".into(),
        grid: views,
        height: side,
        width: side,
        colors: vec![color],
        planes: vec![vec![vec![GREY; side * side]; views[0] * views[1]]],
        view_pitch: None,
        disparity: None,
        depth: None,
        made: None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::engine::cpu::CpuEngine;

    #[test]
    fn independent_frames_follow_the_root_and_joint_ones_are_smoother() {
        let mut display = Display::preset("small").unwrap();
        (display.height, display.width) = (64, 64);
        let settings = Settings { steps: 12, depth: [-0.4e-3, 0.4e-3], ..Settings::default() };
        let mut solves = 0;
        let mut went = || {
            solves += 1;
            true
        };
        let found =
            speckle(Method::Slfh, &settings, &display, [3, 3], &mut CpuEngine::new(), &mut went).unwrap().unwrap();
        assert_eq!(solves, SOLVES);
        let one = found.independent[0].1;
        assert!(one > 0.2, "a single frame is grainy: {one}");
        for &(count, contrast) in &found.independent[..4] {
            let root = one / (count as f64).sqrt();
            assert!((contrast / root - 1.0).abs() < 0.1, "{count} frames: {contrast}, not {root}");
        }
        assert!(found.joint[3].1 < found.independent[3].1, "{found:?}");
        let mut stop = || false;
        assert!(
            speckle(Method::Slfh, &settings, &display, [3, 3], &mut CpuEngine::new(), &mut stop).unwrap().is_none()
        );
    }
}
