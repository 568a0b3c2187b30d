//! Solves one color of a scene with settings that trade quality for time.

use super::QualityError;
use crate::engine::{Engine, Memory};
use crate::optics::{Color, Display, Padding};
use crate::scene::{LightField, ViewGrid};
use crate::solve::{self, Cost, Flow, Levels, PaddingRule, Problem, Progress, Settings, Solution};
use std::borrow::Cow;
use std::time::Instant;

/// One color of a scene on a display, with every part of its solve that does not trade quality for time.
#[derive(Debug, Clone)]
pub struct ColorJob<'a> {
    /// The scene, which has the size of the display.
    pub field: &'a LightField,
    /// The solved color of the scene.
    pub color: Color,
    /// The display for which it is solved.
    pub display: &'a Display,
    /// The depths, diameters and seed. `frames` are the shown sub-frames.
    pub base: Settings,
    /// Phases that the SLM can show, or any phase if there are enough of them.
    pub levels: Levels,
}

/// The result of settings.
#[derive(Debug, Clone)]
pub struct Solved {
    /// Phases of all pixels and all shown sub-frames. Its validation belongs to the problem that was solved. If the
    /// settings [reduce](Settings::reduces) the problem, only a [`Reference`](super::Reference) has the true score.
    pub solution: Solution,
    /// Number of solved sub-frames. They come first and repeat.
    pub frames: usize,
    /// Milliseconds from the light field to the phases, for thinning, pyramid, choice of exposure, and steps.
    pub milliseconds: f64,
}

/// A problem and its settings, ready for a solve.
#[derive(Debug, Clone)]
pub struct Prepared {
    /// The problem, with fewer views or coarser pixels if the settings require it.
    pub problem: Problem,
    /// The settings of the solve.
    pub settings: Settings,
    /// Side of its pixels in pixels of the SLM.
    pub pixel: usize,
}

impl ColorJob<'_> {
    /// Returns the zeros around the SLM that depth and eyebox require (OPTICS 2).
    ///
    /// # Errors
    /// [`QualityError`] for a color that the display does not have.
    pub fn required_padding(&self) -> Result<Padding, QualityError> {
        let optics = self.display.optics(self.color)?;
        let deepest = self.base.depth[0].abs().max(self.base.depth[1].abs());
        Ok(Padding::required(&optics, deepest, self.display.eyebox_min() / 2.0))
    }

    /// Returns the base with all fields of `quality` that trade quality for time.
    pub fn settings(&self, quality: &Settings) -> Settings {
        let mut settings = self.base.with_quality_of(quality);
        if settings.levels == Levels::Display {
            let own = [&self.levels, &self.base.levels].into_iter().find(|l| l.given().is_some());
            settings.levels = own.cloned().unwrap_or_default();
        }
        settings
    }

    /// Counts the cost of settings of this quality, from their first steps until those have drawn 64 pupils. It loads
    /// nothing.
    ///
    /// # Errors
    /// [`QualityError`] for a color that the display does not have.
    pub fn cost(&self, quality: &Settings, memory: Memory) -> Result<Cost, QualityError> {
        let settings = self.settings(quality);
        let display = quality.coarser(self.display);
        let (every, [[_, rows], [_, columns]]) = quality.thinned(self.field.grid);
        let views = ViewGrid { rows, columns, cell: every as f64 * self.field.cell(self.display) };
        let padding = ColorJob { display: &display, ..self.clone() }.padding(&settings)?;
        let mut problem = Problem::outline(&display, self.color, padding, views)?;
        problem.eyebox = problem.eyebox.min(self.display.eyebox_min());
        Ok(Cost::new(&problem, &settings, memory, 64))
    }

    /// Returns the padding of a solve.
    ///
    /// It keeps out light that leaves the picture, if the settings require it and such light exists. Otherwise it
    /// speeds up a side that transforms slowly, unless the settings exclude padding.
    ///
    /// # Errors
    /// [`QualityError`] for a color that the display does not have.
    pub fn padding(&self, settings: &Settings) -> Result<Padding, QualityError> {
        let required = match settings.padding {
            PaddingRule::Exact => return Ok(Padding::default()),
            PaddingRule::Never => Padding::default(),
            PaddingRule::Need | PaddingRule::Always => self.required_padding()?,
        };
        let smooth = Padding::smooth(&self.display.optics(self.color)?);
        Ok(if required == Padding::default() { smooth } else { required })
    }

    /// Prepares the problem for settings of this quality.
    ///
    /// # Errors
    /// [`QualityError`] for a color that the display or the scene does not have.
    pub fn prepare(&self, quality: &Settings) -> Result<Prepared, QualityError> {
        let settings = self.settings(quality);
        let reduced = quality.scene(self.field, self.display);
        let (field, display) = match &reduced {
            Some((field, display)) => (Cow::Borrowed(field), Cow::Borrowed(display)),
            None => (Cow::Borrowed(self.field), Cow::Borrowed(self.display)),
        };
        let pixel = self.display.width / display.width.max(1);
        let padding = ColorJob { field: &field, display: &display, ..self.clone() }.padding(&settings)?;
        let mut problem = Problem::new(&field, self.color, &display, padding)?;
        // Coarser pixels have a smaller eyebox, and pupils outside of it are useless.
        problem.eyebox = problem.eyebox.min(self.display.eyebox_min());
        Ok(Prepared { problem, settings, pixel: pixel.max(1) })
    }

    /// Solves with settings of this quality. The `seconds` and `psnr` of the base apply as in any solve.
    ///
    /// # Errors
    /// [`QualityError`] if the preparation or the solve fails.
    pub fn solve(
        &self,
        quality: &Settings,
        engine: &mut dyn Engine,
        observe: &mut dyn FnMut(&Progress) -> Flow,
    ) -> Result<Solved, QualityError> {
        let start = Instant::now();
        let Prepared { problem, settings, pixel } = self.prepare(quality)?;
        let mut solution = solve::solve(&problem, &settings, engine, observe)?;
        if pixel > 1 {
            solution.phases = enlarged(&solution.phases, problem.optics.height, problem.optics.width, pixel);
            // A pupil's share of the SLM's own eyebox is smaller by this factor, and its intensity is divided by that
            // share.
            solution.exposure /= (pixel * pixel) as f64;
        }
        solution.seconds = start.elapsed().as_secs_f64();
        Ok(Solved { milliseconds: solution.seconds * 1e3, frames: settings.solved_frames(), solution })
    }
}

