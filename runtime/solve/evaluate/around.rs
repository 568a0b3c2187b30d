//! Provides target images for a far field larger than memory, from views around a region or a pupil.
//!
//! The views are no larger and no more than the region or pupil needs.

use crate::engine::{Buffer, Engine, EngineError};
use crate::optics::{Color, Display, Optics, Pupil, WindowFactor};
use crate::plan::{self, Comparison, ModelTables, Planner, Purpose};
use crate::scene::{
    self, DepthSource, Interpolator, Layers, Pyramid, Reprojection, Request, SceneError, SplatViews, Stage, ViewGrid,
    ViewSynthesis, shrink_to_share,
};
use rayon::prelude::*;
use std::path::Path;
use std::sync::{Arc, OnceLock};

/// The largest number of views around a region, both axes together.
pub(crate) const MOST_VIEWS: usize = 81;
/// Pixels that content may move between neighboring views. Above it, more views are made.
const MAX_VIEW_STEP_PX: f64 = 1.5;
/// The largest number of views over the whole eyebox that are made once, both axes together. `MOST_BYTES` limits their
/// memory.
const MAX_CACHED_VIEWS: usize = 441;
const MOST_BYTES: u64 = 512 << 20;

/// A scene in one color of a far-field display, with views from any position.
pub struct Views {
    kind: Kind,
    optics: Optics,
    share: f64,
    /// The model of the display, and the model of its iris alone. They determine the piece and the window that a pupil
    /// needs.
    model: Option<[Arc<ModelTables>; 2]>,
    size: usize,
    /// Farthest and nearest depth in meters, and their source.
    reach: ([f64; 2], DepthSource),
    /// Relative movement in pixels of near and far content between neighboring views of a light field.
    apart: f64,
    held: u64,
    /// Number of views along each axis of the whole eyebox, if they are made [once](Views::once). It is 0 if they are
    /// made around each region.
    once: usize,
    /// The views of the whole eyebox and their positions.
    everywhere: OnceLock<(Arc<Pyramid>, ViewGrid)>,
}

enum Kind {
    /// Rendered around each region, with exact parallax over the whole eyebox.
    Stage(Box<Stage>),
    /// A light field with its own views, at the picture's size.
    Field(Arc<Pyramid>, ViewGrid),
    /// A light field with too large a distance between its views. Views between them are made around each region. The
    /// number is the index of the color.
    Between(Arc<Interpolator>, usize),
    /// A sparse light field that Fourier disparity layers represent well, with the index of the color and the PSNR in
    /// dB.
    Layers(Arc<Layers>, usize, f64),
    /// A picture with its depths, reprojected around each region.
    Picture(Arc<Reprojection>, Color),
    /// Splats, rendered around each region.
    Splats(Arc<SplatViews>, Color),
}

