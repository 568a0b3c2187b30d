//! Packs commands into reports and reads replies (TI DLPU018J, and TI's own program).
//!
//! | byte | content |
//! |---|---|
//! | 0 | flags, with bit 5 for an error in replies, bit 6 for a requested reply and bit 7 for a read |
//! | 1 | sequence number, which the reply returns |
//! | 2, 3 | number of the following bytes, little-endian |
//! | 4, 5 | command, little-endian. Replies do not have it |
//! | 6 | data, which begins at byte 4 of replies |
//!
//! Data that does not fit continues in reports without a header, which are filled with zeros.

use super::link::REPORT;

const READ: u8 = 0x80;
const REPLY: u8 = 0x40;
const ERROR: u8 = 0x20;
/// Bytes of flags, sequence number and length.
const HEADER: usize = 4;
/// Data bytes of the first report of a reply.
pub(super) const REPLY_DATA: usize = REPORT - HEADER;

/// Returns the report that requests the data of a command.
pub(super) fn read_request(code: u16, sequence: u8) -> [u8; REPORT] {
    request(READ | REPLY, code, sequence, &[])[0]
}

/// Returns the reports that write `data`. If `acknowledged`, the controller sends a reply without data.
pub(super) fn write_request(code: u16, sequence: u8, acknowledged: bool, data: &[u8]) -> Vec<[u8; REPORT]> {
    request(if acknowledged { REPLY } else { 0 }, code, sequence, data)
}

fn request(flags: u8, code: u16, sequence: u8, data: &[u8]) -> Vec<[u8; REPORT]> {
    // No command of `Command` has more than 12 bytes, and the field of the length has 16 bits.
    let length = u16::try_from(data.len() + 2).unwrap_or(u16::MAX).to_le_bytes();
    let [low, high] = code.to_le_bytes();
    let mut bytes = vec![flags, sequence, length[0], length[1], low, high];
    bytes.extend_from_slice(data);
    let report = |chunk: &[u8]| {
        let mut report = [0; REPORT];
        report[..chunk.len()].copy_from_slice(chunk);
        report
    };
    bytes.chunks(REPORT).map(report).collect()
}

/// The first report of a reply.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Reply {
    /// Sequence number of the command.
    pub sequence: u8,
    /// True if the controller does not have the command, or refused it.
    pub is_error: bool,
    /// Number of the data bytes of the whole reply.
    pub length: usize,
    /// Data of this report.
    pub data: Vec<u8>,
}

/// Reads the first report of a reply. Returns `None` if it is too short for a header.
pub(super) fn reply(report: &[u8]) -> Option<Reply> {
    let [flags, sequence, low, high, data @ ..] = report else { return None };
    let length = usize::from(u16::from_le_bytes([*low, *high]));
    let data = data[..length.min(data.len())].to_vec();
    Some(Reply { sequence: *sequence, is_error: flags & ERROR != 0, length, data })
}

/// A command as the controller receives it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Received {
    pub reads: bool,
    pub wants_reply: bool,
    pub sequence: u8,
    pub code: u16,
    pub data: Vec<u8>,
}

/// Reads a command of one report. Returns `None` if it is not one.
pub(super) fn received(report: &[u8; REPORT]) -> Option<Received> {
    let length = usize::from(u16::from_le_bytes([report[2], report[3]]));
    let data = report.get(6..HEADER + length)?.to_vec();
    let (reads, wants_reply) = (report[0] & READ != 0, report[0] & REPLY != 0);
    Some(Received { reads, wants_reply, sequence: report[1], code: u16::from_le_bytes([report[4], report[5]]), data })
}

/// Returns the report of a reply to a command.
pub(super) fn reply_report(to: &Received, is_error: bool, data: &[u8]) -> [u8; REPORT] {
    let mut report = [0; REPORT];
    let data = &data[..data.len().min(REPLY_DATA)];
    let flags = REPLY | if to.reads { READ } else { 0 } | if is_error { ERROR } else { 0 };
    let [low, high] = (data.len() as u16).to_le_bytes();
    report[..HEADER].copy_from_slice(&[flags, to.sequence, low, high]);
    report[HEADER..HEADER + data.len()].copy_from_slice(data);
    report
}
