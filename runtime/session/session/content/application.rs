//! Receives content from an application in another process through shared memory (docs/live-input.md). This module
//! sends requests to the application and makes views of its answers, on the host or on the device of the engines.

use crate::engine::Backend;
use crate::gpu::Gpu;
use crate::optics::{Color, Display, PupilDistribution};
use crate::scene::{Layer, Places, ViewGrid, views_of_depths, views_of_layers};
use crate::session::content::decoded_views::live_colors;
use crate::session::content::device_views::DeviceViews;
use crate::session::content::near_eye::{Exposures, NearViews, light_field};
use crate::session::content::scenes::{Due, FrameFreshness, Newest, SceneFrame, Scenes};
use crate::session::frame_log::error::SessionError;
use crate::session::refinement::field::LiveColor;
use eyebox_live_input::{Content, Display as Ring, Frame, Kind, Latest, Offer, Pupil as AskedPupil, Request, Wanted};
use rayon::prelude::*;
use std::sync::Arc;

const SLOTS: u32 = 3;
const LAYERS: u32 = 16;
/// The largest plausible time between a frame and its light (ns). An application outside of it uses another clock.
const PLAUSIBLE_NS: u64 = 1_000_000_000;
/// An application is late if it sent nothing for this many of its usual intervals. The next constant is the limit (ns)
/// while the interval is unknown.
const LATE: f64 = 1.5;
const UNKNOWN_NS: i64 = 1_000_000_000;

/// The frames of an application as scenes.
pub struct LiveInput {
    name: String,
    display: Display,
    colors: Vec<Color>,
    /// The channel of a frame for each color.
    channels: Vec<usize>,
    ring: Ring,
    frame: Frame,
    /// The decoder of views on the device of the engines.
    device: Option<DeviceViews>,
    kind: Kind,
    interval: Interval,
    exposures: Exposures,
    /// The light of the last request, and the number of frames until now.
    asked_ns: Option<i64>,
    frames: u64,
}

impl LiveInput {
    /// Receives frames as `live:NAME` for these colors of a display. Frames hold up to `views` views along each axis,
    /// pictures with depths, or layers. `kind` is the kind that eyebox requests.
    ///
    /// # Errors
    /// Returns [`SessionError::LiveInput`] for a name that is in use or not valid, or an unsafe folder.
    pub fn open(name: &str, display: &Display, colors: &[Color], views: u32, kind: Kind) -> Result<Self, SessionError> {
        let (height, width) = display.picture_size();
        let offered = [Color::Red, Color::Green, Color::Blue].map(|color| colors.contains(&color));
        let eyebox_mm = [display.eyebox_min() * 1e3; 2];
        let offer = Offer {
            size: [height as u32, width as u32],
            colors: offered,
            kinds: Kind::ALL.to_vec(),
            views: [views; 2],
            layers: LAYERS,
            slots: SLOTS,
            pixel_angle: display.picture_pixel() / display.focal_length,
            eyebox_mm,
        };
        let ring = Ring::open(name, offer)?;
        // The channels of a frame are the offered colors in the order red, green, blue.
        let place = |color: &Color| offered[..color.channel()].iter().filter(|is| **is).count();
        Ok(Self {
            name: name.into(),
            display: display.clone(),
            colors: colors.to_vec(),
            channels: colors.iter().map(place).collect(),
            frame: ring.frame(),
            ring,
            device: None,
            kind,
            interval: Interval::default(),
            exposures: Exposures::default(),
            asked_ns: None,
            frames: 0,
        })
    }

    /// Gives its frames the exposures of the other eye's, so that both eyes see the same brightness.
    pub fn expose_like(&mut self, other: &Self) {
        self.exposures = other.exposures.clone();
    }

    /// Decodes views on this device, for engines there, and makes the views of pictures with depths. The host then sees
    /// only sums of the light of a frame, and one view of one color at most 256 pixels wide, which gives the motion of the
    /// content. If the device fails, the host does all of it again. The host makes the views of pictures with depths if
    /// the device does not [draw views](Gpu::draws_views).
    ///
    /// A session with a journal, which has to replay bit for bit, has to decode on the host.
    ///
    /// # Errors
    /// Returns the reason in words if views have to pass through the host. Either the display model or the far field
    /// changes them first, or the device is too small.
    pub fn decode_on(&mut self, gpu: &Gpu) -> Result<(), String> {
        self.device = Some(DeviceViews::new(gpu, self.ring.offer(), &self.display, &self.colors, &self.channels)?);
        Ok(())
    }

