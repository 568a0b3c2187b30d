//! `eyebox eval compare` compares methods over every group of pupils, and writes a report.

pub mod args;

pub use args::Compare;

use crate::experiment::{Table, TableOf};
use crate::jod::ViewingArgs;
use crate::talk::print_report;
use args::CompareSettings;

use crate::Failure;
use crate::common;
use crate::eval::score::decibels as db;
use crate::progress::{self, JobBar};
use crate::quality::Chosen;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::evaluate::Group;
use eyebox::low_level::files::ManagedDir;
use eyebox::low_level::optics::{Color, Display, Geometry};
use eyebox::low_level::reason;
use eyebox::low_level::reconstruction::drawer_for;
use eyebox::low_level::scene;
use eyebox::low_level::solve::{Method, Settings};
use eyebox_lab::comparison::{Comparison, ExistingHologram, JUDGED, MaskKind, Published, Results, candidates};
use eyebox_lab::report;
use eyebox_lab::writable;
use std::path::{Path, PathBuf};

/// The methods that are compared by default.
const DEFAULT: [Method; 5] = [Method::Slfh, Method::Lf2fs, Method::Stft, Method::Smooth, Method::Dpac];
/// The default methods behind a mask. Only methods that compute images through pupils model a mask.
const MASKED: [Method; 3] = [Method::Slfh, Method::Lf2fs, Method::Smooth];

/// Solves with each method, measures, and writes the report.
pub fn run(args: &Compare) -> Result<(), Failure> {
    let tables: [TableOf; 2] = [("compare", CompareSettings::table), ("viewing", ViewingArgs::table)];
    if args.experiment.printed_tables(&tables)? {
        return Ok(());
    }
    let settings: CompareSettings = args.experiment.table("compare")?;
    let mut own = ManagedDir::open(&args.out, &report::COMPARISON, args.overwrite.overwrite)?;
    let mut job = job(args, &settings)?;
    let maps = scene::depth_maps(&args.scenes, &args.options.depth_map)?;
    let published = settings.reference.as_deref().map(Published::read).transpose()?.unwrap_or_default();
    let mut engine = common::engine(&args.engine)?;
    let chosen = with_quality(&mut job, args, engine.as_ref())?;
    for scene in &args.scenes {
        scene::native_size(scene)?;
    }
    let _made = writable(&args.out)?;
    if !args.json {
        eprintln!("engine: {}", engine.describe());
        chosen.iter().for_each(|about| eprintln!("{about}"));
    }
    let drawers: Vec<_> = args.scenes.iter().map(|scene| drawer_for(scene, engine.as_ref())).collect();
    let mut load = |index: usize| -> Result<_, Failure> {
        let scene = args.scene(index, maps.get(index));
        let field = common::scene_by(&scene, &job.display, &job.colors, drawers[index].as_ref())?;
        let depth = common::depths(&scene, &field, &job.display)?;
        Ok((field, depth))
    };
    let mut results = compare(&job, &args.out, &mut load, engine.as_mut(), args.json)?;
    results.published = published;
    report::write_comparison(&results, &mut own)?;
    if args.json {
        print_report(report::comparison_json(&results));
        return Ok(());
    }
    print_table(&results);
    let page = args.out.join("report.html");
    let done = results.runs.len() + results.speckle.len();
    if results.missing > 0 {
        println!(
            "stopped: {done} of {} results are kept, and shown in {}; the same command continues from there",
            done + results.missing,
            page.display()
        );
    } else {
        println!("the report: {}", page.display());
    }
    Ok(())
}

/// A function that loads a scene by its number, with its depths.
type Load<'a> = dyn FnMut(usize) -> Result<(scene::LightField, [f64; 2]), Failure> + 'a;

/// Compares until ctrl-C, with a progress bar unless `quiet` is set.
pub fn compare(
    job: &Comparison,
    folder: &Path,
    load: &mut Load,
    engine: &mut dyn Engine,
    quiet: bool,
) -> Result<Results, Failure> {
    progress::catch_interrupt();
    let bar = JobBar::new(quiet);
    let results = job.run(folder, load, engine, &mut |what, share| bar.show(what, share))?;
    bar.finish();
    Ok(results)
}

