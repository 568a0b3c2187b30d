//! Pictures, and what a model predicts of them.

use super::device::{Device, Set};
use super::map::CameraMap;
use super::parameters::{Parameter, Parameters};
use super::seen::{Look, Seen};
use crate::optics::Optics;
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
    /// What the model predicts of each of these views, with slopes.
    pub(super) fn see(&self, at: &Parameters, subpixels: usize, which: &[usize], free: &[Parameter]) -> Vec<Seen> {
        let device = Device::new(&at.model, self.optics, subpixels);
        let mut sets: Vec<usize> = which.iter().map(|v| self.views[*v].set).collect();
        sets.sort_unstable();
        sets.dedup();
        let of_device: Vec<Parameter> = free.iter().copied().filter(|p| p.is_of_device()).collect();
        let further = device.all_further(at, &of_device);
        let seen: Vec<Vec<(usize, Seen)>> = sets
            .par_iter()
            .map(|&set| {
                let (fields, by) = device.enter(&self.sets[set], &further);
                let views: Vec<usize> = which.iter().copied().filter(|v| self.views[*v].set == set).collect();
                views
                    .into_par_iter()
                    .map(|v| {
                        let window = self.views[v].window;
                        let entering: Vec<_> = fields.iter().map(|frame| &frame[window][..]).collect();
                        let mut device = by.iter();
                        let by: Vec<Vec<_>> = free
                            .iter()
                            .map(|p| match p.is_of_device() {
                                true => device.next().into_iter().flatten().map(|frame| &frame[window][..]).collect(),
                                false => Vec::new(),
                            })
                            .collect();
                        (v, self.views[v].look.see(at, &entering, free, &by))
                    })
                    .collect()
            })
            .collect();
        let mut all: Vec<(usize, Seen)> = seen.into_iter().flatten().collect();
        let order = |v: usize| which.iter().position(|w| *w == v);
        all.sort_by_key(|(v, _)| order(*v));
        all.into_iter().map(|(_, seen)| seen).collect()
    }

    /// What the model predicts of each of these views for cameras that look elsewhere: by view, then camera.
    pub(super) fn see_from(
        &self,
        at: &Parameters,
        subpixels: usize,
        which: &[usize],
        cameras: &[CameraMap],
    ) -> Vec<Vec<Seen>> {
        let device = Device::new(&at.model, self.optics, subpixels);
        let mut seen: Vec<Option<Vec<Seen>>> = which.iter().map(|_| None).collect();
        let mut sets: Vec<usize> = which.iter().map(|v| self.views[*v].set).collect();
        sets.sort_unstable();
        sets.dedup();
        for set in sets {
            let (fields, _) = device.enter(&self.sets[set], &[]);
            seen.par_iter_mut().zip(which).filter(|(_, v)| self.views[**v].set == set).for_each(|(seen, v)| {
                let View { window, look, .. } = &self.views[*v];
                let entering: Vec<_> = fields.iter().map(|frame| &frame[*window][..]).collect();
                let of_camera = |intensity| Seen { intensity, slopes: Vec::new() };
                *seen = Some(look.see_from(at, &entering, cameras).into_iter().map(of_camera).collect());
            });
        }
        seen.into_iter().flatten().collect()
    }

    /// What the model predicts of a view at other camera pixels (x, y).
    pub(super) fn see_places(&self, at: &Parameters, subpixels: usize, view: usize, places: &[[f64; 2]]) -> Seen {
        let View { set, window, look, .. } = &self.views[view];
        let (fields, _) = Device::new(&at.model, self.optics, subpixels).enter(&self.sets[*set], &[]);
        let entering: Vec<_> = fields.iter().map(|frame| &frame[*window][..]).collect();
        look.of(places.to_vec()).see(at, &entering, &[], &[])
    }
}
