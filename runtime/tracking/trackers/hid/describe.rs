//! Explains a report descriptor, for `eyebox tracker describe`.

use super::descriptor::{Descriptor, Field, ReportKind};
use super::layout::{Layout, applications};
use super::names::{collection_kind, unit_name, usage_name};
use serde::Serialize;

/// Largest number of usages that are listed for a field. The rest is counted.
const MOST_USAGES: u32 = 64;
/// Number of usages of these in the text form.
const SHOWN_USAGES: usize = 8;

/// A descriptor with explanations.
#[derive(Debug, Clone, Serialize)]
pub struct Description {
    /// True if it is an eye tracker that eyebox can use.
    pub eye_tracker: bool,
    /// The reason if it is not.
    pub reason: Option<String>,
    /// Number of bytes of the descriptor.
    pub descriptor_bytes: usize,
    /// Application collections, by name.
    pub applications: Vec<String>,
    /// True if reports start with an ID.
    pub numbered: bool,
    /// Reports, with their sizes and fields.
    pub reports: Vec<ReportText>,
    /// Notes about unusual items and their interpretation.
    pub notes: Vec<String>,
}

/// A report with explanations.
#[derive(Debug, Clone, Serialize)]
pub struct ReportText {
    /// Direction of the report.
    pub kind: ReportKind,
    /// ID of the report, or 0 if reports are not numbered.
    pub id: u8,
    /// Size of the report, bytes, including the ID byte if it has one.
    pub bytes: usize,
    /// Fields of the report.
    pub fields: Vec<FieldText>,
}

/// A field with explanations.
#[derive(Debug, Clone, Serialize)]
pub struct FieldText {
    /// Names of the collections around it, the outermost first.
    pub path: Vec<String>,
    /// Name of the usage of each element. The last one also holds for the remaining elements. It is empty for padding.
    pub usages: Vec<String>,
    /// The same usages as `page << 16 | id`, in hexadecimal.
    pub codes: Vec<String>,
    /// First bit, including the ID byte.
    pub bit: usize,
    /// First byte, including the ID byte.
    pub byte: usize,
    /// Number of bits of one element.
    pub bits: u32,
    /// Number of elements in the field.
    pub count: u32,
    /// True if negative values are possible.
    pub signed: bool,
    /// Smallest and largest raw value.
    pub logical: [i64; 2],
    /// Physical values of these, or both 0 if they are the same.
    pub physical: [i64; 2],
    /// The unit with its power of ten, such as `um`, `us` or `Hz`, and empty without a unit.
    pub unit: String,
    /// The power of ten.
    pub exponent: i32,
    /// The code of the unit.
    pub unit_code: u32,
    /// True if the field is flagged constant, because the host cannot set it or it is padding.
    pub constant: bool,
    /// True if each element has a usage of its own.
    pub variable: bool,
}

impl Description {
    /// Explains the bytes of a descriptor.
    ///
    /// # Errors
    /// [`HidError::Descriptor`](super::HidError::Descriptor) if they are not a descriptor.
    pub fn of(bytes: &[u8]) -> Result<Self, super::HidError> {
        let descriptor = Descriptor::parse(bytes)?;
        let layout = Layout::find(&descriptor);
        let mut notes = descriptor.notes.clone();
        notes.extend(layout.iter().flat_map(|layout| layout.notes.clone()));
        let shift = usize::from(descriptor.numbered) * 8;
        let reports = descriptor
            .reports()
            .into_iter()
            .map(|(kind, id, bytes)| {
                let of = descriptor.fields.iter().filter(|f| (f.kind, f.report_id) == (kind, id));
                ReportText { kind, id, bytes, fields: of.map(|f| text(&descriptor, f, shift)).collect() }
            })
            .collect();
        Ok(Self {
            eye_tracker: layout.is_ok(),
            reason: layout.err().map(|reason| reason.to_string()),
            descriptor_bytes: bytes.len(),
            applications: applications(&descriptor),
            numbered: descriptor.numbered,
            reports,
            notes,
        })
    }
}

fn text(descriptor: &Descriptor, field: &Field, shift: usize) -> FieldText {
    let mut path: Vec<String> = descriptor
        .around(field.collection)
        .map(|c| c.usage.map_or_else(|| format!("({})", collection_kind(c.kind)), usage_name))
        .collect();
    path.reverse();
    let explicit = field.usages.iter().map(|[a, b]| u32::from(b.id - a.id) + 1).fold(0, u32::saturating_add);
    // The usages of an array are the choices of its values. The usages of a variable belong to its elements.
    let most = if field.variable() { explicit.min(field.count) } else { explicit };
    let usages: Vec<_> = (0..most.min(MOST_USAGES)).filter_map(|i| field.usage(i)).collect();
    let mut names: Vec<String> = usages.iter().map(|u| usage_name(*u)).collect();
    if most > MOST_USAGES {
        names.push(format!("and {} more", most - MOST_USAGES));
    }
    FieldText {
        path,
        usages: names,
        codes: usages.iter().map(|u| format!("{:04x}{:04x}", u.page, u.id)).collect(),
        bit: field.offset + shift,
        byte: (field.offset + shift) / 8,
        bits: field.bits,
        count: field.count,
        signed: field.signed(),
        logical: field.logical,
        physical: field.physical,
        unit: unit_name(field.unit, field.exponent),
        exponent: field.exponent,
        unit_code: field.unit,
        constant: field.constant(),
        variable: field.variable(),
    }
}

impl std::fmt::Display for Description {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match &self.reason {
            None => writeln!(f, "an eye tracker")?,
            Some(reason) => writeln!(f, "not an eye tracker: {reason}")?,
        }
        writeln!(
            f,
            "descriptor of {} bytes, {}, reports {}",
            self.descriptor_bytes,
            if self.applications.is_empty() { "no application".into() } else { self.applications.join(", ") },
            if self.numbered { "start with their ID" } else { "are not numbered" }
        )?;
        for report in &self.reports {
            let kind = format!("{:?}", report.kind).to_lowercase();
            writeln!(f, "\n{kind} report 0x{:02x}, {} bytes", report.id, report.bytes)?;
            for field in &report.fields {
                let bit = if field.bit % 8 == 0 { String::new() } else { format!(" bit {}", field.bit % 8) };
                let place = format!("byte {}{bit}", field.byte);
                let count = if field.count == 1 { String::new() } else { format!("{} x ", field.count) };
                let sign = if field.signed { "signed" } else { "unsigned" };
                let flags = if field.constant { ", constant" } else { "" };
                write!(f, "  {place:>14}  {count}{} bits {sign}", field.bits)?;
                if field.usages.is_empty() {
                    write!(f, ", no usage{flags}")?;
                } else {
                    write!(f, ", {}..{}", field.logical[0], field.logical[1])?;
                    if field.physical[0] != field.physical[1] {
                        write!(f, " for {}..{}", field.physical[0], field.physical[1])?;
                    }
                    if !field.unit.is_empty() {
                        write!(f, " {}", field.unit)?;
                    }
                    let (shown, rest) = field.usages.split_at(field.usages.len().min(SHOWN_USAGES));
                    write!(f, "{flags}: {}", shown.join(", "))?;
                    if let Some(last) = rest.last() {
                        write!(f, " ... {last}")?;
                    }
                }
                writeln!(f, "  [{}]", field.path.join(" > "))?;
            }
        }
        for note in &self.notes {
            writeln!(f, "note: {note}")?;
        }
        Ok(())
    }
}
