//! Updates the display model from pictures of a camera while a scene is shown, and solves the scene again.
//!
//! The camera of the bench takes a picture of the hologram on the screen at intervals, the display model is fitted to
//! the pictures, and the scene is solved again for the new model.
//!
//! A picture is taken only of the newest version of the hologram, once that is on the screen. It is discarded if the
//! screen changed during the exposure. [`NewestHologram`] receives both facts from the present thread, so nothing here
//! depends on the latency of sets.

use crate::calibrate::{CalibrateError, Calibration, CameraCommand, Follower, Look, Report};
use crate::files::asked_to_end;
use crate::hologram::{Hologram, NewestHologram};
use crate::optics::{Color, Display};
use crate::session::frame_log::error::SessionError;
use crate::session::playback::output::Output;
use crate::session::playback::pattern_output::PatternOutput;
use eyebox_base::reason;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

/// The interval at which a wait checks the screen and the end of the show.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// An event while a bench is followed.
#[derive(Debug)]
#[non_exhaustive]
pub enum FollowEvent<'a> {
    /// A picture was discarded because the screen changed during its exposure.
    Discarded,
    /// The model does not explain the latest pictures and stays unchanged.
    Unexplained(&'a Report),
    /// The latest pictures agree with the model, which counts as a new check for drift.
    Agrees(&'a Calibration),
    /// The model was updated from the bench. The scene is solved for it next.
    Followed(&'a Calibration),
    /// This version of the hologram was solved for the new model. It appears with the next set that is made.
    Replaced(u64),
    /// A picture or a fit failed, and the model stays unchanged. The next picture is taken nevertheless.
    Failed(&'a CalibrateError),
    /// The camera was lost. The model is no longer updated, and the show continues.
    Lost(&'a CalibrateError),
}

/// A bench whose model is updated while a scene is shown in one color.
pub struct BenchFollower<'a> {
    follower: Follower<'a>,
    display: Display,
    color: Color,
    every: Duration,
}

/// Takes a picture of these phases. After the exposure it calls the function, which returns true if the phases were on
/// the screen all the time.
type TakesPicture<'a> = dyn FnMut(&[f32], &dyn Fn() -> bool) -> Result<Look, CalibrateError> + 'a;

impl<'a> BenchFollower<'a> {
    /// Starts the command of the camera, and shows the dots on `output`, which is closed before this returns. The time
    /// `settle` lasts from the light of the dots until the modulator is stable. The time `every` lasts from one picture
    /// to the next.
    ///
    /// # Errors
    /// Returns [`SessionError::Calibrate`], and the errors of [`PatternOutput::open`].
    pub fn open(
        (display, color): (&Display, Color),
        (output, settle): (&Output, Duration),
        camera: &CameraCommand<'a>,
        every: Duration,
        say: &'a mut dyn FnMut(&str),
    ) -> Result<Self, SessionError> {
        let mut output = PatternOutput::open(output, display, &[color], settle)?;
        let follower = Follower::open(display, color, camera, &mut output, say)?;
        Ok(Self { follower, display: display.clone(), color, every })
    }

    /// Updates the model until the show `is_over`. A session plays `newest` at the same time on another thread. `solve`
    /// solves the scene for an updated model.
    ///
    /// # Errors
    /// Returns the errors of `solve` and `observe`, and [`SessionError::Setting`] for a hologram of another shape. The
    /// show continues without the follower.
    pub fn follow<E: From<SessionError>>(
        mut self,
        newest: &NewestHologram,
        is_over: &dyn Fn() -> bool,
        solve: &mut dyn FnMut(&Display) -> Result<Hologram, E>,
        observe: &mut dyn FnMut(FollowEvent) -> Result<(), E>,
    ) -> Result<(), E> {
        while waited(self.every, is_over) {
            let Some(look) = picture(newest, is_over, &mut |phases, stood| self.follower.look(phases, stood), observe)?
            else {
                break;
            };
            match look {
                Ok(Look::Discarded | Look::Taken) => {}
                Ok(Look::Fitted(fitted)) => self.take_over(&fitted, newest, solve, observe)?,
                Err(_) if asked_to_end().load(Ordering::SeqCst) => break,
                Err(error) if error.is_ended() => return observe(FollowEvent::Lost(&error)),
                Err(error) => observe(FollowEvent::Failed(&error))?,
            }
        }
        self.follower.close();
        Ok(())
    }

    /// Adopts the model of the fit if it explains the pictures, and solves the scene for it.
    fn take_over<E: From<SessionError>>(
        &mut self,
        fitted: &Calibration,
        newest: &NewestHologram,
        solve: &mut dyn FnMut(&Display) -> Result<Hologram, E>,
        observe: &mut dyn FnMut(FollowEvent) -> Result<(), E>,
    ) -> Result<(), E> {
        if !fitted.report.calibrated {
            return observe(FollowEvent::Unexplained(&fitted.report));
        }
        let changed = fitted.display.model(self.color) != self.display.model(self.color);
        self.display = fitted.display.clone();
        if !changed {
            return observe(FollowEvent::Agrees(fitted));
        }
        observe(FollowEvent::Followed(fitted))?;
        let other = |_| {
            SessionError::Setting(reason!(
                "other-size",
                "the solved scene has a different number of sub-frames or pixels"
            ))
        };
        let version = newest.replace(solve(&self.display)?).map_err(other)?;
        observe(FollowEvent::Replaced(version))
    }
}

/// Waits for this time. Returns true if the show continues after it.
fn waited(time: Duration, is_over: &dyn Fn() -> bool) -> bool {
    let begun = Instant::now();
    while begun.elapsed() < time && !is_over() {
        thread::sleep(POLL_INTERVAL.min(time));
    }
    !is_over()
}

/// Waits until the newest version is on the screen and takes a picture of it. If the screen changed during the
/// exposure, it takes another one. Returns `None` after the end of the show.
fn picture<E>(
    newest: &NewestHologram,
    is_over: &dyn Fn() -> bool,
    take: &mut TakesPicture,
    observe: &mut dyn FnMut(FollowEvent) -> Result<(), E>,
) -> Result<Option<Result<Look, CalibrateError>>, E> {
    while !is_over() {
        let Some((shown, mut hologram)) = newest.shown() else {
            thread::sleep(POLL_INTERVAL);
            continue;
        };
        let stood = || newest.on_screen() == Some(shown);
        match take(&hologram.colors.swap_remove(0).phases, &stood) {
            Ok(Look::Discarded) => observe(FollowEvent::Discarded)?,
            look => return Ok(Some(look)),
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hologram::{ColorHologram, OnScreen};
    use std::cell::{Cell, RefCell};
    use std::collections::VecDeque;

    /// Creates a hologram whose phases all have this value.
    fn hologram(phase: f32) -> Hologram {
        let text = "resolution = [4, 4]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
        let display = Display::from_toml(text, "test").unwrap();
        let (exposure, efficiency, phases) = (0.4, 0.4, vec![phase; 16]);
        let color = ColorHologram { color: Some(Color::Green), wavelength: 520e-9, exposure, efficiency, phases };
        Hologram::on(&display, 1, vec![color])
    }

    /// Takes pictures while the screen follows a script, one entry for each look, until the script ends. The second
    /// `OnScreen` is the state of the screen at the end of an exposure. Returns for each picture the phase, the version
    /// on the screen, and if it was kept.
    fn pictures(newest: &NewestHologram, script: &[[Option<OnScreen>; 2]]) -> (Vec<(f32, u64, bool)>, bool) {
        let script = RefCell::new(VecDeque::from(script.to_vec()));
        let (after, taken, discarded) = (Cell::new(None), RefCell::new(Vec::new()), Cell::new(0));
        let is_over = || {
            let Some([before, by_the_end]) = script.borrow_mut().pop_front() else { return true };
            newest.put_on_screen(before);
            after.set(by_the_end);
            false
        };
        let mut take = |phases: &[f32], stood: &dyn Fn() -> bool| {
            let version = newest.on_screen().map_or(u64::MAX, |shown| shown.version);
            newest.put_on_screen(None);
            newest.put_on_screen(after.get());
            taken.borrow_mut().push((phases[0], version, stood()));
            Ok(if stood() { Look::Taken } else { Look::Discarded })
        };
        let mut observe = |event: FollowEvent| {
            assert!(matches!(event, FollowEvent::Discarded));
            discarded.set(discarded.get() + 1);
            Ok::<(), SessionError>(())
        };
        let kept = picture(newest, &is_over, &mut take, &mut observe).unwrap().is_some();
        let taken = taken.into_inner();
        assert_eq!(discarded.get(), taken.iter().filter(|(_, _, kept)| !kept).count());
        (taken, kept)
    }

    #[test]
    fn a_picture_is_taken_of_the_newest_version_alone_and_thrown_away_if_the_screen_changed() {
        let newest = NewestHologram::new(hologram(1.0));
        let at = |version, since| Some(OnScreen { version, since });
        // The screen shows no version before the show is over.
        assert_eq!(pictures(&newest, &[[None; 2]; 3]), (vec![], false));
        let still = [at(0, 3); 2];
        assert_eq!(pictures(&newest, &[[None; 2], still]), (vec![(1.0, 0, true)], true));
        // After a replacement, the old version may be on the screen for a long time.
        newest.replace(hologram(2.0)).unwrap();
        assert_eq!(pictures(&newest, &[still, still, [None; 2], [at(1, 9); 2]]), (vec![(2.0, 1, true)], true));
        // The screen changes during an exposure, to another version, to none, and to something else and back.
        for by_the_end in [at(2, 12), None, at(1, 12)] {
            let script = [[at(1, 9), by_the_end], [None; 2], [at(1, 20); 2]];
            assert_eq!(pictures(&newest, &script), (vec![(2.0, 1, false), (2.0, 1, true)], true), "{by_the_end:?}");
        }
    }
}