/// Repeats every pixel of every frame (height, width) on `pixel` x `pixel` pixels.
fn enlarged(phases: &[f32], height: usize, width: usize, pixel: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(phases.len() * pixel * pixel);
    for row in phases.chunks_exact(width.max(1)) {
        let wide: Vec<f32> = row.iter().flat_map(|p| std::iter::repeat_n(*p, pixel)).collect();
        (0..pixel).for_each(|_| out.extend_from_slice(&wide));
    }
    debug_assert_eq!(out.len() % (height * width * pixel * pixel).max(1), 0);
    out
}

#[cfg(test)]
mod tests {
    use super::super::Reference;
    use super::*;
    use crate::engine::{Buffer, cpu::CpuEngine};
    use crate::evaluate;
    use crate::optics::{Mask, WindowFactor};
    use crate::plan::{Planner, Purpose};
    use crate::scene;
    use std::sync::Arc;

    struct Scene {
        display: Display,
        field: LightField,
    }

    impl Scene {
        fn new(height: usize, width: usize) -> Self {
            let display = Display { height, width, ..Display::preset("small").unwrap() };
            let field = scene::load("builtin:still-life", &scene::Request::new(&display, &[Color::Green])).unwrap();
            Self { display, field }
        }

        fn job(&self) -> ColorJob<'_> {
            let [a, b] = self.field.depth_range(&self.display).unwrap();
            let base =
                Settings { depth: [a.min(b), a.max(b)], diameter: [3e-3, 18e-3], frames: 4, ..Settings::default() };
            ColorJob { field: &self.field, color: Color::Green, display: &self.display, base, levels: Levels::Any }
        }
    }

    fn go(job: &ColorJob, quality: &Settings) -> Solved {
        job.solve(quality, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap()
    }

    #[test]
    fn the_default_recipe_is_a_plain_solve() {
        let scene = Scene::new(32, 48);
        let (job, recipe) = (scene.job(), Settings { steps: 4, ..Settings::default() });
        let solved = go(&job, &recipe);
        let problem = Problem::new(&scene.field, Color::Green, &scene.display, Padding::default()).unwrap();
        let settings = Settings { steps: 4, ..job.base.clone() };
        let plain = solve::solve(&problem, &settings, &mut CpuEngine::new(), &mut |_| Flow::Continue).unwrap();
        assert_eq!(solved.solution.phases, plain.phases);
        assert_eq!((solved.solution.exposure, solved.frames), (plain.exposure, 4));
        assert!(solved.milliseconds > 0.0);
    }

    #[test]
    fn sub_frames_repeat_and_pixels_are_enlarged() {
        let scene = Scene::new(32, 48);
        let job = scene.job();
        let solved = go(&job, &Settings { steps: 2, repeats: 2, ..Settings::default() });
        let (phases, half) = (&solved.solution.phases, 2 * 32 * 48);
        assert_eq!((phases.len(), solved.frames), (2 * half, 2));
        assert_eq!(phases[..half], phases[half..]);
        let mut engine = CpuEngine::new();
        let reference = Reference::new(&job, 0, &mut engine).unwrap();
        let once = reference.score(&phases[..half], &mut engine).unwrap();
        let twice = reference.score(phases, &mut engine).unwrap();
        assert!(once.psnr.iter().zip(&twice.psnr).all(|(a, b)| (a - b).abs() < 1e-3), "{once:?} {twice:?}");

        let solved = go(&job, &Settings { steps: 30, pixel: 2, padding: PaddingRule::Always, ..Settings::default() });
        let phases = &solved.solution.phases;
        assert_eq!(phases.len(), 4 * 32 * 48);
        for (i, p) in phases.iter().enumerate() {
            let (y, x) = (i / 48, i % 48);
            assert_eq!(*p, phases[(y - y % 2) * 48 + x - x % 2]);
        }
        // The exposure belongs to the SLM's own eyebox, except for the effect of diffraction at the pixels.
        let fitted = reference.score(phases, &mut engine).unwrap().exposure;
        let ratio = fitted / solved.solution.exposure;
        assert!((0.4..2.5).contains(&ratio), "{ratio}");
    }

    /// The reference scores the images themselves, independent of the solve.
    #[test]
    fn the_reference_scores_the_images() {
        let scene = Scene::new(40, 32);
        let job = scene.job();
        let solved = go(&job, &Settings { steps: 6, views: 2, ..Settings::default() });
        let mut engine = CpuEngine::new();
        let reference = Reference::new(&job, 7, &mut engine).unwrap();
        let validation = reference.score(&solved.solution.phases, &mut engine).unwrap();
        assert_eq!(validation.psnr.len(), super::super::REFERENCE_PUPILS);

        let pupils = reference.pupils.clone();
        let padding = job.required_padding().unwrap();
        assert!(padding != Padding::default(), "a scene with depth needs some");
        let problem = Problem::new(&scene.field, Color::Green, &scene.display, padding).unwrap();
        let planner: Planner = problem.planner(4, WindowFactor::Full);
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid))).unwrap();
        engine.write(Buffer::Phases, &solved.solution.phases).unwrap();
        let pool = |images: Vec<Vec<f32>>| images.iter().map(|i| evaluate::pool2(i, 40, 32)).collect::<Vec<_>>();
        let wanted = pool(evaluate::photographs(&mut engine, &planner, &pupils).unwrap());
        let seen = pool(evaluate::views(&mut engine, &planner, &pupils).unwrap());
        let pairs = || seen.iter().zip(&wanted).map(|(s, w)| (&s[..], &w[..]));
        let exposure = evaluate::fit_exposure(pairs()).unwrap();
        assert!((validation.exposure / exposure - 1.0).abs() < 1e-5);
        for ((seen, wanted), scored) in pairs().zip(&validation.psnr) {
            let exposed: Vec<f32> = seen.iter().map(|v| v * exposure as f32).collect();
            let psnr = evaluate::psnr(&exposed, wanted).unwrap();
            assert!((psnr - scored).abs() < 0.01, "{psnr} {scored}");
        }
        let other = Reference::new(&job, 8, &mut engine).unwrap();
        assert_ne!(other.pupils, pupils, "another seed, other pupils");
        // Diffraction takes nothing through wide pupils. Through narrow ones no trial exceeds its ceiling.
        assert_eq!(reference.ceiling(&mut engine).unwrap(), None);
        let base = Settings { diameter: [2e-3, 4e-3], ..job.base.clone() };
        let narrow = Reference::new(&ColorJob { base, ..scene.job() }, 7, &mut engine).unwrap();
        let [mean, worst] = narrow.ceiling(&mut engine).unwrap().expect("a ceiling");
        let scored = narrow.score(&solved.solution.phases, &mut engine).unwrap();
        assert!(worst < mean && scored.mean() < mean && scored.worst() < worst, "{mean} {worst} {scored:?}");
    }

    #[test]
    fn few_levels_are_better_optimised_for() {
        let scene = Scene::new(48, 48);
        let levels = Levels::Given(solve::even_levels(3));
        let job = ColorJob { levels: levels.clone(), ..scene.job() };
        let recipe = Settings { steps: 40, ..Settings::default() };
        let mut engine = CpuEngine::new();
        let mut scored = |quality: &Settings| {
            let solved = go(&job, quality);
            let reference = Reference::new(&job, 0, &mut engine).unwrap();
            let as_shown = reference.score(&solved.solution.phases, &mut engine).unwrap().mean();
            let free = reference.with_levels(Levels::Any).score(&solved.solution.phases, &mut engine).unwrap().mean();
            (as_shown, free)
        };
        let (after, free) = scored(&recipe);
        let (optimised, shown) = scored(&Settings { levels: Levels::Display, ..recipe });
        assert!(free > after + 0.5, "levels lose quality, {free} {after}");
        assert!(optimised > after + 0.3, "{optimised} {after}");
        assert!((optimised - shown).abs() < 1e-3, "phases that are on levels stay there");
    }

    #[test]
    fn what_costs_more_is_expected_to() {
        let scene = Scene::new(96, 64);
        let job = scene.job();
        let of = |settings: Settings| job.cost(&settings, Memory::Host).unwrap();
        let start = of(Settings::default());
        let more = [
            Settings { steps: 120, ..Settings::default() },
            Settings { pupils: 32, ..Settings::default() },
            Settings { window: WindowFactor::Two, ..Settings::default() },
            Settings { padding: PaddingRule::Always, ..Settings::default() },
        ];
        for recipe in more {
            assert!(of(recipe.clone()).work() > 1.05 * start.work(), "{recipe}");
        }
        let less = [
            Settings { repeats: 2, ..Settings::default() },
            Settings { views: 2, ..Settings::default() },
            Settings { pixel: 2, ..Settings::default() },
        ];
        for recipe in less {
            let found = of(recipe.clone());
            assert!(found.work() < start.work() && found.bytes() < start.bytes(), "{recipe}");
        }
        // The pyramid is counted with its views. With every eighth of 81 views, 4 remain.
        let problem = job.prepare(&Settings::default()).unwrap().problem;
        let four = of(Settings { views: 8, ..Settings::default() });
        assert_eq!((start.bytes() - four.bytes()) * 81 / 77, problem.pyramid.bytes() as u64);
    }

    #[test]
    fn memory_of_a_mask_is_counted() {
        let scene = Scene::new(32, 32);
        let masked = scene.display.with_mask(Some(Mask::of_seed(4, 1, None))).unwrap();
        let bytes = |display| {
            let job = ColorJob { display, ..scene.job() };
            job.cost(&Settings::default(), Memory::Host).unwrap().bytes()
        };
        // Fields are complex float32 for each of the mask's 4 x 4 pixels per SLM pixel.
        assert!(bytes(&masked) >= bytes(&scene.display) + 8 * 16 * 32 * 32);
    }

    /// A solve pads a slow side by the same number as its plan states.
    #[test]
    fn a_slow_side_is_solved_padded() {
        let display = Display { height: 12, width: 262, ..Display::preset("small").unwrap() };
        let field = scene::load("builtin:plane", &scene::Request::new(&display, &[Color::Green])).unwrap();
        let (base, levels) = (Settings { depth: [0.0; 2], ..Settings::default() }, Levels::Any);
        let job = ColorJob { field: &field, color: Color::Green, display: &display, base: base.clone(), levels };
        for padding in [PaddingRule::Never, PaddingRule::Need, PaddingRule::Always] {
            let settings = Settings { padding, ..base.clone() };
            let padding = job.prepare(&settings).unwrap().problem.padding;
            assert_eq!(padding, Padding { rows: 0, columns: 26 });
            assert_eq!(job.padding(&settings).unwrap(), padding);
        }
        let exact = Settings { padding: PaddingRule::Exact, ..base.clone() };
        let kept = exact.with_quality_of(&Settings::default());
        assert_eq!(kept.padding, PaddingRule::Exact);
        assert_eq!(job.prepare(&kept).unwrap().problem.padding, Padding::default());
    }
}
