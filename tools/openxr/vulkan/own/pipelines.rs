//! Compute pipelines of both kernels.

use super::fault::{Fault, of};
use ash::vk;
use eyebox_kernels::{compose_layer, finish_layers};
use eyebox_spirv::Module;

/// The number of buffers of a kernel.
pub const BINDINGS: usize = 4;

/// Both kernels, which have the same layout.
pub struct Pipelines {
    pub set: vk::DescriptorSetLayout,
    pub layout: vk::PipelineLayout,
    pub compose: vk::Pipeline,
    pub finish: vk::Pipeline,
}

impl Pipelines {
    /// Makes the pipelines on a device.
    ///
    /// # Errors
    /// Returns the driver's error as [`Fault`].
    pub fn new(raw: &ash::Device) -> Result<Self, Fault> {
        let mut made = Self {
            set: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            compose: vk::Pipeline::null(),
            finish: vk::Pipeline::null(),
        };
        match made.fill(raw) {
            Ok(()) => Ok(made),
            Err(fault) => {
                made.destroy(raw);
                Err(fault)
            }
        }
    }

    fn fill(&mut self, raw: &ash::Device) -> Result<(), Fault> {
        let binding = |index: usize| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(index as u32)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
        };
        let bindings: [_; BINDINGS] = std::array::from_fn(binding);
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is valid, and the structure lives as long as the call.
        let set = unsafe { raw.create_descriptor_set_layout(&info, None) };
        self.set = set.map_err(of("vkCreateDescriptorSetLayout"))?;
        let size = size_of::<compose_layer::Args>().max(size_of::<finish_layers::Args>()) as u32;
        let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(size)];
        let sets = [self.set];
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
        // SAFETY: as above.
        let layout = unsafe { raw.create_pipeline_layout(&info, None) };
        self.layout = layout.map_err(of("vkCreatePipelineLayout"))?;
        self.compose = pipeline(raw, self.layout, &eyebox_spirv::COMPOSE_LAYER)?;
        self.finish = pipeline(raw, self.layout, &eyebox_spirv::FINISH_LAYERS)?;
        Ok(())
    }

    /// Destroys the pipelines. No work uses them any more.
    pub fn destroy(&self, raw: &ash::Device) {
        // SAFETY: nothing uses the handles. Each may be null.
        unsafe {
            raw.destroy_pipeline(self.compose, None);
            raw.destroy_pipeline(self.finish, None);
            raw.destroy_pipeline_layout(self.layout, None);
            raw.destroy_descriptor_set_layout(self.set, None);
        }
    }
}

fn pipeline(raw: &ash::Device, layout: vk::PipelineLayout, module: &Module) -> Result<vk::Pipeline, Fault> {
    let info = vk::ShaderModuleCreateInfo::default().code(module.words());
    // SAFETY: the module is valid for Vulkan 1.2, which the device has.
    let shader = unsafe { raw.create_shader_module(&info, None) }.map_err(of("vkCreateShaderModule"))?;
    let stage =
        vk::PipelineShaderStageCreateInfo::default().stage(vk::ShaderStageFlags::COMPUTE).module(shader).name(c"main");
    let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout)];
    // SAFETY: the layout has the buffers of the module, and the structures live as long as the call.
    let made = unsafe { raw.create_compute_pipelines(vk::PipelineCache::null(), &info, None) };
    // SAFETY: a pipeline does not need its module any more.
    unsafe { raw.destroy_shader_module(shader, None) };
    made.map(|pipelines| pipelines[0]).map_err(|(_, result)| of("vkCreateComputePipelines")(result))
}
