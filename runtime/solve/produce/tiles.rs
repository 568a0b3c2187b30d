//! Solves a far field that is larger than memory, region by region, into its file.

use super::ProduceError;
use super::job::{SceneEvent, SceneJob, TilesPlan, TilesRequest};
use crate::engine::Engine;
use crate::evaluate::Views;
use crate::files::FileRecord;
use crate::hologram::{ColorHologram, Hologram, Metadata, PhaseSource, SceneRecord, Tiles};
use crate::optics::{Color, Display, Geometry, Pupil};
use crate::plan::ModelTables;
use crate::reconstruction::{HologramScores, SceneSource};
use crate::scene::{self, ViewSynthesis};
use crate::solve::{Flow, Settings};
use crate::tiled::{self, Job, MemoryLimit, RegionSize, Schedule, TiledError};
use eyebox_base::{Reason, reason};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// The result of a solve in tiles.
pub struct SolvedTiles {
    /// The plan with the finished visits.
    pub plan: TilesPlan,
    /// The hologram in its file.
    pub source: PhaseSource<'static>,
    /// Scores at nine places of the eyebox, or `None` if the observer stopped the solve before the last visit.
    pub scores: Option<HologramScores>,
    /// Number of simulated pupils.
    pub pupils: usize,
    /// Duration of the solve in seconds, without the scores.
    pub seconds: f64,
    /// Bytes of tiles that the solve read and wrote.
    pub moved: [u64; 2],
}

/// The key of the digests of scene and depth map in the description of the work.
const DIGESTS: &str = "digests";
/// Largest number of steps of a visit.
const STEPS: usize = 1024;

/// Returns true if a whole far field with 9 x 9 views needs more memory than the default limit.
pub fn is_larger_than_memory(display: &Display, frames: usize) -> bool {
    let pixels = (display.height * display.width) as u64;
    let colors = display.wavelengths.len() as u64;
    let bytes = pixels * (32 * frames as u64 + 81 * (4 * colors + 3));
    display.geometry == Geometry::FarField && bytes > TilesRequest::default().memory.0
}

/// Plans a solve in tiles and its memory. It reads the scene and writes nothing.
///
/// # Errors
/// The errors of [`solve_scene`](super::solve_scene) before its first visit.
pub fn plan_tiles(job: &SceneJob, request: &TilesRequest) -> Result<TilesPlan, ProduceError> {
    job.check_usual()?;
    job.check_one_by_one()?;
    Ok(Prepared::new(job, request)?.plan)
}

/// Solves every color, from the state of the file on.
pub(super) fn solve(
    job: &SceneJob,
    request: &TilesRequest,
    out: &Path,
    engine: &mut dyn Engine,
    observe: &mut dyn FnMut(&SceneEvent) -> Flow,
) -> Result<SolvedTiles, ProduceError> {
    let start = Instant::now();
    let SceneJob { display, colors, .. } = job;
    let mut prepared = Prepared::new(job, request)?;
    let work = prepared.work(job, request, engine);
    let mut tiles = match is_under_way(out, &work)? {
        true => Tiles::resume(out)?,
        false => prepared.create(job, request, out, work, engine)?,
    };
    prepared.plan.done = tiles.made().map_or(0, |m| m.done);
    observe(&SceneEvent::Tiles(&prepared.plan));
    let (visits, mut pupils, mut stopped) = (prepared.plan.visits, 0, false);
    for (i, &color) in colors.iter().enumerate() {
        let part = prepared.job(i, (i * visits) as u64);
        let flow = tiled::solve(&part, &mut tiles, engine, &mut |visit| {
            pupils += visit.pupils;
            observe(&SceneEvent::Visit { color, visit })
        })?;
        stopped = flow == Flow::Stop && tiles.made().is_some_and(|m| m.done < (colors.len() * visits) as u64);
        if stopped {
            break;
        }
    }
    let (moved, seconds) = (tiles.moved(), start.elapsed().as_secs_f64());
    if !stopped {
        tiles.finish()?;
    }
    let source = PhaseSource::Tiled(Arc::new(tiles));
    let Prepared { plan, views, .. } = prepared;
    let scores = match stopped {
        true => None,
        false => Some(source.score(&SceneSource::Around(views), &places(display, &plan.settings), engine)?),
    };
    Ok(SolvedTiles { plan, source, scores, pupils, seconds, moved })
}

/// A job in tiles before its first visit, with its scene, its regions and their order.
pub(super) struct Prepared {
    views: Vec<Views>,
    models: Vec<Option<Arc<ModelTables>>>,
    pub(super) plan: TilesPlan,
    schedule: Schedule,
    /// Pixels along each axis of the scene's views.
    picture: usize,
    /// The identity of its scene.
    record: SceneRecord,
}

