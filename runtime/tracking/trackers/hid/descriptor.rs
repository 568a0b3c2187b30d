//! Parses HID report descriptors (USB HID 1.11, section 6.2.2) into fields.
//!
//! A descriptor is a small program of the device. Global items set what the next fields share, local items name the
//! next field, and main items make it. Real descriptors contain stray bytes and unusual items. The parser reads as much
//! as it can, and the rest becomes a note. All work is bounded, because nothing is expanded here. A field of 65,535
//! elements is one [`Field`].

use super::HidError;
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// Longest descriptor that is read, bytes. Linux stops at 4096.
pub const LONGEST_DESCRIPTOR: usize = 16384;
/// Longest report, bytes, which is the limit of Linux.
pub const LONGEST_REPORT: usize = 16384;
const DEEPEST: usize = 64;
const MOST_NOTES: usize = 32;

/// The direction of a report.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ReportKind {
    /// A report that the device sends on its own.
    Input,
    /// A report that the host sends to the device.
    Output,
    /// A report in both directions, on request.
    Feature,
}

/// A usage, with page and ID.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Usage {
    /// Number of the usage page.
    pub page: u16,
    /// Number within the page.
    pub id: u16,
}

/// A collection of fields.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Collection {
    /// Kind of the collection, such as 0 physical, 1 application and 2 logical.
    pub kind: u8,
    /// Meaning of the collection, or `None` if the descriptor does not name it.
    pub usage: Option<Usage>,
    /// Index of the surrounding collection in [`Descriptor::collections`].
    pub parent: Option<usize>,
}

/// One main item, with `count` elements of `bits` bits next to each other in a report.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// Direction of the report.
    pub kind: ReportKind,
    /// Report ID, or 0 if reports are not numbered.
    pub report_id: u8,
    /// First bit of the first element, counted behind the ID byte.
    pub offset: usize,
    /// Number of bits of one element.
    pub bits: u32,
    /// Number of elements in the field.
    pub count: u32,
    /// Data and flags of the main item. Bit 0 is constant, bit 1 is variable, bit 2 is relative.
    pub flags: u32,
    /// Ranges of usages, first to last. The last usage also holds for the remaining elements.
    pub usages: Vec<[Usage; 2]>,
    /// Smallest and largest valid value.
    pub logical: [i64; 2],
    /// Physical values of these, in `unit` times ten to the `exponent`. Both are 0 if they are the same as `logical`.
    pub physical: [i64; 2],
    /// The code of the unit.
    pub unit: u32,
    /// The power of ten.
    pub exponent: i32,
    /// Index of the surrounding collection.
    pub collection: Option<usize>,
}

impl Field {
    /// True if the field is flagged constant. Eye trackers flag their positions as constant because the host cannot set
    /// them.
    pub fn constant(&self) -> bool {
        self.flags & 1 != 0
    }

    /// True if each element has a usage of its own, instead of a value that selects one.
    pub fn variable(&self) -> bool {
        self.flags & 2 != 0
    }

    /// Number of bits of all elements.
    pub fn total_bits(&self) -> usize {
        self.bits as usize * self.count as usize
    }

    /// The usage of element `index`.
    pub fn usage(&self, index: u32) -> Option<Usage> {
        let mut left = index;
        for [first, last] in &self.usages {
            let length = u32::from(last.id - first.id) + 1;
            if left < length {
                // It is within the range, and therefore within u16.
                return Some(Usage { page: first.page, id: first.id + left as u16 });
            }
            left -= length;
        }
        self.usages.last().map(|[_, last]| *last)
    }

    /// True if the elements are signed, because the smallest value is negative.
    pub fn signed(&self) -> bool {
        self.logical[0] < 0
    }
}

/// The parsed content of a descriptor.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Descriptor {
    /// Collections, in the order in which they open.
    pub collections: Vec<Collection>,
    /// Fields, in their order.
    pub fields: Vec<Field>,
    /// True if reports start with an ID.
    pub numbered: bool,
    /// Notes about unusual items and their interpretation.
    pub notes: Vec<String>,
}

#[derive(Clone, Copy, Default)]
struct Item {
    size: u8,
    value: u32,
}

impl Item {
    fn signed(self) -> i64 {
        match self.size {
            1 => i64::from(self.value as u8 as i8),
            2 => i64::from(self.value as u16 as i16),
            _ => i64::from(self.value as i32),
        }
    }
}

#[derive(Clone, Copy, Default)]
struct Globals {
    page: u16,
    logical: [Item; 2],
    physical: [Item; 2],
    exponent: i32,
    unit: u32,
    bits: u32,
    id: u8,
    count: u32,
}

/// The ends of a range as written, with the page if the item has four bytes.
#[derive(Default)]
struct Locals {
    /// First and last value, each with true if it carries its page.
    usages: Vec<[(u32, bool); 2]>,
    low: Option<(u32, bool)>,
    high: Option<(u32, bool)>,
    /// True in a set of alternatives after the first was used.
    alternatives: Option<bool>,
}

