//! Counts the work of a device.

/// Work on a device since it was opened, by everyone who shares it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Recordings that were submitted.
    pub submissions: u64,
    /// Waits for the last submission, in which the device is idle until the host returns.
    pub stalls: u64,
    /// Bytes copied from the host to buffers.
    pub uploaded: u64,
    /// Bytes copied from buffers to the host, without the few of a step's losses.
    pub read_back: u64,
    /// Bytes of phases in `read_back`.
    pub phases_read_back: u64,
    /// Bytes of steps' losses that were copied to the host.
    pub losses_read_back: u64,
    /// Memory blocks that were allocated.
    pub blocks: u64,
    /// Pipelines that were made.
    pub pipelines: u64,
    /// Pipelines that were made while others already ran.
    pub pipelines_in_background: u64,
    /// Descriptor pools that were made.
    pub pools: u64,
}

impl Counts {
    /// Returns the work after `before`.
    pub fn since(self, before: Self) -> Self {
        Self {
            submissions: self.submissions - before.submissions,
            stalls: self.stalls - before.stalls,
            uploaded: self.uploaded - before.uploaded,
            read_back: self.read_back - before.read_back,
            phases_read_back: self.phases_read_back - before.phases_read_back,
            losses_read_back: self.losses_read_back - before.losses_read_back,
            blocks: self.blocks - before.blocks,
            pipelines: self.pipelines - before.pipelines,
            pipelines_in_background: self.pipelines_in_background - before.pipelines_in_background,
            pools: self.pools - before.pools,
        }
    }
}
