//! Holograms: their files, their phases, and what is seen of them.

use crate::arrays::{array, given, hand_over, put, room, text};
use crate::display::bit;
use crate::failure::{Failure, answer, free, lock};
use crate::scene::scene_of;
use crate::{EyeboxDisplay, EyeboxEngine, EyeboxPupil, EyeboxScene, EyeboxScore, EyeboxStatus};
use eyebox::hologram::{Hologram, Opening, PhaseSource};
use eyebox::reconstruction::SceneSource;
use std::ffi::{CString, c_char};
use std::mem::MaybeUninit;
use std::path::Path;
use std::sync::OnceLock;

/// Phases, and what they were made for and by. It never changes.
pub struct EyeboxHologram {
    pub(crate) hologram: Hologram,
    /// Made when it is first asked for.
    metadata: OnceLock<CString>,
}

impl From<Hologram> for EyeboxHologram {
    fn from(hologram: Hologram) -> Self {
        Self { hologram, metadata: OnceLock::new() }
    }
}

/// The sizes of a hologram, and of what is seen of it.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxSize {
    /// Colours, 1 to 3.
    pub colors: usize,
    /// Which they are, in their order: EYEBOX_RED, EYEBOX_GREEN, EYEBOX_BLUE; 0 where there is none, or it has no name.
    pub color: [u32; 3],
    /// Sub-frames of each colour.
    pub frames: usize,
    /// Rows of the SLM.
    pub rows: usize,
    /// Columns.
    pub columns: usize,
    /// Rows of what an eye sees.
    pub picture_rows: usize,
    /// Columns of it.
    pub picture_columns: usize,
}

/// Opens a hologram: a folder that the command or `eyebox_hologram_save` made.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_hologram_open(
    path: *const c_char,
    hologram: Option<&mut MaybeUninit<*mut EyeboxHologram>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(hologram, || {
            // SAFETY: the header asks callers for texts that end with zero.
            Ok(Opening::default().hologram(Path::new(unsafe { text(path, "path") }?))?.into())
        })
    })
}

/// Saves a hologram by the ending of its name: .zarr is all of it, .npy its phases alone. A hologram that is there is replaced,
/// anything else left alone, and nothing is left half written.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_hologram_save(hologram: Option<&EyeboxHologram>, path: *const c_char) -> EyeboxStatus {
    // SAFETY: the header asks callers for texts that end with zero.
    answer(|| Ok(given(hologram, "hologram")?.hologram.save(Path::new(unsafe { text(path, "path") }?))?))
}

/// The sizes of a hologram.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_hologram_size(
    hologram: Option<&EyeboxHologram>,
    size: Option<&mut MaybeUninit<EyeboxSize>>,
) -> EyeboxStatus {
    answer(|| {
        put(size, || {
            let hologram = &given(hologram, "hologram")?.hologram;
            let mut color = [0; 3];
            for (place, of) in color.iter_mut().zip(&hologram.colors) {
                *place = of.color.map_or(0, bit);
            }
            let Hologram { frames, height: rows, width: columns, .. } = *hologram;
            let (picture_rows, picture_columns) = hologram.picture_size();
            let colors = hologram.colors.len();
            Ok(EyeboxSize { colors, color, frames, rows, columns, picture_rows, picture_columns })
        })
    })
}

/// Loads the scene that a hologram was solved from, read as it was then: wherever it is found, or at `source` where that is not
/// null. A scene that was changed since, and another scene, is refused unless `other_scene` is not 0.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_scene_of_hologram(
    hologram: Option<&EyeboxHologram>,
    source: *const c_char,
    other_scene: i32,
    scene: Option<&mut MaybeUninit<*mut EyeboxScene>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(scene, || {
            let hologram = &given(hologram, "hologram")?.hologram;
            let named = match source.is_null() {
                true => None,
                // SAFETY: the header asks callers for texts that end with zero.
                false => Some(unsafe { text(source, "source") }?.to_owned()),
            };
            EyeboxScene::of(hologram, named, other_scene != 0)
        })
    })
}

/// The display that a name or file says, or, where `name` is null, the one that the hologram was solved for; that is cut to the
/// hologram's size, as it was then. Its encoding is that of today.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_hologram_display(
    hologram: Option<&EyeboxHologram>,
    name: *const c_char,
    display: Option<&mut MaybeUninit<*mut EyeboxDisplay>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(display, || {
            // SAFETY: the header asks callers for texts that end with zero.
            let name = if name.is_null() { None } else { Some(unsafe { text(name, "name") }?) };
            Ok(EyeboxDisplay(given(hologram, "hologram")?.hologram.shown_on(name)?))
        })
    })
}