impl Prepared {
    pub(super) fn new(job: &SceneJob, request: &TilesRequest) -> Result<Self, ProduceError> {
        let picture = request.picture.min(job.display.picture_size().0);
        let maps = scene::depth_maps(&job.scenes[..1], &job.reading.depth_maps)?;
        let views = Views::of_colors(&job.scenes[0], &job.request(maps.first().map(PathBuf::as_path)), picture)?;
        let views: Vec<Views> = views.into_iter().map(Views::once).collect();
        // The model is for the steps of a solve, over the whole SLM.
        let model = |&color: &Color| {
            let whole = job.display.optics(color)?;
            Ok(ModelTables::of(job.display, color, whole, whole).map(|model| model.for_steps()))
        };
        let models = job.colors.iter().map(model).collect::<Result<Vec<_>, ProduceError>>()?;
        let (plan, schedule) = plan(job, request, &views, &models)?;
        Ok(Self { views, models, plan, schedule, picture, record: job.record(0)? })
    }

    /// Returns the values that decide every byte of the file.
    pub(super) fn work(&self, job: &SceneJob, request: &TilesRequest, engine: &dyn Engine) -> Value {
        let (plan, reading) = (&self.plan, &job.reading);
        let mut work = json!({
            "scene": job.scenes[0], "views": [reading.views, Some(self.picture)], "view_pitch": reading.view_pitch_mm,
            "display": job.display.without_apparatus().to_toml(), "colors": job.colors, "settings": plan.settings, "passes": request.passes.max(1),
            "tile": tile_side(job.display), "region": [plan.region.rows, plan.region.columns], "engine": engine.describe(),
        });
        if let Some(map) = reading.depth_maps.first() {
            work["depth_map"] = json!([map.display().to_string(), reading.depth]);
        }
        if let Some(photographs) = reading.photographs.filter(|how| *how != ViewSynthesis::Auto) {
            work["photographs"] = json!(photographs);
        }
        if let Some(near) = reading.near {
            work["near"] = json!(near);
        }
        let digest = |file: &Option<FileRecord>| file.as_ref().map(|file| file.digest.clone());
        if let Some(scene) = digest(&self.record.file) {
            work[DIGESTS] = json!([Some(scene), digest(&self.record.depth_map)]);
        }
        work
    }

    /// Creates a new file with its exposures.
    pub(super) fn create(
        &self,
        job: &SceneJob,
        request: &TilesRequest,
        out: &Path,
        work: Value,
        engine: &mut dyn Engine,
    ) -> Result<Tiles, ProduceError> {
        let (display, settings) = (job.display, &self.plan.settings);
        let mut solved = Vec::new();
        for ((&color, views), model) in job.colors.iter().zip(&self.views).zip(&self.models) {
            let optics = display.optics(color)?;
            let (exposure, mean) = tiled::exposure(&optics, views, model.as_deref(), settings, engine)?;
            let (wavelength, efficiency) = (optics.wavelength, mean / exposure);
            solved.push(ColorHologram { color: Some(color), wavelength, exposure, efficiency, phases: Vec::new() });
        }
        let mut metadata = Metadata {
            solve: Some(settings.clone()),
            padded: Some([0, 0]),
            passes: Some(request.passes.max(1)),
            eyebox_mm: Some(display.eyebox_min() * 1e3),
            // Comparisons with the scene use these statements about it.
            view_pitch_mm: job.reading.view_pitch_mm,
            views: job.reading.views.map(|views| [views, views]),
            model: display.model.clone(),
            viewing: display.viewing,
            display_file: display.file.clone(),
            ..Metadata::default()
        };
        job.describe_reading(&mut metadata);
        let mut about = Hologram {
            seed: settings.seed,
            version: env!("CARGO_PKG_VERSION").into(),
            metadata,
            ..Hologram::on(display, settings.frames, solved)
        };
        about.set_scene(&job.scenes[0], self.record.clone());
        let total = (job.colors.len() * self.plan.visits) as u64;
        Ok(Tiles::create(out, &about, tile_side(display), work, total)?)
    }

    /// Returns the job of a color, with the number of visits of other colors before it.
    pub(super) fn job(&self, color: usize, before: u64) -> Job<'_> {
        let Self { views, models, plan, schedule, .. } = self;
        let (settings, size) = (&plan.settings, plan.region);
        Job { color, views: &views[color], model: models[color].as_deref(), settings, schedule, size, before }
    }
}

