//! Locates the camera of a bench for a solve, and takes pictures through pupils.

use super::sensor::Sensor;
use crate::acquire::{check, two_pi_level};
use crate::captures::{Ask, Session, Shot, shown};
use crate::dots;
use crate::link::Link;
use crate::pattern::{self, Pattern};
use crate::picture::Picture;
use crate::{CalibrateError, CameraCommand, ShowsPatterns};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use eyebox_optics::{Color, Display, Pupil};
use std::path::PathBuf;

/// A picture is black if the mean light over the SLM's image is below this share of full scale.
const BLACK: f64 = 0.002;
/// Target and least value of the brightest thousandth, as shares of full scale, for cameras that do not choose their
/// exposure. `EXPOSURES` is the number of tries.
const BRIGHT: [f32; 2] = [0.7, 0.25];
const EXPOSURES: usize = 4;
/// Dots that are this far off, share of their spacing, RMS, do not locate the camera.
const OFF: f64 = 0.1;

/// A bench whose camera takes part in a solve.
pub struct CameraBench<'a> {
    pub(super) camera: Camera<'a>,
    pub(super) colors: Vec<OfColor>,
    pub(super) steps: usize,
}

/// Shows patterns and takes pictures.
pub(super) struct Camera<'a> {
    pub(super) session: Session<'a>,
    slm: [usize; 2],
    /// Place of an iris that does not move, if the command does not report it.
    iris_mm: Option<[f64; 3]>,
}

/// The properties of the bench in one color.
pub(super) struct OfColor {
    pub(super) color: Color,
    /// The bench's wavelength, nm.
    nm: f64,
    two_pi_level: f64,
    pub(super) sensor: Sensor,
    /// Dark level, share of full scale, or none without a dark picture.
    dark: Option<f64>,
}

/// The light at the camera's pixels through a pupil.
pub(super) struct CapturedLight {
    /// The place of the iris.
    pub(super) pupil: Pupil,
    /// Light per millisecond, in the order of the sensor's pixels, or NaN if a pixel was saturated.
    pub(super) light: Vec<f32>,
}

impl<'a> CameraBench<'a> {
    /// Starts the camera's command, checks that the bench matches the display, and locates the camera in each of these
    /// colors. `steps` is the number of steps of each color. In a folder that a calibration kept, the pictures are
    /// added to its own, and its picture of the dots is not taken again. `shows` shows the patterns if the command does
    /// not. The callback `say` receives lines that are not part of the protocol.
    ///
    /// # Errors
    /// Returns a [`CalibrateError`] if the bench or its pictures cannot be used.
    pub fn open(
        display: &Display,
        colors: &[Color],
        command: &CameraCommand<'a>,
        steps: usize,
        shows: Option<&'a mut dyn ShowsPatterns>,
        say: &'a mut dyn FnMut(&str),
    ) -> Result<Self, CalibrateError> {
        if display.prescription.as_ref().is_some_and(|eye| !eye.is_perfect()) {
            let reason = reason!("prescription", "a camera has no prescription. Solve with `prescription` none");
            return Err(CalibrateError::bench(display, reason));
        }
        if colors.iter().any(|color| !display.modes(*color).is_empty()) {
            let reason = reason!("source-modes", "camera steps support one mode of a source only. Leave out [source]");
            return Err(CalibrateError::bench(display, reason));
        }
        let (link, hello) = Link::start(command.command, command.limit, say)?;
        let named = colors.iter().map(|c| check(display, *c, &hello, shows.is_none()));
        let named = named.collect::<Result<Vec<_>, CalibrateError>>()?;
        let first = named.first().copied().unwrap_or((Color::Green, 0.0));
        let mut session = Session::new(link, hello, command.keep, first, usize::MAX)?;
        session.shows = shows;
        let mut camera = Camera { session, slm: [display.height, display.width], iris_mm: command.iris_mm };
        let mut of_colors = Vec::with_capacity(colors.len());
        for of_color in named {
            of_colors.push(camera.look_about(display, of_color)?);
        }
        Ok(Self { camera, colors: of_colors, steps })
    }

