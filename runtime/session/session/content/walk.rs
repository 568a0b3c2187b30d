//! Draws splats for a camera that moves while they are shown. The views are around the tracked pupil.

use crate::engine::Backend;
use crate::gpu::Gpu;
use crate::optics::{Color, Display};
use crate::scene::{CameraPath, MovingSplats, SplatCamera, ViewGrid};
use crate::session::content::decoded_views::live_colors;
use crate::session::content::device_splats::SplatsOnDevice;
use crate::session::content::near_eye::{Exposures, NearViews, TRACKED_VIEWS, light_field};
use crate::session::content::scenes::{Due, Newest, SceneFrame, Scenes};
use crate::session::content::shared_camera::{SharedCamera, Shot};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::threads::spawn;
use crate::session::refinement::field::LiveColor;
use eyebox_base::mailbox::Mailbox;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// The number of views along an axis without a tracker, over the whole eyebox.
const WHOLE_VIEWS: u32 = 5;
/// New views are made if the pupil moved by this share of the pitch of the views.
const MOVED: f64 = 0.5;
/// New views are made if their pitch changes by this share.
const WIDER: f64 = 0.25;
/// The interval at which the drawing thread checks for its end.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// The share of a new drawing time in the expected one.
const NEWER: f64 = 0.25;

/// The camera of a [`SplatWalk`] without a path. The keys and the mouse of a window move it.
#[derive(Debug, Clone)]
pub struct WalkHandle {
    camera: Arc<Mutex<SplatCamera>>,
    start: SplatCamera,
    distance: f64,
}

impl WalkHandle {
    /// Moves the camera to the right, downwards and forward, in proportion to the distance of the middle of the scene.
    pub fn step(&self, by: [f64; 3]) {
        self.change(|camera| camera.moved(by.map(|v| v * self.distance)));
    }

    /// Turns the camera to the right and downwards (radians).
    pub fn turn(&self, by: [f64; 2]) {
        self.change(|camera| camera.turned(by));
    }

    /// Returns the camera to its start.
    pub fn home(&self) {
        self.change(|_| self.start);
    }

    /// Returns the present camera.
    pub fn camera(&self) -> SplatCamera {
        *self.camera.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&SplatCamera) -> SplatCamera) {
        let mut camera = self.camera.lock().unwrap_or_else(PoisonError::into_inner);
        *camera = change(&camera);
    }
}

/// Splats whose views are made again when the camera or the pupil has moved.
///
/// A thread draws the views, so that a request does not wait. In simulated time a request draws them itself.
pub struct SplatWalk {
    name: String,
    eyebox: f64,
    handle: WalkHandle,
    /// The path, and the time of one round.
    path: Option<(CameraPath, Duration)>,
    /// The camera that both eyes share, if there are two.
    shared: SharedCamera,
    /// The exposures, which both eyes share, too.
    exposures: Exposures,
    /// The newest views that were requested.
    asked: Option<Asked>,
    frames: u64,
    /// The expected time from the request of views to their use (ns).
    lead_ns: f64,
    drawing: Drawing,
}

/// The views to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Asked {
    shot: Shot,
    near: NearViews,
    /// The light at which they are shown (ns).
    shows_ns: i64,
}

/// The result of drawing, with the time of its end.
struct Drawn {
    asked: Asked,
    colors: Result<Vec<LiveColor>, SessionError>,
    ended: Instant,
}

/// The place of the drawing.
enum Drawing {
    /// The thread of the request draws.
    Here(Box<Drawer>),
    Thread {
        asked: Mailbox<Asked>,
        drawn: Mailbox<Drawn>,
        thread: Option<JoinHandle<()>>,
        /// The time of the request that is not answered yet.
        since: Option<Instant>,
    },
}

struct Drawer {
    splats: MovingSplats,
    display: Display,
    colors: Vec<Color>,
    exposures: Exposures,
    /// The device that draws, if one does.
    device: Option<SplatsOnDevice>,
}

