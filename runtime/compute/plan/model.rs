//! Makes the tables of the real display for the kernels (OPTICS 10).

use super::mask::MaskTables;
use super::{Buffer, ModelParts};
use crate::optics::{Color, Display, DisplayModel, Geometry, Obstruction, Optics, Pupil, SourceMode};
use eyebox_kernels::{Complex32, modulate_mask, table_start};
use rayon::prelude::*;
use std::f64::consts::TAU;
use std::sync::{Arc, OnceLock};

/// A display's model at one wavelength, on a grid. Its tables per pixel and per bin are made on first use.
#[derive(Debug, Clone)]
pub struct ModelTables {
    model: DisplayModel,
    /// Radius in the pupil plane of the disc on which the wavefront's polynomials are defined, meters.
    radius: f64,
    /// The highest drive that is not rounded up to the lowest, radians.
    highest_drive: f64,
    slm: Optics,
    grid: Optics,
    /// The modes of the source, whose light meets the relay at different places. The list is empty for a laser on the
    /// axis.
    modes: Vec<SourceMode>,
    /// The static mask in front of the SLM, if any.
    mask: Option<Arc<MaskTables>>,
    /// An obstruction and the iris that holds it, both also in the relay's table. There is none for a clear pupil.
    obstructed: Option<(Obstruction, Pupil)>,
    /// Rows and columns of the whole SLM, and the place of this one's first pixel in it, for pieces of a far field.
    whole: [usize; 2],
    at: [i64; 2],
    /// Root mean square of the source over the whole SLM, shared by all pieces of it.
    root: Arc<OnceLock<f64>>,
    /// [`variance_left`](Self::variance_left) on the whole SLM.
    variance_left: OnceLock<f64>,
    /// Power of the error of the field, over the field's power, at which crosstalk is cut.
    error: f64,
    reach: Option<[usize; 2]>,
    pixels: Arc<OnceLock<Vec<f32>>>,
    crosstalk: Vec<f32>,
    offsets: Arc<OnceLock<Vec<f32>>>,
    relay: Arc<OnceLock<Vec<f32>>>,
    needs: OnceLock<Arc<[u32]>>,
}

/// Error for viewing and scoring, below the precision of float32.
const EXACT: f64 = 1e-11;
/// Error for the steps of a solve. One value per pixel represents crosstalk to a hundredth, three to a thousandth,
/// and no picture shows the difference.
const SOLVING: f64 = 3e-5;
/// Error for viewing a piece at a time, 80 dB below the field. A reach of hundreds of pixels would exceed the piece.
const PIECES: f64 = 1e-8;

impl PartialEq for ModelTables {
    /// Compares the inputs of the tables.
    fn eq(&self, other: &Self) -> bool {
        let of = |t: &Self| (t.radius, t.error, t.slm, t.grid, t.whole, t.at);
        let same = self.model == other.model && self.modes == other.modes && self.mask == other.mask;
        same && self.obstructed == other.obstructed && of(self) == of(other)
    }
}

impl ModelTables {
    /// Makes the tables of this model on an SLM of `levels` levels inside a grid, or none if the display is ideal.
    /// `radius` is half the eyebox of the display's shortest wavelength in meters.
    pub fn new(model: DisplayModel, radius: f64, levels: u32, slm: Optics, grid: Optics) -> Option<Arc<Self>> {
        (!model.is_ideal()).then(|| Arc::new(Self::cut(model, radius, highest_drive(levels), EXACT, slm, grid)))
    }

    /// Returns the same for the steps of a solve, with crosstalk cut where the rest of it is visible in no picture.
    pub fn for_steps(&self) -> Arc<Self> {
        self.cut_at(SOLVING)
    }

    /// Returns the same for viewing a far field a piece at a time.
    pub fn for_pieces(&self) -> Arc<Self> {
        self.cut_at(PIECES)
    }

    /// Returns the same in the light of these modes of a source.
    /// [`Planner::with_source`](super::Planner::with_source) calls it.
    pub(crate) fn lit_by(&self, modes: &[SourceMode]) -> Arc<Self> {
        Arc::new(Self { modes: modes.to_vec(), ..self.again(self.model.clone(), self.error) })
    }

    /// Returns the same with another model of the display behind the same mask, or none if the result is the ideal
    /// display.
    pub fn with_model(&self, model: DisplayModel) -> Option<Arc<Self>> {
        let ideal = model.is_ideal() && self.mask.is_none();
        (!ideal).then(|| Arc::new(Self { modes: self.modes.clone(), ..self.again(model, self.error) }))
    }

    fn again(&self, model: DisplayModel, error: f64) -> Self {
        let plain = Self::cut(model, self.radius, self.highest_drive, error, self.slm, self.grid);
        Self { mask: self.mask.clone(), ..plain }
    }

