//! The class `Display`, made from presets, display files and their keys.

use crate::failure::{Answer, Failure};
use eyebox::optics::{Color, Geometry, PRESETS};
use pyo3::prelude::*;
use toml::{Table, Value};

/// A display with its SLM, its optics and the encoding of its phases. It never changes.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Display(pub(crate) eyebox::optics::Display);

/// Returns the names of the built-in displays.
#[pyfunction]
pub(crate) fn presets() -> Vec<&'static str> {
    PRESETS.to_vec()
}

/// Finds colors of a display by their names.
pub(crate) fn colors(display: &eyebox::optics::Display, names: &[String]) -> Answer<Vec<Color>> {
    let one = |name: &String| {
        let known = [Color::Red, Color::Green, Color::Blue].into_iter().find(|color| color.to_string() == *name);
        let color =
            known.ok_or_else(|| Failure::Argument(format!("color is {name:?}: it must be red, green or blue")))?;
        display.optics(color)?;
        Ok(color)
    };
    names.iter().map(one).collect()
}

/// Merges `over` into `base`, table by table. A key of `over` replaces the same key of `base`.
fn lay_over(base: &mut Table, over: Table) {
    for (key, value) in over {
        match (base.get_mut(&key), value) {
            (Some(Value::Table(below)), Value::Table(above)) => lay_over(below, above),
            (_, value) => {
                base.insert(key, value);
            }
        }
    }
}

/// Removes a key, whose tables and own name dots separate. A key that does not exist is no error.
fn remove(table: &mut Table, key: &str) {
    match key.split_once('.') {
        None => drop(table.remove(key)),
        Some((first, rest)) => {
            if let Some(Value::Table(inner)) = table.get_mut(first) {
                remove(inner, rest);
            }
        }
    }
}

#[pymethods]
impl Display {
    /// Reads the display `name`, a preset or a file, and replaces the keys that the TOML text `fields` has. Without a
    /// name, the fields describe the whole display.
    #[new]
    fn new(py: Python<'_>, name: Option<&str>, fields: &str) -> PyResult<Self> {
        let make = || -> Answer<Self> {
            let base = name.map(eyebox::optics::Display::load).transpose()?;
            let mut file = None;
            let over: Table = fields.parse().map_err(|e: toml::de::Error| Failure::Argument(e.message().into()))?;
            let base = match base {
                Some(base) if over.is_empty() => return Ok(Self(base)),
                Some(base) => {
                    file.clone_from(&base.file);
                    base.to_toml()
                }
                None => String::new(),
            };
            let mut table: Table = base.parse().map_err(|e: toml::de::Error| Failure::Argument(e.message().into()))?;
            lay_over(&mut table, over);
            let display = eyebox::optics::Display::from_toml(&table.to_string(), "Display")?;
            Ok(Self(eyebox::optics::Display { file, ..display }))
        };
        Ok(py.detach(make)?)
    }

    /// Makes a display from the text of a display file. `file` is the record of that file as JSON.
    #[staticmethod]
    #[pyo3(signature = (text, file=None))]
    fn of_toml(text: &str, file: Option<&str>) -> PyResult<Self> {
        let display = eyebox::optics::Display::from_toml(text, "Display").map_err(Failure::from)?;
        let file = file.map(serde_json::from_str).transpose().map_err(|e| Failure::Argument(e.to_string()))?;
        Ok(Self(eyebox::optics::Display { file, ..display }))
    }

    /// Returns the same display with the keys of the TOML text `fields` instead of its own, and without the keys
    /// `without`, whose tables dots separate.
    fn replace(&self, py: Python<'_>, fields: &str, without: Vec<String>) -> PyResult<Self> {
        let make = || -> Answer<Self> {
            let refused = |e: toml::de::Error| Failure::Argument(e.message().into());
            let mut table: Table = self.0.to_toml().parse().map_err(refused)?;
            without.iter().for_each(|key| remove(&mut table, key));
            lay_over(&mut table, fields.parse().map_err(refused)?);
            let display = eyebox::optics::Display::from_toml(&table.to_string(), "Display")?;
            Ok(Self(eyebox::optics::Display { file: self.0.file.clone(), ..display }))
        };
        Ok(py.detach(make)?)
    }

    /// The record of the file of the display as JSON, or `None` for a preset.
    #[getter]
    fn file(&self) -> PyResult<Option<String>> {
        let text = self.0.file.as_ref().map(serde_json::to_string).transpose();
        Ok(text.map_err(|e| Failure::Argument(e.to_string()))?)
    }

    /// Returns the text of the display file.
    fn to_toml(&self) -> String {
        self.0.to_toml()
    }

    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// The rows and columns of the SLM.
    #[getter]
    fn resolution(&self) -> (usize, usize) {
        (self.0.height, self.0.width)
    }

    /// The rows and columns of the pictures that it shows.
    #[getter]
    fn picture_size(&self) -> (usize, usize) {
        self.0.picture_size()
    }

    /// The distance of two pixels of its pictures in the image of the SLM, in meters.
    #[getter]
    fn picture_pixel(&self) -> f64 {
        self.0.picture_pixel()
    }

    /// The pixel pitch in meters.
    #[getter]
    fn pitch(&self) -> f64 {
        self.0.pitch
    }

    /// The focal length of the relay in meters.
    #[getter]
    fn focal_length(&self) -> f64 {
        self.0.focal_length
    }

    /// The side of the eyebox that all colors serve, in meters.
    #[getter]
    fn eyebox(&self) -> f64 {
        self.0.eyebox_min()
    }

    #[getter]
    fn geometry(&self) -> &'static str {
        if self.0.geometry == Geometry::Relay { "relay" } else { "far-field" }
    }

    /// The colors and their wavelengths in meters.
    #[getter]
    fn wavelengths(&self) -> Vec<(String, f64)> {
        self.0.wavelengths.iter().map(|w| (w.color.to_string(), w.wavelength)).collect()
    }

    #[getter]
    fn levels(&self) -> u32 {
        self.0.levels
    }
}
