//! Prints `eyebox info` of a scene.

use super::args::Info;
use crate::Failure;
use crate::args::SceneArgs;
use crate::common::{self, Form};
use crate::failure::in_options;
use crate::talk::print_report;
use eyebox::low_level::evaluate::Plane;
use eyebox::low_level::reason;
use eyebox::low_level::scene::{self, Inspection};

/// Largest side of the contact sheet, pixels.
const SHEET: usize = 1600;

/// Prints the contents of a scene as it is read.
pub fn run(args: &Info) -> Result<(), Failure> {
    if let Some(out) = &args.out {
        common::form(out, &[Form::Png])?;
    }
    let display = common::display(&args.display)?;
    let colors = common::colors(&args.display, &display)?;
    let (mut found, field) = common::inspect(&SceneArgs::new(&args.what, &args.options), &display, &colors)?;
    found.doubt = found.doubt.map(|line| in_options(&line));
    if args.json {
        let report = serde_json::to_value(&found).map_err(|e| Failure::Arguments(reason!("json", "no JSON: {e}")))?;
        print_report(report);
    } else {
        say(&found);
    }
    if let Some(out) = &args.out {
        let ([rows, columns], sheets) = scene::contact_sheet(&field, SHEET);
        let planes: Vec<Plane> = sheets.into_iter().map(|values| Plane { rows, columns, values }).collect();
        let names: Vec<_> = colors.iter().map(|c| Some(*c)).collect();
        common::write_image(out, Form::Png, &planes, &names, &vec![1.0; planes.len()])?;
        eprintln!("wrote {}: all views as they are read", out.display());
    }
    Ok(())
}

fn say(found: &Inspection) {
    let line = |what: &str, value: String| println!("  {what:11} {value}");
    println!("{}", found.name);
    let [rows, columns] = found.grid;
    line("grid", format!("{rows} x {columns} views: {}", found.found_by));
    let [high, wide] = found.size;
    let own = found.own_size.map_or(String::new(), |[h, w]| format!(", their own {h} x {w}"));
    line("pixels", format!("{high} x {wide} on the display{own}; {}", found.transfer));
    if let Some(meaning) = &found.depth_map {
        line("depth map", meaning.clone());
    }
    let says = match found.order_confirmed {
        Some(true) => "; the pictures do not contradict it",
        Some(false) => "; the pictures contradict it",
        None => "; the pictures do not tell",
    };
    line("order", format!("{}{says}", found.order));
    for (movement, what) in found.parallax_px.iter().zip(["columns", "rows"]) {
        if let Some([low, high]) = movement {
            line("parallax", format!("{low:+.2} to {high:+.2} pixels from view to view along {what}"));
        }
    }
    let [low, high] = found.disparity_px;
    line("disparity", format!("{low:+.2} to {high:+.2} pixels between neighboring views, near positive"));
    let [far, near] = found.depth_mm;
    let [far_dioptres, near_dioptres] = found.depth_dioptres;
    let source = if found.depth_is_stated { "stated" } else { "measured" };
    line("depth", format!("{far:.2} to {near:.2} mm, {far_dioptres:.3} to {near_dioptres:.3} D; {source}"));
    let aliasing = if found.aliasing_px > 1.0 {
        format!(": wide pupils see ghosts out of focus; {0} x {0} views would not", found.views_without_aliasing)
    } else {
        ": no ghosts".into()
    };
    line(
        "aliasing",
        format!(
            "{:.2} pixels between near and far, {:.2} mm from view to view{aliasing}",
            found.aliasing_px, found.view_pitch_mm
        ),
    );
    for light in &found.exposure {
        let [black, clipped] = [light.black, light.clipped].map(|share| 100.0 * share);
        let [mean, brightest] = [light.mean, light.brightest];
        line(
            &light.color.to_string(),
            format!("mean {mean:.3}, brightest {brightest:.3}, {black:.1} % black, {clipped:.1} % clipped"),
        );
    }
    if let Some(doubt) = &found.doubt {
        line("refused", doubt.clone());
    }
}