/// Sets steps, pupils, their diameters, window and optimizer by the requested quality or deadline. Returns a note about
/// them.
fn with_quality(job: &mut Comparison, args: &Compare, engine: &dyn Engine) -> Result<Option<String>, Failure> {
    let frames = job.frames.last().copied().unwrap_or(job.settings.frames);
    let size = job.display.picture_size().into();
    let Some(Chosen { settings, about }) = args.quality.choose(engine, size, frames, job.colors.len())? else {
        return Ok(None);
    };
    let settings = job.settings.with_quality_of(&settings);
    job.settings = Settings {
        steps: args.steps.unwrap_or(settings.steps),
        pupils: args.pupils.unwrap_or(settings.pupils),
        // Methods are compared on the whole problem.
        repeats: 1,
        views: 1,
        pixel: 1,
        padding: job.settings.padding,
        levels: job.settings.levels.clone(),
        ..settings
    };
    Ok(Some(about))
}

fn print_table(results: &Results) {
    println!("PSNR over random pupils, dB:      mean  median   worst  spread     JOD   worst");
    results.joint.iter().for_each(|j| {
        let (name, mean, worst) =
            (format!("{}, {} sub-frames, {}", j.scene, j.frames, j.way), db(j.mean_db), db(j.worst_db));
        println!("  {name:72} {mean:>6}{worst:>8}  {:.2} times as bright", j.brightness);
    });
    results.sources.iter().for_each(|s| {
        let name =
            format!("{}, sources {}, the eye at ({:.1}, {:.1}) mm", s.scene, s.way, s.place_mm[0], s.place_mm[1]);
        println!("  {name:72} {:>6}{:>8}", db(s.mean_db), db(s.worst_db));
    });
    results.coherence.iter().for_each(|c| {
        let name = format!("{}, {} sub-frames, a source of {} mm ({} modes)", c.scene, c.frames, c.image_mm, c.modes);
        let ([nyquist, half], contrast, depth) = (c.modulation, c.contrast, c.depth_of_field_mm);
        let (mean, worst) = (db(c.mean_db), db(c.worst_db));
        print!("  {name:60} {mean:>6}{worst:>8}  speckle {contrast:.2}, modulation {nyquist:.2} {half:.2}, ");
        println!("depth of field {depth:.1} mm; pupils need {} to {} modes", c.pupil_modes[1], c.pupil_modes[0]);
    });
    results.etendue.iter().for_each(|e| {
        let name = format!("{}, {} sub-frames, {}, an eyebox of {:.1} mm", e.scene, e.frames, e.mask, e.eyebox_mm);
        let (mean, worst, etendue) = (db(e.mean_db), db(e.worst_db), e.etendue_mm2_sr);
        println!("  {name:72} {mean:>6}{worst:>8}  speckle {:.2}, {etendue:.3} mm2 sr", e.contrast);
    });
    for series in results.series() {
        if let Some(s) = results.psnr(&series, None, Group::Random) {
            let name = results.label(&series);
            let jod = results.jod(&series, None, Group::Random);
            let jod = jod.map_or("       -       -".into(), |jod| format!("{:8.2}{:8.2}", jod.mean, jod.worst));
            println!("  {name:28} {:8.2}{:8.2}{:8.2}{:8.2}{jod}", s.mean, s.median, s.worst, s.sd);
        }
    }
}

