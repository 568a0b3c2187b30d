//! `eyebox display calibrate` fits a model of the real display from pictures of it.

use super::patterns::{self, PatternArgs};
use crate::Failure;
use crate::common;
use crate::experiment::{ExperimentArgs, Table};
use crate::groups::{CameraSettings, Colors};
use crate::progress::{self, JobBar};
use crate::talk::print_report;
use crate::values::celsius;
use clap::Args;
use eyebox::low_level::calibrate::{Bench, CameraCommand, Event, FEWEST, ModelAge, Report, TAKING, Verdict, calibrate};
use eyebox::low_level::engine;
use eyebox::low_level::error::Reason;
use eyebox::low_level::files;
use eyebox::low_level::optics::{Color, Display, PictureWarp};
use eyebox::low_level::reason;
use std::path::PathBuf;
use std::time::Duration;

/// The arguments of `eyebox display calibrate`.
#[derive(Args)]
pub struct Calibrate {
    /// Display preset (eyebox display list) or TOML file. The fit begins with its model
    #[arg(value_name = "PRESET|FILE")]
    pub display: String,
    /// Color whose light is on [default: green, or the display's first]
    #[arg(help_heading = "Display", long, value_enum, value_name = "COLOR", hide_possible_values = true)]
    pub color: Option<Colors>,
    /// Command of a camera that shows patterns and takes pictures (docs/calibrate.md)
    #[arg(
        help_heading = "Camera",
        long,
        value_name = "COMMAND",
        required_unless_present = "captures",
        conflicts_with = "captures"
    )]
    pub camera: Option<String>,
    /// Folder of pictures instead of a camera
    #[arg(help_heading = "Camera", long, value_name = "DIR")]
    pub captures: Option<PathBuf>,
    #[command(flatten)]
    pub patterns: PatternArgs,
    /// Keep the pictures in this folder. A calibration that was interrupted does not take them again
    #[arg(help_heading = "Camera", long, value_name = "OUT_DIR", conflicts_with = "captures")]
    pub keep: Option<PathBuf>,
    /// Take four pictures for the parameters that drift. The display's file has the others
    #[arg(help_heading = "Camera", long, conflicts_with = "captures")]
    pub quick: bool,
    /// Also write the map from the camera to the picture of this color, so that the picture is shown undistorted and
    /// colors coincide. The camera must not move between colors. With straight, the camera looks straight at the
    /// display, and keystone and rotation belong to the display
    #[arg(help_heading = "Camera", long, value_name = "straight", num_args = 0..=1, require_equals = true, default_missing_value = "", value_parser = ["", "straight"], hide_possible_values = true)]
    pub register: Option<String>,
    /// Output file of the display with its model
    #[arg(help_heading = "Output", short, long, value_name = "OUT.toml")]
    pub out: PathBuf,
    /// Page with the measured, predicted and remaining pictures
    #[arg(help_heading = "Output", long, value_name = "OUT.html")]
    pub report: Option<PathBuf>,
    #[command(flatten)]
    pub experiment: ExperimentArgs,
    /// Temperature of the bench in degrees Celsius, kept with the model
    #[arg(help_heading = "Camera", long, value_name = "CELSIUS", value_parser = celsius)]
    pub temperature: Option<f64>,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// Calibrates, writes the display's file, and prints the parameters with their errors.
