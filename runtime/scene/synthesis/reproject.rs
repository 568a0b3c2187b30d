//! Makes views from one picture and its disparities.
//!
//! Each pixel is a small piece of surface. It is joined to neighbors of similar depth, and torn from the others. A view
//! displaces its corners, so joined pieces stretch without cracks. The pieces are drawn from near to far, and each
//! takes the uncovered part of the pixels on which it falls. Near content therefore covers far content, and outlines
//! keep their partial coverage. Behind every tear the far surface is continued once for all views. Content that appears
//! from behind is then the same from everywhere, so it refocuses. The continuation is a mirror image of the surface and
//! not a smear.

use rayon::prelude::*;

/// A difference of disparity that opens more than this many pixels in the outermost view is a tear.
const TEAR: f32 = 1.5;

/// Number of colors of a picture. All three are used, because they show the mixture at edges together.
const C: usize = 3;

/// The neighbors of a pixel, with the closest first.
const AROUND: [(i64, i64); 8] = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)];

/// A picture with disparities, prepared for rendering from any view.
pub(crate) struct Relief {
    height: usize,
    width: usize,
    /// Pieces of the surface, from near to far.
    pieces: Vec<Piece>,
}

/// The piece of surface of one pixel.
#[derive(Clone, Copy)]
struct Piece {
    x: f32,
    y: f32,
    disparity: f32,
    /// Disparities of its left, right, upper and lower edge.
    edges: [f32; 4],
    /// Covered share of its area.
    opacity: f32,
    color: [f32; C],
}

/// The picture and its disparities, continued beyond the frame by mirroring.
struct Padded {
    height: usize,
    width: usize,
    pad: usize,
    disparity: Vec<f32>,
    color: Vec<[f32; C]>,
}

/// Builds the relief of a picture. `disparity` is in pixels between neighboring views (positive towards the camera),
/// and the outermost view is `reach` views from the center. Each plane is `height * width`.
pub(crate) fn relief(planes: &[Vec<f32>], disparity: &[f32], [height, width]: [usize; 2], reach: f32) -> Relief {
    let tear = TEAR / reach.max(0.5);
    let mut sharp = disparity.to_vec();
    for _ in 0..2 {
        sharp = snap(&sharp, height, width, tear);
    }
    let (low, high) = sharp.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let pad = (low.abs().max(high.abs()) * reach).ceil() as usize + 2;
    let mut front = Padded::new(planes, &sharp, height, width, pad);
    let fringe = front.unmix(tear);
    let hidden = front.behind(((high - low) * reach).ceil() as usize + 2, tear);
    let mut pieces = fringe;
    pieces.par_extend(front.cut(&front.disparity, |_| true, &front.color, tear));
    // The far layer is the picture where nothing is in front, and its continuation behind content in front.
    let far: Vec<f32> = hidden.iter().zip(&front.disparity).map(|(h, &d)| h.map_or(d, |(d, _)| d)).collect();
    let colors: Vec<[f32; C]> = hidden.iter().zip(&front.color).map(|(h, &c)| h.map_or(c, |(_, c)| c)).collect();
    pieces.par_extend(front.cut(&far, |i| hidden[i].is_some(), &colors, tear));
    Relief { height, width, pieces: from_near_to_far(&pieces) }
}

/// Sorts pieces from near to far. Pieces of one depth stay in reading order.
fn from_near_to_far(pieces: &[Piece]) -> Vec<Piece> {
    // The bits have the order of `f32::total_cmp`. Numbers are shorter than pieces, and so they sort faster.
    let key = |disparity: f32| {
        let bits = disparity.to_bits();
        if bits >> 31 == 0 { !(bits | 1 << 31) } else { bits }
    };
    let number = |(i, piece): (usize, &Piece)| u64::from(key(piece.disparity)) << 32 | i as u64;
    let mut order: Vec<u64> = pieces.par_iter().enumerate().map(number).collect();
    order.par_sort_unstable();
    order.par_iter().map(|number| pieces[*number as u32 as usize]).collect()
}

