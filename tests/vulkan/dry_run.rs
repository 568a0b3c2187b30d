//! Budgets for the work of a step on a device at 1080 x 1920 x 8, which is recorded and not run. Budgets may only
//! become smaller.

use eyebox::low_level::encode::Encoder;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::engine::vulkan::{VulkanEncoder, VulkanEngine};
use eyebox::low_level::gpu::{DeviceKind, Gpu, Options};
use eyebox::low_level::optics::{Color, Display, ModelOf, ModelTerms, Pupil, PupilDistribution};
use eyebox::low_level::plan::{DEVICES, Storage};
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{DryRun, DryRunStep, Problem, RefineSettings, Refiner, Settings};
use eyebox_tests::both::watched;
use std::collections::{BTreeMap, BTreeSet};

/// Returns a problem with nine views. The target image then moves fewer bytes than with 81 views, and all other work is
/// the same.
fn problem() -> Problem {
    problem_of(1080, 1920)
}

fn problem_of(height: usize, width: usize) -> Problem {
    problem_with([3, 3], height, width)
}

fn problem_with(grid: [usize; 2], height: usize, width: usize) -> Problem {
    problem_before(grid, &Display { height, width, ..Display::preset("paper").expect("a preset") })
}

fn problem_before(grid: [usize; 2], display: &Display) -> Problem {
    let (height, width) = (display.height, display.width);
    let view = vec![0.5; height * width];
    let field = LightField {
        name: "grey".into(),
        grid,
        height,
        width,
        colors: vec![Color::Green],
        planes: vec![vec![view; grid[0] * grid[1]]],
        view_pitch: None,
        disparity: None,
        depth: Some([-3e-3, 3e-3]),
        made: None,
    };
    Problem::new(&field, Color::Green, display, Default::default()).expect("a problem")
}

fn gpu() -> Gpu {
    let plan_as = Some(DeviceKind::Discrete);
    Gpu::open(&Options { record_only: true, plan_as, ..watched() }).unwrap_or_else(|e| panic!("{e}"))
}

/// Returns dispatches, stages and bytes of each step.
fn asked(dry_run: &DryRun) -> Vec<[u64; 3]> {
    let of = |s: &DryRunStep| {
        let r = &s.recording;
        [r.dispatches() as u64, r.stage_count() as u64, r.bytes().iter().sum()]
    };
    dry_run.steps.iter().map(of).collect()
}

#[test]
fn steps_keep_to_their_budgets() {
    let (gpu, problem) = (gpu(), problem());
    let settings = Settings { pupils: 16, ..Settings::default() };
    let solve = DryRun::of_solve(&problem, &settings, &gpu, 3).unwrap();
    for [dispatches, stages, bytes] in asked(&solve) {
        assert!(dispatches <= 60 && stages <= 11 && bytes <= 3_700_000_000, "{dispatches} {stages} {bytes}");
        // Each of 16 windows is passed, compared and returned in any case, whatever is fused.
        assert!(dispatches >= 8 && bytes >= 3_000_000_000, "{dispatches} {bytes}");
    }
    // Only tables of transforms are uploaded, and only losses are read back.
    assert!(solve.steps.iter().all(|s| s.counts.read_back == 0 && s.counts.uploaded < 1 << 20));

    let halves = Settings { storage: Storage::F16, ..settings };
    for [.., bytes] in asked(&DryRun::of_solve(&problem, &halves, &gpu, 2).unwrap()) {
        assert!((1_800_000_000..=2_250_000_000).contains(&bytes), "{bytes}");
    }

    let aim = PupilDistribution::around(&Pupil { x: 1e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 }, 0.3e-3);
    let halves = RefineSettings { storage: Some(Storage::F16), ..RefineSettings::default() };
    for [.., bytes] in asked(&DryRun::of_refinement(problem.clone(), 8, halves, aim, &gpu, 4).unwrap()) {
        assert!((200_000_000..=380_000_000).contains(&bytes), "{bytes}");
    }
    let fp32 = RefineSettings { storage: Some(Storage::F32), ..RefineSettings::default() };
    let steered = DryRun::of_refinement(problem, 8, fp32, aim, &gpu, 4).unwrap();
    for [dispatches, stages, bytes] in asked(&steered) {
        assert!(dispatches <= 20 && stages <= 9 && bytes <= 700_000_000, "{dispatches} {stages} {bytes}");
        assert!(bytes >= 500_000_000, "{bytes}");
    }
    let [fast, .., slow] = DEVICES.map(|device| steered.estimate(&device).total());
    assert!(fast < slow);
    assert!(gpu.messages().lock().unwrap().is_empty(), "{:?}", gpu.messages());
}

