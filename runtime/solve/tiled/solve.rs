//! Visits a region, which reads its phases, takes a few steps over pupils inside it, and writes the phases back.

use super::region::lags;
use super::visits::held;
use super::{RegionSize, Schedule, TiledError, Views};
use crate::engine::{Buffer, Engine, Purpose};
use crate::hologram::Tiles;
use crate::optics::{Optics, Pupil, WindowFactor};
use crate::plan::{Kernel, ModelTables, Planner, Step, Viewpoint};
use crate::scene::Pyramid;
use crate::solve::{
    BrightEnd, Flow, Optimizer, PupilRange, Sampler, Settings, Update, cosine, exposure_under, release_early, strides,
    take,
};
use eyebox_base::random::GOLDEN;
use std::slice;
use std::sync::Arc;
use std::time::Instant;

/// The solve of one color.
pub struct Job<'a> {
    /// Index of the hologram's color.
    pub color: usize,
    /// The scene in this color.
    pub views: &'a Views,
    /// The display model on the whole SLM for steps, or `None` for an ideal display.
    pub model: Option<&'a ModelTables>,
    /// Diameters, depths, seed, optimizer and window, as for any solve. The `steps` belong to one visit.
    pub settings: &'a Settings,
    /// The regions and their order.
    pub schedule: &'a Schedule,
    /// The size of the regions.
    pub size: RegionSize,
    /// Visits of the hologram's colors before this one.
    pub before: u64,
}

/// The progress after a visit.
#[derive(Debug, Clone, Copy)]
pub struct Visit {
    /// Number of finished visits of this color.
    pub visit: usize,
    /// Total number of visits of this color.
    pub visits: usize,
    /// Number of simulated pupils.
    pub pupils: usize,
    /// Mean squared difference over the last step's pupils and pixels.
    pub loss: f64,
    /// Seconds since this call began.
    pub seconds: f64,
}

/// Least share of the region that the windows of a step cover.
const COVERED: f64 = 0.75;

/// Returns the exposure of a scene and its mean light, from target images through pupils all over the eyebox (OPTICS
/// 6c).
///
/// The exposure follows from the bright end and the display model, or from the mean and the efficiency in the settings.
///
/// # Errors
/// [`TiledError`] if the engine fails.
pub fn exposure(
    optics: &Optics,
    views: &Views,
    model: Option<&ModelTables>,
    settings: &Settings,
    engine: &mut dyn Engine,
) -> Result<(f64, f64), TiledError> {
    let mut sampler = Sampler::new(settings.pupil_range(optics.eyebox()), settings.sequence, !settings.seed);
    let mut photographs = Vec::new();
    for _ in 0..8 {
        let pupil = sampler.draw();
        // The piece is as large as the views, because a larger one has no further detail.
        let piece = Optics { height: views.size(), width: views.size(), offset: [0, 0], ..*optics };
        photographs.push(views.photograph(&piece, &pupil, WindowFactor::Full, engine)?);
    }
    let end = BrightEnd::of(photographs.iter().map(|p| &p[..]));
    let exposure = match settings.efficiency {
        Some(efficiency) if end.mean > 0.0 => end.mean / efficiency,
        _ => exposure_under(model, 1.0, &end),
    };
    Ok((exposure, end.mean))
}

/// Solves one color from the state of `tiles` on, visit by visit. Each visit is saved before the next one begins. It
/// uses the exposure of the hologram.
///
/// # Errors
/// [`TiledError`]. Saved visits remain, and the same job continues from there.
pub fn solve(
    job: &Job,
    tiles: &mut Tiles,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&Visit) -> Flow,
) -> Result<Flow, TiledError> {
    let start = Instant::now();
    let visits = job.schedule.visits.len();
    let done = tiles.made().map_or(u64::MAX, |m| m.done).saturating_sub(job.before);
    for k in usize::try_from(done).unwrap_or(usize::MAX)..visits {
        let Visited { at, size, phases, pupils, loss } = visit(job, k, tiles, engine)?;
        tiles.commit(job.before + k as u64 + 1, job.color, at, size, &phases)?;
        let seconds = start.elapsed().as_secs_f64();
        if observe(&Visit { visit: k + 1, visits, pupils, loss, seconds }) == Flow::Stop {
            return Ok(Flow::Stop);
        }
    }
    Ok(Flow::Continue)
}

