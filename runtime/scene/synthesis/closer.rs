//! Makes closer views than a scene has, if target images need them.

use crate::synthesis::layers::decibels;
use crate::{DepthSource, Interpolator, Layers, LightField, MadeViews, SceneError, ViewGrid, ViewSynthesis};
use eyebox_base::memory;
use eyebox_optics::Display;

/// Largest number of views along an axis that are made.
const MOST: usize = 9;
/// Least accuracy of layers for a view between others, dB. It is 3 dB more than the accuracy of a good hologram.
pub const ENOUGH: f64 = 36.0;
/// Least advantage of interpolation over layers if layers are not accurate enough, dB.
const BETTER: f64 = 1.0;

impl LightField {
    /// Returns the light field with the views for target images on `display`, by the requested method.
    ///
    /// # Errors
    /// [`SceneError`] if they do not fit into memory, or if one or two views do not fit the others.
    pub fn with_views_for(self, display: &Display, asked: ViewSynthesis) -> Result<Self, SceneError> {
        let own = self.grid[0].max(self.grid[1]);
        let auto = asked == ViewSynthesis::Auto;
        if own < 2 || asked == ViewSynthesis::Cells || auto && own >= MOST {
            return Ok(self);
        }
        let (depth, source) = self.reach(display);
        let aliasing = self.aliasing(display, depth);
        let wanted = self.views_without_aliasing(display, depth, display.eyebox_min()).min(MOST);
        if auto && (wanted <= own || matches!(source, DepthSource::Doubtful(_))) {
            return Ok(self);
        }
        let layers = match asked {
            ViewSynthesis::Between => None,
            _ => Some(Layers::new(&self, display, depth)?),
        };
        if let Some(odd) = layers.as_ref().filter(|_| auto).and_then(|layers| layers.odd_views(&self.name)) {
            return Err(odd);
        }
        let shown =
            layers.as_ref().map(|l| [l.residual_between(), l.residual().into_iter().fold(f64::INFINITY, f64::min)]);
        let (mut by, mut held_back) = (asked, None);
        if let Some([db, _]) = shown.filter(|_| auto) {
            held_back = if db < ENOUGH { self.held_back(display, depth)? } else { None };
            by = match held_back {
                None if db >= ENOUGH => ViewSynthesis::Layers,
                Some([layers, between]) if between >= layers + BETTER => ViewSynthesis::Between,
                _ => {
                    tracing::warn!(
                        "{}: content moves by {aliasing:.1} pixels from view to view, and layers predict views in \
                         between with {db:.1} dB only. Target images are sums of cells, with ghosts. State \
                         `photographs` layers or between for closer views",
                        self.name
                    );
                    return Ok(self);
                }
            };
        }
        let (cell, n) = (self.cell(display), wanted.max(own.min(MOST)));
        let spans = self.grid.map(|n| (n as f64 * cell).min(display.eyebox_min()));
        let closer = spans[0].max(spans[1]) / n as f64;
        let count = |i: usize| if self.grid[i] == 1 { 1 } else { (spans[i] / closer).round().max(1.0) as usize };
        let grid = ViewGrid { rows: count(0), columns: count(1), cell: closer };
        let places: Vec<(f64, f64)> = (0..grid.rows * grid.columns).map(|i| grid.position(i)).collect();
        let counts = [places.len(), self.colors.len(), self.height, self.width];
        let what = || format!("{} views of {} x {} pixels", places.len(), self.height, self.width);
        memory::check_available(what, memory::bytes_of(&counts, 4), "take a smaller `size`, or `photographs` cells")?;
        let made = MadeViews {
            by,
            grid: self.grid,
            cell,
            aliasing,
            layers: layers.as_ref().zip(shown).map(|(l, db)| (l.count(), db)),
            held_back,
        };
        let colors = 0..self.colors.len();
        let planes = match layers.filter(|_| by == ViewSynthesis::Layers) {
            Some(layers) => colors.map(|color| layers.views(color, &places)).collect(),
            None => {
                let between = Interpolator::new(self.clone(), display);
                colors.map(|color| between.views(color, &places)).collect()
            }
        };
        Ok(Self { made: Some(made), ..self.with_made(grid, planes, depth) })
    }

    /// Returns the accuracy of layers of every second view for the views in between, and of interpolation, in dB of the
    /// brightest light. It returns `None` if there are no views in between.
    fn held_back(&self, display: &Display, depth: [f64; 2]) -> Result<Option<[f64; 2]>, SceneError> {
        let [rows, columns] = self.grid;
        if rows.is_multiple_of(2) || columns.is_multiple_of(2) {
            return Ok(None);
        }
        let is_inner = |i: usize, n: usize| n == 1 || !i.is_multiple_of(2);
        let all = 0..rows * columns;
        let inner: Vec<usize> =
            all.clone().filter(|v| is_inner(v / columns, rows) && is_inner(v % columns, columns)).collect();
        let kept = all.filter(|v| (v / columns).is_multiple_of(2) && (v % columns).is_multiple_of(2));
        let (own, cell) = (self.only(self.colors[0]), self.cell(display));
        let few = LightField {
            grid: [rows / 2 + 1, columns / 2 + 1],
            planes: vec![kept.map(|v| own.planes[0][v].clone()).collect()],
            view_pitch: Some(2.0 * cell),
            disparity: None,
            depth: Some(depth),
            ..own.clone()
        };
        let grid = ViewGrid { rows, columns, cell };
        let places: Vec<(f64, f64)> = inner.iter().map(|v| grid.position(*v)).collect();
        let made =
            [Layers::new(&few, display, depth)?.views(0, &places), Interpolator::new(few, display).views(0, &places)];
        let brightest = own.planes[0].iter().flatten().copied().fold(f32::MIN_POSITIVE, f32::max);
        let pixels = inner.len() * self.height * self.width;
        let db = |made: Vec<Vec<f32>>| {
            let truth = inner.iter().flat_map(|v| &own.planes[0][*v]);
            let error: f64 = truth.zip(made.iter().flatten()).map(|(a, b)| f64::from(a - b).powi(2)).sum();
            decibels(error, pixels, f64::from(brightest))
        };
        Ok(Some(made.map(db)))
    }
}
