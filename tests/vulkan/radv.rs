//! What AMD's compiler makes of the engine's own pipelines, without hardware: Mesa's driver for AMD has a null device for
//! each family, which compiles and runs nothing. It is chosen by environment variables, so that a process of its own compiles.

#![allow(unsafe_code)]

use eyebox::gpu::ash::{Entry, khr, vk};
use eyebox::gpu::{Gpu, MadePipeline};
use eyebox::optics::{Pupil, PupilDistribution};
use eyebox::solve::{Rehearsal, Settings, Steering};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

const DRIVER: &str = "/usr/share/vulkan/icd.d/radeon_icd.x86_64.json";
const FAMILIES: [&str; 5] = ["NAVI21", "GFX1100", "GFX1103_R1", "VEGA20", "REMBRANDT"];
/// Where the process finds what to compile.
const FOLDER: &str = "EYEBOX_TEST_PIPELINES";

/// Registers of an invocation, and bytes of a workgroup.
const REGISTERS: f64 = 128.0;
const SHARED: f64 = 48.0 * 1024.0;

/// Pipelines of a step of 16 pupils and of a steered one at 1080 x 1920 x 8.
fn pipelines() -> Vec<MadePipeline> {
    let (gpu, problem): (Gpu, _) = (super::rehearsal::gpu(), super::rehearsal::problem());
    Rehearsal::of_solve(&problem, &Settings { pupils: 16, ..Settings::default() }, &gpu, 1).unwrap();
    let aim = PupilDistribution::around(&Pupil { x: 1e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 }, 0.3e-3);
    Rehearsal::of_refinement(problem, 8, Steering::default(), aim, &gpu, 1).unwrap();
    gpu.pipelines()
}

/// Compiles these for a family, and fails where one spills or takes too much.
fn look(family: &str, pipelines: &[MadePipeline]) {
    let folder = tempfile::tempdir().unwrap();
    let mut list = String::new();
    for MadePipeline { module, words, bindings, constants } in pipelines {
        let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
        std::fs::write(folder.path().join(module), bytes).unwrap();
        let constants: Vec<String> = constants.iter().map(u32::to_string).collect();
        writeln!(list, "{module} {bindings} {}", constants.join(" ")).unwrap();
    }
    std::fs::write(folder.path().join("list"), list).unwrap();
    let run = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "radv::compile", "--ignored", "--nocapture"])
        .envs([("RADV_FORCE_FAMILY", family), ("VK_ICD_FILENAMES", DRIVER), ("VK_DRIVER_FILES", DRIVER)])
        .env(FOLDER, folder.path())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&run.stdout);
    assert!(run.status.success(), "{family}: {said}{}", String::from_utf8_lossy(&run.stderr));
    let compiled: Vec<&str> = said.lines().filter_map(|line| line.strip_prefix("compiled ")).collect();
    assert_eq!(compiled.len(), pipelines.len(), "{family}: {said}");
    for line in compiled {
        let numbers: Vec<f64> = line.split_whitespace().take(5).map(|n| n.parse().unwrap()).collect();
        let [registers, shared, rest @ ..] = &numbers[..] else { panic!("{line}") };
        assert!(*registers > 0.0 && *registers <= REGISTERS, "{family}: {registers} registers in {line}");
        assert!(*shared <= SHARED, "{family}: {shared} bytes of shared memory in {line}");
        assert!(rest.iter().all(|spilled| *spilled == 0.0), "{family}: spills or scratch in {line}");
    }
}

fn is_there() -> bool {
    let there = Path::new(DRIVER).exists();
    if !there {
        println!("Mesa's driver for AMD is not installed ({DRIVER}): what its compiler would say is not known");
    }
    there
}

/// Of each module the pipeline with the most constants that are not 1: the longest lines.
#[test]
fn no_pipeline_spills_on_a_radeon() {
    if !is_there() {
        return;
    }
    let mut chosen = BTreeMap::new();
    for pipeline in pipelines() {
        let weight = |p: &MadePipeline| p.constants.get(4).copied();
        let kept = chosen.entry(pipeline.module).or_insert_with(|| pipeline.clone());
        if weight(&pipeline) > weight(kept) {
            *kept = pipeline;
        }
    }
    let chosen: Vec<_> = chosen.into_values().collect();
    assert!(chosen.iter().any(|p| p.module == "compare_rows") && chosen.iter().any(|p| p.module == "gather_columns"));
    look("NAVI21", &chosen);
}

