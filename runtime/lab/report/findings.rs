//! What the paper says, checked against what was measured here.

use crate::comparison::{Results, Series, mean};
use eyebox::evaluate::Group;

/// One statement of the paper, with the numbers that decide it.
pub struct Finding {
    /// What is stated.
    pub title: &'static str,
    /// One line for each scene, or method, and whether it holds there.
    pub numbers: Vec<String>,
    holds: usize,
    /// How it was decided.
    pub note: &'static str,
}

impl Finding {
    fn new(title: &'static str, note: &'static str, found: Vec<(bool, String)>) -> Self {
        let holds = found.iter().filter(|f| f.0).count();
        Self { title, note, holds, numbers: found.into_iter().map(|f| f.1).collect() }
    }

    /// What came of it, for people.
    pub fn words(&self) -> &'static str {
        match self.class() {
            "open" => "not measured here",
            "holds" => "holds here",
            "fails" => "does not hold here",
            _ => "holds on some scenes",
        }
    }

    /// `open`, `holds`, `partly` or `fails`.
    pub fn class(&self) -> &'static str {
        match (self.holds, self.numbers.len()) {
            (_, 0) => "open",
            (holds, all) if holds == all => "holds",
            (0, _) => "fails",
            _ => "partly",
        }
    }
}

/// A measure of a series on a scene, dB.
type Measure = fn(&Results, &Series, &str) -> Option<f64>;

/// A statement that some methods are better than others, scene by scene.
struct Statement {
    title: &'static str,
    /// Methods that are to be better, and those that they are compared with.
    better: &'static [&'static str],
    others: &'static [&'static str],
    /// What is compared.
    measure: Measure,
    /// 1 where more is better, -1 where less is.
    sign: f64,
    /// By so much, dB.
    gap: f64,
    note: &'static str,
}

const RANDOM_PHASE: &[&str] = &["slfh", "stft", "stft-unfiltered", "stft-exact"];

const STATEMENTS: [Statement; 5] = [
    Statement {
        title: "SLFH has the best worst case over random pupils",
        better: &["slfh"],
        others: &["lf2fs", "stft", "stft-unfiltered", "stft-exact", "smooth", "dpac"],
        measure: |r, s, scene| Some(r.psnr(s, Some(scene), Group::Random)?.worst),
        sign: 1.0,
        gap: 0.0,
        note: "The lowest PSNR of any random pupil in any colour.",
    },
    Statement {
        title: "SLFH has the smallest spread over random pupils",
        better: &["slfh"],
        others: &["lf2fs", "stft", "stft-unfiltered", "stft-exact", "smooth", "dpac"],
        measure: |r, s, scene| Some(r.psnr(s, Some(scene), Group::Random)?.sd),
        sign: -1.0,
        gap: 0.0,
        note: "Standard deviation of the PSNR over random pupils and colours. A method that is about equally poor through every \
               pupil has a small spread too: read it beside the mean and the worst case. The paper's figure has as many scores \
               as scenes; here there is one per pupil and colour.",
    },
    Statement {
        title: "LF2FS is best on the focal stack at full aperture",
        better: &["lf2fs"],
        others: RANDOM_PHASE,
        measure: |r, s, scene| Some(r.psnr(s, Some(scene), Group::FocalStack)?.mean),
        sign: 1.0,
        gap: 0.0,
        note: "Mean PSNR of the focal stack, among the methods of random phase. Every method takes the same number of steps here.",
    },
    Statement {
        title: "STFT without its Fourier filter is far worse at small depth",
        better: &["stft"],
        others: &["stft-unfiltered"],
        measure: nearest_the_slm,
        sign: 1.0,
        gap: 3.0,
        note: "By more than 3 dB, through the whole eyebox, focused nearest to the SLM, in the colour that fills the eyebox: the \
               light of longer wavelengths has somewhere to go without a filter.",
    },
    Statement {
        title: "Smooth and double phase beat all others at the centred full pupil",
        better: &["smooth", "dpac"],
        others: &["slfh", "lf2fs", "stft", "stft-unfiltered", "stft-exact"],
        measure: whole_eyebox,
        sign: 1.0,
        gap: 1e-9,
        note: "PSNR through the whole eyebox, focused at the middle of the scene. Their sub-frames are alike, so that averaging \
               over them gains nothing: with a single sub-frame these two are ahead, or nearly so.",
    },
];

fn whole_eyebox(results: &Results, series: &Series, scene: &str) -> Option<f64> {
    results.at(series, Some(scene), Group::VaryingAperture, 8)
}

/// Of the focal stack, in the colour of the smallest eyebox, which is the last.
fn nearest_the_slm(results: &Results, series: &Series, scene: &str) -> Option<f64> {
    let color = results.about.colors.last()?;
    let rows = || results.rows(series, Some(scene), Group::FocalStack).filter(|r| r.color == *color);
    let least = rows().map(|r| r.pupil_mm[3].abs()).fold(f64::INFINITY, f64::min);
    mean(rows().filter(|r| r.pupil_mm[3].abs() <= least + 1e-9).filter_map(|r| r.psnr))
}

