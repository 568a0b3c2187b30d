//! The functions for holograms, with their files, phases, reconstructions and scores.

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

/// A hologram, with its phases, its optics and the record of its solve. It never changes.
pub struct EyeboxHologram {
    pub(crate) hologram: Hologram,
    /// The metadata as JSON text. It is made at the first request.
    metadata: OnceLock<CString>,
}

impl From<Hologram> for EyeboxHologram {
    fn from(hologram: Hologram) -> Self {
        Self { hologram, metadata: OnceLock::new() }
    }
}

/// The sizes of a hologram and of its reconstructions.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxSize {
    /// Number of colors, 1 to 3.
    pub colors: usize,
    /// The colors in their order, as EYEBOX_RED, EYEBOX_GREEN or EYEBOX_BLUE. An entry is 0 if there is no such color,
    /// or if the color has no name.
    pub color: [u32; 3],
    /// Number of sub-frames per color.
    pub frames: usize,
    /// Rows of the phases (pixels of the SLM).
    pub rows: usize,
    /// Columns of the phases (pixels of the SLM).
    pub columns: usize,
    /// Rows of the image that an eye sees (pixels).
    pub picture_rows: usize,
    /// Columns of the image that an eye sees (pixels).
    pub picture_columns: usize,
}

/// Opens a hologram from a folder that the command or `eyebox_hologram_save` made. Free it with `eyebox_hologram_free`.
/// Fails with EYEBOX_STATUS_HOLOGRAM if the folder cannot be read or its contents are damaged.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_hologram_open(
    path: *const c_char,
    hologram: Option<&mut MaybeUninit<*mut EyeboxHologram>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(hologram, || {
            // SAFETY: The header requires texts that end with a zero byte.
            Ok(Opening::default().hologram(Path::new(unsafe { text(path, "path") }?))?.into())
        })
    })
}

/// Saves a hologram in the format of the file extension. The extension .zarr saves the whole hologram, and .npy saves
/// its phases alone. A hologram at `path` is replaced, and anything else there is refused. The old hologram stays until
/// the new one is complete. After a failure (EYEBOX_STATUS_HOLOGRAM) nothing has changed at `path`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_hologram_save(hologram: Option<&EyeboxHologram>, path: *const c_char) -> EyeboxStatus {
    // SAFETY: The header requires texts that end with a zero byte.
    answer(|| Ok(given(hologram, "hologram")?.hologram.save(Path::new(unsafe { text(path, "path") }?))?))
}

/// Writes the sizes of a hologram into `size`.
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

/// Loads the scene from which a hologram was solved, with the settings of the solve. If `source` is not null, it is the
/// place of the scene. Otherwise eyebox searches for the scene. If `other_scene` is 0, eyebox refuses another scene,
/// and a scene that has changed since the solve. Free the scene with `eyebox_scene_free`.
///
/// Fails with EYEBOX_STATUS_HOLOGRAM if the scene is not found or is refused. Fails with EYEBOX_STATUS_SCENE if it
/// cannot be read.
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
                // SAFETY: The header requires texts that end with a zero byte.
                false => Some(unsafe { text(source, "source") }?.to_owned()),
            };
            EyeboxScene::of(hologram, named, other_scene != 0)
        })
    })
}

/// Makes the display for a hologram. If `name` is not null, it is a preset or the path of a display file. Otherwise
/// eyebox uses the display of the solve. The display of the solve is cut to the hologram's size, as it was then, and
/// has its present encoding. Free the display with `eyebox_display_free`.
///
/// Fails with EYEBOX_STATUS_HOLOGRAM if the display of the solve no longer exists or has other optics now. Fails with
/// EYEBOX_STATUS_DISPLAY if a display cannot be read.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_hologram_display(
    hologram: Option<&EyeboxHologram>,
    name: *const c_char,
    display: Option<&mut MaybeUninit<*mut EyeboxDisplay>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(display, || {
            // SAFETY: The header requires texts that end with a zero byte.
            let name = if name.is_null() { None } else { Some(unsafe { text(name, "name") }?) };
            Ok(EyeboxDisplay(given(hologram, "hologram")?.hologram.shown_on(name)?))
        })
    })
}

