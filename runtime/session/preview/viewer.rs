//! Renders pictures of the content on a thread of its own.

use super::eye::{Eye, Opener};
use super::picture::{Detail, Picture, develop};
use super::worker::Worker;
use super::{PreviewContent, PreviewError};
use crate::engine::{Engine, Purpose};
use crate::evaluate::{self, Plane};
use crate::mailbox::Mailbox;
use crate::optics::{Color, Pupil, WindowFactor};
use crate::plan::{Planner, Viewpoint};
use crate::reconstruction::SceneSource;
use crate::scene::Pyramid;
use crate::solve::Problem;
use eyebox_base::reason;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// The picture or pictures that a caller requests.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// The image that the eye sees.
    Seen,
    /// The image, and the target image of the scene.
    Both,
    /// The target image alone.
    Photograph,
}

/// A request for a picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// The pupil of the eye.
    pub pupil: Pupil,
    /// One sub-frame alone, or `None` for the mean of all.
    pub frame: Option<usize>,
    /// The picture or pictures.
    pub side: Side,
    /// The rows and columns of the picture.
    pub within: [usize; 2],
}

/// A picture, with the request that it answers.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedView {
    /// The request for this picture.
    pub look: Look,
    /// The number of calls of [`Viewer::show`] up to the content of this picture.
    pub content: u64,
    /// The intensity of each color without exposure, at the positions that the eye sees. It is empty for the target
    /// image alone.
    pub planes: Vec<Plane>,
    /// The factor of each plane in the picture.
    pub exposures: Vec<f64>,
    /// The picture of the image, or black for the target image alone.
    pub seen: Picture,
    /// The target image of each color, if there is a scene and the picture is whole.
    pub wanted: Vec<Plane>,
    /// The picture of the target image, if it was requested.
    pub photograph: Option<Picture>,
    /// The PSNR (dB) over all colors, after 2 x 2 averaging and at the exposure of the content, if there is a scene.
    pub psnr_db: Option<f64>,
    /// The time of the computation (ms).
    pub milliseconds: f64,
    /// True if the picture has all pixels of the SLM. If it is false, a finer picture follows.
    pub whole: bool,
}

/// The newest requests to the thread.
#[derive(Default)]
struct ViewRequest {
    showing: Option<(u64, Arc<PreviewContent>)>,
    look: Option<Look>,
}

type Answer = Result<RenderedView, PreviewError>;

/// A whole picture that takes longer than this is preceded by a coarse picture.
const SLOW: Duration = Duration::from_millis(40);
/// The mouse rests if nothing new arrives for this time.
const REST: Duration = Duration::from_millis(60);
/// If there is a scene to compare with, at most one part in this number of the time goes to whole pictures while the
/// mouse moves.
const WHOLE_SHARE: u32 = 5;

/// Renders the newest hologram through the newest pupil, on a thread that owns the engines. No call waits.
pub struct Viewer {
    worker: Worker<ViewRequest, Answer>,
    looked: Arc<AtomicU64>,
    shown: u64,
}

