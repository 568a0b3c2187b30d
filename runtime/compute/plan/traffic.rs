//! What recorded lists move: dispatches between barriers, each with the bytes that it reads and writes.

use super::{Access, Kernel, PupilPass, Resource, Shape, Step};

/// Bytes that a dispatch, a fill or a copy reads or writes at one place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Move {
    /// A buffer, and where in it, bytes.
    pub place: (u64, u64),
    /// How many.
    pub bytes: u64,
    /// Whether they are written.
    pub write: bool,
}

/// One thing that was recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Entry {
    /// A dispatch, a fill or a copy.
    Work { moves: Vec<Move>, dispatch: bool },
    /// All before is over before what follows begins.
    Barrier,
    /// What was recorded since the mark before belongs to this kernel.
    Mark(usize),
    /// The end of a submission, in the middle of a list that goes on.
    Cut,
    /// The end of a submission.
    Submit,
    /// The host waits for what was submitted last, and the device for the host.
    Stall,
}

/// What was recorded, in order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Recording {
    entries: Vec<Entry>,
}

/// Work that may run side by side.
pub(crate) type Stage<'a> = Vec<&'a [Move]>;

impl Recording {
    pub(crate) fn push(&mut self, entry: Entry) {
        self.entries.push(entry);
    }

    /// What the last dispatch moves.
    pub(crate) fn moved(&mut self, by: Vec<Move>) {
        if let Some(Entry::Work { moves, .. }) = self.entries.last_mut() {
            *moves = by;
        }
    }

    /// Bytes of the dispatch that moves most, and of the submission that does.
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

    /// Dispatches of shaders.
    pub fn dispatches(&self) -> usize {
        self.count(|e| matches!(e, Entry::Work { dispatch: true, .. }))
    }

    /// Barriers, those with nothing between them included.
    pub fn barriers(&self) -> usize {
        self.count(|e| *e == Entry::Barrier)
    }

    /// Submissions.
    pub fn submissions(&self) -> usize {
        self.count(|e| matches!(e, Entry::Submit | Entry::Cut))
    }

    /// Waits of the host for what was submitted last: until it comes back the device has nothing to do.
    pub fn stalls(&self) -> usize {
        self.count(|e| *e == Entry::Stall)
    }

    /// Bytes read and bytes written by everything.
    pub fn bytes(&self) -> [u64; 2] {
        let moves = self.entries.iter().flat_map(|e| if let Entry::Work { moves, .. } = e { &moves[..] } else { &[] });
        moves.fold([0; 2], |mut sums, m| {
            sums[usize::from(m.write)] += m.bytes;
            sums
        })
    }

    /// What runs between barriers, one stage after the other.
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

    /// How many times the device is empty between one piece of work and the next.
    pub fn stage_count(&self) -> usize {
        self.stages().len()
    }

    /// Dispatches and bytes of each kernel; what belongs to none (tables, losses) is left out.
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

/// Bytes that a kernel reads and writes of one thing that it is bound to, over `frames` sub-frames: of the spectrum, and of
/// what stands beside it bin by bin, those that the pupil passes; of all else, all. `None` for what only tables hold.
pub(crate) fn moved(
    kernel: Kernel,
    (access, resource): (Access, Resource),
    step: &Step,
    shape: &Shape,
    pass: Option<&PupilPass>,
    frames: usize,
) -> Option<[u64; 2]> {
    let passing = || pass.map_or(0, PupilPass::passing_itself);
    let by_bin = matches!(kernel, Kernel::PassPupil | Kernel::PupilAdjoint | Kernel::Overlap | Kernel::Relay);
    let extent = match (resource.is_shared(), pass) {
        (true, _) => shape.extent(shape.alias(resource)),
        (false, Some(pass)) => pass.extent(resource, shape),
        (false, None) => return None,
    };
    if extent.values == 0 {
        return None;
    }
    let size = match (extent.complex, resource) {
        (true, resource) => resource.stored(shape.storage).bytes() as u64,
        (false, resource) => shape.real_bytes(resource),
    };
    if (kernel, resource) == (Kernel::DivideByOverlap, Resource::Change) {
        let bytes = size * overlapped(step, shape) * frames as u64;
        return Some([bytes, bytes]);
    }
    let cut = by_bin && !(kernel == Kernel::PassPupil && resource == Resource::Window);
    let values = match (cut, resource) {
        (true, _) => passing(),
        // Of a pixel's numbers: its amplitude and the rest's, or one.
        (_, Resource::Pixels) => {
            let lights = matches!(kernel, Kernel::ModulateWave | Kernel::ModulateSubpixels);
            shape.pixels() as u64 * if lights { 3 } else { 1 }
        }
        _ => extent.values as u64,
    };
    let is_framed = resource.per_frame().is_some() || resource.axes_of_subpixels() > 0;
    let frames = if is_framed { frames as u64 } else { 1 };
    let bytes = size * values * frames;
    Some(match access {
        Access::Read => [bytes, 0],
        Access::Write => [0, bytes],
        Access::Update => [bytes, bytes],
    })
}

/// Bins that two pupils or more pass.
fn overlapped(step: &Step, shape: &Shape) -> u64 {
    let mut counts = vec![0u16; shape.points()];
    for pass in step.pupil_passes.iter().flat_map(PupilPass::each_mode) {
        pass.pass.pieces(&pass.spans, |at, _, length| {
            counts[at..at + length].iter_mut().for_each(|count| *count = count.saturating_add(1));
        });
    }
    counts.iter().filter(|count| **count > 1).count() as u64
}
