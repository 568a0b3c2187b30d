//! Renders the target images and the images of a hologram through all pupils, and compares them.

use super::judged::{Whole, judge};
use super::picture;
use super::pupils::{Pupils, SHOWN};
use super::results::{ColorError, ColorFigures, Row, Run, SceneFigures, mean};
use super::shown::{EnergyMap, Picture, Pictures};
use crate::watch::JobObserver;
use eyebox::low_level::engine::{Buffer, Engine};
use eyebox::low_level::evaluate::{self, Ceiling, Group, Member, Plane, RowFinder, Sums};
use eyebox::low_level::hologram::Hologram;
use eyebox::low_level::optics::{Color, Display, Padding, Pupil, WindowFactor, dioptres};
use eyebox::low_level::plan::{ModelTables, Planner, Purpose};
use eyebox::low_level::quality::QualityError;
use eyebox::low_level::scene::{LightField, central_depth};
use eyebox::low_level::solve::Problem;
use std::sync::Arc;

/// The number of pupils per batch. All images of a batch are in memory together.
const TOGETHER: usize = 8;
/// The limit of a PSNR, in dB. A higher value only means that the images are equal.
const HIGHEST_DB: f64 = 200.0;
/// The distance in pixels from a step in depth that counts as its edge.
const EDGE_REACH: usize = 3;
/// The smallest step in depth that makes an edge, as a share of the scene's range of depth.
const EDGE_STEP: f64 = 0.1;
/// The factor of the error pictures.
pub(crate) const ERROR_GAIN: f64 = 4.0;
/// The range of the energy maps in decades, around an even eyebox.
pub(crate) const DECADES: [f64; 2] = [-2.0, 2.0];

/// The images of one color through all pupils, in linear light and without exposure.
struct Looks {
    color: Color,
    /// One image per member of the groups, after 2 x 2 averaging.
    pooled: Vec<Vec<f32>>,
    /// The images through the shown pupils, at full size.
    chosen: Vec<Vec<f32>>,
    /// The images through the pupils that are judged, at full size.
    judged: Vec<Vec<f32>>,
    /// The images of the focal strip, at full size.
    strip: Vec<Vec<f32>>,
    /// The image row of each sweep, after 2 x 2 averaging, as (places, half the width).
    slices: [Vec<f32>; 2],
    /// For target images, the diffraction limit of each member of the groups. Empty if it is unknown.
    ceilings: Vec<Ceiling>,
}

/// The target images of a scene.
pub struct Wanted {
    looks: Vec<Looks>,
    /// Rows and columns of a picture at full size.
    size: [usize; 2],
    /// Rows and columns after 2 x 2 averaging.
    pooled: [usize; 2],
    /// The pixels near edges in depth, after 2 x 2 averaging.
    edges: Option<Vec<bool>>,
    /// The row of the averaged picture whose slices are used.
    row: usize,
    /// The longest side of the stored pictures, in pixels.
    longest: usize,
}

type Take<'a> = dyn FnMut(&[Pupil]) -> Result<Vec<Vec<f32>>, QualityError> + 'a;

impl Looks {
    /// Renders the images through all pupils with `take`, which may also report progress and stop the work.
    fn of(color: Color, pupils: &Pupils, size: [usize; 2], row: usize, take: &mut Take) -> Result<Self, QualityError> {
        let [height, width] = size;
        let places: Vec<usize> = SHOWN.iter().map(|c| pupils.place(c)).collect();
        let mut shown = vec![Vec::new(); SHOWN.len()];
        let (mut pooled, mut judged) = (Vec::new(), Vec::new());
        let members: Vec<Pupil> = pupils.members.iter().map(|m| m.pupil).collect();
        for some in members.chunks(TOGETHER) {
            for image in take(some)? {
                for (_, shown) in places.iter().zip(&mut shown).filter(|(at, _)| **at == pooled.len()) {
                    shown.clone_from(&image);
                }
                let is_judged = pupils.judged.contains(&pooled.len());
                pooled.push(evaluate::pool2(&image, height, width));
                judged.extend(is_judged.then_some(image));
            }
        }
        let strip = take(&pupils.strip)?;
        let [_, w] = halved(size);
        let mut slices = [Vec::new(), Vec::new()];
        for (sweep, slice) in pupils.sweeps.iter().zip(&mut slices) {
            for some in sweep.chunks(TOGETHER) {
                for image in take(some)? {
                    slice.extend_from_slice(&evaluate::pool2(&image, height, width)[row * w..][..w]);
                }
            }
        }
        Ok(Self { color, pooled, chosen: shown, judged, strip, slices, ceilings: Vec::new() })
    }
}

