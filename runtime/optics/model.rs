//! Models what a real SLM and relay do to the light, with one model per color (OPTICS 10).

use super::Color;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// The most waves of undiffracted light that a display may have.
pub const WAVES: usize = 4;

/// The decay of crosstalk between pixels towards one side, whose transfer is exp(-(|k| / sigma)^q).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(from = "[f64; 2]", into = "[f64; 2]")]
pub struct Spread {
    /// The exponent of the transfer.
    pub q: f64,
    /// The scale in cycles per pixel.
    pub sigma: f64,
}

impl From<[f64; 2]> for Spread {
    fn from([q, sigma]: [f64; 2]) -> Self {
        Self { q, sigma }
    }
}

impl From<Spread> for [f64; 2] {
    fn from(spread: Spread) -> Self {
        [spread.q, spread.sigma]
    }
}

/// The error of the iris. It is at `scale` times the requested place plus (x, y), and is `scale` times as wide.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Iris {
    /// Offset to the right in meters.
    pub x: f64,
    /// Offset down in meters.
    pub y: f64,
    /// A scale factor. An error of the focal length has the same effect.
    pub scale: f64,
}

/// The effect of a real SLM and its relay on the light of one color, with the names of OPTICS 10. The default is the
/// ideal display, and a term at its default costs nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplayModel {
    /// Phase at full drive in units of 2 pi, at 3 x 3 nodes (rows from the top, columns from the left). It is bilinear
    /// between nodes.
    pub level: [[f64; 3]; 3],
    /// Bend of the look-up table in radians, b1 sin w + b2 (1 - cos w).
    pub bend: [f64; 2],
    /// Share h of the previous sub-frame that is still visible.
    pub lag: f64,
    /// Crosstalk towards -y, +y, -x and +x.
    pub crosstalk: Option<[Spread; 4]>,
    /// Sub-pixels along an axis for crosstalk, 1 to 3. More sub-pixels are more exact and cost more transforms.
    pub subpixels: usize,
    /// Linear fill of the pixel, the root of its fill factor. 0 is a point.
    pub fill: f64,
    /// Logarithm (ln) of the source's amplitude along x, y, x^2, x y, y^2. x and y run from -1 to 1 over the SLM.
    pub source: [f64; 5],
    /// Undiffracted light, with one wave per reflection. Each has the real and imaginary part of its amplitude, and its
    /// phase in radians along x, y, x^2 + y^2.
    pub undiffracted: Vec<[f64; 5]>,
    /// Wavefront of the relay, as ANSI index of a Zernike polynomial and waves of this color, RMS. The disc has half
    /// the eyebox of the display's shortest wavelength as radius.
    pub wavefront: BTreeMap<u32, f64>,
    /// Offset and scale of the iris.
    pub iris: Iris,
}

impl Default for DisplayModel {
    fn default() -> Self {
        Self {
            level: [[1.0; 3]; 3],
            bend: [0.0; 2],
            lag: 0.0,
            crosstalk: None,
            subpixels: 1,
            fill: 0.0,
            source: [0.0; 5],
            undiffracted: Vec::new(),
            wavefront: BTreeMap::new(),
            iris: Iris { x: 0.0, y: 0.0, scale: 1.0 },
        }
    }
}

impl DisplayModel {
    /// The names of all terms.
    pub const TERMS: [&str; 9] =
        ["level", "bend", "lag", "crosstalk", "fill", "source", "undiffracted", "wavefront", "iris"];

    /// True if every term is off.
    pub fn is_ideal(&self) -> bool {
        *self == Self::default()
    }

