//! A model that follows a bench while holograms are shown: the camera takes a picture of what is on the screen now and then, and the
//! latest pictures tell what has drifted.

use super::acquire::{AVERAGE, Taken, check, two_pi_level};
use super::bench::{Event, ShowsPatterns};
use super::calibrated::Calibration;
use super::captures::{Ask, Session, Shot};
use super::error::CalibrateError;
use super::link::Link;
use super::pattern::{self, Pattern};
use super::stages;
use crate::optics::{Color, Display};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::path::Path;
use std::time::Duration;

/// Pictures that a fit is of: the latest ones.
const LATEST: usize = 4;
/// The fewest that tell anything.
const FEWEST: usize = 3;

/// How a bench is followed.
#[derive(Debug, Clone, Copy)]
pub struct Following<'a> {
    /// The camera's command, as of [`Bench::Command`](super::Bench::Command).
    pub command: &'a str,
    /// Where its pictures are kept.
    pub keep: Option<&'a Path>,
    /// Limit for every question, in place of the protocol's own.
    pub limit: Option<Duration>,
    /// Where an iris stands that does not move: x, y, diameter, mm.
    pub iris_mm: Option<[f64; 3]>,
}

/// A bench whose model follows it.
pub struct Follower<'a> {
    session: Session<'a>,
    display: Display,
    color: Color,
    iris_mm: Option<[f64; 3]>,
    two_pi_level: f64,
    /// Dots and darkness, of the beginning.
    first: Vec<Shot>,
    latest: VecDeque<Shot>,
    looks: usize,
}

impl<'a> Follower<'a> {
    /// Starts the camera's command and takes the pictures of the dots and of darkness. `shows` shows the dots, and later what is
    /// looked at: a hologram that is on the screen already needs nothing.
    ///
    /// # Errors
    /// [`CalibrateError`].
    pub fn open(
        display: &Display,
        color: Color,
        following: &Following<'a>,
        shows: &'a mut dyn ShowsPatterns,
        say: &'a mut dyn FnMut(&str),
    ) -> Result<Self, CalibrateError> {
        let Following { command, keep, limit, iris_mm } = *following;
        let (link, hello) = Link::start(command, limit, say)?;
        let named = check(display, color, &hello, false)?;
        let (optics, two_pi_level) = (display.optics(color)?, two_pi_level(display, color));
        let mut session = Session::new(link, hello, keep, named, usize::MAX)?;
        session.adds();
        session.shows = Some(shows);
        let dots = pattern::dots_pattern([display.height, display.width], two_pi_level);
        let place = session.hello.iris.is_some().then(|| pattern::dots_iris(&optics));
        let ask = Ask { show: Some(("dots", &dots)), iris_mm: place, focus_mm: 0.0, average: AVERAGE };
        let mut first: Vec<Shot> = session.take(&ask)?.into_iter().collect();
        if first.is_empty() {
            let text = session.left_out.join("; ");
            return Err(CalibrateError::Refused { what: "take the picture of the dots".into(), text });
        }
        if first.iter().any(|shot| shot.iris_mm.or(iris_mm).is_none()) {
            let reason = "its iris does not move, and nothing says where it stands: answer iris_mm, or give `iris` X,Y,DIAMETER in mm";
            return Err(CalibrateError::Bench { display: display.name.clone(), reason: reason.into() });
        }
        if session.hello.camera.dark {
            first.extend(session.take(&Ask { show: None, iris_mm: None, focus_mm: 0.0, average: AVERAGE })?);
        }
        let (display, latest) = (display.clone(), VecDeque::new());
        Ok(Self { session, display, color, iris_mm, two_pi_level, first, latest, looks: 0 })
    }

    /// Takes a picture of a hologram that is on the screen: `phases` (sub-frame, row, column), radians. From the third picture on, fits
    /// drift to the latest four. The model follows if they are explained, and is then that of the next fit.
    ///
    /// # Errors
    /// [`CalibrateError`].
    pub fn look(&mut self, phases: &[f32]) -> Result<Option<Calibration>, CalibrateError> {
        let (height, width) = (self.display.height, self.display.width);
        let drive = phases.iter().map(|phase| f64::from(*phase).rem_euclid(TAU) as f32).collect();
        let frames = phases.len() / (height * width);
        let shown = Pattern { frames, height, width, two_pi_level: self.two_pi_level, drive };
        let iris = pattern::drift_iris(&self.session.hello, &self.display.optics(self.color)?, self.looks);
        let name = format!("shown-{}", self.looks);
        self.looks += 1;
        let iris_mm = self.session.hello.iris.is_some().then_some(iris);
        let Some(mut shot) =
            self.session.take(&Ask { show: Some((&name, &shown)), iris_mm, focus_mm: 0.0, average: AVERAGE })?
        else {
            return Ok(None);
        };
        shot.iris_mm = shot.iris_mm.or(self.iris_mm);
        self.latest.push_back(shot);
        if self.latest.len() > LATEST {
            self.latest.pop_front();
        }
        if self.latest.len() < FEWEST {
            return Ok(None);
        }
        let shots: Vec<Shot> = self.first.iter().chain(&self.latest).cloned().collect();
        let taken = Taken::of(self.session.hello.clone(), shots, self.two_pi_level);
        let calibrated = stages::run(&self.display, self.color, taken, true, &|_: Event| {})?;
        self.display = calibrated.display.clone();
        Ok(Some(calibrated))
    }

    /// Ends the camera's command.
    pub fn close(mut self) {
        self.session.end();
    }
}