/// Sharpens edges of a map, which are often one or two pixels wide. Values in between take the closer side.
fn snap(values: &[f32], height: usize, width: usize, tear: f32) -> Vec<f32> {
    let mut out = values.to_vec();
    out.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, out)| {
        for (x, out) in out.iter_mut().enumerate() {
            let here = values[y * width + x];
            let (mut low, mut high) = (here, here);
            for j in y.saturating_sub(1)..(y + 2).min(height) {
                for i in x.saturating_sub(1)..(x + 2).min(width) {
                    low = low.min(values[j * width + i]);
                    high = high.max(values[j * width + i]);
                }
            }
            if high - low > tear {
                *out = if high - here < here - low { high } else { low };
            }
        }
    });
    out
}

impl Padded {
    fn new(planes: &[Vec<f32>], disparity: &[f32], height: usize, width: usize, pad: usize) -> Self {
        let mirror = |i: usize, n: usize| {
            let period = 2 * n as i64;
            let at = (i as i64 - pad as i64).rem_euclid(period);
            at.min(period - 1 - at) as usize
        };
        let (tall, wide) = (height + 2 * pad, width + 2 * pad);
        let columns: Vec<usize> = (0..wide).map(|i| mirror(i, width)).collect();
        let place = |p: usize| mirror(p / wide, height) * width + columns[p % wide];
        let pixels = (0..tall * wide).into_par_iter().map(place);
        Self {
            height: tall,
            width: wide,
            pad,
            disparity: pixels.clone().map(|p| disparity[p]).collect(),
            color: pixels.map(|p| std::array::from_fn(|k| planes[k][p])).collect(),
        }
    }

    /// Removes the near side's color from pixels on the far rim of a tear, where pictures are smooth and maps are not.
    /// It returns the removed share as pieces of the near surface that cover the same share of the pixel. The picture
    /// from the center stays the same.
    fn unmix(&mut self, tear: f32) -> Vec<Piece> {
        let (h, w) = (self.height as i64, self.width as i64);
        let at = |x: i64, y: i64| ((0..w).contains(&x) && (0..h).contains(&y)).then(|| (y * w + x) as usize);
        let found: Vec<(usize, [f32; C], Piece)> = (0..self.disparity.len())
            .into_par_iter()
            .filter_map(|p| {
                let here = self.disparity[p];
                let (x, y) = (p as i64 % w, p as i64 / w);
                let rises = |&(dx, dy): &(i64, i64)| at(x + dx, y + dy).filter(|&q| self.disparity[q] > here + tear);
                let (&(dx, dy), near) = AROUND.iter().find_map(|d| Some((d, rises(d)?)))?;
                let level = self.disparity[near];
                let alike = |q: &usize, depth: f32| (self.disparity[*q] - depth).abs() <= tear;
                // Pure colors are one pixel further in, and two pixels further out.
                let front = self.color[at(x + 2 * dx, y + 2 * dy).filter(|q| alike(q, level)).unwrap_or(near)];
                let clean = |k: i64| at(x - k * dx, y - k * dy).filter(|q| alike(q, here));
                let back = self.color[clean(2).or_else(|| clean(1))?];
                // This color is approximated by back + share (front - back).
                let (mut dot, mut norm) = (0.0, 0.0);
                for k in 0..C {
                    dot += (self.color[p][k] - back[k]) * (front[k] - back[k]);
                    norm += (front[k] - back[k]).powi(2);
                }
                // Less than half of the pixel is near, because otherwise the map would show that. The color must also
                // be such a mixture, which excludes texture.
                let share = (dot / norm.max(1e-6)).min(0.6);
                let rest = |k: usize| self.color[p][k] - back[k] - share * (front[k] - back[k]);
                let strange: f32 = (0..C).map(|k| rest(k).powi(2)).sum();
                if share < 0.03 || strange > 0.05 * share * share * norm {
                    return None;
                }
                let [x, y] = [x, y].map(|v| v as f32 - self.pad as f32);
                Some((p, back, Piece { x, y, disparity: level, edges: [level; 4], opacity: share, color: front }))
            })
            .collect();
        let mut pieces = Vec::with_capacity(found.len());
        for (p, back, piece) in found {
            self.color[p] = back;
            pieces.push(piece);
        }
        pieces
    }

