//! `eyebox refine` refines a hologram for a pupil and prints the gain of each step.

use crate::Failure;
use crate::args::{EngineArgs, EyeArgs, OwnSceneArgs, scene_of};
use crate::common::{self, Engines, Form};
use crate::eval::score;
use crate::experiment::ExperimentArgs;
use crate::phases::{AtArgs, PhaseArgs, tell_unfinished};
use crate::progress::{self, JobBar};
use crate::talk::print_report;
use crate::values::{GivenPupil, MM, diameters, not_negative_in, pupil};
use clap::Args;
use eyebox::low_level::evaluate::Sums;
use eyebox::low_level::gpu::Options;
use eyebox::low_level::hologram::{Hologram, Metadata, Patch, Refined, Tiles};
use eyebox::low_level::optics::{Display, Pupil, PupilDistribution, depth_in_words, dioptres};
use eyebox::low_level::reason;
use eyebox::low_level::scene::LightField;
use eyebox::low_level::solve::{
    BestKeeper, BestState, Diameters, Flow, JointRefiner, Problem, PupilRange, Refinable, RefineSettings, Refiner,
    Sampler, Sequence,
};
use eyebox::low_level::tiled::{TileRect, problem_around};
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;

/// The arguments of `eyebox refine`.
#[derive(Args)]
pub struct Refine {
    /// NAME.zarr, solved for the whole eyebox, or phases (NAME.npy or a folder of PNGs)
    pub hologram: PathBuf,
    #[command(flatten)]
    pub which: AtArgs,
    #[command(flatten)]
    pub scene: OwnSceneArgs,
    /// Pupil as x,y,diameter,focus in mm, or the focus in dioptres (0.5D)
    #[arg(help_heading = "Pupils", long, value_name = "X,Y,D,Z", value_parser = pupil)]
    pub pupil: GivenPupil,
    /// Standard deviation of the place of the pupil, mm
    #[arg(help_heading = "Pupils", long, value_name = "MM", default_value_t = 0.25, value_parser = not_negative_in(MM))]
    pub spread: f64,
    /// Pupil diameters, mm [default: half a millimeter around the pupil's]
    #[arg(help_heading = "Pupils", long, value_name = "MIN..MAX", value_parser = diameters)]
    pub pupil_diameter: Option<[f64; 2]>,
    /// Steps of the refinement
    #[arg(help_heading = "Steps", long, default_value_t = 16, value_name = "N")]
    pub steps: usize,
    #[command(flatten)]
    pub eye: EyeArgs,
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    #[command(flatten)]
    pub phases: PhaseArgs,
    /// Output file NAME.zarr of the refined hologram
    #[arg(help_heading = "Output", short, long, value_name = "OUT")]
    pub out: Option<PathBuf>,
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Number of pupils anywhere in the eyebox through which a row is measured.
const WIDE_PUPILS: usize = 12;

/// The PSNRs after some steps, dB. They are None if the target image is black.
#[derive(Debug, Clone, Copy)]
struct Row {
    steps: usize,
    ms: f64,
    /// PSNR at the pupil, as `eyebox eval score` measures it.
    eye: Option<f64>,
    /// Mean PSNR over the whole eyebox, or over the whole refined piece, at one exposure.
    wide: Option<f64>,
}

/// The rows of each color, the engine's name, and the best states.
type Refinement = (Vec<Vec<Row>>, String, Vec<Best>);

/// The step and the PSNR at the pupil of the best state, for one color or for all together.
type Best = (usize, Option<f64>);

/// Names of [`Row::wide`] for the whole eyebox, as a key of JSON and in words.
const EYEBOX: [&str; 2] = ["eyebox_db", "over the eyebox dB"];
/// Names of [`Row::wide`] for a hologram in tiles.
const PIECE: [&str; 2] = ["piece_db", "over the piece dB"];

/// Refines the hologram and prints the report.
pub fn run(args: &Refine) -> Result<(), Failure> {
    let steering = args.experiment.refinement()?;
    if args.experiment.printed(&[])? {
        return Ok(());
    }
    if let Some(out) = &args.out {
        common::form(out, &[Form::Zarr])?;
    }
    if Tiles::is_tiled(&args.hologram) {
        // A hologram in tiles holds its own optics.
        args.phases.opening(&args.hologram, args.which.at)?;
        return tiled((args, steering));
    }
    let mut hologram = args.phases.opening(&args.hologram, args.which.at)?.hologram(&args.hologram)?;
    args.eye.replace(&mut hologram.metadata.prescription)?;
    let display = score::display_of(&args.hologram, &hologram)?;
    let input = scene_of(
        &args.hologram,
        &hologram,
        args.scene.scene.as_deref(),
        &args.scene.options,
        args.phases.display.force,
    )?;
    common::pupil_of(&args.pupil, &hologram, args.phases.display.force)?;
    let mut engine = common::engine(&args.engine)?;
    let field = input.drawn_by(engine.as_ref()).light_field()?;
    hologram.fit_exposure(&field, engine.as_mut())?;
    drop(engine);
    let aim = args.aim(display.focal_length);
    progress::catch_interrupt();
    let (all, described, best) = match hologram.metadata.joint_color {
        Some(_) => together((args, steering), &mut hologram, &field, &aim)?,
        None => apart((args, steering), &mut hologram, &field, &display, &aim)?,
    };
    if let Some(out) = &args.out {
        hologram.metadata.refined = Some(refined(aim, steering, &best));
        hologram.save(out)?;
    }
    report((args, steering), (&all, &best), &hologram, &described, EYEBOX, &Value::Null);
    Ok(())
}

/// Refines the phases of each color. Returns the rows color by color and the engine's name.
fn apart(
    (args, steering): (&Refine, RefineSettings),
    hologram: &mut Hologram,
    field: &LightField,
    display: &Display,
    aim: &PupilDistribution,
) -> Result<Refinement, Failure> {
    let padding = hologram.metadata.padding();
    let (mut all, mut described, mut bests) = (Vec::new(), String::new(), Vec::new());
    for solved in &mut hologram.colors {
        let Some(color) = solved.color else { continue };
        let problem = Problem::new(field, color, display, padding)?;
        problem.check_blur(aim.diameter[1])?;
        let anywhere = PupilRange::over(problem.eyebox, aim.focus);
        let RefinedColor { rows, best, engine, sources } =
            steps((args, steering), problem, &solved.phases, solved.exposure, anywhere)?;
        bests.push((best.step, best.psnr));
        solved.phases = best.phases.into_iter().flatten().collect();
        hologram.metadata.sources.light_only(color, &sources);
        described = engine;
        all.push(rows);
    }
    Ok((all, described, bests))
}

/// Refines the drives that all colors share. The powers of the lasers stay as they are.
fn together(
    (args, steering): (&Refine, RefineSettings),
    hologram: &mut Hologram,
    field: &LightField,
    aim: &PupilDistribution,
) -> Result<Refinement, Failure> {
    let engines = Engines::new(&args.engine, &Options::default())?;
    let problems = hologram.problems(field)?;
    problems.iter().try_for_each(|problem| problem.check_blur(aim.diameter[1]))?;
    let (Some(first), Some(parts)) = (problems.first(), hologram.joint_parts(problems.clone())) else {
        return Err(Failure::Arguments(reason!(
            "colors-of-lasers",
            "{}: its colors and its lasers differ",
            args.hologram.display()
        )));
    };
    let anywhere = wide_pupils(PupilRange::over(first.eyebox, aim.focus), first, steering.seed);
    let drives = hologram.sent_phases().swap_remove(0);
    let mut described = String::new();
    let mut refiner = JointRefiner::new(parts, &drives, steering, || {
        let engine = engines.open()?;
        described = engine.describe();
        Ok(engine)
    })?;
    // The exposures are from the hologram before the refinement, because lasers stay as they are.
    let exposed = |color| Ok(Sums::fit_exposure(&refiner.look(color, &anywhere)?)?);
    let exposures = (0..problems.len()).map(exposed).collect::<Result<Vec<f64>, Failure>>()?;
    refiner.aim(*aim)?;
    let (all, best) = follow(args, &mut refiner, (&anywhere, &exposures), "of all colors")?;
    hologram.colors.iter_mut().zip(best.phases).for_each(|(color, phases)| color.phases = phases);
    Ok((all, described, vec![(best.step, best.psnr)]))
}

/// Refines a hologram in tiles. The tiles around the eye are read, refined as a far field of their own, and put into a
/// copy.
fn tiled((args, steering): (&Refine, RefineSettings)) -> Result<(), Failure> {
    let tiles = Tiles::open(&args.hologram)?;
    if args.eye.given()?.is_some_and(|eye| !eye.is_perfect()) {
        let file = args.hologram.display();
        return Err(Failure::Arguments(reason!(
            "eye-of-tiles",
            "{file}: a hologram in tiles is refined for a perfect eye only"
        )));
    }
    let about = tiles.about();
    if tiles.made().is_some() && args.out.is_some() {
        let file = args.hologram.display();
        return Err(Failure::Arguments(reason!(
            "unfinished",
            "{file}: it is still being solved. Repeat its command, and refine it then"
        )));
    }
    tell_unfinished(&args.hologram)?;
    let display = score::display_of(&args.hologram, about)?;
    let input =
        scene_of(&args.hologram, about, args.scene.scene.as_deref(), &args.scene.options, args.phases.display.force)?;
    common::pupil_of(&args.pupil, about, args.phases.display.force)?;
    let scene = input.around()?;
    let aim = args.aim(display.focal_length);
    progress::catch_interrupt();
    let (mut all, mut patches, mut described, mut place) = (Vec::new(), Vec::new(), String::new(), Value::Null);
    let mut bests = Vec::new();
    for (color, views) in scene.iter().enumerate() {
        let (TileRect { at, size }, problem) = problem_around(&tiles, color, views, &aim)?;
        place = json!({ "piece": { "first": at, "size": size }, "unfinished": tiles.unfinished() });
        let anywhere = PupilRange {
            eyebox: problem.eyebox,
            diameter: aim.diameter,
            depth: aim.focus,
            diameters: Diameters::Uniform,
        };
        let phases = tiles.read(color, at, size)?;
        let exposure = about.colors[color].exposure;
        let RefinedColor { rows, best, engine, .. } = steps((args, steering), problem, &phases, exposure, anywhere)?;
        bests.push((best.step, best.psnr));
        if args.out.is_some() {
            patches.push(Patch { color, at, size, phases: best.phases.into_iter().flatten().collect() });
        }
        described = engine;
        all.push(rows);
    }
    if let Some(out) = &args.out {
        let metadata = Metadata { refined: Some(refined(aim, steering, &bests)), ..about.metadata.clone() };
        tiles.copy(out, &metadata, &patches)?;
    }
    report((args, steering), (&all, &bests), about, &described, PIECE, &place);
    Ok(())
}

impl Refine {
    /// Returns the distribution of the pupil.
    fn aim(&self, focal_length: f64) -> PupilDistribution {
        let Pupil { x, y, diameter, depth } = self.pupil.before(focal_length);
        let half = 0.5e-3f64.min(diameter / 2.0);
        let diameter = self.pupil_diameter.unwrap_or([diameter - half, diameter + half]);
        PupilDistribution { centre: [x, y], spread: self.spread * 1e-3, diameter, focus: [depth; 2], elsewhere: 0.0 }
    }
}

/// Returns the entry of the file about the refinement.
fn refined(aim: PupilDistribution, steering: RefineSettings, best: &[Best]) -> Refined {
    Refined { aim, steering, steps: best.iter().map(|(step, _)| *step).max().unwrap_or(0) }
}

/// The refinement of one color.
struct RefinedColor {
    rows: Vec<Row>,
    best: BestState,
    /// The name of the engine.
    engine: String,
    /// The indices of the display's switchable sources that light the color.
    sources: Vec<usize>,
}

/// Refines one color. `anywhere` is around the middle of the refined eyebox or piece.
fn steps(
    (args, steering): (&Refine, RefineSettings),
    problem: Problem,
    phases: &[f32],
    exposure: f64,
    anywhere: PupilRange,
) -> Result<RefinedColor, Failure> {
    let engine = common::engine(&args.engine)?;
    let aim = args.aim(problem.optics.focal_length);
    let described = engine.describe();
    let everywhere = wide_pupils(anywhere, &problem, steering.seed);
    let mut refiner = Refiner::new(problem, phases, exposure, steering, engine)?;
    // The eyebox is compared at the exposure of the hologram before the refinement, in the light that it was made for,
    // because lasers stay as they are.
    let exposure = Sums::fit_exposure(&refiner.look(&everywhere)?)?;
    refiner.aim(aim)?;
    // If other sources are lit now, the pupils are in the eyeboxes of those sources.
    let anywhere = wide_pupils(anywhere, refiner.problem(), steering.seed);
    let (mut rows, best) = follow(args, &mut refiner, (&anywhere, &[exposure]), "for this color")?;
    Ok(RefinedColor { rows: rows.remove(0), best, engine: described, sources: refiner.sources().to_vec() })
}

/// Takes the steps until ctrl-C, and measures after 1, 2, 4, 8, ... of them and the last. Returns the rows of each
/// color, and the best state. `wide` has pupils anywhere in the eyebox and each color's exposure.
fn follow(
    args: &Refine,
    refined: &mut dyn Refinable,
    wide: (&[Pupil], &[f64]),
    what: &str,
) -> Result<(Vec<Vec<Row>>, BestState), Failure> {
    let aim = refined.aimed_at();
    let mut keeper = BestKeeper::new(Pupil { diameter: args.pupil.before(0.0).diameter, ..aim.middle() });
    let (mut rows, bar) = (vec![Vec::new(); wide.1.len()], JobBar::new(args.json));
    let (mut taken, mut ms, mut goes_on) = (0, 0.0, true);
    keeper.judge(refined)?;
    loop {
        let sums = refined.look_at_colors(wide.0)?;
        let measured = sums.iter().zip(wide.1).zip(keeper.psnr_of_colors());
        for (rows, ((sums, exposure), eye)) in rows.iter_mut().zip(measured) {
            let wide = mean(sums.iter().map(|sums| sums.quality(*exposure)));
            rows.push(Row { steps: taken, ms, eye: *eye, wide });
        }
        let more = (2 * taken).clamp(1, args.steps.max(1)).min(args.steps) - taken;
        if more == 0 || !goes_on {
            break;
        }
        let mut seconds = 0.0;
        let (loss, count) = eyebox::low_level::solve::refine(&mut [(&mut *refined, &mut keeper)], more, &mut |at| {
            seconds = at.seconds;
            let done = format!("{} of {} steps {what}", at.step, args.steps);
            let flow = bar.show(&done, at.step as f64 / args.steps as f64);
            goes_on &= flow == Flow::Continue;
            flow
        })?;
        goes_on &= loss.is_finite();
        // The time is per color, because each step refines every color.
        ms += seconds * 1e3 / wide.1.len() as f64;
        taken += count;
    }
    bar.finish();
    let best = keeper.into_best().expect("judged before the first step");
    Ok((rows, best))
}

/// Returns the mean of the known PSNRs.
fn mean(each: impl Iterator<Item = Option<f64>>) -> Option<f64> {
    let known: Vec<f64> = each.flatten().collect();
    (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
}

/// Prints the gain of each step over all colors. `place` has the refined piece of a hologram in tiles, and the progress
/// of an unfinished one.
fn report(
    (args, steering): (&Refine, RefineSettings),
    (all, best): (&[Vec<Row>], &[Best]),
    about: &Hologram,
    engine: &str,
    [key, words]: [&str; 2],
    place: &Value,
) {
    // After an interruption some colors may have fewer rows.
    let count = all.iter().map(Vec::len).min().unwrap_or(0);
    let f = about.focal_length;
    let focus = args.pupil.before(f).depth;
    let rows: Vec<Row> = (0..count)
        .map(|i| Row {
            steps: all[0][i].steps,
            ms: all.iter().map(|r| r[i].ms).sum(),
            eye: mean(all.iter().map(|r| r[i].eye)),
            wide: mean(all.iter().map(|r| r[i].wide)),
        })
        .collect();
    if args.json {
        let row = |r: &Row| json!({ "steps": r.steps, "ms": r.ms, "eye_db": r.eye, key: r.wide });
        let mut said = json!({
            "engine": engine, "aim": args.aim(f), "focus_mm": focus * 1e3, "focus_dioptres": dioptres(focus, f),
            "steering": steering, "rows": rows.iter().map(row).collect::<Vec<_>>(),
            "best_steps": best.iter().map(|(step, _)| step).collect::<Vec<_>>(),
            "best_db": best.iter().map(|(_, psnr)| psnr).collect::<Vec<_>>(),
            "out": args.out.as_ref().map(|out| out.display().to_string()),
        });
        if !place.is_null() {
            said["piece"] = place["piece"].clone();
            said["unfinished"] = place["unfinished"].clone();
            said["peak_memory_mib"] = json!(common::peak_memory_mib());
        }
        print_report(said);
        return;
    }
    let (frames, colors) = (common::counted(about.frames, "sub-frame"), common::counted(all.len(), "color"));
    println!("{engine}; {frames}, {colors}; focused at {}", depth_in_words(focus, f));
    if let (Some(first), Some(size)) = (place["piece"]["first"].as_array(), place["piece"]["size"].as_array()) {
        println!("the piece of {}x{} pixels from row {}, column {}", size[0], size[1], first[0], first[1]);
    }
    println!("  steps        ms    at the eye dB   {words}");
    for row in &rows {
        let [eye, wide] = [row.eye, row.wide].map(score::decibels);
        println!("  {:5} {:9.1}   {eye:>14}   {wide:>width$}", row.steps, row.ms, width = words.len());
    }
    if let Some(out) = &args.out {
        let each: Vec<String> = best
            .iter()
            .map(|(step, psnr)| match psnr {
                Some(psnr) => format!("{step} ({psnr:.2} dB)"),
                None => format!("{step} (black)"),
            })
            .collect();
        println!("wrote {}: the best state, after steps: {}", out.display(), each.join(", "));
    }
}

/// Returns pupils of another seed than the refinement's, anywhere in the light of the problem.
fn wide_pupils(anywhere: PupilRange, problem: &Problem, seed: u64) -> Vec<Pupil> {
    let center = problem.optics.center();
    let sampler = Sampler::new(anywhere, Sequence::Sobol, !seed ^ 0x616e_7977);
    let mut sampler = sampler.over(Arc::clone(&problem.regions));
    let moved = |p: Pupil| Pupil { x: p.x + center[0], y: p.y + center[1], ..p };
    (0..WIDE_PUPILS).map(|_| moved(sampler.draw())).collect()
}
