//! Sessions, which show holograms on a display, and their video frames.

use crate::call::run;
use crate::display::Display;
use crate::engine::Engine;
use crate::failure::{Answer, Failure};
use crate::forked::{OfProcess, refuse_after_computing};
use crate::frames::{DisplayedFrame, Frames};
use crate::hologram::{Hologram, check_scene};
use crate::scene::Scene;
use eyebox::encode::Encoder;
use eyebox::gaze::{self, Estimator, Eyepiece};
use eyebox::hologram::{Opening, Sequence};
use eyebox::present::Rate;
use eyebox::session::{Command, Content, Cost, Live, Output, Play, Policy, SessionEvent, SessionOptions, Tracking};
use eyebox::solve::RefineSettings;
use eyebox::trackers::{self, SampleSender};
use numpy::PyArray3;
use pyo3::exceptions::PyBaseException;
use pyo3::prelude::*;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// The period of the checks for signals while Python waits for a video frame.
const OFTEN: Duration = Duration::from_millis(50);

/// The output and the duration of a session. `eyebox.show` describes the fields.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Where {
    rate: Option<f64>,
    seconds: Option<f64>,
    window: bool,
    monitor: Option<String>,
    simulated: bool,
    queue: usize,
    on_light: Option<Py<PyAny>>,
}

/// The eye tracker and the options of refinement, in meters and seconds.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct EyeOptions {
    /// The text "own" for samples of the program, the name of another tracker, or `None`.
    eye: Option<String>,
    focus: f64,
    /// The time of a step on a simulated clock. `encode_time` is the time of encoding a set.
    step_time: Option<f64>,
    encode_time: f64,
    display_latency: f64,
    whole_sets: bool,
    /// True if each sub-frame is refined for its own time.
    moments: bool,
    restart: f64,
    /// The fields of `solve::RefineSettings` as TOML.
    steering: String,
}

/// Content on a display, shown by threads of the session.
#[pyclass(frozen, module = "eyebox._eyebox")]
pub(crate) struct Session {
    running: OfProcess<StartedSession>,
    /// The rows, columns and channels of a video frame.
    shape: [usize; 3],
    about: About,
}

/// The parts of a session that exist only in the process that started it.
struct StartedSession {
    session: Mutex<Option<eyebox::session::Session>>,
    eye: Option<SampleSender>,
    frames: Frames,
}

impl Drop for StartedSession {
    fn drop(&mut self) {
        // Otherwise a simulated display that waits for Python would never end.
        self.frames.give_up();
        let session = self.session.get_mut().unwrap_or_else(PoisonError::into_inner).take();
        // A callback of the session may wait for the interpreter.
        let mut left = Some(session);
        Python::try_attach(|py| py.detach(|| drop(left.take())));
    }
}

/// The presenter, the video frames per second, the video frames and sub-frames of a set, and whether updates roll.
type About = (String, f64, u64, u64, bool);
/// The pixels, number, seconds and hologram of a video frame, its place in the set, whether the set is new, and the
/// cause of a delay.
type Frame<'py> = (Bound<'py, PyArray3<u8>>, u64, f64, Option<u64>, u64, bool, Option<&'static str>);

/// Converts the caller's seconds to a duration.
fn time(seconds: f64, what: &str) -> Answer<Duration> {
    if (0.0..=1e9).contains(&seconds) {
        return Ok(Duration::from_secs_f64(seconds));
    }
    Err(Failure::Argument(format!("{what} is {seconds}: it must be 0 to 1e9 seconds")))
}

