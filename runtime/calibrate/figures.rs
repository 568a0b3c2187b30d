//! Describes a fitted display by maps, curves and places instead of coefficients.

use super::residual::PictureLeft;
use eyebox_optics::{Color, Display, DisplayModel, ModelTerms, OpticsError, Pupil, zernike_name};
use serde::Serialize;
use std::f64::consts::{PI, TAU};

/// Number of places along the longer side of a map.
const PLACES: usize = 41;
/// Number of places along a curve.
const POINTS: usize = 33;
/// Largest offset of the listed crosstalk kernel, pixels.
const REACH: usize = 6;

/// Values over a rectangle, row by row from the top left. The first and the last places are half a cell inside its
/// edge.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Map {
    /// Height and width of the rectangle, mm.
    pub size_mm: [f64; 2],
    /// Number of rows of the map.
    pub rows: usize,
    /// Number of columns of the map.
    pub columns: usize,
    /// The values, rounded to four digits after the point.
    pub values: Vec<f64>,
}

impl Map {
    /// The map of `value(x, y)` over a rectangle, in which x and y run from -1 to 1.
    fn new([height, width]: [f64; 2], value: impl Fn(f64, f64) -> f64) -> Self {
        // An odd number of places along each side puts one in the middle.
        let side = |length: f64| ((PLACES as f64 * length / height.max(width)) as usize).max(3) | 1;
        let (rows, columns) = (side(height), side(width));
        let place = |i: usize, n: usize| (2 * i + 1) as f64 / n as f64 - 1.0;
        let at = |i: usize| value(place(i % columns, columns), place(i / columns, rows));
        let values = (0..rows * columns).map(|i| rounded(at(i))).collect();
        Self { size_mm: [height, width].map(|v| rounded(v * 1e3)), rows, columns, values }
    }

    /// The lowest and the highest value.
    pub fn range(&self) -> [f64; 2] {
        self.values.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(*v), b.max(*v)])
    }

    /// Places in mm along the middle column (`axis` 0) or the middle row (`axis` 1), each with its value.
    pub fn cut(&self, axis: usize) -> Vec<[f64; 2]> {
        let count = [self.rows, self.columns][axis];
        let at = |i: usize| match axis {
            0 => i * self.columns + self.columns / 2,
            _ => self.rows / 2 * self.columns + i,
        };
        let mm = |i: usize| self.size_mm[axis] * ((i as f64 + 0.5) / count as f64 - 0.5);
        (0..count).map(|i| [mm(i), self.values[at(i)]]).collect()
    }
}

/// A Zernike polynomial of the relay's wavefront.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Aberration {
    /// The ANSI index of the polynomial.
    pub index: u32,
    /// The name that opticians use.
    pub name: String,
    /// Coefficient, waves RMS over the disc as wide as the eyebox.
    pub waves: f64,
    /// Standard error of `waves`, waves.
    pub error: Option<f64>,
}

/// The fitted wavefront of the relay.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Wavefront {
    /// Waves over the square of the eyebox. A longer path is positive.
    pub map: Map,
    /// Waves RMS over the disc as wide as the eyebox.
    pub rms_waves: f64,
    /// The lowest and the highest value over that disc, waves. The corners of the eyebox continue the polynomials
    /// beyond it.
    pub range_waves: [f64; 2],
    /// The polynomials with their coefficients.
    pub terms: Vec<Aberration>,
}

/// The fitted look-up table of the SLM.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Table {
    /// Drives from 0 to 1, with 1 at full drive. The ideal phase is the same number of turns.
    pub drives: Vec<f64>,
    /// Phase in turns at each drive, as the lowest over the SLM, the one in the middle, the highest.
    pub turns: Vec<[f64; 3]>,
    /// Phase in turns at full drive, at 3 x 3 places over the SLM.
    pub level: [[f64; 3]; 3],
    /// The bend of the table, b1 and b2, radians.
    pub bend: [f64; 2],
}