    /// The names of the terms that are on.
    pub fn terms(&self) -> Vec<&'static str> {
        let ideal = Self::default();
        let on = [
            ("level", self.level != ideal.level),
            ("bend", self.bend != ideal.bend),
            ("lag", self.lag != ideal.lag),
            ("crosstalk", self.crosstalk.is_some()),
            ("fill", self.fill != ideal.fill),
            ("source", self.source != ideal.source),
            ("undiffracted", self.undiffracted != ideal.undiffracted),
            ("wavefront", !self.wavefront.is_empty()),
            ("iris", self.iris != ideal.iris),
        ];
        on.into_iter().filter(|(_, on)| *on).map(|(name, _)| name).collect()
    }

    /// The ideal display except for one term of this one, by its name ([`terms`](Self::terms)).
    pub fn only(&self, term: &str) -> Self {
        let (mut one, all) = (Self::default(), self.clone());
        match term {
            "level" => one.level = all.level,
            "bend" => one.bend = all.bend,
            "lag" => one.lag = all.lag,
            "crosstalk" => (one.crosstalk, one.subpixels) = (all.crosstalk, all.subpixels),
            "fill" => one.fill = all.fill,
            "source" => one.source = all.source,
            "undiffracted" => one.undiffracted = all.undiffracted,
            "wavefront" => one.wavefront = all.wavefront,
            "iris" => one.iris = all.iris,
            _ => {}
        }
        one
    }

    /// Checks the range of every number.
    pub(super) fn check(&self) -> Result<(), Reason> {
        let within = |name: &str, values: &[f64], low: f64, high: f64| {
            let wrong = values.iter().find(|v| !(low..=high).contains(*v));
            wrong.map_or(Ok(()), |v| Err(reason!("model-range", "{name} has {v}: it must be {low} to {high}")))
        };
        within("level", self.level.as_flattened(), 0.2, 3.0)?;
        within("bend", &self.bend, -1.0, 1.0)?;
        within("lag", &[self.lag], 0.0, 0.9)?;
        for spread in self.crosstalk.iter().flatten() {
            within("crosstalk's q", &[spread.q], 0.3, 4.0)?;
            within("crosstalk's sigma", &[spread.sigma], 0.1, 100.0)?;
        }
        within("subpixels", &[self.subpixels as f64], 1.0, 3.0)?;
        within("fill", &[self.fill], 0.0, 1.0)?;
        within("source", &self.source, -5.0, 5.0)?;
        if self.undiffracted.len() > WAVES {
            return Err(reason!(
                "undiffracted-waves",
                "undiffracted has {} waves: give at most {WAVES}",
                self.undiffracted.len()
            ));
        }
        for wave in &self.undiffracted {
            within("undiffracted's amplitude", &wave[..2], -0.7, 0.7)?;
            within("undiffracted's phase", &wave[2..], -100.0, 100.0)?;
        }
        within("undiffracted's share of the light", &[self.undiffracted_light()], 0.0, 0.98)?;
        for (j, waves) in &self.wavefront {
            if *j > 65 {
                return Err(reason!(
                    "polynomial",
                    "wavefront names polynomial {j}: the ANSI index must be 0 to 65 (the tenth order)"
                ));
            }
            within("wavefront", &[*waves], -20.0, 20.0)?;
        }
        within("iris's offset in mm", &[self.iris.x * 1e3, self.iris.y * 1e3], -20.0, 20.0)?;
        within("iris's scale", &[self.iris.scale], 0.5, 2.0)
    }
}

/// Level of 2 pi in a file, as one number for the whole SLM or as 3 x 3 nodes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Level {
    /// The same level everywhere on the SLM.
    Even(f64),
    /// Levels at the corners, the middles of the sides and the center.
    Nodes([[f64; 3]; 3]),
}

impl Level {
    /// The level at 3 x 3 nodes.
    pub fn nodes(self) -> [[f64; 3]; 3] {
        match self {
            Self::Even(level) => [[level; 3]; 3],
            Self::Nodes(nodes) => nodes,
        }
    }
}

/// A section of `[model]` in a display file, with the known terms of one color or of all colors.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelTerms {
    /// [`DisplayModel::level`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub level: Option<Level>,
    /// [`DisplayModel::bend`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bend: Option<[f64; 2]>,
    /// [`DisplayModel::lag`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lag: Option<f64>,
    /// [`DisplayModel::crosstalk`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub crosstalk: Option<[Spread; 4]>,
    /// [`DisplayModel::subpixels`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub subpixels: Option<usize>,
    /// [`DisplayModel::fill`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fill: Option<f64>,
    /// [`DisplayModel::source`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub source: Option<[f64; 5]>,
    /// [`DisplayModel::undiffracted`].
    #[serde(skip_serializing_if = "Option::is_none", with = "waves")]
    pub undiffracted: Option<Vec<[f64; 5]>>,
    /// [`DisplayModel::wavefront`], not allowed for all colors, because it is in waves of one color.
    #[serde(skip_serializing_if = "BTreeMap::is_empty", with = "indices")]
    pub wavefront: BTreeMap<u32, f64>,
    /// Alternative to `wavefront` in a file. It names a `.npy` relative to the file, with the relay's path in
    /// micrometers over the square of the eyebox of the shortest wavelength. Polynomials are fitted to it when the file
    /// is read.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wavefront_map: Option<String>,
    /// [`DisplayModel::iris`], as the offsets x and y in millimeters, and the scale.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub iris: Option<[f64; 3]>,
    /// The source of the terms, such as a data sheet or a fit of pictures.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub from: String,
    /// The date of the terms, as year-month-day.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub date: String,
    /// The date of the last drift fit, or of the last pictures that agreed with the model, as year-month-day.
    #[serde(skip_serializing_if = "String::is_empty")]
    pub updated: String,
    /// Temperature of the bench at the fit in degrees Celsius, if it was stated.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<f64>,
    /// Share of the pictures' variance that the fit left unexplained, if it is more than the camera's noise.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unexplained: Option<f64>,
    /// Standard errors of fitted terms.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub errors: Option<Box<ModelTerms>>,
}

