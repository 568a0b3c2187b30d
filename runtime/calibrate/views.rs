//! Pictures, and what a model predicts of them.

use super::device::{Device, Further, Set};
use super::map::CameraMap;
use super::parameters::{Parameter, Parameters};
use super::seen::{Look, Seen};
use eyebox_kernels::Complex64;
use eyebox_optics::Optics;
use rayon::prelude::*;
use std::path::PathBuf;

/// A picture's pixels that are compared.
pub(super) struct View {
    /// Which set, and which of its windows.
    pub(super) set: usize,
    pub(super) window: usize,
    pub(super) look: Look,
    /// Counts, 1 at full scale.
    pub(super) counts: Vec<f64>,
    /// Their variance by the camera's noise.
    pub(super) variance: Vec<f64>,
    /// Variance of the light over the picture, counts: what errors of the model scale with.
    pub(super) signal: f64,
    pub(super) exposure_ms: f64,
    pub(super) full_scale: f64,
    /// Its picture's file.
    pub(super) file: PathBuf,
}

/// Pictures, and what was shown for them.
pub(super) struct Pictures {
    pub(super) optics: Optics,
    pub(super) sets: Vec<Set>,
    pub(super) views: Vec<View>,
    /// The camera's dark level, counts.
    pub(super) dark: f64,
}

impl Pictures {
    /// Something of each of these views and of what enters its iris: by sub-frame, and by `further` and sub-frame. What leaves a set's
    /// pixels is computed once for all of its views.
    fn each<T: Send>(
        &self,
        device: &Device,
        further: &[Further],
        which: &[usize],
        of: impl Fn(&View, &[&[Complex64]], &[Vec<&[Complex64]>]) -> T + Sync,
    ) -> Vec<T> {
        let mut sets: Vec<usize> = which.iter().map(|v| self.views[*v].set).collect();
        sets.sort_unstable();
        sets.dedup();
        let of_set = |&set: &usize| {
            let (fields, by) = device.enter(&self.sets[set], further);
            let places: Vec<usize> = (0..which.len()).filter(|i| self.views[which[*i]].set == set).collect();
            let of_view = |i: usize| {
                let view = &self.views[which[i]];
                let entering: Vec<_> = fields.iter().map(|frame| &frame[view.window][..]).collect();
                let by: Vec<Vec<_>> =
                    by.iter().map(|frames| frames.iter().map(|frame| &frame[view.window][..]).collect()).collect();
                (i, of(view, &entering, &by))
            };
            places.into_par_iter().map(of_view).collect::<Vec<_>>()
        };
        let mut all: Vec<(usize, T)> = sets.par_iter().flat_map(of_set).collect();
        all.sort_by_key(|(i, _)| *i);
        all.into_iter().map(|(_, of_view)| of_view).collect()
    }

    /// What the model predicts of each of these views, with slopes.
    pub(super) fn see(&self, at: &Parameters, subpixels: usize, which: &[usize], free: &[Parameter]) -> Vec<Seen> {
        let device = Device::new(&at.model, self.optics, subpixels);
        let of_device: Vec<Parameter> = free.iter().copied().filter(|p| p.is_of_device()).collect();
        let further = device.all_further(at, &of_device);
        self.each(&device, &further, which, |view, entering, by| {
            let mut by = by.iter();
            let of_parameter = |p: &Parameter| match p.is_of_device() {
                true => by.next().cloned().unwrap_or_default(),
                false => Vec::new(),
            };
            view.look.see(at, entering, free, &free.iter().map(of_parameter).collect::<Vec<_>>())
        })
    }

    /// What the model predicts of each of these views for cameras that look elsewhere: by view, then camera.
    pub(super) fn see_from(
        &self,
        at: &Parameters,
        subpixels: usize,
        which: &[usize],
        cameras: &[CameraMap],
    ) -> Vec<Vec<Seen>> {
        let of_camera = |intensity| Seen { intensity, slopes: Vec::new() };
        self.each(&Device::new(&at.model, self.optics, subpixels), &[], which, |view, entering, _| {
            view.look.see_from(at, entering, cameras).into_iter().map(of_camera).collect()
        })
    }

    /// What the model predicts of a view at other camera pixels (x, y).
    pub(super) fn see_places(&self, at: &Parameters, subpixels: usize, view: usize, places: &[[f64; 2]]) -> Seen {
        let device = Device::new(&at.model, self.optics, subpixels);
        self.each(&device, &[], &[view], |view, entering, _| view.look.of(places.to_vec()).see(at, entering, &[], &[]))
            .swap_remove(0)
    }
}
