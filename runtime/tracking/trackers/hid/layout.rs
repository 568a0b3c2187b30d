//! Finds the numbers in the reports of an eye tracker, by usage or by a [device file](super::device_file).
//!
//! Usage page 0x12 gives the meaning of a field. Only the collection around a position gives its eye (HUTRR74). Devices
//! differ in sizes, order and padding, and older ones leave out usages. No offset is therefore assumed. A field without
//! a name is identified by its place, with a note.

use super::HidError;
use super::descriptor::{Descriptor, Field, ReportKind, Usage};
use super::names::{Dimension, EYE_PAGE, dimension, usage_name};
use crate::trackers::{Quantity, Unit};
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// Bits of a report that make one number, whose value is raw x scale + zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slot {
    /// First bit, counted behind the ID byte.
    pub bit: usize,
    /// Number of bits, 1 to 64.
    pub bits: u32,
    /// True for two's complement.
    pub signed: bool,
    /// Smallest and largest valid raw value, or `None` if all are valid.
    pub logical: Option<[i64; 2]>,
    /// Size of a count, in the unit of the place.
    pub scale: f64,
    /// Value at raw 0, in the unit of the place.
    pub zero: f64,
}

/// The object of a position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Role {
    /// The gaze point of both eyes on the screen.
    Gaze,
    /// The pupil of the left eye.
    Left,
    /// The pupil of the right eye.
    Right,
    /// The position of the head.
    Head,
    /// The point at which the head is directed.
    HeadDirection,
}

impl Role {
    /// All roles, in the order of HUTRR74 and of unnamed positions.
    const ALL: [Self; 5] = [Self::Gaze, Self::Left, Self::Right, Self::Head, Self::HeadDirection];

    fn of(usage: Usage) -> Option<Self> {
        let index = usage.id.checked_sub(0x24).filter(|_| usage.page == EYE_PAGE)?;
        Self::ALL.get(usize::from(index)).copied()
    }
}

/// A position in a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// The object of the position.
    pub role: Role,
    /// The quantity of the position.
    pub quantity: Quantity,
    /// The unit of the axes.
    pub unit: Unit,
    /// The axes x, y and z, if they exist.
    pub axes: [Option<Slot>; 3],
    /// Diameter of the pupil, meters (device files).
    pub diameter: Option<Slot>,
    /// Confidence from 0 to 1 (device files).
    pub confidence: Option<Slot>,
    /// A number that is not zero if the eye was seen (device files).
    pub valid: Option<Slot>,
}

/// A time in a report. Its parts make one number, the lowest part first.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeSlots {
    /// The parts in their order.
    pub parts: Vec<Slot>,
    /// Length of a count, seconds.
    pub scale: f64,
}

impl TimeSlots {
    /// Number of bits of all parts, at most 64.
    pub fn bits(&self) -> u32 {
        self.parts.iter().map(|p| p.bits).sum::<u32>().min(64)
    }
}

/// A report that the device sends.
#[derive(Debug, Clone, PartialEq)]
pub struct InputReport {
    /// ID of the report, or 0 if reports are not numbered.
    pub id: u8,
    /// Bytes of the report, including the ID. A shorter report is refused.
    pub bytes: usize,
    /// The tracker's time in the report.
    pub time: Option<TimeSlots>,
    /// The positions in the report.
    pub places: Vec<Place>,
}

/// One number of a feature or input report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// ID of its report, or 0 if reports are not numbered.
    pub id: u8,
    /// Bytes of its report, including the ID if there is one.
    pub bytes: usize,
    /// Place of the number in the report.
    pub slot: Slot,
}

/// The data to run an eye tracker.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Layout {
    /// True if reports start with an ID.
    pub numbered: bool,
    /// Reports with tracking data.
    pub inputs: Vec<InputReport>,
    /// Device Mode Request, which selects the data that the tracker sends. The tracker may be silent until it is
    /// written.
    pub mode: Option<Setting>,
    /// Configuration Status, read on request.
    pub status: Option<Setting>,
    /// Configuration Status, sent by the device.
    pub status_sent: Option<Setting>,
    /// The Sampling Frequency, hertz.
    pub frequency: Option<Setting>,
    /// Notes about unusual fields.
    pub notes: Vec<String>,
}