impl SplatWalk {
    /// Shows splats on a display in these colors. Without a path, the [handle](Self::handle) moves the camera. The path
    /// has the time of one round.
    pub fn new(
        splats: MovingSplats,
        display: &Display,
        colors: &[Color],
        path: Option<(CameraPath, Duration)>,
    ) -> Self {
        let start = splats.camera();
        let handle = WalkHandle { camera: Arc::new(Mutex::new(start)), start, distance: splats.distance() };
        Self::with(splats, (display, colors), (handle, path, SharedCamera::alone()), Exposures::default())
    }

    /// Shows the splats of the right eye. The camera and the exposures belong to this walk, which is of the left eye. The
    /// camera moves on when both eyes have their views of it.
    pub fn of_right_eye(&self, splats: MovingSplats, display: &Display, colors: &[Color]) -> Self {
        let camera = (self.handle.clone(), self.path.clone(), self.shared.of_right_eye());
        Self::with(splats, (display, colors), camera, self.exposures.clone())
    }

    fn with(
        splats: MovingSplats,
        (display, colors): (&Display, &[Color]),
        (handle, path, shared): (WalkHandle, Option<(CameraPath, Duration)>, SharedCamera),
        exposures: Exposures,
    ) -> Self {
        let (name, eyebox) = (splats.name().to_owned(), display.eyebox_min());
        let (display, colors) = (display.clone(), colors.to_vec());
        let drawer = Drawer { splats, display, colors, exposures: exposures.clone(), device: None };
        let drawing = Drawing::Here(Box::new(drawer));
        Self { name, eyebox, handle, path, shared, exposures, asked: None, frames: 0, lead_ns: 0.0, drawing }
    }

    /// Draws on this device from now on, for engines there. The views stay on it. The host orders the splats, and sees
    /// only sums of the light of the views, and one view of one color at most 256 pixels wide. If the device fails, the
    /// CPU draws again.
    ///
    /// # Errors
    /// Returns the reason in words if views have to pass through the host. Either the display model or the far field
    /// changes them first, or the device is too small.
    pub fn draw_on(&mut self, gpu: &Gpu) -> Result<(), String> {
        // The drawing thread starts with the first request, so the drawer is here.
        if let Drawing::Here(drawer) = &mut self.drawing {
            let most = (TRACKED_VIEWS * TRACKED_VIEWS) as usize;
            drawer.device = Some(SplatsOnDevice::new(gpu, &drawer.display, &drawer.colors, most)?);
        }
        Ok(())
    }

    /// Returns the device that draws, before the first request in real time.
    #[cfg(test)]
    pub(crate) fn device(&mut self) -> Option<&mut SplatsOnDevice> {
        match &mut self.drawing {
            Drawing::Here(drawer) => drawer.device.as_mut(),
            Drawing::Thread { .. } => None,
        }
    }

    /// [Draws](Self::draw_on) on the device of these engines, if they have one that [draws views](Gpu::draws_views).
    /// Returns the reason in words if the CPU draws instead of a device.
    ///
    /// # Errors
    /// Returns [`SessionError::Engine`] if the device is lost.
    pub fn draw_with(&mut self, engines: &Backend) -> Result<Option<String>, SessionError> {
        Ok(match engines.gpu()? {
            Some(gpu) if gpu.draws_views() => self.draw_on(&gpu).err(),
            Some(_) => Some("it is faster than a software device".into()),
            None => None,
        })
    }

    /// Returns the handle that moves the camera. It has no effect if there is a path.
    pub fn handle(&self) -> WalkHandle {
        self.handle.clone()
    }

    /// Returns the views for a set.
    fn wanted(&self, due: &Due) -> Asked {
        let shows_ns = due.light_ns.saturating_add(self.lead_ns as i64);
        let begun_ns = self.shared.begun_ns(due.light_ns);
        let camera = match &self.path {
            Some((path, round)) => path.at((shows_ns - begun_ns) as f64 * 1e-9 / round.as_secs_f64().max(1e-3)),
            None => self.handle.camera(),
        };
        let shot = self.shared.shot(camera, shows_ns, due.now_ns);
        // A still camera shows any time.
        let shows_ns = if shot.camera == camera { shows_ns } else { shot.shows_ns };
        Asked { shot, near: NearViews::of(due, self.eyebox, WHOLE_VIEWS), shows_ns }
    }

