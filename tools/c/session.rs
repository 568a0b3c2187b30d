//! Sessions: what is shown, video frame by video frame, at the caller's own pace.

use crate::arrays::{given, hand_over, put, room, text};
use crate::encoder::EyeboxVideo;
use crate::failure::{Failure, answer, free, lock, starts_threads};
use crate::scene::scene_of;
use crate::{EyeboxDisplay, EyeboxEngine, EyeboxHologram, EyeboxScene, EyeboxStatus};
use eyebox::encode::Encoder;
use eyebox::gaze::{Estimator, Eyepiece, Settings};
use eyebox::hologram::Sequence;
use eyebox::present::Rate;
use eyebox::session::{Live, Play, SessionOptions, TickedSession, Tracking};
use eyebox::solve::RefineSettings;
use eyebox::trackers::{SampleSender, now_ns};
use std::ffi::{c_char, c_void};
use std::mem::MaybeUninit;
use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

/// Farthest position of a pupil's center along an axis, metres: beyond any eyebox.
const FARTHEST_M: f64 = 0.1;
/// Widest pupil, metres: twice the widest that eyes have.
const WIDEST_M: f64 = 0.02;

/// A hologram on a display that the caller drives: each tick gives the video frame that is next. What is refined is refined
/// meanwhile, on threads of its own.
pub struct EyeboxSession {
    session: Mutex<TickedSession>,
    eye: Option<SampleSender>,
    video: EyeboxVideo,
}

/// A sample of the caller's eye tracker.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxSample {
    /// Where the pupil's centre was, metres to the right; NaN where the eye is closed.
    pub x_m: f64,
    /// Down.
    pub y_m: f64,
    /// Its diameter, metres; 0 or NaN if the tracker does not measure it.
    pub diameter_m: f64,
    /// Seconds since it was there: what the tracker and its way here take, 0 to 10.
    pub age_s: f64,
}

/// What a tick gave.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxFrame {
    /// Whether there is one: 0 once what is shown has ended, and then nothing was written.
    pub shown: i32,
    /// Whether a set begins with it; `set` says whether it is another one.
    pub begins: i32,
    /// Which video frame of its set, from 0.
    pub part: u64,
    /// Which video frame of the display, from 0; those that no tick came for are counted.
    pub number: u64,
    /// The number of the refined set, or of the hologram; -1 for the picture that is shown before there is any.
    pub set: i64,
}

/// What a session did so far. Of what is not refined, the counts from `steps` on are 0 and the times NaN.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxAccount {
    /// Video frames of the display, taken or missed.
    pub video_frames: u64,
    /// Of them, those that no tick came for in time.
    pub missed: u64,
    /// Sets begun.
    pub sets: u64,
    /// Of them, those of the picture that is shown before there is any.
    pub idle_sets: u64,
    /// Steps of refinement, of all colours.
    pub steps: u64,
    /// Sets that were new,
    pub sets_new: u64,
    /// and that were shown again.
    pub sets_repeated: u64,
    /// How often refinement began again, after a jump of the eye.
    pub restarts: u64,
    /// From a sample to its first light, the median, milliseconds.
    pub sample_to_light_ms: f64,
    /// How old the newest sample was at the newest light, milliseconds.
    pub sample_age_ms: f64,
}

fn video(encoder: &Encoder) -> EyeboxVideo {
    let [frames, rows, columns, channels] = encoder.video_shape();
    EyeboxVideo { frames, rows, columns, channels, bytes: rows * columns * channels }
}

fn options(rate_hz: f64) -> Result<SessionOptions, Failure> {
    let mut options = SessionOptions::default();
    options.display_rate = Some(Rate::from_hz(rate_hz)?);
    Ok(options)
}

