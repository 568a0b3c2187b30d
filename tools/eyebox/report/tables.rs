//! The numbers of a report as CSV and JSON.

use super::Report;
use eyebox::evaluate::{Group, Summary};
use serde_json::{Value, json};

/// Every score: one line per method, scene, colour and pupil.
pub fn scores(report: &Report) -> Vec<u8> {
    let mut out = csv::Writer::from_writer(Vec::new());
    let head = [
        "method",
        "frames",
        "scene",
        "color",
        "group",
        "pupil",
        "x_mm",
        "y_mm",
        "diameter_mm",
        "focus_mm",
        "psnr_db",
        "ssim",
    ];
    let mut lines = vec![head.map(String::from).to_vec()];
    for run in &report.runs {
        for row in &run.rows {
            let mut line = vec![
                run.method.clone(),
                run.frames.to_string(),
                run.scene.clone(),
                row.color.to_string(),
                row.group.name().into(),
                row.index.to_string(),
            ];
            line.extend(row.pupil_mm.map(|v| format!("{v:.6}")));
            line.push(format!("{:.4}", row.psnr));
            line.push(row.ssim.map_or(String::new(), |s| format!("{s:.6}")));
            lines.push(line);
        }
    }
    lines.iter().for_each(|l| out.write_record(l).expect("a vector takes everything"));
    out.into_inner().expect("a vector takes everything")
}

/// Every summary: per method, sub-frames, group, and scene or all scenes together.
pub fn summary(report: &Report) -> Vec<u8> {
    let mut out = csv::Writer::from_writer(Vec::new());
    let statistics = ["mean", "median", "q25", "q75", "worst", "best", "sd"];
    let mut head: Vec<String> = ["method", "frames", "scene", "group", "n"].map(String::from).to_vec();
    head.extend(statistics.map(|s| format!("psnr_{s}")));
    head.extend(statistics.map(|s| format!("ssim_{s}")));
    out.write_record(&head).expect("a vector takes everything");
    let of = |s: Option<Summary>, digits: usize| {
        let all = s.map(|s| [s.mean, s.median, s.q25, s.q75, s.worst, s.best, s.sd]);
        (0..7).map(move |i| all.map_or(String::new(), |a| format!("{:.digits$}", a[i])))
    };
    for series in report.series() {
        let names = report.scene_names();
        for scene in names.iter().copied().map(Some).chain([None]) {
            for group in Group::ALL {
                let n = report.rows(&series, scene, Some(group)).count();
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
                line.extend(of(report.psnr(&series, scene, Some(group)), 4));
                line.extend(of(report.ssim(&series, scene, Some(group)), 6));
                out.write_record(&line).expect("a vector takes everything");
            }
        }
    }
    out.into_inner().expect("a vector takes everything")
}

/// All numbers of the report, without its pictures.
pub fn json(report: &Report) -> Value {
    let summaries = |method: &str, frames: usize, scene: Option<&str>| -> Value {
        let series = super::Series { method: method.into(), frames };
        let groups = Group::ALL.iter().filter_map(|&g| {
            let psnr = report.psnr(&series, scene, Some(g))?;
            Some((g.name().to_string(), json!({ "psnr_db": psnr, "ssim": report.ssim(&series, scene, Some(g)) })))
        });
        groups.collect::<serde_json::Map<_, _>>().into()
    };
    let runs: Vec<Value> = report
        .runs
        .iter()
        .map(|r| {
            json!({
                "method": r.method, "frames": r.frames, "scene": r.scene, "seconds": r.seconds, "colors": r.colors,
                "color_error": r.color_error, "groups": summaries(&r.method, r.frames, Some(&r.scene)),
                "scores": r.rows,
            })
        })
        .collect();
    let over_scenes: Vec<Value> = report
        .series()
        .iter()
        .map(|s| json!({ "method": s.method, "frames": s.frames, "groups": summaries(&s.method, s.frames, None) }))
        .collect();
    let scenes: Vec<Value> = report
        .scenes
        .iter()
        .map(|s| json!({ "name": s.name, "views": s.views, "depth_mm": s.depth_mm, "epipolar_row": s.row }))
        .collect();
    let claims: Vec<Value> = super::claims::claims(report)
        .iter()
        .map(|c| json!({ "claim": c.title, "verdict": c.verdict.words(), "numbers": c.numbers, "note": c.note }))
        .collect();
    json!({
        "about": report.about, "missing": report.missing, "methods": report.methods, "scenes": scenes,
        "over_scenes": over_scenes, "runs": runs, "speckle": report.speckle, "claims": claims,
        "published": report.published,
    })
}
