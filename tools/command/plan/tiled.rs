//! Prints the plan of a far field that is solved region by region.

use crate::Failure;
use crate::request::SolveRequest;
use crate::talk::print_report;
use eyebox::low_level::engine::Engine;
use eyebox::low_level::optics::{Color, depths_in_words, dioptres};
use eyebox::low_level::produce::{TilesRequest, plan_tiles};
use serde_json::json;

pub fn run(request: &SolveRequest, tiles: &TilesRequest, engine: &dyn Engine) -> Result<(), Failure> {
    let (settings, _) = request.settings(engine)?;
    let (job, display) = (request.job(settings)?, &request.display);
    let plan = plan_tiles(&job, tiles)?;
    let (settings, [limit, held]) = (&plan.settings, plan.memory);
    let (height, width, frames) = (display.height, display.width, settings.frames);
    let disk = 4 * (job.colors.len() * frames * height * width) as u64;
    if request.report.json {
        let out = json!({
            "scene": job.scenes[0], "display": display.name, "size": [height, width], "colors": job.colors,
            "region": [plan.region.rows, plan.region.columns], "visits": plan.visits * job.colors.len(),
            "passes": tiles.passes, "views": plan.views, "settings": settings,
            "depth_mm": settings.depth.map(|z| z * 1e3),
            "depth_dioptres": settings.depth.map(|z| dioptres(z, display.focal_length)),
            "memory_bytes": { "region": plan.region.bytes, "views": held, "limit": limit }, "disk_bytes": disk,
            "reach": display.reach(), "engine": engine.describe(),
        });
        print_report(out);
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    let [small, large] = settings.diameter.map(|d| d * 1e3);
    println!("{} on {}, {height}x{width}", job.scenes[0], display.name);
    println!("shows {}", display.reach());
    println!("{}\n", engine.describe());
    let say = |what: &str, value: String| println!("  {what:13}  {value}");
    say("colors", job.colors.iter().map(Color::to_string).collect::<Vec<_>>().join(", "));
    say("depth", depths_in_words(settings.depth, display.focal_length));
    say("views", plan.views.clone());
    say("pupils", format!("{small:.2} to {large:.2} mm"));
    let [rows, columns] = [plan.region.rows, plan.region.columns];
    say("regions", format!("{rows}x{columns}, {} visits per color in {} passes", plan.visits, tiles.passes));
    say("steps", format!("{} per visit, {frames} sub-frames", settings.steps));
    let parts = format!("region {}, views {}", mib(plan.region.bytes), mib(held));
    say("memory", format!("{} of {} MiB ({parts})", mib(plan.bytes()), mib(limit)));
    say("disk", format!("{} MiB", mib(disk)));
    say("time", "a solve prints it after its first visits".into());
    Ok(())
}