    /// Returns the tables of a tile that repeats over the SLM, or none if the tile's display is ideal. All its pixels
    /// have the SLM's mean and are evenly lit. Light that no pixel modulates is left out, because its fringes repeat
    /// with no tile.
    pub fn tile(&self, tile: Optics) -> Option<Arc<Self>> {
        let ideal = DisplayModel::default();
        let level = self.model.level.as_flattened().iter().sum::<f64>() / 9.0;
        let (source, undiffracted) = (ideal.source, ideal.undiffracted);
        let model = DisplayModel { level: [[level; 3]; 3], source, undiffracted, ..self.model.clone() };
        let modes = self.modes.clone();
        let whole = Self { modes, ..Self::cut(model, self.radius, self.highest_drive, self.error, tile, tile) };
        (!whole.model.is_ideal()).then(|| Arc::new(whole))
    }

    /// Returns the need of each pixel because of its own amount of light ([`table_start::need`]), or none if all are
    /// equal.
    pub fn needs(&self) -> Option<Arc<[u32]>> {
        let need_of = |amplitude: &f32| table_start::need(amplitude * amplitude);
        let all = || {
            let count = self.slm.height * self.slm.width;
            self.pixels()[count..2 * count].iter().map(need_of).collect()
        };
        self.parts().drives.then(|| Arc::clone(self.needs.get_or_init(all)))
    }

    /// Returns the number of modes, at least 1.
    pub(crate) fn mode_count(&self) -> usize {
        self.modes.len().max(1)
    }

    /// Returns the tables of the iris alone.
    pub fn iris(&self) -> Arc<Self> {
        Arc::new(self.again(self.model.only("iris"), self.error))
    }

    /// Returns the tables of the ideal display in the light of these modes.
    pub(super) fn ideal(modes: &[SourceMode], slm: Optics, grid: Optics) -> Arc<Self> {
        let plain = Self::cut(DisplayModel::default(), grid.eyebox() / 2.0, highest_drive(0), EXACT, slm, grid);
        Arc::new(Self { modes: modes.to_vec(), ..plain })
    }

    /// Returns the same in front of one iris with an obstruction in it.
    pub(super) fn obstructed(&self, obstruction: Obstruction, iris: &Pupil) -> Arc<Self> {
        let (obstructed, relay) = (Some((obstruction, *iris)), Arc::default());
        Arc::new(Self { obstructed, relay, ..self.clone() })
    }

    fn cut_at(&self, error: f64) -> Arc<Self> {
        Arc::new(Self { modes: self.modes.clone(), ..self.again(self.model.clone(), error) })
    }

    /// Returns the tables of a piece of a far field's SLM with `size` pixels, whose first is `at`. `self` has the
    /// tables of the whole SLM. The piece may extend over the edges by the [reach](Self::reach) of crosstalk. Pixels
    /// there wrap around from the other side and are dark.
    pub fn piece(&self, at: [i64; 2], size: [usize; 2]) -> Arc<Self> {
        let piece = self.slm.piece(at, size);
        let (pixels, offsets, relay, needs) = Default::default();
        let (slm, grid, obstructed) = (piece, piece, None);
        let variance_left = OnceLock::from(self.variance_left());
        Arc::new(Self { variance_left, slm, grid, obstructed, at, pixels, offsets, relay, needs, ..self.clone() })
    }

    /// Returns the first pixel and the size of the piece that holds these pixels of the whole SLM, and all that
    /// crosstalk brings into them. If the piece would fill an axis, it takes the whole SLM along it.
    pub fn around(&self, at: [usize; 2], size: [usize; 2]) -> ([i64; 2], [usize; 2]) {
        let reach = self.reach();
        let fills = |k: usize| size[k] + 2 * reach[k] >= self.whole[k];
        let first = |k: usize| if fills(k) { 0 } else { at[k] as i64 - reach[k] as i64 };
        let count = |k: usize| if fills(k) { self.whole[k] } else { size[k] + 2 * reach[k] };
        ([0, 1].map(first), [0, 1].map(count))
    }

    /// Returns the piece of a far field's SLM that a pupil sees on this display, or on the ideal display without a
    /// model. It is the part under the real iris, and [around](Self::around) it.
    pub fn under(model: Option<&Self>, whole: &Optics, pupil: &Pupil) -> ([i64; 2], [usize; 2]) {
        let Some(model) = model else {
            let (at, size) = whole.under(pupil);
            return (at.map(|i| i as i64), size);
        };
        let (at, size) = whole.under(&model.model.true_pupil(pupil));
        model.around(at, size)
    }

    /// Returns the pixels that crosstalk reaches along y and along x, 0 without crosstalk.
    pub fn reach(&self) -> [usize; 2] {
        self.reach.unwrap_or_default()
    }