/// Shows a hologram as it was solved, on a display of so many video frames a second.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_play(
    hologram: Option<&EyeboxHologram>,
    display: Option<&EyeboxDisplay>,
    rate_hz: f64,
    session: Option<&mut MaybeUninit<*mut EyeboxSession>>,
) -> EyeboxStatus {
    answer(|| {
        starts_threads();
        hand_over(session, || {
            let hologram = given(hologram, "hologram")?.hologram.clone();
            let sequence = Sequence::single(Path::new(&hologram.scene.clone()), hologram);
            let play = Play::new(sequence, &given(display, "display")?.0)?;
            let video = video(&play.encoder);
            let session = Mutex::new(TickedSession::start(play, options(rate_hz)?)?);
            Ok(EyeboxSession { session, eye: None, video })
        })
    })
}

/// Shows a hologram that is refined for where the eye is, as `eyebox_session_look` says. The scene was loaded for the hologram's
/// display, has its colours, and may be freed afterwards; null takes the one that the hologram was solved from, read as it was
/// then. `display` is what is encoded for. `settings` is TOML, or null for the
/// defaults: the fields of eyebox::solve::RefineSettings, as of `eyebox_refiner_new`. It computes where `engine` does, beside it.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_session_follow(
    hologram: Option<&EyeboxHologram>,
    scene: Option<&EyeboxScene>,
    display: Option<&EyeboxDisplay>,
    settings: *const c_char,
    engine: Option<&EyeboxEngine>,
    rate_hz: f64,
    session: Option<&mut MaybeUninit<*mut EyeboxSession>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(session, || {
            let hologram = &given(hologram, "hologram")?.hologram;
            let (display, engine) = (&given(display, "display")?.0, given(engine, "engine")?);
            // SAFETY: the header asks callers for texts that end with zero.
            let settings = if settings.is_null() { "" } else { unsafe { text(settings, "settings") }? };
            let steering = RefineSettings::from_toml(settings)?;
            let field = scene_of(scene, hologram)?;
            let depths = hologram.metadata.solve.as_ref().map_or([f64::NEG_INFINITY, f64::INFINITY], |s| s.depth);
            let eyepiece = Some(Eyepiece { focal_length: hologram.focal_length, depths });
            let estimator = Estimator::new(Settings { eyepiece, ..Settings::default() }, None);
            let (eye, tracking) = Tracking::pushed(estimator?);
            let backend = engine.backend.clone();
            let mut live = Live::of_hologram(hologram, &field, display, backend, Some(tracking))?;
            live.policy.steering = steering;
            let video = video(&live.encoder);
            let session = Mutex::new(TickedSession::start(live, options(rate_hz)?)?);
            Ok(EyeboxSession { session, eye: Some(eye), video })
        })
    })
}

/// The sizes of what ticks give: `frames` video frames a set, and `bytes` of one of them.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_video(
    session: Option<&EyeboxSession>,
    video: Option<&mut MaybeUninit<EyeboxVideo>>,
) -> EyeboxStatus {
    answer(|| put(video, || Ok(given(session, "session")?.video)))
}

/// Gives a sample of the caller's eye tracker. It waits for nothing, a tick least of all.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_look(session: Option<&EyeboxSession>, sample: Option<&EyeboxSample>) -> EyeboxStatus {
    answer(|| look(session, sample, None))
}

/// The same of a tracker that tells how fast the pupil moves, metres a second: to the right, and down. NaN where it does not know.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_look_moving(
    session: Option<&EyeboxSession>,
    sample: Option<&EyeboxSample>,
    x_m_s: f64,
    y_m_s: f64,
) -> EyeboxStatus {
    answer(|| look(session, sample, Some([x_m_s, y_m_s])))
}

