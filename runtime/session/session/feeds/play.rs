//! Content from disk: a sequence, or a single hologram.

use crate::encode::{Encoder, PhaseSet};
use crate::engine::vulkan::VulkanEncoder;
use crate::gpu::Gpu;
use crate::hologram::{ColorHologram, Hologram, Sequence};
use crate::optics::{Color, Display};
use crate::present::{Rate, SECOND_NS};
use crate::session::feeds::{ActiveContent, ContentSetup};
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
/// How far away the start of a playback may be, seconds: a year and a day.
const FARTHEST_START_S: f64 = 366.0 * 86400.0;

/// Seconds from now on; less than none of a time that has passed.
fn seconds_until(at: SystemTime) -> f64 {
    let now = SystemTime::now();
    at.duration_since(now).map_or_else(|past| -past.duration().as_secs_f64(), |left| left.as_secs_f64())
}

/// A sequence, and how it is played. A single hologram begins again and again.
#[non_exhaustive]
pub struct Play {
    /// The holograms.
    pub sequence: Sequence,
    /// To what the display receives.
    pub encoder: Encoder,
    /// The Vulkan device that encodes; else the CPU does, with the same bytes.
    pub device: Option<Gpu>,
    /// Holograms a second.
    pub rate: Rate,
    /// So many times as fast.
    pub speed: f64,
    /// Whether it begins again at the end.
    pub looped: bool,
    /// Whether to wait for a sequence that is still being written.
    pub follow: bool,
    /// The hologram to begin with, from 0.
    pub first: u64,
    /// When it begins, ready or not: what several displays agree on. Else as soon as it is ready.
    pub start_at: Option<SystemTime>,
    /// Seconds of the sync picture before content.
    pub sync_s: f64,
    /// Side of the corner mark, pixels; 0 for none.
    pub mark: usize,
    /// After a missed present, sets wait until they are in phase with the first.
    pub keep_phase: bool,
    /// Sets that are encoded ahead.
    pub ahead: usize,
}

/// What makes video frames on a display of the phases of a hologram that are [sent](Hologram::sent_colors); `what` is the hologram, for
/// people.
pub(crate) fn encoder_of(what: &str, about: &Hologram, display: &Display) -> Result<Encoder, SessionError> {
    let named = |c: &ColorHologram| {
        c.color.ok_or_else(|| SessionError::Setting(reason!("colors-not-named", "{what}: its colours are not named")))
    };
    let colors: Vec<Color> =
        about.sent_colors().into_iter().map(|i| named(&about.colors[i])).collect::<Result<_, _>>()?;
    let encoder = Encoder::new(display, &colors, about.frames)?;
    let ([eh, ew], [h, w]) = (encoder.hologram_size(), [about.height, about.width]);
    if [eh, ew] != [h, w] {
        let name = &display.name;
        return Err(reason!(
            "size",
            "{what}: it is {h}x{w} pixels, and the display '{name}' takes {eh}x{ew}: give `size` {h}x{w}, or the display that it \
             was made for"
        ).into());
    }
    Ok(encoder)
}

impl Play {
    /// Opens a file for a display, to be played from its beginning as it was made.
    ///
    /// # Errors
    /// [`SessionError::Hologram`]; those of [`new`](Self::new).
    pub fn open(file: &Path, display: &Display) -> Result<Self, SessionError> {
        Self::new(Sequence::open(file)?, display)
    }

    /// A sequence on a display, to be played from its beginning as it was made.
    ///
    /// # Errors
    /// [`SessionError::Hologram`] for a single hologram that is damaged; [`SessionError::Encode`];
    /// [`SessionError::Setting`] for holograms that do not have the display's size or do not name
    /// their colours.
    pub fn new(mut sequence: Sequence, display: &Display) -> Result<Self, SessionError> {
        if sequence.is_single() {
            // Of a sequence what is damaged is left out; of one hologram there would be nothing.
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

    /// Refuses what cannot be, before anything is opened for it.
    pub(crate) fn check(&self) -> Result<(), SessionError> {
        let wrong = |why| Err(SessionError::Setting(why));
        let (what, count, first) = (self.sequence.path().display(), self.sequence.count(), self.first);
        if first >= count.max(1) && !self.follow {
            return wrong(reason!("first", "{what}: it has {count} holograms, the first is 0: `first` {first}"));
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
                "`start_at` is {days:.0} days {when}: a year at most, in seconds since 1970"
            ));
        }
        Ok(())
    }

    pub(crate) fn start(self, display: &OpenDisplay, notes: Notes, trace: Trace) -> Result<ContentSetup, SessionError> {
        let speed = self.exact_speed()?;
        let Self { sequence, encoder, .. } = self;
        let (shape, sent) = (sequence.shape(), sequence.about().sent_colors());
        let set_frames = encoder.packed().video_frames as u64;
        let set_rate = display.rate.hz() / set_frames as f64;
        // Enough video frames that the display's phase is known.
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
        Ok(ContentSetup { running: ActiveContent::Play(stream), schedule, idle, sub_frames })
    }
}
