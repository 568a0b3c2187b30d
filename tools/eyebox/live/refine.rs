//! `eyebox refine`: a hologram refined for where the eye is, and what each step gains.

use super::args::SteeringArgs;
use crate::Failure;
use crate::args::{EngineArgs, EyeArgs, OtherSceneArgs, OwnSceneArgs};
use crate::common::{self, Engines, Form};
use crate::phases::{PhaseArgs, tell_unfinished};
use crate::progress::{self, JobBar};
use crate::score;
use crate::values::{GivenPupil, diameters, not_negative, pupil};
use clap::Args;
use eyebox::evaluate::Sums;
use eyebox::gpu::Options;
use eyebox::hologram::{Hologram, Metadata, Patch, Refined, Tiles};
use eyebox::optics::{Display, Pupil, PupilDistribution, depth_in_words, dioptres};
use eyebox::scene::LightField;
use eyebox::solve::{
    BestState, Diameters, Flow, JUDGED_PUPILS, JointRefiner, Problem, PupilRange, Refiner, Sampler, Sequence,
    is_judged, pupils_of,
};
use eyebox::tiled::Piece;
use serde_json::{Value, json};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

/// `eyebox refine`
#[derive(Args)]
pub struct Refine {
    /// NAME.zarr, solved for the whole eyebox; or phases: NAME.npy or a folder of PNGs
    pub hologram: PathBuf,
    /// Scene
    #[command(flatten)]
    pub scene: OwnSceneArgs,
    /// Where the eye is: x,y,diameter,focus in mm, or the focus in dioptres: 0.5D
    #[arg(long, value_name = "X,Y,D,Z", value_parser = pupil, allow_hyphen_values = true)]
    pub pupil: GivenPupil,
    /// Standard deviation of where it is, mm
    #[arg(long, value_name = "MM", default_value_t = 0.25, value_parser = not_negative)]
    pub spread: f64,
    /// Its diameter, mm [default: half a millimetre about the pupil's]
    #[arg(long, value_name = "MIN..MAX", value_parser = diameters)]
    pub diameter: Option<[f64; 2]>,
    /// Steps
    #[arg(long, default_value_t = 16, value_name = "N")]
    pub steps: usize,
    /// The eye that looks
    #[command(flatten)]
    pub eye: EyeArgs,
    /// How the phases follow
    #[command(flatten)]
    pub steering: SteeringArgs,
    /// A scene that the hologram was not made of
    #[command(flatten)]
    pub other: OtherSceneArgs,
    /// Bare phases
    #[command(flatten)]
    pub phases: PhaseArgs,
    /// Where the refined hologram goes: NAME.zarr
    #[arg(short, long, value_name = "OUT")]
    pub out: Option<PathBuf>,
    /// Engine
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output
    #[arg(long)]
    pub json: bool,
}

/// What had been reached after some steps.
#[derive(Debug, Clone, Copy)]
struct Row {
    steps: usize,
    ms: f64,
    /// At the eye,
    eye: f64,
    /// and over the whole eyebox, or all of the piece that was refined.
    wide: f64,
}

/// What each step gained, color by color, the engine's name, and the steps after which colors were best.
type Refinement = (Vec<Vec<Row>>, String, Vec<usize>);

/// What [`Row::wide`] is about: as JSON's key, and in words.
const EYEBOX: [&str; 2] = ["eyebox_db", "over the eyebox dB"];
/// Of a hologram in tiles.
const PIECE: [&str; 2] = ["piece_db", "over the piece dB"];

/// Refines, and says what came of it.
pub fn run(args: &Refine) -> Result<(), Failure> {
    if let Some(out) = &args.out {
        common::form(out, &[Form::Zarr])?;
    }
    if Tiles::is_tiled(&args.hologram) {
        // It holds its own optics.
        args.phases.opening(&args.hologram, None)?;
        return tiled(args);
    }
    let mut hologram = args.phases.opening(&args.hologram, None)?.hologram(&args.hologram)?;
    args.eye.replace(&mut hologram.metadata.prescription)?;
    let display = score::display_of(&args.hologram, &hologram)?;
    let input = args.other.open(&args.hologram, &hologram, args.scene.scene.as_deref(), &args.scene.options)?;
    common::pupil_of(&args.pupil, &hologram, args.phases.force)?;
    let field = input.light_field()?;
    hologram.fit_exposure(&field, common::engine(&args.engine)?.as_mut())?;
    let aim = args.aim(display.focal_length);
    progress::catch_interrupt();
    let (all, described, best) = match hologram.metadata.joint_color {
        Some(_) => together(args, &mut hologram, &field, &aim)?,
        None => apart(args, &mut hologram, &field, &display, &aim)?,
    };
    if let Some(out) = &args.out {
        hologram.metadata.refined = Some(args.refined(aim, &best));
        hologram.save(out)?;
    }
    report(args, (&all, &best), &hologram, &described, EYEBOX, &Value::Null);
    Ok(())
}

