//! Tests that a compiler for real devices makes good pipelines of a solve and of a refinement.
//!
//! No registers may spill, and shared memory and registers must stay within limits that keep all units of a device at
//! work. RADV compiles for devices that are not present. If it is not installed (`mesa-vulkan-drivers` on Debian),
//! nothing is compiled, and a line states this.

use super::{DryRun, Optimizer, Problem, RefineSettings, Settings};
use crate::gpu::statistics::{Key, Statistics, compile};
use crate::gpu::{DeviceKind, Gpu, Options};
use crate::optics::{Color, Display, ModelOf, ModelTerms, Pupil, PupilDistribution};
use crate::scene::LightField;
use std::collections::BTreeMap;
use std::process::Command;

/// Environment variable with the path of the list of pipelines for the compiling process. It also decides the path of
/// the answer.
const LIST: &str = "EYEBOX_STATISTICS_OF";
/// RADV's description for the loader, as Debian installs it.
const RADV: &str = "/usr/share/vulkan/icd.d/radeon_icd.x86_64.json";

/// Registers per lane. GFX1100 has half as many again and allocates them by twelves (every pipeline's number there is a
/// multiple of 12), so 128 become 132.
fn most_registers(family: &str) -> u64 {
    if family == "GFX1100" { 132 } else { 128 }
}

/// Pipelines of a step of 16 pupils at 1080 x 1920. With `refined` they include all refinements through an eye's pupil
/// there, of Adam, and of a display with faults.
fn asked_for(refined: bool) -> Vec<Key> {
    let (height, width) = (1080, 1920);
    let plan_as = Some(DeviceKind::Discrete);
    let options = Options { allow_cpu: true, record_only: true, plan_as, ..Options::default() };
    let gpu = Gpu::open(&options).unwrap_or_else(|e| panic!("{e}"));
    let display = Display { height, width, ..Display::preset("paper").expect("a preset") };
    let problem_of = |display: &Display| {
        let field = LightField {
            name: "grey".into(),
            grid: [1, 1],
            height,
            width,
            colors: vec![Color::Green],
            planes: vec![vec![vec![0.5; height * width]]],
            view_pitch: None,
            disparity: None,
            depth: Some([-3e-3, 3e-3]),
            made: None,
        };
        Problem::new(&field, Color::Green, display, Default::default()).expect("a problem")
    };
    let problem = || problem_of(&display);
    let settings = Settings { pupils: 16, ..Settings::default() };
    DryRun::of_solve(&problem(), &settings, &gpu, 1).expect("a step");
    let aim = PupilDistribution::around(&Pupil { x: 1e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 }, 0.3e-3);
    if refined {
        DryRun::of_refinement(problem(), 8, RefineSettings::default(), aim, &gpu, 1).expect("a step");
        let adam = Settings { pupils: 1, optimizer: Optimizer::adam(), ..Settings::default() };
        DryRun::of_solve(&problem(), &adam, &gpu, 1).expect("a step");
        let mut terms = ModelTerms::default();
        (terms.lag, terms.source) = (Some(0.1), Some([0.0, 0.0, -0.4, 0.0, -0.4]));
        terms.crosstalk = Some([[1.2, 2.03].into(); 4]);
        let faulty = Display { model: [(ModelOf::All, terms)].into(), ..display.clone() };
        let settings = Settings { pupils: 1, ..Settings::default() };
        DryRun::of_solve(&problem_of(&faulty), &settings, &gpu, 1).expect("a step");
    }
    let mut keys = gpu.device.pipelines_made();
    // Content frames of splats and of pictures with depths have these, too.
    let of_splats = [("project_splats", 3), ("mark_splats", 2), ("draw_splats", 3)];
    let of_surfaces = [("relief_decode", 4), ("relief_sharpen", 2), ("relief_unmix", 5), ("relief_jump", 3)];
    let of_views =
        [("relief_fill", 3), ("relief_soften", 2), ("relief_levels", 4), ("relief_draw", 6), ("relief_close", 2)];
    let of_content = of_splats.into_iter().chain(of_surfaces).chain(of_views);
    keys.extend(of_content.map(|(name, bindings)| (name.to_owned(), bindings, Vec::new())));
    keys.sort();
    keys
}

