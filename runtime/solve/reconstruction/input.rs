//! Finds the scene of a hologram and reads it as it was read for the solve.
//!
//! All code that compares the two, or refines one for the other, uses this module.

use super::SceneSource;
use crate::engine::Engine;
use crate::evaluate::Views;
use crate::hologram::{Hologram, HologramError, SceneRecord};
use crate::optics::{Color, Display};
use crate::scene::{self, LightField, Near, Order, Request, SceneError, SplatDrawer, ViewSynthesis};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Largest number of pixels along each axis of the views of a far field larger than memory.
const PICTURE: usize = 1024;

/// Returns a drawer of the views of a source on the device of an engine. It is `None` if the source has no splats, or
/// the CPU draws them.
pub fn drawer_for(source: &str, engine: &dyn Engine) -> Option<Arc<dyn SplatDrawer>> {
    // A solve on a lost device fails by itself, so the CPU draws meanwhile.
    scene::is_splats(source).then(|| engine.splat_drawer().ok().flatten()).flatten()
}

/// The given settings for reading scenes. The solve of the hologram gives the others.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SceneReading {
    /// Views per axis of scenes that are rendered or reprojected. None is 9, or the number that a depth map's range
    /// needs.
    pub views: Option<usize>,
    /// Distance of neighboring views in the pupil plane in millimeters, instead of the scene's own.
    pub view_pitch_mm: Option<f64>,
    /// The depth maps of pictures, as for [`scene::depth_maps`].
    pub depth_maps: Vec<PathBuf>,
    /// The values of a depth map that are near. It is none for the setting of the map's file.
    pub near: Option<Near>,
    /// Farthest and nearest relevant depth in meters. For a depth map, these are the depths of its extreme values.
    pub depth: Option<[f64; 2]>,
    /// The actual arrangement of the views of folders.
    pub order: Option<Order>,
    /// The views of folders from which other views are synthesized.
    pub photographs: Option<ViewSynthesis>,
}

impl SceneReading {
    /// Returns the request for a scene with this depth map. `force` accepts distances that look like a mistake.
    pub fn request<'a>(
        &self,
        display: &'a Display,
        colors: &'a [Color],
        depth_map: Option<&'a Path>,
        force: bool,
    ) -> Request<'a> {
        let default = Request::new(display, colors);
        Request {
            view_pitch: self.view_pitch_mm.map(|mm| mm * 1e-3),
            views: self.views.unwrap_or(default.views),
            more_views: self.views.is_none(),
            depth_map,
            near: self.near,
            depth: self.depth,
            order: self.order,
            photographs: self.photographs.unwrap_or_default(),
            force,
            ..default
        }
    }
}

/// The choice of a scene and the settings for reading it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct InputOptions {
    /// The scene. If it is none, the scene of the solve is searched.
    pub scene: Option<String>,
    /// True to accept a scene other than the scene of the solve.
    pub other_scene: bool,
    /// The settings for reading it.
    pub reading: SceneReading,
}

/// The scene of a hologram, found and identified but not yet read.
#[derive(Debug, Clone)]
pub struct SolveInput {
    /// The display for which the hologram was solved. It determines how the scene is read.
    pub display: Display,
    source: String,
    depth_map: Option<PathBuf>,
    colors: Vec<Color>,
    reading: SceneReading,
    /// True if the distances are unchanged from the solve, which accepted them.
    is_as_solved: bool,
    drawer: Option<Arc<dyn SplatDrawer>>,
}

