//! Files of splats are scenes in every command, and folders with the cameras of other programs are refused.

use crate::common::{done, folder, json, made, refused};
use std::fs;

const SMALL: [&str; 10] = ["--size", "48x48", "--steps", "4", "--frames", "1", "--color", "green", "--engine", "cpu"];
const SCENE: &str = "still-life.spz?eye=0,0,0&range=0.8333,1.25";

/// Returns a folder with the built-in splats as a file.
fn with_splats() -> tempfile::TempDir {
    let temp = folder();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../runtime/scene/splats/still-life.spz");
    fs::copy(file, temp.path().join("still-life.spz")).expect("the file of the built-in scene");
    temp
}

#[test]
fn splats_are_a_scene_in_every_command() {
    let temp = with_splats();
    let at = temp.path();
    let found = json(at, &["info", SCENE, "--size", "48x48", "--views", "5", "--json"]);
    assert_eq!((found["grid"].clone(), found["depth_is_stated"].clone()), (serde_json::json!([5, 5]), true.into()));
    done(at, &["info", SCENE, "--size", "48x48", "-o", "views.png"]);
    done(at, &[&["solve", SCENE, "-o", "h.zarr"][..], &SMALL].concat());
    // A hologram keeps the camera with its scene.
    let psnr = |words: &[&str]| {
        let pupils = ["--test-pupils", "random:3", "--jod", "none", "--engine", "cpu", "--json"];
        let said = json(at, &[&["eval", "score"][..], words, &pupils].concat());
        said["psnr_db"]["mean"].as_f64().expect("a number")
    };
    let own = psnr(&["h.zarr"]);
    assert!((psnr(&["h.zarr", SCENE]) - own).abs() < 1e-9 && own > 10.0, "{own}");
    let other = ["eval", "score", "h.zarr", "still-life.spz?eye=0,0,0&fov=30", "--engine", "cpu", "--jod", "none"];
    refused(at, &other, "nothing", "arguments/other-scene --force");
    done(at, &["render", "h.zarr", "--pupil=1,0,4,0", "--engine", "cpu", "-o", "seen.png"]);
    done(at, &["render", SCENE, "--size", "48x48", "--pupil=1,0,4,0", "--engine", "cpu", "-o", "target.png"]);
    done(at, &["refine", "h.zarr", "--pupil=1,0,4,0", "--steps", "1", "--engine", "cpu", "-o", "refined.zarr"]);
    // The built-in scene has the same splats, and the same camera by itself.
    done(at, &[&["solve", "builtin:still-life-splats", "-o", "built-in.zarr"][..], &SMALL].concat());
    assert!((psnr(&["built-in.zarr"]) - own).abs() < 0.5);
}

const WALK: [&str; 18] = [
    "--display",
    "planes8",
    "--size",
    "32x32",
    "--color",
    "green",
    "--engine",
    "cpu",
    "--tracker",
    "simulated",
    "--clock",
    "simulated",
    "--set",
    "show.step_time=3",
    "--duration",
    "0.5",
    "--output",
    "raw:shown.raw",
];

/// Views are drawn for the tracked pupil while the camera moves along a path. Each is shown within two set periods, and
/// a simulated clock shows the same bytes again. Without a path, the camera stays and views change with
/// the pupil alone.
#[test]
fn a_camera_walks_in_front_of_splats() {
    let temp = with_splats();
    let at = temp.path();
    let shows = |more: &[&str]| {
        let said = json(at, &[&["show", SCENE][..], &WALK, more, &["--json"]].concat());
        let content = said["content"].clone();
        assert_eq!(content["source"], "still-life.spz");
        // The display shows 60 sets a second.
        let longest_ms = content["arrival_to_light_ms"]["largest"].as_f64().expect("a time");
        assert!(longest_ms <= 2e3 / 60.0, "{said}");
        let frames = fs::read(at.join("shown.raw")).expect("frames");
        fs::remove_file(at.join("shown.raw")).expect("the file");
        (content["shown"].as_u64().expect("a count"), frames)
    };
    let (moving, frames) = shows(&["--walk", "around", "--walk-time", "4"]);
    let (again, same) = shows(&["--walk", "around", "--walk-time", "4"]);
    assert!(moving >= 10 && again == moving && frames == same, "{moving} and {again} views");
    let camera = |x: f64| {
        serde_json::json!({"width": 80, "height": 80, "position": [x, 0, 0], "fx": 100.0, "fy": 100.0,
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]})
    };
    fs::write(at.join("path.json"), serde_json::json!([camera(-0.1), camera(0.1)]).to_string()).unwrap();
    let (along, other) = shows(&["--walk", "path.json"]);
    assert!(along >= 10 && other != frames, "{along} views");
    let (still, _) = shows(&[]);
    assert!(still >= 1 && still < moving, "{still} views of a camera that stays");
    let show = [&["show", SCENE][..], &WALK].concat();
    refused(at, &[&show[..], &["--walk", "none.json"]].concat(), "shown", "scene/not-found");
    refused(at, &[&show[..], &["--quality", "fast"]].concat(), "shown", "arguments/quality-of-splats");
    let plain = ["show", "builtin:still-life", "--walk", "around", "--tracker", "simulated"];
    refused(at, &plain, "shown", "arguments/walk-without-splats");
    refused(at, &["show", SCENE, "--walk", "around"], "shown", "arguments/walk-without-splats");
}