fn look(
    session: Option<&EyeboxSession>,
    sample: Option<&EyeboxSample>,
    velocity: Option<[f64; 2]>,
) -> Result<(), Failure> {
    let (session, sample) = (given(session, "session")?, given(sample, "sample")?);
    let eye = session.eye.as_ref();
    let eye = eye.ok_or_else(|| Failure::argument("session", "one that plays", "one that follows an eye"))?;
    let EyeboxSample { x_m, y_m, diameter_m, age_s } = *sample;
    if !(0.0..=10.0).contains(&age_s) {
        return Err(Failure::argument("sample.age_s", age_s, "0 to 10 s"));
    }
    // Millimetres for metres would be a pupil that is nowhere; what is not finite is a closed eye.
    if let Some(far) = [x_m, y_m].into_iter().find(|at| at.is_finite() && at.abs() > FARTHEST_M) {
        return Err(Failure::argument("sample.x_m or y_m", far, "-0.1 to 0.1 m, or NaN for a closed eye"));
    }
    let diameter = Some(diameter_m).filter(|d| *d != 0.0 && !d.is_nan());
    if let Some(wrong) = diameter.filter(|d| !(0.0..=WIDEST_M).contains(d)) {
        return Err(Failure::argument(
            "sample.diameter_m",
            wrong,
            "0 to 0.02 m, 0 or NaN for one that is not measured",
        ));
    }
    eye.moving_pupil([x_m, y_m], velocity, diameter, Duration::from_secs_f64(age_s));
    Ok(())
}

/// Whether a session that follows an eye does: 0 shows the hologram for the whole eyebox, anything else follows.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_steer(session: Option<&EyeboxSession>, steered: i32) -> EyeboxStatus {
    answer(|| {
        lock(&given(session, "session")?.session)?.steer(steered != 0);
        Ok(())
    })
}

/// The video frame that is next, into memory of the caller's: (row, column, channel), 8 bits each, of as many bytes as
/// `eyebox_session_video` says. It lights up in `lit_in_s` seconds, 0 to 1: what refinement aims at. Call it once for every video frame of
/// the display, in any thread; it waits for no step, and for no encoding.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_session_tick(
    session: Option<&EyeboxSession>,
    lit_in_s: f64,
    picture: *mut c_void,
    bytes: usize,
    frame: Option<&mut MaybeUninit<EyeboxFrame>>,
) -> EyeboxStatus {
    answer(|| {
        put(frame, || {
            let session = given(session, "session")?;
            if !(0.0..=1.0).contains(&lit_in_s) {
                return Err(Failure::argument("lit_in_s", lit_in_s, "0 to 1 s"));
            }
            // SAFETY: the header asks callers for as much memory as they say.
            let picture = unsafe { room(picture.cast::<u8>(), bytes, session.video.bytes, "picture") }?;
            let mut session = lock(&session.session)?;
            let lit_ns = now_ns().saturating_add((lit_in_s * 1e9) as u64);
            let Some(next) = session.tick(Some(lit_ns))? else {
                return Ok(EyeboxFrame { shown: 0, begins: 0, part: 0, number: 0, set: -1 });
            };
            for (out, byte) in picture.iter_mut().zip(&next.picture) {
                out.write(*byte);
            }
            let set = next.content.map_or(-1, |set| i64::try_from(set).unwrap_or(i64::MAX));
            let (part, number) = (next.video_frame, next.number);
            Ok(EyeboxFrame { shown: 1, begins: next.new.into(), part, number, set })
        })
    })
}

/// What a session did so far, as of its last tick.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_account(
    session: Option<&EyeboxSession>,
    account: Option<&mut MaybeUninit<EyeboxAccount>>,
) -> EyeboxStatus {
    answer(|| {
        put(account, || {
            let status = lock(&given(session, "session")?.session)?.status();
            let (account, live) = (status.account, status.live.unwrap_or_default());
            Ok(EyeboxAccount {
                video_frames: account.video_frames,
                missed: account.missed_presents,
                sets: account.sets,
                idle_sets: account.idle_sets,
                steps: live.steps,
                sets_new: live.sets_new,
                sets_repeated: live.sets_repeated,
                restarts: live.restarts,
                sample_to_light_ms: live.sample_to_light_ms.unwrap_or(f64::NAN),
                sample_age_ms: live.sample_age_ms.unwrap_or(f64::NAN),
            })
        })
    })
}

/// Ends a session, and its threads with it.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_free(session: Option<Box<EyeboxSession>>) {
    free(session);
}