    /// Returns disparity and color of the far surface behind pixels that are within `reach` of a tear on its near side.
    fn behind(&self, reach: usize, tear: f32) -> Vec<Option<(f32, [f32; C])>> {
        let (h, w) = (self.height as i64, self.width as i64);
        let at = |x: i64, y: i64| ((0..w).contains(&x) && (0..h).contains(&y)).then(|| (y * w + x) as usize);
        // Pixels on the far rim of a tear.
        let rim: Vec<bool> = (0..self.disparity.len())
            .into_par_iter()
            .map(|p| {
                let (x, y) = (p as i64 % w, p as i64 / w);
                let nearer = |q: usize| self.disparity[q] > self.disparity[p] + tear;
                AROUND.iter().any(|&(dx, dy)| at(x + dx, y + dy).is_some_and(nearer))
            })
            .collect();
        // For each pixel, the nearest rim that is farther than the pixel itself, propagated from neighbor to neighbor.
        let mut nearest: Vec<Option<u32>> = vec![None; rim.len()];
        let distance = |p: usize, rim: u32| {
            let (dx, dy) = (p as i64 % w - i64::from(rim) % w, p as i64 / w - i64::from(rim) / w);
            dx * dx + dy * dy
        };
        // All other pixels are farther from every rim.
        let close = near_any(&rim, self.width, reach);
        let reach = (reach * reach) as i64;
        for sweep in 0..4 {
            for step in 0..close.len() {
                let p = close[if sweep % 2 == 0 { step } else { close.len() - 1 - step }] as usize;
                let (x, y) = (p as i64 % w, p as i64 / w);
                for (dx, dy) in AROUND {
                    let Some(q) = at(x + dx, y + dy) else { continue };
                    for candidate in [nearest[q], rim[q].then_some(q as u32)].into_iter().flatten() {
                        let far = self.disparity[candidate as usize] < self.disparity[p] - tear;
                        let d = distance(p, candidate);
                        if far && d <= reach && nearest[p].is_none_or(|old| d < distance(p, old)) {
                            nearest[p] = Some(candidate);
                        }
                    }
                }
            }
        }
        let fill = |(p, rim): (usize, &Option<u32>)| {
            let rim = (*rim)? as usize;
            let (px, py) = (p as i64 % w, p as i64 / w);
            let (rx, ry) = (rim as i64 % w, rim as i64 / w);
            let depth = self.disparity[rim];
            let same = |q: &usize| (self.disparity[*q] - depth).abs() <= tear;
            // The color comes from the mirror image behind the rim, a little further out, because colors at an outline
            // are mixed.
            let length = (((rx - px).pow(2) + (ry - py).pow(2)) as f64).sqrt();
            let out = |steps: f64| {
                let along = |from: i64, to: i64| from + ((to - from) as f64 / length * steps).round() as i64;
                at(along(px, rx), along(py, ry)).filter(same)
            };
            let tries = [2.0 * length + 2.0, 1.5 * length + 2.0, length + 3.0, length + 2.0, length + 1.0];
            let from = tries.into_iter().find_map(out).unwrap_or(rim);
            Some((depth, self.color[from]))
        };
        let filled: Vec<Option<(f32, [f32; C])>> = nearest.par_iter().enumerate().map(fill).collect();
        // Neighbors that are mirrored at different rims can differ. An average over 3 x 3 pixels avoids lines.
        let soften = |p: usize| {
            let (depth, color) = filled[p]?;
            let (x, y) = (p as i64 % w, p as i64 / w);
            let (mut sum, mut count) = (color, 1.0);
            for (dx, dy) in AROUND {
                let Some((d, c)) = at(x + dx, y + dy).and_then(|q| filled[q]) else { continue };
                if (d - depth).abs() <= tear {
                    sum.iter_mut().zip(c).for_each(|(s, c)| *s += c);
                    count += 1.0;
                }
            }
            Some((depth, sum.map(|s| s / count)))
        };
        (0..filled.len()).into_par_iter().map(soften).collect()
    }

