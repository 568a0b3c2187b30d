//! Reads splats from `.ply` files of 3D Gaussian splatting (Kerbl et al. 2023).
//!
//! A splat is a vertex whose properties have names. Logarithms of the deviations are `scale_0` to `scale_2`, the logit
//! of the opacity is `opacity`, and the quaternion (w, x, y, z) is `rot_0` to `rot_3`. The harmonics `f_rest` have all
//! values of red first, then of green, then of blue. 2D Gaussian splatting (Huang et al. 2024) has no `scale_2`, because
//! its splats are flat. Mip-Splatting (Yu et al. 2024) has the deviation `filter_3D` by which each splat is smoothed.

use crate::splats::cloud::{Cloud, spread};
use crate::splats::file::Opened;
use crate::{SceneError, splats::file};
use eyebox_base::error::Reason;
use eyebox_base::reason;
use eyebox_kernels::splat_colors::{C0, count};
use half::f16;
use std::io::{BufRead, Read};
use std::path::Path;

/// Longest header in bytes.
const HEADER: u64 = 64 << 10;
/// Splats that are read together.
const BLOCK: usize = 4096;

/// A type of a stored number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Number {
    Signed(usize),
    Unsigned(usize),
    Float,
    Double,
}

impl Number {
    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::Signed(1),
            "uchar" | "uint8" => Self::Unsigned(1),
            "short" | "int16" => Self::Signed(2),
            "ushort" | "uint16" => Self::Unsigned(2),
            "int" | "int32" => Self::Signed(4),
            "uint" | "uint32" => Self::Unsigned(4),
            "float" | "float32" => Self::Float,
            "double" | "float64" => Self::Double,
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::Signed(bytes) | Self::Unsigned(bytes) => bytes,
            Self::Float => 4,
            Self::Double => 8,
        }
    }

    /// Returns a stored number, which has all its bytes.
    fn read(self, bytes: &[u8]) -> f32 {
        let word = bytes.iter().take(self.bytes()).rev().fold(0u64, |word, byte| word << 8 | u64::from(*byte));
        match self {
            Self::Float => f32::from_bits(word as u32),
            Self::Double => f64::from_bits(word) as f32,
            Self::Unsigned(_) => word as f32,
            Self::Signed(bytes) => {
                let unused = 64 - 8 * bytes as u32;
                ((word << unused) as i64 >> unused) as f32
            }
        }
    }
}

/// A property of a vertex, with its place in the record.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Field {
    at: usize,
    number: Number,
}

impl Field {
    fn read(self, record: &[u8]) -> f32 {
        self.number.read(&record[self.at..])
    }
}

/// The header of a file.
#[derive(Debug, Default)]
struct Header {
    vertices: u64,
    stride: usize,
    fields: Vec<(String, Field)>,
}

impl Header {
    fn field(&self, name: &str) -> Option<Field> {
        self.fields.iter().find(|(own, _)| own == name).map(|(_, field)| *field)
    }

    fn required<const N: usize>(&self, names: [&str; N]) -> Result<[Field; N], Reason> {
        let mut found = [Field { at: 0, number: Number::Float }; N];
        for (field, name) in found.iter_mut().zip(names) {
            *field = self.field(name).ok_or_else(|| {
                reason!(
                    "no-property",
                    "its vertices have no property {name}, so it is a mesh or a cloud of points and has no splats"
                )
            })?;
        }
        Ok(found)
    }

    /// Reads the lines up to the end of the header.
    fn parse(text: &str) -> Result<Self, Reason> {
        let wrong = |line: &str| reason!("header", "its header has the line '{}', which is not valid", line.trim());
        let (mut header, mut element) = (Self::default(), String::new());
        let mut is_little = false;
        for line in text.lines() {
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words[..] {
                ["format", "binary_little_endian", _] => is_little = true,
                ["format", other, ..] => {
                    return Err(reason!(
                        "encoding",
                        "it is a .ply of the format {other}, and splats are read from binary_little_endian alone. \
                         Write it by plyfile with text=False and byte_order='<'"
                    ));
                }
                ["element", "chunk", _] => {
                    return Err(reason!(
                        "compressed",
                        "it is a compressed .ply of PlayCanvas. Convert it by: npx @playcanvas/splat-transform IN.ply \
                         OUT.spz"
                    ));
                }
                ["element", name, number] => {
                    if element.is_empty() && name != "vertex" {
                        return Err(reason!("first-element", "its first element is {name}, and not vertex"));
                    }
                    element = name.to_owned();
                    if name == "vertex" {
                        header.vertices = number.parse().map_err(|_| wrong(line))?;
                    }
                }
                ["property", "list", ..] if element == "vertex" => return Err(wrong(line)),
                ["property", number, name] if element == "vertex" => {
                    let number = Number::named(number).ok_or_else(|| wrong(line))?;
                    header.fields.push((name.to_owned(), Field { at: header.stride, number }));
                    header.stride += number.bytes();
                }
                _ => {}
            }
        }
        if is_little { Ok(header) } else { Err(reason!("encoding", "its header states no format")) }
    }
}