    /// Returns true if the views differ visibly from the last ones.
    fn differs(&self, wanted: &Asked) -> bool {
        self.asked.is_none_or(|last| {
            let (was, is) = (&last.near, &wanted.near);
            let moved = (is.center[0] - was.center[0]).hypot(is.center[1] - was.center[1]);
            last.shot != wanted.shot
                || was.views != is.views
                || (is.pitch - was.pitch).abs() > WIDER * was.pitch
                || moved > MOVED * was.pitch
        })
    }

    /// Takes the views that the thread has drawn.
    fn arrived(&mut self) -> Result<Option<Drawn>, SessionError> {
        let Drawing::Thread { drawn, thread, since, .. } = &mut self.drawing else { return Ok(None) };
        let newest = drawn.take();
        if newest.is_none() && thread.as_ref().is_none_or(JoinHandle::is_finished) {
            let reason = "failed, which is a fault of eyebox".into();
            return Err(SessionError::Thread { what: DRAWS, reason });
        }
        if let Some(begun) = since.take_if(|_| newest.is_some()) {
            let took_ns = begun.elapsed().as_nanos() as f64;
            self.lead_ns += if self.frames == 0 { took_ns } else { NEWER * (took_ns - self.lead_ns) };
        }
        // The camera may now move on.
        newest.iter().for_each(|drawn| self.shared.taken(&drawn.asked.shot));
        Ok(newest)
    }

    fn frame(&mut self, drawn: Drawn, due: &Due) -> Newest {
        let shot = drawn.asked.shot;
        match drawn.colors {
            Ok(colors) => {
                self.frames += 1;
                let age_ns = if due.patient { 0 } else { drawn.ended.elapsed().as_nanos() as i64 };
                let (arrived_ns, shows_ns) = (Some(due.now_ns - age_ns), Some(drawn.asked.shows_ns));
                let frame = SceneFrame::new(self.frames, Arc::new(colors));
                Newest::New(SceneFrame { arrived_ns, shows_ns, moment: Some(shot.moment), ..frame })
            }
            Err(error) => Newest::Refused(error.to_string()),
        }
    }
}

impl Scenes for SplatWalk {
    fn describe(&self) -> String {
        self.name.clone()
    }

    fn next(&mut self, due: &Due) -> Result<Newest, SessionError> {
        self.drawing.begin(due.patient)?;
        let mut drawn = self.arrived()?;
        if matches!(&self.drawing, Drawing::Thread { since: Some(_), .. }) {
            return Ok(Newest::Same);
        }
        let wanted = self.wanted(due);
        if self.differs(&wanted) {
            match &mut self.drawing {
                Drawing::Here(drawer) => {
                    drawn = Some(drawer.draw(wanted));
                    self.shared.taken(&wanted.shot);
                }
                Drawing::Thread { asked, since, .. } => {
                    *since = Some(Instant::now());
                    asked.push(wanted);
                }
            }
            self.asked = Some(wanted);
        }
        Ok(drawn.map_or(Newest::Same, |drawn| self.frame(drawn, due)))
    }

    fn begins_with_one(&self) -> bool {
        false
    }
}

impl Drop for SplatWalk {
    fn drop(&mut self) {
        let Drawing::Thread { asked, thread, .. } = &mut self.drawing else { return };
        // The thread ends when its end of the requests is alone.
        *asked = Mailbox::new(1);
        if let Some(thread) = thread.take() {
            let _ = thread.join();
        }
    }
}

/// The task of the thread.
const DRAWS: &str = "draws splats";

impl Drawing {
    /// Starts the thread at the first request in real time.
    fn begin(&mut self, patient: bool) -> Result<&mut Self, SessionError> {
        if patient || matches!(self, Self::Thread { .. }) {
            return Ok(self);
        }
        let (asked, drawn) = (Mailbox::new(1), Mailbox::new(1));
        let ends = (asked.clone(), drawn.clone());
        let before = std::mem::replace(self, Self::Thread { asked, drawn, thread: None, since: None });
        if let (Self::Here(drawer), Self::Thread { thread, .. }) = (before, &mut *self) {
            *thread = Some(spawn(DRAWS, move || drawer.run(&ends))?);
        }
        Ok(self)
    }
}

