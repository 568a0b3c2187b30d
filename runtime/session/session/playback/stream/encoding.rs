//! Encodes phases to video frames on a thread, on a device while there is one.

use super::shared::{Encoded, POLL_INTERVAL, Phases, Shared, of_epoch};
use crate::encode::{Encoder, PhaseSet, VideoFrames};
use crate::engine::EngineError;
use crate::engine::vulkan::VulkanEncoder;
use crate::mailbox::Mailbox;
use crate::optics::drives_into;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::notes::Notes;
use crate::session::frame_log::threads::put_unless;
use crate::session::frame_log::trace::Track;
use crate::session::playback::marks::mark_corner;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Instant;

pub(super) struct Encoding {
    pub(super) shape: [usize; 4],
    /// The indices of the colors whose phases the display receives.
    pub(super) sent: Vec<usize>,
    /// The turns of the light of each color over all drives, if the drives are not the phases of a color.
    pub(super) hidden: Option<Vec<f64>>,
    pub(super) mark: usize,
    pub(super) shared: Arc<Shared>,
    pub(super) encode: Mailbox<Phases>,
    pub(super) free_phases: Mailbox<Vec<f32>>,
    pub(super) free_frames: Mailbox<VideoFrames>,
    pub(super) out: Mailbox<Encoded>,
    pub(super) notes: Notes,
    pub(super) track: Track,
}

impl Encoding {
    pub(super) fn start(mut self, encoder: &Encoder, mut device: Option<VulkanEncoder>, threads: usize) -> Track {
        let notes = self.notes.clone();
        let encode = |colors: &[&[f32]], frames: &mut VideoFrames| {
            match device.as_mut().map(|device| device.encode(colors, frames.bytes_mut())) {
                Some(Ok(())) => return Ok(()),
                Some(Err(EngineError::DeviceLost { device: name, during })) => {
                    device = None;
                    notes.send(format!("{name} was lost while it ran {during}: the CPU encodes from here on"));
                }
                Some(Err(error)) => return Err(error.into()),
                None => {}
            }
            Ok(encoder.encode_into(&PhaseSet::trusted(colors), frames)?)
        };
        let failed = match crate::engine::pool(threads) {
            // The work runs on a thread of the pool, because calls from outside would allocate.
            Ok(pool) => pool.install(|| {
                meet();
                self.run(encode)
            }),
            Err(e) => Err(SessionError::Thread { what: "encodes", reason: format!("could not be started ({e})") }),
        };
        if let Err(error) = failed {
            self.shared.fail(error);
        }
        self.track
    }

    fn run(
        &mut self,
        mut encode: impl FnMut(&[&[f32]], &mut VideoFrames) -> Result<(), SessionError>,
    ) -> Result<(), SessionError> {
        let each = self.shape[1] * self.shape[2] * self.shape[3];
        let mut drives = vec![0.0; if self.hidden.is_some() { each } else { 0 }];
        while !self.shared.stopped() {
            let Some(mut item) = self.encode.take_within(POLL_INTERVAL) else { continue };
            let epoch = self.shared.epoch.load(Ordering::Acquire);
            let useful = of_epoch(self.shared.useful.load(Ordering::Acquire), epoch).unwrap_or(0);
            // Frames that are too late are skipped if a newer one waits.
            let useless = item.epoch != epoch || (item.position < useful && !self.encode.is_empty());
            let mut frames = None;
            if !useless && !item.damaged {
                frames = self.wait_for_frames();
                let Some(frames) = &mut frames else { break };
                #[cfg(test)]
                self.shared.panic_from(1, item.position);
                let start = Instant::now();
                if let (Some(slopes), [sent]) = (&self.hidden, &self.sent[..]) {
                    drives_into(slopes, *sent, |color| &item.values[color * each..][..each], &mut drives);
                    item.values[sent * each..][..each].copy_from_slice(&drives);
                }
                mark_corner(&mut item.values, self.shape, self.mark, item.position);
                // There are usually one to three colors, and never more than fit here.
                let mut colors: [&[f32]; 16] = [&[]; 16];
                let count = self.sent.len().min(colors.len());
                colors.iter_mut().zip(&self.sent).for_each(|(c, sent)| *c = &item.values[sent * each..][..each]);
                encode(&colors[..count], frames)?;
                self.track.span("encode", item.index, start);
            }
            let Phases { epoch, position, index, version, values, .. } = item;
            let _ = self.free_phases.put(values);
            if useless {
                continue;
            }
            let done = Encoded { epoch, position, index, version, frames };
            put_unless(&self.out, done, POLL_INTERVAL, || self.shared.stopped());
        }
        Ok(())
    }

    fn wait_for_frames(&self) -> Option<VideoFrames> {
        loop {
            match self.free_frames.take_within(POLL_INTERVAL) {
                Some(frames) => return Some(frames),
                None if self.shared.stopped() => return None,
                None => {}
            }
        }
    }
}

/// Makes every thread of the pool steal work once. The memory for that is allocated at the first time, which on a
/// loaded machine may be long after the first picture.
fn meet() {
    let all = std::sync::Barrier::new(rayon::current_num_threads());
    let wait = || {
        all.wait();
    };
    rayon::scope(|scope| (0..rayon::current_num_threads()).for_each(|_| scope.spawn(|_| wait())));
}