    /// [Decodes](Self::decode_on) on the device of these engines, if they have one. Returns the reason in words if the
    /// views of a device pass through the host.
    ///
    /// # Errors
    /// Returns [`SessionError::Engine`] if the device is lost.
    pub fn decode_with(&mut self, engines: &Backend) -> Result<Option<String>, SessionError> {
        Ok(engines.gpu()?.and_then(|gpu| self.decode_on(&gpu).err()))
    }

    /// Selects the requested views. If there is a tracker, these are a few close ones around the pupil, otherwise as
    /// many as allowed over the whole eyebox.
    fn wanted(&self, due: &Due) -> Wanted {
        let NearViews { views, pitch, center } =
            NearViews::of(due, self.display.eyebox_min(), self.ring.offer().views[0]);
        Wanted { kind: self.kind, views: [views; 2], pitch_mm: pitch * 1e3, center_mm: center.map(|v| v * 1e3) }
    }

    fn ask(&mut self, due: &Due) {
        // Two requests for the same light differ by the rounding of the period of a set, which is a nanosecond.
        if self.asked_ns.is_some_and(|asked| due.light_ns.abs_diff(asked) < due.period_ns.unsigned_abs() / 2) {
            return;
        }
        self.asked_ns = Some(due.light_ns);
        let PupilDistribution { centre, diameter: [low, high], focus: [near, far], .. } = due.pupil;
        let focal_length = self.display.focal_length;
        let request = Request {
            number: 0,
            lit_ns: i64::try_from(due.light_monotonic_ns).unwrap_or(i64::MAX),
            period_ns: due.period_ns.unsigned_abs(),
            pupil: AskedPupil {
                center_mm: centre.map(|v| v * 1e3),
                diameter_mm: 0.5 * (low + high) * 1e3,
                focus_dioptres: 0.5 * (near + far) / (focal_length * focal_length),
                velocity_mm_s: due.velocity.map(|v| v * 1e3),
                tracked: due.tracked,
            },
            wanted: self.wanted(due),
        };
        self.ring.ask(&request);
    }