    fn cut(model: DisplayModel, radius: f64, highest_drive: f64, error: f64, slm: Optics, grid: Optics) -> Self {
        // Crosstalk acts between the SLM's own pixels.
        let [rows, columns] = [grid.height, grid.width].map(|n| n / slm.mask_factor);
        let weights = model.crosstalk_weights(rows, columns, model.subpixels, error);
        let reach = weights.as_ref().map(|axes| [axes[0].reach, axes[1].reach]);
        let crosstalk = weights.iter().flatten().flat_map(|axis| &axis.values).map(|v| *v as f32).collect();
        let (pixels, offsets, relay, needs, root, variance_left) = Default::default();
        let (whole, at) = ([slm.height, slm.width], [0, 0]);
        Self {
            model,
            radius,
            highest_drive,
            slm,
            grid,
            modes: Vec::new(),
            mask: None,
            obstructed: None,
            whole,
            at,
            root,
            variance_left,
            error,
            reach,
            pixels,
            crosstalk,
            offsets,
            relay,
            needs,
        }
    }

    /// Returns the tables of a display in one of its colors, on its SLM inside a grid, in the light of its source.
    pub fn of(display: &Display, color: Color, slm: Optics, grid: Optics) -> Option<Arc<Self>> {
        let (model, radius) = (display.model(color), display.source_eyebox_min() / 2.0);
        let plain = match MaskTables::of(display, slm, grid) {
            None => Self::new(model, radius, display.levels, slm, grid)?,
            Some(mask) => {
                let highest_drive = highest_drive(display.levels);
                let plain = Self::cut(model, radius, highest_drive, EXACT, slm, grid);
                Arc::new(Self { mask: Some(Arc::new(mask)), ..plain })
            }
        };
        let modes = display.modes(color);
        Some(if modes.is_empty() { plain } else { plain.lit_by(&modes) })
    }

    /// Returns the distance of the mask behind the SLM, meters.
    pub(crate) fn mask_distance(&self) -> f64 {
        self.mask.as_ref().map_or(0.0, |mask| mask.distance())
    }

    /// Returns the coverage of each mask pixel by a pixel of the SLM, along an axis.
    pub(crate) fn cover(&self) -> [f32; modulate_mask::MOST] {
        self.mask.as_ref().map_or([1.0; modulate_mask::MOST], |mask| mask.cover(self.model.fill))
    }

    /// Returns the highest drive that is not rounded up to the lowest, radians.
    pub(crate) fn highest_drive(&self) -> f64 {
        self.highest_drive
    }

    /// Returns the sum of squares of crosstalk's kernel, which is the share of the variance of random drives that
    /// remains. It is 1 without crosstalk.
    pub fn variance_left(&self) -> f64 {
        *self.variance_left.get_or_init(|| {
            let [rows, columns] = [self.grid.height, self.grid.width].map(|n| n / self.slm.mask_factor);
            self.model.variance_left(rows, columns)
        })
    }

    /// Returns the model of the display.
    pub fn model(&self) -> &DisplayModel {
        &self.model
    }

    /// Returns the parts that need buffers.
    pub fn parts(&self) -> ModelParts {
        let (model, ideal) = (&self.model, DisplayModel::default());
        let crosstalk = model.crosstalk.is_some();
        let driven = model.level != ideal.level || model.bend != ideal.bend || model.lag > 0.0;
        let lit = model.source != ideal.source || !model.undiffracted.is_empty();
        ModelParts {
            drives: crosstalk || driven || lit || self.mask.is_some(),
            crosstalk: self.reach,
            more_subpixels: if crosstalk { model.subpixels - 1 } else { 0 },
            relay: if self.has_relay() { self.mode_count() } else { 0 },
            mask: self.mask.as_ref().map_or(0, |mask| mask.factor()),
            mask_away: self.mask_distance() > 0.0,
        }
    }

    /// Returns true if something between the SLM and the eye changes bins.
    fn has_relay(&self) -> bool {
        let (model, waves) = (&self.model, self.model.wavefront.values());
        self.obstructed.is_some() || model.fill > 0.0 || waves.copied().any(|waves| waves != 0.0)
    }

    /// Returns the tables of these parts with their buffers.
    pub(crate) fn buffers(&self) -> impl Iterator<Item = (Buffer, &[f32])> {
        let parts = self.parts();
        let pixels = parts.drives.then(|| (Buffer::Pixels, self.pixels()));
        let crosstalk = parts.crosstalk.map(|_| (Buffer::Crosstalk, &self.crosstalk[..]));
        let offsets = (parts.more_subpixels > 0).then(|| (Buffer::Offsets, self.offsets()));
        let relay = (parts.relay > 0).then(|| (Buffer::Relay, self.relay()));
        let mask = self.mask.iter().flat_map(|mask| mask.buffers());
        [pixels, crosstalk, offsets, relay].into_iter().flatten().chain(mask)
    }