impl SolveInput {
    /// Finds the scene of a hologram. If it is not named, it is searched relative to the hologram, at its path during
    /// the solve, and by its name. The first one with the recorded digest is used.
    ///
    /// # Errors
    /// Returns [`HologramError::NoDisplay`] or [`HologramError::NoScene`] if the hologram names none. Returns
    /// [`HologramError::SceneNotFound`] if the scene is at none of the paths, and [`HologramError::ChangedScene`] if
    /// the scene that was found has changed. Returns [`HologramError::OtherScene`] if the named scene is another, and
    /// [`HologramError::Scene`] if the scene cannot be read.
    pub fn open(hologram: &Hologram, options: &InputOptions) -> Result<Self, HologramError> {
        let (display, mut reading) = (hologram.made_for()?, options.reading.clone());
        let own = hologram.scene_record();
        let found = match &options.scene {
            Some(named) => Found::named(hologram, own.as_ref(), named, options)?,
            None => Found::own(hologram, own.as_ref(), options)?,
        };
        let Found { source, depth_map } = found;
        let known = &hologram.metadata;
        reading.view_pitch_mm = reading.view_pitch_mm.or(known.view_pitch_mm);
        reading.order = reading.order.or(known.order);
        reading.photographs = reading.photographs.or(known.photographs);
        reading.views = reading.views.or(known.views.map(|views| views[0]));
        reading.near = reading.near.or(known.near);
        // The depths of a depth map's values have an order. Other scenes have a range.
        reading.depth = reading.depth.or_else(|| match depth_map {
            Some(_) => known.depth_map_mm.map(|both| both.map(|mm| mm * 1e-3)),
            None => known.solve.as_ref().map(|settings| settings.depth),
        });
        let is_as_solved = options.reading.depth.is_none() && options.reading.view_pitch_mm.is_none();
        Ok(Self { display, source, depth_map, colors: hologram.named_colors(), reading, is_as_solved, drawer: None })
    }

    /// Lets the device of the engine draw the views of splats. Otherwise, the CPU draws them.
    #[must_use]
    pub fn drawn_by(self, engine: &dyn Engine) -> Self {
        Self { drawer: drawer_for(&self.source, engine), ..self }
    }

    /// Returns the source of the scene.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// Returns the request for the source.
    pub fn request(&self) -> Request<'_> {
        let request = self.reading.request(&self.display, &self.colors, self.depth_map.as_deref(), self.is_as_solved);
        Request { drawer: self.drawer.as_ref(), ..request }
    }

    /// Reads its light field in the hologram's colors, fitted to the hologram's display.
    ///
    /// # Errors
    /// Returns [`SceneError`] for a scene that cannot be read.
    pub fn light_field(&self) -> Result<LightField, SceneError> {
        scene::load(&self.source, &self.request())
    }

    /// Reads it for a far field larger than memory, color by color.
    ///
    /// # Errors
    /// Returns [`SceneError`] for a scene that cannot be read.
    pub fn around(&self) -> Result<Vec<Views>, SceneError> {
        Views::of_colors(&self.source, &self.request(), PICTURE)
    }

    /// Reads it for a comparison with a hologram, which is `tiled` or in memory. Also returns the farthest and nearest
    /// relevant depth in meters.
    ///
    /// # Errors
    /// Returns [`SceneError`] for a scene that cannot be read.
    pub fn scene(&self, tiled: bool) -> Result<(SceneSource, [f64; 2]), HologramError> {
        let asked = self.reading.depth;
        if tiled {
            let views = self.around()?;
            let depth = views.first().map_or(Ok([0.0; 2]), |views| views.depths(asked))?;
            return Ok((SceneSource::Around(views), depth));
        }
        let field = self.light_field()?;
        let depth = field.depths(&self.display, asked)?;
        Ok((SceneSource::new(field, &self.display)?, depth))
    }
}

/// A scene with its depth map.
struct Found {
    source: String,
    depth_map: Option<PathBuf>,
}

