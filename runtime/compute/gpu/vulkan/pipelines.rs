//! Makes compute pipelines by module and specialization constants on first use, and keeps them.

use super::cache;
use super::error::EngineError;
use super::modules::{FloatModes, NOTHING};
use ash::vk;
use eyebox_spirv::Module;
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};

/// Bytes of push constants that every device has. All layouts use all of them.
pub(crate) const PUSH_BYTES: u32 = 128;

/// A pipeline with the data for its dispatches. The default is no pipeline yet, whose dispatches are left out.
#[derive(Clone, Copy, Default)]
pub(crate) struct Pipeline {
    pub(crate) raw: vk::Pipeline,
    pub(crate) layout: vk::PipelineLayout,
    pub(crate) set_layout: vk::DescriptorSetLayout,
    /// Storage buffers at bindings 0, 1, ...
    pub(crate) bindings: u32,
    #[cfg(test)]
    pub(crate) module: &'static str,
}

/// Layouts by number of bindings.
type Layouts = HashMap<u32, (vk::DescriptorSetLayout, vk::PipelineLayout)>;

/// All pipelines of a device. They are dropped before the device.
pub(crate) struct Pipelines {
    made: HashMap<(&'static str, Vec<u32>), Pipeline>,
    /// Pipelines that are no longer handed out.
    outdated: Vec<vk::Pipeline>,
    layouts: Layouts,
    file: Option<PathBuf>,
    /// Makes pipelines on any thread.
    pub(crate) maker: Maker,
    properties: vk::PhysicalDeviceProperties,
    /// True if the file holds all pipelines that were made.
    is_saved: bool,
}

/// A pipeline that will be needed.
pub(crate) struct Wanted {
    pub(crate) module: &'static Module,
    pub(crate) bindings: u32,
    pub(crate) constants: Vec<u32>,
}

/// Makes pipelines, also on several threads at once, because drivers guard their caches.
#[derive(Clone)]
pub(crate) struct Maker {
    device: ash::Device,
    cache: vk::PipelineCache,
    /// Name of the device, for errors.
    name: String,
    modes: FloatModes,
    /// True if nothing runs. An empty module then replaces all others, which take a driver some 0.1 s each.
    record_only: bool,
    /// True if modules are made for dispatches between guard bands.
    #[cfg(test)]
    pub(crate) is_guarded: bool,
}

impl Maker {
    pub(crate) fn make(
        &self,
        module: &'static Module,
        layout: vk::PipelineLayout,
        constants: &[u32],
    ) -> Result<vk::Pipeline, EngineError> {
        let device = &self.device;
        let error = |call, e| EngineError::vulkan(&self.name, call, module.name, e);
        let words = self.modes.put_into(module.words());
        #[cfg(test)]
        let words = if self.is_guarded { super::guards::shifted(&words) } else { words };
        let words = if self.record_only { NOTHING.to_vec() } else { words };
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the module was validated when it was built, and it is destroyed right after the pipeline is made.
        let shader =
            unsafe { device.create_shader_module(&info, None) }.map_err(|e| error("vkCreateShaderModule", e))?;
        let (entries, values) = self.modes.specialised(constants);
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(bytemuck::cast_slice(&values));
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(shader)
            .name(c"main")
            .specialization_info(&special);
        let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout)];
        // SAFETY: the pointers in `info` stay valid until the call returns.
        let made = unsafe { device.create_compute_pipelines(self.cache, &info, None) };
        // SAFETY: the pipeline keeps all that it needs of the module.
        unsafe { device.destroy_shader_module(shader, None) };
        Ok(made.map_err(|(_, e)| error("vkCreateComputePipelines", e))?[0])
    }
}

impl Pipelines {
    /// Reads the cache on disk, in `folder` or in the user's cache folder.
    pub(crate) fn new(
        device: &ash::Device,
        name: &str,
        properties: &vk::PhysicalDeviceProperties,
        folder: Option<&Path>,
        modes: FloatModes,
        record_only: bool,
    ) -> Result<Self, EngineError> {
        let file = cache::file(folder, properties, "pipelines", "bin");
        let data = file.as_deref().and_then(|f| cache::read(f, properties)).unwrap_or_default();
        let info = vk::PipelineCacheCreateInfo::default().initial_data(&data);
        // SAFETY: the data is either empty or what this driver wrote (header and checksum agree).
        let cache = unsafe { device.create_pipeline_cache(&info, None) }
            .map_err(|e| EngineError::vulkan(name, "vkCreatePipelineCache", "pipeline cache", e))?;
        let maker = Maker {
            device: device.clone(),
            cache,
            name: name.into(),
            modes,
            record_only,
            #[cfg(test)]
            is_guarded: false,
        };
        let (made, layouts, outdated) = Default::default();
        Ok(Self { made, outdated, layouts, file, maker, properties: *properties, is_saved: true })
    }

    /// Returns the pipeline of `module` with storage buffers at bindings `0 .. bindings` and the 32-bit
    /// specialization constants 0, 1, ... Integers and floats are passed by their bits. `makes` is called before a
    /// pipeline is made.
    pub(crate) fn get(
        &mut self,
        module: &'static Module,
        bindings: u32,
        constants: &[u32],
        makes: impl FnOnce(),
    ) -> Result<Pipeline, EngineError> {
        if let Some(pipeline) = self.known(module, constants) {
            return Ok(pipeline);
        }
        makes();
        let planned = self.laid_out(module, bindings)?;
        let pipeline = Pipeline { raw: self.maker.make(module, planned.layout, constants)?, ..planned };
        self.made.insert((module.name, constants.to_vec()), pipeline);
        self.is_saved = false;
        Ok(pipeline)
    }

