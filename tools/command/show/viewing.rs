//! `--view` shows the image that the tracked eye sees, in a window next to the display.

use super::walking::Walker;
use crate::Failure;
use crate::subject::Steered;
use eyebox::low_level::gpu::Gpu;
use eyebox::low_level::optics::Padding;
use eyebox::low_level::present::{Desktop, WindowEvent, WindowKey};
use eyebox::low_level::preview::{
    Look, Opener, Overlay, Picture, PreviewColor, PreviewContent, PreviewError, PreviewWindow, Side, Viewer, places,
    pupil_at,
};
use eyebox::low_level::session::{FinishedSet, Now, SidecarOpener, SidecarWindow, UserRequest, WalkHandle};
use eyebox::low_level::solve::Problem;
use eyebox::low_level::trackers::pushed::MouseHandle;
use std::sync::Arc;

/// The content and the engines for a window that is not open yet.
pub struct Viewing {
    scene: String,
    showing: PreviewContent,
    problems: Vec<Problem>,
    engines: Opener,
    mouse: Option<MouseHandle>,
    walk: Option<WalkHandle>,
}

impl Viewing {
    /// Prepares a window. `mouse` receives the position of the mouse, if the mouse is the tracker. `walk` moves the
    /// camera in front of splats.
    pub fn new(
        steered: &Steered,
        engines: Opener,
        mouse: Option<MouseHandle>,
        walk: Option<WalkHandle>,
    ) -> Result<Self, Failure> {
        let showing = PreviewContent::new(steered.hologram.clone(), steered.hologram.metadata.padding())?;
        let problems = steered.parts.iter().map(|p| p.problem.clone()).collect();
        Ok(Self { scene: steered.hologram.scene.clone(), showing, problems, engines, mouse, walk })
    }

    /// Returns a function that opens the window on this device.
    pub fn opener(self, gpu: Gpu) -> SidecarOpener {
        Box::new(move |desktop| match self.open(&gpu, desktop) {
            Ok(view) => Ok(Box::new(view)),
            Err(error) => Err(error.to_string()),
        })
    }

    fn open(self, gpu: &Gpu, desktop: &mut Desktop) -> Result<View, PreviewError> {
        let Self { scene, showing, problems, engines, mouse, walk } = self;
        let size = showing.size();
        // Small pictures are magnified by a whole number.
        let zoom = (640 / size[0].max(size[1]).max(1)).max(1);
        let mut viewer = Viewer::start(engines, problems)?;
        let window = PreviewWindow::open(gpu, desktop, &scene, size.map(|n| n * zoom))?;
        let (frames, padding, eyebox) = (showing.frames, showing.padding, showing.eyebox);
        let colors = showing.colors.clone();
        viewer.show(Arc::new(showing));
        Ok(View {
            window,
            viewer,
            frames,
            padding,
            eyebox,
            size,
            colors,
            mouse,
            walk: walk.map(Walker::new),
            seen: None,
            compared: None,
            overlay: Overlay::default(),
        })
    }
}

/// The window and its viewer.
struct View {
    window: PreviewWindow,
    viewer: Viewer,
    frames: usize,
    padding: Padding,
    eyebox: f64,
    size: [usize; 2],
    colors: Vec<PreviewColor>,
    mouse: Option<MouseHandle>,
    walk: Option<Walker>,
    seen: Option<Picture>,
    /// The last comparison with the target image, as the state of pupil steering and the PSNR in dB.
    compared: Option<(bool, f64)>,
    overlay: Overlay,
}

const HELP: &str = "s: steering on or off   q, Esc: close";
const WALK_HELP: &str = "drag, arrows, a, d, wheel: walk   Home: start   s: steering   q: close";

impl View {
    /// Handles the events of the user.
    fn asked(&mut self, now: &Now) -> UserRequest {
        let mut asked = UserRequest::Nothing;
        while let Some(event) = self.window.event() {
            if self.walk.as_mut().is_some_and(|walk| walk.take(event)) {
                continue;
            }
            match event {
                WindowEvent::Close | WindowEvent::Key(WindowKey::Escape | WindowKey::Character('q')) => {
                    return UserRequest::Close;
                }
                WindowEvent::Key(WindowKey::Character('s')) => asked = UserRequest::Steer(!now.steered),
                WindowEvent::Pointer(position) => {
                    if let Some(mouse) = &self.mouse {
                        mouse.push(pupil_at(position, &places(self.window.size(), self.size, 1), self.eyebox));
                    }
                }
                _ => {}
            }
        }
        asked
    }

    /// Shows the newest picture.
    fn refresh(&mut self, now: &Now) -> Result<(), PreviewError> {
        let place = places(self.window.size(), self.size, 1)[0];
        let within = [place.height, place.width];
        self.viewer.look(Look { pupil: now.pupil, frame: None, side: Side::Seen, within });
        if let Some(new) = self.viewer.newest()? {
            let steered = if now.steered { "steered" } else { "not steered" };
            self.compared = new.psnr_db.map(|db| (now.steered, db)).or(self.compared);
            let before = if new.psnr_db.is_some() { "" } else { "last " };
            // A PSNR with pupil steering does not apply without it.
            let db = self.compared.filter(|(steered, _)| *steered == now.steered);
            let db = db.map_or(String::new(), |(_, db)| format!(", {before}{db:.1} dB"));
            let pupil = new.look.pupil;
            let [x, y, diameter, focus] = [pupil.x, pupil.y, pupil.diameter, pupil.depth].map(|v| v * 1e3);
            self.window.title(&format!(
                "{steered}{db}; pupil {x:.1}, {y:.1} mm, {diameter:.1} mm wide, focused at {focus:.2} mm; {:.0} sets per second",
                now.sets_per_second
            ));
            let help = if self.walk.is_some() { WALK_HELP } else { HELP };
            let map = [pupil.x, pupil.y, pupil.diameter].map(|v| v / self.eyebox);
            self.overlay = Overlay { help: Vec::new(), line: Some(format!("{steered}{db}   {help}")), map: Some(map) };
            let picture = self.seen.insert(new.seen);
            self.window.show(&[(place, picture)], &self.overlay);
        }
        self.window.refresh().map(drop)
    }
}

impl SidecarWindow for View {
    fn shown(&mut self, set: &FinishedSet) {
        let Some(phases) = &set.phases else { return };
        for (color, phases) in self.colors.iter_mut().zip(phases) {
            color.phases = Arc::clone(phases);
        }
        for (color, lit) in self.colors.iter_mut().zip(set.sources()).filter(|(_, lit)| !lit.is_empty()) {
            color.modes = color.modes.iter().map(|mode| mode.lit_among(lit)).collect();
        }
        if let Some((_, exposures)) = &set.scene {
            self.colors.iter_mut().zip(exposures).for_each(|(color, exposure)| color.exposure = *exposure);
        }
        let scene = set.scene.as_ref().map(|(problems, _)| Arc::clone(problems));
        let Self { frames, padding, eyebox, .. } = *self;
        let colors = self.colors.clone();
        self.viewer.show(Arc::new(PreviewContent {
            frames,
            padding,
            colors,
            eyebox,
            tiles: None,
            scene,
            motion: set.motion.clone(),
            obstruction: None,
        }));
    }

    fn serve(&mut self, now: &Now) -> Result<UserRequest, String> {
        let asked = self.asked(now);
        if asked != UserRequest::Close {
            self.refresh(now).map_err(|error| format!("the view's window: {error}"))?;
        }
        Ok(asked)
    }
}