/// A wave of the zero order, which is light that the SLM does not modulate.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ZeroOrder {
    /// Share of the light in this wave.
    pub share: f64,
    /// Standard error of the share.
    pub share_error: Option<f64>,
    /// Center of its spot in the pupil plane, x to the right, y down, mm.
    pub at_mm: [f64; 2],
    /// Standard errors of `at_mm`, mm.
    pub error_mm: Option<[f64; 2]>,
    /// Width and height of its spot, mm. They come from its curvature and from diffraction at the edges of the SLM.
    pub wide_mm: [f64; 2],
}

/// The kernel of crosstalk, with one sample per pixel.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Kernel {
    /// Distance from the driven pixel, pixels.
    pub offsets_px: Vec<i64>,
    /// Share of the drive that reaches the pixel at each of these offsets along y.
    pub along_y: Vec<f64>,
    /// Share of the drive at each of these offsets along x.
    pub along_x: Vec<f64>,
    /// Share of the variance of random drives that is left after crosstalk.
    pub variance_left: f64,
}

/// The fitted place and scale of the iris.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct IrisFound {
    /// Place of the iris when it is sent to the axis, x to the right, y down, mm.
    pub at_mm: [f64; 2],
    /// Standard errors of `at_mm`, mm.
    pub error_mm: Option<[f64; 2]>,
    /// True distances and diameters over the requested ones.
    pub scale: f64,
    /// Standard error of `scale`.
    pub scale_error: Option<f64>,
    /// Each requested diameter and the true one, mm.
    pub diameters_mm: Vec<[f64; 2]>,
}

/// The display of one color as it was fitted. Terms with ideal values are absent.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Figures {
    /// Side of the square eyebox, mm.
    pub eyebox_mm: f64,
    /// The fitted wavefront of the relay.
    pub wavefront: Option<Wavefront>,
    /// Intensity of the beam over the SLM, with a mean of 1.
    pub beam: Option<Map>,
    /// The fitted look-up table of the SLM.
    pub table: Option<Table>,
    /// The waves of the zero order, the brightest first.
    pub zero_orders: Vec<ZeroOrder>,
    /// The kernel of crosstalk.
    pub crosstalk: Option<Kernel>,
    /// The fitted place and scale of the iris.
    pub iris: Option<IrisFound>,
}

impl Figures {
    /// The figures of one color. `pictures` has the irises that were requested.
    ///
    /// # Errors
    /// [`OpticsError`] if the display does not have the color, or if the model is not possible.
    pub fn new(display: &Display, color: Color, pictures: &[PictureLeft]) -> Result<Self, OpticsError> {
        let (optics, model, ideal) = (display.optics(color)?, display.model(color), DisplayModel::default());
        let errors = display.model.get(&color.into()).and_then(|terms| terms.errors.as_deref());
        let eyebox = optics.wavelength * optics.focal_length / optics.pitch;
        let sides = [display.height, display.width];
        let slm = sides.map(|n| n as f64 * optics.pitch);
        let asked = pictures.iter().map(|p| p.iris_mm[2]).filter(|d| *d > 0.0);
        Ok(Self {
            eyebox_mm: rounded(eyebox * 1e3),
            wavefront: (!model.wavefront.is_empty())
                .then(|| Wavefront::new(&model, errors, display.eyebox_min() / 2.0, eyebox)),
            beam: (model.source != ideal.source).then(|| {
                let root = model.source_root(sides);
                Map::new(slm, |x, y| (model.source_at(x, y) / root).powi(2))
            }),
            table: (model.level != ideal.level || model.bend != ideal.bend).then(|| Table::new(&model)),
            zero_orders: ZeroOrder::all(&model, errors, sides, eyebox),
            crosstalk: Kernel::new(&model, sides),
            iris: (model.iris != ideal.iris).then(|| IrisFound::new(&model, errors, asked)),
        })
    }
}