/// Writes a pointer to the phases of a color into `phases`, and their number into `count`. The argument `color` is the
/// index of the color, less than `colors` of `EyeboxSize`. The phases are an array (sub-frame, row, column) in radians,
/// with frames * rows * columns values. They are in the memory of the hologram, and stay valid until it is freed. Fails
/// with EYEBOX_STATUS_ARGUMENT if there is no such color.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_hologram_phases(
    hologram: Option<&EyeboxHologram>,
    color: usize,
    phases: Option<&mut MaybeUninit<*const f32>>,
    count: Option<&mut MaybeUninit<usize>>,
) -> EyeboxStatus {
    answer(|| {
        let colors = &given(hologram, "hologram")?.hologram.colors;
        let right = || format!("less than {}, the number of its colors", colors.len());
        let of = colors.get(color).ok_or_else(|| Failure::argument("color", color, right()))?;
        put(count, || Ok(of.phases.len()))?;
        put(phases, || Ok(of.phases.as_ptr()))
    })
}

/// Writes a pointer to the metadata of a hologram into `json`. They describe its solve as JSON text, as in its file
/// (docs/hologram-format.md). The hologram owns the text, and it stays valid until the hologram is freed.
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

/// Returns the phases of a hologram with an obstruction in the pupil, or with a clear pupil if `obstruction` is null.
///
/// # Safety
/// If the pointer is not null, it leads to a text that ends with a zero byte.
unsafe fn seen_past<'a>(hologram: &'a Hologram, obstruction: *const c_char) -> Result<PhaseSource<'a>, Failure> {
    let source = PhaseSource::from(hologram);
    if obstruction.is_null() {
        return Ok(source);
    }
    // SAFETY: This function requires a text that ends with a zero byte.
    let name = unsafe { text(obstruction, "obstruction") }?;
    Ok(source.obstructed(Some(name.parse()?)))
}

/// Computes the image that an eye sees of a hologram through a pupil, and writes it into `light`. The image is an array
/// (color, row, column) in linear light, with 1 as the full scale of the scene. Set `count` to the number of values in
/// `light`, which must be colors * picture_rows * picture_columns of `EyeboxSize`. The `obstruction` puts opaque marks
/// into the pupil, and is "lashes", "floaters", "opacity" or "scratches", or null for a clear pupil.
///
/// Fails with EYEBOX_STATUS_DISPLAY if the light does not reach the pupil, if no eye has such a pupil, or if the
/// obstruction is unknown. Fails with EYEBOX_STATUS_ARGUMENT if `count` differs, and with EYEBOX_STATUS_ENGINE if the
/// engine fails.
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
        // SAFETY: The header requires memory of the stated size.
        let light = unsafe { room(light, count, hologram.colors.len() * pixels, "light") }?;
        // SAFETY: The header requires texts that end with a zero byte.
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

/// Compares the images of a hologram through `count` pupils with the target images of a scene, and writes one score per
/// pupil into `scores`. Both arrays have `count` elements, at least 1. One exposure per color holds for all pupils. The
/// scene must be loaded for the hologram's display and have its colors. If `scene` is null, eyebox loads the scene from
/// which the hologram was solved, with the settings of the solve. The `obstruction` is the same as for `eyebox_view`.
///
/// Fails with the statuses of `eyebox_view`. Fails also with EYEBOX_STATUS_HOLOGRAM if the scene is not found, is not
/// the scene of the hologram, or has another size.
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
        // SAFETY: The header requires arrays of the stated length.
        let (pupils, scores) =
            unsafe { (array(pupils, count, None, "pupils")?, room(scores, count, count, "scores")?) };
        let pupils = pupils.iter().map(|p| p.before(&hologram.hologram)).collect::<Result<Vec<_>, _>>()?;
        // SAFETY: The header requires texts that end with a zero byte.
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

/// Frees a hologram with its phases and its metadata. Null is allowed and has no effect.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_hologram_free(hologram: Option<Box<EyeboxHologram>>) {
    free(hologram);
}