    /// Cuts the pixels that `wanted` selects into pieces, which are joined to their neighbors in the layer.
    fn cut(
        &self,
        disparity: &[f32],
        wanted: impl Fn(usize) -> bool + Sync + Send,
        color: &[[f32; C]],
        tear: f32,
    ) -> impl ParallelIterator<Item = Piece> {
        let (h, w) = (self.height, self.width);
        let piece = move |p: usize| {
            let (x, y, here) = (p % w, p / w, disparity[p]);
            let edge = |exists: bool, q: usize| {
                if exists && (disparity[q] - here).abs() <= tear { 0.5 * (disparity[q] + here) } else { here }
            };
            let edges = [
                edge(x > 0, p.wrapping_sub(1)),
                edge(x + 1 < w, p + 1),
                edge(y > 0, p.wrapping_sub(w)),
                edge(y + 1 < h, p + w),
            ];
            let [x, y] = [x, y].map(|v| v as f32 - self.pad as f32);
            Piece { x, y, disparity: here, edges, opacity: 1.0, color: color[p] }
        };
        (0..h * w).into_par_iter().filter(move |p| wanted(*p)).map(piece)
    }
}

/// Returns the pixels within `reach` rows and columns of any marked one, in reading order.
fn near_any(marked: &[bool], width: usize, reach: usize) -> Vec<u32> {
    let spread = |line: Vec<bool>| {
        let mut near = vec![false; line.len()];
        for forward in [true, false] {
            // Distance to the last marked one on this side.
            let mut since = usize::MAX;
            for step in 0..line.len() {
                let at = if forward { step } else { line.len() - 1 - step };
                since = if line[at] { 0 } else { since.saturating_add(1) };
                near[at] |= since <= reach;
            }
        }
        near
    };
    let rows: Vec<bool> = marked.par_chunks(width.max(1)).flat_map_iter(|row| spread(row.to_vec())).collect();
    let column = |x: usize| spread(rows.iter().skip(x).step_by(width).copied().collect());
    let columns: Vec<Vec<bool>> = (0..width).into_par_iter().map(column).collect();
    (0..marked.len()).filter(|p| columns[p % width][p / width]).map(|p| p as u32).collect()
}

/// The light and the coverage of a pixel of a view by the pieces until now.
#[derive(Clone, Copy, Default)]
struct Pixel {
    color: [f32; C],
    covered: f32,
    /// Disparity, in proportion to the coverage.
    depth: f32,
}

impl Relief {
    /// Returns the bytes in memory.
    pub fn bytes(&self) -> u64 {
        (self.pieces.capacity() * size_of::<Piece>()) as u64
    }

    /// Returns the picture from `u` columns and `v` rows of views from the center, as one plane per color.
    pub fn view(&self, u: f32, v: f32) -> Vec<Vec<f32>> {
        let (h, w) = (self.height, self.width);
        let mut pixels = vec![Pixel::default(); h * w];
        for piece in &self.pieces {
            let left = (piece.x - u * piece.edges[0]).max(0.0);
            let right = (piece.x + 1.0 - u * piece.edges[1]).min(w as f32);
            let top = (piece.y - v * piece.edges[2]).max(0.0);
            let bottom = (piece.y + 1.0 - v * piece.edges[3]).min(h as f32);
            if right <= left || bottom <= top {
                continue;
            }
            for j in top as usize..(bottom.ceil() as usize).min(h) {
                let tall = bottom.min(j as f32 + 1.0) - top.max(j as f32);
                let row = &mut pixels[j * w..(j + 1) * w];
                for (i, pixel) in row.iter_mut().enumerate().take(right.ceil() as usize).skip(left as usize) {
                    let free = 1.0 - pixel.covered;
                    if free <= 0.0 {
                        continue;
                    }
                    // The factor 1.01 is needed because pieces do not tile exactly where a surface bends both ways.
                    let area = tall * (right.min(i as f32 + 1.0) - left.max(i as f32)) * piece.opacity;
                    let share = (area * 1.01).min(free);
                    pixel.covered += share;
                    pixel.depth += share * piece.disparity;
                    pixel.color.iter_mut().zip(piece.color).for_each(|(c, k)| *c += share * k);
                }
            }
        }
        let color = self.closed(&pixels, u, v);
        (0..C).map(|k| color.iter().map(|c| c[k].max(0.0)).collect()).collect()
    }