    /// Returns that pipeline, if it was made.
    pub(crate) fn known(&self, module: &'static Module, constants: &[u32]) -> Option<Pipeline> {
        self.made.get(&(module.name, constants.to_vec())).copied()
    }

    /// Returns the layouts of a pipeline of `module` before it is made.
    #[cfg_attr(not(test), allow(unused_variables, reason = "tests name modules"))]
    fn laid_out(&mut self, module: &'static Module, bindings: u32) -> Result<Pipeline, EngineError> {
        let (set_layout, layout) = self.layout(bindings)?;
        Ok(Pipeline {
            raw: vk::Pipeline::null(),
            layout,
            set_layout,
            bindings,
            #[cfg(test)]
            module: module.name,
        })
    }

    /// Returns the wanted pipelines that do not exist yet, each once, as layouts without a pipeline.
    pub(crate) fn missing(&mut self, wanted: Vec<Wanted>) -> Result<Vec<(Wanted, Pipeline)>, EngineError> {
        let mut missing: Vec<(Wanted, Pipeline)> = Vec::new();
        for wanted in wanted {
            let same =
                |other: &Wanted| (other.module.name, &other.constants) == (wanted.module.name, &wanted.constants);
            if self.known(wanted.module, &wanted.constants).is_none() && !missing.iter().any(|(other, _)| same(other)) {
                let pipeline = self.laid_out(wanted.module, wanted.bindings)?;
                missing.push((wanted, pipeline));
            }
        }
        Ok(missing)
    }

    /// From now on kernels compute the bits of halves, whatever the device supports.
    pub(crate) fn make_halves(&mut self) {
        self.maker.modes.rounds_halves = false;
        // The old pipelines may still be in use.
        let halves = self.made.extract_if(|(module, _), _| module.ends_with("_half"));
        self.outdated.extend(halves.map(|(_, pipeline)| pipeline.raw));
    }

    /// Stores a pipeline that was made.
    pub(crate) fn insert(&mut self, wanted: Wanted, pipeline: Pipeline) {
        self.is_saved = false;
        match self.made.entry((wanted.module.name, wanted.constants)) {
            // If the pipeline was made meanwhile, that one may be in use and stays.
            // SAFETY: this pipeline is not yet in use.
            Entry::Occupied(_) => unsafe { self.maker.device.destroy_pipeline(pipeline.raw, None) },
            Entry::Vacant(place) => {
                place.insert(pipeline);
            }
        }
    }

    /// Writes the cache to disk, if it has grown.
    pub(crate) fn save(&mut self) {
        if std::mem::replace(&mut self.is_saved, true) {
            return;
        }
        // SAFETY: the cache is valid.
        let data = unsafe { self.maker.device.get_pipeline_cache_data(self.maker.cache) };
        // Data that equals the file is not written again.
        if let (Some(file), Ok(data)) = (&self.file, data)
            && cache::read(file, &self.properties).as_ref() != Some(&data)
        {
            cache::write(file, &data, &self.properties);
        }
    }

    #[cfg(any(test, feature = "test-hooks"))]
    pub(crate) fn packs_halves(&self) -> bool {
        self.maker.modes.rounds_halves
    }

    #[cfg(any(test, feature = "test-hooks"))]
    pub(crate) fn keys(&self) -> Vec<super::statistics::Key> {
        self.made.iter().map(|((name, constants), made)| (name.to_string(), made.bindings, constants.clone())).collect()
    }

    fn layout(&mut self, bindings: u32) -> Result<(vk::DescriptorSetLayout, vk::PipelineLayout), EngineError> {
        if let Some(layout) = self.layouts.get(&bindings) {
            return Ok(*layout);
        }
        let device = &self.maker.device;
        let slots: Vec<_> = (0..bindings)
            .map(|i| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(i)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&slots);
        // SAFETY: `info` is valid for the call.
        let set = unsafe { device.create_descriptor_set_layout(&info, None) }.map_err(|e| {
            EngineError::vulkan(&self.maker.name, "vkCreateDescriptorSetLayout", "a kernel's layout", e)
        })?;
        let sets = [set];
        let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(PUSH_BYTES)];
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
        // SAFETY: as above.
        let made = unsafe { device.create_pipeline_layout(&info, None) };
        let layout = made.map_err(|e| {
            // SAFETY: nothing uses it.
            unsafe { device.destroy_descriptor_set_layout(set, None) };
            EngineError::vulkan(&self.maker.name, "vkCreatePipelineLayout", "a kernel's layout", e)
        })?;
        self.layouts.insert(bindings, (set, layout));
        Ok((set, layout))
    }
}

impl Drop for Pipelines {
    fn drop(&mut self) {
        self.save();
        let raw = &self.maker.device;
        // SAFETY: recordings are waited for before the pipelines are dropped, and each is destroyed once.
        unsafe {
            for pipeline in self.made.values().map(|made| made.raw).chain(self.outdated.drain(..)) {
                raw.destroy_pipeline(pipeline, None);
            }
            for (set, layout) in self.layouts.values() {
                raw.destroy_pipeline_layout(*layout, None);
                raw.destroy_descriptor_set_layout(*set, None);
            }
            raw.destroy_pipeline_cache(self.maker.cache, None);
        }
    }
}
