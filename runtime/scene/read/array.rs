//! Reads light fields from one array in `.npy` or `.npz` files.
//!
//! The axes are (rows of views, columns of views, rows of pixels, columns of pixels, colors).

use crate::formats::options::Options;
use crate::formats::tone::{Reading, Stored};
use crate::light_field::cameras::Positions;
use crate::light_field::light::{FullScale, Transfer};
use crate::light_field::near::Kind;
use crate::read::layout::{self, Layout};
use crate::read::settings::{self, Settings};
use crate::read::views::{self, Frame, Read};
use crate::{Request, SceneError};
use eyebox_base::error::Reason;
use eyebox_base::files::NpyArray;
use eyebox_base::memory;
use eyebox_base::reason;
use rayon::prelude::*;
use std::path::Path;

/// Returns the kind of the elements of an array, by its name in NumPy.
fn kind_of(name: &str) -> Result<Kind, Reason> {
    match name {
        "u1" => Ok(Kind::Bytes),
        "u2" => Ok(Kind::Words),
        "f2" | "f4" | "f8" => Ok(Kind::Floats),
        _ => {
            let remedy = match name.chars().next() {
                Some('b') => "save views.astype('float32')",
                _ => "save views.astype('uint8') if 255 is full scale, views.astype('uint16') if 65535 is",
            };
            Err(reason!(
                "array-type",
                "its elements are '{name}', but views have unsigned integers of 8 or 16 bits ('u1', 'u2'), or floats \
                 with 1 as full scale. To convert them, {remedy}"
            ))
        }
    }
}

/// An open array with its layout and its settings.
struct Opened {
    array: NpyArray,
    layout: Layout,
    stated: Settings,
    kind: Kind,
}

fn open(file: &Path, options: &Options) -> Result<Opened, SceneError> {
    let stated = settings::beside(file, options)?;
    let array = NpyArray::open(file, options.array.as_deref(), |shape| matches!(shape.len(), 4 | 5))?;
    let corrupt = |reason: Reason| SceneError::Corrupt { file: file.display().to_string(), reason };
    let one_by_one = array.shape.len() == 3 || (array.shape.len() == 4 && matches!(array.shape[3], 1 | 3 | 4));
    let in_a_row = stated.positions.as_ref().map(Positions::grid).filter(|_| one_by_one);
    let color = if layout::needs_contents(&array.shape) { color_axis(file, options, &array.shape)? } else { None };
    let layout = Layout::of(&array.shape, stated.grid.or(in_a_row), color, file).map_err(corrupt)?;
    let kind = kind_of(&array.kind).map_err(corrupt)?;
    Ok(Opened { array, layout, stated, kind })
}

/// Returns the axis of colors that the contents of an array of this shape show.
fn color_axis(file: &Path, options: &Options, shape: &[usize]) -> Result<Option<usize>, SceneError> {
    let what = || format!("an array of the shape {shape:?}");
    memory::check_available(what, memory::bytes_of(shape, 4), "save fewer views")?;
    let mut array = NpyArray::open(file, options.array.as_deref(), |shape| matches!(shape.len(), 4 | 5))?;
    Ok(layout::color_axis(shape, &array.take(shape.iter().product())?))
}

/// Returns rows and columns of the views of an array, from its header.
pub(crate) fn size(file: &Path, options: &Options) -> Result<[usize; 2], SceneError> {
    Ok(open(file, options)?.layout.size)
}

/// Reads the views of an array, a few at a time. Each is scaled to the display as soon as it is read.
pub(crate) fn read(file: &Path, options: &Options, request: &Request) -> Result<Read, SceneError> {
    let Opened { mut array, layout: Layout { grid, size, channels }, stated, kind } = open(file, options)?;
    let count = grid[0] * grid[1];
    let frame = Frame::new(size, count, request)?;
    let reading = Reading::new(stated.tone);
    let planes = |view: usize, values: Vec<f32>| {
        let light = |stored, says| reading.light(stored, channels, false, says, request.colors);
        let planes = match kind {
            Kind::Bytes => {
                light(Stored::Bytes(&values.into_iter().map(|v| v as u8).collect::<Vec<_>>()), Transfer::Srgb)
            }
            Kind::Words => {
                light(Stored::Words(&values.into_iter().map(|v| v as u16).collect::<Vec<_>>()), Transfer::Srgb)
            }
            Kind::Floats => light(Stored::Floats(&values), Transfer::Linear),
        };
        let place =
            || format!("{}, the view of row {}, column {}", file.display(), view / grid[1] + 1, view % grid[1] + 1);
        planes.map_err(|(i, value)| SceneError::no_light(place(), [i / size[1], i % size[1]], value))
    };
    let together = rayon::current_num_threads().min(count);
    let mut fitted: Vec<Vec<Vec<f32>>> = Vec::with_capacity(count);
    while fitted.len() < count {
        let mut some = Vec::with_capacity(together);
        while some.len() < together.min(count - fitted.len()) {
            let values = array.take(size[0] * size[1] * channels)?;
            some.push((fitted.len() + some.len(), values));
        }
        let one = |(view, values): (usize, Vec<f32>)| Ok(frame.fit(planes(view, values)?));
        let some: Result<Vec<_>, SceneError> = some.into_par_iter().map(one).collect();
        fitted.extend(some?);
    }
    reading.judge(file, FullScale::File)?;
    let field = frame.field(file, grid, fitted, request, &stated, stated.disparity);
    let how = format!("an array of {}", array.kind);
    views::ordered(file, field, request, &stated, how, size, (kind == Kind::Floats).then_some("floats"))
}