/// With every term of a display model at once, only the data of the pixels adds bytes, and fields make no further pass.
/// A step takes at most 1.2 times as long as for the ideal display. The terms cost arithmetic, which limits the time of
/// a step.
#[test]
fn every_term_keeps_to_its_budget() {
    let mut terms = ModelTerms { wavefront: [(4, 0.03), (8, 0.05)].into(), ..ModelTerms::default() };
    (terms.lag, terms.bend, terms.undiffracted) =
        (Some(0.1), Some([0.1, -0.05]), Some(vec![[0.2, 0.0, 0.0, 0.0, 0.0]]));
    (terms.crosstalk, terms.source) = (Some([[1.2, 2.03].into(); 4]), Some([0.0, 0.0, -0.4, 0.0, -0.4]));
    let ideal = Display { height: 1080, width: 1920, ..Display::preset("paper").expect("a preset") };
    let faulty = Display { model: [(ModelOf::Green, terms)].into(), ..ideal.clone() };
    for (storage, most_planes, most_times) in [(Storage::F32, 9.0, 1.2), (Storage::F16, 6.0, 1.2)] {
        let settings = Settings { pupils: 16, storage, ..Settings::default() };
        let [ideal, faulty] = [&ideal, &faulty].map(|display| {
            let solve = DryRun::of_solve(&problem_before([5, 5], display), &settings, &gpu(), 2).unwrap();
            let [dispatches, stages, bytes] = asked(&solve)[1].map(|n| n as f64);
            (dispatches, stages, bytes, DEVICES.map(|device| solve.estimate(&device).total().as_secs_f64()))
        });
        // The unit is a plane of float32 of all sub-frames.
        let planes = (faulty.2 - ideal.2) / (4 * 8 * 1080 * 1920) as f64;
        let times = [0, 1, 2].map(|i| faulty.3[i] / ideal.3[i]);
        let what = format!("{storage:?}: {ideal:?} {faulty:?}: {planes} planes, {times:?} times as long");
        assert!(faulty.1 - ideal.1 <= 6.0 && (3.0..=most_planes).contains(&planes), "{what}");
        assert!(times.iter().all(|times| *times <= most_times), "{what}");
    }
}

#[test]
fn what_is_made_for_a_step_is_not_made_again() {
    let (gpu, problem) = (gpu(), problem());
    let steering = RefineSettings { repeats: 8, elsewhere: 0.0, ..RefineSettings::default() };
    let aim = PupilDistribution::around(&Pupil { x: 0.0, y: 0.0, diameter: 3e-3, depth: 0.0 }, 0.0);
    let steered = DryRun::of_refinement(problem, 2, steering, aim, &gpu, 4).unwrap();
    let made = |s: &DryRunStep| s.counts.blocks + s.counts.pipelines + s.counts.pools;
    // The preparation made everything, twice over for the two lists in flight.
    let all = gpu.counts();
    assert!(all.blocks > 0 && all.pipelines > 0 && all.pools > 0, "{all:?}");
    assert!(steered.steps[1..].iter().all(|s| made(s) == 0 && s.counts.uploaded == 0));
    // Each step is one submission, and none is waited for before the next is recorded.
    assert!(steered.steps[1..].iter().all(|s| (s.counts.submissions, s.counts.stalls) == (1, 0)));
    assert!(steered.steps[1..].iter().all(|s| (s.recording.submissions(), s.recording.stalls()) == (1, 0)));
    // A repeated step keeps target images and propagation kernels.
    let [first, second] = [0, 1].map(|i| steered.steps[i].recording.by_kernel());
    assert!(first.iter().any(|(kernel, ..)| kernel.name() == "photograph"));
    assert!(second.iter().all(|(kernel, ..)| kernel.name() != "photograph" && kernel.name() != "transfer"));
}