/// Returns rows and columns after 2 x 2 averaging.
fn halved([height, width]: [usize; 2]) -> [usize; 2] {
    if height < 2 || width < 2 { [height, width] } else { [height / 2, width / 2] }
}

/// Renders the target images of a scene through all pupils.
pub fn wanted(
    field: &LightField,
    display: &Display,
    pupils: &Pupils,
    depth: [f64; 2],
    longest: usize,
    engine: &mut dyn Engine,
    watch: &JobObserver,
) -> Result<Wanted, QualityError> {
    let size = display.picture_size().into();
    let pooled = halved(size);
    // The color that is nearest to perceived brightness decides the row.
    let leading = leading(&field.colors);
    let planner = load_views(field, leading, display, engine)?;
    let mut finder = RowFinder::new(pooled[0], pooled[1]);
    for some in pupils.sweeps.iter().flat_map(|s| s.chunks(TOGETHER)) {
        for photograph in evaluate::photographs(engine, &planner, some)? {
            finder.add(&evaluate::pool2(&photograph, size[0], size[1]));
        }
    }
    let row = finder.row();
    let mut looks = Vec::new();
    for &color in &field.colors {
        let planner = load_views(field, color, display, engine)?;
        let mut take = |some: &[Pupil]| Ok(evaluate::photographs(engine, &planner, some)?);
        let mut look = Looks::of(color, pupils, size, row, &mut take)?;
        look.ceilings = ceilings(&look, display, pupils, pooled, watch)?;
        looks.push(look);
    }
    let step = EDGE_STEP * (depth[1] - depth[0]);
    let depths = central_depth(field, display);
    let edges = (field.colors.len() == 3 && step > 0.0 && depths.len() == size[0] * size[1]).then(|| {
        let near = evaluate::edges(&depths, size[0], size[1], step as f32, EDGE_REACH);
        evaluate::pool_mask(&near, size[0], size[1])
    });
    Ok(Wanted { looks, size, pooled, edges, row, longest })
}

/// Returns the diffraction limits of the target images of one color, if they are whole pictures of the SLM.
fn ceilings(
    look: &Looks,
    display: &Display,
    pupils: &Pupils,
    [rows, columns]: [usize; 2],
    watch: &JobObserver,
) -> Result<Vec<Ceiling>, QualityError> {
    let optics = display.optics(look.color)?;
    if display.picture_share(optics.wavelength) < 1.0 {
        return Ok(Vec::new());
    }
    let of = |(member, values): (&Member, &Vec<f32>)| {
        watch.check()?;
        Ok(Ceiling::new(&optics, &member.pupil, &Plane { rows, columns, values: values.clone() }))
    };
    pupils.members.iter().zip(&look.pooled).map(of).collect()
}

fn load_views(
    field: &LightField,
    color: Color,
    display: &Display,
    engine: &mut dyn Engine,
) -> Result<Planner, QualityError> {
    let problem = Problem::new(field, color, display, Padding::default())?;
    let planner = problem.planner(1, WindowFactor::Full);
    engine.load(&planner.shape(Purpose::View), Some(Arc::clone(&problem.pyramid)))?;
    Ok(planner)
}

