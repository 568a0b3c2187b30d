//! Composes the frames of a display.

use super::device::Own;
use super::fault::{Fault, of};
use super::memory::{Memory, Use};
use super::pipelines::BINDINGS;
use super::tables::{Range, Run, Seen, Tables};
use crate::composition::Frustum;
use ash::vk;
use eyebox_kernels::{WIDTH, compose_layer, finish_layers};
use std::sync::{Arc, PoisonError};
use std::time::Duration;

/// The longest time that a composition may take.
const PATIENCE: Duration = Duration::from_secs(5);
/// The rows of workgroups that every device runs.
const ROWS: usize = 65_535;
/// The bytes of the flag that content was too near, with room for any device's unit.
const FOUND: u64 = 64;

/// The place for the frames of a display.
pub enum Target {
    /// Memory of the display, with the bytes from one slot to the next.
    Slots { memory: Memory, stride: u64 },
    /// Memory that the host reads, with one frame.
    Host(Memory),
}

impl Target {
    /// Makes memory for one frame of this many bytes, which the host reads.
    ///
    /// # Errors
    /// Returns [`Fault`] if memory runs out.
    pub fn host(own: &Arc<Own>, bytes: u64) -> Result<Self, Fault> {
        Memory::new(own, bytes, Use::Readback).map(Self::Host)
    }

    fn memory(&self) -> &Memory {
        match self {
            Self::Slots { memory, .. } | Self::Host(memory) => memory,
        }
    }
}

/// The layout of a display's frames.
#[derive(Debug, Clone, Copy)]
pub struct Shape {
    pub frustum: Frustum,
    /// The colors that the display has.
    pub colors: [bool; 3],
    /// Dioptres of the nearest content that the display shows.
    pub nearest: f32,
}

impl Shape {
    /// Returns the bytes of a frame, and the offset of its dioptres.
    pub fn bytes(&self) -> [u64; 2] {
        let pixels = self.frustum.size.iter().map(|n| *n as u64).product::<u64>();
        let channels = self.colors.iter().filter(|color| **color).count() as u64;
        // Live input has depth at the next multiple of 64 bytes.
        let depth = (pixels * channels * 4).next_multiple_of(64);
        [depth + pixels * 4, depth]
    }
}

/// The work of one display on the device.
pub struct Composer {
    own: Arc<Own>,
    shape: Shape,
    target: Target,
    canvas: Memory,
    found: Memory,
    tables: Tables,
    upload: Memory,
    pool: vk::CommandPool,
    commands: vk::CommandBuffer,
    fence: vk::Fence,
    sets: vk::DescriptorPool,
    /// The number of sets of the pool.
    room: usize,
}

impl Composer {
    /// Makes the buffers of a display.
    ///
    /// # Errors
    /// Returns [`Fault`] if memory runs out or the device is lost.
    pub fn new(own: &Arc<Own>, shape: Shape, target: Target) -> Result<Self, Fault> {
        if shape.frustum.size[0] > ROWS {
            return Err(Fault::Rows { found: shape.frustum.size[0], most: ROWS });
        }
        let [bytes, _] = shape.bytes();
        let canvas_bytes = shape.frustum.size.iter().map(|n| *n as u64).product::<u64>() * 16;
        let found = canvas_bytes.max(bytes + own.alignment);
        if found > own.range {
            return Err(Fault::Size { found, most: own.range });
        }
        let mut made = Self {
            own: own.clone(),
            shape,
            canvas: Memory::new(own, canvas_bytes, Use::Device)?,
            found: Memory::new(own, FOUND, Use::Readback)?,
            tables: Tables::new(own.alignment, own.range),
            upload: Memory::new(own, 1 << 16, Use::Upload)?,
            target,
            pool: vk::CommandPool::null(),
            commands: vk::CommandBuffer::null(),
            fence: vk::Fence::null(),
            sets: vk::DescriptorPool::null(),
            room: 0,
        };
        let raw = &own.raw;
        let info = vk::CommandPoolCreateInfo::default()
            .queue_family_index(own.family)
            .flags(vk::CommandPoolCreateFlags::TRANSIENT);
        // SAFETY: the family is the one of the queue, and `Drop` destroys the pool.
        made.pool = unsafe { raw.create_command_pool(&info, None) }.map_err(of("vkCreateCommandPool"))?;
        let info = vk::CommandBufferAllocateInfo::default().command_pool(made.pool).command_buffer_count(1);
        // SAFETY: the pool was made just now, and frees its commands.
        let commands = unsafe { raw.allocate_command_buffers(&info) }.map_err(of("vkAllocateCommandBuffers"))?;
        made.commands = commands[0];
        // SAFETY: `Drop` destroys the fence.
        let fence = unsafe { raw.create_fence(&vk::FenceCreateInfo::default(), None) };
        made.fence = fence.map_err(of("vkCreateFence"))?;
        Ok(made)
    }