impl Views {
    /// Opens `source`, as for [`scene::load`], in each color of `request`, with pictures of at most `size` x `size`
    /// pixels. Pictures have no more pixels than the display's pictures, and show the field of view of its shortest
    /// wavelength. The colors share common data.
    ///
    /// # Errors
    /// Returns the errors of loading the scene.
    pub fn of_colors(source: &str, request: &Request, size: usize) -> Result<Vec<Self>, SceneError> {
        let size = size.min(request.display.picture_size().0);
        scene::check_map(source, request)?;
        let display = request.display;
        if let Some(name) = source.strip_prefix("builtin:").filter(|_| !scene::is_splats(source)) {
            let one = |&color: &Color| {
                let stage = Stage::new(name, display, color, size)?;
                let reach = (stage.depth(), DepthSource::Stated);
                Self::of(Kind::Stage(Box::new(stage)), display, color, size, reach)
            };
            return request.colors.iter().map(one).collect();
        }
        // Views that are smaller than the picture do not gain detail from a larger size.
        let native = scene::native_size(source)?.map_or(size, |[rows, columns]| rows.max(columns));
        let work = native.clamp(1, size);
        let small = small(display, work);
        let request = Request { display: &small, ..*request };
        // The colors share the data of `bytes`, so only the first color counts them.
        let shared = |reach, apart: f64, bytes: u64, kind: &dyn Fn(usize, Color) -> Kind| {
            let one = |(i, &color): (usize, &Color)| {
                let held = if i == 0 { bytes } else { 0 };
                Ok(Self { held, apart, ..Self::of(kind(i, color), display, color, work, reach)? })
            };
            request.colors.iter().enumerate().map(one).collect()
        };
        if scene::is_single(source)? {
            let picture = Arc::new(Reprojection::new(Path::new(source), &request)?);
            let reach = (picture.depth(), DepthSource::Stated);
            return shared(reach, 0.0, picture.bytes(), &|_, color| Kind::Picture(Arc::clone(&picture), color));
        }
        if scene::is_splats(source) {
            let splats = Arc::new(SplatViews::new(source, &request)?);
            let reach = (splats.depth(), DepthSource::Stated);
            return shared(reach, 0.0, splats.bytes(), &|_, color| Kind::Splats(Arc::clone(&splats), color));
        }
        let asked = request.photographs;
        let request = Request { photographs: ViewSynthesis::Cells, ..request };
        let load = |display, color| scene::load(source, &Request { display, colors: &[color], ..request });
        let Some((&first, others)) = request.colors.split_first() else { return Ok(Vec::new()) };
        let field = load(&small, first)?;
        let (reach, cell) = (field.reach(&small), field.cell(&small));
        let apart = field.aliasing(&small, reach.0);
        let depths = scene::asked_or_found(request.depth, || reach, small.focal_length);
        let forced = asked == ViewSynthesis::Layers;
        let layers = match depths {
            Err(error) if forced => return Err(error),
            Ok(depths) if forced || asked == ViewSynthesis::Auto && apart > MAX_VIEW_STEP_PX => {
                let layers = Layers::new(&field, &small, depths)?;
                let shown = layers.residual_between();
                Some((layers, shown))
            }
            _ => None,
        };
        if let Some((mut layers, shown)) = layers.filter(|(_, shown)| forced || *shown >= scene::ENOUGH) {
            for &color in others {
                layers = layers.with(&load(&small, color)?, &small);
            }
            let layers = Arc::new(layers);
            return shared(reach, apart, layers.bytes(), &|i, _| Kind::Layers(Arc::clone(&layers), i, shown));
        }
        let mut between = Interpolator::new(field, &small);
        if asked == ViewSynthesis::Between || asked != ViewSynthesis::Cells && between.parallax(cell) > MAX_VIEW_STEP_PX
        {
            for &color in others {
                between.add(load(&small, color)?);
            }
            let between = Arc::new(between);
            return shared(reach, apart, between.bytes(), &|i, _| Kind::Between(Arc::clone(&between), i));
        }
        drop(between);
        let small = self::small(display, size);
        let one = |&color: &Color| {
            let field = load(&small, color)?;
            let grid = ViewGrid { rows: field.grid[0], columns: field.grid[1], cell };
            let share = display.picture_share(display.optics(color)?.wavelength);
            let pyramid = Arc::new(pyramid(&field.planes[0], size, share));
            Ok(Self { apart, ..Self::of(Kind::Field(pyramid, grid), display, color, size, reach)? })
        };
        request.colors.iter().map(one).collect()
    }

    fn of(
        kind: Kind,
        display: &Display,
        color: Color,
        size: usize,
        reach: ([f64; 2], DepthSource),
    ) -> Result<Self, SceneError> {
        let optics = display.optics(color)?;
        let share = display.picture_share(optics.wavelength);
        let model = ModelTables::of(display, color, optics, optics).map(|model| [model.for_pieces(), model.iris()]);
        let everywhere = OnceLock::new();
        Ok(Self { kind, optics, share, model, size, reach, apart: 0.0, held: 0, once: 0, everywhere })
    }

    /// Returns the same views for use around many regions. If a measured light field has too large a distance between
    /// its views, the views between them are made once for the whole eyebox, at the first request, unless there are too
    /// many.
    pub(crate) fn once(self) -> Self {
        let n = self.wanted(self.extent()).max(3);
        let few = n * n <= MAX_CACHED_VIEWS && self.bytes_of(n) <= MOST_BYTES;
        let measured = matches!(self.kind, Kind::Between(..) | Kind::Layers(..));
        Self { once: if few && measured { n } else { 0 }, ..self }
    }

    /// Returns the bytes of a pyramid of `n` x `n` views.
    fn bytes_of(&self, n: usize) -> u64 {
        (n * n * self.size * self.size) as u64 * 8 / 3
    }

    /// Returns the larger side of the SLM, in whose plane the pupil is, in meters.
    fn extent(&self) -> f64 {
        self.optics.height.max(self.optics.width) as f64 * self.optics.pitch
    }