/// Through pupils of a quarter of the eyebox that do not hold its middle.
fn beside_the_middle(results: &Results, series: &Series, scene: &str) -> Option<f64> {
    let groups = [Group::NearFocus, Group::FarFocus];
    let away = groups.iter().flat_map(|&g| results.rows(series, Some(scene), g)).filter(|r| {
        let [x, y, d, _] = r.pupil_mm;
        x.hypot(y) > d / 2.0
    });
    mean(away.filter_map(|r| r.psnr))
}

/// All findings, in the order of the paper.
pub(crate) fn findings(results: &Results) -> Vec<Finding> {
    let mut all: Vec<Finding> = STATEMENTS.iter().map(|s| compared(results, s)).collect();
    all.push(collapse(results));
    all.push(speckle(results));
    all
}

fn compared(results: &Results, statement: &Statement) -> Finding {
    let leading = results.leading();
    let mut found = Vec::new();
    for scene in results.scenes.iter().map(|s| &s.name[..]) {
        let of = |methods: &[&str]| -> Vec<(f64, String)> {
            let named = leading.iter().filter(|s| methods.contains(&&s.method[..]));
            let value = |s| Some(((statement.measure)(results, s, scene)?, results.title(&s.method)));
            named.filter_map(value).collect()
        };
        let (better, others) = (of(statement.better), of(statement.others));
        if better.is_empty() || others.is_empty() {
            continue;
        }
        let holds = better.iter().all(|b| others.iter().all(|o| statement.sign * (b.0 - o.0) >= statement.gap));
        let mut all = [better, others].concat();
        all.sort_by(|a, b| (statement.sign * b.0).total_cmp(&(statement.sign * a.0)));
        let listed: Vec<String> = all.iter().map(|(v, title)| format!("{title} {v:.1}")).collect();
        found.push((holds, format!("{scene}: {} dB", listed.join(", "))));
    }
    Finding::new(statement.title, statement.note, found)
}

fn collapse(results: &Results) -> Finding {
    let mut found = Vec::new();
    for scene in results.scenes.iter().map(|s| &s.name[..]) {
        for series in results.leading().iter().filter(|s| ["smooth", "dpac"].contains(&&s.method[..])) {
            let values = (whole_eyebox(results, series, scene), beside_the_middle(results, series, scene));
            if let (Some(centre), Some(away)) = values {
                let (title, drop) = (results.title(&series.method), centre - away);
                let line = format!("{scene}, {title}: {centre:.1} dB, then {away:.1} dB ({drop:.1} less)");
                found.push((drop > 10.0, line));
            }
        }
    }
    let note = "From the centred full pupil to the mean over pupils of a quarter of the eyebox that do not hold its middle. PSNR \
                has a floor: a black picture of a dim scene still has the PSNR of that scene against black.";
    Finding::new("Smooth and double phase collapse by over 10 dB when the pupil leaves the DC peak", note, found)
}

