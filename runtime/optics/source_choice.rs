//! Chooses the switchable sources that are lit for a tracked pupil (OPTICS 12).
//!
//! The choice is the nearest source whose eyebox holds the whole pupil. Near a border it is all sources whose eyeboxes
//! the pupil touches. Decisions are pure functions of the expected pupil and of the lit sources.

use super::{Color, Display, EyeboxRegion, Pupil, PupilDistribution, SourcesLit};

/// The lit switchable sources of a display for one color, as the pupil moves.
#[derive(Debug, Clone, PartialEq)]
pub struct SourceChoice {
    /// Sources of the color by their places, with the middles of their eyeboxes in meters.
    sources: Vec<(usize, [f64; 2])>,
    /// Half the side of the eyebox of each source in meters.
    half: f64,
    /// Pairs that may not be lit together.
    apart: Vec<[usize; 2]>,
    /// The lit sources while the pupil is unknown.
    first: Vec<usize>,
    lit: Vec<usize>,
}

/// A source takes over from others only if its eyebox holds the pupil with this margin in meters. Therefore nothing
/// flickers at a border.
const HYSTERESIS: f64 = 0.25e-3;
/// A source that is lit alone must hold this many standard deviations of the pupil's position.
const SPREADS: f64 = 2.0;
/// From this probability on, the pupil may still be at its old place, so the source there stays lit.
const MAY_HAVE_STAYED: f64 = 0.25;
/// The most sources that are lit together, as many as meet in a corner.
const MOST_TOGETHER: usize = 4;

impl SourceChoice {
    /// Makes a choice for one color of a display. It is none if the display's sources do not follow the pupil.
    pub fn new(display: &Display, color: Color) -> Option<Self> {
        let sources = &display.sources;
        let is_steered = matches!(sources.lit, SourcesLit::Steered | SourcesLit::Only(_));
        if sources.is_empty() || !is_steered {
            return None;
        }
        let of = sources.of(color);
        let middle = |at: &usize| (*at, sources.each[*at].eyebox(display.focal_length));
        let pairs = of.iter().flat_map(|a| of.iter().map(move |b| [*a, *b]));
        let apart = pairs.filter(|[a, b]| !sources.may_meet(*a, *b)).collect();
        let first = sources.lit(color, display.focal_length);
        let half = display.optics(color).ok()?.eyebox() / 2.0;
        Some(Self { sources: of.iter().map(middle).collect(), half, apart, lit: first.clone(), first })
    }

    /// The lit sources by their places.
    pub fn lit(&self) -> &[usize] {
        &self.lit
    }

    /// The eyeboxes of the lit sources.
    pub fn regions(&self) -> Vec<EyeboxRegion> {
        let lit = self.sources.iter().filter(|(at, _)| self.lit.contains(at));
        lit.map(|(_, center)| EyeboxRegion { center: *center, size: [2.0 * self.half; 2] }).collect()
    }

    /// Share of a pupil's disc that is in the eyeboxes of these sources, 0 to 1. The remainder is dark.
    pub fn served(&self, lit: &[usize], pupil: &Pupil) -> f64 {
        const ALONG: i32 = 24;
        let radius = pupil.diameter / 2.0;
        let (mut all, mut inside) = (0, 0);
        for (j, i) in (0..ALONG).flat_map(|j| (0..ALONG).map(move |i| (j, i))) {
            let off = [i, j].map(|k| radius * (f64::from(2 * k + 1) / f64::from(ALONG) - 1.0));
            if off[0].hypot(off[1]) > radius {
                continue;
            }
            let within = |middle: &[f64; 2]| {
                (pupil.x + off[0] - middle[0]).abs() <= self.half && (pupil.y + off[1] - middle[1]).abs() <= self.half
            };
            all += 1;
            inside += usize::from(self.sources.iter().any(|(at, middle)| lit.contains(at) && within(middle)));
        }
        inside as f64 / f64::from(all.max(1))
    }

