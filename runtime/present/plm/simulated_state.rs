//! The state and the rules of a simulated controller.

use super::command::Command;
use super::link::REPORT;
use super::report::{Received, reply_report};
use super::table::{PLANES, plane_of_bit};
use super::values::{Leds, Pattern};
use std::time::Duration;

/// The time from a picture at the receiver to the lock.
const LOCK_TIME: Duration = Duration::from_millis(800);
/// The time in which the mode changes, and after which a read of the mode is answered.
const MODE_TIME: Duration = Duration::from_millis(400);
/// The time after the table without replies.
const SILENCE: Duration = Duration::from_millis(900);
/// The most patterns of a DLP670S.
const MOST_PATTERNS: usize = 400;
/// The least exposure of one bit (us), of a LightCrafter 9000.
const LEAST_US: u16 = 105;

/// The faults of a simulated controller, and the picture at its input.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Faults {
    /// True if the USB cable is unplugged.
    pub unplugged: bool,
    /// True if the host shows a picture on the controller's monitor.
    pub picture: bool,
    /// Video frames per second of the picture.
    pub rate_hz: f64,
    /// The number of the next commands whose reply is lost.
    pub drop_replies: u32,
    /// The number of the next replies that have this many bytes, and the bytes.
    pub short_replies: (u32, usize),
    /// The number of the next replies with another sequence number.
    pub wrong_sequence: u32,
    /// The number of the next commands that are refused.
    pub refuse: u32,
    /// Bits that are set in the hardware status.
    pub hardware_bits: u8,
    /// True if the firmware lacks gamma and the least exposures.
    pub is_old: bool,
    /// True if the mode never changes.
    pub mode_is_stuck: bool,
    /// True if patterns never start.
    pub never_starts: bool,
    /// True if the line at TRIG_IN_2 is high.
    pub trigger_in_2: bool,
}

impl Default for Faults {
    fn default() -> Self {
        Self {
            unplugged: false,
            picture: true,
            rate_hz: 60.0,
            drop_replies: 0,
            short_replies: (0, 0),
            wrong_sequence: 0,
            refuse: 0,
            hardware_bits: 0,
            is_old: false,
            mode_is_stuck: false,
            never_starts: false,
            trigger_in_2: false,
        }
    }
}

/// A plane of a video frame as the controller shows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub struct LitPlane {
    /// The bit of the pixel in this plane.
    pub bit: bool,
    /// The outputs for light sources.
    pub leds: Leds,
    /// The exposure of the plane (us).
    pub exposure_us: u32,
    /// True if TRIG_OUT_2 marks the plane.
    pub trigger_out_2: bool,
}

#[derive(Debug)]
pub(super) struct SimulatedState {
    pub now: Duration,
    pub faults: Faults,
    pub receiver: u8,
    pub lost_replies: u64,
    power: u8,
    port: u8,
    swaps: [u8; 2],
    source: u8,
    invert: u8,
    gamma: u8,
    flips: [u8; 2],
    mode: u8,
    /// The mode that was requested, and the time at which the controller changes to it.
    next_mode: Option<(u8, Duration)>,
    /// The time since which a picture is at the receiver, with the settings of the input as they are.
    picture_since: Option<Duration>,
    patterns: Vec<Option<Pattern>>,
    table: Option<u16>,
    sequencer: u8,
    /// The level of TRIG_IN_2 at which patterns run. Until it is set, they run at any level.
    runs_at: Option<bool>,
    aborted: bool,
    silent_until: Duration,
    last_error: u8,
    /// The reply that waits, with the time at which it can be fetched.
    reply: Option<(Vec<u8>, Duration)>,
}

impl Default for SimulatedState {
    fn default() -> Self {
        Self {
            now: Duration::ZERO,
            faults: Faults::default(),
            receiver: 0,
            lost_replies: 0,
            power: 0,
            port: 1,
            swaps: [2, 3],
            source: 0,
            invert: 1,
            gamma: 1,
            flips: [0; 2],
            mode: 1,
            next_mode: None,
            picture_since: None,
            patterns: vec![None; MOST_PATTERNS],
            table: None,
            sequencer: 0,
            runs_at: None,
            aborted: false,
            silent_until: Duration::ZERO,
            last_error: 0,
            reply: None,
        }
    }
}

/// The codes of errors. The guide has no table of them, so that only zero and others differ.
const REFUSED: u8 = 1;

type Outcome = Result<Vec<u8>, u8>;

