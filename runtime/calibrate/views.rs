//! Holds the pictures and predicts them from a model.

use super::captures::picture_of;
use super::device::{Device, Set};
use super::error::CalibrateError;
use super::map::CameraMap;
use super::parameters::{Parameter, Parameters};
use super::pattern::Pattern;
use super::picture::Picture;
use super::seen::{Look, Prediction};
use eyebox_kernels::Complex64;
use eyebox_optics::{Optics, Pupil, SlmPart};
use rayon::prelude::*;
use std::path::PathBuf;

/// The compared pixels of a picture.
pub(super) struct View {
    pub(super) set: usize,
    /// For each part of the SLM, the pixels that look at it, and the index of the window of the iris.
    pub(super) looks: Vec<(Look, usize)>,
    /// Counts of the pixels, 1 at full scale, part by part.
    pub(super) counts: Vec<f64>,
    pub(super) variance: Vec<f64>,
    /// Variance of the light over the picture, counts squared. Errors of the model scale with it.
    pub(super) signal: f64,
    pub(super) exposure_ms: f64,
    pub(super) full_scale: f64,
    pub(super) file: PathBuf,
}

impl View {
    /// The iris as it was requested.
    pub(super) fn pupil(&self) -> Pupil {
        self.looks[0].0.pupil
    }

    pub(super) fn picture(&self, camera: [usize; 2]) -> Result<Picture, CalibrateError> {
        picture_of(&self.file, self.full_scale, camera)
    }

    pub(super) fn file_name(&self) -> String {
        self.file.file_name().unwrap_or_default().to_string_lossy().into_owned()
    }

    /// The pixels (x, y), part by part.
    pub(super) fn pixels(&self) -> impl Iterator<Item = [f64; 2]> {
        self.looks.iter().flat_map(|(look, _)| look.pixels.iter().copied())
    }
}

/// The pattern on the whole SLM, and by part.
pub(super) struct PatternSet {
    pub(super) pattern: Pattern,
    pub(super) parts: Vec<Set>,
}

/// The pictures, and the patterns that were shown for them.
pub(super) struct Pictures {
    pub(super) optics: Optics,
    /// The simulated parts of the SLM.
    pub(super) parts: Vec<SlmPart>,
    pub(super) sets: Vec<PatternSet>,
    pub(super) views: Vec<View>,
    /// The dark level of the camera, counts.
    pub(super) dark: f64,
}

/// The look at a part and the light that enters its iris, by sub-frame, then by parameter and sub-frame.
type Entering<'a> = (&'a Look, &'a [&'a [Complex64]], &'a [Vec<&'a [Complex64]>]);

impl Pictures {
    /// True if the whole SLM is simulated, as one part.
    pub(super) fn are_whole(&self) -> bool {
        self.parts.len() == 1
    }

    /// Calls `of` for each of these views, part by part. The light that leaves a set's pixels is computed once for all
    /// of its views.
    fn each<T: Send>(
        &self,
        (at, subpixels): (&Parameters, usize),
        free: &[Parameter],
        which: &[usize],
        of: impl Fn(Entering<'_>) -> T + Sync,
    ) -> Vec<Vec<T>> {
        let mut sets: Vec<usize> = which.iter().map(|v| self.views[*v].set).collect();
        sets.sort_unstable();
        sets.dedup();
        let of_part = |part: usize| {
            let device = Device::new(&at.model, self.parts[part], &self.optics, subpixels);
            let further = device.all_further(at, free);
            let of_set = |&set: &usize| {
                let (fields, by) = device.enter(&self.sets[set].parts[part], &further);
                let places: Vec<usize> = (0..which.len()).filter(|i| self.views[which[*i]].set == set).collect();
                let of_view = |i: usize| {
                    let (look, window) = &self.views[which[i]].looks[part];
                    let entering: Vec<_> = fields.iter().map(|frame| &frame[*window][..]).collect();
                    let by: Vec<Vec<_>> =
                        by.iter().map(|frames| frames.iter().map(|frame| &frame[*window][..]).collect()).collect();
                    ((i, part), of((look, &entering, &by)))
                };
                places.into_par_iter().map(of_view).collect::<Vec<_>>()
            };
            sets.par_iter().flat_map(of_set).collect::<Vec<_>>()
        };
        let mut all: Vec<((usize, usize), T)> = (0..self.parts.len()).into_par_iter().flat_map(of_part).collect();
        all.sort_by_key(|(place, _)| *place);
        let mut views: Vec<Vec<T>> = which.iter().map(|_| Vec::new()).collect();
        all.into_iter().for_each(|((i, _), of_view)| views[i].push(of_view));
        views
    }

    /// The prediction of each of these views, with slopes.
    pub(super) fn see(
        &self,
        at: &Parameters,
        subpixels: usize,
        which: &[usize],
        free: &[Parameter],
    ) -> Vec<Prediction> {
        let of_device: Vec<Parameter> = free.iter().copied().filter(|p| p.is_of_device()).collect();
        let parts = self.each((at, subpixels), &of_device, which, |(look, entering, by)| {
            let mut by = by.iter();
            let of_parameter = |p: &Parameter| match p.is_of_device() {
                true => by.next().cloned().unwrap_or_default(),
                false => Vec::new(),
            };
            look.see(at, entering, free, &free.iter().map(of_parameter).collect::<Vec<_>>())
        });
        parts.into_iter().map(Prediction::joined).collect()
    }

    /// The prediction of each of these views for other maps of the camera, by view, then by map.
    pub(super) fn see_from(
        &self,
        at: &Parameters,
        subpixels: usize,
        which: &[usize],
        cameras: &[CameraMap],
    ) -> Vec<Vec<Prediction>> {
        let parts = self.each((at, subpixels), &[], which, |(look, entering, _)| look.see_from(at, entering, cameras));
        let by_camera = |parts: Vec<Vec<Vec<f64>>>| -> Vec<Prediction> {
            let of_camera = |camera: usize| {
                let intensity = parts.iter().flat_map(|cameras| cameras[camera].iter().copied()).collect();
                Prediction { intensity, slopes: Vec::new() }
            };
            (0..cameras.len()).map(of_camera).collect()
        };
        parts.into_iter().map(by_camera).collect()
    }

    /// The prediction of a view at other camera pixels (x, y), for any place of the SLM.
    pub(super) fn see_places(&self, at: &Parameters, subpixels: usize, view: usize, places: &[[f64; 2]]) -> Vec<f64> {
        let (of_view, slm) = (&self.views[view], SlmPart::from([self.optics.height, self.optics.width]));
        let radius = of_view.looks[0].0.radius;
        let look = Look::new((slm, &self.optics), of_view.pupil(), radius, at, places.to_vec());
        let set = Set { pattern: self.sets[of_view.set].pattern.clone(), windows: vec![look.window.clone()] };
        let (fields, _) = Device::new(&at.model, slm, &self.optics, subpixels).enter(&set, &[]);
        let entering: Vec<_> = fields.iter().map(|frame| &frame[0][..]).collect();
        look.see(at, &entering, &[], &[]).intensity
    }
}
