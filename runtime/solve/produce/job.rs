//! Describes a job with its scenes, display and settings, and the events of its solve.

use super::ProduceError;
use crate::engine::Engine;
use crate::hologram::{Metadata, SceneRecord, Start};
use crate::optics::{Color, Display, check_usual_diameters};
use crate::reconstruction::{SceneReading, drawer_for};
use crate::scene::{self, LightField, Request, SplatDrawer, ViewSynthesis};
use crate::solve::{Full, PlanRequest, Progress, PupilRange, ScenePlan, Settings, Solution};
use crate::tiled::{self, RegionSize};
use eyebox_base::error::Reason;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Scenes to solve into a hologram or a sequence of holograms.
#[derive(Debug, Clone)]
pub struct SceneJob<'a> {
    /// Folders of views, pictures, or `builtin:NAME`. One scene makes a hologram, and several make the frames of a
    /// sequence.
    pub scenes: Vec<String>,
    /// The display for which it is solved.
    pub display: &'a Display,
    /// The solved colors of the display.
    pub colors: Vec<Color>,
    /// The options for reading the scenes.
    pub reading: SceneReading,
    /// Range of drawn pupil diameters in meters, or `None` for the usual one of the eyebox.
    pub diameter: Option<[f64; 2]>,
    /// Accepts a display and diameters that look like a mistake. Examples are a wrong unit, exchanged rows and columns,
    /// and pupils that no eye has or that do not fit the eyebox.
    pub force: bool,
    /// Everything else that decides the solve. The reading's depth and `diameter` above replace its own values. The
    /// colors share its `seconds`.
    pub settings: Settings,
    /// Parts of the model that are kept regardless of the scene.
    pub full: Full,
    /// Speckle contrast that decides the number of sub-frames, or `None` for the number in the settings.
    pub contrast: Option<f64>,
    /// The options for several scenes.
    pub sequence: SequenceRequest,
    /// The options of a far field that is solved region by region into tiles on disk, or `None` for a whole solve.
    pub tiles: Option<TilesRequest>,
    /// Identity of a light field that replaces the scene, or `None` for the identity of the named scene.
    pub record: Option<SceneRecord>,
}

/// The properties of a sequence besides its holograms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequenceRequest {
    /// Holograms per second as a fraction.
    pub rate: [u32; 2],
    /// The start of each hologram after the first.
    pub start: Start,
}

/// The options of a far field in tiles. The `steps` of the settings belong to one visit to a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TilesRequest {
    /// Memory limit in bytes.
    pub memory: tiled::MemoryLimit,
    /// Number of passes over the SLM.
    pub passes: usize,
    /// Pixels along each axis of the scene's views.
    pub picture: usize,
}

impl TilesRequest {
    /// Default steps of one visit.
    pub const STEPS: usize = 8;
}

impl Default for TilesRequest {
    fn default() -> Self {
        Self { memory: tiled::MemoryLimit(4 << 30), passes: 3, picture: 1024 }
    }
}

/// The plan of a solve in tiles.
#[derive(Debug, Clone)]
pub struct TilesPlan {
    /// The size of the regions and of a visit.
    pub region: RegionSize,
    /// The origin of the scene's views, as text.
    pub views: String,
    /// Visits to regions per color.
    pub visits: usize,
    /// Finished visits of all colors.
    pub done: u64,
    /// The settings, whose `steps` belong to a visit.
    pub settings: Settings,
    /// The memory limit, and the memory of the views, in bytes.
    pub memory: [u64; 2],
}

impl TilesPlan {
    /// Returns the bytes of a visit and the views.
    pub fn bytes(&self) -> u64 {
        self.region.bytes + self.memory[1]
    }

    /// Returns the number of earlier visits of this color.
    pub fn done_of(&self, colors: &[Color], color: Color) -> u64 {
        let index = colors.iter().position(|c| *c == color).unwrap_or(0);
        self.done.saturating_sub((index * self.visits) as u64).min(self.visits as u64)
    }
}