impl Where {
    /// Starts the session. `endless` is true for content that does not end by itself.
    fn start(self, content: Content, eye: Option<SampleSender>, shape: [usize; 3], endless: bool) -> Answer<Session> {
        refuse_after_computing("a session", "Show it in the parent")?;
        let mut options = SessionOptions::default();
        options.display_rate = self.rate.map(Rate::from_hz).transpose()?;
        options.duration = self.seconds.map(|seconds| time(seconds, "seconds")).transpose()?;
        if self.simulated && self.queue == 0 && endless && options.duration.is_none() {
            let right = "give seconds, or take its video frames (queue)";
            return Err(Failure::Argument(format!("a simulated clock that nobody reads goes on for ever: {right}")));
        }
        let frames = Frames::new(self.queue, self.simulated);
        if self.queue > 0 {
            let mut sender = frames.sender();
            options.observer = Some(Box::new(move |frame| sender.put(frame)));
        }
        if let Some(called) = self.on_light {
            options.light_observer = Some(Box::new(move |light| {
                let seconds = |ns: i64| ns as f64 * 1e-9;
                let (begins, reported) = (seconds(light.predicted_ns), light.reported_ns.map(seconds));
                let fields = (light.set, light.content, light.video_frame, light.new, begins, reported);
                // The interpreter may be about to end.
                Python::try_attach(|py| {
                    if let Err(error) = called.call1(py, fields) {
                        error.write_unraisable(py, Some(called.bind(py)));
                    }
                });
            }));
        }
        let output = match self.window {
            true => Output::Window { monitor: self.monitor },
            false => Output::Memory { simulated: self.simulated, sink: None },
        };
        let session = eyebox::session::Session::start(content, output, options)?;
        let about = session.about();
        let rate = about.display_rate.hz();
        let about = (about.presenter.clone(), rate, about.set_frames, about.sub_frames, about.rolls);
        let running = StartedSession { session: Mutex::new(Some(session)), eye, frames };
        Ok(Session { running: OfProcess::new(running, "the session", "Leave it to the parent"), shape, about })
    }
}

impl EyeOptions {
    /// Opens the tracker. For "own" it also returns the sender for the samples of the program.
    fn tracking(&self, simulated: bool, eyepiece: Eyepiece) -> Answer<(Option<SampleSender>, Option<Tracking>)> {
        let Some(name) = &self.eye else { return Ok((None, None)) };
        let focus = [self.focus; 2];
        let settings = gaze::Settings { focus, eyepiece: Some(eyepiece), ..gaze::Settings::default() };
        let estimator = Estimator::new(settings, None)?;
        if name == "own" {
            let (eye, tracking) = Tracking::pushed(estimator);
            return Ok((Some(eye), Some(tracking)));
        }
        let spec: trackers::Spec = name.parse()?;
        let options = trackers::Options { real_time: !simulated, ..trackers::Options::default() };
        Ok((None, Some(Tracking::open(&spec, &options, estimator)?)))
    }

    /// Returns the time that work takes, which is fixed on a simulated clock and measured on a real one.
    fn cost(&self, simulated: bool) -> Answer<Cost> {
        match (simulated, self.step_time) {
            (true, Some(step)) => {
                let (step, encode) = (time(step, "step_time")?, time(self.encode_time, "encode_time")?);
                Ok(Cost::Fixed { step, encode })
            }
            (true, None) => {
                Err(Failure::Argument("a simulated clock has to be told what a step takes: step_time".into()))
            }
            (false, Some(_)) => Err(Failure::Argument("step_time is for clock=\"simulated\" alone".into())),
            (false, None) => Ok(Cost::Measured),
        }
    }

    fn set(&self, live: &mut Live, simulated: bool) -> Answer<()> {
        live.policy = Policy { restart: self.restart, steering: RefineSettings::from_toml(&self.steering)? };
        (live.cost, live.whole_sets, live.moments) = (self.cost(simulated)?, self.whole_sets, self.moments);
        live.display_latency = time(self.display_latency, "latency")?.min(Duration::from_secs(10));
        Ok(())
    }
}

/// Returns the rows, columns and channels of the video frames of an encoder.
fn shape(encoder: &Encoder) -> [usize; 3] {
    let [_, rows, columns, channels] = encoder.video_shape();
    [rows, columns, channels]
}

impl Session {
    fn lock(&self) -> Answer<MutexGuard<'_, Option<eyebox::session::Session>>> {
        Ok(self.running.get()?.session.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn command(&self, command: Command) -> PyResult<()> {
        self.lock()?.iter().for_each(|session| session.command(command));
        Ok(())
    }

    fn played(sequence: Sequence, display: &Display, speed: f64, looped: bool, at: Where) -> Answer<Self> {
        let mut play = Play::new(sequence, &display.0)?;
        (play.speed, play.looped) = (speed, play.looped || looped);
        let (shape, endless) = (shape(&play.encoder), play.looped);
        at.start(play.into(), None, shape, endless)
    }
}

#[pymethods]
impl Session {
    /// Shows a hologram as it was solved.
    #[staticmethod]
    fn play(py: Python<'_>, hologram: Py<Hologram>, display: Py<Display>, shown: Where) -> PyResult<Self> {
        run(py, false, move |_| {
            let hologram = hologram.get().0.clone();
            let sequence = Sequence::single(Path::new(&hologram.scene.clone()), hologram);
            Self::played(sequence, display.get(), 1.0, true, shown)
        })
    }

