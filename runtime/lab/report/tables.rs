//! Writes the numbers of a comparison as CSV and JSON.

use crate::comparison::{
    CoherenceFigures, EtendueFigures, JointFigures, Results, SceneFigures, Series, SourcesFigures,
};
use eyebox::low_level::evaluate::{Group, Summary};
use serde_json::{Map, Value, json};

/// Returns a CSV file of these lines.
pub fn csv(head: &[&str], lines: impl IntoIterator<Item = Vec<String>>) -> Vec<u8> {
    let mut out = csv::Writer::from_writer(Vec::new());
    out.write_record(head).expect("a vector takes everything");
    lines.into_iter().for_each(|l| out.write_record(l).expect("a vector takes everything"));
    out.into_inner().expect("a vector takes everything")
}

/// Returns all scores, with one line per method, scene, color and pupil.
pub fn scores(results: &Results) -> Vec<u8> {
    let head = "method,frames,scene,color,group,pupil,x_mm,y_mm,diameter_mm,focus_mm,psnr_db,ssim,focus_dioptres,ceiling_db,jod";
    let rows = results.runs.iter().flat_map(|run| run.rows.iter().map(move |row| (run, row)));
    let lines = rows.map(|(run, row)| {
        let mut line = vec![
            run.method.clone(),
            run.frames.to_string(),
            run.scene.clone(),
            row.color.to_string(),
            row.group.name().into(),
            row.index.to_string(),
        ];
        line.extend(row.pupil_mm.map(|v| format!("{v:.6}")));
        line.push(row.psnr.map_or(String::new(), |db| format!("{db:.4}")));
        line.push(row.ssim.map_or(String::new(), |s| format!("{s:.6}")));
        line.push(format!("{:.6}", row.focus_dioptres));
        line.push(row.ceiling.map_or(String::new(), |db| format!("{db:.4}")));
        line.push(row.jod.map_or(String::new(), |jod| format!("{jod:.4}")));
        line
    });
    csv(&head.split(',').collect::<Vec<_>>(), lines)
}

/// Returns all summaries by method, sub-frames, group, and scene or all scenes together.
pub fn summary(results: &Results) -> Vec<u8> {
    let statistics = ["mean", "median", "q25", "q75", "worst", "best", "sd"];
    let mut head: Vec<String> = ["method", "frames", "scene", "group", "n"].map(String::from).to_vec();
    head.extend(["psnr", "ssim", "jod"].iter().flat_map(|what| statistics.map(|s| format!("{what}_{s}"))));
    let of = |s: Option<Summary>, digits: usize| {
        let all = s.map(|s| [s.mean, s.median, s.q25, s.q75, s.worst, s.best, s.sd]);
        (0..7).map(move |i| all.map_or(String::new(), |a| format!("{:.digits$}", a[i])))
    };
    let mut lines = Vec::new();
    for series in results.series() {
        let names = results.scenes.iter().map(|s| &s.name[..]);
        for (scene, group) in names.map(Some).chain([None]).flat_map(|s| Group::ALL.map(|g| (s, g))) {
            let n = results.rows(&series, scene, group).count();
            if n == 0 {
                continue;
            }
            let mut line = vec![
                series.method.clone(),
                series.frames.to_string(),
                scene.unwrap_or("all scenes").into(),
                group.name().into(),
                n.to_string(),
            ];
            line.extend(of(results.psnr(&series, scene, group), 4));
            line.extend(of(results.ssim(&series, scene, group), 6));
            line.extend(of(results.jod(&series, scene, group), 4));
            lines.push(line);
        }
    }
    csv(&head.iter().map(|h| &h[..]).collect::<Vec<_>>(), lines)
}

/// Formats a number of a table. The cell is empty without a number.
fn cell(value: Option<f64>) -> String {
    value.map_or(String::new(), |v| format!("{v:.4}"))
}

/// Returns one way of lighting as JSON, without its picture.
fn joint(figures: &JointFigures) -> Value {
    let JointFigures { scene, frames, way, brightness, mean_db, worst_db, colors_db, powers, .. } = figures;
    json!({
        "scene": scene, "frames": frames, "way": way, "brightness": brightness, "mean_db": mean_db, "worst_db": worst_db,
        "colors_db": colors_db, "powers": powers,
    })
}

/// Returns simultaneous color against one color after another, with one line per scene, number of sub-frames and way of
/// lighting.
pub fn joint_table(results: &Results) -> Vec<u8> {
    let lines = results.joint.iter().map(|j| {
        let numbers = [Some(j.brightness), j.mean_db, j.worst_db].map(cell);
        [vec![j.scene.clone(), j.frames.to_string(), j.way.clone()], numbers.to_vec()].concat()
    });
    csv(&["scene", "frames", "way", "brightness", "psnr_mean_db", "psnr_worst_db"], lines)
}

