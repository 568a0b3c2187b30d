//! Checks the values of pictures of every kind that is read.

use super::*;
use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, ImageAttributes, IntegerBounds, Layer, LayerAttributes,
    SmallVec, Vec2, WritableImage, f16,
};
use std::fs::{self, File};
use std::path::PathBuf;
use tiff::encoder::{TiffEncoder, colortype as of};

const H: usize = 3;
const W: usize = 5;
const MOST: u64 = 1 << 20;

/// Returns a value for every place and channel, between 0 and 1.
fn value(row: usize, column: usize, channel: usize) -> f64 {
    (row * 31 + column * 7 + channel * 50) as f64 / 255.0
}

fn all(channels: usize) -> impl Iterator<Item = f64> {
    (0..H * W * channels).map(move |i| value(i / channels / W, i / channels % W, i % channels))
}

fn bytes(channels: usize) -> Vec<u8> {
    all(channels).map(|v| (v * 255.0).round() as u8).collect()
}

fn words(channels: usize) -> Vec<u16> {
    all(channels).map(|v| (v * 65535.0).round() as u16).collect()
}

fn floats(channels: usize) -> Vec<f32> {
    all(channels).map(|v| v as f32 * 4.0).collect()
}

fn tiff<C: of::ColorType>(file: &Path, values: &[C::Inner])
where
    [C::Inner]: tiff::encoder::TiffValue,
{
    let mut encoder = TiffEncoder::new(File::create(file).unwrap()).unwrap();
    encoder.write_image::<C>(W as u32, H as u32, values).unwrap();
}

/// Writes an EXR of one part with these channels.
fn exr_of(file: &Path, channels: &[(&str, FlatSamples)]) {
    let list: SmallVec<[AnyChannel<FlatSamples>; 4]> =
        channels.iter().map(|(name, samples)| AnyChannel::new(*name, samples.clone())).collect();
    Image::from_channels((W, H), AnyChannels::sort(list)).write().to_file(file).unwrap();
}

fn read(file: &Path, wanted: Wanted) -> Pixels {
    let size = picture_size(file, wanted, MOST).unwrap();
    let read = read_pixels(file, wanted, MOST).unwrap_or_else(|e| panic!("{e}"));
    assert_eq!(([read.height, read.width], size), ([H, W], [H, W]));
    read
}

#[test]
fn tiff_of_every_depth_and_number_of_channels_is_read_as_it_is_stored() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    tiff::<of::Gray8>(&at("1b"), &bytes(1));
    tiff::<of::RGB8>(&at("3b"), &bytes(3));
    tiff::<of::RGBA8>(&at("4b"), &bytes(4));
    tiff::<of::Gray16>(&at("1w"), &words(1));
    tiff::<of::RGB16>(&at("3w"), &words(3));
    tiff::<of::RGBA16>(&at("4w"), &words(4));
    tiff::<of::Gray32Float>(&at("1f"), &floats(1));
    tiff::<of::RGB32Float>(&at("3f"), &floats(3));
    tiff::<of::RGBA32Float>(&at("4f"), &floats(4));
    let doubles: Vec<f64> = floats(1).into_iter().map(f64::from).collect();
    tiff::<of::Gray64Float>(&at("1d"), &doubles);
    for channels in [1, 3, 4] {
        let read = |kind: char| read(&at(&format!("{channels}{kind}")), Wanted::Scene);
        assert_eq!((read('b').samples, read('b').channels), (Samples::U8(bytes(channels)), channels));
        assert_eq!((read('w').samples, read('w').channels), (Samples::U16(words(channels)), channels));
        assert_eq!((read('f').samples, read('f').channels), (Samples::F32(floats(channels)), channels));
    }
    assert_eq!(read(&at("1d"), Wanted::DepthMap).samples, Samples::F32(floats(1)));
    assert_eq!([holds_light(&at("3f")), holds_light(&at("3w"))], [Some("TIFF floats"), None]);
    // Values without a meaning here are refused, such as signed ones, integers of 32 bits, and pages.
    tiff::<of::GrayI16>(&at("signed"), &[-1; H * W]);
    tiff::<of::Gray32>(&at("wide"), &[7; H * W]);
    let mut two = TiffEncoder::new(File::create(at("pages")).unwrap()).unwrap();
    (0..2).for_each(|_| two.write_image::<of::Gray8>(W as u32, H as u32, &bytes(1)).unwrap());
    for name in ["signed", "wide", "pages"] {
        let error = read_pixels(&at(name), Wanted::Scene, MOST).unwrap_err();
        assert!(matches!(error, FileError::Content { .. }), "{name}: {error}");
    }
}

