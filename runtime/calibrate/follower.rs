//! Lets a model follow its bench while holograms are shown.
//!
//! The camera takes a picture of the hologram on the screen now and then, and drift is fitted to the latest pictures.

use super::acquire::{CaptureSet, check, two_pi_level};
use super::bench::{CameraCommand, Event, ShowsPatterns};
use super::calibrated::Calibration;
use super::captures::{Ask, Session, Shot};
use super::error::CalibrateError;
use super::link::Link;
use super::pattern::{self, Pattern};
use super::stages;
use eyebox_optics::{Color, Display};
use std::collections::VecDeque;
use std::f64::consts::TAU;

/// Number of pictures of a fit, which are the latest ones.
const LATEST: usize = 4;
/// The least number of pictures for a fit.
const FEWEST: usize = 3;

/// The result of a picture of a hologram on the screen.
#[derive(Debug)]
pub enum Look {
    /// The picture was dropped, because the screen changed during its exposure.
    Discarded,
    /// No fit was made, because there are too few pictures yet or the camera could not take this one.
    Taken,
    /// Drift was fitted to the latest pictures.
    Fitted(Box<Calibration>),
}

/// Shows nothing, because the hologram is already on the screen.
struct AlreadyShown;

impl ShowsPatterns for AlreadyShown {
    fn sub_frames(&self) -> usize {
        1
    }

    fn show(&mut self, _: Color, _: &[f32]) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        Ok(())
    }
}

/// A bench whose model follows its drift.
pub struct Follower<'a> {
    session: Session<'a>,
    display: Display,
    color: Color,
    iris_mm: Option<[f64; 3]>,
    two_pi_level: f64,
    /// The first pictures, of the dots and of darkness.
    first: Vec<Shot>,
    latest: VecDeque<Shot>,
    looks: usize,
}

impl<'a> Follower<'a> {
    /// Starts the camera's command and takes the pictures of the dots, which `shows` shows, and of darkness.
    ///
    /// # Errors
    /// Returns a [`CalibrateError`] if the bench or its pictures cannot be used.
    pub fn open(
        display: &Display,
        color: Color,
        camera: &CameraCommand<'a>,
        shows: &mut dyn ShowsPatterns,
        say: &'a mut dyn FnMut(&str),
    ) -> Result<Self, CalibrateError> {
        let CameraCommand { command, keep, limit, iris_mm } = *camera;
        let (link, hello) = Link::start(command, limit, say)?;
        let named = check(display, color, &hello, false)?;
        let two_pi_level = two_pi_level(display, color);
        let mut session = Session::new(link, hello, keep, named, usize::MAX)?;
        session.adds();
        // The type has no size, so this leaks no memory.
        session.shows = Some(Box::leak(Box::new(AlreadyShown)));
        let dots = pattern::dots_pattern([display.height, display.width], two_pi_level);
        shows.show(color, &dots.drive).map_err(CalibrateError::Shows)?;
        let first = session.take_first(display, &dots, iris_mm)?;
        let (display, latest) = (display.clone(), VecDeque::new());
        Ok(Self { session, display, color, iris_mm, two_pi_level, first, latest, looks: 0 })
    }