/// Returns one source as JSON, without its picture.
fn coherence(figures: &CoherenceFigures) -> Value {
    json!(CoherenceFigures { picture: None, ..figures.clone() })
}

/// Returns quality against coherence, with one line per scene, number of sub-frames and size of the source.
pub fn coherence_table(results: &Results) -> Vec<u8> {
    let lines = results.coherence.iter().map(|c| {
        let [nyquist, half] = c.modulation;
        let others = [c.contrast, nyquist, half, c.depth_of_field_mm].map(Some);
        let numbers = [c.mean_db, c.worst_db].into_iter().chain(others).map(cell);
        let counts = [c.modes, c.pupil_modes[0], c.pupil_modes[1], c.judged_modes].map(|n| n.to_string());
        let about = [c.scene.clone(), c.frames.to_string(), c.image_mm.to_string()].into_iter().chain(counts);
        about.chain(numbers).collect::<Vec<_>>()
    });
    let modes = ["modes", "modes_narrowest", "modes_widest", "modes_judging"];
    let measured = ["psnr_mean_db", "psnr_worst_db", "speckle_contrast", "modulation_nyquist", "modulation_half"];
    csv(&[&["scene", "frames", "source_mm"][..], &modes, &measured, &["depth_of_field_mm"]].concat(), lines)
}

/// Returns one mask as JSON, without its picture.
fn etendue(figures: &EtendueFigures) -> Value {
    json!(EtendueFigures { picture: None, ..figures.clone() })
}

/// Returns quality against masks, with one line per scene, number of sub-frames and mask.
pub fn etendue_table(results: &Results) -> Vec<u8> {
    let lines = results.etendue.iter().map(|e| {
        let numbers = [Some(e.eyebox_mm), Some(e.etendue_mm2_sr), e.mean_db, e.worst_db, Some(e.contrast)].map(cell);
        let about = [e.scene.clone(), e.frames.to_string(), e.mask.clone(), e.factor.to_string()];
        about.into_iter().chain(numbers).collect::<Vec<_>>()
    });
    let about = ["scene", "frames", "mask", "factor"];
    let measured = ["eyebox_mm", "etendue_mm2_sr", "psnr_mean_db", "psnr_worst_db", "speckle_contrast"];
    csv(&[&about[..], &measured].concat(), lines)
}

/// Returns one position across the eyebox of switchable sources as JSON, without its picture.
fn source(figures: &SourcesFigures) -> Value {
    let SourcesFigures { scene, frames, way, place_mm, lit, mean_db, worst_db, .. } = figures;
    json!({
        "scene": scene, "frames": frames, "way": way, "place_mm": place_mm, "lit": lit, "mean_db": mean_db, "worst_db": worst_db,
    })
}

/// Returns all numbers as JSON, without pictures.
pub fn json(results: &Results) -> Value {
    let groups = |method: &str, frames: usize, scene: Option<&str>| -> Value {
        let series = Series { method: method.into(), frames };
        let of = |&g: &Group| {
            let psnr = results.psnr(&series, scene, g)?;
            let [ssim, jod] = [results.ssim(&series, scene, g), results.jod(&series, scene, g)];
            Some((g.name().to_lowercase().replace(' ', "_"), json!({ "psnr_db": psnr, "ssim": ssim, "jod": jod })))
        };
        Group::ALL.iter().filter_map(of).collect::<Map<_, _>>().into()
    };
    let runs = results.runs.iter().map(|r| {
        json!({
            "method": r.method, "frames": r.frames, "scene": r.scene, "seconds": r.seconds, "colors": r.colors,
            "color_error": r.color_error, "groups": groups(&r.method, r.frames, Some(&r.scene)), "scores": r.rows,
        })
    });
    let of_series =
        |s: &Series| json!({ "method": s.method, "frames": s.frames, "groups": groups(&s.method, s.frames, None) });
    let scene = |s: &SceneFigures| {
        json!({
            "name": s.name, "views": s.views, "depth_mm": s.depth_mm, "depth_dioptres": s.depth_dioptres,
            "epipolar_row": s.row,
        })
    };
    let scenes = results.scenes.iter().map(scene);
    json!({
        "about": results.about, "missing": results.missing, "methods": results.methods,
        "scenes": scenes.collect::<Vec<_>>(), "over_scenes": results.series().iter().map(of_series).collect::<Vec<_>>(),
        "runs": runs.collect::<Vec<_>>(), "speckle": results.speckle,
        "published": results.published, "joint": results.joint.iter().map(joint).collect::<Vec<_>>(),
        "coherence": results.coherence.iter().map(coherence).collect::<Vec<_>>(),
        "etendue": results.etendue.iter().map(etendue).collect::<Vec<_>>(),
        "sources": results.sources.iter().map(source).collect::<Vec<_>>(),
    })
}
