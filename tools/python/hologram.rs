//! Holograms with their files, phases and reconstructions.

use crate::arrays::{encoded, picture, values};
use crate::call::{Caller, run};
use crate::display::{Display, colors};
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::pupil::{Numbers, pupil};
use crate::scene::Scene;
use eyebox::hologram::{ColorHologram, Opening, PhaseSource, check_radians};
use eyebox::optics::Color;
use eyebox::optics::wrap_phase;
use numpy::{IntoPyArray, PyArray1, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Phases with their display, scene and settings. A hologram never changes.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Hologram(pub(crate) eyebox::hologram::Hologram);

impl Hologram {
    fn name(&self, color: usize) -> String {
        self.0.colors[color].color.map_or_else(|| color.to_string(), |color| color.to_string())
    }
}

/// Returns the phases for a pupil with the obstruction of this name, or for a clear pupil without a name.
pub(crate) fn seen_past<'a>(
    hologram: &'a eyebox::hologram::Hologram,
    obstructed: Option<&str>,
) -> Answer<PhaseSource<'a>> {
    let source = PhaseSource::from(hologram);
    Ok(match obstructed {
        Some(name) => source.obstructed(Some(name.parse()?)),
        None => source,
    })
}

/// Refuses a scene that differs from the scene of the hologram. With `other_scene` it refuses only a scene of another
/// size.
pub(crate) fn check_scene(hologram: &eyebox::hologram::Hologram, scene: &Scene, other_scene: bool) -> Answer<()> {
    match other_scene {
        true => Ok(hologram.check_size(&scene.field)?),
        false => Ok(hologram.check_shows(&scene.record, &scene.field)?),
    }
}