    /// Composes the layers into a slot of the display, or into the memory that the host reads. Returns true if content
    /// was nearer than the display shows. The work is done on return, and other devices see it.
    ///
    /// # Errors
    /// Returns [`Fault`] for texels that are too many for the device, for a slot outside of the memory, and if the
    /// device fails.
    pub fn compose(&mut self, slot: usize, layers: &[Seen<'_>]) -> Result<bool, Fault> {
        let (runs, tables) = self.tables.fill(&self.shape.frustum, layers)?;
        let bytes = 4 * self.tables.words().len() as u64;
        if bytes > self.upload.bytes {
            self.upload = Memory::new(&self.own, bytes.next_power_of_two(), Use::Upload)?;
        }
        self.upload.write(self.tables.words());
        let [frame, _] = self.shape.bytes();
        let begin = match &self.target {
            Target::Slots { stride, .. } => stride.saturating_mul(slot as u64),
            Target::Host(_) => 0,
        };
        let room = self.target.memory().bytes.saturating_sub(begin);
        if frame > room {
            return Err(Fault::Size { found: frame, most: room });
        }
        let sets = self.sets(runs.len() + 1)?;
        self.record(&runs, tables, begin, &sets)?;
        self.submit()?;
        Ok(self.found.words().first().is_some_and(|found| *found != 0))
    }

    /// Returns the colors and the dioptres that the host reads, after [`compose`](Self::compose). Both are empty if the
    /// display has the frame.
    pub fn samples(&self) -> (&[f32], &[f32]) {
        let Target::Host(memory) = &self.target else { return (&[], &[]) };
        let [bytes, depth] = self.shape.bytes().map(|bytes| bytes as usize / 4);
        let pixels = bytes - depth;
        let channels = self.shape.colors.iter().filter(|color| **color).count();
        let values: &[f32] = bytemuck::cast_slice(memory.words());
        (&values[..pixels * channels], &values[depth..bytes])
    }

    /// Returns this many empty sets of descriptors.
    fn sets(&mut self, count: usize) -> Result<Vec<vk::DescriptorSet>, Fault> {
        let raw = &self.own.raw;
        if count > self.room {
            // SAFETY: no work uses the sets, because each composition is awaited.
            unsafe { raw.destroy_descriptor_pool(self.sets, None) };
            (self.sets, self.room) = (vk::DescriptorPool::null(), 0);
            let room = count.next_power_of_two();
            let size = [vk::DescriptorPoolSize::default()
                .ty(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count((room * BINDINGS) as u32)];
            let info = vk::DescriptorPoolCreateInfo::default().max_sets(room as u32).pool_sizes(&size);
            // SAFETY: the structure lives as long as the call, and `Drop` destroys the pool.
            let pool = unsafe { raw.create_descriptor_pool(&info, None) };
            (self.sets, self.room) = (pool.map_err(of("vkCreateDescriptorPool"))?, room);
        } else {
            // SAFETY: as above.
            unsafe { raw.reset_descriptor_pool(self.sets, vk::DescriptorPoolResetFlags::empty()) }
                .map_err(of("vkResetDescriptorPool"))?;
        }
        let layouts = vec![self.own.pipelines.set; count];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.sets).set_layouts(&layouts);
        // SAFETY: the pool has room for these sets.
        unsafe { raw.allocate_descriptor_sets(&info) }.map_err(of("vkAllocateDescriptorSets"))
    }

    /// Writes the buffers of a set.
    fn bind(&self, set: vk::DescriptorSet, buffers: &[(vk::Buffer, u64, u64)]) {
        let infos: Vec<[vk::DescriptorBufferInfo; 1]> = buffers
            .iter()
            .map(|(buffer, begin, bytes)| {
                [vk::DescriptorBufferInfo::default().buffer(*buffer).offset(*begin).range(*bytes)]
            })
            .collect();
        let mut writes = Vec::with_capacity(infos.len());
        for (binding, info) in (0..).zip(&infos) {
            let write = vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(binding)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER);
            writes.push(write.buffer_info(info));
        }
        // SAFETY: no work uses the set, and the ranges are inside of the buffers.
        unsafe { self.own.raw.update_descriptor_sets(&writes, &[]) };
    }

