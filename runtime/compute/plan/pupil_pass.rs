//! Plans the data of a pupil, from window, spans and taps to tables and the scales between units.

use super::resample_tables::ResampleTables;
use super::{EyeTables, ModelTables, PupilPass, Purpose, Shape, Shot, Storage};
use crate::optics::{
    FewerModes, Geometry, Obstruction, Optics, Padding, Pupil, SourceMode, Window, WindowFactor, fewer_modes,
};
use crate::scene::{Pyramid, ViewGrid};
use eyebox_kernels::{compare, fft::Columns, intensity, modulate, pass_pupil, photograph, resample, transfer};
use std::sync::Arc;

/// The comparison of an image with its target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Comparison {
    /// One of the modes of the kernel `compare`.
    pub mode: u32,
    /// Intensity scale s (OPTICS 2).
    pub exposure: f64,
    /// Added to both sides of a ratio, in units of the target.
    pub floor: f64,
    /// Largest ratio of amplitudes.
    pub limit: f64,
    /// Pupils in the mini-batch, B.
    pub batch: usize,
}

impl Default for Comparison {
    fn default() -> Self {
        // Floor and limit are the values of the former float64 reference implementation.
        Self { mode: compare::PROJECTION, exposure: 1.0, floor: 1e-6, limit: 3.0, batch: 1 }
    }
}

/// Layout of a scene's pyramid, as far as target images need it.
#[derive(Debug, Clone, PartialEq)]
pub struct ViewLayout {
    /// Places of the views around their center.
    pub grid: ViewGrid,
    /// Place of that center in the pupil plane, (x, y), meters.
    pub center: [f64; 2],
    /// Sizes of the levels, (height, width).
    pub levels: Vec<(usize, usize)>,
    /// Linear light of the value 1 of a stored sample.
    pub unit: f64,
    /// Weights from levels to windows.
    pub(crate) tables: ResampleTables,
}

impl ViewLayout {
    /// Returns the layout of this pyramid.
    pub fn new(grid: ViewGrid, pyramid: &Pyramid) -> Self {
        let levels = pyramid.levels.iter().map(|l| (l.height, l.width)).collect();
        Self {
            grid,
            center: [0.0, 0.0],
            levels,
            unit: f64::from(pyramid.scale) / 65535.0,
            tables: ResampleTables::default(),
        }
    }

    /// Returns the same with the grid's center at (x, y) in the pupil plane, meters.
    #[must_use]
    pub fn centered_at(self, center: [f64; 2]) -> Self {
        Self { center, ..self }
    }
}

/// Everything about a solve that does not change from pupil to pupil, at one wavelength.
#[derive(Debug, Clone)]
pub struct Planner {
    /// Optics over the SLM.
    pub slm: Optics,
    /// Optics over the grid, which is the SLM with its padding.
    pub grid: Optics,
    /// Number of planned sub-frames.
    pub frames: usize,
    /// Share of the spectrum that a pupil gets.
    pub factor: WindowFactor,
    /// The views, or none if only the wave is needed.
    pub views: Option<ViewLayout>,
    /// Levels of the SLM, 0 for any phase.
    pub levels: usize,
    /// How complex fields are stored.
    pub storage: Storage,
    /// True if phases that the projection moves are [binary angles](Shape::binary_angles), provided that fields are
    /// halves.
    pub binary_angles: bool,
    /// Share of the image that the picture takes along each axis (OPTICS 9). Images are cut to it.
    pub share: f64,
    /// Effects of the display on the light besides showing phases, or none for the ideal display.
    pub model: Option<Arc<ModelTables>>,
    /// The eye of the viewer, or none for a perfect one.
    pub eye: Option<Arc<EyeTables>>,
    /// The modes of the source (OPTICS 12), whose intensities add. There are none for a laser on the axis.
    /// [`with_source`](Self::with_source) also sets them in the model.
    pub modes: Arc<[SourceMode]>,
    /// Reduced lists of modes for wide pupils in a solve, in the order of their diameters. They are empty if all
    /// pupils use all modes.
    pub fewer: Arc<[FewerModes]>,
    /// Power of the laser in each sub-frame over its mean (OPTICS 13). It is empty if all are equal.
    pub powers: Arc<[f64]>,
}