#[test]
fn a_far_field_takes_splats() {
    let temp = with_splats();
    let display = "name = \"far\"\nresolution = [320, 320]\npitch_um = 4.0\nfocal_length_mm = 400.0\n\
                   wavelengths_nm = { green = 520 }\ngeometry = \"far-field\"\n";
    fs::write(temp.path().join("far.toml"), display).unwrap();
    let far = ["--display", "far.toml", "--frames", "1", "--memory", "600MiB", "--pupil-diameter", "0.2..0.4"];
    let tiles = ["--set", "tiles.picture=64", "--engine", "cpu"];
    done(temp.path(), &[&["solve", SCENE, "-o", "far.zarr"][..], &far, &tiles].concat());
}

#[test]
fn cameras_of_other_programs_are_refused() {
    let temp = folder();
    let at = temp.path();
    made::views(&at.join("images"), "builtin:still-life", |r, c| [r, c]);
    fs::create_dir_all(at.join("sparse/0")).unwrap();
    let line = |i: usize, x: f64| format!("{i} 1 0 0 0 {x} 0 0 1 p{i}.jpg\n\n");
    let all: String = [0.0, 1.0, 1.4, 2.9].iter().enumerate().map(|(i, x)| line(i, *x)).collect();
    fs::write(at.join("sparse/0/images.txt"), all).unwrap();
    refused(at, &["solve", "images", "-o", "h.zarr"], "h.zarr", "scene/cameras splats");
    refused(at, &["info", "images"], "nothing", "scene/cameras splats");
    fs::write(at.join("broken.ply"), "ply\nformat ascii 1.0\nend_header\n").unwrap();
    refused(at, &["solve", "broken.ply", "-o", "h.zarr"], "h.zarr", "scene/corrupt/encoding ascii");
    fs::write(at.join("cache.ksplat"), [0; 5000]).unwrap();
    refused(at, &["solve", "cache.ksplat", "-o", "h.zarr"], "h.zarr", "scene/kind splat-transform");
}

#[test]
fn layers_are_a_scene() {
    let temp = folder();
    let at = temp.path().join("layers");
    fs::create_dir_all(&at).unwrap();
    let picture = |near: bool| {
        image::RgbaImage::from_fn(48, 48, |x, y| {
            let inside = (16..32).contains(&x) && (16..32).contains(&y);
            image::Rgba([200, (4 * x) as u8, (4 * y) as u8, if near && !inside { 0 } else { 255 }])
        })
    };
    picture(false).save(at.join("layer_0.png")).unwrap();
    picture(true).save(at.join("layer_1.png")).unwrap();
    fs::write(at.join("lightfield.toml"), "layers_dioptres = [-0.005, 0.01]").unwrap();
    let found = json(temp.path(), &["info", "layers", "--size", "48x48", "--views", "3", "--json"]);
    for (at, dioptres) in [-0.005, 0.01].into_iter().enumerate() {
        let found = found["depth_dioptres"][at].as_f64().expect("a number");
        assert!((found - dioptres).abs() < 1e-12, "{found}");
    }
    done(temp.path(), &[&["solve", "layers", "-o", "h.zarr"][..], &SMALL].concat());
}