/// No dispatch takes more than 10 ms, and no submission more than 100 ms, on the slowest device of the comparison, for
/// any size of the display. Short work stays in one submission.
#[test]
fn long_lists_are_cut() {
    let slowest = DEVICES[DEVICES.len() - 1];
    for (height, width, pupils, storage) in [
        (2160, 3840, 16, Storage::F32),
        (2160, 3840, 4, Storage::F16),
        (1080, 1920, 16, Storage::F32),
        (1080, 1920, 2, Storage::F16),
    ] {
        let settings = Settings { pupils, storage, ..Settings::default() };
        let solve = DryRun::of_solve(&problem_with([1, 1], height, width), &settings, &gpu(), 2).unwrap();
        for step in &solve.steps {
            let [dispatch, submission] = slowest.longest(&step.recording).map(|t| t.as_secs_f64() * 1e3);
            let what = format!("{height} x {width}, {pupils} pupils: {dispatch} and {submission} ms");
            assert!(dispatch <= 10.0 && submission <= 100.0, "{what}");
            let all: u64 = step.recording.bytes().iter().sum();
            let least = (all as f64 / slowest.bandwidth / 0.1).ceil() as usize;
            let most = (all as f64 / slowest.bandwidth / 0.08).ceil() as usize;
            let submissions = step.recording.submissions();
            assert!((least..=most).contains(&submissions), "{what} in {submissions} submissions, {least} to {most}");
            assert_eq!(submissions as u64, step.counts.submissions, "{what}");
        }
    }
}

/// A solve makes everything that its steps need before the first step.
#[test]
fn nothing_is_made_while_a_solve_takes_steps() {
    let settings = Settings { pupils: 5, window_bytes: 1 << 20, ..Settings::default() };
    let solve = DryRun::of_solve(&problem_of(216, 384), &settings, &gpu(), 12).unwrap();
    for (i, step) in solve.steps.iter().enumerate() {
        let counts = step.counts;
        assert_eq!((counts.pipelines, counts.blocks, counts.uploaded), (0, 0, 0), "step {i}: {counts:?}");
        // The first step may also make pools of descriptors.
        assert!(i == 0 || (counts.pools, counts.submissions) == (0, 1), "step {i}: {counts:?}");
    }
}