    /// Returns the colors. Pixels that no piece covers take the farther one of the two sides along the direction of the
    /// parallax.
    fn closed(&self, pixels: &[Pixel], u: f32, v: f32) -> Vec<[f32; C]> {
        let length = (u * u + v * v).sqrt().max(1e-6);
        let (du, dv) = if u * u + v * v > 0.0 { (u / length, v / length) } else { (1.0, 0.0) };
        let known = |pixel: &Pixel| pixel.color.map(|k| k / pixel.covered.max(1e-6));
        let far = |q: usize| (pixels[q].covered > 0.5).then(|| pixels[q].depth / pixels[q].covered);
        let closed = |(p, pixel): (usize, &Pixel)| {
            if pixel.covered > 0.5 {
                return known(pixel);
            }
            let mut color = pixel.color;
            if let Some(q) = farther_side([self.height, self.width], p, [du, dv], far) {
                let rest = 1.0 - pixel.covered;
                color.iter_mut().zip(known(&pixels[q])).for_each(|(c, k)| *c += rest * k);
            }
            color
        };
        pixels.par_iter().enumerate().map(closed).collect()
    }
}

/// Returns the farther one of the nearest pixels with a disparity before and behind pixel `p` along a direction (x, y).
pub(crate) fn farther_side(
    [height, width]: [usize; 2],
    p: usize,
    [du, dv]: [f32; 2],
    disparity: impl Fn(usize) -> Option<f32>,
) -> Option<usize> {
    let (x, y) = ((p % width) as f32, (p / width) as f32);
    let search = |sign: f32| {
        let steps = (1..width + height).map(|k| sign * k as f32);
        let mut pixels = steps.map_while(|k| {
            let (x, y) = ((x + k * du).round(), (y + k * dv).round());
            let inside = x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32;
            inside.then_some(y as usize * width + x as usize)
        });
        pixels.find_map(|q| Some((q, disparity(q)?)))
    };
    match (search(1.0), search(-1.0)) {
        (Some(a), Some(b)) => Some(if a.1 <= b.1 { a.0 } else { b.0 }),
        (a, b) => a.or(b).map(|(q, _)| q),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pixels_near_a_marked_one_are_found() {
        let (height, width) = (13, 17);
        let marked: Vec<bool> = (0..height * width).map(|i| (i * 7919) % 61 == 3).collect();
        for reach in [0, 1, 4, 40] {
            let near = |p: usize| {
                (0..marked.len()).any(|q| {
                    let apart = (p / width).abs_diff(q / width).max((p % width).abs_diff(q % width));
                    marked[q] && apart <= reach
                })
            };
            let wanted: Vec<u32> = (0..marked.len()).filter(|p| near(*p)).map(|p| p as u32).collect();
            assert_eq!(near_any(&marked, width, reach), wanted, "{reach}");
        }
        assert!(near_any(&[false; 12], 4, 9).is_empty() && near_any(&[], 0, 1).is_empty());
    }

    /// Numbers of all signs, with equal ones in reading order.
    #[test]
    fn pieces_come_from_near_to_far() {
        let disparities = [0.5, -0.0, 2.0, -3.0, 0.0, 2.0, -0.25, f32::INFINITY];
        let piece = |(i, disparity): (usize, &f32)| Piece {
            x: i as f32,
            y: 0.0,
            disparity: *disparity,
            edges: [0.0; 4],
            opacity: 1.0,
            color: [0.0; C],
        };
        let pieces: Vec<Piece> = disparities.iter().enumerate().map(piece).collect();
        let mut wanted = pieces.clone();
        wanted.sort_by(|a, b| b.disparity.total_cmp(&a.disparity));
        let places = |pieces: &[Piece]| pieces.iter().map(|piece| piece.x).collect::<Vec<_>>();
        assert_eq!(places(&from_near_to_far(&pieces)), places(&wanted));
        assert_eq!(places(&wanted), [7.0, 2.0, 5.0, 0.0, 4.0, 1.0, 6.0, 3.0]);
    }
}