impl SimulatedState {
    pub(super) fn pass(&mut self, time: Duration) {
        self.now += time;
        let has_picture = self.faults.picture && self.receiver != 0;
        self.picture_since = has_picture.then(|| self.picture_since.unwrap_or(self.now));
        if let Some((mode, at)) = self.next_mode
            && self.now >= at
        {
            (self.mode, self.next_mode) = (mode, None);
        }
        if !self.locked() && self.sequencer == 2 {
            self.sequencer = 0;
        }
        // The controller aborts the video frame and continues with the next one.
        self.aborted |= self.runs() && self.patterns_us() > 1e6 / self.faults.rate_hz;
    }

    fn locked(&self) -> bool {
        let input_fits = matches!((self.receiver, self.port & 3), (1, 0) | (2, 2)) && self.source == 0x08;
        input_fits && self.picture_since.is_some_and(|since| self.now >= since + LOCK_TIME)
    }

    pub(super) fn runs(&self) -> bool {
        let is_started = self.runs_at.is_none_or(|level| level == self.faults.trigger_in_2);
        self.sequencer == 2 && self.mode == 2 && self.locked() && !self.faults.never_starts && is_started
    }

    fn shown(&self) -> impl Iterator<Item = Pattern> {
        let count = usize::from(self.table.unwrap_or(0));
        self.patterns.iter().take(count).flatten().copied()
    }

    fn patterns_us(&self) -> f64 {
        self.shown().map(|p| f64::from(p.exposure_us) + f64::from(p.dark_us)).sum()
    }

    pub(super) fn lit_planes(&self, word: u32) -> Vec<LitPlane> {
        let lit = |p: Pattern| {
            // Red is lowest in a video word, and the swap and the inversion must be off for this order.
            let bit = word >> plane_of_bit(p.plane.into()) & 1 == 1;
            LitPlane {
                bit: bit != (self.invert != 0 || self.swaps != [0, 1] || self.gamma != 0),
                leds: p.leds,
                exposure_us: p.exposure_us,
                trigger_out_2: p.trigger_out_2,
            }
        };
        if self.runs() { self.shown().map(lit).collect() } else { Vec::new() }
    }

    /// Runs a command, and prepares its reply.
    pub(super) fn take(&mut self, command: &Received) {
        if self.now < self.silent_until {
            return;
        }
        let outcome = if self.faults.refuse > 0 {
            self.faults.refuse -= 1;
            Err(REFUSED)
        } else {
            match Command::of_code(command.code) {
                Some(known) if command.reads => self.read(known),
                Some(known) => self.write(known, &command.data).map(|()| Vec::new()),
                None => Err(REFUSED),
            }
        };
        if let Err(error) = outcome {
            self.last_error = error;
        }
        if command.wants_reply {
            self.answer(command, &outcome);
        }
    }

    fn answer(&mut self, command: &Received, outcome: &Outcome) {
        self.lost_replies += u64::from(self.reply.take().is_some());
        if self.faults.drop_replies > 0 {
            self.faults.drop_replies -= 1;
            return;
        }
        let data = outcome.as_deref().unwrap_or_default();
        let mut bytes = reply_report(command, outcome.is_err(), data).to_vec();
        if self.faults.wrong_sequence > 0 {
            self.faults.wrong_sequence -= 1;
            bytes[1] = bytes[1].wrapping_add(0x80);
        }
        if self.faults.short_replies.0 > 0 {
            self.faults.short_replies.0 -= 1;
            bytes.truncate(self.faults.short_replies.1.min(REPORT));
        }
        // While the mode changes, its value is answered late.
        let late = command.reads && command.code == Command::Mode.code();
        let ready = self.next_mode.filter(|_| late).map_or(self.now, |(_, at)| at);
        self.reply = Some((bytes, ready));
    }

    /// Returns the reply that can be fetched within this time, and the time until then.
    pub(super) fn reply_within(&mut self, timeout: Duration) -> (Duration, Option<Vec<u8>>) {
        match self.reply.take() {
            Some((bytes, ready)) if ready <= self.now + timeout => (ready.saturating_sub(self.now), Some(bytes)),
            reply => {
                self.reply = reply;
                (timeout, None)
            }
        }
    }

