//! Counts the traffic of recorded lists, as dispatches between barriers with the bytes read and written.

use super::Kernel;

/// Bytes that a dispatch, a fill or a copy reads or writes at one place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Move {
    /// A buffer, and the offset in it in bytes.
    pub place: (u64, u64),
    /// Number of bytes moved.
    pub bytes: u64,
    /// True if the bytes are written.
    pub write: bool,
}

/// One operation of a recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Entry {
    /// A dispatch, a fill or a copy.
    Work { moves: Vec<Move>, dispatch: bool },
    /// All work before it ends before the work after it begins.
    Barrier,
    /// The work recorded since the last mark belongs to this kernel.
    Mark(usize),
    /// The end of a submission in the middle of a list that continues.
    Cut,
    /// The end of a submission.
    Submit,
    /// The host waits for the last submission, and the device waits for the host.
    Stall,
}

/// The recorded operations, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Recording {
    entries: Vec<Entry>,
}

/// Work that may run concurrently.
pub(crate) type Stage<'a> = Vec<&'a [Move]>;

impl Recording {
    pub(crate) fn push(&mut self, entry: Entry) {
        self.entries.push(entry);
    }

    /// Sets the moves of the last dispatch.
    pub(crate) fn moved(&mut self, by: Vec<Move>) {
        if let Some(Entry::Work { moves, .. }) = self.entries.last_mut() {
            *moves = by;
        }
    }

    /// Returns the bytes of the largest dispatch and of the largest submission.
    pub(crate) fn largest(&self) -> [u64; 2] {
        let (mut largest, mut sum) = ([0; 2], 0);
        for entry in &self.entries {
            match entry {
                Entry::Work { moves, dispatch } => {
                    let bytes = moves.iter().map(|m| m.bytes).sum();
                    sum += bytes;
                    largest[0] = largest[0].max(if *dispatch { bytes } else { 0 });
                    largest[1] = largest[1].max(sum);
                }
                Entry::Cut | Entry::Submit => sum = 0,
                Entry::Barrier | Entry::Mark(_) | Entry::Stall => {}
            }
        }
        largest
    }

    fn count(&self, of: impl Fn(&Entry) -> bool) -> usize {
        self.entries.iter().filter(|e| of(e)).count()
    }

    /// Returns the number of shader dispatches.
    pub fn dispatches(&self) -> usize {
        self.count(|e| matches!(e, Entry::Work { dispatch: true, .. }))
    }

    /// Returns the number of barriers, including barriers with nothing between them.
    pub fn barriers(&self) -> usize {
        self.count(|e| *e == Entry::Barrier)
    }

    /// Returns the number of submissions.
    pub fn submissions(&self) -> usize {
        self.count(|e| matches!(e, Entry::Submit | Entry::Cut))
    }

    /// Returns the number of waits of the host for the last submission. The device is idle until the host returns.
    pub fn stalls(&self) -> usize {
        self.count(|e| *e == Entry::Stall)
    }

    /// Returns the bytes read and the bytes written by all operations.
    pub fn bytes(&self) -> [u64; 2] {
        let moves = self.entries.iter().flat_map(|e| if let Entry::Work { moves, .. } = e { &moves[..] } else { &[] });
        moves.fold([0; 2], |mut sums, m| {
            sums[usize::from(m.write)] += m.bytes;
            sums
        })
    }

    /// Returns the work between barriers, one stage after the other.
    pub(crate) fn stages(&self) -> Vec<Stage<'_>> {
        let mut stages = vec![Stage::new()];
        for entry in &self.entries {
            match entry {
                Entry::Work { moves, .. } => stages.last_mut().expect("there is one").push(moves),
                Entry::Barrier | Entry::Cut | Entry::Submit => stages.push(Stage::new()),
                Entry::Mark(_) | Entry::Stall => {}
            }
        }
        stages.retain(|stage| !stage.is_empty());
        stages
    }

    /// Returns the number of stages, after each of which the device is empty.
    pub fn stage_count(&self) -> usize {
        self.stages().len()
    }

    /// Returns the dispatches and bytes of each kernel, without work that belongs to no kernel (tables, losses).
    pub fn by_kernel(&self) -> Vec<(Kernel, usize, u64)> {
        let mut sums = [(0, 0); Kernel::ALL.len()];
        let (mut dispatches, mut bytes) = (0, 0);
        for entry in &self.entries {
            match entry {
                Entry::Work { moves, dispatch } => {
                    dispatches += usize::from(*dispatch);
                    bytes += moves.iter().map(|m| m.bytes).sum::<u64>();
                }
                Entry::Mark(kernel) => {
                    sums[*kernel].0 += std::mem::take(&mut dispatches);
                    sums[*kernel].1 += std::mem::take(&mut bytes);
                }
                Entry::Submit => (dispatches, bytes) = (0, 0),
                Entry::Barrier | Entry::Cut | Entry::Stall => {}
            }
        }
        let all = Kernel::ALL.into_iter().zip(sums).map(|(kernel, (dispatches, bytes))| (kernel, dispatches, bytes));
        all.filter(|(_, dispatches, bytes)| *dispatches > 0 || *bytes > 0).collect()
    }
}
