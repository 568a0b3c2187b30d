//! The forward model for optimizers of other programs. Its images equal the images of a hologram, and its gradients are
//! the derivatives of a loss in float64.

use crate::model::{Bench, optics, seen_on};
use eyebox::low_level::engine::{Engine, cpu::CpuEngine};
use eyebox::low_level::evaluate::{crop, crop_adjoint, photographs};
use eyebox::low_level::files::write_npy;
use eyebox::low_level::hologram::{ColorHologram, Hologram};
use eyebox::low_level::optics::{
    Color, Display, Geometry, Level, ModelTerms, Optics, Padding, Picture, PictureWarp, Prescription, Pupil,
    WindowFactor,
};
use eyebox::low_level::plan::{Planner, Purpose};
use eyebox::low_level::reconstruction::{ForwardModel, ReconstructionError};
use eyebox::low_level::scene;
use eyebox::low_level::solve::{
    self, FirstPhases, Flow, Optimizer, Problem, PupilRange, Sampler, Settings, cosine, random_phases,
};
use eyebox_tests::both::every_fault;
use eyebox_tests::gradient::{assert_derivative, intensity_loss, random_targets, unwrapped_phases};
use eyebox_tests::{Oracle, error_power, noise};

const FRAMES: usize = 3;
const SIZE: [usize; 2] = [20, 24];

fn small() -> Display {
    Display { height: SIZE[0], width: SIZE[1], ..Display::preset("small").unwrap() }
}

/// Returns the display with all faults of its model in green light.
fn faulty() -> Display {
    let all = every_fault();
    small().with_model_of(Color::Green, |terms| {
        *terms = ModelTerms {
            level: Some(Level::Nodes(all.level)),
            bend: Some(all.bend),
            lag: Some(all.lag),
            crosstalk: all.crosstalk,
            subpixels: Some(2),
            fill: Some(all.fill),
            source: Some(all.source),
            undiffracted: Some(all.undiffracted),
            wavefront: all.wavefront,
            iris: Some([all.iris.x * 1e3, all.iris.y * 1e3, all.iris.scale]),
            ..ModelTerms::default()
        }
    })
}

/// Returns displays with further parts of the model. One has a source of several modes, an eye and a distorted picture.
/// Another is a far field whose picture is smaller than the field of view. The last has a mask at a distance.
fn others() -> Vec<(&'static str, Display, Color)> {
    let mut picture = Picture::default();
    let homography = [0.9, 0.03, 0.02, -0.03, 0.906, -0.05, 0.02, -0.01];
    picture.set(Color::Green, PictureWarp { homography, distortion: [0.15, -0.01] });
    let text = faulty().to_toml() + "\n[source.green]\nimage_mm = 1\nshape = \"square\"\nsamples = 2\n";
    let source = Display::from_toml(&text, "lit").unwrap();
    let source = Display { picture, prescription: Some(Prescription::new(-0.1, 0.05, 35.0)), ..source };
    let far = Display { height: 20, width: 24, pitch: 200e-6, ..Display::preset("far-field").unwrap() };
    let dir = tempfile::tempdir().unwrap();
    let turns: Vec<f32> = noise(48 * 40, 77).iter().map(|x| 3.0 * *x as f32).collect();
    write_npy(&dir.path().join("mask.npy"), &[40, 48], &turns).unwrap();
    let text = "resolution = [20, 24]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n\
        [mask]\nfactor = 2\nfile = \"mask.npy\"\ndistance_mm = 1\n[model.green]\nlevel = 1.04\nfill = 0.8\n";
    let mask = Display::from_toml(text, dir.path().join("b.toml").to_str().unwrap()).unwrap();
    vec![("source", source, Color::Green), ("far field", far, Color::Red), ("mask", mask, Color::Green)]
}

fn pupils() -> [Pupil; 2] {
    [Pupil::from_mm([3.0, -2.0, 9.0, 4.0]), Pupil::from_mm([-5.0, 1.0, 5.0, -1.0])]
}