    fn read(&mut self, command: Command) -> Outcome {
        let byte = |value: u8| Ok(vec![value]);
        match command {
            Command::LastError => byte(self.last_error),
            Command::LastErrorText => Ok(if self.last_error == 0 { b"\0".into() } else { b"refused\0".into() }),
            Command::Power => byte(self.power),
            Command::Versions => Ok(vec![3, 0, 1, 6, 0, 0, 2, 6, 1, 0, 0, 4, 0, 0, 1, 9]),
            Command::Hardware => Ok([&[0][..], b"SIMULATED DLPC900", &[0; 14]].concat()),
            Command::FlipLong => byte(self.flips[0]),
            Command::FlipShort => byte(self.flips[1]),
            Command::HardwareStatus => byte(1 ^ self.faults.hardware_bits | u8::from(self.aborted) << 6),
            Command::MainStatus => byte(u8::from(self.runs()) << 1 | u8::from(self.locked()) << 3),
            Command::Source => byte(self.source),
            Command::Receiver => byte(self.receiver),
            Command::Port => byte(self.port),
            Command::Mode => byte(self.mode),
            Command::Invert => byte(self.invert),
            Command::LeastExposures if !self.faults.is_old => {
                let mut data = vec![0; 32];
                data[..2].copy_from_slice(&LEAST_US.to_le_bytes());
                Ok(data)
            }
            Command::Gamma if !self.faults.is_old => Ok(vec![self.gamma, 0]),
            _ => Err(REFUSED),
        }
    }

    /// Changes a setting of the input, which loses the lock.
    fn change_input(&mut self, old: u8, new: u8) -> u8 {
        if old != new {
            self.picture_since = None;
        }
        new
    }

    fn write(&mut self, command: Command, data: &[u8]) -> Result<(), u8> {
        let is_pattern_mode = self.mode == 2;
        match (command, data) {
            (Command::Power, &[power @ 0..=1]) => self.power = power,
            // In standby all else waits.
            _ if self.power != 0 => return Err(REFUSED),
            (Command::Source, &[source]) => self.source = self.change_input(self.source, source),
            (Command::Receiver, &[receiver @ 0..=2]) => self.receiver = self.change_input(self.receiver, receiver),
            (Command::Port, &[port]) if port & 0xC0 == 0 => self.port = self.change_input(self.port, port),
            (Command::Swap, &[swap]) if swap >> 1 <= 5 => self.swaps[usize::from(swap & 1)] = swap,
            (Command::Invert, &[invert @ 0..=1]) => self.invert = invert,
            (Command::Gamma, &[on, _]) if !self.faults.is_old => self.gamma = on,
            (Command::TriggerIn2, &[edge @ 0..=1]) => self.runs_at = Some(edge == 0),
            (Command::FlipLong, &[flip @ 0..=1]) => self.flips[0] = flip,
            (Command::FlipShort, &[flip @ 0..=1]) => self.flips[1] = flip,
            (Command::Mode, &[mode @ 0..=3]) => {
                if mode == 2 && !self.locked() {
                    return Err(REFUSED);
                }
                self.sequencer = 0;
                if !self.faults.mode_is_stuck {
                    self.next_mode = (mode != self.mode).then(|| (mode, self.now + MODE_TIME));
                }
            }
            (Command::Definition, data) if is_pattern_mode && self.sequencer == 0 => {
                let data: &[u8; Pattern::BYTES] = data.try_into().map_err(|_| REFUSED)?;
                let pattern = Pattern::of(data);
                let fits = usize::from(pattern.plane) + usize::from(pattern.depth) <= PLANES;
                let is_long = self.faults.is_old || pattern.exposure_us >= u32::from(LEAST_US);
                let place = self.patterns.get_mut(usize::from(pattern.index)).filter(|_| fits && is_long);
                *place.ok_or(REFUSED)? = Some(pattern);
                self.table = None;
            }
            (Command::Table, &[low, high, ..]) if is_pattern_mode && self.sequencer == 0 && data.len() == 6 => {
                let count = u16::from_le_bytes([low, high]);
                let defined = self.patterns.iter().take_while(|pattern| pattern.is_some()).count();
                if count == 0 || usize::from(count) > defined {
                    return Err(REFUSED);
                }
                self.table = Some(count);
                self.silent_until = self.now + SILENCE;
            }
            (Command::Sequence, &[value @ 0..=2]) if is_pattern_mode => {
                if value == 2 && self.table.is_none() {
                    return Err(REFUSED);
                }
                self.sequencer = value;
                self.aborted &= value != 0;
            }
            _ => return Err(REFUSED),
        }
        Ok(())
    }
}