#[test]
fn bmp_and_portable_maps_are_read_and_stretched_to_their_largest_value() {
    let here = tempfile::tempdir().unwrap();
    let at = |name: &str| here.path().join(name);
    image::save_buffer(at("a.bmp"), &bytes(3), W as u32, H as u32, image::ExtendedColorType::Rgb8).unwrap();
    assert_eq!(read(&at("a.bmp"), Wanted::Scene).samples, Samples::U8(bytes(3)));
    let big: Vec<u8> = words(3).into_iter().flat_map(u16::to_be_bytes).collect();
    let ten: Vec<u16> = all(1).map(|v| (v * 1023.0).round() as u16).collect();
    let ten_bytes: Vec<u8> = ten.iter().flat_map(|v| v.to_be_bytes()).collect();
    let text = bytes(1).iter().map(u8::to_string).collect::<Vec<_>>().join(" ");
    for (name, bytes) in [
        ("p6", [b"P6\n# a comment 9\n5 3\n255\n", &bytes(3)[..]].concat()),
        ("p5", [b"P5 5 3 255\n", &bytes(1)[..]].concat()),
        ("p6w", [b"P6\n5 3\n65535\n", &big[..]].concat()),
        ("p5ten", [b"P5\n5 3\n1023\n", &ten_bytes[..]].concat()),
        ("p2", format!("P2\n5 3\n255\n{text}\n").into_bytes()),
    ] {
        fs::write(at(name), bytes).unwrap();
    }
    assert_eq!(read(&at("p6"), Wanted::Scene).samples, Samples::U8(bytes(3)));
    assert_eq!(read(&at("p5"), Wanted::Scene).samples, Samples::U8(bytes(1)));
    assert_eq!(read(&at("p2"), Wanted::Scene).samples, Samples::U8(bytes(1)));
    assert_eq!(read(&at("p6w"), Wanted::Scene).samples, Samples::U16(words(3)));
    // 10 bits fill all 16 bits, and the brightest value is white.
    let Samples::U16(stretched) = read(&at("p5ten"), Wanted::Scene).samples else { panic!("16 bits") };
    assert!(stretched.iter().zip(all(1)).all(|(v, light)| (f64::from(*v) / 65535.0 - light).abs() < 1e-3));
}