impl Planner {
    /// Makes a planner without padding and without views.
    pub fn new(slm: Optics, frames: usize, factor: WindowFactor) -> Self {
        Self {
            slm,
            grid: Padding::default().grid(slm),
            frames,
            factor,
            views: None,
            levels: 0,
            storage: Storage::F32,
            binary_angles: false,
            share: 1.0,
            model: None,
            eye: None,
            modes: Arc::new([]),
            fewer: Arc::new([]),
            powers: Arc::new([]),
        }
    }

    /// Returns the same in the light of these modes of a source, none for a laser on the axis.
    #[must_use]
    pub fn with_source(self, modes: &[SourceMode]) -> Self {
        let model = match &self.model {
            Some(model) if !modes.is_empty() => Some(model.lit_by(modes)),
            model => model.clone(),
        };
        Self { modes: modes.into(), model, ..self }
    }

    /// Returns the same with the fewest modes for wide pupils that keep their speckle, in an eyebox of side `eyebox`
    /// meters. A relay's tables cover all modes, so on a display whose relay has faults every pupil uses every mode.
    #[must_use]
    pub fn with_fewer_modes(self, eyebox: f64) -> Self {
        let relays = self.model.as_ref().is_some_and(|model| model.parts().relay > 0);
        // Switched sources are lit, each unchanged.
        let switched = self.modes.iter().any(|mode| mode.source != 0 || mode.turn != SourceMode::ALWAYS);
        let modes = if relays || switched { &[][..] } else { &self.modes };
        Self { fewer: fewer_modes(modes, eyebox / 2.0, self.grid.focal_length).into(), ..self }
    }

    /// Returns the same with fewer modes, if they suffice for a pupil of this diameter. All modes stay if pupils get
    /// the whole spectrum, as in scoring.
    pub(super) fn of_fewer_modes(&self, diameter: f64) -> Option<Self> {
        if self.factor == WindowFactor::Full {
            return None;
        }
        let few = self.fewer.iter().rev().find(|few| diameter >= few.from)?;
        Some(Self { modes: Arc::clone(&few.modes), fewer: Arc::new([]), ..self.clone() })
    }

    /// Returns one of the modes, by its index, with the optics of its wavelength over the grid.
    pub(super) fn mode(&self, at: usize) -> (SourceMode, Optics) {
        let mode = self.modes.get(at).copied().unwrap_or(SourceMode::centred(self.grid.wavelength));
        (mode, Optics { wavelength: mode.wavelength, ..self.grid })
    }

    /// Returns the indices of the modes whose light may reach a pupil, at least one. They are lit, and their eyebox
    /// contains the pupil.
    fn modes_at(&self, pupil: Pupil) -> impl Iterator<Item = usize> + Clone {
        let lit = |at: &usize| self.modes[*at].is_lit();
        let reaches = move |at: &usize| {
            let (mode, optics) = self.mode(*at);
            let (seen, (bin_y, bin_x)) = (mode.pupil(&pupil, optics.focal_length), optics.bin_size());
            let most = (optics.eyebox() + pupil.diameter) / 2.0;
            seen.x.abs() <= most + bin_x && seen.y.abs() <= most + bin_y
        };
        let all = 0..self.modes.len();
        let found = all.clone().filter(move |at| lit(at) && (self.modes.len() == 1 || reaches(at)));
        let any = found.clone().next().is_none().then(|| all.clone().find(lit).unwrap_or(0));
        found.chain(any)
    }

    /// Returns the power of a mode in a sub-frame over its mean, from the lasers and from sources that take turns.
    pub(super) fn power(&self, mode: usize, frame: usize) -> f64 {
        self.powers.get(frame).map_or(1.0, |power| *power) * self.mode(mode).0.power(frame, self.frames)
    }

    /// Lights the sources at these indices all the time, and no others.
    pub fn light(&mut self, sources: &[usize]) {
        self.modes = self.modes.iter().map(|mode| mode.lit_among(sources)).collect();
    }