/// Returns the comparison of these arguments. Nothing is computed or written yet.
fn job(args: &Compare, compared: &CompareSettings) -> Result<Comparison, Failure> {
    if args.frames.is_empty() || args.frames.iter().any(|f| !(1..=4096).contains(f)) {
        return Err(Failure::Arguments(reason!("frames", "--frames: the numbers of sub-frames must be 1 to 4096")));
    }
    let defaults = Settings::default();
    let (steps, pupils) = (args.steps.unwrap_or(defaults.steps), args.pupils.unwrap_or(defaults.pupils));
    if !(1..=1_000_000).contains(&steps) {
        return Err(Failure::Arguments(reason!("steps", "--steps {steps}: it must be 1 to 1000000")));
    }
    let mut methods = match &args.methods {
        Some(names) => methods(names)?,
        None if args.hologram.is_empty() && !compares_light(args, compared) => DEFAULT.to_vec(),
        None => Vec::new(),
    };
    let opening = args.unit.chosen(&args.display)?;
    let read = |(name, file): &(String, PathBuf)| -> Result<ExistingHologram, Failure> {
        let mut hologram = opening.hologram(file)?;
        args.eye.replace(&mut hologram.metadata.prescription)?;
        Ok(ExistingHologram::new(name, file.clone(), hologram, &args.scenes, args.display.force)?)
    };
    let given: Vec<ExistingHologram> = args.hologram.iter().map(read).collect::<Result<_, _>>()?;
    let (mut display, colors) = optics(args, methods.is_empty().then_some(()).and(given.first()))?;
    args.eye.replace(&mut display.prescription)?;
    display.viewing = args.experiment.table::<ViewingArgs>("viewing")?.over(display.viewing)?;
    if args.ideal {
        display.model.clear();
        display.mask = None;
        display.picture = Default::default();
    }
    for hologram in &given {
        hologram.check(&display, &colors)?;
    }
    if args.methods.is_none() && display.mask.is_some() {
        methods.retain(|method| MASKED.contains(method));
    }
    let mut frames = args.frames.clone();
    frames.sort_unstable();
    frames.dedup();
    if let Some((_, scene)) = args.scenes.iter().enumerate().find(|(i, s)| args.scenes[..*i].contains(s)) {
        return Err(Failure::Arguments(reason!("scene-twice", "{scene}: this scene is given twice")));
    }
    if args.display.size.is_none() {
        same_size(&args.scenes)?;
    }
    let candidates = candidates(&methods, given)?;
    let settings = Settings {
        steps,
        pupils,
        diameter: common::diameters(args.pupil_diameter, &display, args.display.force)?,
        seed: args.seed,
        ..defaults
    };
    settings.check()?;
    let (speckle, judged) = (compared.speckle, args.seen.pupils(JUDGED));
    let joint = joint(args, &colors, &frames)?;
    let coherence = coherence(compared, &display)?;
    let (scenes, masks) = (labels(&args.scenes), masks(compared, &display)?);
    let sources = sources(compared, &display)?;
    let comparison = Comparison {
        scenes,
        candidates,
        frames,
        display,
        colors,
        settings,
        speckle,
        joint,
        coherence,
        masks,
        sources,
        judged,
    };
    Ok(comparison)
}

/// Returns whether ways of lighting are compared, with methods or without any.
fn compares_light(args: &Compare, compared: &CompareSettings) -> bool {
    args.joint_color.is_some() || compared.coherence.is_some() || compared.etendue.is_some() || compared.sources
}

/// Returns the masks to compare, which must fit the display.
fn masks(args: &CompareSettings, display: &Display) -> Result<Vec<MaskKind>, Failure> {
    let mut masks = args.etendue.clone().unwrap_or_default();
    for kind in &masks {
        kind.before(display).map_err(|why| Failure::Arguments(reason!("etendue", "compare.etendue, {kind}: {why}")))?;
    }
    masks.sort_unstable();
    masks.dedup();
    Ok(masks)
}

/// Returns whether the display's switchable sources are measured. The display must have some.
fn sources(args: &CompareSettings, display: &Display) -> Result<bool, Failure> {
    if args.sources && display.sources.is_empty() {
        return Err(Failure::Arguments(reason!(
            "no-sources",
            "compare.sources: the display {} has no [[sources]]",
            display.name
        )));
    }
    Ok(args.sources)
}

/// Returns the brightnesses of all colors at once to compare.
fn joint(args: &Compare, colors: &[Color], frames: &[usize]) -> Result<Vec<f64>, Failure> {
    let times = args.joint_color.clone().unwrap_or_default();
    let most = colors.len() as f64;
    if let Some(wrong) = times.iter().find(|times| !(1.0..=most).contains(*times)) {
        return Err(Failure::Arguments(reason!(
            "joint-color",
            "--joint-color {wrong}: it must be 1 to {most}, the number of colors"
        )));
    }
    if !times.is_empty() && frames.iter().all(|f| *f < colors.len()) {
        return Err(Failure::Arguments(reason!(
            "joint-color-frames",
            "--joint-color: --frames must have {most} or more, one for each color"
        )));
    }
    Ok(times)
}