    /// Returns the number of views along an axis that cover `extent` meters without gaps. It is odd, so that one is in
    /// the middle.
    fn wanted(&self, extent: f64) -> usize {
        let parallax = match &self.kind {
            Kind::Field(..) => 0.0,
            Kind::Stage(stage) => stage.parallax(extent),
            Kind::Between(between, _) => between.parallax(extent),
            Kind::Layers(layers, ..) => layers.parallax(extent),
            Kind::Picture(picture, _) => picture.parallax(extent),
            Kind::Splats(splats, _) => splats.parallax(extent),
        };
        (parallax / MAX_VIEW_STEP_PX).ceil() as usize | 1
    }

    /// Returns the optics of the whole SLM in that color.
    pub fn optics(&self) -> &Optics {
        &self.optics
    }

    /// Returns the number of pixels along each axis of a picture.
    pub fn size(&self) -> usize {
        self.size
    }

    /// Returns the share of the field of view that the picture takes (OPTICS 9).
    pub fn share(&self) -> f64 {
        self.share
    }

    /// Returns the farthest and nearest relevant depth in meters, as requested, as stated by the scene, or as
    /// shown by its views.
    ///
    /// # Errors
    /// Returns [`SceneError::Request`] if nothing is requested or stated, and the views show too little.
    pub fn depths(&self, asked: Option<[f64; 2]>) -> Result<[f64; 2], SceneError> {
        scene::asked_or_found(asked, || self.reach, self.optics.focal_length)
    }

    /// Returns a description of the origin of its views.
    pub fn in_words(&self) -> String {
        let apart = format!("its own, between which near and far move by {:.1} pixels", self.apart);
        let made = match self.once {
            0 => "around each region".to_owned(),
            n => format!("once, {n} x {n} over all of the SLM"),
        };
        match &self.kind {
            Kind::Stage(_) | Kind::Splats(..) => "rendered around each region".into(),
            Kind::Picture(..) => "the picture, reprojected around each region".into(),
            Kind::Field(_, grid) => format!("{} x {}, {apart}", grid.rows, grid.columns),
            Kind::Between(..) => format!("interpolated between {apart}, made {made}"),
            Kind::Layers(layers, _, shown) => {
                let count = layers.count();
                let shown = format!("which show a view between its own at {shown:.1} dB");
                format!("from {count} Fourier disparity layers, {shown}, made {made} from {apart}")
            }
        }
    }

    /// Returns the bytes of a solve in addition to the plan of a region, which are the views from which others are
    /// made.
    pub fn held(&self) -> u64 {
        self.held + self.bytes_of(self.once)
    }

    /// Returns the views from a square of `extent` meters around `center` (x, y), and their positions.
    pub fn around(&self, center: [f64; 2], extent: f64) -> (Arc<Pyramid>, plan::ViewLayout) {
        if let Kind::Field(pyramid, grid) = &self.kind {
            return (Arc::clone(pyramid), plan::ViewLayout::new(*grid, pyramid));
        }
        if self.once > 0 {
            let (pyramid, grid) = self.everywhere.get_or_init(|| self.made([0.0, 0.0], self.extent(), self.once));
            return (Arc::clone(pyramid), plan::ViewLayout::new(*grid, pyramid));
        }
        let most = (MOST_VIEWS as f64).sqrt() as usize;
        let (pyramid, grid) = self.made(center, extent, self.wanted(extent).clamp(3, most));
        let views = plan::ViewLayout::new(grid, &pyramid).centered_at(center);
        (pyramid, views)
    }

    /// Returns `n` x `n` views of a square of `extent` meters around `center`.
    fn made(&self, center: [f64; 2], extent: f64, n: usize) -> (Arc<Pyramid>, ViewGrid) {
        let grid = ViewGrid { rows: n, columns: n, cell: extent / n as f64 };
        let place = |i| {
            let (x, y) = grid.position(i);
            (x + center[0], y + center[1])
        };
        let places: Vec<(f64, f64)> = (0..n * n).map(place).collect();
        let views = match &self.kind {
            Kind::Field(..) => Vec::new(),
            Kind::Stage(stage) => stage.views(&places),
            Kind::Between(between, color) => between.views(*color, &places),
            Kind::Layers(layers, color, _) => layers.views(*color, &places),
            Kind::Picture(picture, color) => picture.views(*color, &places),
            Kind::Splats(splats, color) => splats.views(*color, &places),
        };
        (Arc::new(pyramid(&views, self.size, self.share)), grid)
    }
}

impl Views {
    /// Returns the piece of the SLM that a pupil sees.
    pub(crate) fn piece(&self, pupil: &Pupil) -> Optics {
        let (at, size) = ModelTables::under(self.model.as_ref().map(|[model, _]| &**model), &self.optics, pupil);
        self.optics.piece(at, size)
    }

