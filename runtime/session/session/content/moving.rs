//! Plays a sequence of holograms with known scenes, each loaded ahead to be refined before its light.

use crate::hologram::{Hologram, Sequence};
use crate::mailbox::Mailbox;
use crate::optics::{Color, Display, mean_light};
use crate::present::Rate;
use crate::scene::LightField;
use crate::session::content::scenes::{Due, FrameFreshness, Newest, SceneFrame, Scenes};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::threads::{put_unless, spawn};
use crate::session::playback::timeline::{Speed, Timeline};
use crate::session::refinement::field::LiveColor;
use crate::solve::Problem;
use eyebox_base::error::Reason;
use eyebox_base::reason;
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// The number of scenes that wait to be due.
const AHEAD: usize = 2;
/// The interval at which the reading thread checks for its end.
const POLL_INTERVAL: Duration = Duration::from_millis(20);
/// The memory for scenes that are shown repeatedly (bytes).
const KEPT: usize = 1 << 30;

/// Loads the scene that a hologram names, in the colors of the hologram, and the display that it is shown on. A failure
/// is returned as a sentence.
pub type SceneLoader = Box<dyn FnMut(&Hologram) -> Result<(LightField, Display), String> + Send>;

/// A sequence of holograms and their scenes.
pub struct MovingSequence {
    name: String,
    rate: Rate,
    count: u64,
    looped: bool,
    /// The timeline of the holograms, created with the first request.
    timeline: Option<Timeline>,
    first_light_ns: i64,
    /// The position of the newest scene that was returned.
    shown: u64,
    arriving: Mailbox<Result<SceneFrame, String>>,
    ahead: Option<Result<SceneFrame, String>>,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Shared {
    stop: AtomicBool,
    /// The position that is due. Older scenes are skipped.
    wanted: AtomicU64,
}

impl MovingSequence {
    /// Loads the first hologram with its scene, which refinement starts from, and starts to read ahead. A `looped`
    /// sequence starts again at its end.
    ///
    /// # Errors
    /// Returns [`SessionError::Hologram`], or [`SessionError::Setting`] if a scene cannot be loaded or the colors of a
    /// hologram have no names.
    pub fn start(
        mut sequence: Sequence,
        looped: bool,
        mut load: SceneLoader,
    ) -> Result<(Self, Vec<LiveColor>), SessionError> {
        let name = sequence.path().display().to_string();
        let (count, [numerator, denominator]) = (sequence.count(), sequence.rate());
        let rate = Rate::new(numerator, denominator)?;
        let wrong = |reason: Reason| SessionError::Setting(reason.within(&name));
        if count == 0 {
            return Err(wrong(reason!("no-hologram-yet", "it has no hologram yet")));
        }
        let first = colors_of(&sequence.load(0)?, &mut load).map_err(|e| wrong(e.into()))?;
        let arriving = Mailbox::new(AHEAD);
        let out = arriving.clone();
        let shared = Arc::new(Shared::default());
        let state = Arc::clone(&shared);
        let first = Arc::new(first);
        let begun = Arc::clone(&first);
        let reader = Reader { sequence, load, count, looped, out, shared: state };
        let thread = spawn("reads scenes", move || reader.run(begun))?;
        let (timeline, ahead, thread) = (None, None, Some(thread));
        let (first_light_ns, shown) = (0, 0);
        let all = Self { name, rate, count, looped, timeline, first_light_ns, shown, arriving, ahead, shared, thread };
        Ok((all, Arc::unwrap_or_clone(first)))
    }

    /// Returns the next scene that was read. In simulated time it waits for it.
    fn read(&mut self, patient: bool) -> Option<Result<SceneFrame, String>> {
        loop {
            if let Some(read) = self.ahead.take().or_else(|| self.arriving.take()) {
                return Some(read);
            }
            if !patient || self.thread.as_ref().is_none_or(JoinHandle::is_finished) {
                return self.arriving.take();
            }
            self.ahead = self.arriving.take_within(POLL_INTERVAL);
        }
    }
}

impl Scenes for MovingSequence {
    fn describe(&self) -> String {
        format!("{}: {} holograms at {} per second", self.name, self.count, self.rate)
    }