/// A file holds a single wave without a list around it.
mod waves {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[derive(Serialize, Deserialize)]
    #[serde(
        untagged,
        expecting = "undiffracted is not five numbers (re, im, x, y, x^2 + y^2), nor a list of such fives"
    )]
    enum Waves {
        One([f64; 5]),
        Several(Vec<[f64; 5]>),
    }

    pub fn serialize<S: Serializer>(waves: &Option<Vec<[f64; 5]>>, to: S) -> Result<S::Ok, S::Error> {
        let waves = waves.as_ref().map(|waves| match waves[..] {
            [one] => Waves::One(one),
            _ => Waves::Several(waves.clone()),
        });
        waves.serialize(to)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Vec<[f64; 5]>>, D::Error> {
        Ok(Option::<Waves>::deserialize(from)?.map(|waves| match waves {
            Waves::One(one) => vec![one],
            Waves::Several(waves) => waves,
        }))
    }
}

/// TOML allows only text as keys.
pub(super) mod indices {
    use serde::{Deserialize, Deserializer, Serializer, de::Error};
    use std::collections::BTreeMap;

    pub fn serialize<S: Serializer>(terms: &BTreeMap<u32, f64>, to: S) -> Result<S::Ok, S::Error> {
        to.collect_map(terms.iter().map(|(j, waves)| (j.to_string(), waves)))
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<BTreeMap<u32, f64>, D::Error> {
        let named = BTreeMap::<String, f64>::deserialize(from)?;
        let index = |(name, waves): (String, f64)| match name.parse() {
            Ok(j) => Ok((j, waves)),
            Err(_) => Err(D::Error::custom(format!("'{name}' is no ANSI index of a Zernike polynomial"))),
        };
        named.into_iter().map(index).collect()
    }
}

/// The owner of a section of `[model]`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ModelOf {
    /// Every color without such a term of its own.
    All,
    /// The red color alone.
    Red,
    /// The green color alone.
    Green,
    /// The blue color alone.
    Blue,
}

impl ModelOf {
    /// The name of the section.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::All => "all",
            Self::Red => "red",
            Self::Green => "green",
            Self::Blue => "blue",
        }
    }
}

impl From<Color> for ModelOf {
    fn from(color: Color) -> Self {
        match color {
            Color::Red => Self::Red,
            Color::Green => Self::Green,
            Color::Blue => Self::Blue,
        }
    }
}

impl ModelTerms {
    /// Writes the terms that are set here into a model.
    fn apply(&self, model: &mut DisplayModel) {
        fn put<T: Copy>(known: Option<T>, term: &mut T) {
            *term = known.unwrap_or(*term);
        }
        put(self.level.map(Level::nodes), &mut model.level);
        put(self.bend, &mut model.bend);
        put(self.lag, &mut model.lag);
        put(self.crosstalk.map(Some), &mut model.crosstalk);
        put(self.subpixels, &mut model.subpixels);
        put(self.fill, &mut model.fill);
        put(self.source, &mut model.source);
        if let Some(waves) = &self.undiffracted {
            model.undiffracted = waves.iter().copied().filter(|wave| wave[..2] != [0.0; 2]).collect();
        }
        put(self.iris.map(|[x, y, scale]| Iris { x: x * 1e-3, y: y * 1e-3, scale }), &mut model.iris);
        if !self.wavefront.is_empty() {
            model.wavefront.clone_from(&self.wavefront);
        }
    }