    /// Sends bye to the camera's command.
    pub fn close(mut self) {
        self.camera.session.end();
    }
}

impl Camera<'_> {
    /// Locates the camera by the dots and finds its dark level, from existing pictures or new ones.
    fn look_about(&mut self, display: &Display, (color, nm): (Color, f64)) -> Result<OfColor, CalibrateError> {
        let (optics, two_pi_level) = (display.optics(color)?, two_pi_level(display, color));
        let camera = self.session.hello.camera.resolution;
        self.session.color = (color, nm);
        let had = self.session.adds();
        let pattern = pattern::dots_pattern(self.slm, two_pi_level);
        let is_dots = |shot: &&Shot| {
            let read = |(file, kind): &(PathBuf, String)| shown(file, kind, self.slm, two_pi_level).ok();
            shot.show.as_ref().and_then(read).is_some_and(|shown| shown.is_like(&pattern))
        };
        let picture = match had.iter().rfind(is_dots) {
            Some(shot) => shot.picture(camera)?,
            None => {
                let name = format!("dots-{color}");
                let iris_mm = self.session.hello.iris.is_some().then(|| pattern::dots_iris(&optics));
                let ask = Ask { show: Some((&name, &pattern)), iris_mm, focus_mm: 0.0 };
                self.shot(&ask)?.ok_or_else(|| self.refused("take the picture of the dots"))?.1
            }
        };
        let unclear = |reason: Reason| {
            CalibrateError::Pictures(reason.reworded(|text| {
                format!("in the picture of the dots {text}. Check that the SLM is lit and in focus on the camera")
            }))
        };
        let (map, rms) = dots::find(&picture, self.slm).map_err(unclear)?;
        let spacing = pattern::spacing(self.slm) * map.zoom();
        tracing::debug!("the camera's map of {color} is off by {rms:.2} of its pixels");
        if rms > OFF * spacing {
            return Err(unclear(reason!(
                "dots-off",
                "the dots are {rms:.1} camera pixels off, with a spacing of {spacing:.0}"
            )));
        }
        let dark = match had.iter().rfind(|shot| shot.show.is_none()) {
            Some(shot) => Some(shot.picture(camera)?.median()),
            None if self.session.hello.camera.dark => {
                self.session.take(&Ask::default())?.map(|shot| shot.picture(camera)).transpose()?.map(|p| p.median())
            }
            None => None,
        };
        Ok(OfColor { color, nm, two_pi_level, sensor: Sensor::new(map), dark })
    }

    /// The error for a step that the bench refused, with the bench's last message.
    pub(super) fn refused(&self, what: &str) -> CalibrateError {
        let text = self.session.left_out.last().cloned().unwrap_or_else(|| "no reason given".into());
        CalibrateError::Refused { what: what.into(), text }
    }

    /// Takes a picture that is bright enough, as far as the camera allows. Returns none if the bench could not.
    fn shot(&mut self, ask: &Ask) -> Result<Option<(Shot, Picture)>, CalibrateError> {
        let camera = self.session.hello.camera.clone();
        for tried in 1.. {
            let Some(shot) = self.session.take(ask)? else { return Ok(None) };
            let picture = shot.picture(camera.resolution)?;
            let most = camera.exposure_ms.map_or(1e3, |range| range[1]);
            let brightest = picture.brightest();
            if camera.auto_exposure || brightest >= BRIGHT[1] || shot.exposure_ms >= 0.99 * most || tried >= EXPOSURES {
                return Ok(Some((shot, picture)));
            }
            let longer = f64::from(BRIGHT[0] / brightest.max(1e-3)) * shot.exposure_ms;
            self.session.exposure_ms = Some(longer.min(most));
        }
        Ok(None)
    }

    /// The nearest pupil that the bench can reach.
    fn within_reach(&self, pupil: Pupil) -> (Option<[f64; 3]>, f64) {
        let within = |v: f64, [low, high]: [f64; 2]| v.clamp(low, high);
        let ([x, y, d, z], hello) = (pupil.to_mm(), &self.session.hello);
        let iris = hello.iris.as_ref().map(|i| [within(x, i.x_mm), within(y, i.y_mm), within(d, i.diameter_mm)]);
        (iris, hello.focus_mm.map_or(0.0, |range| within(z, range)))
    }

    /// Number of sub-frames of a set that are shown in turn at a time. It is limited by the bench, or by the places of
    /// this machine's display. It divides both numbers for the latter.
    fn at_once(&self, frames: usize) -> usize {
        match &self.session.shows {
            None => self.session.hello.slm.sub_frames.min(frames),
            Some(shows) => {
                let places = shows.sub_frames();
                (1..=places).rev().find(|n| places.is_multiple_of(*n) && frames.is_multiple_of(*n)).unwrap_or(1)
            }
        }
    }

    /// The light that the camera sees of a set of sub-frames (phases, sub-frame by sub-frame) through a pupil. The
    /// pupil is the nearest one that the bench can reach. It is none if the bench could not.
    pub(super) fn see(
        &mut self,
        of: &OfColor,
        phases: &[f32],
        pupil: Pupil,
    ) -> Result<Option<CapturedLight>, CalibrateError> {
        self.session.color = (of.color, of.nm);
        let (iris_mm, focus_mm) = self.within_reach(pupil);
        let pixels = self.slm[0] * self.slm[1];
        let at_once = self.at_once(phases.len() / pixels);
        let mut seen: Option<CapturedLight> = None;
        for part in phases.chunks(at_once * pixels) {
            let drive: Vec<f64> = part.iter().map(|p| f64::from(*p)).collect();
            let (name, pattern) =
                (format!("hologram-{:03}", self.session.next()), Pattern::new(self.slm, of.two_pi_level, &drive));
            let ask = Ask { show: Some((&name, &pattern)), iris_mm, focus_mm };
            let Some((shot, picture)) = self.shot(&ask)? else { return Ok(None) };
            let share = part.len() as f64 / phases.len() as f64;
            let light = of.light(&shot, &picture)?;
            let Some([x, y, d]) = shot.iris_mm.or(self.iris_mm) else {
                let reason = "its answer has no iris_mm. For a fixed iris, answer iris_mm, or give \
                              `iris` X,Y,DIAMETER in mm";
                return Err(CalibrateError::captures(&shot.file, Reason::new("no-iris", reason)));
            };
            let pupil = Pupil::from_mm([x, y, d, shot.focus_mm]).check()?;
            let sum = seen.get_or_insert_with(|| CapturedLight { pupil, light: vec![0.0; light.len()] });
            sum.light.iter_mut().zip(light).for_each(|(sum, v)| *sum += share as f32 * v);
        }
        Ok(seen)
    }
}