    fn next(&mut self, due: &Due) -> Result<Newest, SessionError> {
        let rate = self.rate;
        if self.timeline.is_none() {
            self.first_light_ns = due.light_ns;
        }
        let timeline = self.timeline.get_or_insert_with(|| Timeline::new(rate, Speed::ONE, due.light_ns));
        let position = timeline.due(due.light_ns).unwrap_or(0);
        if !self.looped && position >= self.count {
            return Ok(Newest::Ended);
        }
        self.shared.wanted.store(position, Ordering::Release);
        let (mut newest, mut refused) = (None, None);
        while newest.as_ref().map_or(self.shown, |scene: &SceneFrame| scene.number) < position {
            match self.read(due.patient) {
                Some(Ok(scene)) if scene.number <= position => newest = Some(scene),
                Some(Ok(later)) => {
                    self.ahead = Some(Ok(later));
                    break;
                }
                Some(Err(reason)) => {
                    refused = Some(reason);
                    break;
                }
                None => break,
            }
        }
        Ok(match (newest, refused) {
            (Some(scene), _) => {
                self.shown = scene.number;
                let shows_ns = Some(self.first_light_ns.saturating_add(rate.time_of_ns(scene.number as i64)));
                Newest::New(SceneFrame { shows_ns, ..scene })
            }
            (None, Some(reason)) => Newest::Refused(reason),
            (None, None) if self.shown < position => Newest::Late(FrameFreshness::LateContent),
            (None, None) => Newest::Same,
        })
    }
}

impl Drop for MovingSequence {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Release);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// Loads a hologram with its scene, color by color.
fn colors_of(hologram: &Hologram, load: &mut SceneLoader) -> Result<Vec<LiveColor>, String> {
    let (field, display) = load(hologram)?;
    LiveColor::all_of(hologram, &field, &display).map_err(|e| e.to_string())
}

impl LiveColor {
    /// Returns all colors of a hologram of `field`, made for `display`, to be refined.
    ///
    /// # Errors
    /// Returns [`SessionError::Setting`] if the scene or the display lacks a color of the hologram.
    pub fn all_of(hologram: &Hologram, field: &LightField, display: &Display) -> Result<Vec<Self>, SessionError> {
        let padding = hologram.metadata.padding();
        let one = |color: &crate::hologram::ColorHologram| {
            let problem = Problem::new(field, color.color.unwrap_or(Color::Green), display, padding);
            let problem = problem.map_err(|e| SessionError::Setting(Reason::of(&e)))?;
            let lasers = hologram.metadata.joint_color.as_ref().map(|joint| &joint.lasers);
            let laser = lasers.and_then(|lasers| lasers.get(&color.color?)).cloned();
            Ok(Self { problem, phases: color.phases.clone(), exposure: color.exposure, laser })
        };
        hologram.colors.iter().map(one).collect()
    }

    /// Returns the same colors for another scene, which brings no phases. An exposure rises if the scene is brighter
    /// than the available light, as it can be with a new picture of an application.
    ///
    /// # Errors
    /// [`SessionError::Setting`] if the scene or the display lacks a color.
    pub fn for_scene(colors: &[Self], field: &LightField, display: &Display) -> Result<Vec<Self>, SessionError> {
        let one = |(at, color): (usize, &Self)| {
            let name = field.colors.get(at).copied().unwrap_or(Color::Green);
            let problem = Problem::new(field, name, display, color.problem.padding);
            let problem = problem.map_err(|e| SessionError::Setting(Reason::of(&e)))?;
            let exposure = color.exposure.max(problem.mean / mean_light(&display.modes(name)));
            Ok(Self { problem, phases: Vec::new(), exposure, laser: color.laser.clone() })
        };
        colors.iter().enumerate().map(one).collect()
    }
}

struct Reader {
    sequence: Sequence,
    load: SceneLoader,
    count: u64,
    looped: bool,
    out: Mailbox<Result<SceneFrame, String>>,
    shared: Arc<Shared>,
}

impl Reader {
    fn run(mut self, first: Arc<Vec<LiveColor>>) {
        let mut kept = HashMap::from([(0, first)]);
        let mut bytes = 0;
        let mut position = 0;
        while !self.shared.stop.load(Ordering::Acquire) {
            position = (position + 1).max(self.shared.wanted.load(Ordering::Acquire));
            if !self.looped && position >= self.count {
                return;
            }
            let index = position % self.count;
            let read = match kept.get(&index) {
                Some(colors) => Ok(Arc::clone(colors)),
                None => self.load(index).map(Arc::new),
            };
            if let (Ok(colors), true) = (&read, self.looped && !kept.contains_key(&index)) {
                let size = |c: &LiveColor| c.problem.pyramid.bytes() + 4 * c.phases.len();
                let more = colors.iter().map(size).sum::<usize>();
                if bytes + more <= KEPT {
                    bytes += more;
                    kept.insert(index, Arc::clone(colors));
                }
            }
            let item = read.map(|colors| SceneFrame::new(position, colors));
            put_unless(&self.out, item, POLL_INTERVAL, || self.shared.stop.load(Ordering::Acquire));
        }
    }

    fn load(&mut self, index: u64) -> Result<Vec<LiveColor>, String> {
        let hologram = self.sequence.load(index).map_err(|e| format!("hologram {index} is left out: {e}"))?;
        colors_of(&hologram, &mut self.load).map_err(|e| format!("hologram {index} is left out: {e}"))
    }
}