    /// Lights the sources for an unknown pupil again.
    pub fn forget(&mut self) {
        self.lit.clone_from(&self.first);
    }

    /// Chooses the sources for the expected pupil. True if other sources are lit from now on.
    pub fn follow(&mut self, aim: &PupilDistribution) -> bool {
        let chosen = if aim.elsewhere >= 1.0 { self.first.clone() } else { self.choose(aim) };
        let changed = chosen != self.lit;
        self.lit = chosen;
        changed
    }

    /// Distances in meters between the pupil's center and the middle of a source's eyebox, along the farther and the
    /// nearer axis.
    fn apart_by(&self, source: usize, aim: &PupilDistribution) -> [f64; 2] {
        let middle = self.sources.iter().find(|(at, _)| *at == source).map(|(_, middle)| *middle);
        let [x, y] = middle.map_or([f64::INFINITY; 2], |[x, y]| [aim.centre[0] - x, aim.centre[1] - y].map(f64::abs));
        [x.max(y), x.min(y)]
    }

    fn off(&self, source: usize, aim: &PupilDistribution) -> f64 {
        self.apart_by(source, aim)[0]
    }

    fn choose(&self, aim: &PupilDistribution) -> Vec<usize> {
        let reach = SPREADS * aim.spread + 0.5 * aim.diameter[1];
        let holds = |source: usize, spare: f64| self.off(source, aim) <= self.half - reach - spare;
        let stays = self.lit.len() == 1 && holds(self.lit[0], 0.0);
        let mut near: Vec<usize> = self.sources.iter().map(|(at, _)| *at).collect();
        let order = |a: [f64; 2], b: [f64; 2]| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1]));
        near.sort_by(|a, b| order(self.apart_by(*a, aim), self.apart_by(*b, aim)));
        let mut chosen = match near.iter().find(|at| holds(**at, HYSTERESIS)) {
            _ if stays => self.lit.clone(),
            Some(alone) => vec![*alone],
            None => {
                let touches = |at: &usize| {
                    let spare = if self.lit.contains(at) { HYSTERESIS } else { 0.0 };
                    self.off(*at, aim) < self.half + reach + spare
                };
                self.together(near.iter().copied().filter(touches))
            }
        };
        if chosen.is_empty() {
            chosen.extend(near.first());
        }
        if aim.elsewhere >= MAY_HAVE_STAYED {
            chosen = self.together(chosen.into_iter().chain(self.lit.iter().copied()));
        }
        chosen.sort_unstable();
        chosen
    }

    /// The first of these sources that may all be lit together.
    fn together(&self, sources: impl Iterator<Item = usize>) -> Vec<usize> {
        let mut lit: Vec<usize> = Vec::new();
        for source in sources {
            let meets = lit.iter().all(|other| !self.apart.contains(&[*other, source]));
            if meets && !lit.contains(&source) && lit.len() < MOST_TOGETHER {
                lit.push(source);
            }
        }
        lit
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A display with 3 x 3 sources at this spacing, each with an eyebox of 26 mm.
    fn display(spacing: f64) -> Display {
        let places = (0..9).map(|i| [f64::from(i % 3) - 1.0, f64::from(i / 3) - 1.0].map(|at| at * spacing));
        let each: String = places.map(|[x, y]| format!("[[sources]]\neyebox_mm = [{x}, {y}]\n")).collect();
        let text = format!(
            "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nsources_lit = \"steered\"\n\
             wavelengths_nm = {{ green = 520 }}\n{each}"
        );
        Display::from_toml(&text, "b.toml").unwrap()
    }

    fn at(x: f64, y: f64) -> PupilDistribution {
        PupilDistribution::around(&Pupil::from_mm([x, y, 4.0, 0.0]), 0.1e-3)
    }

    fn followed(choice: &mut SourceChoice, x: f64, y: f64) -> Vec<usize> {
        choice.follow(&at(x, y));
        choice.lit().to_vec()
    }

    #[test]
    fn the_source_whose_eyebox_holds_the_pupil_is_lit_and_both_near_a_border() {
        let mut choice = SourceChoice::new(&display(26.0), Color::Green).unwrap();
        assert_eq!(choice.lit(), [4], "the middle, while nothing is known");
        for (x, y, lit) in [
            (0.0, 0.0, &[4][..]),
            (10.0, 0.0, &[4]),
            // The edge is at 13 mm. A pupil of 4.5 mm and twice its spread need 2.45 mm.
            (11.0, 0.0, &[4, 5]),
            (13.0, 13.0, &[4, 5, 7, 8]),
            (26.0, -26.0, &[2]),
            // Beyond all sources, the nearest one stays.
            (60.0, 0.0, &[5]),
        ] {
            assert_eq!(followed(&mut choice, x, y), lit, "at ({x}, {y})");
        }
        // At a border there is no flicker. Both sources stay lit until one holds the pupil with a margin of a quarter
        // of a millimeter.
        assert_eq!(followed(&mut choice, 11.0, 0.0), [4, 5]);
        assert_eq!(followed(&mut choice, 10.4, 0.0), [4, 5]);
        assert_eq!(followed(&mut choice, 10.2, 0.0), [4]);
        assert_eq!(followed(&mut choice, 10.4, 0.0), [4]);
        // The spacing is an eyebox less the pupil and its margin, so one source always holds all of it.
        let mut close = SourceChoice::new(&display(20.7), Color::Green).unwrap();
        assert!((-300..300).all(|i| followed(&mut close, 0.1 * f64::from(i), 0.0).len() == 1));
    }

    #[test]
    fn the_source_before_stays_lit_while_the_pupil_may_be_there() {
        let mut choice = SourceChoice::new(&display(26.0), Color::Green).unwrap();
        let jump = PupilDistribution { elsewhere: 0.4, ..at(26.0, 0.0) };
        assert!(choice.follow(&jump));
        assert_eq!(choice.lit(), [4, 5]);
        assert!(choice.follow(&at(26.0, 0.0)) && choice.lit() == [5]);
        assert!(choice.follow(&PupilDistribution { elsewhere: 1.0, ..at(26.0, 0.0) }) && choice.lit() == [4]);
    }

    #[test]
    fn a_pupil_on_the_border_has_half_of_its_light_from_each_side() {
        let choice = SourceChoice::new(&display(26.0), Color::Green).unwrap();
        let served = |lit: &[usize], x: f64| choice.served(lit, &Pupil::from_mm([x, 0.0, 4.0, 0.0]));
        assert_eq!(
            [served(&[4], 13.0), served(&[4, 5], 13.0), served(&[4], 10.0), served(&[4], 16.0)],
            [0.5, 1.0, 1.0, 0.0]
        );
    }

    #[test]
    fn what_may_not_be_lit_together_is_not() {
        let mut display = display(26.0);
        display.sources.each[4].with = Some(vec![]);
        let mut choice = SourceChoice::new(&display, Color::Green).unwrap();
        assert_eq!(followed(&mut choice, 12.0, 0.0), [4]);
        assert_eq!(followed(&mut choice, 14.0, 0.0), [5]);
    }

    /// For any path of the pupil and any steps, a source is lit that the pupil touches.
    #[test]
    fn no_pupil_in_the_eyebox_meets_the_dark() {
        let mut choice = SourceChoice::new(&display(26.0), Color::Green).unwrap();
        for i in 0..20_000u32 {
            let place = |k: u32| -38.0 + 76.0 * f64::from(i.wrapping_mul(k) % 9973) / 9973.0;
            let aim = at(place(7919), place(104_729));
            choice.follow(&aim);
            assert!(choice.lit().iter().any(|lit| choice.off(*lit, &aim) < choice.half + 2e-3), "{aim}");
        }
    }
}
