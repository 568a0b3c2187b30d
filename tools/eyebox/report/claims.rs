//! What the paper says, checked against what was measured here.

use super::stats::mean;
use super::{Report, Series};
use eyebox::evaluate::Group;

/// What came of a claim.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// On every scene.
    Holds,
    /// On some scenes.
    Partly,
    /// On none.
    Fails,
    /// A method that it is about was not measured.
    Open,
}

impl Verdict {
    /// For people.
    pub fn words(self) -> &'static str {
        match self {
            Self::Holds => "holds here",
            Self::Partly => "holds on some scenes",
            Self::Fails => "does not hold here",
            Self::Open => "not measured here",
        }
    }
}

/// A claim, with the numbers that decide it.
#[derive(Debug, Clone)]
pub struct Claim {
    /// What is claimed.
    pub title: &'static str,
    /// What came of it.
    pub verdict: Verdict,
    /// One line per scene.
    pub numbers: Vec<String>,
    /// How it was decided, or why it could not be; and where it fails, what to make of it.
    pub note: String,
}

/// All claims, in their order.
pub fn claims(report: &Report) -> Vec<Claim> {
    vec![
        worst_case(report),
        spread(report),
        focal_stack(report),
        filter(report),
        centred(report),
        collapse(report),
        speckle(report),
    ]
}

fn of(report: &Report, method: &str) -> Option<Series> {
    report.leading().into_iter().find(|s| s.method == method)
}

/// Methods that SLFH is compared with: all but its own kin and what was given.
fn rivals(report: &Report, except: &[&str]) -> Vec<Series> {
    let known = ["lf2fs", "stft", "stft-unfiltered", "stft-exact", "smooth", "dpac", "slfh"];
    let wanted = |s: &Series| known.contains(&&s.method[..]) && !except.contains(&&s.method[..]);
    report.leading().into_iter().filter(wanted).collect()
}

/// One line per scene, each with whether the claim holds there.
fn decide(title: &'static str, found: Vec<(bool, String)>, note: &str, failing: &str) -> Claim {
    let holds = found.iter().filter(|f| f.0).count();
    let verdict = match found.len() {
        0 => Verdict::Open,
        n if holds == n => Verdict::Holds,
        _ if holds > 0 => Verdict::Partly,
        _ => Verdict::Fails,
    };
    let note = match verdict {
        Verdict::Partly | Verdict::Fails if !failing.is_empty() => format!("{note} {failing}"),
        _ => note.to_string(),
    };
    Claim { title, verdict, numbers: found.into_iter().map(|f| f.1).collect(), note }
}

fn open(title: &'static str, methods: &str) -> Claim {
    Claim { title, verdict: Verdict::Open, numbers: Vec::new(), note: format!("It takes {methods} to check this.") }
}