impl Drawer {
    fn run(mut self: Box<Self>, (asked, drawn): &(Mailbox<Asked>, Mailbox<Drawn>)) {
        while !asked.is_alone() {
            if let Some(next) = asked.take_within(POLL_INTERVAL) {
                drawn.push(self.draw(next));
            }
        }
    }

    fn draw(&mut self, asked: Asked) -> Drawn {
        let colors = self.colors_of(&asked);
        Drawn { asked, colors, ended: Instant::now() }
    }

    fn colors_of(&mut self, asked: &Asked) -> Result<Vec<LiveColor>, SessionError> {
        let (near, of) = (&asked.near, (&self.display, &self.colors[..]));
        let (grid, center) = ([near.views as usize; 2], near.center);
        let there = self.device.as_mut().and_then(|device| device.draw(&self.splats, &asked.shot.camera, near, of));
        if let Some(views) = there {
            let grid = ViewGrid { rows: grid[0], columns: grid[1], cell: near.pitch };
            return live_colors(views, &self.exposures, of, (grid, center));
        }
        let planes = self.splats.views(&asked.shot.camera, &self.colors, &near.pairs());
        let name = self.splats.name().to_owned();
        let field = light_field(name, &self.display, &self.colors, (grid, near.pitch), planes);
        self.exposures.colors(&field, &self.display, center)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::PupilDistribution;
    use crate::scene::Request;
    use crate::solve::Problem;

    const MS: i64 = 1_000_000;

    fn display() -> Display {
        Display { height: 40, width: 56, ..Display::preset("small").unwrap() }
    }

    fn walk(seconds: Option<f64>) -> SplatWalk {
        let display = display();
        let splats = MovingSplats::new("builtin:still-life-splats", &Request::new(&display, &[Color::Green])).unwrap();
        let path = seconds.map(|s| (splats.around(), Duration::from_secs_f64(s)));
        SplatWalk::new(splats, &display, &[Color::Green], path)
    }

    fn due(light_ns: i64, center: [f64; 2], patient: bool) -> Due {
        let pupil =
            PupilDistribution { centre: center, spread: 1e-4, diameter: [3e-3; 2], focus: [0.0; 2], elsewhere: 0.0 };
        Due {
            now_ns: light_ns - 20 * MS,
            light_ns,
            light_monotonic_ns: light_ns as u64,
            period_ns: 16 * MS,
            pupil,
            velocity: [0.0; 2],
            tracked: true,
            patient,
        }
    }

    fn problem(newest: Newest) -> Problem {
        match newest {
            Newest::New(frame) => frame.colors[0].problem.clone(),
            _ => panic!("no new views"),
        }
    }

    /// Without a path, views are made again if the pupil or the camera moves, and not otherwise.
    #[test]
    fn views_are_made_for_the_pupil_and_the_camera() {
        let mut walk = walk(None);
        let first = problem(walk.next(&due(100 * MS, [0.0; 2], true)).unwrap());
        assert_eq!((first.views.rows, first.views.columns, first.center), (3, 3, [0.0; 2]));
        assert!((first.views.cell - 3.4e-3 / 3.0).abs() < 1e-9, "{}", first.views.cell);
        let again = walk.next(&due(116 * MS, [0.3e-3, 0.0], true)).unwrap();
        assert!(matches!(again, Newest::Same), "the pupil moved by less than half a pitch");
        let aside = problem(walk.next(&due(132 * MS, [0.9e-3, 0.0], true)).unwrap());
        assert_eq!(aside.center, [0.9e-3, 0.0]);
        assert!(matches!(walk.next(&due(148 * MS, [0.9e-3, 0.0], true)).unwrap(), Newest::Same));
        walk.handle().step([0.2, 0.0, 0.0]);
        let moved = problem(walk.next(&due(164 * MS, [0.9e-3, 0.0], true)).unwrap());
        assert_ne!(moved.pyramid.levels[0].views, aside.pyramid.levels[0].views);
        walk.handle().home();
        let back = problem(walk.next(&due(180 * MS, [0.9e-3, 0.0], true)).unwrap());
        assert_eq!(back.pyramid.levels[0].views, aside.pyramid.levels[0].views);
        walk.handle().turn([0.2, 0.1]);
        assert!(matches!(walk.next(&due(196 * MS, [0.9e-3, 0.0], true)).unwrap(), Newest::New(_)));
    }

    /// The views of the still camera are the same as in the light field that a solve reads, at the same places.
    #[test]
    fn views_are_those_of_the_light_field() {
        let display = display();
        let mut walk = walk(None);
        let made = problem(walk.next(&due(100 * MS, [0.0; 2], true)).unwrap());
        let pitch = Some(made.views.cell);
        let request = Request { views: 3, view_pitch: pitch, ..Request::new(&display, &[Color::Green]) };
        let field = crate::scene::load("builtin:still-life-splats", &request).unwrap();
        let wanted = Problem::new(&field, Color::Green, &display, crate::optics::Padding::default()).unwrap();
        assert_eq!(made.pyramid.levels[0].views, wanted.pyramid.levels[0].views);
    }

    /// The right eye sees the same moments of the camera as the left one, from its own place.
    #[test]
    fn both_eyes_see_the_same_moments_of_a_path() {
        let display = display();
        let mut left = walk(Some(2.0));
        let request = Request::new(&display, &[Color::Green]);
        let splats = MovingSplats::new("builtin:still-life-splats?shift=63", &request).unwrap();
        let mut right = left.of_right_eye(splats, &display, &[Color::Green]);
        let frame = |walk: &mut SplatWalk, light_ns| match walk.next(&due(light_ns, [0.0; 2], true)).unwrap() {
            Newest::New(frame) => frame,
            _ => panic!("no new views"),
        };
        for moment in 0..3 {
            let [one, other] = [&mut left, &mut right].map(|eye| frame(eye, 100 * MS * (moment + 1)));
            assert_eq!([one.moment, other.moment], [Some(moment); 2]);
            assert_eq!(one.colors[0].exposure, other.colors[0].exposure);
            let views = |frame: &SceneFrame| frame.colors[0].problem.pyramid.levels[0].views.clone();
            assert!(views(&one) != views(&other), "the eyes see the same");
        }
        // The left eye alone does not move the camera.
        let ahead = frame(&mut left, 400 * MS);
        assert_eq!(ahead.moment, Some(3));
        assert!(matches!(left.next(&due(500 * MS, [0.0; 2], true)).unwrap(), Newest::Same));
        assert_eq!(frame(&mut right, 500 * MS).moment, Some(3));
        assert_eq!(frame(&mut left, 500 * MS).moment, Some(4));
    }

    /// In real time a thread draws. Requests return at once, and a path moves the camera.
    #[test]
    fn a_path_is_walked_while_a_thread_draws() {
        let mut walk = walk(Some(2.0));
        let begun = Instant::now();
        let (mut pictures, mut waiting) = (Vec::new(), 0);
        while pictures.len() < 4 && begun.elapsed() < Duration::from_secs(60) {
            let now_ns = begun.elapsed().as_nanos() as i64;
            let next = walk.next(&due(now_ns + 20 * MS, [0.0; 2], false)).unwrap();
            match next {
                Newest::New(frame) => {
                    assert_eq!(frame.number, pictures.len() as u64 + 1);
                    assert!(frame.arrived_ns.unwrap() <= now_ns);
                    pictures.push(frame.colors[0].problem.pyramid.levels[0].views.clone());
                }
                _ => waiting += 1,
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        assert_eq!(pictures.len(), 4);
        pictures.dedup();
        assert_eq!(pictures.len(), 4, "the camera moves");
        // The first request, at least, returned before its views were drawn.
        assert!(waiting > 0);
    }
}