/// A live set of three colors reads back its video frame and at most 16 KB of losses, and uploads nothing. A jump reads
/// back and uploads nothing.
#[test]
fn a_live_set_brings_its_video_frame_and_little_else() {
    let (height, width) = (1080, 1920);
    let gpu = gpu();
    let display = Display { height, width, ..Display::preset("planes24").expect("a preset") };
    let colors = [Color::Red, Color::Green, Color::Blue];
    let field = LightField {
        name: "grey".into(),
        grid: [1, 1],
        height,
        width,
        colors: colors.to_vec(),
        planes: vec![vec![vec![0.5; height * width]]; 3],
        view_pitch: None,
        disparity: None,
        depth: Some([-3e-3, 3e-3]),
        made: None,
    };
    let mut refiners = colors.map(|color| {
        let problem = Problem::new(&field, color, &display, Default::default()).expect("a problem");
        let engine = Box::new(VulkanEngine::new(&gpu).expect("an engine"));
        Refiner::new(problem, &vec![0.0; 8 * height * width], 1.0, RefineSettings::default(), engine)
            .expect("a refinement")
    });
    let encoder = Encoder::new(&display, &colors, 8).expect("an encoder");
    let mut device = VulkanEncoder::new(&gpu, encoder.plan()).expect("an encoder on the device");
    let mut frames = encoder.frames();
    let mut set = |refiners: &mut [Refiner; 3], x: f64| {
        let before = gpu.counts();
        let aim = PupilDistribution::around(&Pupil { x, y: 0.0, diameter: 4e-3, depth: 0.0 }, 0.2e-3);
        for refiner in refiners.iter_mut() {
            refiner.aim(aim).unwrap();
            refiner.advance().unwrap();
        }
        for refiner in refiners.iter_mut() {
            refiner.settle().unwrap();
        }
        let phases: Vec<_> = refiners.iter().map(|r| r.phases_on_device().expect("on the device")).collect();
        device.encode_on_device(&phases).unwrap();
        device.download(frames.bytes_mut()).unwrap();
        let frame = frames.bytes_mut().len() as u64;
        let moved = gpu.counts().since(before);
        assert_eq!((moved.read_back, moved.uploaded, moved.phases_read_back), (frame, 0, 0), "{moved:?}");
        assert!((1..=16 << 10).contains(&moved.losses_read_back), "{moved:?}");
    };
    // The first set also makes the encoder's tables and the pools of descriptors.
    for i in 0..4 {
        set(&mut refiners, 1e-3 * f64::from(i));
    }
    let before = gpu.counts();
    refiners.iter_mut().for_each(|refiner| refiner.begin_again().unwrap());
    let jump = gpu.counts().since(before);
    assert_eq!((jump.read_back, jump.uploaded, jump.losses_read_back, jump.blocks), (0, 0, 0, 0), "{jump:?}");
}

/// A sweep through all sizes of an eye's pupil, in three colors on one device, makes no pipelines, no blocks and no
/// pools.
#[test]
fn nothing_is_made_while_pupils_change() {
    let folder = tempfile::tempdir().unwrap();
    let (plan_as, cache) = (Some(DeviceKind::Discrete), Some(folder.path().to_owned()));
    let gpu = Gpu::open(&Options { record_only: true, plan_as, cache, ..watched() }).unwrap();
    let display = Display { height: 384, width: 512, ..Display::preset("paper").expect("a preset") };
    let colors = [Color::Red, Color::Green, Color::Blue];
    let view = vec![0.5; 384 * 512];
    let field = LightField {
        name: "grey".into(),
        grid: [3, 3],
        height: 384,
        width: 512,
        colors: colors.to_vec(),
        planes: vec![vec![view; 9]; 3],
        view_pitch: None,
        disparity: None,
        depth: Some([-3e-3, 3e-3]),
        made: None,
    };
    let refiner = |color| {
        let problem = Problem::new(&field, color, &display, Default::default()).expect("a problem");
        let engine = Box::new(VulkanEngine::new(&gpu).expect("an engine"));
        Refiner::new(problem, &vec![0.0; 2 * 384 * 512], 1.0, RefineSettings::default(), engine).expect("a refinement")
    };
    let mut refiners = colors.map(refiner);
    // Compiled pipelines are on disk already, so a session that is killed loses none of them.
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    // The first steps make only pools of descriptors.
    for refiner in &mut refiners {
        refiner.step().unwrap();
    }
    let before = gpu.counts();
    assert!(before.pipelines + before.pipelines_in_background > 40, "{before:?}");
    let mut steps = 0;
    for i in 0..=60 {
        let t = f64::from(i) / 60.0;
        let pupil = Pupil { x: 4e-3 * (t - 0.5), y: 2e-3 * t, diameter: 2e-3 + 6e-3 * t, depth: 1e-3 * t };
        for refiner in &mut refiners {
            refiner.aim(PupilDistribution::around(&pupil, 0.2e-3)).unwrap();
            for _ in 0..2 {
                refiner.advance().unwrap();
                steps += 1;
            }
        }
    }
    let made = gpu.counts().since(before);
    assert_eq!((made.pipelines, made.blocks, made.pools, made.uploaded), (0, 0, 0, 0), "{made:?}");
    assert!(made.submissions >= steps && made.read_back == 0, "{made:?}");
    assert_eq!(made.phases_read_back, 0);
}

