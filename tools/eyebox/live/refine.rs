//! `eyebox refine`: a hologram refined for where the eye is, and what each step gains.

use super::args::SteeringArgs;
use crate::args::{EngineArgs, SceneArgs};
use crate::common::{self, Form};
use crate::score;
use crate::values::{not_negative, pupil, range};
use crate::view::padding_of;
use crate::{Failure, progress};
use clap::Args;
use eyebox::evaluate::Sums;
use eyebox::optics::Pupil;
use eyebox::solve::{Aim, Problem, PupilRange, Refiner, Sampler, Sequence};
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

/// `eyebox refine`
#[derive(Args)]
pub struct Refine {
    /// NAME.zarr, solved for the whole eyebox
    pub hologram: PathBuf,
    /// Scene
    #[command(flatten)]
    pub scene: SceneArgs,
    /// Where the eye is: x,y,diameter,focus in mm
    #[arg(long, value_name = "X,Y,D,Z", value_parser = pupil, allow_hyphen_values = true)]
    pub pupil: Pupil,
    /// Standard deviation of where it is, mm
    #[arg(long, value_name = "MM", default_value_t = 0.25, value_parser = not_negative)]
    pub spread: f64,
    /// Its diameter, mm [default: half a millimetre about the pupil's]
    #[arg(long, value_name = "MIN..MAX", value_parser = range)]
    pub diameter: Option<[f64; 2]>,
    /// Steps
    #[arg(long, default_value_t = 16, value_name = "N")]
    pub steps: usize,
    /// How the phases follow
    #[command(flatten)]
    pub steering: SteeringArgs,
    /// Where the refined hologram goes: NAME.zarr
    #[arg(short, long, value_name = "FILE")]
    pub out: Option<PathBuf>,
    /// Engine
    #[command(flatten)]
    pub engine: EngineArgs,
    /// One JSON object on standard output
    #[arg(long)]
    pub json: bool,
}

/// Pupils through which the eye's place, and the whole eyebox, are judged.
const JUDGED: usize = 12;

/// What had been reached after some steps.
#[derive(Debug, Clone, Copy, Default, Serialize)]
struct Row {
    steps: usize,
    ms: f64,
    eye_db: f64,
    eyebox_db: f64,
}

/// Refines, and says what came of it.
pub fn run(args: &Refine) -> Result<(), Failure> {
    if let Some(out) = &args.out {
        common::form(out, &[Form::Zarr])?;
    }
    let (mut hologram, display) = score::with_display(&args.hologram)?;
    let colors: Vec<_> = hologram.colors.iter().filter_map(|c| c.color).collect();
    let field = common::scene(&score::as_solved(&args.scene, &hologram), &display, &colors)?;
    let [x, y, diameter, depth] = [args.pupil.x, args.pupil.y, args.pupil.diameter, args.pupil.depth];
    let half = 0.5e-3f64.min(diameter / 2.0);
    let aim = Aim {
        x,
        y,
        spread: args.spread * 1e-3,
        diameter: args.diameter.unwrap_or([diameter - half, diameter + half]),
        depth: [depth; 2],
        elsewhere: 0.0,
    };
    let steering = args.steering.steering();
    let padding = padding_of(&hologram);
    progress::catch_interrupt();
    let mut all: Vec<Vec<Row>> = Vec::new();
    let mut described = String::new();
    for (color, solved) in colors.iter().zip(&mut hologram.colors) {
        let problem = Problem::new(&field, *color, &display, padding)?;
        let engine = common::engine(&args.engine)?;
        described = engine.describe();
        let (at_eye, anywhere) = judged(&problem, &aim, steering.seed);
        let mut refiner = Refiner::new(problem, &solved.phases, solved.exposure, steering, engine)?;
        refiner.aim(aim)?;
        // What is seen is compared at the exposure of the hologram as it was: lasers stay as they are.
        let before = [refiner.look(&at_eye)?, refiner.look(&anywhere)?];
        let exposure = Sums::fit_exposure(&before[1])?;
        let mean = |sums: &[Sums]| sums.iter().map(|s| s.psnr(exposure)).sum::<f64>() / sums.len() as f64;
        let mut rows = vec![Row { steps: 0, ms: 0.0, eye_db: mean(&before[0]), eyebox_db: mean(&before[1]) }];
        let mut ms = 0.0;
        for steps in 1..=args.steps {
            let start = Instant::now();
            refiner.step()?;
            ms += start.elapsed().as_secs_f64() * 1e3;
            if steps.is_power_of_two() || steps == args.steps || progress::interrupted() {
                let (eye_db, eyebox_db) = (mean(&refiner.look(&at_eye)?), mean(&refiner.look(&anywhere)?));
                rows.push(Row { steps, ms, eye_db, eyebox_db });
            }
            if progress::interrupted() {
                break;
            }
        }
        solved.phases = refiner.phases()?;
        all.push(rows);
    }
    // Colours, side by side: an interruption may have left some with fewer rows.
    let count = all.iter().map(Vec::len).min().unwrap_or(0);
    let mean = |i: usize, of: &dyn Fn(&Row) -> f64| all.iter().map(|r| of(&r[i])).sum::<f64>() / all.len() as f64;
    let rows: Vec<Row> = (0..count)
        .map(|i| Row {
            steps: all[0][i].steps,
            ms: all.iter().map(|r| r[i].ms).sum(),
            eye_db: mean(i, &|r| r.eye_db),
            eyebox_db: mean(i, &|r| r.eyebox_db),
        })
        .collect();
    if let Some(out) = &args.out {
        hologram.settings["refined"] = json!({ "aim": aim, "steering": steering, "steps": args.steps });
        hologram.save(out)?;
    }
    if args.json {
        println!("{}", json!({ "engine": described, "aim": aim, "steering": steering, "rows": rows, "out": args.out }));
        return Ok(());
    }
    println!("{described}; {} sub-frames, {} colours", hologram.frames, colors.len());
    println!("  steps        ms    at the eye dB   over the eyebox dB");
    for row in &rows {
        println!("  {:5} {:9.1}   {:14.2}   {:18.2}", row.steps, row.ms, row.eye_db, row.eyebox_db);
    }
    if let Some(out) = &args.out {
        println!("wrote {}", out.display());
    }
    Ok(())
}

/// Pupils of other seeds than the refinement's: around the eye, and over the whole eyebox.
fn judged(problem: &Problem, aim: &Aim, seed: u64) -> (Vec<Pupil>, Vec<Pupil>) {
    let anywhere = PupilRange::over(problem.eyebox, aim.depth);
    let mut sampler = Sampler::new(anywhere, Sequence::Sobol, !seed ^ 0x616e_7977);
    let anywhere = (0..JUDGED).map(|_| sampler.draw()).collect();
    (aim.pupils(JUDGED, !seed), anywhere)
}