/// Refines each colour's own phases: what each step gained, colour by colour, and the engine's name.
fn apart(
    args: &Refine,
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
            steps(args, problem, &solved.phases, solved.exposure, anywhere)?;
        solved.phases = best.state;
        bests.push(best.step);
        hologram.metadata.sources.light_only(color, &sources);
        described = engine;
        all.push(rows);
    }
    Ok((all, described, bests))
}

/// Refines the drives that all colours share, in the light of their lasers as it is: the same.
fn together(
    args: &Refine,
    hologram: &mut Hologram,
    field: &LightField,
    aim: &PupilDistribution,
) -> Result<Refinement, Failure> {
    let (engines, steering) = (Engines::new(&args.engine, &Options::default())?, args.steering.steering());
    let problems = hologram.problems(field)?;
    problems.iter().try_for_each(|problem| problem.check_blur(aim.diameter[1]))?;
    let (Some(first), Some(parts)) = (problems.first(), hologram.joint_parts(problems.clone())) else {
        return Err(Failure::Asked(format!("{}: its colours are not those of its lasers", args.hologram.display())));
    };
    let (at_eye, anywhere) = judged(PupilRange::over(first.eyebox, aim.focus), first, aim, steering.seed);
    let drives = hologram.sent_phases().swap_remove(0);
    let mut described = String::new();
    let mut refiner = JointRefiner::new(parts, &drives, steering, || {
        let engine = engines.open()?;
        described = engine.describe();
        Ok(engine)
    })?;
    let colors = 0..problems.len();
    // At the exposures of the hologram as it was: lasers stay as they are.
    let exposed = |color| Ok(Sums::fit_exposure(&refiner.look(color, &anywhere)?)?);
    let exposures = colors.clone().map(exposed).collect::<Result<Vec<f64>, Failure>>()?;
    refiner.aim(*aim)?;
    let row = |refiner: &mut JointRefiner, color: usize, steps: usize, ms: f64| -> Result<Row, Failure> {
        let mut mean = |pupils: &[Pupil]| -> Result<f64, Failure> {
            let sums = refiner.look(color, pupils)?;
            Ok(sums.iter().map(|s| s.psnr(exposures[color])).sum::<f64>() / sums.len() as f64)
        };
        Ok(Row { steps, ms, eye: mean(&at_eye)?, wide: mean(&anywhere)? })
    };
    let mut all =
        colors.clone().map(|c| Ok(vec![row(&mut refiner, c, 0, 0.0)?])).collect::<Result<Vec<_>, Failure>>()?;
    let mean_at_eye = |all: &[Vec<Row>]| {
        let last = all.iter().filter_map(|rows| rows.last());
        last.map(|row| row.eye).sum::<f64>() / all.len().max(1) as f64
    };
    let mut best = BestState { step: 0, psnr: mean_at_eye(&all), state: refiner.phases().to_vec() };
    let (mut ms, bar) = (0.0, JobBar::new(args.json));
    for steps in 1..=args.steps {
        let start = Instant::now();
        refiner.step()?;
        // A step of each colour.
        ms += start.elapsed().as_secs_f64() * 1e3 / all.len() as f64;
        if is_judged(steps, args.steps) || progress::interrupted() {
            for (color, rows) in all.iter_mut().enumerate() {
                rows.push(row(&mut refiner, color, steps, ms)?);
            }
            best.offer(steps, mean_at_eye(&all), || Ok::<_, Failure>(refiner.phases().to_vec()))?;
        }
        let done = format!("{steps} of {} steps of all colours", args.steps);
        if bar.show(&done, steps as f64 / args.steps as f64) == Flow::Stop {
            break;
        }
    }
    bar.finish();
    hologram.colors.iter_mut().zip(best.state).for_each(|(color, phases)| color.phases = phases);
    Ok((all, described, vec![best.step]))
}