/// The result of a visit to a region.
#[derive(Debug, Clone)]
pub struct Visited {
    /// Row and column of the region's first pixel.
    pub at: [usize; 2],
    /// Rows and columns of the region.
    pub size: [usize; 2],
    /// Phases (sub-frame, row, column), radians.
    pub phases: Vec<f32>,
    /// Number of simulated pupils.
    pub pupils: usize,
    /// Mean squared difference over the last step's pupils and pixels.
    pub loss: f64,
}

/// Takes visit `k` of a job. It reads its region from the current `tiles` and changes nothing there.
///
/// # Errors
/// [`TiledError`] if the engine or the file fails.
///
/// # Panics
/// Panics for a visit that the schedule does not have.
pub fn visit(job: &Job, k: usize, tiles: &Tiles, engine: &mut dyn Engine) -> Result<Visited, TiledError> {
    let (at, about) = (job.schedule.visits[k], tiles.about());
    let size = job.size.inside(at, [about.height, about.width]);
    let optics = about.optics(job.color)?;
    let exposure = about.colors[job.color].exposure;
    let outer = [
        [at[1] == 0, at[1] + size[1] == about.width], //
        [at[0] == 0, at[0] + size[0] == about.height],
    ];
    let plain = Planner::new(optics, about.frames, job.settings.window);
    let region = Region::new(job, plain, [at, size], outer, exposure);
    let (first, held) = region.held;
    let mut phases = tiles.read_around(job.color, first, held)?;
    let (pupils, loss) = region.visit(k, &mut phases, engine)?;
    if held != size {
        phases = inside(&phases, held, [0, 1].map(|i| (at[i] as i64 - first[i]) as usize), size);
    }
    // The next region's views are rendered in the memory of this one's fields.
    drop(region);
    engine.load(&Planner::new(optics.piece([0; 2], [1, 1]), 1, WindowFactor::One).shape(Purpose::View), None)?;
    Ok(Visited { at, size, phases, pupils, loss })
}

/// Returns a rectangle of `size` that begins at `first` of sub-frames of `held` pixels.
fn inside(phases: &[f32], held: [usize; 2], first: [usize; 2], size: [usize; 2]) -> Vec<f32> {
    let frames = phases.chunks_exact(held[0] * held[1]);
    let rows = frames.flat_map(|frame| frame.chunks_exact(held[1]).skip(first[0]).take(size[0]));
    rows.flat_map(|row| &row[first[1]..first[1] + size[1]]).copied().collect()
}

/// A region with its target light field.
struct Region<'a> {
    job: &'a Job<'a>,
    /// The solved region, in which pupils are drawn.
    optics: Optics,
    /// First pixel and size of the pixels that the engine holds. They are the region and the surroundings from which
    /// crosstalk reaches into it.
    held: ([i64; 2], [usize; 2]),
    /// The planner of the pixels that the engine holds. It has one sub-frame, or all of them if they affect each other.
    one: Planner,
    /// The planner of all sub-frames, which decides gains.
    all: Planner,
    pyramid: Arc<Pyramid>,
    center: [f64; 2],
    /// True along x and y if it begins and ends where the SLM does.
    outer: [[bool; 2]; 2],
    exposure: f64,
}

/// Returns the position of a pupil along an axis of a region `side` wide, from its middle, for `even` in -1..1.
///
/// Pupils are drawn evenly over slightly more than the region and then moved inside. A pixel at an edge is seen by
/// pupils from one side only, so they touch it more often. With half a diameter more, as many pupils are near an edge
/// as near the middle. At an end of the SLM no region overlaps this one, so it is a whole diameter, which gives half as
/// many again.
fn place(even: f64, side: f64, diameter: f64, outer: [bool; 2]) -> f64 {
    let reach = (side - diameter).max(0.0) / 2.0;
    let beyond = outer.map(|outer| if outer { diameter } else { diameter / 2.0 });
    let [low, high] = [-reach - beyond[0], reach + beyond[1]];
    (low + (even + 1.0) / 2.0 * (high - low)).clamp(-reach, reach)
}

