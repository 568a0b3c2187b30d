//! The functions for sessions, which give the caller one video frame at each of its ticks.

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

/// The largest distance of a pupil's center from 0 along an axis (m). It is outside of any eyebox.
const FARTHEST_M: f64 = 0.1;
/// The largest diameter of a pupil (m), which is twice the largest diameter of an eye's pupil.
const WIDEST_M: f64 = 0.02;

/// A session, which shows a hologram on a display that the caller drives. Each tick gives the next video frame.
/// Refinement runs on threads of the session. Calls with one session wait for each other, except for
/// `eyebox_session_look` and `eyebox_session_look_moving`.
pub struct EyeboxSession {
    session: Mutex<TickedSession>,
    eye: Option<SampleSender>,
    video: EyeboxVideo,
}

/// A sample of the caller's eye tracker.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxSample {
    /// Center of the pupil along the columns (m, -0.1 to 0.1). Positive values are to the right. NaN states that the
    /// eye is closed.
    pub x_m: f64,
    /// Center of the pupil along the rows (m, -0.1 to 0.1). Positive values are down. NaN states that the eye is
    /// closed.
    pub y_m: f64,
    /// Diameter of the pupil (m, 0 to 0.02). Set it to 0 or NaN if the tracker does not measure it.
    pub diameter_m: f64,
    /// Age of the sample (s, 0 to 10), which is the latency of the tracker and of the connection to it.
    pub age_s: f64,
}

/// The description of the video frame that a tick gave.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxFrame {
    /// 1 if there is a video frame. It is 0 after the end of the content, and then the tick wrote no picture.
    pub shown: i32,
    /// 1 if a multiplex set begins with this video frame, otherwise 0. If `set` is unchanged, the same set repeats.
    pub begins: i32,
    /// Index of the video frame in its multiplex set, from 0.
    pub part: u64,
    /// Number of the video frame of the display, from 0. Video frames without a tick count too.
    pub number: u64,
    /// Number of the refined set, or of the hologram. It is -1 for the idle picture that is shown before the first set.
    pub set: i64,
}

/// The statistics of a session. Without refinement, the counts from `steps` on are 0 and the times are NaN.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct EyeboxAccount {
    /// Number of video frames of the display, taken or missed.
    pub video_frames: u64,
    /// Number of these video frames for which no tick came in time.
    pub missed: u64,
    /// Number of multiplex sets that began.
    pub sets: u64,
    /// Number of these sets that show the idle picture, which precedes the first content.
    pub idle_sets: u64,
    /// Number of refinement steps over all colors.
    pub steps: u64,
    /// Number of sets that were new.
    pub sets_new: u64,
    /// Number of sets that were shown again.
    pub sets_repeated: u64,
    /// Number of restarts of the refinement after a jump of the eye.
    pub restarts: u64,
    /// Median time from a sample to its first light (ms).
    pub sample_to_light_ms: f64,
    /// Age of the newest sample at the newest light (ms).
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

/// Starts a session that shows a hologram as it was solved. The display shows `rate_hz` video frames per second (0.001
/// to 100000). The hologram and the display may be freed after this call. Free the session with `eyebox_session_free`.
///
/// Fails with EYEBOX_STATUS_SESSION if the rate is outside its range, or if the hologram has another size than the
/// display. Fails with EYEBOX_STATUS_ENCODE if the display cannot show the colors and sub-frames of the hologram.
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

/// Starts a session that shows a hologram and refines it for the pupil of `eyebox_session_look`. The scene must be
/// loaded for the hologram's display and have its colors. If `scene` is null, eyebox loads the scene from which the
/// hologram was solved, with the settings of the solve. The video frames are encoded for `display`, which shows
/// `rate_hz` video frames per second (0.001 to 100000). The session computes on the device of `engine`, with engines of
/// its own. All handles may be freed after this call. Free the session with `eyebox_session_free`.
///
/// Set `settings` to a TOML text, or to null for the defaults. The keys are the same as for `eyebox_refiner_new`.
///
/// Fails with EYEBOX_STATUS_SOLVE if the settings are wrong. Fails with EYEBOX_STATUS_HOLOGRAM if the scene is not
/// found, is not the scene of the hologram, or has another size. Fails with EYEBOX_STATUS_ENCODE if the display cannot
/// show the colors and sub-frames of the hologram. Fails with EYEBOX_STATUS_SESSION if the rate is outside its range,
/// if the hologram has another size than the display, or if the scene lacks a color of the hologram.
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
            // SAFETY: The header requires texts that end with a zero byte.
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

/// Writes the shape of the pictures of `eyebox_session_tick` into `video`. The field `frames` is the number of video
/// frames per multiplex set, and `bytes` is the size of one of them.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_video(
    session: Option<&EyeboxSession>,
    video: Option<&mut MaybeUninit<EyeboxVideo>>,
) -> EyeboxStatus {
    answer(|| put(video, || Ok(given(session, "session")?.video)))
}

/// Gives a sample of the caller's eye tracker to a session that follows the eye. It never waits, and any thread may
/// call it while another thread ticks. Fails with EYEBOX_STATUS_ARGUMENT if a value is outside its range, or if
/// `eyebox_session_play` started the session.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_look(session: Option<&EyeboxSession>, sample: Option<&EyeboxSample>) -> EyeboxStatus {
    answer(|| look(session, sample, None))
}

/// Gives a sample like `eyebox_session_look`, with the velocity of the pupil from the tracker. The velocity is `x_m_s`
/// to the right and `y_m_s` down (m/s). Set it to NaN if it is unknown.
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
    // A position in millimeters instead of meters is outside of any eyebox. A position that is not finite is a closed
    // eye.
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

/// Turns refinement for the tracked pupil on or off. If `steered` is 0, the session shows the hologram for the whole
/// eyebox. Any other value turns refinement on.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_steer(session: Option<&EyeboxSession>, steered: i32) -> EyeboxStatus {
    answer(|| {
        lock(&given(session, "session")?.session)?.steer(steered != 0);
        Ok(())
    })
}

/// Writes the next video frame into `picture`, and its description into `frame`. The picture is an array (row, column,
/// channel) of 8-bit values in memory of the caller, and `bytes` must be the size from `eyebox_session_video`. Set
/// `lit_in_s` to the time until the frame lights up (s, 0 to 1). Refinement predicts the pupil for this time. Call this
/// function once for every video frame of the display, on any thread. It waits neither for a step nor for an encoding.
///
/// Fails with EYEBOX_STATUS_ARGUMENT if `bytes` differs or `lit_in_s` is outside its range.
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
            // SAFETY: The header requires memory of the stated size.
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

/// Writes the statistics of a session, as of its last tick, into `account`.
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

/// Ends a session with its threads, and frees it. Null is allowed and has no effect.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_session_free(session: Option<Box<EyeboxSession>>) {
    free(session);
}