/// Returns RADV's statistics for a family of devices, or `None` if it is not installed.
fn compiled(keys: &[Key], family: &str) -> Option<Vec<Statistics>> {
    if !std::path::Path::new(RADV).exists() {
        eprintln!("RADV is not installed ({RADV}): nothing was compiled for a real device");
        return None;
    }
    let folder = tempfile::tempdir().expect("a folder");
    let list = folder.path().join("list.json");
    std::fs::write(&list, serde_json::to_vec(keys).expect("JSON")).expect("written");
    let mut child = Command::new(std::env::current_exe().expect("this program"));
    child.args(["--exact", "solve::statistics_tests::what_a_child_compiles", "--ignored"]).env(LIST, &list);
    child.env("VK_ICD_FILENAMES", RADV).env("VK_DRIVER_FILES", RADV).env("RADV_FORCE_FAMILY", family);
    child.env("MESA_SHADER_CACHE_DISABLE", "true").env_remove("VK_INSTANCE_LAYERS");
    let output = child.output().expect("it starts");
    let answer = std::fs::read(list.with_extension("answer"));
    let answer = answer.unwrap_or_else(|_| panic!("{family}: {}", String::from_utf8_lossy(&output.stdout)));
    Some(serde_json::from_slice(&answer).expect("JSON"))
}

#[test]
#[ignore = "run by the tests below, in a process that has one driver"]
fn what_a_child_compiles() {
    let Some(list) = std::env::var_os(LIST).map(std::path::PathBuf::from) else { return };
    let keys: Vec<Key> = serde_json::from_slice(&std::fs::read(&list).expect("a list")).expect("JSON");
    let (name, told) = compile(&keys).unwrap_or_else(|e| panic!("{e}"));
    println!("{name}");
    std::fs::write(list.with_extension("answer"), serde_json::to_vec(&told).expect("JSON")).expect("written");
}

/// Fails if a pipeline takes too much, which leaves fewer than `least` subgroups on one of the device's units. It
/// prints the resources of each kernel.
fn check(keys: &[Key], family: &str, least: u64) {
    let Some(told) = compiled(keys, family) else { return };
    assert!(told.len() == keys.len() && !keys.is_empty());
    let most_registers = most_registers(family);
    // Per kernel these are the pipelines, and the fewest and most registers, bytes of shared memory, and subgroups per
    // SIMD.
    let mut kernels = BTreeMap::<&str, (usize, [[u64; 2]; 3])>::new();
    for (key, told) in keys.iter().zip(&told) {
        let n = |name: &str| *told.get(name).unwrap_or_else(|| panic!("{family}: RADV has no {name}: {told:?}"));
        assert_eq!([n("Spilled SGPRs"), n("Spilled VGPRs"), n("Scratch size")], [0; 3], "{family}: {key:?} spills");
        let taken = [n("VGPRs"), n("LDS size"), n("Subgroups per SIMD")];
        let (count, ranges) = kernels.entry(&key.0).or_insert((0, taken.map(|n| [n, n])));
        *count += 1;
        for (range, n) in ranges.iter_mut().zip(taken) {
            *range = [range[0].min(n), range[1].max(n)];
        }
        if taken[0] > most_registers || taken[1] > 48 << 10 || taken[2] < least {
            println!("{family}: {key:?} takes too much: {taken:?}");
        }
    }
    println!("{family}: pipelines, then registers, bytes of shared memory and subgroups per SIMD, fewest and most");
    kernels.iter().for_each(|(kernel, (count, ranges))| println!("{family} {kernel}: {count}, {ranges:?}"));
    let most = |i: usize| kernels.values().map(|(_, ranges)| ranges[i][1]).max().unwrap_or(0);
    let fewest = kernels.values().map(|(_, ranges)| ranges[2][0]).min().unwrap_or(0);
    assert!(most(0) <= most_registers, "{family}: {} registers", most(0));
    assert!(most(1) <= 48 << 10, "{family}: {} bytes of shared memory", most(1));
    assert!(fewest >= least, "{family}: {fewest} subgroups per SIMD");
}

/// Checks one family for a solve. Every sixth pipeline is checked of the transforms and the kernels fused with them,
/// which take most time.
#[test]
fn nothing_spills_on_a_real_device() {
    let keys = asked_for(false);
    let (transforms, others): (Vec<_>, Vec<_>) = keys.into_iter().partition(|(_, _, constants)| !constants.is_empty());
    let some = others.into_iter().chain(transforms.into_iter().step_by(6)).collect::<Vec<_>>();
    check(&some, "NAVI21", 4);
}

#[test]
#[ignore = "all pipelines for five families take minutes: tools/nightly.sh"]
fn nothing_spills_on_any_of_five_families() {
    let keys = asked_for(true);
    let only = std::env::var("EYEBOX_FAMILY").ok();
    // VEGA20 has few registers for its number of lanes.
    for (family, least) in [("NAVI21", 4), ("GFX1100", 4), ("GFX1103_R1", 4), ("VEGA20", 1), ("REMBRANDT", 4)] {
        if only.as_deref().is_none_or(|only| only == family) {
            check(&keys, family, least);
        }
    }
}