/// Plans the regions that the memory allows, and the settings of a visit.
fn plan(
    job: &SceneJob,
    request: &TilesRequest,
    views: &[Views],
    models: &[Option<Arc<ModelTables>>],
) -> Result<(TilesPlan, Schedule), ProduceError> {
    let display = job.display;
    if display.geometry != Geometry::FarField {
        return Err(ProduceError::Job(reason!(
            "tiles-in-a-relay",
            "tiles need a far-field display, because every pupil sees all of the SLM behind a relay"
        )));
    }
    if !display.picture.is_empty() {
        let reason = "a display's [picture] is not supported in tiles. Remove it from the display file";
        return Err(ProduceError::Job(Reason::new("tiles-with-picture", reason)));
    }
    if display.prescription.as_ref().is_some_and(|eye| !eye.is_perfect()) {
        return Err(ProduceError::Job(reason!(
            "tiles-with-prescription",
            "a prescription is not supported in tiles. Use a display without one"
        )));
    }
    let (optics, side) = (display.optics(job.colors[0])?, tile_side(display));
    let largest = display.eyebox_min() / 2.0;
    let diameter = job.diameter.unwrap_or([1e-3f64.min(largest / 4.0), 4e-3f64.min(largest)]);
    let held: u64 = views.iter().map(Views::held).sum();
    let left = MemoryLimit(request.memory.0.saturating_sub(held));
    // Views that are smaller than the picture need less memory.
    let size = RegionSize::new(&optics, models, job.settings.frames, side, diameter[1], views[0].size(), left);
    let region = size.map_err(|error| match error {
        TiledError::Memory { diameter_mm, frames, needed_mib, .. } => {
            let (needed_mib, given_mib) = (needed_mib + (held >> 20), request.memory.0 >> 20);
            TiledError::Memory { diameter_mm, frames, needed_mib, given_mib }
        }
        other => other,
    })?;
    let settings = Settings { diameter, depth: views[0].depths(job.reading.depth)?, ..job.settings.clone() };
    settings.check()?;
    if !(1..=STEPS).contains(&settings.steps) {
        return Err(ProduceError::Job(reason!(
            "steps-of-a-visit",
            "`steps` {}: a visit to a region takes 1 to {STEPS}, because it is never split. Take more `passes`",
            settings.steps
        )));
    }
    let passes = request.passes.max(1);
    let schedule = Schedule::new([display.height, display.width], region, side, passes, settings.seed);
    let memory = [request.memory.0, held];
    let views = views[0].in_words();
    Ok((TilesPlan { region, views, visits: schedule.visits.len(), done: 0, settings, memory }, schedule))
}

/// Returns the side of a tile, which is a fraction of a pupil and gives files that are neither tiny nor huge.
fn tile_side(display: &Display) -> usize {
    let pixels = display.height.max(display.width);
    (pixels / 16).next_power_of_two().clamp(32, 512)
}

/// Returns true if the job is the same of an older eyebox, which did not store the digests of its scene.
fn is_older(job: &Value, work: &Value) -> bool {
    let mut undigested = work.clone();
    undigested.as_object_mut().is_some_and(|work| work.shift_remove(DIGESTS).is_some()) && *job == undigested
}

/// Returns true if `path` has an unfinished hologram of this job.
pub(super) fn is_under_way(path: &Path, work: &Value) -> Result<bool, ProduceError> {
    if !Tiles::is_tiled(path) {
        return Ok(false);
    }
    match Tiles::open(path)?.made() {
        None => Ok(false),
        Some(made) if made.job == *work || is_older(&made.job, work) => Ok(true),
        Some(_) => Err(ProduceError::Job(reason!(
            "another-job",
            "{}: an unfinished hologram of another job. Repeat its command to continue it, or remove it",
            path.display()
        ))),
    }
}

/// Returns pupils at the middle, the sides and the corners, each wholly inside the eyebox. Diameters and depths run
/// through their ranges.
fn places(display: &Display, settings: &Settings) -> Vec<Pupil> {
    let [small, large] = settings.diameter;
    let [far, near] = settings.depth;
    let one = |i: usize| {
        let diameter = small * (large / small).powf((i * 4 % 9) as f64 / 8.0);
        let reach = (display.eyebox_min() - diameter) / 2.0;
        let (x, y) = ((i % 3) as f64 - 1.0, (i / 3) as f64 - 1.0);
        Pupil { x: x * reach, y: y * reach, diameter, depth: far + (near - far) * (i * 5 % 9) as f64 / 8.0 }
    };
    (0..9).map(one).collect()
}
