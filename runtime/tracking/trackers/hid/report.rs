//! Decodes reports into samples, with checks of their length and their ranges.

use super::layout::{InputReport, Layout, Place, Role, Setting, Slot};
use crate::trackers::clock::{ForeignClock, Unwrap};
use crate::trackers::{Reading, Sample, TimeUnit};

/// Extracts `bits` (1 to 64) bits from `bit` on, the lowest first. It is `None` beyond the end.
pub fn extract(payload: &[u8], bit: usize, bits: u32, signed: bool) -> Option<i64> {
    if !(1..=64).contains(&bits) {
        return None;
    }
    let (first, shift) = (bit / 8, (bit % 8) as u32);
    let bytes = (shift + bits).div_ceil(8) as usize; // at most 9
    let part = payload.get(first..first.checked_add(bytes)?)?;
    let all = part.iter().rev().fold(0u128, |v, b| v << 8 | u128::from(*b)) >> shift;
    let value = (all & (u128::MAX >> (128 - bits))) as u64;
    let spare = 64 - bits;
    Some(if signed { ((value << spare) as i64) >> spare } else { value as i64 })
}

/// Writes the low `bits` of `value` at `bit`. It does nothing beyond the end.
pub fn insert(payload: &mut [u8], bit: usize, bits: u32, value: i64) {
    for i in 0..bits.min(64) as usize {
        if let Some(byte) = payload.get_mut((bit + i) / 8) {
            let mask = 1 << ((bit + i) % 8);
            *byte = if value >> i & 1 == 1 { *byte | mask } else { *byte & !mask };
        }
    }
}

impl Slot {
    /// The raw value, or `None` beyond the end of the payload or outside the logical range.
    pub fn raw(&self, payload: &[u8]) -> Option<i64> {
        let raw = extract(payload, self.bit, self.bits, self.signed)?;
        self.logical.is_none_or(|[low, high]| (low..=high).contains(&raw)).then_some(raw)
    }

    /// The value in the slot's unit, or `None` as in [`raw`](Self::raw).
    pub fn value(&self, payload: &[u8]) -> Option<f64> {
        Some(self.raw(payload)? as f64 * self.scale + self.zero)
    }
}

impl Setting {
    /// The value in a report of its kind, including the ID if reports are numbered.
    pub fn value(&self, report: &[u8]) -> Option<f64> {
        let payload = if self.id == 0 { report } else { report.strip_prefix(&[self.id])? };
        self.slot.value(payload)
    }

    /// A report with this setting at `value` (or the largest valid value) and zeros elsewhere, in the form of hidapi.
    /// The first byte is the ID, or 0 if reports are not numbered.
    pub fn report(&self, value: i64) -> Vec<u8> {
        let mut report = vec![0; self.bytes + usize::from(self.id == 0)];
        report[0] = self.id;
        let value = self.slot.logical.map_or(value, |[low, high]| value.clamp(low, high));
        insert(&mut report[1..], self.slot.bit, self.slot.bits, value);
        report
    }
}

/// Decodes the reports of one device, in their order.
#[derive(Debug, Clone)]
pub struct Decoder {
    pub(in crate::trackers) layout: Layout,
    latency_ns: u64,
    /// The clock of the device.
    pub(in crate::trackers) clock: ForeignClock,
    counter: Unwrap,
}

impl Decoder {
    /// A decoder. `latency_ns` is the time between the eye and the arrival of its report.
    pub fn new(layout: Layout, latency_ns: u64) -> Self {
        Self { layout, latency_ns, clock: ForeignClock::of(TimeUnit::Seconds), counter: Unwrap::default() }
    }

    /// Decodes a report that arrived at `received_ns`. The sample is `None` if the report has no tracking data, or is
    /// too short for its fields.
    pub fn sample(&mut self, report: &[u8], received_ns: u64) -> Option<Sample> {
        let (id, payload) = match (self.layout.numbered, report) {
            (false, all) => (0, all),
            (true, [id, payload @ ..]) => (*id, payload),
            (true, []) => return None,
        };
        let input = self.layout.inputs.iter().find(|r| r.id == id && report.len() >= r.bytes)?;
        let mut sample = Sample::empty(received_ns);
        if let Some(ns) = tracker_time(input, payload, &mut self.counter) {
            let stamp = self.clock.place(i128::from(ns), received_ns);
            (sample.tracker_ns, sample.time_ns) = (Some(stamp.tracker_ns), stamp.time_ns);
        }
        sample.time_ns = sample.time_ns.saturating_sub(self.latency_ns);
        for place in &input.places {
            let reading = Some(reading(place, payload));
            match place.role {
                Role::Left => sample.left = reading,
                Role::Right => sample.right = reading,
                Role::Gaze => sample.combined = reading,
                Role::Head | Role::HeadDirection => {}
            }
        }
        Some(sample)
    }
}

fn tracker_time(input: &InputReport, payload: &[u8], counter: &mut Unwrap) -> Option<u64> {
    let time = input.time.as_ref()?;
    let (mut count, mut shift) = (0u64, 0);
    for part in &time.parts {
        let raw = extract(payload, part.bit, part.bits, false)? as u64;
        if shift >= 64 {
            break;
        }
        count |= raw << shift;
        shift += part.bits;
    }
    let count = counter.count(count, time.bits());
    // Whole nanoseconds are multiplied as integers, which is exact beyond the 53 bits of a float.
    let factor = time.scale * 1e9;
    if factor >= 1.0 && (factor - factor.round()).abs() < 1e-6 {
        Some(count.saturating_mul(factor.round() as u64))
    } else {
        Some((count as f64 * factor) as u64)
    }
}

fn reading(place: &Place, payload: &[u8]) -> Reading {
    let value = |slot: &Option<Slot>| slot.as_ref().map(|s| s.value(payload));
    let [x, y, z] = [0, 1, 2].map(|i| value(&place.axes[i]));
    // An axis that exists but is out of its range makes the position invalid.
    let in_range = [&x, &y, &z].iter().all(|a| a.is_none_or(|v| v.is_some()));
    let [x, y, z] = [x, y, z].map(Option::flatten);
    let seen = value(&place.valid).is_none_or(|v| v.is_some_and(|v| v != 0.0));
    // An eye exactly at the origin is a field that the device did not fill.
    let filled = !(z == Some(0.0) && x == Some(0.0) && y == Some(0.0));
    let mut reading = Reading::new(place.quantity, place.unit, [x.unwrap_or(0.0), y.unwrap_or(0.0)]);
    reading.distance = z;
    reading.diameter = value(&place.diameter).flatten();
    reading.confidence = value(&place.confidence).map_or(1.0, |c| c.map_or(0.0, |c| c.clamp(0.0, 1.0)));
    reading.valid = in_range && seen && filled && x.is_some() && y.is_some();
    reading.checked()
}
