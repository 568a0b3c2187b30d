//! Describes the positions of cameras in a grid, in one row of tiles, or anywhere.
//!
//! Tiles in a picture are not cameras in a grid. A quilt of a Looking Glass display has one row of cameras, laid out in
//! rows of tiles from the bottom left. Its name says so. For example, `NAME_qs8x6a0.75.png` has 8 columns and 6 rows of
//! tiles, and each view is 0.75 times as wide as high.

use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::Deserialize;
use std::{fmt, path::Path};

/// The tile of the leftmost camera of a row that is laid out in tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FirstTile {
    /// Cameras run from left to right and then up, as in quilts.
    BottomLeft,
    /// Cameras run from left to right and then down.
    TopLeft,
    /// Cameras run from right to left and then up.
    BottomRight,
    /// Cameras run from right to left and then down.
    TopRight,
}

impl FirstTile {
    pub(crate) const ALL: [Self; 4] = [Self::BottomLeft, Self::TopLeft, Self::BottomRight, Self::TopRight];
}

impl fmt::Display for FirstTile {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(match self {
            Self::BottomLeft => "bottom-left",
            Self::TopLeft => "top-left",
            Self::BottomRight => "bottom-right",
            Self::TopRight => "top-right",
        })
    }
}

/// One row of cameras that is laid out in rows and columns of tiles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
pub struct Tiles {
    /// Rows and columns of tiles.
    pub grid: [usize; 2],
    /// Tile of the leftmost camera.
    pub first: FirstTile,
    /// True if every second row of tiles, counted from the first camera, runs backwards.
    pub serpentine: bool,
}

impl Tiles {
    /// Returns the tile of each camera from left to right. The index counts the tiles row by row from the top left.
    pub(crate) fn order(self) -> Vec<usize> {
        let [rows, columns] = self.grid;
        let from_below = matches!(self.first, FirstTile::BottomLeft | FirstTile::BottomRight);
        let from_right = matches!(self.first, FirstTile::BottomRight | FirstTile::TopRight);
        let tile = |camera: usize| {
            let (along, across) = (camera / columns, camera % columns);
            let row = if from_below { rows - 1 - along } else { along };
            let backwards = from_right != (self.serpentine && !along.is_multiple_of(2));
            row * columns + if backwards { columns - 1 - across } else { across }
        };
        (0..rows * columns).map(tile).collect()
    }

    /// Returns the same row from the other end.
    fn reversed(self) -> Self {
        let mut order = self.order();
        order.reverse();
        let tiles = FirstTile::ALL.map(|first| Self { first, ..self });
        tiles.into_iter().find(|tiles| tiles.order() == order).unwrap_or(self)
    }

    /// Returns the keys of `lightfield.toml` that state these tiles.
    pub(crate) fn keys(self) -> String {
        let [rows, columns] = self.grid;
        let serpentine = if self.serpentine { ", `serpentine = true`" } else { "" };
        format!("`tiles = [{rows}, {columns}]`, `first = \"{}\"`{serpentine}", self.first)
    }
}

impl fmt::Display for Tiles {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let [rows, columns] = self.grid;
        let backwards = if self.serpentine { ", every second row of tiles backwards" } else { "" };
        write!(f, "one row of {} cameras in {rows} x {columns} tiles, {} first{backwards}", rows * columns, self.first)
    }
}

/// Positions of cameras in the pupil plane in meters, with x to the right and y downwards.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Positions {
    /// Rows and columns that are not evenly spaced, as x of each column and y of each row.
    Lines([Vec<f64>; 2]),
    /// The position (x, y) of each view, in the order of the views.
    Each(Vec<[f64; 2]>),
}

/// The key `positions_mm` of `lightfield.toml`.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(crate) enum PositionsToml {
    /// x of each view of one row.
    Row(Vec<f64>),
    /// The position (x, y) of each view.
    Each(Vec<[f64; 2]>),
    /// x of each column and y of each row.
    Lines(LinesToml),
}

/// Rows and columns of `positions_mm`.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct LinesToml {
    x: Vec<f64>,
    y: Vec<f64>,
}

/// Cameras farther from 0 than this (mm) do not fit any eyebox.
const FARTHEST_MM: f64 = 1e4;

