//! Computes the JOD of some pupils of each group, over all colors together.

use super::results::Row;
use eyebox::low_level::evaluate::{Group, JodMetric, Member, rgb};
use eyebox::low_level::optics::{Color, Display};
use eyebox::low_level::quality::QualityError;

/// The pictures of one color, at full size, with their exposure.
pub struct Whole<'a> {
    pub color: Color,
    /// One picture per pupil that is judged.
    pub pictures: &'a [Vec<f32>],
    /// The factor of the pictures.
    pub exposure: f64,
}

/// Returns the indices of the members to judge. There are at most `most` per group, spread evenly over it.
pub fn judged(members: &[Member], most: usize) -> Vec<usize> {
    let of_group = |group: Group| {
        let all: Vec<usize> = (0..members.len()).filter(|i| members[*i].group == group).collect();
        let count = most.min(all.len());
        (0..count).map(move |i| all[i * all.len() / count]).collect::<Vec<_>>()
    };
    Group::ALL.into_iter().flat_map(of_group).collect()
}

/// Writes the JOD into the rows of the members at `places`. An eye sees all colors at once, so the rows of all colors
/// receive the same value. `went` is called before each pupil, and its error ends the computation.
pub fn judge(
    [seen, wanted]: [&[Whole]; 2],
    (places, members): (&[usize], &[Member]),
    (display, [height, width]): (&Display, [usize; 2]),
    rows: &mut [Row],
    went: &mut dyn FnMut() -> Result<(), QualityError>,
) -> Result<(), QualityError> {
    if places.is_empty() {
        return Ok(());
    }
    let metric = JodMetric::new(&display.viewing, display.pixels_per_degree(), false)?;
    let black = vec![0.0; height * width];
    for (at, place) in places.iter().enumerate() {
        went()?;
        let exposed = |of: &[Whole]| -> Vec<Vec<f32>> {
            of.iter().map(|w| w.pictures[at].iter().map(|v| v * w.exposure as f32).collect()).collect()
        };
        let [seen_planes, wanted_planes] = [exposed(seen), exposed(wanted)];
        let [seen_planes, wanted_planes] = [named(seen, &seen_planes), named(wanted, &wanted_planes)];
        let pictures = [rgb(&seen_planes, &black), rgb(&wanted_planes, &black)];
        let jod = metric.picture(&pictures[0], &pictures[1], height, width)?.map(|judged| judged.jod);
        let member = &members[*place];
        let index = members[..*place].iter().filter(|m| m.group == member.group).count();
        rows.iter_mut().filter(|r| r.group == member.group && r.index == index).for_each(|r| r.jod = jod);
    }
    Ok(())
}

/// Pairs the planes with the names of their colors.
fn named<'a>(of: &[Whole], planes: &'a [Vec<f32>]) -> Vec<(Option<Color>, &'a [f32])> {
    of.iter().map(|w| Some(w.color)).zip(planes.iter().map(|p| &p[..])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::evaluate::members;
    use eyebox::low_level::optics::Pupil;

    #[test]
    fn a_few_of_each_group_are_judged_and_all_their_colours_are_told() {
        let random = [Pupil { x: 0.0, y: 0.0, diameter: 4e-3, depth: 0.0 }; 24];
        let all = members(22e-3, [-2e-3, 3e-3], &random);
        let places = judged(&all, 4);
        assert_eq!(places.len(), 20);
        assert!(Group::ALL.iter().all(|g| places.iter().filter(|p| all[**p].group == *g).count() == 4));
        assert_eq!((judged(&all, 1000).len(), judged(&all, 0).len()), (all.len(), 0));
        let display = Display { height: 16, width: 16, ..Display::preset("small").unwrap() };
        let flat = vec![vec![0.5f32; 256]; 2];
        let spotted: Vec<f32> = (0..256).map(|i| if i % 3 == 0 { 0.9 } else { 0.3 }).collect();
        let whole = |color, pictures, exposure| Whole { color, pictures, exposure };
        let bad = [flat[0].clone(), spotted];
        let seen = [whole(Color::Red, &flat[..], 1.0), whole(Color::Green, &bad[..], 1.0)];
        let wanted = [whole(Color::Red, &flat[..], 1.0), whole(Color::Green, &flat[..], 1.0)];
        let row = |color, index| Row {
            color,
            group: Group::VaryingAperture,
            index,
            pupil_mm: [0.0; 4],
            focus_dioptres: 0.0,
            psnr: Some(30.0),
            ceiling: None,
            ssim: None,
            jod: None,
        };
        let mut rows: Vec<Row> =
            [Color::Red, Color::Green].into_iter().flat_map(|c| (0..3).map(move |i| row(c, i))).collect();
        let display = Display { viewing: display.viewing.with(None, None, Some(20.0)).unwrap(), ..display };
        judge([&seen, &wanted], (&[0, 2], &all), (&display, [16, 16]), &mut rows, &mut || Ok(())).unwrap();
        let of = |i: usize| rows[i].jod;
        assert!(of(0) == Some(10.0) && of(3) == of(0) && of(1).is_none() && of(4).is_none());
        assert!(of(2).unwrap() < 9.0 && of(5) == of(2), "{:?}", of(2));
    }
}