/// "SLFH 22.9, LF2FS 20.6, STFT 19.7", best first.
fn listed(report: &Report, mut values: Vec<(Series, f64)>, high_first: bool) -> String {
    values.sort_by(|a, b| if high_first { b.1.total_cmp(&a.1) } else { a.1.total_cmp(&b.1) });
    let one = |(s, v): &(Series, f64)| format!("{} {v:.1}", report.title(&s.method));
    values.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// SLFH against all others by one number per scene.
fn slfh_best(
    report: &Report,
    title: &'static str,
    high: bool,
    note: &str,
    failing: &str,
    number: impl Fn(&Series, &str) -> Option<f64>,
) -> Claim {
    let (Some(slfh), rivals) = (of(report, "slfh"), rivals(report, &["slfh"])) else {
        return open(title, "slfh and another method");
    };
    if rivals.is_empty() {
        return open(title, "slfh and another method");
    }
    let mut found = Vec::new();
    for scene in report.scene_names() {
        let Some(own) = number(&slfh, scene) else { continue };
        let others: Vec<(Series, f64)> =
            rivals.iter().filter_map(|s| number(s, scene).map(|v| (s.clone(), v))).collect();
        if others.is_empty() {
            continue;
        }
        let holds = others.iter().all(|o| if high { own >= o.1 } else { own <= o.1 });
        let all = others.into_iter().chain([(slfh.clone(), own)]).collect();
        found.push((holds, format!("{scene}: {} dB", listed(report, all, high))));
    }
    decide(title, found, note, failing)
}

fn worst_case(report: &Report) -> Claim {
    slfh_best(
        report,
        "SLFH has the best worst case over random pupils",
        true,
        "The lowest PSNR of any random pupil in any colour.",
        "",
        |s, scene| Some(report.psnr(s, Some(scene), Some(Group::Random))?.worst),
    )
}

fn spread(report: &Report) -> Claim {
    slfh_best(
        report,
        "SLFH has the smallest spread over random pupils",
        false,
        "Standard deviation of the PSNR over random pupils and colours.",
        "A method that is about equally poor through every pupil has a small spread too: what is gained through wide pupils, \
         where speckle averages, widens it. Read it beside the mean and the worst case. The paper's figure has as many scores as \
         scenes; here there is one per pupil and colour.",
        |s, scene| Some(report.psnr(s, Some(scene), Some(Group::Random))?.sd),
    )
}

fn focal_stack(report: &Report) -> Claim {
    let title = "LF2FS is best on the focal stack at full aperture";
    let Some(lf2fs) = of(report, "lf2fs") else { return open(title, "lf2fs") };
    // Smooth phase is best wherever the pupil holds the DC peak; that is the next claim's business.
    let others = rivals(report, &["lf2fs", "smooth", "dpac"]);
    if others.is_empty() {
        return open(title, "lf2fs and another method of random phase");
    }
    let number = |s: &Series, scene| Some(report.psnr(s, Some(scene), Some(Group::FocalStack))?.mean);
    let mut found = Vec::new();
    for scene in report.scene_names() {
        let Some(own) = number(&lf2fs, scene) else { continue };
        let mut all: Vec<(Series, f64)> =
            others.iter().filter_map(|s| number(s, scene).map(|v| (s.clone(), v))).collect();
        let holds = all.iter().all(|o| own >= o.1);
        all.push((lf2fs.clone(), own));
        found.push((holds, format!("{scene}: {} dB", listed(report, all, true))));
    }
    decide(
        title,
        found,
        "Mean PSNR of the focal stack, among the methods of random phase.",
        "Here every method takes the same number of steps, and SLFH's many small pupils are cheap: it may come as far \
         through the whole eyebox as the method that looks through nothing else.",
    )
}

fn filter(report: &Report) -> Claim {
    let title = "STFT without its Fourier filter is far worse at small depth";
    let (Some(with), Some(without)) = (of(report, "stft"), of(report, "stft-unfiltered")) else {
        return open(title, "stft and stft-unfiltered");
    };
    // The colour of the smallest eyebox is the last: colours are in the order of their wavelengths.
    let Some(bluest) = report.about.colors.last() else { return open(title, "stft and stft-unfiltered") };
    let mut found = Vec::new();
    for scene in &report.scenes {
        // The pupils of the focal stack that are focused nearest to the SLM.
        let nearest = |s: &Series, color| {
            let of_color = report.rows(s, Some(&scene.name), Some(Group::FocalStack)).filter(|r| r.color == color);
            let rows: Vec<_> = of_color.collect();
            let least = rows.iter().map(|r| r.pupil_mm[3].abs()).fold(f64::INFINITY, f64::min);
            mean(rows.iter().filter(|r| r.pupil_mm[3].abs() <= least + 1e-9).map(|r| r.psnr))
        };
        let both = |color| nearest(&without, color).zip(nearest(&with, color));
        let each: Vec<String> = report
            .about
            .colors
            .iter()
            .filter_map(|&c| both(c).map(|(b, a)| format!("{c} {b:.1} dB without, {a:.1} with it")))
            .collect();
        if let Some((b, a)) = both(*bluest) {
            found.push((a - b > 3.0, format!("{}: {}", scene.name, each.join("; "))));
        }
    }
    decide(
        title,
        found,
        "Far worse means by more than 3 dB, through the whole eyebox, focused nearest to the SLM, in the colour that fills \
         the eyebox. The longer wavelengths reach beyond it: their light has somewhere to go without a filter.",
        "The filter gives up the outermost 5 % of the eyebox, and a pupil as wide as the eyebox sees what is left there.",
    )
}

fn centred(report: &Report) -> Claim {
    let title = "Smooth and double phase beat all others at the centred full pupil";
    let smooth: Vec<Series> = ["smooth", "dpac"].iter().filter_map(|m| of(report, m)).collect();
    let others = rivals(report, &["smooth", "dpac"]);
    if smooth.is_empty() || others.is_empty() {
        return open(title, "smooth or dpac, and another method");
    }
    let number = |s: &Series, scene| report.at(s, Some(scene), Group::VaryingAperture, 8);
    let mut found = Vec::new();
    for scene in report.scene_names() {
        let own: Vec<_> = smooth.iter().filter_map(|s| number(s, scene).map(|v| (s.clone(), v))).collect();
        let rest: Vec<_> = others.iter().filter_map(|s| number(s, scene).map(|v| (s.clone(), v))).collect();
        if own.is_empty() || rest.is_empty() {
            continue;
        }
        let holds = own.iter().all(|o| rest.iter().all(|r| o.1 > r.1));
        found.push((holds, format!("{scene}: {} dB", listed(report, [own, rest].concat(), true))));
    }
    decide(
        title,
        found,
        "PSNR through the whole eyebox, focused at the middle of the scene.",
        "Their sub-frames are alike, so that averaging over them gains nothing, while methods of random phase average over \
         all of theirs, optimised together: with one sub-frame (--frames 1) these two are ahead, or nearly so.",
    )
}

fn collapse(report: &Report) -> Claim {
    let title = "Both collapse by over 10 dB when the pupil leaves the DC peak";
    let smooth: Vec<Series> = ["smooth", "dpac"].iter().filter_map(|m| of(report, m)).collect();
    if smooth.is_empty() {
        return open(title, "smooth or dpac");
    }
    let mut found = Vec::new();
    for scene in report.scene_names() {
        for series in &smooth {
            let centre = report.at(series, Some(scene), Group::VaryingAperture, 8);
            let groups = [Group::NearFocus, Group::FarFocus];
            let away = groups.iter().flat_map(|&g| report.rows(series, Some(scene), Some(g))).filter(|r| {
                let [x, y, d, _] = r.pupil_mm;
                x.hypot(y) > d / 2.0
            });
            if let (Some(centre), Some(away)) = (centre, mean(away.map(|r| r.psnr))) {
                let title = report.title(&series.method);
                let drop = centre - away;
                found.push((
                    drop > 10.0,
                    format!("{scene}, {title}: {centre:.1} dB, then {away:.1} dB ({drop:.1} less)"),
                ));
            }
        }
    }
    decide(
        title,
        found,
        "From the centred full pupil to the mean over pupils of a quarter of the eyebox that do not hold its middle.",
        "PSNR has a floor: a black picture of a dim scene still has the PSNR of that scene against black.",
    )
}

fn speckle(report: &Report) -> Claim {
    let title = "Speckle of independent frames falls as 1/\u{221a}F";
    let mut found = Vec::new();
    for figures in &report.speckle {
        let Some(&(_, one)) = figures.independent.iter().find(|p| p.0 == 1) else { continue };
        let off = |&(n, c): &(usize, f64)| (c * (n as f64).sqrt() / one - 1.0).abs();
        let up_to_8 = figures.independent.iter().filter(|p| p.0 <= 8);
        let worst = up_to_8.map(off).fold(0.0, f64::max);
        let joint = figures.joint.iter().find(|p| p.0 == 8);
        let alone = figures.independent.iter().find(|p| p.0 == 8);
        let beside = joint.zip(alone).map_or(String::new(), |(j, a)| {
            format!("; 8 frames have a contrast of {:.3} each for itself, {:.3} optimised together", a.1, j.1)
        });
        let line = format!("{}: at most {:.1} % off{beside}", report.title(&figures.method), 100.0 * worst);
        found.push((worst <= 0.1, line));
    }
    decide(title, found, "Within 10 % of the line up to 8 frames, on an even grey plane.", "")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::figures::{Pictures, Row, Run, SceneFigures, SpeckleFigures};
    use crate::report::{About, MethodAbout};
    use eyebox::optics::{Color, Pupil};

    /// One scene, one colour; `psnr` of a method through a pupil of a group.
    fn report(methods: &[&str], psnr: impl Fn(&str, Group, &Pupil) -> f64) -> Report {
        let depth = [-1e-3, 1e-3];
        let random: Vec<Pupil> =
            (1..9).map(|i| Pupil { x: 0.0, y: 0.0, diameter: f64::from(i) * 2e-3, depth: 0.0 }).collect();
        let about = About {
            version: String::new(),
            display: String::new(),
            size: [4, 4],
            pitch_um: 8.0,
            eyebox_mm: 22.0,
            colors: vec![Color::Blue],
            frames: vec![8],
            steps: 1,
            pupils: 1,
            seed: 0,
            engine: String::new(),
        };
        let named = |m: &&str| MethodAbout {
            name: m.to_string(),
            title: m.to_uppercase(),
            about: String::new(),
            citation: String::new(),
        };
        let mut report = Report::new(about, methods.iter().map(named).collect());
        report.scenes.push(SceneFigures {
            name: "a".into(),
            views: [9, 9],
            depth_mm: [-1.0, 1.0],
            row: 0,
            pictures: Pictures::default(),
        });
        for method in methods {
            let mut rows: Vec<Row> = Vec::new();
            for member in eyebox::evaluate::members(22e-3, depth, &random) {
                let index = rows.iter().filter(|r| r.group == member.group).count();
                let psnr = psnr(method, member.group, &member.pupil);
                let (color, group, pupil_mm) = (Color::Blue, member.group, member.pupil.to_mm());
                rows.push(Row { color, group, index, pupil_mm, psnr, ssim: None });
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

    fn verdicts(report: &Report) -> Vec<Verdict> {
        claims(report).iter().map(|c| c.verdict).collect()
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
        found.runs[3].rows.iter_mut().for_each(|r| r.psnr = r.psnr.min(15.0));
        found.speckle.push(SpeckleFigures {
            method: "slfh".into(),
            independent: vec![(1, 0.9), (2, 0.64), (4, 0.45), (8, 0.33), (16, 0.6)],
            joint: vec![(8, 0.25)],
            side: 64,
            color: Color::Green,
            diameter_mm: 5.5,
        });
        let expected = [Verdict::Holds; 7];
        let mut all = verdicts(&found);
        // Its spread is the smallest of those that were not flattened above.
        found.runs.remove(3);
        all[1] = verdicts(&found)[1];
        assert_eq!(all, expected, "{:?}", claims(&found));
    }

    #[test]
    fn what_was_not_measured_stays_open_and_what_differs_is_said() {
        assert_eq!(verdicts(&report(&["slfh"], papers)), [Verdict::Open; 7]);
        let found = report(&ALL, |method, _, p| if method == "slfh" { 10.0 + 900.0 * p.diameter } else { 30.0 });
        let all = claims(&found);
        let expected = [Verdict::Fails, Verdict::Fails, Verdict::Holds, Verdict::Fails, Verdict::Fails, Verdict::Fails];
        assert_eq!(all.iter().map(|c| c.verdict).collect::<Vec<_>>()[..6], expected);
        assert!(all[0].numbers[0].contains("LF2FS 30.0") && all[0].numbers[0].ends_with("SLFH 11.8 dB"), "{all:?}");
        let mut grainy = found;
        grainy.speckle.push(SpeckleFigures {
            method: "slfh".into(),
            independent: vec![(1, 0.9), (2, 0.64), (4, 0.45), (8, 0.36)],
            joint: Vec::new(),
            side: 64,
            color: Color::Green,
            diameter_mm: 5.5,
        });
        assert_eq!(verdicts(&grainy)[6], Verdict::Fails);
    }
}