/// On GPUs, whose time depends on bytes, fields are halves unless the settings request float32. On software devices
/// they are float32.
#[test]
fn gpus_store_halves() {
    let stored = |gpu: &Gpu| VulkanEngine::new(gpu).unwrap().preferred_storage();
    assert_eq!(stored(&gpu()), Storage::F16);
    let software = Options { plan_as: Some(DeviceKind::Cpu), ..watched() };
    assert_eq!(stored(&Gpu::open(&software).unwrap()), Storage::F32);
    // The same step moves fewer bytes.
    let aim = PupilDistribution::around(&Pupil { x: 1e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 }, 0.3e-3);
    let bytes = |storage| {
        let steering = RefineSettings { storage, ..RefineSettings::default() };
        let steered = DryRun::of_refinement(problem_of(128, 128), 8, steering, aim, &gpu(), 2).unwrap();
        asked(&steered)[1][2] as f64
    };
    let [as_preferred, full] = [None, Some(Storage::F32)].map(bytes);
    assert!(as_preferred < 0.8 * full, "{as_preferred} {full}");
}

/// Returns the number of pipelines of each kernel that were made.
fn pipelines_by_kernel(gpu: &Gpu) -> BTreeMap<String, u64> {
    let mut kernels = BTreeMap::new();
    for (kernel, _, _) in gpu.device.pipelines_made() {
        *kernels.entry(kernel).or_default() += 1;
    }
    kernels
}

/// Returns the length and the direction (1 for columns) of each pipeline that transforms whole lines. The radices, whose
/// product is the length, decide the registers of a pipeline.
fn transforms(gpu: &Gpu) -> Vec<(u32, u32)> {
    let made = gpu.device.pipelines_made();
    let shared = made.iter().filter(|(kernel, _, _)| kernel.starts_with("fft_shared"));
    let length = |constants: &[u32]| constants[5..20].chunks(3).map(|stage| stage[0] * stage[1]).product();
    shared.map(|(_, _, constants)| (length(constants), constants[20])).collect()
}

/// A driver of a GPU compiles a pipeline in 0.1 to 0.3 s of a core, and a session shows nothing refined before.
#[test]
fn few_pipelines_are_compiled_before_the_first_step_of_a_session() {
    for storage in [Storage::F16, Storage::F32] {
        let gpu = gpu();
        let steering = RefineSettings { storage: Some(storage), ..RefineSettings::default() };
        let aim = PupilDistribution::around(&Pupil { x: 1e-3, y: 0.0, diameter: 4e-3, depth: 1e-3 }, 0.3e-3);
        DryRun::of_refinement(problem(), 8, steering, aim, &gpu, 0).unwrap();
        let (counts, made) = (gpu.counts(), pipelines_by_kernel(&gpu));
        println!("{storage:?}: {} first, {} later, {made:?}", counts.pipelines, counts.pipelines_in_background);
        assert!((10..=60).contains(&counts.pipelines), "{storage:?}: {counts:?}");
        // The others are made as well, so that a pupil of another size does not wait for a compiler.
        assert!(counts.pipelines_in_background > 60, "{storage:?}: {counts:?}");
        assert_eq!(made.values().sum::<u64>(), counts.pipelines + counts.pipelines_in_background);
        // Transforms differ in their lengths and axes alone. Direction, offsets and scales are no constants.
        let transforms = transforms(&gpu);
        let lines: BTreeSet<(u32, u32)> = transforms.iter().copied().collect();
        println!("{storage:?}: lengths and axes {lines:?}");
        assert_eq!((lines.len() > 20, lines.len()), (true, transforms.len()), "{storage:?}: {transforms:?}");
    }
}
