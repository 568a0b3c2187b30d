//! Reads multi-plane images, which are pictures with transparency at distances of their own.
//!
//! The settings of the folder state the vergence of each picture, or of each layer of one EXR file. Views show the
//! pictures one in front of the other, each displaced by its depth.

use crate::formats::picture;
use crate::formats::tone::Reading;
use crate::light_field::light::FullScale;
use crate::read::pictures::Pictures;
use crate::read::single::enough_views;
use crate::read::views::{Frame, Read};
use crate::synthesis::given::{Layer, Places, views_of_layers};
use crate::{Order, OrderFound, Parallax, Request, SceneError, ViewGrid};
use eyebox_base::error::Reason;
use eyebox_base::files::{Pixels, Samples, Wanted, read_layers, read_pixels};
use eyebox_base::reason;
use eyebox_optics::{check_usual_depths, depth_of_dioptres};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Bytes of the pictures that are decoded together from one file.
const TOGETHER: usize = 512 << 20;

/// A multi-plane image in a folder.
pub(crate) struct Planes {
    pub pictures: Pictures,
    /// The layers of a single EXR file, if they are the pictures and not the files.
    pub layers: Option<Vec<u16>>,
    /// Vergence of each picture in diopters.
    pub dioptres: Vec<f64>,
}

/// A picture of the size of the display. Its light is multiplied by its opacity.
struct Opened {
    planes: Vec<Vec<f32>>,
    opacity: Vec<f32>,
}

impl Planes {
    /// Reads the pictures and makes views of them.
    pub fn read(&self, folder: &Path, request: &Request) -> Result<Read, SceneError> {
        let (own, display) = (self.pictures.size()?, request.display);
        let Pictures { stated, file, .. } = &self.pictures;
        let wrong = |reason: Reason| SceneError::Settings { file: file.display().to_string(), reason };
        let depths: Vec<f64> = self.dioptres.iter().map(|d| depth_of_dioptres(*d, display.focal_length)).collect();
        let depth = depths.iter().fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], z| [a.min(*z), b.max(*z)]);
        if !request.force {
            check_usual_depths(depth).map_err(|e| wrong(reason!("layers", "layers_dioptres: {e}")))?;
        }
        let n = if request.more_views { enough_views(folder, request, depth) } else { request.views };
        let frame = Frame::new(own, n * n + 2 * depths.len(), request)?;
        let reading = Reading::new(stated.tone);
        let opened = |path: &Path, image: &Pixels| -> Result<Opened, SceneError> {
            let light = picture::light(path, image, request.colors, &reading)?;
            let mut planes = frame.fit([light.planes, vec![opacity(image)]].concat());
            let opacity = planes.pop().unwrap_or_default();
            Ok(Opened { planes, opacity })
        };
        let read = match &self.layers {
            Some(layers) => layers_in(&self.pictures.paths[0], layers, own, opened)?,
            None => {
                let one = |path: &PathBuf| opened(path, &read_pixels(path, Wanted::Scene, picture::ONE)?);
                self.pictures.paths.par_iter().map(one).collect::<Result<Vec<_>, SceneError>>()?
            }
        };
        reading.judge(folder, FullScale::Folder)?;
        // Scaled pictures are unmultiplied again, because layers are given without their opacity.
        let bare: Vec<Opened> = read.into_iter().map(Opened::bare).collect();
        let mut order: Vec<usize> = (0..bare.len()).collect();
        order.sort_by(|a, b| depths[*a].total_cmp(&depths[*b]));
        let layers: Vec<Layer> = (order.iter())
            .map(|i| Layer {
                depth: depths[*i],
                planes: bare[*i].planes.iter().map(Vec::as_slice).collect(),
                opacity: &bare[*i].opacity,
            })
            .collect();
        let cell = request.view_pitch.unwrap_or_else(|| display.eyebox_min() / n as f64);
        let grid = ViewGrid { rows: n, columns: n, cell };
        let places: Vec<[f64; 2]> = (0..n * n).map(|view| grid.position(view).into()).collect();
        let per_metre = 1.0 / (display.focal_length * display.picture_pixel());
        let (rows, columns) = display.picture_size();
        let from = Places { places: &places, per_metre, size: [rows, columns] };
        let planes = views_of_layers(&layers, &from).map_err(wrong)?;
        let how = format!("{} layers from {:.3} to {:.3} D", layers.len(), self.least(), self.most());
        let bare_frame = frame.field(folder, [0, 0], Vec::new(), request, stated, None);
        let field = bare_frame.with_made(grid, planes, depth);
        let parallax = Parallax::of(&field);
        let transfer = self.pictures.transfer();
        let (order, order_found) = (Order::default(), OrderFound::AsNamed);
        Ok(Read { field, how, order, order_stated: true, order_found, parallax, cameras: None, size: own, transfer })
    }

    fn least(&self) -> f64 {
        self.dioptres.iter().copied().fold(f64::INFINITY, f64::min)
    }

    fn most(&self) -> f64 {
        self.dioptres.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    }
}

/// Reads layers of an EXR file of the size `own`, and makes a picture of each by `opened`.
fn layers_in(
    path: &Path,
    layers: &[u16],
    own: [usize; 2],
    opened: impl Fn(&Path, &Pixels) -> Result<Opened, SceneError> + Sync,
) -> Result<Vec<Opened>, SceneError> {
    // Red, green, blue and alpha in float32.
    let bytes = 16 * own[0] * own[1];
    let mut read = Vec::new();
    for together in layers.chunks((TOGETHER / bytes.max(1)).max(1)) {
        let images = read_layers(path, together, picture::ONE)?;
        let made: Result<Vec<Opened>, SceneError> = images.par_iter().map(|image| opened(path, image)).collect();
        read.extend(made?);
    }
    Ok(read)
}

impl Opened {
    fn bare(mut self) -> Self {
        for plane in &mut self.planes {
            plane.iter_mut().zip(&self.opacity).for_each(|(v, a)| *v = if *a > 1e-6 { *v / a } else { 0.0 });
        }
        self
    }
}

/// Returns the opacity of a picture, which is 1 without transparency.
fn opacity(image: &Pixels) -> Vec<f32> {
    let pixels = image.height * image.width;
    if !image.channels.is_multiple_of(2) {
        return vec![1.0; pixels];
    }
    let last = |i: usize| (i + 1) * image.channels - 1;
    let one = |i: usize| match &image.samples {
        Samples::U8(v) => f32::from(v[last(i)]) / 255.0,
        Samples::U16(v) => f32::from(v[last(i)]) / 65535.0,
        Samples::F32(v) => v[last(i)].clamp(0.0, 1.0),
    };
    (0..pixels).map(one).map(|v| if v.is_finite() { v } else { 0.0 }).collect()
}