    /// Scales the planner for targets that are divided by `unit`.
    pub fn divide_targets(&mut self, unit: f64) {
        if let Some(views) = &mut self.views {
            views.unit /= unit;
        }
    }

    /// Returns the same with zeros around the SLM.
    pub fn with_padding(self, padding: Padding) -> Self {
        Self { grid: padding.grid(self.slm), ..self }
    }

    /// Returns the place of the SLM in the grid, as its own size and the first point of the grid on it. Behind a
    /// mask, the points of the grid are the mask's pixels ([`Shape::on_grid`]).
    pub fn place(&self) -> modulate::Args {
        let finer = self.slm.mask_factor;
        modulate::Args {
            height: self.slm.height as u32,
            width: self.slm.width as u32,
            grid_height: self.grid.height as u32,
            grid_width: self.grid.width as u32,
            top: ((self.grid.height - finer * self.slm.height) / 2) as u32,
            left: ((self.grid.width - finer * self.slm.width) / 2) as u32,
        }
    }

    /// Returns the buffers that an engine needs.
    pub fn shape(&self, purpose: Purpose) -> Shape {
        let (frames, place, storage) = (self.frames, self.place(), self.storage);
        let model = self.model.as_ref().map(|model| model.parts()).unwrap_or_default();
        let quantised = self.levels > 0;
        // Only the kernels of the projection support angles.
        let fits = storage == Storage::F16 && purpose == Purpose::Project && !quantised;
        let binary_angles = self.binary_angles && fits;
        Shape { frames, place, purpose, quantised, storage, binary_angles, model }
    }

    /// Plans the pass of `pupil`. For the projection, the scale of the way back makes `change` the wanted change of
    /// the field after an unnormalized inverse. For the others it makes `change` the gradient G (OPTICS 4, 6b). Both
    /// carry the scale of the storage.
    pub fn pupil_pass(&self, pupil: &Pupil, comparison: &Comparison) -> PupilPass {
        let mut pass = PupilPass::empty();
        self.refill(&mut pass, pupil, comparison);
        pass
    }

    /// Refills a finished pass as [`pupil_pass`](Self::pupil_pass), in the lists that it has.
    pub(super) fn refill(&self, pass: &mut PupilPass, pupil: &Pupil, comparison: &Comparison) {
        // Light passes the real iris, but the target image is for the requested one.
        let iris = self.model.as_ref().map_or(*pupil, |model| model.model().true_pupil(pupil));
        self.refill_wave(pass, &iris, self.grid.share(iris.diameter), self.frames, comparison);
        self.see_with_eye(pass, &iris);
        let takes_turns = |mode: &PupilPass| self.modes.get(mode.source_mode).is_some_and(|mode| mode.turn[1] != 1);
        if !self.powers.is_empty() || pass.each_mode().any(takes_turns) {
            pass.set_powers_by_mode(|mode| (0..self.frames).map(move |frame| self.power(mode, frame)));
        }
        let look = std::iter::once((*pupil, self.displacement(&iris)));
        pass.shot = self.shot_over(look, pass.window, pass.shot.take());
    }

    /// Returns the same for an eye with this pupil and an obstruction in it (OPTICS 11), for viewing and scoring
    /// through that pupil alone. The obstruction is in the relay's table, by which engines already multiply each bin.
    #[must_use]
    pub fn obstructed(&self, obstruction: Obstruction, pupil: &Pupil) -> Self {
        let ideal = || ModelTables::ideal(&self.modes, self.slm, self.grid);
        let model = self.model.clone().unwrap_or_else(ideal);
        let iris = model.model().true_pupil(pupil);
        Self { model: Some(model.obstructed(obstruction, &iris)), ..self.clone() }
    }

    /// Returns the distance behind the SLM at which light leaves the mask, meters.
    fn mask_distance(&self) -> f64 {
        self.model.as_ref().map_or(0.0, |model| model.mask_distance())
    }