/// The phases of a colour, by its place: (sub-frame, row, column), radians, in the hologram's own memory. They stand as long as it
/// does. `count` is frames rows columns.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_hologram_phases(
    hologram: Option<&EyeboxHologram>,
    color: usize,
    phases: Option<&mut MaybeUninit<*const f32>>,
    count: Option<&mut MaybeUninit<usize>>,
) -> EyeboxStatus {
    answer(|| {
        let colors = &given(hologram, "hologram")?.hologram.colors;
        let right = || format!("less than {}, the number of its colours", colors.len());
        let of = colors.get(color).ok_or_else(|| Failure::argument("color", color, right()))?;
        put(count, || Ok(of.phases.len()))?;
        put(phases, || Ok(of.phases.as_ptr()))
    })
}

/// How a hologram was made: JSON, as its file has it (docs/hologram-format.md). It stands as long as the hologram.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_hologram_metadata(
    hologram: Option<&EyeboxHologram>,
    json: Option<&mut MaybeUninit<*const c_char>>,
) -> EyeboxStatus {
    answer(|| {
        put(json, || {
            let hologram = given(hologram, "hologram")?;
            let text = hologram.metadata.get_or_init(|| {
                let text = serde_json::to_string(&hologram.hologram.metadata).unwrap_or_default();
                CString::new(text).unwrap_or_default()
            });
            Ok(text.as_ptr())
        })
    })
}

/// The hologram as an eye sees it past an obstruction that has this name, or with a clear pupil if there is none.
///
/// # Safety
/// The text, if there is one, ends with a zero byte.
unsafe fn seen_past<'a>(hologram: &'a Hologram, obstruction: *const c_char) -> Result<PhaseSource<'a>, Failure> {
    let source = PhaseSource::from(hologram);
    if obstruction.is_null() {
        return Ok(source);
    }
    // SAFETY: as this function asks.
    let name = unsafe { text(obstruction, "obstruction") }?;
    Ok(source.obstructed(Some(name.parse()?)))
}

/// What an eye sees through a pupil: (colour, row, column) in linear light, with 1 as the scene's full scale, into `light`, which has
/// `count` values: colors picture_rows picture_columns. `obstruction` puts opaque marks into the pupil: "lashes", "floaters", "opacity",
/// "scratches", or null for a clear pupil.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_view(
    hologram: Option<&EyeboxHologram>,
    pupil: Option<&EyeboxPupil>,
    obstruction: *const c_char,
    engine: Option<&EyeboxEngine>,
    light: *mut f32,
    count: usize,
) -> EyeboxStatus {
    answer(|| {
        let hologram = &given(hologram, "hologram")?.hologram;
        let pupil = given(pupil, "pupil")?.before(hologram)?;
        let (rows, columns) = hologram.picture_size();
        let pixels = rows * columns;
        // SAFETY: the header asks callers for as much memory as they say.
        let light = unsafe { room(light, count, hologram.colors.len() * pixels, "light") }?;
        // SAFETY: the header asks callers for texts that end with zero.
        let source = unsafe { seen_past(hologram, obstruction) }?;
        let mut engine = lock(&given(engine, "engine")?.engine)?;
        let planes = source.about().seen(&pupil, engine.as_mut())?;
        for (out, plane) in light.chunks_exact_mut(pixels).zip(&planes) {
            for (out, value) in out.iter_mut().zip(&plane.values) {
                out.write(*value);
            }
        }
        Ok(())
    })
}

/// Compares what `count` pupils see with what they should see of the scene, with one exposure per colour for all of them, into
/// `scores`, which has room for as many. The scene was loaded for the hologram's display and has its colours; null takes the one
/// that the hologram was solved from, read as it was then. `obstruction` is as in eyebox_view.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_score(
    hologram: Option<&EyeboxHologram>,
    scene: Option<&EyeboxScene>,
    pupils: *const EyeboxPupil,
    count: usize,
    obstruction: *const c_char,
    engine: Option<&EyeboxEngine>,
    scores: *mut EyeboxScore,
) -> EyeboxStatus {
    answer(|| {
        let hologram = given(hologram, "hologram")?;
        if count == 0 {
            return Err(Failure::argument("count", count, "1 or more pupils"));
        }
        // SAFETY: the header asks callers for arrays as long as they say.
        let (pupils, scores) =
            unsafe { (array(pupils, count, None, "pupils")?, room(scores, count, count, "scores")?) };
        let pupils = pupils.iter().map(|p| p.before(&hologram.hologram)).collect::<Result<Vec<_>, _>>()?;
        // SAFETY: the header asks callers for texts that end with zero.
        let source = unsafe { seen_past(&hologram.hologram, obstruction) }?;
        let field = scene_of(scene, &hologram.hologram)?;
        let mut engine = lock(&given(engine, "engine")?.engine)?;
        let scene = SceneSource::from(hologram.hologram.problems(&field)?);
        let scored = source.score(&scene, &pupils, engine.as_mut())?;
        for (out, score) in scores.iter_mut().zip(&scored.pupils) {
            out.write(score.into());
        }
        Ok(())
    })
}

/// Frees a hologram, and with it its phases and its metadata.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_hologram_free(hologram: Option<Box<EyeboxHologram>>) {
    free(hologram);
}
