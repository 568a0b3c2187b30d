//! The thread that looks.

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

/// Which picture is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// What the eye sees.
    Seen,
    /// That, and the scene's photograph: what it should see.
    Both,
    /// The photograph alone.
    Photograph,
}

/// What is looked at, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Look {
    /// Through this pupil.
    pub pupil: Pupil,
    /// One sub-frame alone, or all of them averaged.
    pub frame: Option<usize>,
    /// Which picture.
    pub side: Side,
    /// Rows and columns of the picture.
    pub within: [usize; 2],
}

/// What was seen.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderedView {
    /// As it was asked for.
    pub look: Look,
    /// What was shown: how many times [`Viewer::show`] had been called.
    pub content: u64,
    /// The intensity per colour, without exposure, where the display's picture is seen; empty for the photograph alone.
    pub planes: Vec<Plane>,
    /// What they are multiplied by in the picture.
    pub exposures: Vec<f64>,
    /// The picture; black for the photograph alone.
    pub seen: Picture,
    /// The scene's photograph per colour, where there is a scene and the picture is whole.
    pub wanted: Vec<Plane>,
    /// Its picture, where that is to be shown.
    pub photograph: Option<Picture>,
    /// Over all colours, after 2 x 2 averaging, at the exposure that is shown; where there is a scene.
    pub psnr_db: Option<f64>,
    /// Time that it took.
    pub milliseconds: f64,
    /// Whether it is on all of the SLM's pixels; if not, a better one is under way.
    pub whole: bool,
}

/// What the thread is given: all of it is the newest.
#[derive(Default)]
struct ViewRequest {
    showing: Option<(u64, Arc<PreviewContent>)>,
    look: Option<Look>,
}

type Answer = Result<RenderedView, PreviewError>;

/// A whole picture that takes longer than this is preceded by a coarse one.
const SLOW: Duration = Duration::from_millis(40);
/// The mouse rests when nothing new comes for so long.
const REST: Duration = Duration::from_millis(60);
/// Where a photograph is to be compared with, no more than one part in so many goes into whole pictures while nothing rests.
const WHOLE_SHARE: u32 = 5;

/// Looks through the newest pupil at the newest hologram, on a thread of its own that owns the engines. No call waits.
pub struct Viewer {
    worker: Worker<ViewRequest, Answer>,
    looked: Arc<AtomicU64>,
    shown: u64,
}

impl Viewer {
    /// Starts the thread. `open` opens an engine; there is one for each colour, and one for the photographs of each.
    /// `scene`: in the colours of what will be shown, and in their order; none where it is not known.
    ///
    /// # Errors
    /// [`PreviewError::Thread`].
    pub fn start(open: Opener, scene: impl Into<SceneSource>) -> Result<Self, PreviewError> {
        let scene = scene.into();
        let looked = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&looked);
        let worker = Worker::start("viewer", "looks", move |take: &Mailbox<Option<ViewRequest>>, give| {
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
                // Nobody knows yet how long the first takes; of tiles it can be seconds.
                let slow = looker.expected.map_or(showing.tiles.is_some(), |time| time > SLOW);
                if look.side == Side::Seen && slow {
                    let coarse = looker.look(*content, showing, look, Detail::Coarse);
                    let failed = coarse.is_err();
                    publish(coarse);
                    // The mouse moves on: the next coarse picture counts more than this one's whole, but for one now and then.
                    if failed || (!looker.is_due(showing) && take.comes(REST)) {
                        continue;
                    }
                }
                publish(looker.look(*content, showing, look, Detail::Whole));
            }
        });
        Ok(Self { worker: worker?, looked, shown: 0 })
    }

    /// From now on the display shows this.
    pub fn show(&mut self, showing: Arc<PreviewContent>) {
        self.shown += 1;
        let shown = Some((self.shown, showing));
        self.ask(|given| given.showing = shown);
    }

    /// From now on it is looked at like this.
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

    /// The newest picture that was not taken yet.
    ///
    /// # Errors
    /// What went wrong with it; [`PreviewError::Thread`] if nothing will come any more.
    pub fn newest(&self) -> Result<Option<RenderedView>, PreviewError> {
        self.worker.newest()?.transpose()
    }

    /// How many pictures were made so far.
    pub fn looked(&self) -> u64 {
        self.looked.load(Relaxed)
    }
}

struct Looker {
    eye: Eye,
    scene: SceneSource,
    /// What takes photographs of each colour, and the views that it holds.
    cameras: Vec<(Box<dyn Engine>, Arc<Pyramid>)>,
    /// What a whole picture took.
    expected: Option<Duration>,
    /// When it was there.
    whole_ended: Option<Instant>,
}

impl Looker {
    /// Whether a whole picture is made though something newer waits: only it is compared with the photograph.
    fn is_due(&self, showing: &PreviewContent) -> bool {
        let (Some(took), Some(ended)) = (self.expected, self.whole_ended) else { return false };
        self.is_known(showing) && ended.elapsed() >= (WHOLE_SHARE - 1) * took
    }

    /// Whether it is known what is shown should be.
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
        // Of tiles, what the pupil resolves is all there is; else the planes sample the SLM's pixels.
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
            reason: reason!("other-optics", "its colours or its optics are not the scene's"),
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
            // A photograph is of all moments at once.
            let planner = Planner { frames: motion.map_or(1, |_| showing.frames), ..planner };
            let through = motion.unwrap_or(Viewpoint::Pupil(*pupil));
            let mut taken = evaluate::targets(camera.as_mut(), &planner, &[through])?;
            let [rows, columns] = showing.size();
            planes.push(Plane { rows, columns, values: taken.pop().unwrap_or_default() });
        }
        Ok(planes)
    }
}

/// As `eyebox eval score` has it, but at the exposure that is shown.
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