/// Returns green if it is among the colors, and otherwise the first color.
pub fn leading(colors: &[Color]) -> Color {
    if colors.contains(&Color::Green) { Color::Green } else { colors[0] }
}

/// Returns the figures of the scene itself for the report.
pub(crate) fn scene_figures(
    name: &str,
    field: &LightField,
    depth: [f64; 2],
    display: &Display,
    wanted: &Wanted,
) -> SceneFigures {
    let exposures = vec![1.0; wanted.looks.len()];
    let [height, width] = wanted.size;
    let views = (0..SHOWN.len()).map(|i| {
        let planes = planes(&wanted.looks, &exposures, |l| &l.chosen[i]);
        picture::light(&borrow(&planes), height, width, wanted.longest, None)
    });
    SceneFigures {
        name: name.into(),
        views: field.grid,
        depth_mm: depth.map(|z| z * 1e3),
        depth_dioptres: depth.map(|z| dioptres(z, display.focal_length)),
        row: 2 * wanted.row,
        pictures: Pictures {
            views: views.collect(),
            strip: strip(&wanted.looks, &exposures, wanted.size, wanted.longest),
            epipolar: epipolar(&wanted.looks, &exposures, wanted.pooled[1]),
            ..Pictures::default()
        },
    }
}

type Planes = Vec<(Color, Vec<f32>)>;

fn planes<'a>(looks: &'a [Looks], exposures: &[f64], which: impl Fn(&'a Looks) -> &'a Vec<f32>) -> Planes {
    let exposed = |(look, e): (&'a Looks, &f64)| (look.color, which(look).iter().map(|v| v * *e as f32).collect());
    looks.iter().zip(exposures).map(exposed).collect()
}

fn borrow(planes: &Planes) -> Vec<(Color, &[f32])> {
    planes.iter().map(|(c, p)| (*c, &p[..])).collect()
}

fn strip(looks: &[Looks], exposures: &[f64], [height, width]: [usize; 2], longest: usize) -> Vec<Picture> {
    let count = looks.first().map_or(0, |l| l.strip.len());
    let shown =
        |i: usize| picture::light(&borrow(&planes(looks, exposures, |l| &l.strip[i])), height, width, longest, None);
    (0..count).map(shown).collect()
}

fn epipolar(looks: &[Looks], exposures: &[f64], width: usize) -> Vec<Picture> {
    let shown = |i: usize| {
        let planes = planes(looks, exposures, |l| &l.slices[i]);
        picture::light_exact(&borrow(&planes), planes[0].1.len() / width, width)
    };
    (0..2).map(shown).collect()
}

/// The energy of one color over the spectrum and its variation over the eyebox.
struct Energy {
    map: Vec<f64>,
    size: [usize; 2],
    /// The share of the map's side that the eyebox of all colors takes.
    share: f64,
    variation: f64,
}

/// Renders a hologram through all pupils and compares its images with the target images.
pub fn measure(
    hologram: &Hologram,
    display: &Display,
    pupils: &Pupils,
    wanted: &Wanted,
    engine: &mut dyn Engine,
    watch: &JobObserver,
) -> Result<Run, QualityError> {
    let (mut looks, mut energies) = (Vec::new(), Vec::new());
    for (i, solved) in hologram.colors.iter().enumerate() {
        let planner = Planner::new(hologram.optics(i)?, hologram.frames, WindowFactor::Full)
            .with_padding(hologram.metadata.padding());
        let color = solved.color.unwrap_or(wanted.looks[i].color);
        let model = ModelTables::of(display, color, planner.slm, planner.grid);
        let powers = hologram.powers(i).unwrap_or_default().into();
        let planner = Planner { model, modes: display.modes(color).into(), powers, ..planner };
        engine.load(&planner.shape(Purpose::View), None)?;
        engine.write(Buffer::Phases, &solved.phases)?;
        let map = evaluate::energy(engine, &planner)?;
        let variation = evaluate::variation(&evaluate::passed(&map, &planner.grid, &pupils.grid));
        let share = (display.source_eyebox_min() / planner.grid.eyebox()).min(1.0);
        energies.push(Energy { map, size: [planner.grid.height, planner.grid.width], share, variation });
        let mut take = |some: &[Pupil]| Ok(evaluate::views(engine, &planner, some)?);
        looks.push(Looks::of(color, pupils, wanted.size, wanted.row, &mut take)?);
    }
    let (mut rows, mut colors) = (Vec::new(), Vec::new());
    for ((look, wanted_look), energy) in looks.iter().zip(&wanted.looks).zip(&energies) {
        let exposure = score(look, wanted_look, (pupils, display, wanted.pooled), &mut rows, watch)?;
        let exposed = |s: &Vec<f32>| s.iter().map(|v| v * exposure as f32).collect::<Vec<_>>();
        let slice = |i: usize| finite(Sums::of_images(&exposed(&look.slices[i]), &wanted_look.slices[i])?.quality(1.0));
        let epipolar = [slice(0)?, slice(1)?];
        colors.push(ColorFigures { color: look.color, exposure, variation: energy.variation, epipolar });
    }
    let exposures: Vec<f64> = colors.iter().map(|c| c.exposure).collect();
    let seen = wholes(&looks, &exposures);
    let photographs = wholes(&wanted.looks, &vec![1.0; looks.len()]);
    let judged = (&pupils.judged[..], &pupils.members[..]);
    judge([&seen, &photographs], judged, (display, wanted.size), &mut rows, &mut || watch.check())?;
    Ok(Run {
        scene: String::new(),
        method: String::new(),
        frames: hologram.frames,
        seconds: None,
        color_error: match &wanted.edges {
            Some(edges) => color_error(&looks, &exposures, wanted, (pupils, edges), watch)?,
            None => None,
        },
        pictures: pictures(&looks, &exposures, &energies, wanted, pupils, &rows),
        colors,
        rows,
    })
}

/// Returns the pictures that are judged, with their exposures.
fn wholes<'a>(looks: &'a [Looks], exposures: &[f64]) -> Vec<Whole<'a>> {
    let whole = |(look, &exposure): (&'a Looks, &f64)| Whole { color: look.color, pictures: &look.judged, exposure };
    looks.iter().zip(exposures).map(whole).collect()
}