pub fn run(args: &Calibrate) -> Result<(), Failure> {
    if args.experiment.printed_tables(&[("camera", CameraSettings::table)])? {
        return Ok(());
    }
    let camera_settings: CameraSettings = args.experiment.table("camera")?;
    common::check_output(&args.out, "toml")?;
    if let Some(page) = &args.report {
        common::check_output(page, "html")?;
    }
    let display = Display::load(&args.display)?;
    let green = display.wavelengths.iter().find(|w| w.color == Color::Green).or(display.wavelengths.first());
    if args.color == Some(Colors::All) {
        return Err(Failure::Arguments(reason!("one-color", "--color all: calibrate one color after the other")));
    }
    let named = args.color.and_then(Colors::one);
    let color = named.or(green.map(|w| w.color)).unwrap_or(Color::Green);
    let age = ModelAge::of(&display, color);
    if let Some(age) = &age {
        eprintln!("the {color} model of {}: {age}", args.display);
    }
    let bench = match (&args.camera, &args.captures) {
        (Some(command), _) => {
            let limit = camera_settings.timeout.map(Duration::from_secs_f64);
            let camera = CameraCommand { command, keep: args.keep.as_deref(), limit, iris_mm: camera_settings.iris };
            Bench::Command { camera, most: camera_settings.pictures, quick: args.quick }
        }
        (None, Some(folder)) => Bench::Folder { folder, iris_mm: camera_settings.iris },
        (None, None) => return Err(Failure::Arguments(reason!("no-camera", "--camera or --captures is needed"))),
    };
    if camera_settings.pictures < FEWEST {
        return Err(Failure::Arguments(reason!(
            "captures-max",
            "camera.pictures = {} is too few. Give {FEWEST} or more",
            camera_settings.pictures
        )));
    }
    if args.camera.is_some() {
        progress::catch_interrupt();
    }
    let mut output = args.patterns.open(camera_settings.settle, &display, &[color])?;
    let shows = patterns::shows(&mut output);
    let bar = JobBar::new(args.json);
    let calibrated = calibrate(&display, color, &bench, shows, &mut |event| match event {
        Event::At(what, share) => {
            if share >= TAKING {
                // The pictures are kept, so a fit may end at once.
                progress::let_interrupt();
            }
            let _ = bar.show(what, share);
        }
        Event::Said(line) => eprintln!("{line}"),
        _ => {}
    });
    bar.finish();
    let mut calibrated = calibrated.inspect_err(|e| {
        if let (true, Some(keep)) = (e.is_ended(), &args.keep) {
            eprintln!("the pictures so far are in {}. The same command continues from them", keep.display());
        }
    })?;
    let mut engine = engine::open(engine::Choice::Cpu)?;
    calibrated.measure_gain(&display, color, engine.as_mut())?;
    let mut fitted = calibrated.display.clone();
    if let Some(how) = &args.register {
        fitted.picture.straight = how == "straight";
        fitted.picture.set(color, PictureWarp::by_camera(calibrated.report.camera_map));
        fitted.picture.check(fitted.picture_size().into()).map_err(Failure::Arguments)?;
        let off = fitted.picture.farthest(color, fitted.picture_size().into());
        eprintln!("the {color} picture is seen up to {off:.2} pixels off its place, which is corrected from now on");
    }
    let own = fitted.model.get_mut(&color.into()).filter(|_| calibrated.report.calibrated);
    if let (Some(terms), Some(celsius)) = (own, args.temperature) {
        terms.temperature_c = Some(celsius);
    }
    let text = fitted.to_toml();
    files::write_file(&args.out, |to| to.write_all(text.as_bytes()))?;
    if let Some(page) = &args.report {
        let html = eyebox_lab::report::calibration_page(&calibrated, color);
        files::write_file(page, |to| to.write_all(html.as_bytes()))?;
    }
    if args.json {
        let mut report =
            serde_json::to_value(&calibrated.report).map_err(|e| Failure::Arguments(Reason::new("json", e)))?;
        report["model_before"] = serde_json::to_value(&age).map_err(|e| Failure::Arguments(Reason::new("json", e)))?;
        print_report(report);
    } else {
        say(&calibrated.report);
    }
    for warning in &calibrated.report.warnings {
        eprintln!("eyebox: {warning}");
    }
    let out = args.out.display();
    match calibrated.report.verdict {
        Verdict::Calibrated => eprintln!("calibrated; wrote {out}: give it as --display {out}"),
        Verdict::WithFaults => {
            eprintln!("calibrated, with faults that the model lacks; wrote {out}: give it as --display {out}");
        }
        _ => eprintln!("not calibrated; wrote {out} with the model that the display's file had"),
    }
    // The next quick calibration has another model, and therefore another table.
    if calibrated.report.calibrated && !args.quick {
        // The display is loaded from the file, because a solve reads the file's digits, too.
        common::prepare_first_phases(&Display::load(&args.out.to_string_lossy())?, &[color], args.json)?;
    }
    Ok(())
}

/// Prints the report in words.
fn say(report: &Report) {
    println!("{}", report.directions);
    println!("{:24} {:>12} {:>10}", "", "value", "error");
    for p in &report.parameters {
        let error = p.error.map_or_else(String::new, |e| format!("{e:.5}"));
        println!("{:24} {:12.5} {error:>10} {}", p.name, p.value, p.unit);
    }
    for pair in &report.confused {
        let [a, b] = &pair.names;
        println!("the pictures hardly separate {a} and {b}, whose correlation is {:.3}", pair.correlation);
    }
    println!("{} pictures; the camera's map is off by {:.2} of its pixels", report.captures, report.camera_rms_px);
    if let (Some(before), Some(unexplained), Some(noise)) = (report.before, report.unexplained, report.noise) {
        let percent = |share: f64| format!("{:.3} %", 100.0 * share);
        println!(
            "of pictures that were not fitted, {} of the variance is unexplained (before: {}); the camera's noise is {}",
            percent(unexplained),
            percent(before),
            percent(noise)
        );
    }
    if let Some(gain) = &report.gain {
        let [[before, before_worst], [after, after_worst]] = [gain.before_db, gain.after_db];
        println!(
            "the built-in still life on {} x {} of its pixels, {} steps, seen on the fitted display: {before:.2} dB solved for the \
             display as its file was (worst pupil {before_worst:.2}), {after:.2} for the fitted one ({after_worst:.2})",
            gain.size[0], gain.size[1], gain.steps
        );
        let terms: Vec<String> = gain.terms_db.iter().map(|(term, db)| format!("{term} {db:.2}")).collect();
        if !terms.is_empty() {
            println!("gained by each term of the model, dB: {}", terms.join(", "));
        }
        for mend in &gain.mend {
            println!("fix on the bench: {} costs {:.2} dB: {}", mend.fault, mend.costs_db, mend.remedy);
        }
    }
}