impl Viewer {
    /// Starts the thread. The function `open` opens an engine for each color, and one for the target images of each
    /// color. The `scene` has the colors of the content in their order, or is empty if it is unknown.
    ///
    /// # Errors
    /// Returns [`PreviewError::Thread`] if the thread cannot be started.
    pub fn start(open: Opener, scene: impl Into<SceneSource>) -> Result<Self, PreviewError> {
        let scene = scene.into();
        let looked = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&looked);
        let worker = Worker::start("viewer", "renders", move |take: &Mailbox<Option<ViewRequest>>, give| {
            let mut looker =
                Looker { eye: Eye::new(open), scene, cameras: Vec::new(), expected: None, whole_ended: None };
            let (mut showing, mut look) = (None, None);
            while let Some(given) = take.wait() {
                showing = given.showing.or(showing);
                look = given.look.or(look);
                let (Some((content, showing)), Some(look)) = (&showing, &look) else { continue };
                let publish = |answer: Answer| {
                    count.fetch_add(1, Relaxed);
                    give.push(answer);
                };
                // The time of the first picture is unknown. For tiles it can be seconds.
                let slow = looker.expected.map_or(showing.tiles.is_some(), |time| time > SLOW);
                if look.side == Side::Seen && slow {
                    let coarse = looker.look(*content, showing, look, Detail::Coarse);
                    let failed = coarse.is_err();
                    publish(coarse);
                    // While the mouse moves, the next coarse picture is more useful than a whole one, except now and
                    // then.
                    if failed || (!looker.is_due(showing) && take.comes(REST)) {
                        continue;
                    }
                }
                publish(looker.look(*content, showing, look, Detail::Whole));
            }
        });
        Ok(Self { worker: worker?, looked, shown: 0 })
    }

    /// Sets the content of the display from now on.
    pub fn show(&mut self, showing: Arc<PreviewContent>) {
        self.shown += 1;
        let shown = Some((self.shown, showing));
        self.ask(|given| given.showing = shown);
    }

    /// Sets the view from now on.
    pub fn look(&self, look: Look) {
        self.ask(|given| given.look = Some(look));
    }

    fn ask(&self, change: impl FnOnce(&mut ViewRequest)) {
        self.worker.asked.update(|given| {
            let mut given = given.flatten().unwrap_or_default();
            change(&mut given);
            Some(given)
        });
    }

    /// Returns the newest picture that was not taken yet.
    ///
    /// # Errors
    /// Returns the error of that picture, or [`PreviewError::Thread`] if the thread has ended.
    pub fn newest(&self) -> Result<Option<RenderedView>, PreviewError> {
        self.worker.newest()?.transpose()
    }

    /// Returns the number of pictures that were made until now.
    pub fn looked(&self) -> u64 {
        self.looked.load(Relaxed)
    }
}

struct Looker {
    eye: Eye,
    scene: SceneSource,
    /// The engine for the target images of each color, and the views that it holds.
    cameras: Vec<(Box<dyn Engine>, Arc<Pyramid>)>,
    /// The time that a whole picture took.
    expected: Option<Duration>,
    /// The time at which it was ready.
    whole_ended: Option<Instant>,
}

impl Looker {
    /// Returns true if a whole picture is due although newer requests wait, because only a whole picture is compared
    /// with the target image.
    fn is_due(&self, showing: &PreviewContent) -> bool {
        let (Some(took), Some(ended)) = (self.expected, self.whole_ended) else { return false };
        self.is_known(showing) && ended.elapsed() >= (WHOLE_SHARE - 1) * took
    }

    /// Returns true if there is a target scene for the content.
    fn is_known(&self, showing: &PreviewContent) -> bool {
        showing.scene.is_some() || !self.scene.is_empty()
    }

    fn look(&mut self, content: u64, showing: &PreviewContent, look: &Look, detail: Detail) -> Answer {
        let start = Instant::now();
        let whole = detail == Detail::Whole;
        let colors: Vec<Option<Color>> = showing.colors.iter().map(|c| c.color).collect();
        let exposures: Vec<f64> = showing.colors.iter().map(|c| c.exposure).collect();
        let wanted = self.is_known(showing) && whole;
        let photograph = if wanted { self.photograph(showing, &look.pupil)? } else { Vec::new() };
        let planes = match look.side {
            Side::Photograph => Vec::new(),
            _ => self.eye.look(showing, look.frame, &look.pupil, detail)?,
        };
        // The planes of tiles have the resolution of the pupil. Otherwise they sample the pixels of the SLM.
        let size = match planes.first().or(photograph.first()).filter(|_| showing.tiles.is_some()) {
            Some(plane) => [plane.rows, plane.columns],
            None => showing.size(),
        };
        let psnr_db =
            (!photograph.is_empty() && !planes.is_empty()).then(|| psnr(&planes, &exposures, &photograph, size));
        let [planes, photograph] = [planes, photograph].map(|planes| showing.as_seen(planes));
        let seen = match look.side {
            Side::Photograph => Picture::black([0, 0]),
            _ => develop(&planes, &colors, &exposures, size, look.within),
        };
        let shown = wanted && look.side != Side::Seen;
        let picture = shown.then(|| develop(&photograph, &colors, &vec![1.0; colors.len()], size, look.within));
        let spent = start.elapsed();
        if whole {
            (self.expected, self.whole_ended) = (Some(spent), Some(Instant::now()));
        }
        let milliseconds = spent.as_secs_f64() * 1e3;
        Ok(RenderedView {
            look: *look,
            content,
            planes,
            exposures,
            seen,
            wanted: photograph,
            photograph: picture,
            psnr_db,
            milliseconds,
            whole,
        })
    }

