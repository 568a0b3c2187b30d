//! Plays a sequence or a single hologram from disk.

use crate::encode::{Encoder, PhaseSet};
use crate::engine::vulkan::VulkanEncoder;
use crate::gpu::Gpu;
use crate::hologram::{ColorHologram, Hologram, Sequence};
use crate::optics::{Color, Display};
use crate::present::{Rate, SECOND_NS};
use crate::session::feeds::ContentSetup;
use crate::session::feeds::eye_content::EyeContent;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::trace::Trace;
use crate::session::playback::marks::sync_phases;
use crate::session::playback::output::OpenDisplay;
use crate::session::playback::scheduler::{Schedule, Start};
use crate::session::playback::stream::{Stream, StreamOptions};
use crate::session::playback::timeline::Speed;
use eyebox_base::reason;
use std::path::Path;
use std::time::SystemTime;

const LONGEST_SYNC_S: f64 = 86400.0;
const MOST_AHEAD: usize = 64;
/// The largest time to the start of a playback (s): a year and a day.
const FARTHEST_START_S: f64 = 366.0 * 86400.0;

/// Returns the seconds until a time, negative if it has passed.
fn seconds_until(at: SystemTime) -> f64 {
    let now = SystemTime::now();
    at.duration_since(now).map_or_else(|past| -past.duration().as_secs_f64(), |left| left.as_secs_f64())
}

/// A sequence and its playback settings. A single hologram repeats.
#[non_exhaustive]
pub struct Play {
    /// The sequence of holograms.
    pub sequence: Sequence,
    /// The encoder for the video frames of the display.
    pub encoder: Encoder,
    /// The Vulkan device that encodes. If it is `None`, the CPU encodes to the same bytes.
    pub device: Option<Gpu>,
    /// The number of holograms per second.
    pub rate: Rate,
    /// The factor on the rate of the sequence.
    pub speed: f64,
    /// True if playback starts again at the end.
    pub looped: bool,
    /// True if playback waits for a sequence that is still being written.
    pub follow: bool,
    /// The first hologram to show, from 0.
    pub first: u64,
    /// The start time, on which several displays can agree. Playback starts then even if it is not ready. If it is
    /// `None`, playback starts as soon as it is ready.
    pub start_at: Option<SystemTime>,
    /// The time of the sync picture before content (s).
    pub sync_s: f64,
    /// The side of the corner mark (pixels), or 0 for none.
    pub mark: usize,
    /// True if sets wait after a missed present until they are in phase with the first set.
    pub keep_phase: bool,
    /// The number of sets that are encoded ahead.
    pub ahead: usize,
}

/// Creates the encoder for the phases of a hologram that are [sent](Hologram::sent_colors) to a display. `what` names
/// the hologram for people.
pub(crate) fn encoder_of(what: &str, about: &Hologram, display: &Display) -> Result<Encoder, SessionError> {
    let named = |c: &ColorHologram| {
        c.color.ok_or_else(|| SessionError::Setting(reason!("colors-not-named", "{what}: its colors are not named")))
    };
    let colors: Vec<Color> =
        about.sent_colors().into_iter().map(|i| named(&about.colors[i])).collect::<Result<_, _>>()?;
    let encoder = Encoder::new(display, &colors, about.frames)?;
    let ([eh, ew], [h, w]) = (encoder.hologram_size(), [about.height, about.width]);
    if [eh, ew] != [h, w] {
        let name = &display.name;
        return Err(reason!(
            "size",
            "{what}: it has {h}x{w} pixels, but the display '{name}' takes {eh}x{ew}. Give `size` {h}x{w}, or use \
             the display that it was made for"
        )
        .into());
    }
    Ok(encoder)
}

impl Play {
    /// Opens a file for a display, to be played from its start as it was made.
    ///
    /// # Errors
    /// Returns [`SessionError::Hologram`], and the errors of [`new`](Self::new).
    pub fn open(file: &Path, display: &Display) -> Result<Self, SessionError> {
        Self::new(Sequence::open(file)?, display)
    }