/// An event of a solve.
#[non_exhaustive]
pub enum SceneEvent<'a> {
    /// The parts of the scene that are computed were decided.
    Planned {
        /// The scene as it is solved.
        field: &'a LightField,
        /// Rows and columns of its views before any reduction.
        views: [usize; 2],
        /// All decisions of the plan.
        plan: &'a ScenePlan,
        /// The settings of the solve.
        settings: &'a Settings,
    },
    /// A sequence begins or is resumed.
    Sequence {
        /// Number of existing holograms.
        done: usize,
        /// Total number of holograms.
        count: usize,
    },
    /// A solve in tiles begins or is resumed.
    Tiles(&'a TilesPlan),
    /// A step was taken.
    Step {
        /// Number of the hologram in its sequence.
        hologram: usize,
        /// The color of the step.
        color: Color,
        /// The progress of the solve.
        progress: &'a Progress<'a>,
    },
    /// A region was visited.
    Visit {
        /// The color of the region.
        color: Color,
        /// The progress of the visits.
        visit: &'a tiled::Visit,
    },
    /// The solve of a color ended.
    Solved {
        /// Number of the hologram in its sequence.
        hologram: usize,
        /// The color of the solution.
        color: Color,
        /// The solution of this color.
        solution: &'a Solution,
    },
    /// A hologram of a sequence was written to disk.
    Appended {
        /// Number of the hologram in its sequence.
        hologram: usize,
        /// The name of its scene.
        scene: &'a str,
        /// The solution of each color.
        solutions: &'a [(Color, Solution)],
    },
}

impl<'a> SceneJob<'a> {
    /// Creates the job of one scene in all colors of a display, with the default settings.
    pub fn new(scene: &str, display: &'a Display) -> Self {
        Self {
            scenes: vec![scene.into()],
            display,
            colors: display.wavelengths.iter().map(|w| w.color).collect(),
            reading: SceneReading::default(),
            diameter: None,
            force: false,
            settings: Settings::default(),
            full: Full::default(),
            contrast: None,
            sequence: SequenceRequest { rate: [30, 1], start: Start::Warm(0.0) },
            tiles: None,
            record: None,
        }
    }

    /// Returns an error for likely mistakes, unless `force` is set.
    ///
    /// # Errors
    /// [`OpticsError::Unusual`](crate::optics::OpticsError::Unusual) with the unusual value.
    pub fn check_usual(&self) -> Result<(), ProduceError> {
        if self.force {
            return Ok(());
        }
        self.display.check_usual()?;
        Ok(self.diameter.map_or(Ok(()), |diameter| check_usual_diameters(diameter, self.display.eyebox_min()))?)
    }

    /// Returns an error for simultaneous color, which sequences and tiles do not support.
    pub(super) fn check_one_by_one(&self) -> Result<(), ProduceError> {
        if self.settings.joint.is_none() {
            return Ok(());
        }
        let reason = "simultaneous color needs a single scene without tiles. Remove the other scenes and the tiles";
        Err(ProduceError::Job(Reason::new("joint-of-many", reason)))
    }

    /// Returns the request for loading one of its scenes with its depth map.
    pub fn request<'r>(&'r self, depth_map: Option<&'r Path>) -> Request<'r> {
        self.reading.request(self.display, &self.colors, depth_map, self.force)
    }

    /// Returns the job with the depth map of each scene, whose values have the same meaning in all of them.
    pub(super) fn with_maps(&self) -> Result<Self, ProduceError> {
        let reading = &self.reading;
        let depth_maps = scene::sequence_maps(&self.scenes, &reading.depth_maps, reading.near, reading.depth)?;
        Ok(Self { reading: SceneReading { depth_maps, ..reading.clone() }, ..self.clone() })
    }

    /// Loads one of its scenes.
    ///
    /// # Errors
    /// The errors of [`scene::load`] and of [`scene::depth_maps`].
    pub fn load(&self, index: usize) -> Result<LightField, ProduceError> {
        self.load_with(index, None)
    }

    /// Loads one of its scenes, as [`load`](Self::load) does. The device of the engine draws the views of splats.
    pub(super) fn load_on(&self, index: usize, engine: &dyn Engine) -> Result<LightField, ProduceError> {
        self.load_with(index, drawer_for(&self.scenes[index], engine).as_ref())
    }