impl PositionsToml {
    /// # Errors
    /// The reason in words, if a number is not finite, or if two cameras have the same position.
    pub(crate) fn metres(self) -> Result<Positions, Reason> {
        let found = match self {
            Self::Row(x) => Positions::Each(x.iter().map(|mm| [mm * 1e-3, 0.0]).collect()),
            Self::Each(all) => Positions::Each(all.iter().map(|at| at.map(|mm| mm * 1e-3)).collect()),
            Self::Lines(LinesToml { x, y }) => {
                Positions::Lines([x, y].map(|line| line.iter().map(|mm| mm * 1e-3).collect()))
            }
        };
        let all = found.all();
        if all.len() < 2 || all.iter().flatten().any(|v| v.is_nan() || v.abs() > FARTHEST_MM * 1e-3) {
            return Err(reason!(
                "positions",
                "positions_mm must be two or more positions within {FARTHEST_MM} mm of 0"
            ));
        }
        if (1..all.len()).any(|i| all[..i].contains(&all[i])) {
            return Err(reason!(
                "positions-same",
                "positions_mm has two cameras in one place, but each view must have a position of its own"
            ));
        }
        Ok(found)
    }
}

impl Positions {
    /// Returns (x, y) of each view, row by row for rows and columns.
    pub(crate) fn all(&self) -> Vec<[f64; 2]> {
        match self {
            Self::Each(all) => all.clone(),
            Self::Lines([x, y]) => y.iter().flat_map(|y| x.iter().map(move |x| [*x, *y])).collect(),
        }
    }

    /// Returns the rows and columns in which the views come.
    pub(crate) fn grid(&self) -> [usize; 2] {
        match self {
            Self::Each(all) => [1, all.len()],
            Self::Lines([x, y]) => [y.len(), x.len()],
        }
    }
}

/// Rows and columns of tiles, and the width of a view over its height, from the name of a quilt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Quilt {
    pub grid: [usize; 2],
    pub aspect: Option<f64>,
}

/// The largest number of tiles along an axis.
const MOST_TILES: usize = 64;

impl Quilt {
    /// Reads a file name of the form `NAME_qsCOLUMNSxROWSaASPECT.png`.
    pub(crate) fn of(file: &Path) -> Option<Self> {
        let stem = file.file_stem()?.to_str()?.to_ascii_lowercase();
        stem.match_indices("qs").filter(|(at, _)| !stem[..*at].ends_with(char::is_alphanumeric)).find_map(|(at, _)| {
            let rest = &stem[at + 2..];
            let digits = |text: &str| text.find(|c: char| !c.is_ascii_digit()).unwrap_or(text.len());
            let count = |text: &str| text.parse().ok().filter(|n| (1..=MOST_TILES).contains(n));
            let (columns, rest) = rest.split_at(digits(rest));
            let rest = rest.strip_prefix('x')?;
            let (rows, rest) = rest.split_at(digits(rest));
            let grid = [count(rows)?, count(columns)?];
            let (aspect, rest) = match rest.strip_prefix('a') {
                Some(rest) => {
                    let end = rest.find(|c: char| !(c.is_ascii_digit() || c == '.')).unwrap_or(rest.len());
                    let aspect = rest[..end].parse().ok().filter(|a: &f64| (0.05..=20.0).contains(a))?;
                    (Some(aspect), &rest[end..])
                }
                None => (None, rest),
            };
            (grid[0] * grid[1] > 1 && !rest.starts_with(char::is_alphanumeric)).then_some(Self { grid, aspect })
        })
    }
}

/// The contradiction between the pictures and the positions of the cameras.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum CamerasFound {
    /// The cameras are in one row, which is laid out in tiles.
    RowInTiles(Tiles),
    /// The cameras are not evenly spaced, along rows of views or along columns. Positions are relative to the central
    /// one, in units of the mean spacing.
    Uneven {
        /// True for the spacing of columns, along a row of views.
        columns: bool,
        /// Positions of the cameras that were compared.
        positions: Vec<f64>,
    },
    /// Content moves across the axes of the grid. This percentage of the patches that moved did so along them.
    Elsewhere(u8),
    /// The stated positions explain only this percentage of the movements.
    Misplaced(u8),
    /// The cameras have one position. The pictures differ in sharpness or exposure, and nothing moves.
    OnePlace,
    /// Hardly any content of a view is found again in its neighbors. This is the percentage of its patches that are
    /// found.
    Unlike(u8),
    /// The camera was carried around, by a file of another program. It took this number of pictures. The rows and
    /// columns belong to a grid, if its positions are in one.
    Carried {
        /// The number of pictures, one for each camera.
        count: usize,
        /// Rows and columns of a grid.
        grid: Option<[usize; 2]>,
    },
}