fn speckle(results: &Results) -> Finding {
    let mut found = Vec::new();
    for figures in &results.speckle {
        let Some(&(_, one)) = figures.independent.iter().find(|p| p.0 == 1) else { continue };
        let off = |&(n, c): &(usize, f64)| (c * (n as f64).sqrt() / one - 1.0).abs();
        let worst = figures.independent.iter().filter(|p| p.0 <= 8).map(off).fold(0.0, f64::max);
        let title = results.title(&figures.method);
        found.push((worst <= 0.1, format!("{title}: at most {:.1} % from the line", 100.0 * worst)));
    }
    let note = "Within 10 % of the line up to 8 frames, on an even grey plane.";
    Finding::new("Speckle of independent frames falls as 1/\u{221a}F", note, found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::comparison::{About, MethodAbout, Pictures, Row, Run, SceneFigures, SpeckleFigures};
    use eyebox::optics::{Color, Pupil};

    /// One scene, one colour; `psnr` of a method through a pupil of a group.
    fn report(methods: &[&str], psnr: impl Fn(&str, Group, &Pupil) -> f64) -> Results {
        let depth = [-1e-3, 1e-3];
        let random: Vec<Pupil> =
            (1..9).map(|i| Pupil { x: 0.0, y: 0.0, diameter: f64::from(i) * 2e-3, depth: 0.0 }).collect();
        let about = About {
            version: String::new(),
            display: String::new(),
            size: [4, 4],
            pitch_um: 8.0,
            eyebox_mm: 22.0,
            reach: String::new(),
            colors: vec![Color::Blue],
            frames: vec![8],
            steps: 1,
            pupils: 1,
            seed: 0,
            engine: String::new(),
            viewing: None,
        };
        let named = |m: &&str| MethodAbout {
            name: m.to_string(),
            title: m.to_uppercase(),
            about: String::new(),
            citation: String::new(),
        };
        let mut report = Results {
            about,
            methods: methods.iter().map(named).collect(),
            scenes: Vec::new(),
            runs: Vec::new(),
            speckle: Vec::new(),
            joint: Vec::new(),
            coherence: Vec::new(),
            etendue: Vec::new(),
            sources: Vec::new(),
            published: Vec::new(),
            missing: 0,
        };
        report.scenes.push(SceneFigures {
            name: "a".into(),
            views: [9, 9],
            depth_mm: [-1.0, 1.0],
            depth_dioptres: [-6.25e-3, 6.25e-3],
            row: 0,
            pictures: Pictures::default(),
        });
        for method in methods {
            let mut rows: Vec<Row> = Vec::new();
            for member in eyebox::evaluate::members(22e-3, depth, &random) {
                let index = rows.iter().filter(|r| r.group == member.group).count();
                let psnr = psnr(method, member.group, &member.pupil);
                let (color, group, pupil_mm) = (Color::Blue, member.group, member.pupil.to_mm());
                let (focus_dioptres, ceiling) = (pupil_mm[3] / 160.0, Some(psnr + 10.0));
                rows.push(Row {
                    color,
                    group,
                    index,
                    pupil_mm,
                    focus_dioptres,
                    psnr: Some(psnr),
                    ceiling,
                    ssim: None,
                    jod: None,
                });
            }
            report.runs.push(Run {
                scene: "a".into(),
                method: method.to_string(),
                frames: 8,
                seconds: None,
                colors: Vec::new(),
                rows,
                color_error: None,
                pictures: Pictures::default(),
            });
        }
        report
    }

    fn classes(results: &Results) -> Vec<&'static str> {
        findings(results).iter().map(Finding::class).collect()
    }

    /// As the paper has it.
    fn papers(method: &str, group: Group, p: &Pupil) -> f64 {
        let off = p.x.hypot(p.y) > p.diameter / 2.0;
        match (method, group) {
            ("smooth" | "dpac", _) if off => 12.0,
            ("smooth" | "dpac", Group::VaryingAperture | Group::FocalStack) => 45.0,
            ("slfh", Group::Random) => 28.0 + 200.0 * p.diameter,
            ("lf2fs", Group::FocalStack) => 36.0,
            ("stft-unfiltered", _) => 10.0 + 900.0 * p.diameter,
            (_, Group::Random) => 24.0 + 900.0 * p.diameter,
            _ => 30.0,
        }
    }

    const ALL: [&str; 6] = ["slfh", "lf2fs", "stft", "stft-unfiltered", "smooth", "dpac"];

    #[test]
    fn what_the_paper_measured_holds() {
        let mut found = report(&ALL, papers);
        // Without its filter: 29.8 at the whole eyebox. Let it be far worse.
        found.runs[3].rows.iter_mut().for_each(|r| r.psnr = r.psnr.map(|db| db.min(15.0)));
        found.speckle.push(SpeckleFigures {
            method: "slfh".into(),
            independent: vec![(1, 0.9), (2, 0.64), (4, 0.45), (8, 0.33), (16, 0.6)],
            joint: vec![(8, 0.25)],
            side: 64,
            color: Color::Green,
            diameter_mm: 5.5,
        });
        let expected = ["holds"; 7];
        let mut all = classes(&found);
        // Its spread is the smallest of those that were not flattened above.
        found.runs.remove(3);
        all[1] = classes(&found)[1];
        assert_eq!(all, expected);
    }

    #[test]
    fn what_was_not_measured_stays_open_and_what_differs_is_said() {
        assert_eq!(classes(&report(&["slfh"], papers)), ["open"; 7]);
        let found = report(&ALL, |method, _, p| if method == "slfh" { 10.0 + 900.0 * p.diameter } else { 30.0 });
        let all = findings(&found);
        let expected = ["fails", "fails", "holds", "fails", "fails", "fails"];
        assert_eq!(all.iter().map(Finding::class).collect::<Vec<_>>()[..6], expected);
        assert!(
            all[0].numbers[0].contains("LF2FS 30.0") && all[0].numbers[0].ends_with("SLFH 11.8 dB"),
            "{:?}",
            all[0].numbers
        );
        let mut grainy = found;
        grainy.speckle.push(SpeckleFigures {
            method: "slfh".into(),
            independent: vec![(1, 0.9), (2, 0.64), (4, 0.45), (8, 0.36)],
            joint: Vec::new(),
            side: 64,
            color: Color::Green,
            diameter_mm: 5.5,
        });
        assert_eq!(classes(&grainy)[6], "fails");
    }
}