/// Scores all pupils of one color and returns the exposure.
fn score(
    look: &Looks,
    wanted: &Looks,
    (pupils, display, [h, w]): (&Pupils, &Display, [usize; 2]),
    rows: &mut Vec<Row>,
    watch: &JobObserver,
) -> Result<f64, QualityError> {
    // One exposure serves all pupils. As in photography, the widest pupil sets it, over the focal stack.
    let widest = pupils.members.iter().zip(look.pooled.iter().zip(&wanted.pooled));
    let widest = widest.filter(|(m, _)| m.group == Group::FocalStack);
    let exposure = evaluate::fit_exposure(widest.map(|(_, (s, w))| (&s[..], &w[..])))?;
    let mut scores = Vec::with_capacity(look.pooled.len());
    for (seen, wanted) in look.pooled.chunks(TOGETHER).zip(wanted.pooled.chunks(TOGETHER)) {
        watch.check()?;
        scores.extend(evaluate::compare(seen, wanted, exposure, h, w)?);
    }
    let mut index = 0;
    for (i, (member, score)) in pupils.members.iter().zip(&scores).enumerate() {
        index = if i > 0 && pupils.members[i - 1].group == member.group { index + 1 } else { 0 };
        let (color, group, pupil_mm) = (look.color, member.group, member.pupil.to_mm());
        let focus_dioptres = dioptres(member.pupil.depth, display.focal_length);
        let ceiling = wanted.ceilings.get(i).map(|c| Ceiling::decibels([c])).filter(|db| *db < HIGHEST_DB);
        let (psnr, ssim) = (finite(score.psnr)?, score.ssim);
        rows.push(Row { color, group, index, pupil_mm, focus_dioptres, psnr, ceiling, ssim, jod: None });
    }
    Ok(exposure)
}