struct Parser {
    out: Descriptor,
    globals: Globals,
    stack: Vec<Globals>,
    locals: Locals,
    open: Vec<usize>,
    /// Number of bits up to now, by kind and report ID.
    ends: Box<[[usize; 256]; 3]>,
}

impl Descriptor {
    /// Reads the bytes of a descriptor.
    ///
    /// # Errors
    /// [`HidError::Descriptor`] if it is empty, longer than [`LONGEST_DESCRIPTOR`], nested deeper than 64, or describes
    /// a report beyond [`LONGEST_REPORT`].
    pub fn parse(bytes: &[u8]) -> Result<Self, HidError> {
        let wrong = |at: usize, reason: Reason| HidError::Descriptor { at, reason };
        if bytes.is_empty() {
            return Err(wrong(0, reason!("empty", "it is empty")));
        }
        if bytes.len() > LONGEST_DESCRIPTOR {
            return Err(wrong(0, reason!("length", "it has {} bytes, more than {LONGEST_DESCRIPTOR}", bytes.len())));
        }
        let mut parser = Parser {
            out: Self::default(),
            globals: Globals::default(),
            stack: Vec::new(),
            locals: Locals::default(),
            open: Vec::new(),
            ends: Box::new([[0; 256]; 3]),
        };
        let mut at = 0;
        while let Some(&prefix) = bytes.get(at) {
            if prefix == 0xfe {
                // The length of a long item follows. None has ever been defined.
                let length = bytes.get(at + 1).copied().map_or(usize::MAX, usize::from);
                parser.note(format!("byte {at}: a long item was skipped"));
                at = at.saturating_add(length.saturating_add(3));
                continue;
            }
            let size = [0, 1, 2, 4][usize::from(prefix & 3)];
            let Some(data) = bytes.get(at + 1..at + 1 + size) else {
                parser.note(format!("byte {at}: the last item is cut short and ignored"));
                break;
            };
            let value = data.iter().rev().fold(0u32, |v, b| v << 8 | u32::from(*b));
            let item = Item { size: size as u8, value };
            match prefix >> 2 & 3 {
                0 => parser.main(prefix >> 4, item, at).map_err(|reason| wrong(at, reason))?,
                1 => parser.global(prefix >> 4, item, at).map_err(|reason| wrong(at, reason))?,
                2 => parser.local(prefix >> 4, item, at),
                _ => parser.note(format!("byte {at}: a reserved item (0x{prefix:02x}) was ignored")),
            }
            at += 1 + size;
        }
        if !parser.open.is_empty() {
            parser.note(format!("{} collections without an end were closed at the end", parser.open.len()));
        }
        Ok(parser.out)
    }

    /// Kind, ID and number of bytes of every report, in order. The bytes include the ID byte if reports are numbered.
    pub fn reports(&self) -> Vec<(ReportKind, u8, usize)> {
        let mut bits = std::collections::BTreeMap::new();
        for field in &self.fields {
            let end = bits.entry((field.kind, field.report_id)).or_insert(0);
            *end = field.total_bits().saturating_add(field.offset).max(*end);
        }
        let id = usize::from(self.numbered);
        bits.into_iter().map(|((kind, report), bits)| (kind, report, bits.div_ceil(8) + id)).collect()
    }

    /// The collection itself and the collections around it, the innermost first.
    pub fn around(&self, collection: Option<usize>) -> impl Iterator<Item = &Collection> {
        // A parent always has a smaller index, so this ends.
        std::iter::successors(collection.and_then(|i| self.collections.get(i)), |c| {
            c.parent.and_then(|i| self.collections.get(i))
        })
    }
}

impl Parser {
    fn note(&mut self, text: String) {
        if self.out.notes.len() < MOST_NOTES {
            self.out.notes.push(text);
        } else if self.out.notes.len() == MOST_NOTES {
            self.out.notes.push("and more notes of this kind".into());
        }
    }

    fn main(&mut self, tag: u8, item: Item, at: usize) -> Result<(), Reason> {
        let locals = std::mem::take(&mut self.locals);
        match tag {
            0x8 => self.field(ReportKind::Input, item, locals, at)?,
            0x9 => self.field(ReportKind::Output, item, locals, at)?,
            0xb => self.field(ReportKind::Feature, item, locals, at)?,
            0xa => {
                if self.open.len() == DEEPEST {
                    return Err(reason!("collections", "collections are nested deeper than {DEEPEST}"));
                }
                let usage = self.usages(&locals).first().map(|[first, _]| *first);
                let parent = self.open.last().copied();
                self.open.push(self.out.collections.len());
                self.out.collections.push(Collection { kind: item.value as u8, usage, parent });
            }
            0xc => {
                if self.open.pop().is_none() {
                    self.note(format!("byte {at}: an end of collection without a beginning was ignored"));
                }
            }
            _ => self.note(format!("byte {at}: an unknown main item (tag {tag}) was ignored")),
        }
        Ok(())
    }

