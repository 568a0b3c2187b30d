//! Tests videos of colors and depths, and folders of pairs, frame by frame against single pictures with maps.

use crate::*;
use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, SmallVec, WritableImage};
use eyebox_base::error::ErrorData;
use eyebox_optics::{Color, Display};
use image::{ImageBuffer, Luma, Rgb};
use std::{fs, path::PathBuf};

const SIZE: usize = 24;
const FRAMES: usize = 3;

/// Returns a gray picture that moves, and its depths, with a square in front of a wall.
fn frame(i: usize) -> [Vec<u8>; 2] {
    let inside = |p: usize| (6 + 2 * i..14 + 2 * i).contains(&(p % SIZE)) && (8..16).contains(&(p / SIZE));
    let light = |p: usize| if inside(p) { 220 } else { 40 + (p * 37 % 60) as u8 };
    // The wall comes nearer from frame to frame, which a separate range in each frame would hide.
    let depth = |p: usize| if inside(p) { 200 } else { 20 + 30 * i as u8 };
    [(0..SIZE * SIZE).map(light).collect(), (0..SIZE * SIZE).map(depth).collect()]
}

fn video(file: &Path, which: usize) {
    let mut bytes = format!("YUV4MPEG2 W{SIZE} H{SIZE} F30:1 Cmono XCOLORRANGE=FULL\n").into_bytes();
    (0..FRAMES).for_each(|i| bytes.extend([b"FRAME\n", &frame(i)[which][..]].concat()));
    fs::write(file, bytes).unwrap();
}

fn loaded(source: &str, map: &Path) -> LightField {
    let display = Display { height: SIZE, width: SIZE, ..Display::preset("small").unwrap() };
    let request = Request {
        depth_map: Some(map),
        views: 3,
        depth: Some([-1e-3, 1e-3]),
        near: Some(Near::Large),
        ..Request::new(&display, &[Color::Green])
    };
    load(source, &request).unwrap()
}

/// Returns the frames of a source and their maps.
fn pairs(source: &Path, maps: &Path) -> Vec<(String, PathBuf)> {
    let maps = [maps.to_path_buf()];
    let frames = sequence(source.to_str().unwrap(), &maps).unwrap().expect("a sequence");
    let maps = depth_maps(&frames, &maps).unwrap();
    frames.into_iter().zip(maps).collect()
}