/// Bits of the Device Mode Request for gaze and eye positions.
pub const MODE_GAZE_AND_EYES: i64 = 3;
const EYE_TRACKER: Usage = Usage { page: EYE_PAGE, id: 0x01 };
const HEAD_TRACKER: Usage = Usage { page: EYE_PAGE, id: 0x02 };

/// A position that is being assembled.
struct Group {
    report: u8,
    collection: Option<usize>,
    role: Option<Role>,
    axes: [Option<(Slot, Unit)>; 3],
    named: bool,
}

impl Layout {
    /// Finds the fields of usage page 0x12 in the bytes of a descriptor. `name` is the name of the device.
    ///
    /// # Errors
    /// [`HidError::Descriptor`] or [`HidError::NotAnEyeTracker`] if it cannot be used.
    pub fn of(descriptor: &[u8], name: &str) -> Result<Self, HidError> {
        let wrong = |reason| HidError::NotAnEyeTracker { name: name.to_owned(), reason };
        Self::find(&Descriptor::parse(descriptor)?).map_err(wrong)
    }

    /// Finds the fields of usage page 0x12.
    ///
    /// # Errors
    /// The reason why it is not an eye tracker, in words.
    pub fn find(descriptor: &Descriptor) -> Result<Self, Reason> {
        let page = |u: Option<Usage>| u.is_some_and(|u| u.page == EYE_PAGE);
        let fields = || descriptor.fields.iter().flat_map(|f| &f.usages).any(|[first, _]| first.page == EYE_PAGE);
        if !descriptor.collections.iter().any(|c| page(c.usage)) && !fields() {
            let mut names: Vec<_> = applications(descriptor);
            names.dedup();
            let names = if names.is_empty() { "nothing".into() } else { names.join(", ") };
            return Err(reason!("no-eye-tracker", "nothing of usage page 0x12 (Eye and Head Trackers), only {names}"));
        }
        let sizes = descriptor.reports();
        let bytes = |kind, id| sizes.iter().find(|(k, i, _)| (*k, *i) == (kind, id)).map_or(0, |(.., b)| *b);
        let mut layout = Self { numbered: descriptor.numbered, ..Self::default() };
        let mut groups: Vec<Group> = Vec::new();
        for field in &descriptor.fields {
            let of_head = descriptor.around(field.collection).any(|c| c.usage == Some(HEAD_TRACKER) && c.kind == 1);
            if of_head {
                continue;
            }
            if field.kind == ReportKind::Input {
                let role = descriptor.around(field.collection).find_map(|c| Role::of(c.usage?));
                layout.times(field, bytes(field.kind, field.report_id));
                axes(field, role, &mut groups, &mut layout.notes);
            }
            layout.settings(field, bytes(field.kind, field.report_id));
        }
        layout.assign(groups, |id| bytes(ReportKind::Input, id));
        if !layout.inputs.iter().any(|i| !i.places.is_empty()) {
            return Err(reason!(
                "no-gaze-report",
                "usage page 0x12 (Eye and Head Trackers), but no report with a gaze point or an eye position"
            ));
        }
        if !descriptor.collections.iter().any(|c| c.usage == Some(EYE_TRACKER)) {
            layout.notes.push("no application collection is called Eye Tracker, so its fields identify it".into());
        }
        layout.inputs.retain(|i| !i.places.is_empty());
        Ok(layout)
    }

    fn report(&mut self, id: u8, bytes: usize) -> &mut InputReport {
        let index = self.inputs.iter().position(|r| r.id == id).unwrap_or_else(|| {
            self.inputs.push(InputReport { id, bytes, time: None, places: Vec::new() });
            self.inputs.len() - 1
        });
        &mut self.inputs[index]
    }