impl OfColor {
    /// Light per millisecond above the dark level, in shares of full scale.
    fn light(&self, shot: &Shot, picture: &Picture) -> Result<Vec<f32>, CalibrateError> {
        let of = |at: &usize| picture.values[*at];
        let dark = self.dark.unwrap_or_else(|| {
            // The dark level comes from pixels that no light reaches. If there are too few, it is the lowest percent of
            // the lit ones.
            let (from, share) = match self.sensor.beside.len() {
                0..100 => (&self.sensor.pixels, 100),
                _ => (&self.sensor.beside, 2),
            };
            let mut values: Vec<f32> = from.iter().map(of).collect();
            values.sort_by(f32::total_cmp);
            values.get(values.len() / share).copied().map_or(0.0, f64::from)
        }) as f32;
        let values: Vec<f32> = self.sensor.pixels.iter().map(of).collect();
        let mean = values.iter().map(|v| f64::from(v - dark)).sum::<f64>() / values.len().max(1) as f64;
        if mean.is_nan() || mean < BLACK {
            let reason = reason!(
                "black",
                "is black, with {:.2} % of full scale on the SLM's image after {:.3} ms. Check laser and iris",
                100.0 * mean,
                shot.exposure_ms
            );
            return Err(CalibrateError::captures(&shot.file, reason));
        }
        let rate = (1.0 / shot.exposure_ms) as f32;
        let light = |at: &usize| if picture.is_full(*at) { f32::NAN } else { (picture.values[*at] - dark) * rate };
        Ok(self.sensor.pixels.iter().map(light).collect())
    }
}