    /// Returns the target image in the samples of a pupil's window on `grid`, which is the far-field SLM or a piece of
    /// it. The axis comes first.
    ///
    /// # Errors
    /// Returns the errors of the engine.
    pub(crate) fn photograph(
        &self,
        grid: &Optics,
        pupil: &Pupil,
        factor: WindowFactor,
        engine: &mut dyn Engine,
    ) -> Result<Vec<f32>, EngineError> {
        let (pyramid, seen) = self.around([pupil.x, pupil.y], pupil.diameter);
        let model = self.model.as_ref().map(|[_, iris]| Arc::clone(iris));
        let planner = Planner { views: Some(seen), model, ..Planner::new(*grid, 1, factor) };
        let step = planner.photograph_step(vec![planner.pupil_pass(pupil, &Comparison::default())]);
        engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&pyramid)))?;
        engine.run(&step)?;
        engine.read(Buffer::Target(0))
    }
}

/// Returns a display with the same eyebox and field of view in fewer, larger pixels. The scene is loaded for it.
fn small(display: &Display, size: usize) -> Display {
    let rate = size as f64 / display.picture_size().0 as f64;
    // The eyebox is pixels times pitch, and the field of view is wavelength times f over pitch. Both are unchanged. So
    // are depths, because they are given in the picture's pixels.
    let pitch = display.pitch / rate;
    let (focal_length, shortest) = (display.focal_length, 1.0 / rate);
    let wavelengths = (display.wavelengths.iter())
        .map(|w| crate::optics::Wavelength { wavelength: w.wavelength * shortest, ..*w })
        .collect();
    Display { height: size, width: size, pitch, focal_length, wavelengths, ..display.clone() }
}