impl<'a> Region<'a> {
    fn new(job: &'a Job, plain: Planner, [at, size]: [[usize; 2]; 2], outer: [[bool; 2]; 2], exposure: f64) -> Self {
        let whole = plain.slm;
        let optics = whole.piece(at.map(|i| i as i64), size);
        let held = held(job.model, at, size);
        let model = job.model.map(|model| model.piece(held.0, held.1));
        // Views belong to the requested iris, which differs from the true one.
        let extent = optics.height.max(optics.width) as f64 * optics.pitch;
        let iris = Pupil { x: optics.center()[0], y: optics.center()[1], diameter: extent, depth: 0.0 };
        let seen = model.as_ref().map_or(iris, |model| model.model().asked_pupil(&iris));
        let (pyramid, views) = job.views.around([seen.x, seen.y], seen.diameter);
        let all = Planner {
            views: Some(views),
            share: job.views.share(),
            model,
            slm: whole.piece(held.0, held.1),
            grid: whole.piece(held.0, held.1),
            ..plain
        };
        let one = if lags(job.model) { all.clone() } else { Planner { frames: 1, ..all.clone() } };
        Self { job, optics, held, one, all, pyramid, center: optics.center(), outer, exposure }
    }

    /// Returns the requested iris for a true one.
    fn asked(&self, iris: Pupil) -> Pupil {
        self.job.model.map_or(iris, |model| model.model().asked_pupil(&iris))
    }

    /// Takes the steps of visit `k`, and returns the number of pupils and the last loss.
    fn visit(&self, k: usize, phases: &mut [f32], engine: &mut dyn Engine) -> Result<(usize, f64), TiledError> {
        let settings = self.job.settings;
        engine.load(&self.one.shape(Purpose::Project), Some(Arc::clone(&self.pyramid)))?;
        let scale = self.job.model.map_or(1.0, |model| model.model().iris.scale);
        let diameter = settings.diameter.map(|d| d * scale);
        let range = PupilRange { diameter, ..settings.pupil_range(self.optics.eyebox()) };
        let seed = settings.seed ^ (self.job.before + k as u64 + 1).wrapping_mul(GOLDEN);
        let mut sampler = Sampler::new(range, settings.sequence, seed);
        let (visits, steps) = (self.job.schedule.visits.len(), settings.steps.max(1));
        let (mut count, mut loss) = (0, f64::NAN);
        for step in 0..steps {
            let pupils = self.draw(&mut sampler);
            count += pupils.len();
            let in_visit = step as f64 / steps as f64;
            let progress = (k as f64 + in_visit) / visits as f64;
            loss = self.step(&pupils, progress, in_visit, phases, engine)?;
        }
        Ok((count, loss))
    }

    /// Draws pupils whose windows cover most of the region, or slightly more than all of it.
    fn draw(&self, sampler: &mut Sampler) -> Vec<Pupil> {
        let wanted = COVERED * (self.optics.height * self.optics.width) as f64;
        let (mut pupils, mut covered) = (Vec::new(), 0.0);
        let side = [self.optics.width, self.optics.height].map(|n| n as f64 * self.optics.pitch);
        while pupils.is_empty() || covered < wanted {
            let drawn = sampler.draw();
            let reach = (self.optics.eyebox() - drawn.diameter) / 2.0;
            let [x, y] = [(0, drawn.x), (1, drawn.y)].map(|(i, at)| {
                let even = if reach > 0.0 { at / reach } else { 0.0 };
                place(even, side[i], drawn.diameter, self.outer[i]) + self.center[i]
            });
            covered += (drawn.diameter / self.optics.pitch).powi(2);
            pupils.push(self.asked(Pupil { x, y, ..drawn }));
        }
        pupils
    }