    /// Shows a file of a hologram or a sequence at `speed` times its own speed.
    #[staticmethod]
    fn play_file(
        py: Python<'_>,
        file: PathBuf,
        display: Py<Display>,
        speed: f64,
        looped: bool,
        shown: Where,
    ) -> PyResult<Self> {
        run(py, false, move |_| Self::played(Opening::default().sequence(&file)?, display.get(), speed, looped, shown))
    }

    /// Shows a hologram of a scene, refined for the tracked pupil.
    #[staticmethod]
    #[allow(clippy::too_many_arguments, reason = "Python names them; `_show.py` is the interface")]
    fn follow(
        py: Python<'_>,
        hologram: Py<Hologram>,
        scene: Py<Scene>,
        display: Py<Display>,
        engine: Py<Engine>,
        following: EyeOptions,
        shown: Where,
        other_scene: bool,
    ) -> PyResult<Self> {
        run(py, engine.get().on_device, move |_| {
            let (hologram, scene, display, engine) = (hologram.get(), scene.get(), display.get(), engine.get());
            check_scene(&hologram.0, scene, other_scene)?;
            let mut whole = hologram.0.clone();
            if whole.metadata.exposure_assumed {
                engine.lend(|engine| Ok(whole.fit_exposure(&scene.field, engine)?))?;
            }
            let depths = whole.metadata.solve.as_ref().map_or([f64::NEG_INFINITY, f64::INFINITY], |s| s.depth);
            let eyepiece = Eyepiece { focal_length: whole.focal_length, depths };
            let (eye, tracking) = following.tracking(shown.simulated, eyepiece)?;
            let mut live = Live::of_hologram(&whole, &scene.field, &display.0, engine.backend()?, tracking)?;
            following.set(&mut live, shown.simulated)?;
            let shape = shape(&live.encoder);
            shown.start(live.into(), eye, shape, true)
        })
    }

    /// Shows frames that another process sends as live:NAME. `content` is the colors of the display, the sub-frames,
    /// the kind of frames, and the most views along an axis.
    #[cfg(target_os = "linux")]
    #[staticmethod]
    fn live(
        py: Python<'_>,
        name: String,
        display: Py<Display>,
        content: (Vec<String>, usize, String, u32),
        engine: Py<Engine>,
        following: EyeOptions,
        shown: Where,
    ) -> PyResult<Self> {
        use eyebox::session::{LiveInput, LiveKind, darkness};
        run(py, engine.get().on_device, move |_| {
            let (display, (names, frames, ask, views)) = (&display.get().0, content);
            let backend = engine.get().backend()?;
            let colors = crate::display::colors(display, &names)?;
            let kind = match &ask[..] {
                "views" => LiveKind::Views,
                "depth" => LiveKind::ColorAndDepth,
                "layers" => LiveKind::Layers,
                _ => return Err(Failure::Argument(format!("ask is {ask:?}: it must be views, depth or layers"))),
            };
            let eyepiece = Eyepiece { focal_length: display.focal_length, depths: [f64::NEG_INFINITY, f64::INFINITY] };
            let (eye, tracking) = following.tracking(shown.simulated, eyepiece)?;
            let encoder = Encoder::new(display, &colors, frames)?;
            let shape = shape(&encoder);
            let seed = RefineSettings::from_toml(&following.steering)?.seed;
            let parts = darkness(display, &colors, frames, seed)?;
            let mut live = Live::new(parts, encoder, backend.clone(), tracking);
            following.set(&mut live, shown.simulated)?;
            live.whole.focus = [following.focus; 2];
            let mut input = LiveInput::open(&name, display, &colors, views, kind)?;
            // The host decodes frames that a device cannot decode.
            input.decode_with(&backend)?;
            live.scenes = Some(Box::new(input));
            let live = live.with_start_tables(&mut |_| true)?;
            shown.start(live.into(), eye, shape, true)
        })
    }