/// Returns pupils that cover some pixels of an SLM in the pupil plane.
fn near_axis() -> [Pupil; 2] {
    [Pupil::from_mm([0.5, -0.3, 2.0, 4.0]), Pupil::from_mm([-0.8, 0.4, 1.5, -1.0])]
}

/// Returns the derivatives of the mean squared difference of exposed images from targets, with respect to the images.
fn derivative(images: &[f32], targets: &[Vec<f32>], exposure: f32) -> Vec<f32> {
    let count = images.len() as f32;
    let all = images.iter().zip(targets.iter().flatten());
    all.map(|(image, target)| 2.0 * exposure * (exposure * image - target) / count).collect()
}

#[test]
fn gradients_are_the_derivatives_in_float64() {
    let [height, width] = SIZE;
    let (exact, rounded) = unwrapped_phases(FRAMES * height * width, 4);
    let targets = random_targets(2, height * width);
    for (name, display) in [("ideal", small()), ("every fault", faulty())] {
        let oracle = Oracle { optics: optics(height, width), frames: FRAMES };
        let bench = Bench { model: display.model(Color::Green), oracle };
        assert_eq!(bench.model.is_ideal(), name == "ideal");
        let (model, mut engine) = (ForwardModel::new(&display, Color::Green, FRAMES).unwrap(), CpuEngine::new());
        let images = model.images(&rounded, &pupils(), &mut engine).unwrap();
        for (image, pupil) in images.chunks_exact(height * width).zip(&pupils()) {
            let error = error_power(image, &bench.view(&exact, pupil));
            assert!(error < 1e-12, "{name}: error power {error:.1e}");
        }
        let gradients = derivative(&images, &targets, 0.7);
        let gradient = model.adjoint(&rounded, &pupils(), &gradients, &mut engine).unwrap();
        let gradient: Vec<f64> = gradient.iter().map(|value| f64::from(*value)).collect();
        let loss = |phases: &[f64]| intensity_loss(&targets, 0.7, |i| bench.view(phases, &pupils()[i]));
        assert_derivative(&gradient, &exact, 3, 2e-5, name, loss);
    }
}

/// Returns the images that an eye sees of the hologram of these phases.
fn seen(display: &Display, color: Color, phases: &[f32], pupils: &[Pupil]) -> Vec<f32> {
    let wavelength = display.optics(color).unwrap().wavelength;
    let of_color =
        ColorHologram { color: Some(color), wavelength, exposure: 1.0, efficiency: 1.0, phases: phases.to_vec() };
    let hologram = Hologram::on(display, FRAMES, vec![of_color]);
    let one = |pupil: &Pupil| hologram.seen(pupil, &mut CpuEngine::new()).unwrap().remove(0).values;
    pupils.iter().flat_map(one).collect()
}

