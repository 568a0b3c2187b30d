//! Reads phases from the file on a thread, and checks them.

use super::shared::{POLL_INTERVAL, Phases, Shared, StreamOptions, of_epoch, tagged};
use crate::hologram::Sequence;
use crate::mailbox::Mailbox;
use crate::session::frame_log::threads::put_unless;
use crate::session::frame_log::trace::Track;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

pub(super) struct Reader {
    pub(super) sequence: Sequence,
    pub(super) options: StreamOptions,
    pub(super) shared: Arc<Shared>,
    pub(super) free: Mailbox<Vec<f32>>,
    pub(super) out: Mailbox<Phases>,
    pub(super) track: Track,
}

impl Reader {
    pub(super) fn run(mut self) -> Track {
        let (mut epoch, mut position) = (0, 0u64);
        let mut index = self.options.first;
        let mut told = BTreeSet::new();
        let mut held: Option<Vec<f32>> = None;
        let mut said_end = false;
        while !self.shared.stopped() {
            let now = self.shared.epoch.load(Ordering::Acquire);
            if now != epoch {
                (epoch, position, index) = (now, 0, self.shared.seek_to.load(Ordering::Acquire));
            }
            let useful = of_epoch(self.shared.useful.load(Ordering::Acquire), epoch).unwrap_or(0);
            if useful > position {
                index = index.saturating_add(useful - position);
                position = useful;
            }
            let mut count = self.sequence.count();
            if index >= count {
                count = self.sequence.refresh();
            }
            if index >= count {
                let waits = self.options.follow && !self.sequence.is_complete();
                if self.options.looped && count > 0 && !waits {
                    index %= count;
                } else {
                    if !waits && self.shared.end.load(Ordering::Acquire) != tagged(epoch, position) {
                        // The skipped frames were not in the file, so the end is the end of the file.
                        let end = position - (index - count).min(position);
                        // The note is sent before the end is published, while a reader of notes still listens.
                        said_end = said_end || self.say_where_it_ends();
                        self.shared.end.store(tagged(epoch, end), Ordering::Release);
                    }
                    std::thread::sleep(POLL_INTERVAL / 4);
                    continue;
                }
            }
            let Some(mut values) = held.take().or_else(|| self.free.take_within(POLL_INTERVAL)) else { continue };
            if self.shared.epoch.load(Ordering::Acquire) != epoch {
                held = Some(values);
                continue;
            }
            #[cfg(test)]
            self.shared.panic_from(0, position);
            let start = Instant::now();
            let read = self.sequence.read_into(index, &mut values);
            self.track.span("decode", index, start);
            let damaged = read.is_err();
            let version = *read.as_ref().unwrap_or(&0);
            if let Some(error) = read.err().filter(|_| told.insert(index)) {
                self.options.notes.send(format!("hologram {index} is left out: {error}"));
            }
            self.shared.read.store(tagged(epoch, position + 1), Ordering::Release);
            let item = Phases { epoch, position, index, damaged, version, values };
            put_unless(&self.out, item, POLL_INTERVAL, || self.shared.stopped());
            (position, index) = (position + 1, index + 1);
        }
        self.track
    }

    fn say_where_it_ends(&mut self) -> bool {
        if !self.sequence.is_complete() {
            let (path, count) = (self.sequence.path().display(), self.sequence.count());
            let of = self.sequence.planned().map(|n| format!(" of {n}")).unwrap_or_default();
            self.options.notes.send(format!("{path}: it is unfinished and ends after {count}{of} holograms"));
        }
        true
    }
}
