//! What a device was asked to do, counted.

/// What was done on a device since it was opened, by everyone who shares it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Recordings that were submitted.
    pub submissions: u64,
    /// Waits for the submission made last: the device has nothing to do until the host comes back.
    pub stalls: u64,
    /// Bytes copied from the host to buffers.
    pub uploaded: u64,
    /// Bytes copied from buffers to the host, without the few of a step's losses.
    pub read_back: u64,
    /// Bytes of phases among those.
    pub phases_read_back: u64,
    /// Bytes of steps' losses that were copied to the host.
    pub losses_read_back: u64,
    /// Blocks of memory that were made.
    pub blocks: u64,
    /// Pipelines that were made.
    pub pipelines: u64,
    /// Pools of descriptors that were made.
    pub pools: u64,
}

impl Counts {
    /// What was done after `before`.
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
            pools: self.pools - before.pools,
        }
    }
}