    fn times(&mut self, field: &Field, bytes: usize) {
        let is_time = |u: Option<Usage>| u == Some(Usage { page: EYE_PAGE, id: 0x20 });
        // A time can have 64 bits, and therefore at most 64 parts.
        let parts: Vec<Slot> = (0..field.count.min(64))
            .filter(|i| is_time(field.usage(*i)))
            .filter_map(|i| slot(field, i, 1.0))
            .map(|s| Slot { signed: false, logical: None, ..s })
            .collect();
        if parts.is_empty() {
            return;
        }
        let scale = match dimension(field.unit, field.exponent) {
            Dimension::Time(scale) => scale,
            _ => {
                note_once(&mut self.notes, "the timestamp has no unit of time, so microseconds are assumed");
                1e-6
            }
        };
        let report = self.report(field.report_id, bytes);
        let time = report.time.get_or_insert(TimeSlots { parts: Vec::new(), scale });
        for part in parts {
            if time.parts.iter().map(|p| p.bits).sum::<u32>() + part.bits <= 64 {
                time.parts.push(part);
            }
        }
    }

    fn settings(&mut self, field: &Field, bytes: usize) {
        if !field.usages.iter().any(|[first, _]| first.page == EYE_PAGE && first.id >= 0x300) {
            return;
        }
        for i in 0..field.count.min(64) {
            let Some(usage) = field.usage(i).filter(|u| u.page == EYE_PAGE) else { continue };
            let hertz = match dimension(field.unit, field.exponent) {
                Dimension::Frequency(scale) => scale,
                _ => 1.0,
            };
            let scale = if usage.id == 0x300 { hertz } else { 1.0 };
            let Some(slot) = slot(field, i, scale) else { continue };
            let setting = Setting { id: field.report_id, bytes, slot };
            let place = match (usage.id, field.kind) {
                (0x300, ReportKind::Feature) => &mut self.frequency,
                (0x301, ReportKind::Feature) => &mut self.status,
                (0x301, ReportKind::Input) => &mut self.status_sent,
                (0x400, ReportKind::Feature) => &mut self.mode,
                _ => continue,
            };
            place.get_or_insert(setting);
        }
    }

    /// Assigns the remaining roles to the unnamed groups in the order of HUTRR74, and puts all groups into their
    /// reports.
    fn assign(&mut self, mut groups: Vec<Group>, bytes: impl Fn(u8) -> usize) {
        groups.retain(|g| g.axes[0].is_some() && g.axes[1].is_some());
        for i in 0..groups.len() {
            if groups[i].role.is_some() {
                continue;
            }
            let flat = groups[i].axes[2].is_none();
            let report = groups[i].report;
            let free = |role: &Role| !groups.iter().any(|g| g.report == report && g.role == Some(*role));
            // Only a gaze point has two axes.
            let role = Role::ALL.into_iter().filter(|r| (*r == Role::Gaze) == flat).find(free);
            if let Some(role) = role {
                self.notes.push(format!("report 0x{report:02x}: a position without a name is {role:?} by its place"));
            }
            groups[i].role = role;
        }
        for group in groups {
            let Some(role) = group.role else { continue };
            if matches!(role, Role::Head | Role::HeadDirection) {
                continue; // The description shows it, but no sample needs it.
            }
            let report = self.report(group.report, bytes(group.report));
            if report.places.iter().any(|p| p.role == role) {
                continue;
            }
            let quantity = if role == Role::Gaze { Quantity::Gaze } else { Quantity::Pupil };
            let unit = group.axes[0].map_or(Unit::Counts, |(_, unit)| unit);
            let axes = group.axes.map(|a| a.map(|(slot, _)| slot));
            report.places.push(Place { role, quantity, unit, axes, diameter: None, confidence: None, valid: None });
        }
    }
}