impl Wavefront {
    fn new(model: &DisplayModel, errors: Option<&ModelTerms>, radius: f64, eyebox: f64) -> Self {
        let map = Map::new([eyebox; 2], |x, y| model.wavefront_turns(x * eyebox / 2.0, y * eyebox / 2.0, radius));
        let within = |i: &usize| {
            let place = |i: usize| (2 * i + 1) as f64 / PLACES as f64 - 1.0;
            place(i % PLACES).hypot(place(i / PLACES)) * eyebox <= 2.0 * radius
        };
        let inside = (0..map.values.len()).filter(within).map(|i| map.values[i]);
        let range_waves = inside.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)]);
        let error = |j: &u32| errors.and_then(|e| e.wavefront.get(j)).copied();
        let terms = model.wavefront.iter();
        Self {
            rms_waves: model.wavefront.iter().filter(|(j, _)| **j > 0).map(|(_, c)| c * c).sum::<f64>().sqrt(),
            range_waves,
            map,
            terms: terms
                .map(|(j, waves)| Aberration { index: *j, name: zernike_name(*j), waves: *waves, error: error(j) })
                .collect(),
        }
    }
}

impl Table {
    fn new(model: &DisplayModel) -> Self {
        let drives: Vec<f64> = (0..POINTS).map(|i| i as f64 / (POINTS - 1) as f64).collect();
        let nodes = model.level.as_flattened();
        let least = nodes.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = nodes.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let turns = |drive: &f64| [least, model.level[1][1], highest].map(|l| model.look_up(drive * TAU, l).0 / TAU);
        Self { turns: drives.iter().map(turns).collect(), drives, level: model.level, bend: model.bend }
    }
}

impl ZeroOrder {
    /// The waves of an SLM of `sides` pixels (rows, columns) whose diffraction order is `eyebox` meters wide, the
    /// brightest first.
    fn all(model: &DisplayModel, errors: Option<&ModelTerms>, sides: [usize; 2], eyebox: f64) -> Vec<Self> {
        let errors = errors.and_then(|e| e.undiffracted.as_deref()).unwrap_or_default();
        let waves = model.undiffracted.iter().enumerate();
        let mut all: Vec<Self> = waves.map(|(i, wave)| Self::new(wave, errors.get(i), sides, eyebox)).collect();
        all.sort_by(|a, b| b.share.total_cmp(&a.share));
        all
    }

    fn new([re, im, px, py, pr]: &[f64; 5], errors: Option<&[f64; 5]>, sides: [usize; 2], eyebox: f64) -> Self {
        // A phase of p radians at the edge of the SLM is p / pi bins.
        let bins = [sides[1], sides[0]].map(|n| eyebox * 1e3 / n as f64);
        let tilts = |x: f64, y: f64| [x / PI * bins[0], y / PI * bins[1]];
        Self {
            share: re * re + im * im,
            share_error: errors.map(|e| 2.0 * (re * e[0]).hypot(im * e[1])),
            at_mm: tilts(*px, *py),
            error_mm: errors.map(|e| tilts(e[2], e[3])),
            wide_mm: bins.map(|bin| bin * (1.0 + 4.0 * pr.abs() / PI)),
        }
    }
}

impl Kernel {
    fn new(model: &DisplayModel, [rows, columns]: [usize; 2]) -> Option<Self> {
        let kernels = model.crosstalk_kernels(rows, columns, 1)?;
        let reach = REACH.min((rows.min(columns) - 1) / 2) as i64;
        let along = |kernel: &[f64]| -> Vec<f64> {
            (-reach..=reach).map(|d| rounded(kernel[d.rem_euclid(kernel.len() as i64) as usize])).collect()
        };
        let [along_y, along_x] = kernels.each_ref().map(|kernel| along(kernel));
        let variance_left = model.variance_left(rows, columns);
        Some(Self { offsets_px: (-reach..=reach).collect(), along_y, along_x, variance_left })
    }
}