    /// Returns the next video frame that was shown. Waits up to `within` seconds, or as long as the session shows
    /// content.
    fn frame<'py>(&self, py: Python<'py>, within: Option<f64>) -> PyResult<Option<Frame<'py>>> {
        let mut left = within.map(|within| time(within, "timeout")).transpose()?.unwrap_or(Duration::MAX);
        let shown = loop {
            let patience = left.min(OFTEN);
            let frames = &self.running.get()?.frames;
            match py.detach(|| frames.take(patience)) {
                Ok(shown) => break shown,
                Err(()) => left = left.saturating_sub(patience),
            }
            py.check_signals()?;
            if left.is_zero() {
                break None;
            }
        };
        let Some(DisplayedFrame { pixels, number, lit_ns, hologram, part, new, late }) = shown else { return Ok(None) };
        let pixels = crate::arrays::bytes(py, pixels, self.shape)?;
        Ok(Some((pixels, number, lit_ns as f64 * 1e-9, hologram, part, new, late)))
    }

    /// Adds a sample of the pupil with its velocity, `age` seconds old. A NaN position is a closed eye.
    fn look(&self, x: f64, y: f64, diameter: Option<f64>, velocity: Option<(f64, f64)>, age: f64) -> PyResult<()> {
        let eye = self.running.get()?.eye.as_ref();
        let eye =
            eye.ok_or_else(|| Failure::Argument("nobody's samples are waited for: give eye=\"own\" to show".into()))?;
        if let Some(far) = [x, y].into_iter().find(|at| at.is_finite() && at.abs() > 0.1) {
            return Err(Failure::Argument(format!("x or y is {far}: it must be -0.1 to 0.1 m, or NaN")).into());
        }
        let diameter = diameter.filter(|d| !d.is_nan());
        if let Some(wrong) = diameter.filter(|d| !(0.0..=0.02).contains(d)) {
            return Err(Failure::Argument(format!("diameter is {wrong}: it must be 0 to 0.02 m, or NaN")).into());
        }
        eye.moving_pupil([x, y], velocity.map(|(x, y)| [x, y]), diameter, time(age, "age")?);
        Ok(())
    }

    /// Turns refinement for the tracked pupil on or off.
    fn steer(&self, steered: bool) -> PyResult<()> {
        self.lock()?.iter().for_each(|session| session.steer(steered));
        Ok(())
    }

    /// Pauses or resumes the content.
    fn pause(&self, paused: bool) -> PyResult<()> {
        self.command(Command::Pause(paused))
    }

    /// Moves forward by this number of holograms.
    fn seek(&self, holograms: i64) -> PyResult<()> {
        self.command(Command::Seek(holograms))
    }

    /// Returns whether the session still shows content.
    fn is_running(&self) -> PyResult<bool> {
        Ok(self.lock()?.as_ref().is_some_and(eyebox::session::Session::is_running))
    }

    #[getter]
    fn about(&self) -> About {
        self.about.clone()
    }

    /// The number of video frames that were dropped because Python did not take them in time.
    #[getter]
    fn left_out(&self) -> PyResult<u64> {
        Ok(self.running.get()?.frames.left_out())
    }

    /// Returns the state of the session as JSON, or `None` after its end.
    fn status(&self) -> PyResult<Option<String>> {
        let session = self.lock()?;
        let Some(session) = session.as_ref() else { return Ok(None) };
        let now = session.status();
        let mut all = now.report(session.about()).to_json();
        if let Some(live) = now.live {
            all["sets_new"] = json!(live.sets_new);
            all["sets_repeated"] = json!(live.sets_repeated);
            all["steps"] = json!(live.steps);
            all["restarts"] = json!(live.restarts);
            all["sample_to_light_ms"] = json!(live.sample_to_light_ms);
            all["sample_age_ms"] = json!(live.sample_age_ms);
            all["pupil_error_mm"] = json!(live.pupil_error_mm);
        }
        Ok(Some(all.to_string()))
    }

    /// Returns the notes since the last call, one line each.
    fn notes(&self) -> PyResult<Vec<String>> {
        let session = self.lock()?;
        let next = || match session.as_ref()?.event(Duration::ZERO)? {
            SessionEvent::Note(note) => Some(note),
            _ => None,
        };
        Ok(std::iter::from_fn(next).collect())
    }

    /// Stops the session. Returns its statistics as JSON and its error, or `None` if it was stopped before.
    fn stop(&self, py: Python<'_>) -> PyResult<Option<(String, Option<Py<PyBaseException>>)>> {
        let Some(session) = self.lock()?.take() else { return Ok(None) };
        self.running.get()?.frames.give_up();
        let ended = run(py, true, move |_| Ok(session.stop()))?;
        let error = ended.result.err().map(|error| PyErr::from(Failure::from(error)).into_value(py));
        Ok(Some((ended.statistics.to_json().to_string(), error)))
    }
}