/// The channels of a file, and the ones among them that are its colors and its depth. `None` means that it is refused.
type Row = (&'static str, &'static [&'static str], Option<&'static [&'static str]>, Option<&'static [&'static str]>);

#[test]
fn channels_of_exr_files_are_chosen_by_their_names() {
    let rows: [Row; 15] = [
        ("rgb", &["R", "G", "B"], Some(&["R", "G", "B"]), Some(&["R", "G", "B"])),
        ("rgba", &["R", "G", "B", "A"], Some(&["R", "G", "B", "A"]), Some(&["R", "G", "B"])),
        ("Z alone", &["Z"], None, Some(&["Z"])),
        ("V alone", &["V"], Some(&["V"]), Some(&["V"])),
        ("Y alone", &["Y"], Some(&["Y"]), Some(&["Y"])),
        ("R alone", &["R"], Some(&["R"]), Some(&["R"])),
        ("color and Z", &["R", "G", "B", "A", "Z"], Some(&["R", "G", "B", "A"]), Some(&["Z"])),
        (
            "Blender's layers",
            &[
                "ViewLayer.Combined.R",
                "ViewLayer.Combined.G",
                "ViewLayer.Combined.B",
                "ViewLayer.Combined.A",
                "ViewLayer.Depth.Z",
            ],
            Some(&["ViewLayer.Combined.R", "ViewLayer.Combined.G", "ViewLayer.Combined.B", "ViewLayer.Combined.A"]),
            Some(&["ViewLayer.Depth.Z"]),
        ),
        ("a depth layer of colors", &["depth.R"], None, Some(&["depth.R"])),
        ("Blender 4's depth", &["Depth.V"], None, Some(&["Depth.V"])),
        ("Nuke's depth", &["R", "G", "B", "depth.Z"], Some(&["R", "G", "B"]), Some(&["depth.Z"])),
        ("two depths", &["R", "G", "B", "left.Z", "right.Z"], Some(&["R", "G", "B"]), None),
        ("two layers of color", &["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"], None, None),
        ("normals", &["N.X", "N.Y", "N.Z2"], None, None),
        (
            "color beside a layer",
            &["R", "G", "B", "diffuse.R", "diffuse.G", "diffuse.B"],
            Some(&["R", "G", "B"]),
            Some(&["R", "G", "B"]),
        ),
    ];
    let here = tempfile::tempdir().unwrap();
    for (what, names, colors, depth) in rows {
        let file = here.path().join("a.exr");
        let number = |name: &str| names.iter().position(|n| *n == name).unwrap();
        let planes: Vec<Vec<f32>> =
            (0..names.len()).map(|k| (0..H * W).map(|i| (100 * k + i) as f32).collect()).collect();
        let channels: Vec<_> = names.iter().zip(&planes).map(|(n, p)| (*n, FlatSamples::F32(p.clone()))).collect();
        exr_of(&file, &channels);
        for (wanted, chosen) in [(Wanted::Scene, colors), (Wanted::DepthMap, depth)] {
            let Some(chosen) = chosen else {
                let error = read_pixels(&file, wanted, MOST).unwrap_err().to_string();
                assert!(names.iter().all(|n| error.contains(n)), "{what}: {error}");
                continue;
            };
            let read = read(&file, wanted);
            let Samples::F32(values) = read.samples else { panic!("floats") };
            assert_eq!(read.channels, chosen.len(), "{what}");
            for (k, name) in chosen.iter().enumerate() {
                let found: Vec<f32> = values.iter().skip(k).step_by(chosen.len()).copied().collect();
                assert_eq!(found, planes[number(name)], "{what}: {name}");
            }
        }
    }
}

#[test]
fn exr_parts_halves_and_windows_are_read() {
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.exr");
    let half = (0..H * W).map(|i| f16::from_f32(i as f32 * 0.5)).collect();
    exr_of(&file, &[("Y", FlatSamples::F16(half))]);
    let expected: Vec<f32> = (0..H * W).map(|i| i as f32 * 0.5).collect();
    assert_eq!(read(&file, Wanted::DepthMap).samples, Samples::F32(expected));
    // There are two parts. The second is called depth, and its data begin one pixel further right and down.
    let window = IntegerBounds::from_dimensions(Vec2(W, H));
    let part = |name: &str, channels: &[&str], size: Vec2<usize>| {
        let list: SmallVec<[AnyChannel<FlatSamples>; 4]> = channels
            .iter()
            .map(|c| AnyChannel::new(*c, FlatSamples::F32((0..size.0 * size.1).map(|i| i as f32 + 1.0).collect())))
            .collect();
        Layer::new(size, LayerAttributes::named(name), Encoding::SMALL_LOSSLESS, AnyChannels::sort(list))
    };
    let mut depth = part("depth", &["Y"], Vec2(W - 1, H - 1));
    depth.attributes.layer_position = Vec2(1, 1);
    let beauty = part("beauty", &["R", "G", "B"], Vec2(W, H));
    let image = Image::empty(ImageAttributes::new(window)).with_layer(beauty).with_layer(depth);
    image.write().to_file(&file).unwrap();
    assert_eq!(read(&file, Wanted::Scene).channels, 3);
    let Samples::F32(values) = read(&file, Wanted::DepthMap).samples else { panic!("floats") };
    assert!(values[..W].iter().all(|v| v.is_nan()) && values[W].is_nan(), "{values:?}");
    assert_eq!((&values[W + 1..2 * W], &values[2 * W + 1..]), (&[1.0, 2.0, 3.0, 4.0][..], &[5.0, 6.0, 7.0, 8.0][..]));
}

/// Layers of one part and of another one, with and without opacity.
#[test]
fn layers_with_colors_are_read_together() {
    let here = tempfile::tempdir().unwrap();
    let file = here.path().join("a.exr");
    let channels = |size: Vec2<usize>, names: &[(&str, f32)]| {
        let list: SmallVec<[AnyChannel<FlatSamples>; 4]> = (names.iter())
            .map(|(name, value)| AnyChannel::new(*name, FlatSamples::F32(vec![*value; size.0 * size.1])))
            .collect();
        AnyChannels::sort(list)
    };
    let size = Vec2(W, H);
    let names = ["far.R", "far.G", "far.B", "near.10.R", "near.10.G", "near.10.B", "near.10.A", "normal.X", "depth.Z"];
    let values: Vec<(&str, f32)> = names.iter().enumerate().map(|(i, name)| (*name, i as f32)).collect();
    let first = Layer::new(size, LayerAttributes::named("main"), Encoding::SMALL_LOSSLESS, channels(size, &values));
    let second = [("R", 20.0), ("G", 21.0), ("B", 22.0)];
    let second = Layer::new(size, LayerAttributes::named("Near.2"), Encoding::SMALL_LOSSLESS, channels(size, &second));
    let window = IntegerBounds::from_dimensions(size);
    let image = Image::empty(ImageAttributes::new(window)).with_layer(first).with_layer(second);
    image.write().to_file(&file).unwrap();
    assert_eq!(picture_layers(&file).unwrap(), ["far", "near.10", "near.2"]);
    let pixel = |image: &Pixels| match &image.samples {
        Samples::F32(values) => values[..image.channels].to_vec(),
        _ => panic!("floats"),
    };
    let together = read_layers(&file, &[1, 2, 0], MOST).unwrap();
    let pixels: Vec<Vec<f32>> = together.iter().map(pixel).collect();
    assert_eq!(pixels, [vec![3.0, 4.0, 5.0, 6.0], vec![20.0, 21.0, 22.0], vec![0.0, 1.0, 2.0]]);
    assert!(read_layers(&file, &[], MOST).unwrap().is_empty());
    let none = read_layers(&file, &[0, 3], MOST);
    assert!(matches!(&none, Err(FileError::Content { reason, .. }) if reason.code() == "no-layer"), "{none:?}");
    // A single picture would be one of several.
    assert!(read_pixels(&file, Wanted::Scene, MOST).is_err());
}

#[test]
fn an_animated_gif_is_refused_and_a_still_one_is_read() {
    let here = tempfile::tempdir().unwrap();
    let file: PathBuf = here.path().join("a.gif");
    let frame = || image::Frame::new(image::RgbaImage::from_pixel(W as u32, H as u32, image::Rgba([9, 9, 9, 255])));
    for (count, read) in [(1, true), (2, false)] {
        let mut encoder = image::codecs::gif::GifEncoder::new(File::create(&file).unwrap());
        encoder.encode_frames((0..count).map(|_| frame())).unwrap();
        drop(encoder);
        match read_pixels(&file, Wanted::Scene, MOST) {
            Ok(found) => assert!(read && found.height == H),
            Err(FileError::Kind(OtherKind { found, remedy, .. })) => {
                assert!(!read && found == FileKind::Gif && remedy.contains("ffmpeg"), "{remedy}");
            }
            Err(other) => panic!("{other}"),
        }
    }
}