impl IrisFound {
    fn new(model: &DisplayModel, errors: Option<&ModelTerms>, asked: impl Iterator<Item = f64>) -> Self {
        let errors = errors.and_then(|e| e.iris);
        let mut asked: Vec<f64> = asked.map(rounded).collect();
        asked.sort_by(f64::total_cmp);
        asked.dedup();
        let found = |d: f64| model.true_pupil(&Pupil::from_mm([0.0, 0.0, d, 0.0])).to_mm()[2];
        Self {
            at_mm: [model.iris.x, model.iris.y].map(|v| v * 1e3),
            error_mm: errors.map(|[x, y, _]| [x, y]),
            scale: model.iris.scale,
            scale_error: errors.map(|[_, _, scale]| scale),
            diameters_mm: asked.into_iter().map(|d| [d, rounded(found(d))]).collect(),
        }
    }
}

/// Rounds to four digits after the point, without a negative zero.
fn rounded(value: f64) -> f64 {
    (value * 1e4).round() / 1e4 + 0.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_optics::{Iris, Level, Spread};

    fn display(terms: ModelTerms) -> Display {
        let text =
            "resolution = [64, 128]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
        let mut display = Display::from_toml(text, "test").expect("a display");
        display.model.insert(Color::Green.into(), terms);
        display
    }

    fn figures(terms: ModelTerms) -> Figures {
        Figures::new(&display(terms), Color::Green, &[]).expect("figures")
    }

    #[test]
    fn an_ideal_display_has_no_figures_but_its_eyebox() {
        let figures = figures(ModelTerms::default());
        assert!((figures.eyebox_mm - 26.0).abs() < 1e-9, "{}", figures.eyebox_mm);
        assert!(figures.wavefront.is_none() && figures.beam.is_none() && figures.table.is_none());
        assert!(figures.zero_orders.is_empty() && figures.crosstalk.is_none() && figures.iris.is_none());
    }

    #[test]
    fn the_zero_order_is_where_its_tilt_sends_it() {
        let errors = ModelTerms { undiffracted: Some(vec![[0.01, 0.02, 0.1, 0.2, 0.1]]), ..ModelTerms::default() };
        let terms = ModelTerms {
            undiffracted: Some(vec![[0.3, -0.4, 4.0, -4.0, 0.5]]),
            errors: Some(Box::new(errors)),
            ..ModelTerms::default()
        };
        let zero = &figures(terms).zero_orders[0];
        assert!((zero.share - 0.25).abs() < 1e-12);
        // 4 rad are 0.26 mm at 128 pixels (columns) and double that at 64 (rows).
        assert!((zero.at_mm[0] - 0.2586).abs() < 1e-4 && (zero.at_mm[1] + 0.5173).abs() < 1e-4, "{:?}", zero.at_mm);
        assert!((zero.share_error.expect("an error") - 2.0 * 0.003f64.hypot(0.008)).abs() < 1e-12);
        let [x, y] = zero.error_mm.expect("errors");
        assert!((x - 0.1 / PI * 26.0 / 128.0).abs() < 1e-9 && (y - 0.2 / PI * 26.0 / 64.0).abs() < 1e-9);
        // The width is the phase's slope at both edges plus a bin of diffraction.
        assert!((zero.wide_mm[0] - (26.0 / 128.0) * (1.0 + 2.0 / PI)).abs() < 1e-9, "{:?}", zero.wide_mm);
    }

    #[test]
    fn the_wavefront_is_a_map_over_the_eyebox_with_named_terms() {
        let errors = ModelTerms { wavefront: [(4, 0.01)].into(), ..ModelTerms::default() };
        let terms = ModelTerms {
            wavefront: [(4, 0.3), (8, 0.4)].into(),
            errors: Some(Box::new(errors)),
            ..ModelTerms::default()
        };
        let wavefront = figures(terms).wavefront.expect("a wavefront");
        assert!((wavefront.rms_waves - 0.5).abs() < 1e-12);
        let map = &wavefront.map;
        assert_eq!((map.rows, map.columns, map.values.len()), (41, 41, 41 * 41));
        let middle = map.values[20 * 41 + 20];
        assert!((middle + 0.3 * 3f64.sqrt()).abs() < 1e-4, "{middle}");
        // At the right end of the disc defocus and coma add up. The corners are higher and do not count.
        let highest = 0.3 * 3f64.sqrt() + 0.4 * 8f64.sqrt();
        assert!((wavefront.range_waves[1] - highest).abs() < 0.2, "{:?}", wavefront.range_waves);
        assert!(map.range()[1] > highest + 1.0, "{:?}", map.range());
        let [defocus, coma] = &wavefront.terms[..] else { panic!("{:?}", wavefront.terms) };
        assert_eq!((&defocus.name[..], defocus.error, coma.index, coma.error), ("defocus", Some(0.01), 8, None));
    }

    #[test]
    fn beam_table_kernel_and_iris_are_those_of_the_model() {
        let side = Spread { q: 1.2, sigma: 1.0 };
        let terms = ModelTerms {
            source: Some([0.5, 0.0, 0.0, 0.0, -0.4]),
            level: Some(Level::Nodes([[0.9, 1.0, 1.0], [1.0, 1.05, 1.0], [1.0, 1.0, 1.2]])),
            bend: Some([0.1, -0.05]),
            crosstalk: Some([side; 4]),
            iris: Some([0.3, -0.1, 1.1]),
            ..ModelTerms::default()
        };
        let picture = |d: f64| PictureLeft {
            file: String::new(),
            kind: "random",
            iris_mm: [1.0, 0.0, d],
            role: "fitted",
            left: 0.0,
            squares: 1.0,
        };
        let pictures = [picture(6.0), picture(2.5), picture(6.0)];
        let display = display(terms);
        let figures = Figures::new(&display, Color::Green, &pictures).expect("figures");
        let beam = figures.beam.expect("a beam");
        assert_eq!((beam.rows, beam.columns), (21, 41));
        let mean = beam.values.iter().sum::<f64>() / beam.values.len() as f64;
        assert!((mean - 1.0).abs() < 0.01, "{mean}");
        let (x, y) = (beam.cut(1), beam.cut(0));
        assert!((x[0][0] + x[40][0]).abs() < 1e-9 && x[40][0] > 0.49 && x[40][0] < 0.512, "{:?}", x[40]);
        assert!((x[40][1] / x[0][1] - (2.0 * 40.0 / 41.0f64).exp()).abs() < 0.01, "{:?}", [x[0], x[40]]);
        assert!(y[10][1] > 1.5 * y[0][1] && (y[0][1] - y[20][1]).abs() < 1e-3, "{y:?}");
        let table = figures.table.expect("a table");
        let quarter = table.drives.iter().position(|d| *d == 0.25).expect("a quarter");
        let bent = (0.1 - 0.05) / TAU;
        for (got, level) in table.turns[quarter].iter().zip([0.9, 1.05, 1.2]) {
            assert!((got - 0.25 * level - bent).abs() < 1e-9, "{got} at {level}");
        }
        let kernel = figures.crosstalk.expect("a kernel");
        assert_eq!(kernel.offsets_px.len(), 13);
        let squares = |v: &[f64]| v.iter().map(|v| v * v).sum::<f64>();
        let left = squares(&kernel.along_x) * squares(&kernel.along_y);
        assert!(kernel.variance_left < 0.9 && (left - kernel.variance_left).abs() < 0.01, "{left}");
        let iris = figures.iris.expect("an iris");
        assert_eq!(display.model(Color::Green).iris, Iris { x: 3e-4, y: -1e-4, scale: 1.1 });
        assert_eq!(iris.diameters_mm, [[2.5, 2.75], [6.0, 6.6]]);
        assert!((iris.at_mm[0] - 0.3).abs() < 1e-9 && iris.error_mm.is_none());
    }
}
