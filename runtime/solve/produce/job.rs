//! What is to be made, and what is told while it is.

use super::ProduceError;
use crate::hologram::{Metadata, SceneRecord, Start};
use crate::optics::{Color, Display, check_usual_diameters};
use crate::reconstruction::SceneReading;
use crate::scene::{self, LightField, Request, ViewSynthesis};
use crate::solve::{Full, PlanRequest, Progress, PupilRange, ScenePlan, Settings, Solution};
use crate::tiled::{self, RegionSize};
use eyebox_base::error::Reason;
use std::path::{Path, PathBuf};

/// Scenes that are to become a hologram, or a sequence of holograms.
#[derive(Debug, Clone)]
pub struct SceneJob<'a> {
    /// Folders of views, pictures, or `builtin:NAME`: one for a hologram, several for the frames of a sequence.
    pub scenes: Vec<String>,
    /// The display that is solved for.
    pub display: &'a Display,
    /// Which of its colours.
    pub colors: Vec<Color>,
    /// How the scenes are read.
    pub reading: SceneReading,
    /// Pupil diameters drawn, metres; none for what fits the eyebox.
    pub diameter: Option<[f64; 2]>,
    /// Take a display and diameters as they are that look like a mistake: a unit taken for another, rows and columns exchanged,
    /// pupils that no eye has or that do not fit the eyebox.
    pub force: bool,
    /// Everything else that decides the solve. The reading's depth and `diameter` above take the place of its own; its `seconds` are
    /// shared by the colours.
    pub settings: Settings,
    /// Parts of the model that are kept whatever the scene requires.
    pub full: Full,
    /// Speckle contrast that decides the sub-frames; none for the settings'.
    pub contrast: Option<f64>,
    /// Of several scenes.
    pub sequence: SequenceRequest,
    /// Of a far field that is solved region by region into tiles on the disk; none for all at once.
    pub tiles: Option<TilesRequest>,
    /// What identifies a light field that is given instead of the scene; none for what the scene's name says.
    pub record: Option<SceneRecord>,
}

/// What a sequence has beside its holograms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SequenceRequest {
    /// Holograms a second, a fraction.
    pub rate: [u32; 2],
    /// Where each but the first begins.
    pub start: Start,
}

/// How a far field is solved in tiles. The settings' `steps` are those of one visit to a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TilesRequest {
    /// Bytes that it keeps to.
    pub memory: tiled::MemoryLimit,
    /// Passes over the SLM.
    pub passes: usize,
    /// Pixels along each axis of the scene's views.
    pub picture: usize,
}

impl TilesRequest {
    /// Steps of one visit, where nothing else is asked for.
    pub const STEPS: usize = 8;
}

impl Default for TilesRequest {
    fn default() -> Self {
        Self { memory: tiled::MemoryLimit(4 << 30), passes: 3, picture: 1024 }
    }
}

/// What a solve in tiles will do.
#[derive(Debug, Clone)]
pub struct TilesPlan {
    /// The regions, and what a visit takes.
    pub region: RegionSize,
    /// How the scene's views come to be, for people.
    pub views: String,
    /// Visits to regions, per colour.
    pub visits: usize,
    /// Visits of all colours that are done.
    pub done: u64,
    /// The settings; `steps` are those of a visit.
    pub settings: Settings,
    /// Bytes that it keeps to, and those that the views take of them.
    pub memory: [u64; 2],
}

impl TilesPlan {
    /// Bytes that a visit and the views take.
    pub fn bytes(&self) -> u64 {
        self.region.bytes + self.memory[1]
    }

    /// Visits of this colour that were done before.
    pub fn done_of(&self, colors: &[Color], color: Color) -> u64 {
        let index = colors.iter().position(|c| *c == color).unwrap_or(0);
        self.done.saturating_sub((index * self.visits) as u64).min(self.visits as u64)
    }
}

/// What happens on the way.
#[non_exhaustive]
pub enum SceneEvent<'a> {
    /// It is decided what of the scene is computed, as the settings say.
    Planned {
        /// The scene as it is solved.
        field: &'a LightField,
        /// Rows and columns of its views before anything was left out.
        views: [usize; 2],
        /// The decisions.
        plan: &'a ScenePlan,
        /// The settings of the solve.
        settings: &'a Settings,
    },
    /// A sequence begins, or is resumed after so many of its holograms.
    Sequence {
        /// Holograms that are there.
        done: usize,
        /// How many there are to be.
        count: usize,
    },
    /// A solve in tiles begins, or is resumed.
    Tiles(&'a TilesPlan),
    /// A step was taken.
    Step {
        /// Number of the hologram in its sequence.
        hologram: usize,
        /// The colour.
        color: Color,
        /// How far it is.
        progress: &'a Progress<'a>,
    },
    /// A region was visited.
    Visit {
        /// The colour.
        color: Color,
        /// How far it is.
        visit: &'a tiled::Visit,
    },
    /// A colour is solved.
    Solved {
        /// Number of the hologram in its sequence.
        hologram: usize,
        /// The colour.
        color: Color,
        /// What came of it.
        solution: &'a Solution,
    },
    /// A hologram of a sequence is on the disk.
    Appended {
        /// Its number.
        hologram: usize,
        /// Its scene.
        scene: &'a str,
        /// Its colours.
        solutions: &'a [(Color, Solution)],
    },
}

