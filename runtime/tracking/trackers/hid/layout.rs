//! Where an eye tracker's report keeps what: found by usage, or told by a [device file](super::device_file).
//!
//! Usage page 0x12 says what a field is; which eye a position belongs to is told by the collection around it alone
//! (HUTRR74). Devices differ in sizes, order and padding, and older ones leave usages out, so nothing is assumed of
//! offsets, and what has no name is taken by its place, with a note.

use super::HidError;
use super::descriptor::{Descriptor, Field, ReportKind, Usage};
use super::names::{Dimension, EYE_PAGE, dimension, usage_name};
use crate::trackers::{Quantity, Unit};
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// Bits of a report that make one number: value = raw x scale + zero.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slot {
    /// First bit, behind the ID byte.
    pub bit: usize,
    /// Bits, 1 to 64.
    pub bits: u32,
    /// Two's complement.
    pub signed: bool,
    /// Smallest and largest raw value that means something; `None` where all do.
    pub logical: Option<[i64; 2]>,
    /// In the place's unit, a count.
    pub scale: f64,
    /// The value of raw 0.
    pub zero: f64,
}

/// Whose position it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Role {
    /// Where both eyes look, on the screen.
    Gaze,
    /// The left eye.
    Left,
    /// The right eye.
    Right,
    /// The head.
    Head,
    /// Where the head points.
    HeadDirection,
}

impl Role {
    /// The order of HUTRR74, and of the unnamed.
    const ALL: [Self; 5] = [Self::Gaze, Self::Left, Self::Right, Self::Head, Self::HeadDirection];

    fn of(usage: Usage) -> Option<Self> {
        let index = usage.id.checked_sub(0x24).filter(|_| usage.page == EYE_PAGE)?;
        Self::ALL.get(usize::from(index)).copied()
    }
}

/// A position in a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Place {
    /// Whose.
    pub role: Role,
    /// What it tells.
    pub quantity: Quantity,
    /// What it is measured in.
    pub unit: Unit,
    /// x, y, z; those that there are.
    pub axes: [Option<Slot>; 3],
    /// Diameter of the pupil, metres (device files).
    pub diameter: Option<Slot>,
    /// 0 to 1 (device files).
    pub confidence: Option<Slot>,
    /// Not zero: seen (device files).
    pub valid: Option<Slot>,
}

/// A time in a report: its parts make one number, the first the least.
#[derive(Debug, Clone, PartialEq)]
pub struct TimeSlots {
    /// Parts in order.
    pub parts: Vec<Slot>,
    /// Seconds a count.
    pub scale: f64,
}

impl TimeSlots {
    /// Bits of all parts, at most 64.
    pub fn bits(&self) -> u32 {
        self.parts.iter().map(|p| p.bits).sum::<u32>().min(64)
    }
}

/// A report that the device sends.
#[derive(Debug, Clone, PartialEq)]
pub struct InputReport {
    /// Its ID; 0 where reports are not numbered.
    pub id: u8,
    /// Bytes, with the ID; a shorter report is refused.
    pub bytes: usize,
    /// The tracker's time.
    pub time: Option<TimeSlots>,
    /// Positions.
    pub places: Vec<Place>,
}

/// One number of a feature or input report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Setting {
    /// ID of its report; 0 where reports are not numbered.
    pub id: u8,
    /// Bytes of its report, with the ID where numbered.
    pub bytes: usize,
    /// Where in it.
    pub slot: Slot,
}

/// All that is needed to run an eye tracker.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Layout {
    /// Whether reports start with an ID.
    pub numbered: bool,
    /// Reports with tracking data.
    pub inputs: Vec<InputReport>,
    /// Device Mode Request: what the tracker should send. Until it is written, it may be silent.
    pub mode: Option<Setting>,
    /// Configuration Status, on request.
    pub status: Option<Setting>,
    /// Configuration Status, sent by itself.
    pub status_sent: Option<Setting>,
    /// Sampling Frequency, hertz.
    pub frequency: Option<Setting>,
    /// What was taken how.
    pub notes: Vec<String>,
}

/// Bits of the Device Mode Request: gaze and eye positions.
pub const MODE_GAZE_AND_EYES: i64 = 3;
const EYE_TRACKER: Usage = Usage { page: EYE_PAGE, id: 0x01 };
const HEAD_TRACKER: Usage = Usage { page: EYE_PAGE, id: 0x02 };

/// A position while it is put together.
struct Group {
    report: u8,
    collection: Option<usize>,
    role: Option<Role>,
    axes: [Option<(Slot, Unit)>; 3],
    named: bool,
}

impl Layout {
    /// Finds the fields of usage page 0x12 in the bytes of a descriptor. `name` is the device's.
    ///
    /// # Errors
    /// [`HidError::Descriptor`] and [`HidError::NotAnEyeTracker`].
    pub fn of(descriptor: &[u8], name: &str) -> Result<Self, HidError> {
        let wrong = |reason| HidError::NotAnEyeTracker { name: name.to_owned(), reason };
        Self::find(&Descriptor::parse(descriptor)?).map_err(wrong)
    }

    /// Finds the fields of usage page 0x12.
    ///
    /// # Errors
    /// Why it is not an eye tracker, in words.
    pub fn find(descriptor: &Descriptor) -> Result<Self, Reason> {
        let page = |u: Option<Usage>| u.is_some_and(|u| u.page == EYE_PAGE);
        let fields = || descriptor.fields.iter().flat_map(|f| &f.usages).any(|[first, _]| first.page == EYE_PAGE);
        if !descriptor.collections.iter().any(|c| page(c.usage)) && !fields() {
            let mut names: Vec<_> = applications(descriptor);
            names.dedup();
            let names = if names.is_empty() { "nothing".into() } else { names.join(", ") };
            return Err(reason!("no-eye-tracker", "nothing of usage page 0x12 (Eye and Head Trackers): it is {names}"));
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
            layout.notes.push("no application collection is called Eye Tracker: taken as one by its fields".into());
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
        // 64 bits are all that a time can have: no more than 64 parts.
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
                note_once(&mut self.notes, "the timestamp has no unit of time: taken as microseconds");
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

    /// Gives the unnamed groups the roles that are left, in the order of HUTRR74, and puts all into their reports.
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
                self.notes
                    .push(format!("report 0x{report:02x}: a position without a name is taken by its place: {role:?}"));
            }
            groups[i].role = role;
        }
        for group in groups {
            let Some(role) = group.role else { continue };
            if matches!(role, Role::Head | Role::HeadDirection) {
                continue; // Described, not needed.
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
        return; // An array selects usages, it holds no positions.
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
        // Fewer usages than elements: the next axis, not the last again.
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
                note_once(notes, "positions have no unit: taken as micrometres");
                (1e-6, Unit::Metres)
            }
            _ => (1.0, Unit::Counts),
        };
        let Some(mut slot) = slot(field, i, scale) else { continue };
        if slot.logical.is_none() && field.bits >= 12 {
            note_once(notes, "positions have no logical range: taken as signed, none refused");
            slot.signed = true;
        }
        let here = |g: &Group| g.report == field.report_id && g.collection == field.collection && g.role == role;
        let index = match groups.iter().rposition(here) {
            // What has no usage does not add to what has.
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
            note_once(notes, "positions without usages are taken as x, y, z in their order");
        }
        groups[index].axes[axis] = Some((slot, unit));
    }
}

fn note_once(notes: &mut Vec<String>, note: &str) {
    if !notes.iter().any(|n| n == note) {
        notes.push(note.into());
    }
}

/// Where element `index` of a field lies, each count worth `scale` (times what the physical range says).
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