/// All of them, on all families: minutes.
#[test]
#[ignore = "compiles everything five times"]
fn no_pipeline_spills_on_any_radeon() {
    if is_there() {
        let pipelines = pipelines();
        FAMILIES.iter().for_each(|family| look(family, &pipelines));
    }
}

/// The process of its own.
#[test]
#[ignore = "run by the others"]
fn compile() {
    let Some(folder) = std::env::var_os(FOLDER) else { return };
    let list = std::fs::read_to_string(Path::new(&folder).join("list")).unwrap();
    // SAFETY: nothing else makes use of Vulkan in this process; what is made lives as long as it.
    unsafe {
        let entry = Entry::load().unwrap();
        let app = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_2);
        let instance = entry.create_instance(&vk::InstanceCreateInfo::default().application_info(&app), None).unwrap();
        let physical = instance.enumerate_physical_devices().unwrap()[0];
        let mut feature =
            vk::PhysicalDevicePipelineExecutablePropertiesFeaturesKHR::default().pipeline_executable_info(true);
        let queues = [vk::DeviceQueueCreateInfo::default().queue_priorities(&[1.0])];
        let names = [khr::pipeline_executable_properties::NAME.as_ptr()];
        let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues).enabled_extension_names(&names);
        let device = instance.create_device(physical, &info.push_next(&mut feature), None).unwrap();
        let calls = khr::pipeline_executable_properties::Device::new(&instance, &device);
        for line in list.lines() {
            let (module, numbers) = line.split_once(' ').unwrap();
            let numbers: Vec<u32> = numbers.split_whitespace().map(|n| n.parse().unwrap()).collect();
            let bytes = std::fs::read(Path::new(&folder).join(module)).unwrap();
            let words: Vec<u32> = bytes.chunks_exact(4).map(|b| u32::from_le_bytes(b.try_into().unwrap())).collect();
            let pipeline = one(&device, &words, numbers[0], &numbers[1..]);
            let about = vk::PipelineExecutableInfoKHR::default().pipeline(pipeline);
            let all = calls.get_pipeline_executable_statistics(&about).unwrap();
            let of = |name: &str| {
                let found = all.iter().find(|s| s.name_as_c_str().is_ok_and(|n| n.to_bytes() == name.as_bytes()));
                found.map_or(f64::NAN, |s| s.value.u64 as f64)
            };
            let numbers = ["VGPRs", "LDS size", "Spilled VGPRs", "Spilled SGPRs", "Scratch size"].map(of);
            let numbers: Vec<String> = numbers.iter().map(f64::to_string).collect();
            println!("\ncompiled {} {line}", numbers.join(" "));
        }
    }
}

/// # Safety
/// The module is valid and has as many storage buffers.
unsafe fn one(device: &eyebox::gpu::ash::Device, words: &[u32], bindings: u32, constants: &[u32]) -> vk::Pipeline {
    // SAFETY: all that is pointed to lives until the calls return.
    unsafe {
        let shader = device.create_shader_module(&vk::ShaderModuleCreateInfo::default().code(words), None).unwrap();
        let slot = |i| {
            vk::DescriptorSetLayoutBinding::default()
                .binding(i)
                .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                .descriptor_count(1)
                .stage_flags(vk::ShaderStageFlags::COMPUTE)
        };
        let slots: Vec<_> = (0..bindings).map(slot).collect();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&slots);
        let sets = [device.create_descriptor_set_layout(&info, None).unwrap()];
        let push = [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(128)];
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(&push);
        let layout = device.create_pipeline_layout(&info, None).unwrap();
        let entry = |i| vk::SpecializationMapEntry { constant_id: i, offset: 4 * i, size: 4 };
        let entries: Vec<_> = (0..constants.len() as u32).map(entry).collect();
        let data: Vec<u8> = constants.iter().flat_map(|c| c.to_le_bytes()).collect();
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(&data);
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(shader)
            .name(c"main")
            .specialization_info(&special);
        let flags = vk::PipelineCreateFlags::CAPTURE_STATISTICS_KHR;
        let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(layout).flags(flags)];
        device.create_compute_pipelines(vk::PipelineCache::null(), &info, None).unwrap()[0]
    }
}