fn pyramid(views: &[Vec<f32>], size: usize, share: f64) -> Pyramid {
    if share >= 1.0 {
        return Pyramid::new(views, size, size);
    }
    let shrunk: Vec<Vec<f32>> = views.par_iter().map(|v| shrink_to_share(v, size, size, share)).collect();
    Pyramid::new(&shrunk, size, size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::cpu::CpuEngine;
    use crate::files::write_png;

    const SIZE: usize = 160;

    fn display() -> Display {
        Display { height: 640, width: 640, ..Display::preset("far-field").unwrap() }
    }

    /// Returns a folder of `n` x `n` views of a built-in scene.
    fn folder(n: usize) -> tempfile::TempDir {
        let (here, small) = (tempfile::tempdir().unwrap(), small(&display(), SIZE));
        let request = Request { views: n, ..Request::new(&small, &[Color::Green]) };
        let field = scene::load("builtin:still-life", &request).unwrap();
        for (i, view) in field.planes[0].iter().enumerate() {
            write_png(&here.path().join(format!("view_{i:03}.png")), SIZE, SIZE, &[view]).unwrap();
        }
        let [low, high] = field.disparity.unwrap();
        std::fs::write(here.path().join("lightfield.toml"), format!("disparity = [{low}, {high}]\n")).unwrap();
        here
    }

    fn psnr(a: &[f32], b: &[f32]) -> f64 {
        let error: f64 = a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        -10.0 * (error / a.len() as f64).log10()
    }

    /// Target images from few views of a scene equal those from the scene itself, in sign and scale, from the whole
    /// eyebox.
    #[test]
    fn a_sparse_folder_is_photographed_like_its_scene() {
        let (few, many, display) = (folder(4), folder(11), display());
        let request = Request::new(&display, &[Color::Green]);
        let asked = |source: &str, photographs| {
            Views::of_colors(source, &Request { photographs, ..request }, SIZE).unwrap().remove(0)
        };
        let views = |source: &str| asked(source, ViewSynthesis::Auto);
        let few = few.path().to_str().unwrap();
        let (exact, sparse) = (views("builtin:still-life"), asked(few, ViewSynthesis::Between));
        let layered = asked(few, ViewSynthesis::Layers);
        assert!(matches!(sparse.kind, Kind::Between(..)) && sparse.held() > 0);
        assert!(matches!(layered.kind, Kind::Layers(..)) && layered.held() > 0);
        assert!(matches!(views(many.path().to_str().unwrap()).kind, Kind::Field(..)), "dense enough as it is");
        let (far, near) = (exact.depths(None).unwrap(), sparse.depths(None).unwrap());
        assert!((0..2).all(|i| (far[i] - near[i]).abs() < 0.02 * far[i].abs()), "{far:?} {near:?}");
        let once = asked(few, ViewSynthesis::Between).once();
        let of_layers = asked(few, ViewSynthesis::Layers).once();
        assert!(once.held() > sparse.held() && of_layers.held() > layered.held());
        let words = [&exact, &sparse, &once, &of_layers, &views(many.path().to_str().unwrap())].map(Views::in_words);
        assert!((1..5).all(|i| !words[..i].contains(&words[i])) && words[4].contains("11 x 11"), "{words:#?}");
        let seen = [[0.0, 0.0], [1e-4, -2e-4]].map(|center| once.around(center, display.eyebox_min() / 4.0).0);
        assert!(Arc::ptr_eq(&seen[0], &seen[1]), "made once");
        let (optics, mut engine) = (display.optics(Color::Green).unwrap(), CpuEngine::new());
        let reach = display.eyebox_min() / 2.0;
        for (x, y, z) in [(0.0, 0.0, 0.0), (0.6, -0.5, 0.8), (-0.8, 0.7, -0.9)] {
            let pupil = Pupil { x: x * reach, y: y * reach, diameter: 0.4 * reach, depth: z * far[1] };
            let (at, size) = optics.under(&pupil);
            let piece = optics.piece(at.map(|i| i as i64), size);
            let mut shot = |views: &Views| views.photograph(&piece, &pupil, WindowFactor::One, &mut engine).unwrap();
            let want = shot(&exact);
            let all = [&sparse, &layered, &once, &of_layers].map(|views| psnr(&want, &shot(views)));
            assert!(all.iter().all(|db| *db > 34.0), "{all:.2?} dB through {pupil:?}");
        }
    }

    /// A depth that is not stated is not taken as 0, because the views show it.
    #[test]
    fn depths_that_are_not_stated_are_measured() {
        let (here, display) = (folder(5), display());
        std::fs::remove_file(here.path().join("lightfield.toml")).unwrap();
        let request = Request::new(&display, &[Color::Green]);
        let views = |source: &str| Views::of_colors(source, &request, SIZE).unwrap().remove(0);
        let (truth, silent) = (views("builtin:still-life"), views(here.path().to_str().unwrap()));
        let ([far, near], [a, b]) = (truth.depths(None).unwrap(), silent.depths(None).unwrap());
        let within = |found: f64, is: f64| (found - is).abs() < 0.1 * (near - far);
        assert!(within(a, far) && within(b, near), "{a} to {b} m of {far} to {near}");
        assert_eq!(silent.depths(Some([1e-3, -2e-3])).unwrap(), [-2e-3, 1e-3]);
        let files = std::fs::read_dir(here.path()).unwrap().map(|e| e.unwrap().path());
        files.for_each(|file| write_png(&file, SIZE, SIZE, &[&vec![0.5; SIZE * SIZE]]).unwrap());
        assert_eq!(views(here.path().to_str().unwrap()).depths(None).unwrap(), [0.0, 0.0], "nothing is seen in them");
    }

    /// A picture with its depths, from around a region, equals the picture from the whole eyebox.
    #[test]
    fn a_picture_with_depths_is_seen_from_around_a_region() {
        let (here, display) = (tempfile::tempdir().unwrap(), display());
        let at = |x: usize, y: usize| 0.5 + 0.4 * ((x as f32 * 0.7).sin() * (y as f32 * 0.5).cos());
        let picture: Vec<f32> = (0..SIZE * SIZE).map(|i| at(i % SIZE, i / SIZE)).collect();
        let map: Vec<f32> = (0..SIZE * SIZE).map(|i| (i % SIZE) as f32 / SIZE as f32).collect();
        let (file, depth) = (here.path().join("picture.png"), here.path().join("depth.png"));
        write_png(&file, SIZE, SIZE, &[&picture, &picture, &picture]).unwrap();
        write_png(&depth, SIZE, SIZE, &[&map]).unwrap();
        let request = Request { depth_map: Some(&depth), ..Request::new(&display, &[Color::Green]) };
        let source = file.to_str().unwrap();
        let views = Views::of_colors(source, &request, SIZE).unwrap().remove(0);
        let small = small(&display, SIZE);
        let field = scene::load(source, &Request { display: &small, ..request }).unwrap();
        let Kind::Picture(made, color) = &views.kind else { panic!("not a picture") };
        let grid = ViewGrid { rows: 9, columns: 9, cell: field.cell(&small) };
        for index in [0, 30, 80] {
            let one = made.views(*color, &[grid.position(index)]).remove(0);
            assert!(psnr(&one, &field.planes[0][index]) > 35.0, "view {index}");
        }
        let (_, seen) = views.around([1e-4, -2e-4], display.eyebox_min() / 4.0);
        assert!(seen.center == [1e-4, -2e-4] && seen.grid.rows >= 3);
    }
}