/// The same for a hologram in tiles: those around the eye are read, refined as a far field of their own, and put into a
/// copy.
fn tiled(args: &Refine) -> Result<(), Failure> {
    let tiles = Tiles::open(&args.hologram)?;
    if args.eye.given()?.is_some_and(|eye| !eye.is_perfect()) {
        let file = args.hologram.display();
        return Err(Failure::Asked(format!("{file}: a hologram in tiles is refined for a perfect eye only")));
    }
    let about = tiles.about();
    if tiles.made().is_some() && args.out.is_some() {
        let file = args.hologram.display();
        return Err(Failure::Asked(format!(
            "{file}: it is still being solved: repeat its command, and refine it then"
        )));
    }
    tell_unfinished(&args.hologram)?;
    let display = score::display_of(&args.hologram, about)?;
    let input = args.other.open(&args.hologram, about, args.scene.scene.as_deref(), &args.scene.options)?;
    common::pupil_of(&args.pupil, about, args.phases.force)?;
    let scene = input.around()?;
    let aim = args.aim(display.focal_length);
    progress::catch_interrupt();
    let (mut all, mut patches, mut described, mut place) = (Vec::new(), Vec::new(), String::new(), Value::Null);
    let mut bests = Vec::new();
    for (color, views) in scene.iter().enumerate() {
        let Piece { at, size, problem } = Piece::around(&tiles, color, views, &aim)?;
        place = json!({ "piece": { "first": at, "size": size }, "unfinished": tiles.unfinished() });
        let anywhere = PupilRange {
            eyebox: problem.eyebox,
            diameter: aim.diameter,
            depth: aim.focus,
            diameters: Diameters::Uniform,
        };
        let phases = tiles.read(color, at, size)?;
        let exposure = about.colors[color].exposure;
        let RefinedColor { rows, best, engine, .. } = steps(args, problem, &phases, exposure, anywhere)?;
        bests.push(best.step);
        if args.out.is_some() {
            patches.push(Patch { color, at, size, phases: best.state });
        }
        described = engine;
        all.push(rows);
    }
    if let Some(out) = &args.out {
        let metadata = Metadata { refined: Some(args.refined(aim, &bests)), ..about.metadata.clone() };
        tiles.copy(out, &metadata, &patches)?;
    }
    report(args, (&all, &bests), about, &described, PIECE, &place);
    Ok(())
}

impl Refine {
    /// Where the eye is believed to be.
    fn aim(&self, focal_length: f64) -> PupilDistribution {
        let Pupil { x, y, diameter, depth } = self.pupil.before(focal_length);
        let half = 0.5e-3f64.min(diameter / 2.0);
        let diameter = self.diameter.unwrap_or([diameter - half, diameter + half]);
        PupilDistribution { centre: [x, y], spread: self.spread * 1e-3, diameter, focus: [depth; 2], elsewhere: 0.0 }
    }

    /// What the file says of it; `best` are the steps after which its colors were best.
    fn refined(&self, aim: PupilDistribution, best: &[usize]) -> Refined {
        Refined { aim, steering: self.steering.steering(), steps: best.iter().copied().max().unwrap_or(0) }
    }
}

/// One colour, refined.
struct RefinedColor {
    /// What each step gained.
    rows: Vec<Row>,
    /// The best of the states that were judged, which is kept.
    best: BestState<Vec<f32>>,
    /// The engine's name.
    engine: String,
    /// The display's switchable sources that light it, by their places.
    sources: Vec<usize>,
}

/// Refines one colour. `anywhere` is around the middle of what is refined.
fn steps(
    args: &Refine,
    problem: Problem,
    phases: &[f32],
    exposure: f64,
    anywhere: PupilRange,
) -> Result<RefinedColor, Failure> {
    let (engine, steering) = (common::engine(&args.engine)?, args.steering.steering());
    let aim = args.aim(problem.optics.focal_length);
    let described = engine.describe();
    let (at_eye, everywhere) = judged(anywhere, &problem, &aim, steering.seed);
    let mut refiner = Refiner::new(problem, phases, exposure, steering, engine)?;
    // What is seen is compared at the exposure of the hologram as it was, in the light that it was made for: lasers stay as they are.
    let exposure = Sums::fit_exposure(&refiner.look(&everywhere)?)?;
    refiner.aim(aim)?;
    // Where other sources are lit now, anywhere is in their eyeboxes.
    let (_, anywhere) = judged(anywhere, refiner.problem(), &aim, steering.seed);
    let before = [refiner.look(&at_eye)?, refiner.look(&anywhere)?];
    let mean = |sums: &[Sums]| sums.iter().map(|s| s.psnr(exposure)).sum::<f64>() / sums.len() as f64;
    let mut rows = vec![Row { steps: 0, ms: 0.0, eye: mean(&before[0]), wide: mean(&before[1]) }];
    let mut best = BestState { step: 0, psnr: rows[0].eye, state: phases.to_vec() };
    let mut ms = 0.0;
    let bar = JobBar::new(args.json);
    for steps in 1..=args.steps {
        let start = Instant::now();
        refiner.step()?;
        ms += start.elapsed().as_secs_f64() * 1e3;
        if is_judged(steps, args.steps) || progress::interrupted() {
            let (eye, wide) = (mean(&refiner.look(&at_eye)?), mean(&refiner.look(&anywhere)?));
            rows.push(Row { steps, ms, eye, wide });
            best.offer(steps, eye, || refiner.phases())?;
        }
        let done = format!("{steps} of {} steps for this colour", args.steps);
        if bar.show(&done, steps as f64 / args.steps as f64) == Flow::Stop {
            break;
        }
    }
    bar.finish();
    Ok(RefinedColor { rows, best, engine: described, sources: refiner.sources().to_vec() })
}