fn pictures(
    looks: &[Looks],
    exposures: &[f64],
    energies: &[Energy],
    wanted: &Wanted,
    pupils: &Pupils,
    rows: &[Row],
) -> Pictures {
    let ([height, width], [h, w]) = (wanted.size, wanted.pooled);
    let mut pictures = Pictures {
        strip: strip(looks, exposures, wanted.size, wanted.longest),
        epipolar: epipolar(looks, exposures, w),
        ..Pictures::default()
    };
    for (i, shown) in SHOWN.iter().enumerate() {
        let of_pupil = rows.iter().filter(|r| r.group == shown.group && r.index == shown.index);
        let psnr = mean(of_pupil.filter_map(|r| r.psnr));
        let seen = planes(looks, exposures, |l| &l.chosen[i]);
        pictures.views.push(picture::light(&borrow(&seen), height, width, wanted.longest, psnr));
        let at = pupils.place(shown);
        let seen = planes(looks, exposures, |l| &l.pooled[at]);
        let pairs: Vec<(&[f32], &[f32])> =
            seen.iter().zip(&wanted.looks).map(|((_, s), w)| (&s[..], &w.pooled[at][..])).collect();
        pictures.errors.push(picture::error(&pairs, h, w, wanted.longest, ERROR_GAIN));
    }
    let color = leading(&looks.iter().map(|l| l.color).collect::<Vec<_>>());
    pictures.energy = looks.iter().zip(energies).find(|(l, _)| l.color == color).map(|(_, energy)| {
        let (height, width, map) = picture::shrink(&energy.map, energy.size[0], energy.size[1], wanted.longest);
        let [low, high] = DECADES;
        let levels: Vec<f64> = map.iter().map(|e| (e.max(1e-30).log10() - low) / (high - low)).collect();
        EnergyMap { color, share: energy.share, picture: picture::map(&levels, height, width) }
    });
    pictures
}

fn finite(psnr: Option<f64>) -> Result<Option<f64>, QualityError> {
    if psnr.is_some_and(f64::is_nan) { Err(QualityError::NotFinite) } else { Ok(psnr.map(|db| db.min(HIGHEST_DB))) }
}

/// Computes the mean CIEDE2000 difference over the random pupils, after 2 x 2 averaging.
fn color_error(
    looks: &[Looks],
    exposures: &[f64],
    wanted: &Wanted,
    (pupils, edges): (&Pupils, &[bool]),
    watch: &JobObserver,
) -> Result<Option<ColorError>, QualityError> {
    let channel = |c: usize| looks.iter().position(|l| l.color.channel() == c);
    let [Some(red), Some(green), Some(blue)] = [0, 1, 2].map(channel) else { return Ok(None) };
    let order = [red, green, blue];
    let (mut sums, mut counts) = ([0.0f64; 2], [0usize; 2]);
    for (at, _) in pupils.members.iter().enumerate().filter(|(_, m)| m.group == Group::Random) {
        watch.check()?;
        let seen = order.map(|i| looks[i].pooled[at].iter().map(|v| v * exposures[i] as f32).collect::<Vec<_>>());
        let target = order.map(|i| &wanted.looks[i].pooled[at][..]);
        let difference = evaluate::color_difference([&seen[0], &seen[1], &seen[2]], target);
        for (d, edge) in difference.iter().zip(edges) {
            sums[usize::from(!edge)] += d;
            counts[usize::from(!edge)] += 1;
        }
    }
    let mean = |i: usize| (counts[i] > 0).then(|| sums[i] / counts[i] as f64);
    let share = counts[0] as f64 / (counts[0] + counts[1]).max(1) as f64;
    Ok(Some(ColorError { edges: mean(0), elsewhere: mean(1), share }))
}
