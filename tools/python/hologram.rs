//! Holograms: their files, their phases, and what is seen of them.

use crate::arrays::{picture, values};
use crate::display::{Display, colors};
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::pupil::{Numbers, pupil};
use crate::scene::Scene;
use eyebox::hologram::{ColorHologram, Opening, SceneSource, wrap_phase};
use eyebox::optics::Color;
use numpy::ndarray::ArrayView3;
use numpy::{IntoPyArray, PyArray3, PyArray4, PyArrayMethods, PyReadonlyArrayDyn};
use pyo3::prelude::*;
use std::path::PathBuf;

/// PSNR and the most that there can be (dB), SSIM.
type Score = (f64, Option<f64>, Option<f64>);

/// Phases, and what they were made for and by. It never changes.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Hologram(pub(crate) eyebox::hologram::Hologram);

impl Hologram {
    fn name(&self, color: usize) -> String {
        self.0.colors[color].color.map_or_else(|| color.to_string(), |color| color.to_string())
    }
}

#[pymethods]
impl Hologram {
    /// A hologram that the command or `save` made.
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf, at: Option<u64>) -> PyResult<Self> {
        let opening = Opening { at, ..Opening::default() };
        Ok(Self(py.detach(|| opening.hologram(&path)).map_err(Failure::from)?))
    }

    /// Of arrays (sub-frame, row, column) of radians, one for each colour, made by somebody else for a display of their size;
    /// its exposures are what is given, or those that fit the scene best, where one is given.
    #[staticmethod]
    fn of_phases(
        py: Python<'_>,
        display: &Display,
        color_names: Vec<String>,
        arrays: Vec<PyReadonlyArrayDyn<'_, f32>>,
        scene: Option<&Scene>,
        exposure: Option<f64>,
        engine: &Engine,
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
            frames = own;
            made.push(ColorHologram {
                color: Some(color),
                wavelength: display.optics(color).map_err(Failure::from)?.wavelength,
                exposure: exposure.unwrap_or(1.0),
                efficiency: 1.0,
                phases: phases.iter().map(|phase| wrap_phase(*phase)).collect(),
            });
        }
        let fit = || -> Answer<Self> {
            let mut hologram = eyebox::hologram::Hologram::on(display, frames, made);
            hologram.version = env!("CARGO_PKG_VERSION").into();
            hologram.metadata.exposure_assumed = exposure.is_none();
            hologram.check()?;
            if let Some(scene) = scene {
                hologram.check_shows(&scene.source, &scene.field)?;
                engine.lend(|engine| Ok(hologram.fit_exposure(&scene.field, engine)?))?;
                hologram.scene.clone_from(&scene.source);
            }
            Ok(Self(hologram))
        };
        Ok(py.detach(fit)?)
    }

    /// Saves it by the ending of its name.
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        Ok(py.detach(|| self.0.save(&path)).map_err(Failure::from)?)
    }

    /// The phases of a colour, (sub-frame, row, column), radians: this hologram's own memory, which cannot be written to.
    fn phases<'py>(slf: Bound<'py, Self>, color: usize) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let hologram = &slf.get().0;
        let of = hologram.colors.get(color);
        let of = of.ok_or_else(|| Failure::Argument(format!("color is {color}: there are fewer")))?;
        let shape = (hologram.frames, hologram.height, hologram.width);
        let view = ArrayView3::from_shape(shape, &of.phases).map_err(|e| Failure::Argument(e.to_string()))?;
        // SAFETY: the array holds the Python object, which holds the phases; nothing moves or changes them, for the class is
        // frozen and hands out shared references alone. That nobody writes through the array is the next line's.
        #[allow(unsafe_code)]
        let array = unsafe { PyArray3::borrow_from_array(&view, slf.clone().into_any()) };
        // NumPy lets nobody take that back: the array's memory belongs to an object that gives no memory to write to.
        array.call_method1("setflags", (false,))?;
        Ok(array)
    }

    /// The names of its colours, or their numbers.
    #[getter]
    fn colors(&self) -> Vec<String> {
        (0..self.0.colors.len()).map(|color| self.name(color)).collect()
    }

    /// Sub-frames, rows and columns.
    #[getter]
    fn shape(&self) -> [usize; 3] {
        [self.0.frames, self.0.height, self.0.width]
    }

    /// Per colour, as long as it is known.
    #[getter]
    fn exposures(&self) -> Option<Vec<f64>> {
        let known = !self.0.metadata.exposure_assumed;
        known.then(|| self.0.colors.iter().map(|color| color.exposure).collect())
    }

    #[getter]
    fn scene(&self) -> &str {
        &self.0.scene
    }

    /// How it was made: JSON, as its file has it.
    #[getter]
    fn metadata(&self) -> PyResult<String> {
        serde_json::to_string(&self.0.metadata).map_err(|e| Failure::Argument(e.to_string()).into())
    }

    /// The display that it was made for: its optics, without its encoding.
    #[getter]
    fn display(&self) -> PyResult<Display> {
        Ok(Display(self.0.made_for().map_err(Failure::from)?))
    }

    /// What an eye sees: (row, column, colour), linear light, 1 = the scene's full scale.
    fn view<'py>(&self, py: Python<'py>, at: Numbers, engine: &Engine) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let look = || -> Answer<_> {
            let pupil = self.0.check_pupil(pupil(at))?;
            engine.lend(|engine| Ok(self.0.seen(&pupil, engine)?))
        };
        picture(py, &py.detach(look)?)
    }

    /// The same as a PNG, where a colour that it has not is dark.
    fn picture(&self, py: Python<'_>, at: Numbers, engine: &Engine) -> PyResult<Vec<u8>> {
        let draw = || -> Answer<Vec<u8>> {
            let pupil = self.0.check_pupil(pupil(at))?;
            let seen = engine.lend(|engine| Ok(self.0.seen(&pupil, engine)?))?;
            let (rows, columns) = (seen[0].rows, seen[0].columns);
            let dark = vec![0.0f32; rows * columns];
            let of = |color: Color| {
                let at = self.0.colors.iter().position(|c| c.color == Some(color));
                at.map_or(&dark[..], |at| &seen[at].values[..])
            };
            let planes = match self.0.named_colors().len() {
                0 => vec![&seen[0].values[..]],
                _ => vec![of(Color::Red), of(Color::Green), of(Color::Blue)],
            };
            let mut png = Vec::new();
            let drawn = eyebox::files::encode_png(&mut png, rows, columns, &planes);
            drawn.map_err(|e| Failure::Argument(format!("the picture could not be made: {e}")))?;
            Ok(png)
        };
        Ok(py.detach(draw)?)
    }

    /// What pupils see, compared with what they should see of the scene, with one exposure per colour for all of them.
    fn score(&self, py: Python<'_>, scene: &Scene, at: Vec<Numbers>, engine: &Engine) -> PyResult<Vec<Score>> {
        let compare = || -> Answer<Vec<Score>> {
            let pupils = at.into_iter().map(|at| self.0.check_pupil(pupil(at))).collect::<Result<Vec<_>, _>>()?;
            self.0.check_shows(&scene.source, &scene.field)?;
            let source = SceneSource::from(self.0.problems(&scene.field)?);
            let scores = engine.lend(|engine| Ok(self.0.score(&source, &pupils, engine)?))?;
            Ok(scores.pupils.iter().map(|score| (score.psnr, score.ceiling, score.ssim)).collect())
        };
        Ok(py.detach(compare)?)
    }

    /// Its video frames on a display: (frame, row, column, channel), bytes.
    fn encode<'py>(&self, py: Python<'py>, display: &Display) -> PyResult<Bound<'py, PyArray4<u8>>> {
        let frames = py.detach(|| self.0.encode(&display.0)).map_err(Failure::from)?;
        let shape = [frames.count(), frames.height, frames.width, frames.channels];
        frames.bytes().to_vec().into_pyarray(py).reshape(shape)
    }
}
