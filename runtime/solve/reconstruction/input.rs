//! A hologram's scene, found again and read as it was when the hologram was solved: the one way in for everything that
//! compares the two or refines one for the other.

use super::SceneSource;
use crate::evaluate::Views;
use crate::hologram::{Hologram, HologramError, SceneRecord};
use crate::optics::{Color, Display};
use crate::scene::{self, LightField, Near, Order, Request, SceneError, ViewSynthesis};
use std::path::{Path, PathBuf};

/// Pixels along each axis of the views of a far field larger than memory, at most.
const PICTURE: usize = 1024;

/// How scenes are read, as far as it is stated; of a hologram, the rest is as it was solved.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SceneReading {
    /// Views per axis of scenes that are rendered or reprojected; none for 9, or as many as a depth map's range needs.
    pub views: Option<usize>,
    /// Distance of neighboring views in the pupil plane, millimeters, instead of what the scene says.
    pub view_pitch_mm: Option<f64>,
    /// The depth maps of pictures, as [`scene::depth_maps`] takes them.
    pub depth_maps: Vec<PathBuf>,
    /// Which values of a depth map are near; none for what its file tells.
    pub near: Option<Near>,
    /// Farthest and nearest depth that matter, meters; of a depth map, those that its values reach.
    pub depth: Option<[f64; 2]>,
    /// How the views of folders really stand.
    pub order: Option<Order>,
    /// Of which views photographs of folders are made.
    pub photographs: Option<ViewSynthesis>,
}

impl SceneReading {
    /// What is loaded of a scene with this depth map; `force` takes distances as they are that look like a mistake.
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

/// Which scene is taken, and how it is read.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct InputOptions {
    /// The scene; none for the one that the hologram was solved from, wherever that is found.
    pub scene: Option<String>,
    /// Take the scene though it is not the one that the hologram was solved from.
    pub other_scene: bool,
    /// How it is read.
    pub reading: SceneReading,
}

/// The scene of a hologram, found and identified but not yet read.
#[derive(Debug, Clone)]
pub struct SolveInput {
    /// The display that the hologram was solved for; it decides how the scene is read.
    pub display: Display,
    source: String,
    depth_map: Option<PathBuf>,
    colors: Vec<Color>,
    reading: SceneReading,
    /// Its distances are those of the solve, which took them.
    is_as_solved: bool,
}

impl SolveInput {
    /// Finds the scene of a hologram. One that is not named is looked for beside the hologram, where it was when the hologram
    /// was solved, and by its name; the first that has the digest of what was read is taken.
    ///
    /// # Errors
    /// [`HologramError::NoDisplay`]; [`HologramError::NoScene`] where the hologram knows none,
    /// [`HologramError::SceneNotFound`], [`HologramError::ChangedScene`] where what is found was changed, and
    /// [`HologramError::OtherScene`] for a scene that was named and is another; [`HologramError::Scene`] for one that cannot be
    /// read.
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
        // What a depth map's values mean has an order; other scenes have a range.
        reading.depth = reading.depth.or_else(|| match depth_map {
            Some(_) => known.depth_map_mm.map(|both| both.map(|mm| mm * 1e-3)),
            None => known.solve.as_ref().map(|settings| settings.depth),
        });
        let is_as_solved = options.reading.depth.is_none() && options.reading.view_pitch_mm.is_none();
        Ok(Self { display, source, depth_map, colors: hologram.named_colors(), reading, is_as_solved })
    }

    /// The source that is read.
    pub fn source(&self) -> &str {
        &self.source
    }

    /// What is read of it.
    pub fn request(&self) -> Request<'_> {
        self.reading.request(&self.display, &self.colors, self.depth_map.as_deref(), self.is_as_solved)
    }

    /// Reads its light field in the hologram's colors, fitted to the hologram's display.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn light_field(&self) -> Result<LightField, SceneError> {
        scene::load(&self.source, &self.request())
    }

    /// Reads it for a far field larger than memory, color by color.
    ///
    /// # Errors
    /// [`SceneError`].
    pub fn around(&self) -> Result<Vec<Views>, SceneError> {
        Views::of_colors(&self.source, &self.request(), PICTURE)
    }

    /// Reads it for what a hologram, `tiled` or whole, is compared with; with the farthest and nearest depth that matter,
    /// meters.
    ///
    /// # Errors
    /// [`SceneError`].
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

/// A scene, and the depth map that goes with it.
struct Found {
    source: String,
    depth_map: Option<PathBuf>,
}

impl Found {
    /// The scene that was named, which must be the hologram's own unless another is asked for.
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

    /// The hologram's own scene, wherever it is.
    fn own(hologram: &Hologram, own: Option<&SceneRecord>, options: &InputOptions) -> Result<Self, HologramError> {
        let Some(own) = own else {
            if hologram.scene.is_empty() {
                return Err(HologramError::NoScene { of_array: false });
            }
            let source = hologram.scene.clone();
            tracing::warn!(
                "{source}: an older eyebox kept only the name of this hologram's scene: whether it has changed is unknown"
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

/// The depth map that is stated for a scene.
fn given_map(source: &str, options: &InputOptions) -> Result<Option<PathBuf>, SceneError> {
    Ok(scene::depth_maps(&[source.to_owned()], &options.reading.depth_maps)?.into_iter().next())
}

/// The depth map that a scene was read with.
fn own_map(own: &SceneRecord, other_scene: bool) -> Result<Option<PathBuf>, HologramError> {
    let Some(file) = &own.depth_map else { return Ok(None) };
    let name = file.absolute.clone().or_else(|| file.relative.clone()).unwrap_or_default();
    let digest = |place: &Path| scene::digest_of_picture(place).map(Some);
    Ok(Some(first_same(&name, file.places().into_iter(), file, other_scene, digest)?.into()))
}

/// The first of the places that holds what was read, by its digest; with `other_scene`, the first that holds anything.
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