    /// Removes the terms whose names `kept` rejects.
    pub fn keep(&mut self, kept: &dyn Fn(&str) -> bool) {
        fn keep<T>(kept: bool, term: &mut Option<T>) {
            *term = term.take().filter(|_| kept);
        }
        keep(kept("level"), &mut self.level);
        keep(kept("bend"), &mut self.bend);
        keep(kept("lag"), &mut self.lag);
        keep(kept("crosstalk"), &mut self.crosstalk);
        keep(kept("crosstalk"), &mut self.subpixels);
        keep(kept("fill"), &mut self.fill);
        keep(kept("source"), &mut self.source);
        keep(kept("undiffracted"), &mut self.undiffracted);
        keep(kept("iris"), &mut self.iris);
        self.wavefront.retain(|_, _| kept("wavefront"));
        self.errors.iter_mut().for_each(|errors| errors.keep(kept));
    }

    /// These terms, and the terms of `others` that are not set here.
    fn or(self, others: &Self) -> Self {
        let others = others.clone();
        Self {
            level: self.level.or(others.level),
            bend: self.bend.or(others.bend),
            lag: self.lag.or(others.lag),
            crosstalk: self.crosstalk.or(others.crosstalk),
            subpixels: self.subpixels.or(others.subpixels),
            fill: self.fill.or(others.fill),
            source: self.source.or(others.source),
            undiffracted: self.undiffracted.or(others.undiffracted),
            wavefront: if self.wavefront.is_empty() { others.wavefront } else { self.wavefront },
            wavefront_map: self.wavefront_map.or(others.wavefront_map),
            iris: self.iris.or(others.iris),
            from: if self.from.is_empty() { others.from } else { self.from },
            date: if self.date.is_empty() { others.date } else { self.date },
            updated: if self.updated.is_empty() { others.updated } else { self.updated },
            temperature_c: self.temperature_c.or(others.temperature_c),
            unexplained: self.unexplained.or(others.unexplained),
            errors: self.errors.or(others.errors),
        }
    }
}

/// The same sections with the terms of each color in its own section.
pub(super) fn by_color(sections: &ModelSections, colors: &[Color]) -> ModelSections {
    let all = sections.get(&ModelOf::All).cloned().unwrap_or_default();
    let own = |color: &Color| sections.get(&ModelOf::from(*color)).cloned().unwrap_or_default().or(&all);
    colors.iter().map(|color| (ModelOf::from(*color), own(color))).collect()
}

/// The table `[model]` of a display file.
pub type ModelSections = BTreeMap<ModelOf, ModelTerms>;

/// The model of a color from the sections of a file.
pub(super) fn of_color(sections: &ModelSections, color: Color) -> DisplayModel {
    let mut model = DisplayModel::default();
    for terms in [ModelOf::All, color.into()].iter().filter_map(|of| sections.get(of)) {
        terms.apply(&mut model);
    }
    model
}

/// Checks the sections of a file that has these colors.
pub(super) fn check(sections: &ModelSections, colors: &[Color]) -> Result<(), Reason> {
    for (of, terms) in sections {
        let wrong = |reason: Reason| reason.within(format!("[model.{}]", of.name()));
        if *of == ModelOf::All && !terms.wavefront.is_empty() {
            return Err(wrong(reason!(
                "wavefront-of-all-colors",
                "wavefront is in waves of one color: put it in the section of that color"
            )));
        }
        if *of != ModelOf::All && !colors.iter().any(|c| ModelOf::from(*c) == *of) {
            return Err(wrong(reason!("no-such-color", "wavelengths_nm has no such color")));
        }
        if terms.errors.as_ref().is_some_and(|errors| errors.errors.is_some()) {
            return Err(wrong(reason!("errors-of-errors", "errors have no errors of their own")));
        }
        if let Some(celsius) = terms.temperature_c.filter(|c| !(-100.0..=200.0).contains(c)) {
            return Err(wrong(reason!(
                "temperature",
                "temperature_c has {celsius}: it must be -100 to 200 degrees Celsius"
            )));
        }
        if let Some(share) = terms.unexplained.filter(|share| !(0.0..=1.0).contains(share)) {
            return Err(wrong(reason!("unexplained", "unexplained has {share}: it must be 0 to 1")));
        }
        let mut model = DisplayModel::default();
        terms.apply(&mut model);
        model.check().map_err(wrong)?;
    }
    Ok(())
}