    /// Makes views for each color of the newest frame. A refusal is returned in words.
    fn scene(&mut self, due: &Due) -> Result<Result<SceneFrame, String>, SessionError> {
        let info = *self.frame.info();
        let (height, width) = self.display.picture_size();
        let pixels = height * width;
        let metres = |mm: f64| mm * 1e-3;
        let camera = info.center_mm.map(metres);
        // These are the views that are wanted now, because frames of other kinds need no request for views.
        let near = NearViews::of(due, self.display.eyebox_min(), self.ring.offer().views[0]);
        let places: Vec<[f64; 2]> = near.places().into_iter().map(|[x, y]| [x - camera[0], y - camera[1]]).collect();
        let focal_length = self.display.focal_length;
        let per_metre = 1.0 / (focal_length * self.display.picture_pixel());
        let from = Places { places: &places, per_metre, size: [height, width] };
        let NearViews { views, pitch, center } = near;
        if self.frame.is_taken() {
            let (grid, center) = match info.content {
                Content::Views { grid: [rows, columns], pitch_mm } => {
                    let [rows, columns] = [rows, columns].map(|n| n as usize);
                    (ViewGrid { rows, columns, cell: metres(pitch_mm) }, camera)
                }
                _ => {
                    let drawn = self.device.as_mut().map_or(Ok(()), |device| device.draw(&from, views as usize));
                    if let Err(reason) = drawn {
                        return Ok(Err(refusal(&reason)));
                    }
                    (ViewGrid { rows: views as usize, columns: views as usize, cell: pitch }, center)
                }
            };
            return self.device_scene(grid, center, info.content_time_ns, due);
        }
        let (grid, pitch, center, planes) = match info.content {
            Content::Views { grid, pitch_mm } => {
                let views =
                    |channel: &usize| self.frame.channel(*channel).par_chunks_exact(pixels).map(<[f32]>::to_vec);
                let planes = self.channels.iter().map(|channel| views(channel).collect()).collect();
                (grid, metres(pitch_mm), camera, planes)
            }
            content => {
                // The conversion from dioptres to depth follows OPTICS 8.
                let depth = |dioptres: f32| f64::from(dioptres) * focal_length * focal_length;
                let made = match content {
                    Content::Layers(dioptres) => {
                        let layer = |channel: usize, at: usize| {
                            self.frame.channel(channel).get(at * pixels..(at + 1) * pixels).unwrap_or(&[])
                        };
                        let opacity = self.ring.offer().channels();
                        let one = |(at, dioptres): (usize, &f32)| {
                            let planes = self.channels.iter().map(|channel| layer(*channel, at)).collect();
                            Layer { depth: depth(*dioptres), planes, opacity: layer(opacity, at) }
                        };
                        let layers: Vec<_> = dioptres.as_slice().iter().enumerate().map(one).collect();
                        views_of_layers(&layers, &from)
                    }
                    _ => {
                        let depths: Vec<f32> = self.frame.dioptres().iter().map(|d| depth(*d) as f32).collect();
                        let planes: Vec<&[f32]> = self.channels.iter().map(|c| self.frame.channel(*c)).collect();
                        views_of_depths(&planes, &depths, &from)
                    }
                };
                match made {
                    Ok(planes) => ([views; 2], pitch, center, planes),
                    Err(reason) => return Ok(Err(refusal(&reason))),
                }
            }
        };
        let place = (grid.map(|n| n as usize), pitch);
        let field = light_field(self.describe(), &self.display, &self.colors, place, planes);
        let colors = self.exposures.colors(&field, &self.display, center)?;
        Ok(Ok(self.next_scene(colors, info.content_time_ns, due)))
    }

    /// Makes the scene of the newest frame, whose views are on the device.
    fn device_scene(
        &mut self,
        views: ViewGrid,
        center: [f64; 2],
        content_time_ns: i64,
        due: &Due,
    ) -> Result<Result<SceneFrame, String>, SessionError> {
        let newest = match self.device.as_mut().map_or(Ok(Vec::new()), DeviceViews::newest) {
            Ok(newest) => newest,
            Err(reason) => return Ok(Err(format!("the application's frame is left out: {reason}"))),
        };
        let of = (&self.display, &self.colors[..]);
        let colors = live_colors(newest, &self.exposures, of, (views, center))?;
        Ok(Ok(self.next_scene(colors, content_time_ns, due)))
    }

    fn next_scene(&mut self, colors: Vec<LiveColor>, content_time_ns: i64, due: &Due) -> SceneFrame {
        self.frames += 1;
        let (arrived_ns, shows_ns) = (Some(due.now_ns), Some(shown_at(content_time_ns, due)));
        // An application sends the frames of both eyes with the same time, on any clock.
        let moment = Some(content_time_ns).filter(|time| *time != 0);
        SceneFrame { arrived_ns, shows_ns, moment, ..SceneFrame::new(self.frames, Arc::new(colors)) }
    }
}

/// Returns the message about a frame whose views cannot be made.
fn refusal(reason: &dyn std::fmt::Display) -> String {
    format!("the application's frame is refused: {reason}")
}

/// Returns the time that a frame shows (ns on the clock of the player). The time of the application counts if it is
/// plausible, otherwise the time of arrival.
fn shown_at(content_time_ns: i64, due: &Due) -> i64 {
    let behind_ns = i64::try_from(due.light_monotonic_ns).unwrap_or(i64::MAX).saturating_sub(content_time_ns);
    match behind_ns.unsigned_abs() <= PLAUSIBLE_NS {
        true => due.light_ns - behind_ns,
        false => due.now_ns,
    }
}

impl Scenes for LiveInput {
    fn describe(&self) -> String {
        format!("live:{}", self.name)
    }

