//! Tables on the disk: a line of JSON that says what decided them, then the angles of the levels that are fitted.

use super::made_by::MadeBy;
use crate::files::{cache_folder, read, write_file};
use eyebox_kernels::table_start::LEVELS;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Each level's angles (sub-frames, side, side), if it is fitted.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Levels(pub [Option<Vec<u16>>; LEVELS]);

impl Levels {
    pub(super) fn are_all(&self) -> bool {
        self.0.iter().all(Option::is_some)
    }
}

/// What stands before the angles.
#[derive(Serialize, Deserialize)]
struct Head {
    /// What decided them, as text: numbers are the same only where every digit is.
    made_by: String,
    /// Levels that follow, in this order.
    levels: Vec<usize>,
    /// CRC-32C of what follows.
    crc32c: u32,
}

impl MadeBy {
    fn file(&self) -> Option<PathBuf> {
        let name = format!("start-{:08x}.table", crc32c::crc32c(self.text().as_bytes()));
        cache_folder().map(|folder| folder.join(name))
    }

    /// The levels that the cache keeps; none of a file that cannot be read, is damaged, or is another's.
    pub(super) fn load(&self) -> Levels {
        self.file().and_then(|file| self.parse(&read::bytes(&file, read::RESULTS).ok()?)).unwrap_or_default()
    }

    pub(super) fn parse(&self, bytes: &[u8]) -> Option<Levels> {
        let (head, angles) = bytes.split_at_checked(bytes.iter().position(|b| *b == b'\n')? + 1)?;
        let Head { made_by, levels, crc32c } = serde_json::from_slice(head).ok()?;
        let of_level = 2 * self.frames * self.side * self.side;
        let ours = made_by == self.text()
            && angles.len() == levels.len() * of_level
            && crc32c::crc32c(angles) == crc32c
            && levels.iter().all(|at| *at < LEVELS);
        let mut found = Levels::default();
        for (at, angles) in levels.iter().zip(angles.chunks_exact(of_level)).filter(|_| ours) {
            found.0[*at] = Some(angles.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]])).collect());
        }
        ours.then_some(found)
    }

    pub(super) fn bytes(&self, levels: &Levels) -> Vec<u8> {
        let there = levels.0.iter().enumerate().filter_map(|(at, level)| Some((at, level.as_ref()?)));
        let angles: Vec<u8> = there.clone().flat_map(|(_, level)| level.iter().flat_map(|a| a.to_le_bytes())).collect();
        let (made_by, crc32c) = (self.text(), crc32c::crc32c(&angles));
        let head = Head { made_by, levels: there.map(|(at, _)| at).collect(), crc32c };
        let mut bytes = serde_json::to_vec(&head).unwrap_or_default();
        bytes.push(b'\n');
        bytes.extend(angles);
        bytes
    }

    /// Keeps what is fitted. If it cannot be kept, it is fitted again the next time.
    pub(super) fn save(&self, levels: &Levels) {
        let Some(file) = self.file().filter(|_| levels.0.iter().any(Option::is_some)) else { return };
        let kept = file
            .parent()
            .map_or(Ok(()), std::fs::create_dir_all)
            .map_err(|e| e.to_string())
            .and_then(|()| write_file(&file, |out| out.write_all(&self.bytes(levels))).map_err(|e| e.to_string()));
        if let Err(reason) = kept {
            tracing::info!("the table of first phases is not kept: {reason}");
        }
    }
}