    /// Takes one step of the projection (OPTICS 6b).
    ///
    /// A single sub-frame uses the ordinary list, and so do several that the liquid crystal mixes. Otherwise the
    /// sub-frames pass through the same kernels one after the other. They pass twice because their error follows only
    /// from all of them. The memory is enough for one sub-frame. `progress` belongs to the solve, and `in_visit` to the
    /// visit. A visit may be the last one to this region, so each visit ends with phases that crosstalk bounds.
    fn step(
        &self,
        pupils: &[Pupil],
        progress: f64,
        in_visit: f64,
        phases: &mut [f32],
        engine: &mut dyn Engine,
    ) -> Result<f64, TiledError> {
        let Optimizer::Projection { gain, momentum, overlap_power } = self.job.settings.optimizer else {
            return Err(TiledError::Unsuitable("a hologram in tiles requires the optimizer projection".into()));
        };
        let together = self.one.frames == self.all.frames;
        let (gain, momentum) = strides(&self.all, gain, momentum);
        // Velocities would need as much memory as the phases. A larger gain partly replaces them.
        let (gain, momentum) = match together {
            true => (cosine(gain, progress), momentum),
            false => (cosine(gain, progress) / (1.0 - 0.5 * momentum), 0.0),
        };
        let update = Update::Projection { gain, momentum, overlap_power };
        let viewpoints: Vec<Viewpoint> = pupils.iter().map(|p| Viewpoint::Pupil(*p)).collect();
        let mut pupil_passes = update.pupil_passes(&self.all, &viewpoints, self.exposure);
        if !together {
            pupil_passes.iter_mut().for_each(|pupil_pass| pupil_pass.intensity.frames = 1);
        }
        let mut whole = update.step(&self.one, pupil_passes, usize::MAX);
        release_early(&self.all, in_visit, &mut whole);
        if together {
            engine.write(Buffer::Phases, phases)?;
            let found = take(engine, &whole, slice::from_ref(&(0..whole.list.len())))?;
            if found.is_finite() {
                engine.read_into(Buffer::Phases, phases)?;
            }
            return Ok(found);
        }
        frame_by_frame(&whole, phases, engine)
    }
}

/// Takes a step over all sub-frames on an engine that holds one of them, and returns its loss.
fn frame_by_frame(whole: &Step, phases: &mut [f32], engine: &mut dyn Engine) -> Result<f64, TiledError> {
    use Kernel::{ApplyFactor, Clear, Compare, Eye, Intensity, Overlap};
    use Kernel::{Photograph, Relay, Resample, Taper, Transfer};
    let only = |keeps: &dyn Fn(usize, Kernel) -> bool| {
        let mut step = whole.clone();
        let mut place = 0..whole.list.len();
        step.list.retain(|d| place.next().is_some_and(|i| keeps(i, d.kernel)));
        step
    };
    let target = [Photograph, Resample, Compare];
    // The part of the spectrum that the pupils pass is the same for every sub-frame.
    let passing = [Transfer, Relay, Eye, Taper];
    let back = whole.list.iter().position(|d| d.kernel == ApplyFactor).unwrap_or(whole.list.len());
    let mut see = only(&|i, kernel| i < back && !target.contains(&kernel) && ![Clear, Overlap].contains(&kernel));
    let pixels = whole.project.place.height as usize * whole.project.place.width as usize;
    for (f, frame) in phases.chunks_exact(pixels).enumerate() {
        engine.write(Buffer::Phases, frame)?;
        engine.run(&see)?;
        if f == 0 {
            see.list.retain(|d| !passing.contains(&d.kernel));
            see.pupil_passes.iter_mut().for_each(|pupil_pass| pupil_pass.intensity.accumulate = 1);
        }
    }
    let losses = engine.run(&only(&|_, kernel| target.contains(&kernel)))?;
    let found = whole.mean_loss(&losses);
    if !found.is_finite() {
        return Ok(found);
    }
    let turn = only(&|_, kernel| !target.contains(&kernel) && !passing.contains(&kernel) && kernel != Intensity);
    for frame in phases.chunks_exact_mut(pixels) {
        engine.write(Buffer::Phases, frame)?;
        engine.run(&turn)?;
        engine.read_into(Buffer::Phases, frame)?;
    }
    Ok(found)
}

#[cfg(test)]
#[path = "solve_tests.rs"]
mod tests;