    /// Sets the eye's error, centered on this iris, in all modes of a pupil pass, and reuses the terms of the pass
    /// before.
    pub(super) fn see_with_eye(&self, pass: &mut PupilPass, iris: &Pupil) {
        pass.with_modes(std::iter::repeat(()), |pass, ()| {
            let (mode, optics) = self.mode(pass.source_mode);
            let before = pass.eye.take();
            let iris = mode.pupil(iris, optics.focal_length);
            pass.eye = self.eye.as_ref().map(|eye| eye.terms(&optics, &iris, &pass.window, before));
        });
    }

    /// Does the same as [`refill`](Self::refill) without the eye's error and the target image, which the caller sets.
    /// The argument `share` is the part of an even field's light that passes. The argument `seen` is the number of
    /// sub-frames that the eye averages.
    pub(super) fn refill_wave(
        &self,
        pass: &mut PupilPass,
        pupil: &Pupil,
        share: f64,
        seen: usize,
        comparison: &Comparison,
    ) {
        let lit = self.modes_at(*pupil);
        let pupil_of = |mode: &SourceMode| mode.pupil(pupil, self.grid.focal_length);
        let size = lit.clone().map(|at| self.mode(at)).fold([0; 2], |[rows, columns], (mode, optics)| {
            let window = Window::new(&optics, &pupil_of(&mode), self.factor);
            [rows.max(window.rows), columns.max(window.columns)]
        });
        pass.modes.resize_with(lit.clone().count() - 1, PupilPass::empty);
        pass.with_modes(lit, |pass, at| {
            let (mode, optics) = self.mode(at);
            let window = Window::around(&optics, &pupil_of(&mode), self.factor, size);
            self.refill_mode(pass, &mode, &optics, &pupil_of(&mode), window, share, seen, comparison);
            pass.source_mode = at;
        });
    }

    /// Refills one mode, with a pupil at another place in the SLM's light, with the optics of the mode's wavelength.
    /// The root of the mode's weight is in the scale of the way there and in the scale of the way back.
    #[allow(clippy::too_many_arguments, reason = "the first arguments belong to one mode, the rest to all")]
    fn refill_mode(
        &self,
        refilled: &mut PupilPass,
        mode: &SourceMode,
        grid: &Optics,
        pupil: &Pupil,
        window: Window,
        share: f64,
        seen: usize,
        comparison: &Comparison,
    ) {
        let PupilPass { mut spans, mut moments, eye, shot, modes, .. } =
            std::mem::replace(refilled, PupilPass::empty());
        spans.clear();
        spans.extend(window.each_span(grid, pupil));
        moments.clear();
        let amplitude = mode.weight.sqrt();
        let (points, count) = ((grid.height * grid.width) as f64, (window.rows * window.columns) as f64);
        let gain = 1.0 / (seen as f64 * share);
        // The buffers hold their values times these factors.
        let in_field = self.storage.field_scale(grid.height * grid.width);
        let in_window = self.storage.between(window.rows * window.columns);
        // The relay's spectrum is an unnormalized transform of the field. In the far field the window is cut from the
        // field, and an even field must have the same brightness (OPTICS 9).
        let normal = match grid.geometry {
            Geometry::Relay => 1.0 / points,
            Geometry::FarField => 1.0 / points.sqrt(),
        };
        let (y0, x0) = grid.index_of(window.y0, window.x0);
        let pass = pass_pupil::Args {
            grid_height: grid.height as u32,
            grid_width: grid.width as u32,
            y0: y0 as u32,
            x0: x0 as u32,
            rows: window.rows as u32,
            columns: window.columns as u32,
            scale: (in_window / in_field * normal * amplitude) as f32,
        };
        let projects = comparison.mode == compare::PROJECTION;
        let weight = 2.0 * comparison.exposure * gain / (count * comparison.batch as f64);
        let exposure = comparison.exposure as f32;
        let in_factor = self.factor_scale(comparison.mode, f64::from(exposure), weight);
        let in_change = self.change_scale(comparison.mode, f64::from(exposure));
        let back = in_change / (in_factor * in_window)
            * match (grid.geometry, projects) {
                (Geometry::Relay, true) => 1.0 / count,
                (Geometry::FarField, true) => 1.0 / (count * normal),
                (_, false) => normal,
            };
        let back = pass_pupil::Args { scale: (back * amplitude) as f32, ..pass };
        let ((slope_y, slope_x), (cosine_y, cosine_x)) = (grid.slopes(), grid.cosine_per_bin());
        let [angle_x, angle_y] = mode.angle;
        let compared = compare::Args {
            count: count as u32,
            mode: comparison.mode,
            exposure,
            weight: (weight * in_factor) as f32,
            floor: comparison.floor as f32,
            limit: comparison.limit as f32,
        };
        *refilled = PupilPass {
            transfer: transfer::Args {
                slope_y,
                slope_x,
                // The light leaves a mask at a distance, and the rest of the way remains.
                turns: (pupil.depth - self.mask_distance()) / grid.wavelength,
                shift_y: angle_y / cosine_y,
                shift_x: angle_x / cosine_x,
                y0: window.y0 as i32,
                x0: window.x0 as i32,
                rows: window.rows as u32,
                columns: window.columns as u32,
            },
            eye,
            taper: None,
            moments,
            columns: span_columns(&spans),
            intensity: intensity::Args {
                count: count as u32,
                frames: self.frames as u32,
                gain: (gain / (in_window * in_window)) as f32,
                accumulate: 0,
            },
            compare: compared,
            shot,
            weight: mode.weight as f32,
            source_mode: 0,
            modes,
            window,
            spans,
            pass,
            back,
        };
    }

