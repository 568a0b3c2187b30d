//! Transforms lengths with a large prime factor, as convolutions with a chirp (`fft_chirp.comp`).

use super::state::{Fft, Planned, Work};
use crate::engine::{EngineError, Storage};
use crate::gpu::{Block, Commands, Pipeline, Range};
use eyebox_kernels::fft_plan::{Axis, CHIRP_BEGIN, CHIRP_END, CHIRP_FILTER, CHIRP_WORKGROUP};

/// Bytes of scratch for a convolution's lines at once, once to read and once to write.
const WORK: u64 = 16 << 20;

impl Fft {
    /// Copies as many lines to the scratch as fit, lengthens and convolves them there, and copies them back.
    pub(super) fn convolution(
        &mut self,
        gpu: &mut Commands,
        planned: &Planned,
        work: &Work<'_>,
    ) -> Result<(), EngineError> {
        let Some((chirp, filter, inner)) = &planned.convolution else { return Ok(()) };
        let (n, m) = (planned.plan.n, inner.plan.n);
        let chunks = Chunks::new(m, work.count, work.frames, work.axis);
        let half = chunks.bytes();
        let range = |at: u64| Range { block: work.spare.block, offset: work.spare.offset + at, size: half };
        let (long, spare) = (range(0), range(half));
        let rows = work.axis == Axis::Rows;
        let mut begun = false;
        for line in (0..work.count).step_by(chunks.lines as usize) {
            for first_frame in (0..work.frames).step_by(chunks.frames as usize) {
                let count = chunks.lines.min(work.count - line);
                let frames = chunks.frames.min(work.frames - first_frame);
                let first = (work.first + line) % work.wrap;
                let offset = work.storage.bytes() as u64 * u64::from(work.frame) * u64::from(first_frame);
                let data = Range { offset: work.data.offset + offset, size: work.data.size - offset, ..work.data };
                let inverse = u32::from(work.inverse);
                let (row, frame) = (chunks.row, chunks.frame);
                // The arguments are in the order of `fft_chirp`, with its mode first.
                let arguments =
                    [0, n, m, inverse, u32::from(rows), first, count, work.wrap, work.row, work.frame, row, frame];
                let step = |fft: &mut Self, gpu: &mut Commands, mode: u32, table: &Block| {
                    let length = if mode == CHIRP_END { n } else { m };
                    let (along, across) = if rows { (length, count) } else { (count, length) };
                    let groups = [along.div_ceil(CHIRP_WORKGROUP[0]), across.div_ceil(CHIRP_WORKGROUP[1]), frames];
                    let (data, storage) =
                        if mode == CHIRP_FILTER { (long, Storage::F32) } else { (data, work.storage) };
                    let pipeline = chirp_pipeline(gpu, storage)?;
                    let buffers = [data, long, table.all()];
                    let mut push = arguments;
                    push[0] = mode;
                    gpu.recorder.dispatch(pipeline, &buffers, bytemuck::cast_slice(&push), groups)?;
                    let values = u64::from(length) * u64::from(count) * u64::from(frames);
                    let of = |storage: Storage, n: u64| storage.bytes() as u64 * n;
                    gpu.recorder.moved(|| match mode {
                        CHIRP_END => vec![long.reads(of(Storage::F32, values)), data.writes(of(storage, values))],
                        CHIRP_FILTER => {
                            [long.reads(of(Storage::F32, values)), long.writes(of(Storage::F32, values))].into()
                        }
                        _ => {
                            let read = of(storage, values / u64::from(m) * u64::from(n));
                            vec![data.reads(read), long.writes(of(Storage::F32, values))]
                        }
                    });
                    fft.mark(gpu, || format!("{:?} of {n}, chirp", work.axis).to_lowercase());
                    Ok::<(), EngineError>(())
                };
                let convolved = |inverse| Work {
                    data: long,
                    spare,
                    frames,
                    axis: work.axis,
                    first: 0,
                    // A column next to the last one may be transformed with it. It is never read.
                    count: if rows { count } else { count.next_multiple_of(2) },
                    wrap: if rows { u32::MAX } else { row },
                    columns: if rows { [0, m] } else { [0, count.next_multiple_of(2)] },
                    row,
                    frame,
                    spare_frame: frame,
                    inverse,
                    storage: Storage::F32,
                };
                if std::mem::replace(&mut begun, true) {
                    gpu.recorder.barrier();
                }
                step(self, gpu, CHIRP_BEGIN, chirp)?;
                gpu.recorder.barrier();
                self.lines(gpu, inner, &convolved(false))?;
                gpu.recorder.barrier();
                step(self, gpu, CHIRP_FILTER, filter)?;
                gpu.recorder.barrier();
                self.lines(gpu, inner, &convolved(true))?;
                gpu.recorder.barrier();
                step(self, gpu, CHIRP_END, chirp)?;
            }
        }
        Ok(())
    }
}

/// The layout of a convolution's lines, and their number at once.
pub(super) struct Chunks {
    lines: u32,
    frames: u32,
    /// Values from row to row and from frame to frame.
    row: u32,
    frame: u32,
}

impl Chunks {
    /// Makes the layout of `lines` lines of `m` values in each of `frames` frames.
    pub(super) fn new(m: u32, lines: u32, frames: u32, axis: Axis) -> Self {
        let fit = (WORK / (8 * u64::from(m))).max(2) as u32;
        let lines = lines.clamp(1, fit & !1);
        // Columns are in pairs, and so are rows of even length.
        let (row, height) = match axis {
            Axis::Rows => (m, lines),
            Axis::Columns | Axis::ColumnPairs => (lines.next_multiple_of(2), m),
        };
        let frame = (row * height).next_multiple_of(2);
        let frames = ((WORK / (8 * u64::from(frame))) as u32).clamp(1, frames.max(1));
        Self { lines, frames, row, frame }
    }

    /// Returns the bytes, a multiple of every device's alignment.
    pub(super) fn bytes(&self) -> u64 {
        (8 * u64::from(self.frame) * u64::from(self.frames)).next_multiple_of(256)
    }
}

/// Returns the pipeline for data in this storage. The scratch is always in float32.
pub(super) fn chirp_pipeline(gpu: &mut Commands, storage: Storage) -> Result<Pipeline, EngineError> {
    gpu.pipeline(eyebox_spirv::FFT_CHIRP.stored(storage == Storage::F16), 3, &[])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_hold_lines_of_any_length() {
        for axis in [Axis::Rows, Axis::Columns, Axis::ColumnPairs] {
            for (m, lines, frames) in [(1, 1, 1), (2048, 1030, 3), (65_536, 3, 5), (65_536, 4159, 1), (196, 0, 2)] {
                let chunks = Chunks::new(m, lines, frames, axis);
                assert!(chunks.lines >= 1 && chunks.frames >= 1 && chunks.lines <= lines.max(1));
                assert!(chunks.bytes() <= WORK.max(16 * u64::from(m)) + 256);
                assert!(u64::from(chunks.frame) >= u64::from(m) * u64::from(chunks.lines));
            }
        }
    }
}