/// Returns the sizes of sources to compare, mm.
fn coherence(args: &CompareSettings, display: &Display) -> Result<Vec<f64>, Failure> {
    let mut sizes = args.coherence.clone().unwrap_or_default();
    let most = display.eyebox_min() * 0.5e3;
    if let Some(wrong) = sizes.iter().find(|mm| !(0.0..=most).contains(*mm)) {
        return Err(Failure::Arguments(reason!(
            "coherence",
            "compare.coherence {wrong}: it must be 0 to {most:.1} mm, half of the eyebox"
        )));
    }
    if !sizes.is_empty() && display.geometry == Geometry::FarField {
        return Err(Failure::Arguments(reason!(
            "coherence-far-field",
            "compare.coherence: a source is for an SLM behind a relay"
        )));
    }
    sizes.sort_by(f64::total_cmp);
    sizes.dedup();
    Ok(sizes)
}

/// Returns the methods of these names, each once.
fn methods(names: &[String]) -> Result<Vec<Method>, Failure> {
    let mut methods = Vec::new();
    for name in names {
        let known = || Method::ALL.map(Method::name).join(", ");
        let method = Method::by_name(name.trim()).ok_or_else(|| {
            Failure::Arguments(reason!("no-such-method", "no method '{name}': expected some of {}", known()))
        })?;
        if !methods.contains(&method) {
            methods.push(method);
        }
    }
    Ok(methods)
}

/// Returns the requested display, or the display of the first hologram if nothing is solved.
fn optics(args: &Compare, given: Option<&ExistingHologram>) -> Result<(Display, Vec<Color>), Failure> {
    match given {
        Some(given) if args.display.size.is_none() => Ok((given.hologram.made_for()?, given.hologram.named_colors())),
        _ => {
            let display = common::display(&args.display)?;
            let colors = common::colors(&args.display, &display)?;
            Ok((display, colors))
        }
    }
}

/// Refuses pictures of different sizes, if no size is given that they are all fitted to.
fn same_size(sources: &[String]) -> Result<(), Failure> {
    let mut first: Option<(&str, [usize; 2])> = None;
    for source in sources {
        let Some(size) = scene::native_size(source)? else { continue };
        match first {
            Some((other, before)) if before != size => {
                return Err(Failure::Arguments(reason!(
                    "sizes",
                    "{source}: {} x {} pixels, but {other} has {} x {}. Give the common size with --size",
                    size[0],
                    size[1],
                    before[0],
                    before[1]
                )));
            }
            _ => first = first.or(Some((source, size))),
        }
    }
    Ok(())
}

/// Returns short names of scenes, or whole ones if the short ones are not unique.
fn labels(sources: &[String]) -> Vec<String> {
    let short = |source: &String| {
        let plain = source.strip_prefix("builtin:").unwrap_or(source);
        let whole = Path::new(plain).canonicalize().unwrap_or_else(|_| plain.into());
        match source.starts_with("builtin:") {
            true => plain.to_string(),
            false => whole.file_name().map_or(plain.to_string(), |n| n.to_string_lossy().into_owned()),
        }
    };
    let all: Vec<String> = sources.iter().map(short).collect();
    let unique = |i: usize| all.iter().filter(|l| **l == all[i]).count() == 1;
    (0..all.len()).map(|i| if unique(i) { all[i].clone() } else { sources[i].clone() }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_of_one_name_are_told_apart() {
        let of = |s: &[&str]| labels(&s.iter().map(|s| s.to_string()).collect::<Vec<_>>());
        assert_eq!(of(&["builtin:plane?depth=2", "a/views"]), ["plane?depth=2", "views"]);
        assert_eq!(of(&["a/views", "b/views"]), ["a/views", "b/views"]);
    }
}