fn likeness(a: &LightField, b: &LightField) -> f32 {
    let pixels = a.planes[0].iter().flatten().zip(b.planes[0].iter().flatten());
    pixels.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn frames_of_videos_and_of_folders_are_pictures_with_maps() {
    let here = tempfile::tempdir().unwrap();
    let [clip, depths, pairs_in, apart] =
        ["clip.y4m", "depths.y4m", "pairs", "maps"].map(|name| here.path().join(name));
    [&clip, &depths].into_iter().enumerate().for_each(|(which, file)| video(file, which));
    [&pairs_in, &apart].iter().for_each(|folder| fs::create_dir(folder).unwrap());
    let size = SIZE as u32;
    for i in 0..FRAMES {
        let [light, depth] = frame(i);
        let grey = |values: &[u8]| ImageBuffer::<Luma<u8>, _>::from_raw(size, size, values.to_vec()).unwrap();
        let color = ImageBuffer::from_fn(size, size, |x, y| Rgb([light[(y * size + x) as usize]; 3]));
        color.save(pairs_in.join(format!("shot-{}.png", 8 + i))).unwrap();
        grey(&depth).save(pairs_in.join(format!("shot_depth-{}.png", 8 + i))).unwrap();
        grey(&depth).save(apart.join(format!("{i:03}.png"))).unwrap();
    }
    let of_video = pairs(&clip, &depths);
    assert_eq!(of_video.len(), FRAMES);
    assert!(of_video[2].0.ends_with("clip.y4m?frame=2") && of_video[2].1.ends_with("depths.y4m?frame=2"));
    let of_folder = pairs(&pairs_in, &pairs_in);
    assert!(of_folder[0].0.ends_with("shot-8.png") && of_folder[2].1.ends_with("shot_depth-10.png"), "{of_folder:?}");
    assert!(pairs(&clip, &apart)[1].1.ends_with("001.png"));
    for ((video, video_map), (picture, map)) in of_video.iter().zip(&of_folder) {
        // The light is the same. The range of depths is the same in every frame of a video, and a picture has its own.
        let [a, b] = [loaded(video, map), loaded(picture, map)];
        assert!(likeness(&a, &b) < 1e-5, "{video}: {}", likeness(&a, &b));
        assert!(loaded(video, video_map).depth.unwrap()[1] < 0.6e-3 && b.depth.unwrap()[1] > 0.99e-3);
    }
    // The wall of the last frame is nearer than the wall of the first one.
    let far = |i: usize| loaded(&of_video[i].0, &of_video[i].1).depth.unwrap()[0];
    assert!(far(2) > far(0) + 0.3e-3, "{} {}", far(0), far(2));
    // The video alone is its first frame, and a missing frame is an error.
    assert_eq!(native_size(clip.to_str().unwrap()).unwrap(), Some([SIZE, SIZE]));
    let says = |found: Result<Vec<PathBuf>, SceneError>, numbers: [&str; 2]| {
        let Err(SceneError::Maps { what }) = found else { panic!("{found:?}") };
        let said = what.rsplit(": ").next().unwrap().split(|c: char| !c.is_ascii_digit());
        assert!(said.filter(|word| !word.is_empty()).take(2).eq(numbers), "{what}");
    };
    says(depth_maps(&[format!("{}?frame=7", clip.display())], &[depths]), ["3", "7"]);
    fs::remove_file(apart.join("002.png")).unwrap();
    let frames = sequence(clip.to_str().unwrap(), &[]).unwrap().unwrap();
    says(depth_maps(&frames, std::slice::from_ref(&apart)), ["2", "2"]);
    assert!(sequence(here.path().join("none.y4m").to_str().unwrap(), &[]).unwrap().is_none());
}

/// Writes a frame to an EXR file, with distances of 20 for a depth of 0 and of 0.5 for a depth of 255.
fn exr_frame(file: &Path, i: usize) {
    let [light, depth] = frame(i);
    let light: Vec<f32> = light.iter().map(|v| f32::from(*v) / 255.0).collect();
    let distance: Vec<f32> = depth.iter().map(|v| 20.0 - 19.5 * f32::from(*v) / 255.0).collect();
    let named = [("R", &light), ("G", &light), ("B", &light), ("Z", &distance)];
    let list: SmallVec<[AnyChannel<FlatSamples>; 4]> =
        named.iter().map(|(name, values)| AnyChannel::new(*name, FlatSamples::F32((*values).clone()))).collect();
    Image::from_channels((SIZE, SIZE), AnyChannels::sort(list)).write().to_file(file).unwrap();
}

/// Frames of a renderer have their distances in the same file. A wall stays at its depth in all frames.
#[test]
fn maps_of_a_sequence_have_the_same_ends() {
    let here = tempfile::tempdir().unwrap();
    let folder = here.path().join("frames");
    fs::create_dir(&folder).unwrap();
    (0..FRAMES).for_each(|i| exr_frame(&folder.join(format!("shot-{i}.exr")), i));
    let given = [folder.clone()];
    let frames = sequence(folder.to_str().unwrap(), &given).unwrap().expect("a sequence");
    let own: Vec<PathBuf> = frames.iter().map(PathBuf::from).collect();
    assert_eq!(depth_maps(&frames, &given).unwrap(), own);
    let together = sequence_maps(&frames, &given, Some(Near::Small), None).unwrap();
    let [low, high] = [200, 20].map(|v| 20.0 - 19.5 * v as f32 / 255.0);
    assert!(
        together.iter().all(|map| map.to_str().unwrap().ends_with(&format!("?range={low},{high}"))),
        "{together:?}"
    );
    let depth = |source: &str, map: &Path| {
        let display = Display { height: SIZE, width: SIZE, ..Display::preset("small").unwrap() };
        let (depth, near, depth_map) = (Some([-1e-3, 1e-3]), Some(Near::Small), Some(map));
        let request = Request { depth_map, views: 3, depth, near, ..Request::new(&display, &[Color::Green]) };
        load(source, &request).map(|field| field.depth.unwrap())
    };
    for (i, source) in frames.iter().enumerate() {
        // The wall is at 20, 50 and 80 of 20 to 200.
        let [far, nearest] = depth(source, &together[i]).unwrap();
        let wall = -1e-3 + 2e-3 * 30.0 * i as f64 / 180.0;
        assert!((far - wall).abs() < 1e-6 && (nearest - 1e-3).abs() < 1e-6, "{i}: {far} {nearest}");
        let [far, nearest] = depth(source, &own[i]).unwrap();
        assert!((far + 1e-3).abs() < 1e-6 && (nearest - 1e-3).abs() < 1e-6, "{i}: {far} {nearest}");
    }

    // Stated ends count, and values beyond them become the ends.
    let stated = [format!("{}?range=2,10", folder.display()).into()];
    let maps = sequence_maps(&frames, &stated, Some(Near::Small), None).unwrap();
    assert!(maps[2].ends_with("shot-2.exr?range=2,10"), "{maps:?}");
    let [far, nearest] = depth(&frames[0], &maps[0]).unwrap();
    assert!((far + 1e-3).abs() < 1e-6 && nearest < 0.6e-3, "{far} {nearest}");
    for wrong in ["range=10,2", "range=2", "range=2,inf", "range=a,b", "range=1,1"] {
        let map = format!("{}?{wrong}", frames[0]);
        assert_eq!(
            ErrorData::of(&depth(&frames[0], Path::new(&map)).unwrap_err()).code,
            "options/option-value",
            "{wrong}"
        );
    }
    // Single pictures, one map for all pictures and frames of videos keep their ends.
    let one = [folder.join("shot-0.exr")];
    assert_eq!(sequence_maps(&frames[..1], &given, None, None).unwrap(), own[..1]);
    assert_eq!(
        sequence_maps(&[frames[0].clone(), frames[0].clone()], &one, None, None).unwrap(),
        [one[0].clone(), one[0].clone()]
    );
    let clip = here.path().join("depths.y4m");
    video(&clip, 1);
    assert!(sequence_maps(&frames, &[clip], None, None).unwrap()[1].ends_with("depths.y4m?frame=1"));
    // Disparities are pixels already.
    let disparities: Vec<PathBuf> = (0..FRAMES).map(|i| here.path().join(format!("disp-{i}.pfm"))).collect();
    for (i, file) in disparities.iter().enumerate() {
        let [_, depth] = frame(i);
        let bytes: Vec<u8> = depth.iter().flat_map(|v| (f32::from(*v) / 255.0).to_le_bytes()).collect();
        fs::write(file, [format!("Pf\n{SIZE} {SIZE}\n-1.0\n").as_bytes(), &bytes].concat()).unwrap();
    }
    assert_eq!(sequence_maps(&frames, &disparities, None, None).unwrap(), disparities);
    let stated = format!("{}?range=0.1,0.5", disparities[0].display());
    let display = Display { height: SIZE, width: SIZE, ..Display::preset("small").unwrap() };
    let request = Request { depth_map: Some(Path::new(&stated)), views: 3, ..Request::new(&display, &[Color::Green]) };
    assert_eq!(ErrorData::of(&load(&frames[0], &request).unwrap_err()).code, "corrupt/map-range");
    // Pictures without depths have no map in their folder.
    fs::remove_file(folder.join("shot-1.exr")).unwrap();
    image::RgbImage::new(24, 24).save(folder.join("shot-1.png")).unwrap();
    let frames = sequence(folder.to_str().unwrap(), &given).unwrap().unwrap();
    assert!(matches!(depth_maps(&frames, &given), Err(SceneError::Maps { .. })));
}
