//! Damages files next to pictures, which have cameras or layers, and videos.

use super::{damage, display, edit, fuzz, png, sound, sound_or_refused};
use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, SmallVec, WritableImage};
use eyebox::low_level::optics::Color;
use eyebox::low_level::scene::{self, Request};
use proptest::prelude::*;
use std::fs;
use std::path::Path;

const LAYERS: &str = "layers_dioptres = [-0.002, 0.004]";
const POSES: [[f64; 7]; 3] =
    [[1.0, 0.0, 0.0, 0.0, 0.1, 0.2, 0.3], [0.9, 0.1, 0.0, 0.0, 0.4, -0.2, 0.3], [0.8, 0.0, 0.2, 0.0, -0.3, 0.5, 0.1]];

/// Writes a picture of 10 x 12 pixels with two layers.
fn layered(file: &Path) {
    let mut list: SmallVec<[AnyChannel<FlatSamples>; 4]> = SmallVec::new();
    for layer in ["plane_0", "plane_1"] {
        for (channel, name) in ["R", "G", "B", "A"].iter().enumerate() {
            let values = (0..120).map(|i| ((i + 7 * channel) % 13) as f32 / 13.0).collect();
            list.push(AnyChannel::new(format!("{layer}.{name}").as_str(), FlatSamples::F32(values)));
        }
    }
    Image::from_channels((10, 12), AnyChannels::sort(list)).write().to_file(file).expect("a picture");
}

#[test]
fn folders_of_layers() {
    let temp = tempfile::tempdir().expect("a folder");
    let [several, one] = ["several", "one"].map(|name| temp.path().join(name));
    for folder in [&several, &one] {
        fs::create_dir(folder).expect("a folder");
        fs::write(folder.join("lightfield.toml"), LAYERS).expect("written");
    }
    for (name, opacity) in [("plane_0.png", 255), ("plane_1.png", 90)] {
        let picture =
            image::RgbaImage::from_fn(10, 12, |x, y| image::Rgba([(x * 20) as u8, (y * 9) as u8, 77, opacity]));
        picture.save(several.join(name)).expect("a picture");
    }
    layered(&one.join("planes.exr"));
    let of =
        |folder: &Path, name: &'static str| (folder.to_path_buf(), name, fs::read(folder.join(name)).expect("there"));
    let kinds = [
        of(&several, "plane_1.png"),
        of(&several, "lightfield.toml"),
        of(&one, "planes.exr"),
        of(&one, "lightfield.toml"),
    ];
    let display = display();
    let request = Request { views: 2, ..Request::new(&display, &[Color::Green]) };
    let load = |folder: &Path| scene::load(folder.to_str().expect("a name"), &request);
    for folder in [&several, &one] {
        sound(&load(folder).expect("layers")).expect("sound");
    }
    fuzz("folders of layers", (0..kinds.len(), prop::collection::vec(edit(), 1..6)), |(which, edits)| {
        let (folder, name, whole) = &kinds[which];
        fs::write(folder.join(name), damage(whole.clone(), &edits)).expect("written");
        let loaded = load(folder);
        fs::write(folder.join(name), whole).expect("restored");
        sound_or_refused(loaded)
    });
}

/// Returns the cameras of COLMAP as a binary file and as text.
fn colmap() -> [Vec<u8>; 2] {
    let mut binary = (POSES.len() as u64).to_le_bytes().to_vec();
    let mut text = String::from("# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n");
    for (i, pose) in POSES.iter().enumerate() {
        binary.extend((i as u32 + 1).to_le_bytes());
        binary.extend(pose.iter().flat_map(|number| number.to_le_bytes()));
        binary.extend(1u32.to_le_bytes());
        binary.extend(format!("{i}.png\0").bytes());
        binary.extend(1u64.to_le_bytes());
        binary.extend([0; 24]);
        let numbers = pose.map(|number| number.to_string()).join(" ");
        text += &format!("{} {numbers} 1 {i}.png\n1.0 2.0 -1\n", i + 1);
    }
    [binary, text.into_bytes()]
}