impl Found {
    /// Returns the named scene, which must be the hologram's own unless another is allowed.
    fn named(
        hologram: &Hologram,
        own: Option<&SceneRecord>,
        named: &str,
        options: &InputOptions,
    ) -> Result<Self, HologramError> {
        let Some(own) = own else {
            if !options.other_scene {
                hologram.check_scene(named)?;
            }
            return Ok(Self { source: named.into(), depth_map: given_map(named, options)? });
        };
        let source = own.source_of(named);
        let mut given = SceneRecord::of_source(&source, None)?;
        let is_own_file = given.file.is_some() && given.file == own.file;
        let depth_map = match given_map(&source, options)? {
            None if is_own_file => own_map(own, options.other_scene)?,
            given => given,
        };
        if !options.other_scene {
            given.set_depth_map(depth_map.as_deref())?;
            hologram.check_is_of(&given)?;
        }
        Ok(Self { source, depth_map })
    }

    /// Searches the hologram's own scene.
    fn own(hologram: &Hologram, own: Option<&SceneRecord>, options: &InputOptions) -> Result<Self, HologramError> {
        let Some(own) = own else {
            if hologram.scene.is_empty() {
                return Err(HologramError::NoScene { of_array: false });
            }
            let source = hologram.scene.clone();
            tracing::warn!(
                "{source}: an older eyebox stored only the name of this hologram's scene, so changes cannot be detected"
            );
            let depth_map = given_map(&source, options)?;
            return Ok(Self { source, depth_map });
        };
        if !own.views.is_empty() {
            return Err(HologramError::NoScene { of_array: true });
        }
        let Some(file) = &own.file else { return Ok(Self { source: own.source.clone(), depth_map: None }) };
        let typed = scene::path_and_options(&own.source).map(|(path, _)| path);
        let named = [Some(PathBuf::from(&hologram.scene)), typed].into_iter().flatten();
        let places = file.places().into_iter().chain(named.filter(|place| !place.as_os_str().is_empty()));
        let digest = |place: &Path| scene::digest(place.to_str().unwrap_or_default());
        let source = first_same(&own.source, places, file, options.other_scene, digest)?;
        let depth_map = match given_map(&source, options)? {
            None => own_map(own, options.other_scene)?,
            Some(map) if options.other_scene => Some(map),
            Some(map) => {
                let mut given = own.clone();
                given.set_depth_map(Some(&map))?;
                hologram.check_is_of(&given)?;
                Some(map)
            }
        };
        Ok(Self { source, depth_map })
    }
}

/// Returns the depth map that is given for a scene.
fn given_map(source: &str, options: &InputOptions) -> Result<Option<PathBuf>, SceneError> {
    Ok(scene::depth_maps(&[source.to_owned()], &options.reading.depth_maps)?.into_iter().next())
}

/// Returns the depth map with which a scene was read.
fn own_map(own: &SceneRecord, other_scene: bool) -> Result<Option<PathBuf>, HologramError> {
    let Some(file) = &own.depth_map else { return Ok(None) };
    let name = file.absolute.clone().or_else(|| file.relative.clone()).unwrap_or_default();
    let digest = |place: &Path| scene::digest_of_picture(place).map(Some);
    Ok(Some(first_same(&name, file.places().into_iter(), file, other_scene, digest)?.into()))
}

/// Returns the first path with the recorded content, by its digest. With `other_scene`, returns the first path that
/// exists.
fn first_same(
    name: &str,
    places: impl Iterator<Item = PathBuf>,
    file: &crate::files::FileRecord,
    other_scene: bool,
    digest: impl Fn(&Path) -> Result<Option<String>, SceneError>,
) -> Result<String, HologramError> {
    let (mut changed, mut looked) = (None, Vec::new());
    for place in places {
        looked.push(place.display().to_string());
        if !place.exists() {
            continue;
        }
        let named = file.named(&place);
        let found = digest(&named);
        if other_scene || matches!(&found, Ok(Some(digest)) if *digest == file.digest) {
            return Ok(named.to_string_lossy().into_owned());
        }
        let why = found.err().map(|error| error.to_string());
        changed = changed.or(Some(HologramError::ChangedScene { scene: place.display().to_string(), why }));
    }
    looked.dedup();
    Err(changed.unwrap_or_else(|| HologramError::SceneNotFound { scene: name.into(), looked: looked.join(", ") }))
}