    fn field(&mut self, kind: ReportKind, item: Item, locals: Locals, at: usize) -> Result<(), Reason> {
        let g = self.globals;
        let bits = (g.bits as usize).checked_mul(g.count as usize).filter(|b| *b <= LONGEST_REPORT * 8);
        let end = &mut self.ends[kind as usize][usize::from(g.id)];
        let offset = *end;
        let new_end = bits.map(|b| offset + b).filter(|e| *e <= LONGEST_REPORT * 8).ok_or_else(|| {
            reason!(
                "report-size",
                "report {} grows beyond {LONGEST_REPORT} bytes ({} elements of {} bits)",
                g.id,
                g.count,
                g.bits
            )
        })?;
        *end = new_end;
        if new_end == offset {
            self.note(format!("byte {at}: a field of {} elements of {} bits was ignored", g.count, g.bits));
            return Ok(());
        }
        let usages = self.usages(&locals);
        let range = |[low, high]: [Item; 2]| {
            let low = low.signed();
            // Many devices write 25 ff for 255. The value is unsigned, unless the range starts below zero.
            let high = if low < 0 { high.signed() } else { i64::from(high.value) };
            [low, high]
        };
        self.out.fields.push(Field {
            kind,
            report_id: g.id,
            offset,
            bits: g.bits,
            count: g.count,
            flags: item.value,
            usages,
            logical: range(g.logical),
            physical: range(g.physical),
            unit: g.unit,
            exponent: g.exponent,
            collection: self.open.last().copied(),
        });
        Ok(())
    }

    /// Local usages, with the current page of the main item if they carry none.
    fn usages(&mut self, locals: &Locals) -> Vec<[Usage; 2]> {
        let own = self.globals.page;
        let whole = |(value, extended): (u32, bool)| Usage {
            page: if extended { (value >> 16) as u16 } else { own },
            id: value as u16,
        };
        let mut out = Vec::with_capacity(locals.usages.len());
        for range in &locals.usages {
            let [first, last] = range.map(whole);
            if first.page == last.page && first.id <= last.id {
                out.push([first, last]);
            } else {
                self.note(format!(
                    "usages {:04x}:{:04x} to {:04x}:{:04x} are not a range and were ignored",
                    first.page, first.id, last.page, last.id
                ));
            }
        }
        out
    }

    fn global(&mut self, tag: u8, item: Item, at: usize) -> Result<(), Reason> {
        let g = &mut self.globals;
        match tag {
            0x0 => g.page = item.value as u16,
            0x1 => g.logical[0] = item,
            0x2 => g.logical[1] = item,
            0x3 => g.physical[0] = item,
            0x4 => g.physical[1] = item,
            // The exponent has four bits in two's complement, but some devices write a whole signed byte.
            0x5 => {
                g.exponent =
                    if item.value <= 0xf { (item.value as i32 ^ 8) - 8 } else { item.signed().clamp(-32, 32) as i32 }
            }
            0x6 => g.unit = item.value,
            0x7 => g.bits = item.value,
            0x8 => {
                g.id = item.value as u8;
                self.out.numbered = true;
                if item.value == 0 || item.value > 255 {
                    self.note(format!("byte {at}: report ID {}, but it must be 1 to 255", item.value));
                }
            }
            0x9 => g.count = item.value,
            0xa => {
                if self.stack.len() == DEEPEST {
                    return Err(reason!("pushes", "more than {DEEPEST} pushes"));
                }
                self.stack.push(self.globals);
            }
            0xb => match self.stack.pop() {
                Some(globals) => self.globals = globals,
                None => self.note(format!("byte {at}: a pop without a push was ignored")),
            },
            _ => self.note(format!("byte {at}: an unknown global item (tag {tag}) was ignored")),
        }
        Ok(())
    }

    fn local(&mut self, tag: u8, item: Item, at: usize) {
        let value = (item.value, item.size == 4);
        let l = &mut self.locals;
        match tag {
            0x0 => {
                let taken = l.alternatives.as_mut().is_some_and(|taken| std::mem::replace(taken, true));
                if !taken {
                    l.usages.push([value, value]);
                }
            }
            0x1 => l.low = Some(value),
            0x2 => l.high = Some(value),
            // Strings and designators are not needed.
            0x3..=0x9 => {}
            0xa => l.alternatives = (item.value == 1).then_some(false),
            _ => self.note(format!("byte {at}: an unknown local item (tag {tag}) was ignored")),
        }
        let l = &mut self.locals;
        if let (Some(low), Some(high)) = (l.low, l.high) {
            l.usages.push([low, high]);
            (l.low, l.high) = (None, None);
        }
    }
}