/// The properties of a splat.
struct Layout {
    place: [Field; 3],
    scale: [Field; 2],
    /// The third deviation, which flat splats do not have.
    thickness: Option<Field>,
    /// The deviation of a smoothing filter.
    filter: Option<Field>,
    turn: [Field; 4],
    opacity: Field,
    /// The constant harmonic of each color.
    constant: Option<[Field; 3]>,
    /// Colors of 8 bits, which some programs write instead.
    bytes: Option<[Field; 3]>,
    /// Harmonics of a degree above 0, in the order of the file.
    rest: Vec<Field>,
    degree: usize,
}

impl Layout {
    fn of(header: &Header) -> Result<Self, Reason> {
        let place = header.required(["x", "y", "z"])?;
        let scale = header.required(["scale_0", "scale_1"])?;
        let (thickness, filter) = (header.field("scale_2"), header.field("filter_3D"));
        let turn = header.required(["rot_0", "rot_1", "rot_2", "rot_3"])?;
        let [opacity] = header.required(["opacity"])?;
        let constant = header.required(["f_dc_0", "f_dc_1", "f_dc_2"]);
        let bytes = header.required(["red", "green", "blue"]).ok();
        let rest: Vec<Field> = (0..).map_while(|i| header.field(&format!("f_rest_{i}"))).collect();
        let degree = (0..=3).find(|degree| 3 * count(*degree) == rest.len());
        let degree = degree.ok_or_else(|| {
            reason!("harmonics", "it has {} properties f_rest, but 0, 9, 24 or 45 are expected", rest.len())
        })?;
        let constant = match (constant, &bytes) {
            (Err(reason), None) => return Err(reason),
            (constant, _) => constant.ok(),
        };
        Ok(Self { place, scale, thickness, filter, turn, opacity, constant, bytes, rest, degree })
    }

    /// Returns the deviations of a splat after its filter, and the part of the opacity that remains. The integral over
    /// the splat stays the same.
    fn shape(&self, record: &[u8]) -> ([f32; 3], f32) {
        let [a, b] = self.scale.map(|f| f.read(record).exp());
        let mut deviations = [a, b, self.thickness.map_or(0.0, |f| f.read(record).exp())];
        let filter = self.filter.map_or(0.0, |f| f.read(record));
        if filter == 0.0 {
            return (deviations, 1.0);
        }
        let axes = if self.thickness.is_some() { 3 } else { 2 };
        let mut share = 1.0;
        for deviation in &mut deviations[..axes] {
            let filtered = deviation.hypot(filter);
            share *= *deviation / filtered;
            *deviation = filtered;
        }
        (deviations, share)
    }

    fn push(&self, record: &[u8], cloud: &mut Cloud) {
        cloud.places.push(self.place.map(|f| f.read(record)));
        let (deviations, share) = self.shape(record);
        cloud.spreads.push(spread(deviations, self.turn.map(|f| f.read(record))));
        cloud.opacities.push(share / (1.0 + (-self.opacity.read(record)).exp()));
        cloud.colors.push(match (self.constant, self.bytes) {
            (Some(constant), _) => constant.map(|f| 0.5 + C0 * f.read(record)),
            (None, Some(bytes)) => bytes.map(|f| f.read(record) / 255.0),
            (None, None) => [0.0; 3],
        });
        let harmonics = count(self.degree);
        for i in 0..harmonics {
            let of = |color: usize| f16::from_f32(self.rest[color * harmonics + i].read(record));
            cloud.rest.extend([of(0), of(1), of(2)]);
        }
    }
}

/// Reads the splats of a `.ply` file.
///
/// # Errors
/// [`SceneError::Corrupt`] for a file that is not valid, and [`SceneError::Memory`].
pub(crate) fn read(path: &Path, mut opened: Opened) -> Result<Cloud, SceneError> {
    let corrupt = |reason: Reason| SceneError::Corrupt { file: path.display().to_string(), reason };
    let io = |error: std::io::Error| file::broken(path, &error);
    let mut text = Vec::new();
    loop {
        let before = text.len();
        let mut line = Read::by_ref(&mut opened.file).take(HEADER - before as u64);
        if line.read_until(b'\n', &mut text).map_err(io)? == 0 {
            return Err(corrupt(reason!("header", "its header has no end within {HEADER} bytes")));
        }
        if text[before..].trim_ascii_end() == b"end_header" {
            break;
        }
    }
    let header = Header::parse(&String::from_utf8_lossy(&text)).map_err(corrupt)?;
    let layout = Layout::of(&header).map_err(corrupt)?;
    let left = opened.length.saturating_sub(text.len() as u64);
    let count = file::checked_count(path, header.vertices, header.stride as u64, left)?;
    let mut cloud = file::room(path, count, layout.degree)?;
    let mut block = vec![0; BLOCK * header.stride];
    for from in (0..count).step_by(BLOCK) {
        let records = &mut block[..BLOCK.min(count - from) * header.stride];
        opened.file.read_exact(records).map_err(io)?;
        records.chunks_exact(header.stride).for_each(|record| layout.push(record, &mut cloud));
    }
    Ok(cloud)
}