/// The images equal the images of a hologram bit for bit, also for phases with whole turns. The gradient is the derivative
/// of the sum of the images times random weights. Float32 images limit the differences.
#[test]
fn each_part_of_the_model_is_in_the_images_and_in_the_gradient() {
    let [height, width] = SIZE;
    let count = FRAMES * height * width;
    let (_, phases) = unwrapped_phases(count, 6);
    let all = [("ideal", small(), Color::Green), ("every fault", faulty(), Color::Green)].into_iter().chain(others());
    for (name, display, color) in all {
        let pupils = if name == "far field" { near_axis() } else { pupils() };
        let (model, mut engine) = (ForwardModel::new(&display, color, FRAMES).unwrap(), CpuEngine::new());
        let [rows, columns] = model.image_size();
        let images = |phases: &[f32], engine: &mut CpuEngine| model.images(phases, &pupils, engine).unwrap();
        let plain = images(&phases, &mut engine);
        assert_eq!(plain.len(), 2 * rows * columns);
        let wrapped: Vec<f32> = phases.iter().map(|phase| eyebox::optics::wrap_phase(*phase)).collect();
        assert!(plain == seen(&display, color, &wrapped, &pupils), "{name}: the images differ from a hologram's");

        let weights: Vec<f32> = noise(plain.len(), 8).iter().map(|x| *x as f32).collect();
        let gradient = model.adjoint(&phases, &pupils, &weights, &mut engine).unwrap();
        let largest = gradient.iter().fold(0.0f32, |most, value| most.max(value.abs()));
        // The direction of the gradient with noise, in which the change is large compared with rounding.
        let along = gradient.iter().zip(noise(count, 9)).map(|(g, x)| f64::from(g / largest) + 0.2 * x);
        let direction: Vec<f64> = along.collect();
        let mut at = |step: f64| {
            let moved = phases.iter().zip(&direction).map(|(phase, d)| (f64::from(*phase) + step * d) as f32);
            let images = images(&moved.collect::<Vec<_>>(), &mut engine);
            images.iter().zip(&weights).map(|(image, weight)| f64::from(*image) * f64::from(*weight)).sum::<f64>()
        };
        let h = 5e-3;
        let numeric = (8.0 * (at(h) - at(-h)) - (at(2.0 * h) - at(-2.0 * h))) / (12.0 * h);
        let closed: f64 = gradient.iter().zip(&direction).map(|(g, d)| f64::from(*g) * d).sum();
        eprintln!("{name}: {:.1e}", closed / numeric - 1.0);
        assert!((closed / numeric - 1.0).abs() < 1e-4, "{name}: {closed}, not {numeric}");
    }
}

/// Adam in a few lines over the model, from the same phases with the same pupils, takes the steps of a solve by Adam.
#[test]
fn a_loop_of_adam_over_the_model_is_a_solve_by_adam() {
    let display = Display { height: 48, width: 48, ..Display::preset("small").unwrap() };
    let field = scene::load("builtin:still-life", &scene::Request::new(&display, &[Color::Green])).unwrap();
    let problem = Problem::new(&field, Color::Green, &display, Padding::default()).unwrap();
    let rate = [0.2, 0.01];
    let settings = Settings {
        steps: 12,
        pupils: 4,
        optimizer: Optimizer::Adam { rate, amplitude: false },
        window: WindowFactor::Full,
        diameter: [4e-3, 12e-3],
        depth: [0.0, 2e-3],
        first_phases: FirstPhases::Random,
        ..Settings::default()
    };
    let mut engine = CpuEngine::new();
    let solution = solve::solve(&problem, &settings, &mut engine, &mut |_| Flow::Continue).unwrap();

    let count = settings.frames * 48 * 48;
    let mut phases = random_phases(count, settings.seed);
    let (mut first, mut second) = (vec![0.0f64; count], vec![0.0f64; count]);
    let Settings { diameter, depth, diameters, .. } = settings;
    let range = PupilRange { eyebox: problem.eyebox, diameter, depth, diameters };
    let mut pupils = Sampler::new(range, settings.sequence, settings.seed);
    let (model, mut targets_engine) =
        (ForwardModel::new(&display, Color::Green, settings.frames).unwrap(), CpuEngine::new());
    let planner = problem.planner(settings.frames, WindowFactor::Full);
    targets_engine.load(&planner.shape(Purpose::View), Some(problem.pyramid.clone())).unwrap();
    for step in 0..settings.steps {
        let drawn: Vec<Pupil> = (0..settings.pupils).map(|_| pupils.draw()).collect();
        let targets = photographs(&mut targets_engine, &planner, &drawn).unwrap();
        let images = model.images(&phases, &drawn, &mut engine).unwrap();
        let gradients = derivative(&images, &targets, solution.exposure as f32);
        let gradient = model.adjoint(&phases, &drawn, &gradients, &mut engine).unwrap();
        let (rate, t) = (cosine(rate, step as f64 / settings.steps as f64), step as i32 + 1);
        for (((phase, g), m), v) in phases.iter_mut().zip(&gradient).zip(&mut first).zip(&mut second) {
            let g = f64::from(*g);
            (*m, *v) = (0.9 * *m + 0.1 * g, 0.999 * *v + 0.001 * g * g);
            let (m, v) = (*m / (1.0 - 0.9f64.powi(t)), *v / (1.0 - 0.999f64.powi(t)));
            *phase -= (rate * m / (v.sqrt() + 1e-11)) as f32;
        }
    }
    let [own, solved] = [&phases, &solution.phases].map(|phases| seen_on(&problem, phases));
    let same = phases.iter().zip(&solution.phases).map(|(a, b)| f64::from(a - b).cos()).sum::<f64>() / count as f64;
    eprintln!("own loop {own:.3} dB, solve {solved:.3} dB, mean cosine of the difference {same:.6}");
    assert!((own - solved).abs() < 0.05 && same > 0.999, "{own} dB, not {solved} dB, {same}");
}