    fn load_with(&self, index: usize, drawer: Option<&Arc<dyn SplatDrawer>>) -> Result<LightField, ProduceError> {
        let maps = scene::depth_maps(&self.scenes, &self.reading.depth_maps)?;
        let request = self.request(maps.get(index).map(PathBuf::as_path));
        Ok(scene::load(&self.scenes[index], &Request { drawer, ..request })?)
    }

    /// Returns the identity of one of its scenes, by which a hologram finds it again.
    ///
    /// # Errors
    /// The errors of [`scene::digest`] and of [`scene::depth_maps`].
    pub fn record(&self, index: usize) -> Result<SceneRecord, ProduceError> {
        let maps = scene::depth_maps(&self.scenes, &self.reading.depth_maps)?;
        Ok(SceneRecord::of_source(&self.scenes[index], maps.get(index).map(PathBuf::as_path))?)
    }

    /// Stores the options for reading the scene with a hologram.
    pub(super) fn describe_reading(&self, metadata: &mut Metadata) {
        metadata.order = self.reading.order;
        metadata.photographs = self.reading.photographs.filter(|how| *how != ViewSynthesis::Auto);
        metadata.near = self.reading.near;
        if !self.reading.depth_maps.is_empty() {
            // The values keep the order of the map's values, which the range of depths does not keep.
            metadata.depth_map_mm = self.reading.depth.map(|both| both.map(|meters| meters * 1e3));
        }
    }

    /// Decides which parts of a scene are solved.
    ///
    /// # Errors
    /// [`ProduceError`] for invalid settings, and for colors that the display does not have.
    pub fn plan(&self, field: &LightField) -> Result<ScenePlan, ProduceError> {
        let diameter = self.diameter.unwrap_or_else(|| PupilRange::usual_diameter(self.display.eyebox_min()));
        let settings = Settings { diameter, ..self.settings.clone() };
        let Self { full, contrast, .. } = *self;
        let request = PlanRequest { settings: &settings, depth: self.reading.depth, full, contrast };
        let mut plan = ScenePlan::new(field, self.display, &request)?;
        // Colors that are solved together do not divide the time.
        let turns = if self.settings.joint.is_some() { 1 } else { plan.colors.len() };
        plan.settings.seconds = self.settings.seconds.map(|s| s / turns as f64);
        Ok(plan)
    }
}

/// Warns if pupils can see the distance between views. Tiles have views that are close enough. Built-in scenes have the
/// paper's number of views, so a warning would not help the user.
pub(super) fn warn_of_aliasing(field: &LightField, display: &Display, settings: &Settings) {
    let ([pixels, why], true) = field.aliasing_in_words(display, settings.depth, settings.diameter[1]) else { return };
    let text =
        format!("near and far content differ by {pixels}: {why} (use more `views` of a rendered scene or a depth map)");
    if field.name.starts_with("builtin:") { tracing::debug!("{text}") } else { tracing::warn!("{text}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::optics::OpticsError;
    use crate::produce::solve_scene;
    use crate::solve::Flow;

    #[test]
    fn what_looks_like_a_mistake_is_refused_unless_it_is_forced() {
        let display = Display { height: 24, width: 32, ..Display::preset("small").unwrap() };
        let upright = Display { height: 32, width: 16, ..display.clone() };
        let metres = SceneJob { diameter: Some([2e-6, 4e-6]), ..SceneJob::new("builtin:plane", &display) };
        let wide = SceneJob { diameter: Some([2e-3, 0.1]), ..SceneJob::new("builtin:plane", &display) };
        let portrait = SceneJob::new("builtin:plane", &upright);
        for job in [metres, wide, portrait.clone()] {
            let refused = solve_scene(&job, None, &mut CpuEngine::new(), &mut |_| Flow::Continue).err();
            assert!(matches!(refused, Some(ProduceError::Optics(OpticsError::Unusual { .. }))), "{refused:?}");
        }
        let settings = Settings { steps: 1, frames: 1, ..Settings::default() };
        let forced = SceneJob { force: true, settings, ..portrait };
        assert!(solve_scene(&forced, None, &mut CpuEngine::new(), &mut |_| Flow::Continue).is_ok());
    }
}