impl<'a> SceneJob<'a> {
    /// One scene in all colours of a display, with the default settings.
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

    /// Refuses what is most likely a mistake, unless it is to be taken as it is.
    ///
    /// # Errors
    /// [`OpticsError::Unusual`](crate::optics::OpticsError::Unusual).
    pub fn check_usual(&self) -> Result<(), ProduceError> {
        if self.force {
            return Ok(());
        }
        self.display.check_usual()?;
        Ok(self.diameter.map_or(Ok(()), |diameter| check_usual_diameters(diameter, self.display.eyebox_min()))?)
    }

    /// Refuses all colours at once, which sequences and tiles have not.
    pub(super) fn check_one_by_one(&self) -> Result<(), ProduceError> {
        if self.settings.joint.is_none() {
            return Ok(());
        }
        let reason =
            "all colours at once is for one scene that is solved whole: leave out the other scenes and the tiles";
        Err(ProduceError::Job(Reason::new("joint-of-many", reason)))
    }

    /// What is loaded of its scenes; the map is that of one of them.
    pub fn request<'r>(&'r self, depth_map: Option<&'r Path>) -> Request<'r> {
        self.reading.request(self.display, &self.colors, depth_map, self.force)
    }

    /// Loads one of its scenes.
    ///
    /// # Errors
    /// Those of [`scene::load`] and of [`scene::depth_maps`].
    pub fn load(&self, index: usize) -> Result<LightField, ProduceError> {
        let maps = scene::depth_maps(&self.scenes, &self.reading.depth_maps)?;
        Ok(scene::load(&self.scenes[index], &self.request(maps.get(index).map(PathBuf::as_path)))?)
    }

    /// What identifies one of its scenes, by which a hologram finds it again.
    ///
    /// # Errors
    /// Those of [`scene::digest`] and of [`scene::depth_maps`].
    pub fn record(&self, index: usize) -> Result<SceneRecord, ProduceError> {
        let maps = scene::depth_maps(&self.scenes, &self.reading.depth_maps)?;
        Ok(SceneRecord::of_source(&self.scenes[index], maps.get(index).map(PathBuf::as_path))?)
    }

    /// Keeps with a hologram what was stated of how its scene is read.
    pub(super) fn describe_reading(&self, metadata: &mut Metadata) {
        metadata.order = self.reading.order;
        metadata.photographs = self.reading.photographs.filter(|how| *how != ViewSynthesis::Auto);
        metadata.near = self.reading.near;
        if !self.reading.depth_maps.is_empty() {
            // In the order of the map's values, which the range of depths does not keep.
            metadata.depth_map_mm = self.reading.depth.map(|both| both.map(|meters| meters * 1e3));
        }
    }

    /// Decides what of a scene is solved.
    ///
    /// # Errors
    /// Settings that cannot be; colours that the display does not have.
    pub fn plan(&self, field: &LightField) -> Result<ScenePlan, ProduceError> {
        let diameter = self.diameter.unwrap_or_else(|| PupilRange::usual_diameter(self.display.eyebox_min()));
        let settings = Settings { diameter, ..self.settings.clone() };
        let Self { full, contrast, .. } = *self;
        let request = PlanRequest { settings: &settings, depth: self.reading.depth, full, contrast };
        let mut plan = ScenePlan::new(field, self.display, &request)?;
        // Colours that are solved together need no share of it each.
        let turns = if self.settings.joint.is_some() { 1 } else { plan.colors.len() };
        plan.settings.seconds = self.settings.seconds.map(|s| s / turns as f64);
        Ok(plan)
    }
}

/// Warns if views are so far apart that pupils see it. Tiles have views that are close enough. Built-in scenes
/// have the paper's number of views, so that a warning would not help the user.
pub(super) fn warn_of_aliasing(field: &LightField, display: &Display, settings: &Settings) {
    let ([pixels, why], true) = field.aliasing_in_words(display, settings.depth, settings.diameter[1]) else { return };
    let text = format!(
        "near and far content part by {pixels}: {why} (`views`, where they are rendered or made from a depth map)"
    );
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