    /// Returns for each pixel its level, its modulated share and the light of the source (`Buffer::Pixels`).
    pub fn pixels(&self) -> &[f32] {
        self.pixels.get_or_init(|| {
            let root = *self.root.get_or_init(|| self.model.source_root(self.whole));
            let (count, width) = (self.slm.height * self.slm.width, self.slm.width);
            let mut tables = vec![0.0f32; 4 * count];
            let [level, modulated, re, im] = split(&mut tables, count);
            let rows = level.par_chunks_mut(width).zip(modulated.par_chunks_mut(width));
            let rows = rows.zip(re.par_chunks_mut(width).zip(im.par_chunks_mut(width))).enumerate();
            rows.for_each(|(y, ((level, modulated), (re, im)))| {
                for x in 0..width {
                    let place = [self.at[0] + y as i64, self.at[1] + x as i64];
                    let own = self.model.pixel(place, self.whole, root).map(|v| v as f32);
                    [level[x], modulated[x], re[x], im[x]] = own;
                }
            });
            tables
        })
    }

    fn offsets(&self) -> &[f32] {
        self.offsets.get_or_init(|| {
            let sides = [self.grid.height, self.grid.width];
            let factors = sides.into_iter().flat_map(|count| self.model.subpixel_factors(count, self.model.subpixels));
            factors.flat_map(|z| [z.re as f32, z.im as f32]).collect()
        })
    }

    fn relay(&self) -> &[f32] {
        self.relay.get_or_init(|| {
            let centred = [SourceMode::centred(self.grid.wavelength)];
            let modes = if self.modes.is_empty() { &centred[..] } else { &self.modes };
            let tables: Vec<Complex32> = modes.iter().flat_map(|mode| self.relay_of(mode)).collect();
            bytemuck::cast_slice(&tables).to_vec()
        })
    }

    /// Returns the table of one mode of the source. The aperture stays with the SLM's frequencies. The wavefront is a
    /// path, which applies where the light arrives (OPTICS 12).
    fn relay_of(&self, mode: &SourceMode) -> Vec<Complex32> {
        let (grid, model) = (&self.grid, &self.model);
        let lit = Optics { wavelength: mode.wavelength, ..*grid };
        let ((bin_y, bin_x), (first_y, first_x)) = (lit.bin_size(), grid.first_bin());
        let [moved_x, moved_y] = mode.angle.map(|t| grid.focal_length * t);
        let waves = grid.wavelength / mode.wavelength;
        let full = DisplayModel { fill: 1.0, ..DisplayModel::default() };
        let sinc = |k: i64, n: usize| match grid.geometry {
            // Behind a mask the aperture is the one of the mask's pixels, which are full. The SLM's fill acts through
            // its coverage.
            Geometry::Relay if model.fill > 0.0 && self.mask.is_some() => full.pixel_sinc(k as f64 / n as f64),
            Geometry::Relay if model.fill > 0.0 => model.pixel_sinc(k as f64 / n as f64),
            _ => 1.0,
        };
        let passing = self.obstructed.map(|(obstruction, iris)| obstruction.amplitude(grid, &iris));
        let along_x: Vec<f64> = (0..grid.width as i64).map(|x| sinc(first_x + x, grid.width)).collect();
        let mut relay = vec![Complex32::default(); grid.height * grid.width];
        let row_of = |row: usize| {
            let ky = (0..grid.height as i64).map(|y| first_y + y).find(|ky| grid.index_of(*ky, 0).0 == row);
            ky.expect("every row is a bin's")
        };
        relay.par_chunks_exact_mut(grid.width).enumerate().for_each(|(row, out)| {
            let ky = row_of(row);
            let across = sinc(ky, grid.height);
            for (x, along) in along_x.iter().enumerate() {
                let kx = first_x + x as i64;
                let (at_x, at_y) = (kx as f64 * bin_x + moved_x, ky as f64 * bin_y + moved_y);
                let turns = waves * model.wavefront_turns(at_x, at_y, self.radius);
                let (sin, cos) = (TAU * (turns - turns.round())).sin_cos();
                let size = across * along * passing.as_ref().map_or(1.0, |passing| passing([at_x, at_y]));
                out[grid.index_of(ky, kx).1] = Complex32::new((size * cos) as f32, (size * sin) as f32);
            }
        });
        relay
    }
}

/// Returns the highest drive of `levels` levels that is not rounded up to the lowest, radians.
fn highest_drive(levels: u32) -> f64 {
    TAU * (1.0 - 1.0 / f64::from(levels.max(2)))
}

/// Splits a table into four of `count` values each.
fn split(tables: &mut [f32], count: usize) -> [&mut [f32]; 4] {
    let (a, rest) = tables.split_at_mut(count);
    let (b, rest) = rest.split_at_mut(count);
    let (c, d) = rest.split_at_mut(count);
    [a, b, c, d]
}