#[pymethods]
impl Hologram {
    /// Opens a hologram that the command or `save` made, or hologram `at` of a sequence.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, at: Option<u64>) -> PyResult<Self> {
        let opening = Opening { at, ..Opening::default() };
        run(py, false, move |_| Ok(Self(opening.hologram(&path)?)))
    }

    /// Makes a hologram from arrays (sub-frame, row, column) of radians, one per color, for a display of their size.
    /// Its exposures are the given one, or the best fit to the scene if there is a scene.
    #[staticmethod]
    fn of_phases(
        py: Python<'_>,
        display: &Display,
        color_names: Vec<String>,
        arrays: Vec<PyReadonlyArrayDyn<'_, f32>>,
        scene: Option<Py<Scene>>,
        exposure: Option<f64>,
        engine: Py<Engine>,
    ) -> PyResult<Self> {
        let display = &display.0;
        let mut made = Vec::with_capacity(arrays.len());
        let mut frames = 0;
        for (color, array) in colors(display, &color_names)?.into_iter().zip(&arrays) {
            let ([own, rows, columns], phases) = values::<3>(array, "phases")?;
            if own == 0 || (rows, columns) != (display.height, display.width) || (frames != 0 && own != frames) {
                let (h, w) = (display.height, display.width);
                let right = format!("(sub-frame, {h}, {w}), as the display {:?}", display.name);
                let found = format!("phases of {color} has the shape ({own}, {rows}, {columns})");
                return Err(Failure::Argument(format!("{found}: it must be {right}, with as many sub-frames")).into());
            }
            if let Some(at) = phases.iter().position(|phase| !phase.is_finite()) {
                let (frame, row, column) = (at / (rows * columns), at / columns % rows, at % columns);
                let found =
                    format!("phases of {color} is {} at sub-frame {frame}, row {row}, column {column}", phases[at]);
                return Err(Failure::Argument(format!("{found}: it must be finite")).into());
            }
            check_radians(phases).map_err(Failure::from)?;
            frames = own;
            made.push(ColorHologram {
                color: Some(color),
                wavelength: display.optics(color).map_err(Failure::from)?.wavelength,
                exposure: exposure.unwrap_or(1.0),
                efficiency: 1.0,
                phases: phases.iter().map(|phase| wrap_phase(*phase)).collect(),
            });
        }
        let mut hologram = eyebox::hologram::Hologram::on(display, frames, made);
        hologram.version = env!("CARGO_PKG_VERSION").into();
        hologram.metadata.exposure_assumed = exposure.is_none();
        run(py, engine.get().on_device, move |_| {
            hologram.check()?;
            if let Some(scene) = scene.as_ref().map(Py::get) {
                hologram.check_shows(&scene.record, &scene.field)?;
                engine.get().lend(|engine| Ok(hologram.fit_exposure(&scene.field, engine)?))?;
                hologram.set_scene(&scene.source, scene.record.clone());
            }
            Ok(Self(hologram))
        })
    }

    /// Saves the hologram in the format of the file extension.
    fn save(slf: Py<Self>, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        run(py, false, move |_| Ok(slf.get().0.save(&path)?))
    }

    /// Returns a copy of the phases of a color (sub-frame, row, column), in radians.
    fn phases<'py>(&self, py: Python<'py>, color: usize) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let hologram = &self.0;
        let of = hologram.colors.get(color);
        let of = of.ok_or_else(|| Failure::Argument(format!("color is {color}: there are fewer")))?;
        PyArray1::from_slice(py, &of.phases).reshape([hologram.frames, hologram.height, hologram.width])
    }

    /// The name of each color, or its number if it has no name.
    #[getter]
    fn colors(&self) -> Vec<String> {
        (0..self.0.colors.len()).map(|color| self.name(color)).collect()
    }

    /// The numbers of sub-frames, rows and columns.
    #[getter]
    fn shape(&self) -> [usize; 3] {
        [self.0.frames, self.0.height, self.0.width]
    }

    /// The exposure of each color, or `None` if the exposures are unknown.
    #[getter]
    fn exposures(&self) -> Option<Vec<f64>> {
        let known = !self.0.metadata.exposure_assumed;
        known.then(|| self.0.colors.iter().map(|color| color.exposure).collect())
    }

    #[getter]
    fn scene(&self) -> &str {
        &self.0.scene
    }

    /// The metadata of the hologram as JSON, with the keys of its file.
    #[getter]
    fn metadata(&self) -> PyResult<String> {
        serde_json::to_string(&self.0.metadata).map_err(|e| Failure::Argument(e.to_string()).into())
    }

    /// The display for which the hologram was made, with its optics but without its encoding.
    #[getter]
    fn display(&self) -> PyResult<Display> {
        Ok(Display(self.0.made_for().map_err(Failure::from)?))
    }

    /// Computes the reconstruction through a pupil (row, column, color), in linear light. 1 is the full scale of the
    /// scene.
    fn view<'py>(
        slf: Py<Self>,
        py: Python<'py>,
        at: Numbers,
        obstructed: Option<String>,
        engine: Py<Engine>,
    ) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let on_device = engine.get().on_device;
        let look = move |_: &Caller| -> Answer<_> {
            let hologram = &slf.get().0;
            let pupil = hologram.check_pupil(pupil(at))?;
            let source = seen_past(hologram, obstructed.as_deref())?;
            engine.get().lend(|engine| Ok(source.about().seen(&pupil, engine)?))
        };
        picture(py, &run(py, on_device, look)?)
    }

    /// Computes the reconstruction as a PNG. A color that the hologram does not have is dark.
    fn picture(slf: Py<Self>, py: Python<'_>, at: Numbers, engine: Py<Engine>) -> PyResult<Vec<u8>> {
        run(py, engine.get().on_device, move |_| {
            let hologram = &slf.get().0;
            let pupil = hologram.check_pupil(pupil(at))?;
            let seen = engine.get().lend(|engine| Ok(hologram.seen(&pupil, engine)?))?;
            let (rows, columns) = (seen[0].rows, seen[0].columns);
            let dark = vec![0.0f32; rows * columns];
            let of = |color: Color| {
                let at = hologram.colors.iter().position(|c| c.color == Some(color));
                at.map_or(&dark[..], |at| &seen[at].values[..])
            };
            let planes = match hologram.named_colors().len() {
                0 => vec![&seen[0].values[..]],
                _ => vec![of(Color::Red), of(Color::Green), of(Color::Blue)],
            };
            encoded(rows, columns, &planes)
        })
    }

    /// Reads the named scene, or the scene of the hologram, with the options of the solve.
    fn scene_as_solved(slf: Py<Self>, py: Python<'_>, named: Option<String>, other_scene: bool) -> PyResult<Scene> {
        run(py, false, move |_| Scene::of(&slf.get().0, named, other_scene))
    }

    /// Returns the display of a name or a file, or the display of the solve, cropped to the size of the hologram.
    fn shown_on(slf: Py<Self>, py: Python<'_>, named: Option<String>) -> PyResult<Display> {
        run(py, false, move |_| Ok(Display(slf.get().0.shown_on(named.as_deref())?)))
    }

    /// Returns the same display for the file of a hologram or a sequence.
    #[staticmethod]
    fn file_shown_on(py: Python<'_>, file: PathBuf, named: Option<String>) -> PyResult<Display> {
        run(py, false, move |_| Ok(Display(Opening::default().sequence(&file)?.about().shown_on(named.as_deref())?)))
    }

    /// Returns the number of holograms in the file of a sequence, or `None` for a single hologram.
    #[staticmethod]
    fn count(py: Python<'_>, file: PathBuf) -> PyResult<Option<u64>> {
        run(py, false, move |_| {
            let is_sequence = eyebox::hologram::Sequence::is_at(&file);
            Ok(if is_sequence { Some(Opening::default().sequence(&file)?.count()) } else { None })
        })
    }

    /// Encodes the hologram as video frames of a display (frame, row, column, channel), in bytes.
    fn encode(slf: Py<Self>, py: Python<'_>, display: Py<Display>) -> PyResult<Bound<'_, PyArray4<u8>>> {
        let encode = move |_: &Caller| -> Answer<_> { Ok(slf.get().0.encode(&display.get().0)?) };
        let frames = run(py, false, encode)?;
        let shape = [frames.count(), frames.height, frames.width, frames.channels];
        frames.bytes().to_vec().into_pyarray(py).reshape(shape)
    }
}