/// Sorts the axes of one field into groups.
fn axes(field: &Field, role: Option<Role>, groups: &mut Vec<Group>, notes: &mut Vec<String>) {
    if !field.variable() && !field.constant() {
        return; // An array selects usages and holds no positions.
    }
    let explicit: u32 = field.usages.iter().map(|[a, b]| u32::from(b.id - a.id) + 1).sum();
    let on_page = field.usages.iter().any(|[first, _]| first.page == EYE_PAGE);
    if !on_page && (role.is_none() || !field.usages.is_empty() || field.bits < 12) {
        return;
    }
    let mut axis_before = None;
    for i in 0..field.count.min(64) {
        let named = match field.usage(i) {
            Some(Usage { page: EYE_PAGE, id: id @ 0x21..=0x23 }) => Some(usize::from(id - 0x21)),
            Some(_) => continue,
            None => None,
        };
        // If there are fewer usages than elements, the next axis follows instead of the last one again.
        let axis = match (named, axis_before) {
            (Some(axis), Some(before)) if i >= explicit && axis <= before => before + 1,
            (Some(axis), _) => axis,
            (None, before) => before.map_or(0, |b: usize| b + 1),
        };
        let most = if role == Some(Role::Gaze) && (named.is_none() || i >= explicit) { 2 } else { 3 };
        if axis >= most {
            break;
        }
        axis_before = Some(axis);
        let (scale, unit) = match dimension(field.unit, field.exponent) {
            Dimension::Length(scale) => (scale, Unit::Metres),
            Dimension::Angle(scale) => (scale, Unit::Radians),
            Dimension::None if field.unit == 0 => {
                note_once(notes, "positions have no unit, so micrometers are assumed");
                (1e-6, Unit::Metres)
            }
            _ => (1.0, Unit::Counts),
        };
        let Some(mut slot) = slot(field, i, scale) else { continue };
        if slot.logical.is_none() && field.bits >= 12 {
            note_once(notes, "positions have no logical range, so all signed values are accepted");
            slot.signed = true;
        }
        let here = |g: &Group| g.report == field.report_id && g.collection == field.collection && g.role == role;
        let index = match groups.iter().rposition(here) {
            // A field without a usage does not add to a group with one.
            Some(last) if named.is_none() && groups[last].named => continue,
            Some(last) if groups[last].axes[axis].is_none() => last,
            Some(_) if named.is_none() => continue,
            _ => {
                let axes = [None; 3];
                let collection = field.collection;
                groups.push(Group { report: field.report_id, collection, role, axes, named: named.is_some() });
                groups.len() - 1
            }
        };
        if named.is_none() {
            note_once(notes, "positions without usages are x, y, z in their order");
        }
        groups[index].axes[axis] = Some((slot, unit));
    }
}

fn note_once(notes: &mut Vec<String>, note: &str) {
    if !notes.iter().any(|n| n == note) {
        notes.push(note.into());
    }
}

/// The place of element `index` of a field. A count is worth `scale` times the factor of the physical range.
fn slot(field: &Field, index: u32, scale: f64) -> Option<Slot> {
    if !(1..=64).contains(&field.bits) {
        return None;
    }
    let [low, high] = field.logical;
    let range = (low < high).then_some([low, high]);
    let (mut counts, mut zero) = (1.0, 0.0);
    if let (Some([low, high]), [first, last]) = (range, field.physical)
        && first != last
    {
        counts = (last - first) as f64 / (high - low) as f64;
        zero = first as f64 - low as f64 * counts;
    }
    Some(Slot {
        bit: field.offset + field.bits as usize * index as usize,
        bits: field.bits,
        signed: field.signed(),
        logical: range,
        scale: scale * counts,
        zero: scale * zero,
    })
}

/// Names of the application collections.
pub fn applications(descriptor: &Descriptor) -> Vec<String> {
    let named = |c: &super::descriptor::Collection| c.usage.map_or("without a name".into(), usage_name);
    descriptor.collections.iter().filter(|c| c.kind == 1).map(named).collect()
}