    fn next(&mut self, due: &Due) -> Result<Newest, SessionError> {
        self.ask(due);
        let found = match &mut self.device {
            Some(device) => self.ring.latest_to(&mut self.frame, device),
            None => self.ring.latest(&mut self.frame),
        };
        Ok(match found {
            Latest::New => {
                self.interval.came(due.now_ns);
                match self.scene(due)? {
                    Ok(scene) => Newest::New(scene),
                    Err(reason) => Newest::Refused(reason),
                }
            }
            Latest::Gone => {
                self.interval = Interval::default();
                Newest::Late(FrameFreshness::ApplicationGone)
            }
            Latest::Refused(fault) => Newest::Refused(fault.to_string()),
            _ if self.interval.is_late(due.now_ns) => Newest::Late(FrameFreshness::ApplicationLate),
            _ => Newest::Same,
        })
    }

    fn begins_with_one(&self) -> bool {
        false
    }
}

/// The interval between the frames of an application, measured (ns).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Interval {
    last_ns: Option<i64>,
    usual_ns: Option<f64>,
}

impl Interval {
    fn came(&mut self, now_ns: i64) {
        if let Some(last) = self.last_ns.replace(now_ns) {
            let interval = now_ns.saturating_sub(last) as f64;
            // A pause does not count as a usual interval.
            let usual = self.usual_ns.map_or(interval, |usual| usual + 0.25 * (interval.min(4.0 * usual) - usual));
            self.usual_ns = Some(usual);
        }
    }

    fn is_late(&self, now_ns: i64) -> bool {
        let Some(last) = self.last_ns else { return false };
        now_ns.saturating_sub(last) as f64 > self.usual_ns.map_or(UNKNOWN_NS as f64, |usual| LATE * usual)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_live_input::Application;

    /// The application receives the predicted position of the pupil, its velocity and the time.
    #[test]
    fn an_application_is_told_where_the_pupil_goes() {
        let display = Display { height: 32, width: 48, ..Display::preset("small").unwrap() };
        let name = format!("told-{}", std::process::id());
        let mut input = LiveInput::open(&name, &display, &[Color::Green], 3, Kind::Views).unwrap();
        let connecting = std::thread::spawn(move || Application::connect(&name));
        let pupil = PupilDistribution {
            centre: [1e-3, -2e-3],
            spread: 1e-4,
            diameter: [3e-3, 5e-3],
            focus: [0.0; 2],
            elsewhere: 0.0,
        };
        let due = Due {
            now_ns: 0,
            light_ns: 20_000_000,
            light_monotonic_ns: 5_000_000_000,
            period_ns: 16_000_000,
            pupil,
            velocity: [0.03, -0.002],
            tracked: true,
            patient: false,
        };
        // The application is admitted when the session looks for it.
        while !connecting.is_finished() {
            assert!(matches!(input.next(&due).unwrap(), Newest::Same | Newest::Late(_)));
        }
        let asked = connecting.join().unwrap().unwrap().request().expect("a request");
        let near = |a: [f64; 2], b: [f64; 2]| (0..2).all(|i| (a[i] - b[i]).abs() < 1e-9);
        assert!(near(asked.pupil.center_mm, [1.0, -2.0]) && near(asked.pupil.velocity_mm_s, [30.0, -2.0]), "{asked:?}");
        assert!((asked.pupil.diameter_mm - 4.0).abs() < 1e-9 && asked.pupil.tracked);
        assert_eq!((asked.lit_ns, asked.period_ns), (5_000_000_000, 16_000_000));
    }

    #[test]
    fn late_is_what_gives_nothing_for_longer_than_it_does() {
        const MS: i64 = 1_000_000;
        let mut interval = Interval::default();
        assert!(!interval.is_late(5000 * MS), "nothing was ever given");
        for i in 0..10 {
            interval.came(i * 33 * MS);
        }
        assert!(!interval.is_late((9 * 33 + 40) * MS) && interval.is_late((9 * 33 + 60) * MS));
        // A stall of a second does not make the next one usual.
        interval.came(1300 * MS);
        interval.came(1333 * MS);
        assert!(interval.is_late(1500 * MS));
    }
}
