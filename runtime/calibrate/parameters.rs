//! Lists the numbers that are fitted, with their names, steps and ranges (OPTICS 10).

use super::map::CameraMap;
use eyebox_optics::{DisplayModel, Spread};

/// One number of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Parameter {
    /// ln q and ln sigma, towards -y, +y, -x, +x.
    Crosstalk(usize),
    Level(usize),
    Bend(usize),
    Lag,
    Source(usize),
    /// The index of a wave of the zero order, and the index of a number of it.
    Undiffracted(usize, usize),
    Fill,
    /// The ANSI index of a polynomial.
    Wavefront(u32),
    /// Offset x, offset y (mm), and scale.
    Iris(usize),
    /// Homography, then k1 and k2.
    Map(usize),
    /// Share of the camera's pixel that sees light.
    CameraPixel,
}

/// Orders of the wavefront that are fitted at most. 15 small irises show 30 slopes.
pub(super) const ORDERS: std::ops::RangeInclusive<u32> = 2..=7;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct Parameters {
    pub(super) model: DisplayModel,
    pub(super) map: CameraMap,
    pub(super) camera_pixel: f64,
    /// True if the iris passes a share of the bins at its edge, so that pictures change smoothly with its place. A hard
    /// edge jumps from bin to bin. It is correct if the model is, but no slope shows it.
    pub(super) soft_edge: bool,
}

/// ANSI indices of the wavefront's polynomials of an order.
pub(super) fn indices_of_order(n: u32) -> std::ops::RangeInclusive<u32> {
    n * (n + 1) / 2..=n * (n + 3) / 2
}

/// Parameters of the wavefront's polynomials of an order.
pub(super) fn of_order(n: u32) -> impl Iterator<Item = Parameter> {
    indices_of_order(n).map(Parameter::Wavefront)
}

impl Parameter {
    /// All parameters except the wavefront, for a display with this many waves of the zero order.
    pub(super) fn all(waves: usize) -> Vec<Self> {
        let counted = |make: fn(usize) -> Self, count: usize| (0..count).map(make).collect::<Vec<_>>();
        let mut all = counted(Self::Crosstalk, 8);
        all.extend(counted(Self::Level, 9));
        all.extend(counted(Self::Bend, 2));
        all.push(Self::Lag);
        all.extend(counted(Self::Source, 5));
        all.extend((0..waves.max(1)).flat_map(Self::of_wave));
        all.push(Self::Fill);
        all.extend(counted(Self::Iris, 3));
        all.extend(counted(Self::Map, 10));
        all.push(Self::CameraPixel);
        all
    }

    /// The parameters of one wave of the zero order.
    pub(super) fn of_wave(wave: usize) -> impl Iterator<Item = Self> {
        (0..5).map(move |i| Self::Undiffracted(wave, i))
    }

    /// True if the parameter changes the light that leaves the SLM.
    pub(super) fn is_of_device(self) -> bool {
        !matches!(self, Self::Wavefront(_) | Self::Iris(_) | Self::Map(_) | Self::CameraPixel)
    }

    /// True if the parameter changes the phases before crosstalk.
    pub(super) fn is_of_drive(self) -> bool {
        matches!(self, Self::Level(_) | Self::Bend(_) | Self::Lag)
    }

    /// The step of finite differences.
    pub(super) fn step(self) -> f64 {
        match self {
            Self::Crosstalk(_) => 1e-4,
            Self::Map(_) => 1e-6,
            _ => 1e-5,
        }
    }

    /// Lowest value, highest value, and the expected spread about the start, all in the parameter's unit.
    fn range(self) -> (f64, f64, f64) {
        match self {
            Self::Crosstalk(i) if i % 2 == 0 => (0.4f64.ln(), 3.0f64.ln(), 0.4),
            Self::Crosstalk(_) => (0.3f64.ln(), 50f64.ln(), 1.0),
            Self::Level(_) => (0.5, 1.6, 0.15),
            Self::Bend(_) => (-0.9, 0.9, 0.3),
            Self::Lag => (-0.1, 0.8, 0.2),
            Self::Source(_) => (-3.0, 3.0, 0.5),
            Self::Undiffracted(_, 0 | 1) => (-0.5, 0.5, 0.3),
            Self::Undiffracted(..) => (-2000.0, 2000.0, 4.0),
            Self::Fill => (0.02, 1.0, 0.3),
            Self::Wavefront(_) => (-3.0, 3.0, 0.2),
            Self::Iris(2) => (0.8, 1.25, 0.05),
            Self::Iris(_) => (-5.0, 5.0, 0.5),
            Self::Map(_) => (-20.0, 20.0, 1.0),
            Self::CameraPixel => (0.01, 1.5, 0.5),
        }
    }

    /// The expected spread about the start.
    pub(super) fn usual(self) -> f64 {
        self.range().2
    }