    /// Plays a sequence on a display from its start, as it was made.
    ///
    /// # Errors
    /// Returns [`SessionError::Hologram`] for a single hologram that is damaged, and [`SessionError::Encode`]. Returns
    /// [`SessionError::Setting`] if the holograms do not have the size of the display or do not name their colors.
    pub fn new(mut sequence: Sequence, display: &Display) -> Result<Self, SessionError> {
        if sequence.is_single() {
            // Damaged holograms of a sequence are skipped, but a single damaged hologram would leave nothing to show.
            let mut phases = vec![0.0; sequence.values()];
            sequence.read_into(0, &mut phases)?;
        }
        let encoder = encoder_of(&sequence.path().display().to_string(), sequence.about(), display)?;
        let [numerator, denominator] = sequence.rate();
        let (rate, looped) = (Rate::new(numerator, denominator)?, sequence.is_single());
        Ok(Self {
            sequence,
            encoder,
            device: None,
            rate,
            speed: 1.0,
            looped,
            follow: false,
            first: 0,
            start_at: None,
            sync_s: 0.0,
            mark: 0,
            keep_phase: false,
            ahead: 4,
        })
    }

    fn exact_speed(&self) -> Result<Speed, SessionError> {
        let wrong = || reason!("speed", "`speed` {}: it must be 0.001 to 1000", self.speed);
        Speed::new(self.speed).ok_or_else(|| SessionError::Setting(wrong()))
    }

    /// Checks the settings before anything is opened.
    pub(crate) fn check(&self) -> Result<(), SessionError> {
        let wrong = |why| Err(SessionError::Setting(why));
        let (what, count, first) = (self.sequence.path().display(), self.sequence.count(), self.first);
        if first >= count.max(1) && !self.follow {
            return wrong(reason!("first", "`first` {first}: {what} has {count} holograms, and the first is 0"));
        }
        self.exact_speed()?;
        if !(0.0..=LONGEST_SYNC_S).contains(&self.sync_s) {
            return wrong(reason!("sync", "`sync` {}: it must be 0 to {LONGEST_SYNC_S} seconds", self.sync_s));
        }
        if !(1..=MOST_AHEAD).contains(&self.ahead) {
            return wrong(reason!("ahead", "`ahead` {}: it must be 1 to {MOST_AHEAD} sets", self.ahead));
        }
        if let Some(left) = self.start_at.map(seconds_until).filter(|left| left.abs() > FARTHEST_START_S) {
            let (days, when) = (left.abs() / 86400.0, if left > 0.0 { "from now" } else { "ago" });
            return wrong(reason!(
                "start-at",
                "`start_at`: {days:.0} days {when}, but at most a year is allowed. Give seconds since 1970."
            ));
        }
        Ok(())
    }

    pub(crate) fn start(
        self,
        display: &OpenDisplay,
        notes: Notes,
        trace: Trace,
    ) -> Result<ContentSetup<EyeContent>, SessionError> {
        let speed = self.exact_speed()?;
        let Self { sequence, encoder, .. } = self;
        let (shape, sent) = (sequence.shape(), sequence.about().sent_colors());
        let set_frames = encoder.packed().video_frames as u64;
        let set_rate = display.rate.hz() / set_frames as f64;
        // This is enough video frames to determine the phase of the display.
        let idle_sets = ((self.sync_s * set_rate).ceil() as u64).max(4_u64.div_ceil(set_frames));
        let start = match self.start_at {
            None => Start::WhenReady { idle_sets },
            Some(at) => {
                let left_ns = (seconds_until(at) * SECOND_NS as f64) as i64;
                Start::At { display_time_ns: display.clock.now_ns() + left_ns }
            }
        };
        let schedule = Schedule {
            rolls: false,
            display_rate: display.rate,
            content_rate: self.rate,
            speed,
            set_frames,
            start,
            waits: encoder.display().trigger_in.is_some() && display.real_clock.is_some(),
            keep_phase: self.keep_phase,
        };
        let phases = if self.sync_s > 0.0 { sync_phases(shape) } else { vec![0.0; shape.iter().product()] };
        let each = phases.len() / shape[0];
        let colors: Vec<&[f32]> = sent.iter().map(|color| &phases[color * each..][..each]).collect();
        let idle = encoder.encode(&PhaseSet::trusted(&colors))?;
        let options = StreamOptions {
            ahead: self.ahead,
            looped: self.looped || sequence.is_single(),
            follow: self.follow,
            first: self.first,
            threads: 0,
            mark: self.mark,
            notes,
            trace,
        };
        let device = self.device.map(|gpu| VulkanEncoder::new(&gpu, encoder.plan())).transpose()?;
        let stream = Stream::start(sequence, encoder, device, options)?;
        let sub_frames = (sent.len() * shape[1]) as u64;
        Ok(ContentSetup { running: EyeContent::Play(stream), schedule, idle, sub_frames })
    }
}
