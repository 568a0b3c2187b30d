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
        "A method that is about equally poor through every pupil has a small spread too: read it beside the mean and the \
         worst case.",
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
    let mut found = Vec::new();
    for scene in &report.scenes {
        // The pupils of the focal stack that are focused nearest to the SLM.
        let nearest = |s: &Series| {
            let rows: Vec<_> = report.rows(s, Some(&scene.name), Some(Group::FocalStack)).collect();
            let least = rows.iter().map(|r| r.pupil_mm[3].abs()).fold(f64::INFINITY, f64::min);
            mean(rows.iter().filter(|r| r.pupil_mm[3].abs() <= least + 1e-9).map(|r| r.psnr))
        };
        let random = |s: &Series| Some(report.psnr(s, Some(&scene.name), Some(Group::Random))?.mean);
        let numbers = (nearest(&with), nearest(&without), random(&with), random(&without));
        if let (Some(a), Some(b), Some(ra), Some(rb)) = numbers {
            let line = format!(
                "{}: {b:.1} dB without, {a:.1} dB with it at the smallest depth; {rb:.1} and {ra:.1} dB over random pupils",
                scene.name
            );
            found.push((a - b > 3.0, line));
        }
    }
    decide(
        title,
        found,
        "Far worse means by more than 3 dB, through the whole eyebox, focused nearest to the SLM.",
        "The filter gives the light that no pixel wants somewhere to go. Where the exposure leaves light to spare and the \
         window's own reach ends before the eyebox does, there is such a place without a filter too.",
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
        "One exposure is fitted over all pupils of all groups. A method that leaves most of the eyebox dark is pulled \
         away from its own best exposure by those pupils, and that shows at the centre too.",
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