/// The sum of gradient times cropped image equals the sum of the adjoint times the image.
#[test]
fn the_adjoint_of_the_crop_is_that_of_the_crop() {
    let planner = |optics: Optics| Planner::new(optics, 1, WindowFactor::Full);
    let plain = optics(10, 13);
    let far = plain.in_geometry(Geometry::FarField);
    let cases = [
        ("no padding", planner(plain)),
        ("padding", planner(plain).with_padding(Padding { rows: 3, columns: 2 })),
        ("mask", planner(plain.behind_mask(2))),
        ("padding of a mask", planner(plain.behind_mask(3)).with_padding(Padding { rows: 3, columns: 2 })),
        ("far field", planner(far)),
        ("part of a far field", Planner { share: 0.8, ..planner(far) }),
    ];
    let random = |count, seed| noise(count, seed).iter().map(|x| (0.6 + 0.4 * x) as f32).collect::<Vec<f32>>();
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
    for (name, planner) in cases {
        let (height, width) = planner.grid.image_size();
        let image = random(height * width, 1);
        let cropped = crop(&planner, image.clone());
        let gradient = random(cropped.len(), 2);
        let back = crop_adjoint(&planner, &gradient, &cropped);
        assert_eq!(back.len(), image.len(), "{name}");
        let (there, back) = (dot(&gradient, &cropped), dot(&back, &image));
        assert!((there / back - 1.0).abs() < 1e-5, "{name}: {there}, {back}");
    }
}

#[test]
fn values_that_do_not_fit_are_refused() {
    let missing =
        ForwardModel::new(&Display { wavelengths: small().wavelengths[..2].to_vec(), ..small() }, Color::Blue, 1);
    assert!(missing.is_err() && ForwardModel::new(&small(), Color::Green, 0).is_err());
    let (model, mut engine) = (ForwardModel::new(&small(), Color::Green, 2).unwrap(), CpuEngine::new());
    assert_eq!((model.shape(), model.image_size()), ([2, 20, 24], SIZE));
    let (mut phases, pupils) = (vec![0.0; 960], pupils());
    let short = model.images(&phases[..950], &pupils, &mut engine);
    assert!(matches!(short, Err(ReconstructionError::Count { what: "phases", given: 950, expected: 960 })));
    let short = model.adjoint(&phases, &pupils, &[1.0; 480], &mut engine);
    assert!(matches!(short, Err(ReconstructionError::Count { what: "gradients", given: 480, expected: 960 })));
    let far = [Pupil { x: 1.0, ..pupils[0] }];
    assert!(matches!(model.images(&phases, &far, &mut engine), Err(ReconstructionError::Hologram(_))));
    assert!(model.adjoint(&phases, &far, &[0.0; 480], &mut engine).is_err());
    assert!(model.images(&phases, &[], &mut engine).unwrap().is_empty());
    assert_eq!(model.adjoint(&phases, &[], &[], &mut engine).unwrap(), vec![0.0; 960]);
    phases[480 + 24 + 5] = f32::NAN;
    let wrong = model.images(&phases, &pupils, &mut engine);
    assert!(matches!(wrong, Err(ReconstructionError::NotFinite { frame: 1, row: 1, column: 5, .. })));
}