    /// Takes a picture of a hologram that is on the screen. `phases` are (sub-frame, row, column), radians. Drift is
    /// fitted to the latest four from the third picture on. If the fit explains them, the model changes and the next
    /// fit starts from it. `stood` returns, after the exposure, if the hologram was on the screen all the time.
    ///
    /// # Errors
    /// Returns a [`CalibrateError`] if the bench or its pictures cannot be used.
    pub fn look(&mut self, phases: &[f32], stood: &dyn Fn() -> bool) -> Result<Look, CalibrateError> {
        let (height, width) = (self.display.height, self.display.width);
        let drive = phases.iter().map(|phase| f64::from(*phase).rem_euclid(TAU) as f32).collect();
        let frames = phases.len() / (height * width);
        let shown = Pattern { frames, height, width, two_pi_level: self.two_pi_level, drive };
        let iris = pattern::drift_iris(&self.session.hello, &self.display.optics(self.color)?, self.looks);
        let name = format!("shown-{}", self.looks);
        let before = self.session.next();
        let iris_mm = self.session.hello.iris.is_some().then_some(iris);
        let ask = Ask { show: Some((&name, &shown)), iris_mm, focus_mm: 0.0 };
        let Some(mut shot) = self.session.take(&ask)? else {
            self.looks += 1;
            return Ok(Look::Taken);
        };
        if !stood() {
            self.session.leave_out_from(before)?;
            return Ok(Look::Discarded);
        }
        self.looks += 1;
        shot.iris_mm = shot.iris_mm.or(self.iris_mm);
        self.latest.push_back(shot);
        if self.latest.len() > LATEST {
            self.latest.pop_front();
        }
        if self.latest.len() < FEWEST {
            return Ok(Look::Taken);
        }
        let shots: Vec<Shot> = self.first.iter().chain(&self.latest).cloned().collect();
        let taken = CaptureSet::of(self.session.hello.clone(), shots, self.two_pi_level);
        let calibrated = stages::run(&self.display, self.color, taken, true, &|_: Event| {})?;
        self.display = calibrated.display.clone();
        Ok(Look::Fitted(Box::new(calibrated)))
    }

    /// Ends the camera's command.
    pub fn close(mut self) {
        self.session.end();
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs;

    /// A command that answers every question with the same picture.
    const CAMERA: &str = r#"while read -r line; do
  id=${line#*:}; id=${id%%,*}
  case $line in
    *hello*) echo "{\"id\":$id,\"protocol\":1,\"colors\":{\"green\":520},\"slm\":{\"resolution\":[64,64],\"pitch_um\":8},\"camera\":{\"resolution\":[8,8],\"bits\":12,\"auto_exposure\":true}}";;
    *) echo "{\"id\":$id,\"file\":\"$1\",\"full_scale\":4095,\"exposure_ms\":1}";;
  esac
done"#;

    struct Patterns(usize);

    impl ShowsPatterns for Patterns {
        fn sub_frames(&self) -> usize {
            1
        }

        fn show(&mut self, _: Color, phases: &[f32]) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
            assert_eq!(phases.len(), 64 * 64);
            self.0 += 1;
            Ok(())
        }
    }

    #[test]
    fn a_picture_is_thrown_away_if_the_screen_changed() {
        let here = tempfile::tempdir().expect("a folder");
        let (script, picture, kept) =
            (here.path().join("camera.sh"), here.path().join("picture.npy"), here.path().join("kept"));
        fs::write(&script, CAMERA).expect("a script");
        eyebox_base::files::write_npy(&picture, &[8, 8], &[100.0; 64]).expect("a picture");
        let command = format!("sh '{}' '{}'", script.display(), picture.display());
        let text = "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";
        let display = Display::from_toml(text, "test").expect("a display");
        let following =
            CameraCommand { command: &command, keep: Some(&kept), limit: None, iris_mm: Some([0.0, 0.0, 6.0]) };
        let (mut dots, mut say) = (Patterns(0), |line: &str| panic!("{line}"));
        let mut follower = Follower::open(&display, Color::Green, &following, &mut dots, &mut say).expect("it starts");
        assert_eq!(dots.0, 1, "the dots alone are shown for the camera");
        let phases = vec![1.0; 64 * 64];
        assert!(matches!(follower.look(&phases, &|| false), Ok(Look::Discarded)));
        assert!(matches!(follower.look(&phases, &|| true), Ok(Look::Taken)));
        assert_eq!((follower.latest.len(), follower.looks), (1, 1));
        follower.close();
        // The dropped picture is not a picture of the folder either.
        let (_, captures) = super::super::captures::load(&kept).expect("captures");
        let answered: Vec<bool> = captures.iter().map(|capture| capture.answer.is_some()).collect();
        assert_eq!(answered, [true, false, true], "dots, thrown away, kept");
    }
}