    /// Records the work. The texels of other devices, and the display's slots, are taken over first and handed back at
    /// the end.
    fn record(&self, runs: &[Run<'_>], tables: Range<'_>, begin: u64, sets: &[vk::DescriptorSet]) -> Result<(), Fault> {
        let (raw, commands) = (&self.own.raw, self.commands);
        let foreign = self.foreign(runs);
        // SAFETY: the commands are not in use, because each composition is awaited.
        unsafe { raw.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()) }
            .map_err(of("vkResetCommandPool"))?;
        let once = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: as above.
        unsafe { raw.begin_command_buffer(commands, &once) }.map_err(of("vkBeginCommandBuffer"))?;
        self.pass(&foreign, vk::QUEUE_FAMILY_EXTERNAL, self.own.family);
        // SAFETY: the commands are being recorded, and the buffers are of the device.
        unsafe {
            raw.cmd_fill_buffer(commands, self.canvas.raw, 0, vk::WHOLE_SIZE, 0);
            raw.cmd_fill_buffer(commands, self.found.raw, 0, vk::WHOLE_SIZE, 0);
        }
        use vk::{AccessFlags as Access, PipelineStageFlags as Stage};
        let shader = Access::SHADER_READ | Access::SHADER_WRITE;
        self.order((Stage::TRANSFER, Access::TRANSFER_WRITE), (Stage::COMPUTE_SHADER, shader));
        let [height, width] = self.shape.frustum.size.map(|n| n as u32);
        let angle = self.shape.frustum.angle as f32;
        for (run, set) in runs.iter().zip(sets) {
            let of = |range: &Range<'_>| {
                (range.buffer.map_or(self.upload.raw, |buffer| buffer.raw), range.begin, range.bytes)
            };
            let canvas = (self.canvas.raw, 0, self.canvas.bytes);
            self.bind(*set, &[of(&run.color), of(&run.depth), of(&tables), canvas]);
            let args = compose_layer::Args { height, width, record: run.record, angle };
            let groups = [width.div_ceil(WIDTH), height];
            self.dispatch(self.own.pipelines.compose, *set, bytemuck::bytes_of(&args), groups);
            self.order((Stage::COMPUTE_SHADER, Access::SHADER_WRITE), (Stage::COMPUTE_SHADER, shader));
        }
        self.finish(begin, sets[runs.len()]);
        self.order((Stage::COMPUTE_SHADER, Access::SHADER_WRITE), (Stage::HOST, Access::HOST_READ));
        self.pass(&foreign, self.own.family, vk::QUEUE_FAMILY_EXTERNAL);
        // SAFETY: the commands are being recorded.
        unsafe { raw.end_command_buffer(commands) }.map_err(of("vkEndCommandBuffer"))
    }

    /// Lists the buffers of other devices and of the display, each once.
    fn foreign(&self, runs: &[Run<'_>]) -> Vec<vk::Buffer> {
        let texels = runs.iter().flat_map(|run| [run.color.buffer, run.depth.buffer]).flatten();
        let mut all: Vec<vk::Buffer> = texels.map(|memory| memory.raw).collect();
        if let Target::Slots { memory, .. } = &self.target {
            all.push(memory.raw);
        }
        all.sort_unstable();
        all.dedup();
        all
    }

    /// Records the run that writes the frame.
    fn finish(&self, begin: u64, set: vk::DescriptorSet) {
        let [bytes, depth] = self.shape.bytes();
        // Slots begin at multiples of 4, and ranges at multiples of the device's unit.
        let first = begin % self.own.alignment;
        let frame = (self.target.memory().raw, begin - first, first + bytes);
        let canvas = (self.canvas.raw, 0, self.canvas.bytes);
        self.bind(set, &[canvas, frame, (self.found.raw, 0, FOUND)]);
        let pixels = (self.canvas.bytes / 16) as u32;
        let colors = self.shape.colors.iter().enumerate().map(|(i, has)| u32::from(*has) << i).sum();
        let [light, depth] = [first, first + depth].map(|byte| (byte / 4) as u32);
        let args = finish_layers::Args { pixels, colors, light, depth, nearest: self.shape.nearest };
        // Each run of the shader works on several pixels if there are more than this.
        let groups = [pixels.div_ceil(WIDTH).clamp(1, 32_768), 1];
        self.dispatch(self.own.pipelines.finish, set, bytemuck::bytes_of(&args), groups);
    }

    fn dispatch(&self, pipeline: vk::Pipeline, set: vk::DescriptorSet, push: &[u8], [x, y]: [u32; 2]) {
        let (raw, commands, layout) = (&self.own.raw, self.commands, self.own.pipelines.layout);
        let compute = vk::PipelineBindPoint::COMPUTE;
        // SAFETY: the commands are being recorded, and the set has the buffers of the pipeline.
        unsafe {
            raw.cmd_bind_pipeline(commands, compute, pipeline);
            raw.cmd_bind_descriptor_sets(commands, compute, layout, 0, &[set], &[]);
            raw.cmd_push_constants(commands, layout, vk::ShaderStageFlags::COMPUTE, 0, push);
            raw.cmd_dispatch(commands, x, y, 1);
        }
    }

    /// Orders accesses to memory.
    fn order(&self, from: (vk::PipelineStageFlags, vk::AccessFlags), to: (vk::PipelineStageFlags, vk::AccessFlags)) {
        let barrier = [vk::MemoryBarrier::default().src_access_mask(from.1).dst_access_mask(to.1)];
        let none = vk::DependencyFlags::empty();
        // SAFETY: the commands are being recorded.
        unsafe { self.own.raw.cmd_pipeline_barrier(self.commands, from.0, to.0, none, &barrier, &[], &[]) };
    }

    /// Takes buffers over from other devices, or hands them back.
    fn pass(&self, buffers: &[vk::Buffer], from: u32, to: u32) {
        use vk::AccessFlags as Access;
        let access = Access::SHADER_READ | Access::SHADER_WRITE;
        let ours = |family: u32| if family == vk::QUEUE_FAMILY_EXTERNAL { Access::empty() } else { access };
        let barrier = |buffer: &vk::Buffer| {
            vk::BufferMemoryBarrier::default()
                .buffer(*buffer)
                .size(vk::WHOLE_SIZE)
                .src_queue_family_index(from)
                .dst_queue_family_index(to)
                .src_access_mask(ours(from))
                .dst_access_mask(ours(to))
        };
        let barriers: Vec<_> = buffers.iter().map(barrier).collect();
        let (work, none) = (vk::PipelineStageFlags::COMPUTE_SHADER, vk::DependencyFlags::empty());
        // SAFETY: the commands are being recorded, and the memory of the buffers was made to be shared.
        unsafe { self.own.raw.cmd_pipeline_barrier(self.commands, work, work, none, &[], &barriers, &[]) };
    }

    /// Submits the recorded work and waits for its end.
    fn submit(&self) -> Result<(), Fault> {
        let raw = &self.own.raw;
        // SAFETY: no work uses the fence.
        unsafe { raw.reset_fences(&[self.fence]) }.map_err(of("vkResetFences"))?;
        let commands = [self.commands];
        let submit = [vk::SubmitInfo::default().command_buffers(&commands)];
        {
            let queue = self.own.queue.lock().unwrap_or_else(PoisonError::into_inner);
            // SAFETY: the commands are recorded, the fence is free, and the lock keeps other threads from the queue.
            unsafe { raw.queue_submit(*queue, &submit, self.fence) }.map_err(of("vkQueueSubmit"))?;
        }
        let ns = PATIENCE.as_nanos() as u64;
        // SAFETY: the fence is valid.
        unsafe { raw.wait_for_fences(&[self.fence], true, ns) }.map_err(|error| {
            let _queue = self.own.queue.lock().unwrap_or_else(PoisonError::into_inner);
            // The buffers of the work must stay until its end, which comes at last when the driver gives it up.
            // SAFETY: the lock keeps other threads from the queue.
            let _ = unsafe { raw.device_wait_idle() };
            of("vkWaitForFences")(error)
        })
    }
}

impl Drop for Composer {
    fn drop(&mut self) {
        let raw = &self.own.raw;
        // SAFETY: no work uses the handles, because each composition is awaited. Each may be null.
        unsafe {
            raw.destroy_descriptor_pool(self.sets, None);
            raw.destroy_fence(self.fence, None);
            raw.destroy_command_pool(self.pool, None);
        }
    }
}