/// Says what each step gained, over all colours; `place`: the piece that was refined, and of what.
fn report(
    args: &Refine,
    (all, best): (&[Vec<Row>], &[usize]),
    about: &Hologram,
    engine: &str,
    [key, words]: [&str; 2],
    place: &Value,
) {
    // Colours, side by side: an interruption may have left some with fewer rows.
    let count = all.iter().map(Vec::len).min().unwrap_or(0);
    let f = about.focal_length;
    let focus = args.pupil.before(f).depth;
    let mean = |i: usize, of: &dyn Fn(&Row) -> f64| all.iter().map(|r| of(&r[i])).sum::<f64>() / all.len() as f64;
    let rows: Vec<Row> = (0..count)
        .map(|i| Row {
            steps: all[0][i].steps,
            ms: all.iter().map(|r| r[i].ms).sum(),
            eye: mean(i, &|r| r.eye),
            wide: mean(i, &|r| r.wide),
        })
        .collect();
    if args.json {
        let row = |r: &Row| json!({ "steps": r.steps, "ms": r.ms, "eye_db": r.eye, key: r.wide });
        let mut said = json!({
            "engine": engine, "aim": args.aim(f), "focus_mm": focus * 1e3, "focus_dioptres": dioptres(focus, f),
            "steering": args.steering.steering(), "rows": rows.iter().map(row).collect::<Vec<_>>(),
            "best_steps": best,
            "out": args.out.as_ref().map(|out| out.display().to_string()),
        });
        if !place.is_null() {
            said["piece"] = place["piece"].clone();
            said["unfinished"] = place["unfinished"].clone();
            said["peak_memory_mib"] = json!(common::peak_memory_mib());
        }
        println!("{said}");
        return;
    }
    println!("{engine}; {} sub-frames, {} colours; focused at {}", about.frames, all.len(), depth_in_words(focus, f));
    if let (Some(first), Some(size)) = (place["piece"]["first"].as_array(), place["piece"]["size"].as_array()) {
        println!("the piece of {}x{} pixels from row {}, column {}", size[0], size[1], first[0], first[1]);
    }
    println!("  steps        ms    at the eye dB   {words}");
    for row in &rows {
        println!("  {:5} {:9.1}   {:14.2}   {:width$.2}", row.steps, row.ms, row.eye, row.wide, width = words.len());
    }
    if let Some(out) = &args.out {
        let steps: Vec<String> = best.iter().map(usize::to_string).collect();
        println!("wrote {}: the best state, after {} steps", out.display(), steps.join(", "));
    }
}

/// Pupils of other seeds than the refinement's: around the eye, and anywhere that the problem's light goes.
fn judged(anywhere: PupilRange, problem: &Problem, aim: &PupilDistribution, seed: u64) -> (Vec<Pupil>, Vec<Pupil>) {
    let center = problem.optics.center();
    let sampler = Sampler::new(anywhere, Sequence::Sobol, !seed ^ 0x616e_7977);
    let mut sampler = sampler.over(Arc::clone(&problem.regions));
    let moved = |p: Pupil| Pupil { x: p.x + center[0], y: p.y + center[1], ..p };
    let anywhere = (0..JUDGED_PUPILS).map(|_| moved(sampler.draw())).collect();
    (pupils_of(aim, JUDGED_PUPILS, !seed), anywhere)
}