    /// The parameter's name, as in OPTICS 10, and its unit.
    pub(super) fn name(self) -> (String, &'static str) {
        const SIDES: [&str; 4] = ["-y", "+y", "-x", "+x"];
        match self {
            Self::Crosstalk(i) if i % 2 == 0 => (format!("crosstalk q {}", SIDES[i / 2]), ""),
            Self::Crosstalk(i) => (format!("crosstalk sigma {}", SIDES[i / 2]), "cycles/pixel"),
            Self::Level(i) => (format!("level {} {}", i / 3, i % 3), "2 pi"),
            Self::Bend(i) => (format!("bend b{}", i + 1), "rad"),
            Self::Lag => ("lag".into(), ""),
            Self::Source(i) => (format!("source {}", ["x", "y", "xx", "xy", "yy"][i]), ""),
            Self::Undiffracted(wave, i) => {
                let which = if wave == 0 { String::new() } else { format!("{} ", wave + 1) };
                let name = format!("undiffracted {which}{}", ["re", "im", "x", "y", "rr"][i]);
                (name, if i < 2 { "" } else { "rad" })
            }
            Self::Fill => ("fill".into(), ""),
            Self::Wavefront(j) => (format!("wavefront {j}"), "waves"),
            Self::Iris(i) => (format!("iris {}", ["x", "y", "scale"][i]), if i < 2 { "mm" } else { "" }),
            Self::Map(i) if i < 8 => (format!("camera homography {i}"), ""),
            Self::Map(i) => (format!("camera k{}", i - 7), ""),
            Self::CameraPixel => ("camera pixel".into(), ""),
        }
    }
}

impl Parameters {
    pub(super) fn get(&self, parameter: Parameter) -> f64 {
        let model = &self.model;
        match parameter {
            Parameter::Crosstalk(i) => {
                let side = model.crosstalk.map_or(Spread { q: 1.2, sigma: 50.0 }, |sides| sides[i / 2]);
                if i % 2 == 0 { side.q.ln() } else { side.sigma.ln() }
            }
            Parameter::Level(i) => model.level[i / 3][i % 3],
            Parameter::Bend(i) => model.bend[i],
            Parameter::Lag => model.lag,
            Parameter::Source(i) => model.source[i],
            Parameter::Undiffracted(wave, i) => model.undiffracted.get(wave).map_or(0.0, |wave| wave[i]),
            Parameter::Fill => model.fill,
            Parameter::Wavefront(j) => model.wavefront.get(&j).copied().unwrap_or(0.0),
            Parameter::Iris(i) => [model.iris.x * 1e3, model.iris.y * 1e3, model.iris.scale][i],
            Parameter::Map(i) => self.map.numbers[i],
            Parameter::CameraPixel => self.camera_pixel,
        }
    }

    fn set(&mut self, parameter: Parameter, value: f64) {
        let model = &mut self.model;
        match parameter {
            Parameter::Crosstalk(i) => {
                let sides = model.crosstalk.get_or_insert([Spread { q: 1.2, sigma: 50.0 }; 4]);
                let side = &mut sides[i / 2];
                *(if i % 2 == 0 { &mut side.q } else { &mut side.sigma }) = value.exp();
            }
            Parameter::Level(i) => model.level[i / 3][i % 3] = value,
            Parameter::Bend(i) => model.bend[i] = value,
            Parameter::Lag => model.lag = value,
            Parameter::Source(i) => model.source[i] = value,
            Parameter::Undiffracted(wave, i) => {
                let waves = &mut model.undiffracted;
                waves.resize(waves.len().max(wave + 1), [0.0; 5]);
                waves[wave][i] = value;
            }
            Parameter::Fill => model.fill = value,
            Parameter::Wavefront(j) => drop(model.wavefront.insert(j, value)),
            Parameter::Iris(0) => model.iris.x = value * 1e-3,
            Parameter::Iris(1) => model.iris.y = value * 1e-3,
            Parameter::Iris(_) => model.iris.scale = value,
            Parameter::Map(i) => self.map.numbers[i] = value,
            Parameter::CameraPixel => self.camera_pixel = value,
        }
    }

    /// A copy with one number moved by a step.
    pub(super) fn moved(&self, parameter: Parameter, step: f64) -> Self {
        let mut moved = self.clone();
        moved.set(parameter, self.get(parameter) + step);
        moved
    }

    /// A copy with all of these numbers moved by their steps, clamped to their ranges.
    pub(super) fn stepped(&self, free: &[Parameter], steps: &[f64]) -> Self {
        let mut moved = self.clone();
        for (parameter, step) in free.iter().zip(steps) {
            let (least, most, _) = parameter.range();
            moved.set(*parameter, (self.get(*parameter) + step).clamp(least, most));
        }
        moved
    }
}