    /// Returns the displacement of the picture for the eye, meters (x, y): the place at which its error is centered
    /// (OPTICS 11).
    pub(super) fn displacement(&self, iris: &Pupil) -> [f64; 2] {
        self.eye.as_ref().map_or([0.0; 2], |e| e.prescription().displacement([iris.x, iris.y], self.grid.focal_length))
    }

    /// Plans the mean of the target images through these pupils, each displaced by (x, y) meters, in the lists of
    /// `over`.
    pub(super) fn shot_over(
        &self,
        looks: impl Iterator<Item = (Pupil, [f64; 2])> + Clone,
        window: Window,
        over: Option<Shot>,
    ) -> Option<Shot> {
        let ViewLayout { grid: views, center, levels, unit, tables } = self.views.as_ref()?;
        let fits = |l: &(usize, usize)| l.0 >= window.rows && l.1 >= window.columns;
        let level = levels.iter().rposition(fits).unwrap_or(0);
        let (height, width) = levels[level];
        let mut taps = over.map_or_else(Vec::new, |shot| shot.taps);
        taps.clear();
        let count = looks.clone().count();
        for (pupil, displaced) in looks {
            taps.extend(views.taps_around(*center, displaced, &self.grid, &pupil, height, width));
        }
        if count > 1 {
            let share = 1.0 / count as f32;
            taps.iter_mut().for_each(|tap| tap.weight *= share);
            // Sorting joins taps of one vertical shift, which are then added up together.
            taps.sort_unstable_by_key(|tap| (tap.dy, tap.fy.to_bits(), tap.view, tap.dx, tap.fx.to_bits()));
        }
        let (rows, columns) = (tables.get(height, window.rows), tables.get(width, window.columns));
        Some(Shot {
            level,
            args: photograph::Args {
                height: height as u32,
                width: width as u32,
                taps: taps.len() as u32,
                scale: *unit as f32,
                accumulate: 0,
            },
            taps,
            resample: resample::Args::between((height, width), (window.rows, window.columns), &rows, &columns),
            rows,
            columns,
        })
    }
}

/// Returns the columns of a window that its spans touch.
fn span_columns(spans: &[[u32; 2]]) -> Columns {
    let used = spans.iter().filter(|s| s[1] > s[0]);
    let first = used.clone().map(|s| s[0]).min().unwrap_or(0);
    let end = used.map(|s| s[1]).max().unwrap_or(0);
    Columns { first: first as usize, count: (end - first) as usize }
}