impl fmt::Display for CamerasFound {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Self::RowInTiles(tiles) => write!(
                f,
                "the pictures show {tiles}, and no grid of cameras. State {} in lightfield.toml, with `first = \
                 \"{}\"` if that camera is the rightmost",
                tiles.keys(),
                tiles.reversed().first
            ),
            Self::Uneven { columns, positions } => {
                let what = if *columns { "columns" } else { "rows" };
                let all: Vec<String> = positions.iter().map(|x| format!("{x:.1}")).collect();
                write!(
                    f,
                    "the pictures show that {what} of cameras are not evenly spaced (about {}). State `positions_mm`, \
                     the position of each camera, in lightfield.toml",
                    all.join(", ")
                )
            }
            Self::Elsewhere(percent) => write!(
                f,
                "the pictures show cameras that are not in a grid, because only {percent} % of the moving content \
                 moves along its row or column. State `positions_mm`, the position (x, y) of each camera, in \
                 lightfield.toml. Stated depths do not help"
            ),
            Self::Misplaced(percent) => write!(
                f,
                "the pictures contradict `positions_mm`, which explains only {percent} % of the movement. Give x to \
                 the right and y downwards, in millimeters, one position for each view in the order of the numbers in \
                 their names"
            ),
            Self::OnePlace => write!(
                f,
                "the pictures were taken from one position, because nothing moves and the sharpness changes. If they \
                 are a focal stack, state `focus_mm` and `aperture_mm` in lightfield.toml"
            ),
            Self::Unlike(percent) => write!(
                f,
                "the views are not neighbors, because only {percent} % of a view's detail is found again in the next \
                 one. Take views of one scene from positions closer to each other. Stated depths do not help"
            ),
            Self::Carried { count, grid: Some([rows, columns]) } => write!(
                f,
                "it has the {count} cameras of another program, which are a grid. State `grid = [{rows}, {columns}]` in \
                 lightfield.toml, if the pictures are row by row"
            ),
            Self::Carried { count, grid: None } => write!(
                f,
                "it has the {count} cameras of another program, which are in no grid, so the pictures are no light \
                 field. Train splats from them, and give the .ply, .splat or .spz file"
            ),
        }?;
        if matches!(self, Self::Misplaced(_) | Self::Carried { .. }) {
            Ok(())
        } else {
            f.write_str(". `order` as-named confirms a grid")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tiles_are_counted_from_any_corner() {
        let of = |first, serpentine| Tiles { grid: [2, 3], first, serpentine }.order();
        assert_eq!(of(FirstTile::BottomLeft, false), [3, 4, 5, 0, 1, 2]);
        assert_eq!(of(FirstTile::TopLeft, false), [0, 1, 2, 3, 4, 5]);
        assert_eq!(of(FirstTile::BottomRight, false), [5, 4, 3, 2, 1, 0]);
        assert_eq!(of(FirstTile::TopRight, false), [2, 1, 0, 5, 4, 3]);
        assert_eq!(of(FirstTile::TopLeft, true), [0, 1, 2, 5, 4, 3]);
        assert_eq!(of(FirstTile::BottomRight, true), [5, 4, 3, 0, 1, 2]);
        for (grid, serpentine) in [([2, 3], false), ([2, 3], true), ([3, 4], true), ([3, 4], false)] {
            for first in [FirstTile::BottomLeft, FirstTile::TopLeft, FirstTile::BottomRight, FirstTile::TopRight] {
                let tiles = Tiles { grid, first, serpentine };
                assert!(tiles.reversed().order().into_iter().rev().eq(tiles.order()), "{tiles}");
            }
        }
    }

    #[test]
    fn names_of_quilts_are_read() {
        for (name, right) in [
            ("flower_qs8x6a0.75.png", Some(([6, 8], Some(0.75)))),
            ("qs5x9a1.777.jpg", Some(([9, 5], Some(1.777)))),
            ("My Scene_QS11x6a0.5625.PNG", Some(([6, 11], Some(0.5625)))),
            ("a_qs7x7.png", Some(([7, 7], None))),
            ("a_qs8x6a0.75_v2.png", Some(([6, 8], Some(0.75)))),
            ("a_qs48x1a1.png", Some(([1, 48], Some(1.0)))),
            ("a_qs8x6a.png", None),
            ("a_qs8.png", None),
            ("mosqs8x6a0.75.png", None),
            ("a_qs0x6a0.75.png", None),
            ("a_qs1x1a0.75.png", None),
            ("a_qs8x6b.png", None),
            ("quilt.png", None),
        ] {
            let found = Quilt::of(Path::new(name)).map(|q| (q.grid, q.aspect));
            assert_eq!(found, right, "{name}");
        }
    }
}