    fn photograph(&mut self, showing: &PreviewContent, pupil: &Pupil) -> Result<Vec<Plane>, PreviewError> {
        let other = || PreviewError::Showing {
            reason: reason!("other-optics", "its colors or its optics differ from the scene's"),
        };
        let scene: &[Problem] = match (&self.scene, &showing.tiles) {
            _ if showing.scene.is_some() => showing.scene.as_deref().map_or(&[], Vec::as_slice),
            (scene @ SceneSource::Around(views), Some(_)) if views.len() == showing.colors.len() => {
                return Ok(scene.photograph(pupil, self.eye.single()?)?);
            }
            (SceneSource::Whole(problems), None) => problems,
            _ => return Err(other()),
        };
        let fits = |(problem, shown): (&Problem, &super::PreviewColor)| problem.optics == shown.optics;
        if scene.len() != showing.colors.len() || !scene.iter().zip(&showing.colors).all(fits) {
            return Err(other());
        }
        let mut planes = Vec::with_capacity(scene.len());
        for (i, problem) in scene.iter().enumerate() {
            let planner = problem.planner(1, WindowFactor::Full);
            if self.cameras.len() == i {
                let mut camera = (self.eye.opener())()?;
                camera.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
                self.cameras.push((camera, Arc::clone(&problem.pyramid)));
            }
            let (camera, views) = &mut self.cameras[i];
            if !Arc::ptr_eq(views, &problem.pyramid) {
                camera.take_views(Arc::clone(&problem.pyramid))?;
                *views = Arc::clone(&problem.pyramid);
            }
            let motion = showing.moving(i).map(|motion| motion.seen_through(*pupil, showing.frames));
            // A target image integrates over all times at once.
            let planner = Planner { frames: motion.map_or(1, |_| showing.frames), ..planner };
            let through = motion.unwrap_or(Viewpoint::Pupil(*pupil));
            let mut taken = evaluate::targets(camera.as_mut(), &planner, &[through])?;
            let [rows, columns] = showing.size();
            planes.push(Plane { rows, columns, values: taken.pop().unwrap_or_default() });
        }
        Ok(planes)
    }
}

/// Computes the PSNR as `eyebox eval score` does, but at the exposure of the content.
fn psnr(seen: &[Plane], exposures: &[f64], wanted: &[Plane], [height, width]: [usize; 2]) -> f64 {
    let pooled = |planes: &[Plane], exposure: &dyn Fn(usize) -> f32| -> Vec<f32> {
        let one = |(i, plane): (usize, &Plane)| {
            let mut pooled = evaluate::pool2(&plane.values, height, width);
            pooled.iter_mut().for_each(|v| *v *= exposure(i));
            pooled
        };
        planes.iter().enumerate().flat_map(one).collect()
    };
    let (seen, wanted) = (pooled(seen, &|i| exposures[i] as f32), pooled(wanted, &|_| 1.0));
    evaluate::psnr(&seen, &wanted).unwrap_or(f64::NAN)
}