/// A damaged file of cameras either names the cameras or is ignored.
#[test]
fn cameras_of_other_programs() {
    let temp = tempfile::tempdir().expect("a folder");
    let folder = temp.path().join("images");
    fs::create_dir(&folder).expect("a folder");
    (0..3).for_each(|i| png(&folder.join(format!("{i}.png")), i));
    let [binary, text] = colmap();
    let poses: Vec<f32> = POSES.iter().flat_map(|pose| (0..17).map(|i| pose[i % 7] as f32)).collect();
    let npy = folder.join("poses_bounds.npy");
    eyebox::low_level::files::write_npy(&npy, &[3, 17], &poses).expect("an array");
    let array = fs::read(&npy).expect("there");
    fs::remove_file(&npy).expect("removed");
    let frame = |[_, _, _, _, x, y, z]: [f64; 7]| {
        format!(r#"{{"file_path": "a.png", "transform_matrix": [[1,0,0,{x}],[0,1,0,{y}],[0,0,1,{z}],[0,0,0,1]]}}"#)
    };
    let json = format!(r#"{{"camera_angle_x": 0.7, "frames": [{}]}}"#, POSES.map(frame).join(", ")).into_bytes();
    let kinds = [("images.bin", binary), ("images.txt", text), ("poses_bounds.npy", array), ("transforms.json", json)];
    let display = display();
    let request = Request::new(&display, &[Color::Green]);
    let load = |name: &str, bytes: &[u8]| {
        fs::write(folder.join(name), bytes).expect("written");
        let loaded = scene::load(folder.to_str().expect("a name"), &request);
        fs::remove_file(folder.join(name)).expect("removed");
        loaded
    };
    for (name, whole) in &kinds {
        let found = load(name, whole);
        assert!(matches!(found, Err(scene::SceneError::Cameras { .. })), "{name}: {found:?}");
    }
    fuzz("cameras of other programs", (0..kinds.len(), prop::collection::vec(edit(), 1..6)), |(which, edits)| {
        let (name, whole) = &kinds[which];
        load(name, &damage(whole.clone(), &edits)).map_or(Ok(()), |field| sound(&field))
    });
}

/// The cameras of training next to splats.
#[test]
fn cameras_of_training() {
    let temp = tempfile::tempdir().expect("a folder");
    let splats = temp.path().join("a.splat");
    fs::write(&splats, super::splats::plain()).expect("written");
    let camera = |x: f64| {
        format!(
            r#"{{"id": 0, "img_name": "a", "width": 100, "height": 80, "position": [{x}, 0.2, -4.0],
            "rotation": [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], "fy": 120.0, "fx": 120.0}}"#
        )
    };
    let whole = format!("[{}, {}]", camera(0.1), camera(0.2)).into_bytes();
    let display = display();
    let request = Request { views: 2, ..Request::new(&display, &[Color::Green]) };
    let file = temp.path().join("cameras.json");
    let load = |bytes: &[u8], which: usize| {
        fs::write(&file, bytes).expect("written");
        scene::load(&format!("{}?camera={which}", splats.display()), &request)
    };
    sound(&load(&whole, 1).expect("splats")).expect("sound");
    fuzz("cameras of training", (0..3usize, prop::collection::vec(edit(), 1..6)), |(which, edits)| {
        sound_or_refused(load(&damage(whole.clone(), &edits), which))
    });
}

/// Videos of which one half has the depths, in the format that needs no other program.
#[test]
fn videos_with_depths() {
    let temp = tempfile::tempdir().expect("a folder");
    let file = temp.path().join("pair.y4m");
    let mut whole = b"YUV4MPEG2 W20 H12 F30:1 Ip A1:1 C420jpeg\n".to_vec();
    for frame in 0..2 {
        whole.extend(b"FRAME\n");
        whole.extend((0..20 * 12 * 3 / 2).map(|i| (i * 7 + frame * 31) as u8));
    }
    let display = display();
    let request = Request {
        views: 2,
        near: Some(scene::Near::Bright),
        depth: Some([-1e-3, 1e-3]),
        ..Request::new(&display, &[Color::Green])
    };
    let load = |bytes: &[u8], query: &str| {
        fs::write(&file, bytes).expect("written");
        scene::load(&format!("{}?{query}", file.display()), &request)
    };
    const QUERY: &str = "frame=1&depth=right&matrix=bt709";
    sound(&load(&whole, "depth=right").expect("a frame")).expect("sound");
    let cases = (any::<bool>(), prop::collection::vec(edit(), 1..6));
    fuzz("videos with depths", cases, |(options, edits)| {
        let loaded = match options {
            true => {
                let query = damage(QUERY.as_bytes().to_vec(), &edits);
                load(&whole, &String::from_utf8_lossy(&query).replace(char::is_control, " "))
            }
            false => load(&damage(whole.clone(), &edits), "depth=right"),
        };
        sound_or_refused(loaded)
    });
}
