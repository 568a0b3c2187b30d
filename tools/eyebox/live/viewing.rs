//! `--view`: what the tracked eye sees, in a window beside the display.

use super::subject::Steered;
use crate::view::padding_of;
use crate::{Failure, common};
use eyebox::gpu::Gpu;
use eyebox::hologram::Hologram;
use eyebox::live::{Live, Made};
use eyebox::optics::{Padding, Pupil};
use eyebox::present::{Desktop, WindowEvent, WindowKey};
use eyebox::preview::{
    Look, Overlay, Picture, PreviewError, PreviewWindow, Showing, Shown, Side, Viewer, places, pupil_at,
};
use eyebox::trackers::mouse::MouseHandle;
use std::sync::Arc;

/// The window and its viewer.
pub struct Viewing {
    window: PreviewWindow,
    viewer: Viewer,
    frames: usize,
    padding: Padding,
    eyebox: f64,
    size: [usize; 2],
    colors: Vec<Shown>,
    mouse: Option<MouseHandle>,
    seen: Option<(Picture, Option<f64>)>,
    overlay: Overlay,
    pupil: Option<Pupil>,
}

const HELP: &str = "s: steering on or off   q, Esc: close";

impl Viewing {
    /// Opens it. `mouse` is told where the mouse points, if that is the tracker.
    pub fn open(
        gpu: &Gpu,
        desktop: &mut Desktop,
        steered: &Steered,
        engine: &crate::args::EngineArgs,
        mouse: Option<MouseHandle>,
    ) -> Result<Self, Failure> {
        let hologram: &Hologram = &steered.hologram;
        let showing = Showing::new(hologram.clone(), padding_of(hologram))?;
        let problems: Vec<_> = steered.parts.iter().map(|p| p.problem.clone()).collect();
        let size = showing.size();
        // Small ones by a whole number.
        let zoom = (640 / size[0].max(size[1]).max(1)).max(1);
        let viewer = Viewer::start(common::opener(engine)?, problems)?;
        let window = PreviewWindow::open(gpu, desktop, &hologram.scene, size.map(|n| n * zoom))?;
        let eyebox = showing.eyebox;
        let (frames, padding, colors) = (showing.frames, showing.padding, showing.colors.clone());
        let (seen, overlay, pupil) = (None, Overlay::default(), None);
        let mut viewing = Self { window, viewer, frames, padding, eyebox, size, colors, mouse, seen, overlay, pupil };
        viewing.viewer.show(Arc::new(showing));
        Ok(viewing)
    }

    /// Another set is on the display.
    pub fn made(&mut self, made: &Made) {
        let Some(phases) = &made.phases else { return };
        for (color, phases) in self.colors.iter_mut().zip(phases) {
            color.phases = Arc::clone(phases);
        }
        let Self { frames, padding, eyebox, .. } = *self;
        let colors = self.colors.clone();
        self.viewer.show(Arc::new(Showing { frames, padding, colors, eyebox, tiles: None }));
    }

    /// Where the eye is now.
    pub fn look(&mut self, pupil: Pupil) {
        self.pupil = Some(pupil);
    }

    /// Takes what the user did, and shows what is new; false once it is closed. Nothing of it waits.
    pub fn tend(&mut self, live: &Live, note: &str) -> Result<bool, Failure> {
        let gone = |error: PreviewError| Failure::Lost(format!("the view's window: {error}"));
        while let Some(event) = self.window.event() {
            match event {
                WindowEvent::Close | WindowEvent::Key(WindowKey::Escape | WindowKey::Character('q')) => {
                    return Ok(false);
                }
                WindowEvent::Key(WindowKey::Character('s')) => live.steer(!live.is_steered()),
                WindowEvent::Pointer(position) => {
                    if let Some(mouse) = &self.mouse {
                        mouse.push(pupil_at(position, &places(self.window.size(), self.size, 1), self.eyebox));
                    }
                }
                _ => {}
            }
        }
        let place = places(self.window.size(), self.size, 1)[0];
        if let Some(pupil) = self.pupil.take() {
            let within = [place.height, place.width];
            self.viewer.look(Look { pupil, frame: None, side: Side::Seen, within });
        }
        let new = self.viewer.newest().map_err(gone)?;
        let steered = if live.is_steered() { "steered" } else { "not steered" };
        let mut changed = false;
        if let Some(new) = new {
            let db = new.psnr_db.map_or(String::new(), |db| format!(", {db:.1} dB"));
            let pupil = new.look.pupil;
            let place =
                format!("pupil {:.1}, {:.1} mm, {:.1} mm wide", pupil.x * 1e3, pupil.y * 1e3, pupil.diameter * 1e3);
            self.window.title(&format!("{steered}{db}; {place}; {note}"));
            let map = [pupil.x, pupil.y, pupil.diameter].map(|v| v / self.eyebox);
            self.overlay = Overlay { help: Vec::new(), line: Some(format!("{steered}{db}   {HELP}")), map: Some(map) };
            self.seen = Some((new.seen, new.psnr_db));
            changed = true;
        }
        if let Some((picture, _)) = self.seen.as_ref().filter(|_| changed) {
            self.window.show(&[(place, picture)], &self.overlay);
        }
        self.window.refresh().map_err(gone)?;
        Ok(true)
    }
}
