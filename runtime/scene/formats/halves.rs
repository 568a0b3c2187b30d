//! Takes one half of a picture that has colors in one half and depths in the other one.

use crate::light_field::light::Picture;
use crate::light_field::near::GrayValues;
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// A half of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Half {
    Left,
    Right,
    Top,
    Bottom,
}

impl Half {
    /// Reads the name of a half.
    pub fn named(name: &str) -> Result<Self, Reason> {
        match name {
            "left" => Ok(Self::Left),
            "right" => Ok(Self::Right),
            "top" => Ok(Self::Top),
            "bottom" => Ok(Self::Bottom),
            other => Err(reason!("half", "'{other}' is no half of a picture, which is left, right, top or bottom")),
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Right => "right",
            Self::Top => "top",
            Self::Bottom => "bottom",
        }
    }

    /// Returns the other half of the same picture.
    pub fn other(self) -> Self {
        match self {
            Self::Left => Self::Right,
            Self::Right => Self::Left,
            Self::Top => Self::Bottom,
            Self::Bottom => Self::Top,
        }
    }

    /// Returns rows and columns of this half of a picture. The middle row or column of an odd number is left out.
    pub fn size(self, [rows, columns]: [usize; 2]) -> [usize; 2] {
        match self {
            Self::Left | Self::Right => [rows, columns / 2],
            Self::Top | Self::Bottom => [rows / 2, columns],
        }
    }

    /// Returns this half of a plane of interleaved channels.
    pub fn cut<T: Copy>(self, plane: &[T], [rows, columns]: [usize; 2], channels: usize) -> Vec<T> {
        let [height, width] = self.size([rows, columns]);
        let [top, left] = match self {
            Self::Left | Self::Top => [0, 0],
            Self::Right => [0, columns - width],
            Self::Bottom => [rows - height, 0],
        };
        let row = |y: usize| plane[((top + y) * columns + left) * channels..][..width * channels].iter().copied();
        (0..height).flat_map(row).collect()
    }

    /// Returns this half of a picture.
    pub fn picture(self, whole: Picture) -> Picture {
        let size = [whole.height, whole.width];
        let planes = whole.planes.iter().map(|plane| self.cut(plane, size, 1)).collect();
        let [height, width] = self.size(size);
        let read_as = format!("{}, {} half", whole.read_as, self.name());
        Picture { height, width, planes, read_as }
    }

    /// Returns this half of the values of a gray picture.
    pub fn values(self, whole: GrayValues) -> GrayValues {
        let size = [whole.height, whole.width];
        let [height, width] = self.size(size);
        GrayValues { height, width, values: self.cut(&whole.values, size, 1), ..whole }
    }
}
