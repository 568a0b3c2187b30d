//! Draws the fitted display as wavefront, beam, table, pupil plane and crosstalk.

use super::super::page::{figure, row, table};
use super::super::pictures::{img, ramp};
use super::super::plot::{Axis, Plot};
use crate::comparison::map as picture_of;
use eyebox::low_level::calibrate::{Figures, IrisFound, Kernel, Map, Report, Table, Wavefront, ZeroOrder};
use maud::{Markup, html};
use std::f64::consts::TAU;

/// Draws all differences from an ideal display. Returns `None` for an ideal display.
pub(super) fn plots(report: &Report) -> Option<Markup> {
    let figures = report.figures.as_ref()?;
    let Figures { eyebox_mm, wavefront, beam, table, zero_orders, crosstalk, iris, .. } = figures;
    let any = wavefront.is_some() || beam.is_some() || table.is_some() || crosstalk.is_some();
    if !any && zero_orders.is_empty() && iris.is_none() {
        return None;
    }
    Some(html! {
        @if !report.calibrated { p { "These are the values of the display's file. The pictures gave no better ones." } }
        div.plots {
            @if let Some(wavefront) = wavefront { (relay(wavefront)) }
            @if let Some(beam) = beam { (profile(beam)) }
            @if let Some(table) = table { (curve(table)) }
            @if !zero_orders.is_empty() || iris.is_some() { (pupil(*eyebox_mm, zero_orders, iris.as_ref())) }
            @if let Some(kernel) = crosstalk { (neighbors(kernel)) }
        }
        @if let Some(table) = table { (levels(table)) }
        @if let Some(iris) = iris { (diameters(iris)) }
    })
}

/// Draws a map with its scale from the least to the highest value.
fn mapped(map: &Map, [least, highest]: [f64; 2], name: &str, about: &str, unit: &str) -> Markup {
    let wide = (highest - least).max(f64::MIN_POSITIVE);
    let shares: Vec<f64> = map.values.iter().map(|v| (v - least) / wide).collect();
    html! {
        figure {
            figcaption { b { (name) } " " span { (about) } }
            (img(&picture_of(&shares, map.rows, map.columns), name, None))
            (ramp(&format!("{least:.2}"), &format!("{highest:.2} {unit}")))
        }
    }
}

/// Draws a plot of several lines with a legend above it.
fn lines(plot: &Plot, name: &str, about: &str, series: &[(&str, &str)]) -> Markup {
    html! {
        figure {
            figcaption { b { (name) } " " span { (about) } }
            ul.legend {
                @for (class, name) in series {
                    li class=(class) { @if *class == "root" { i.line {} } @else { i {} } (name) }
                }
            }
            (plot.svg())
        }
    }
}

fn relay(wavefront: &Wavefront) -> Markup {
    let [height, width] = wavefront.map.size_mm;
    let about = format!(
        "over the eyebox of {width:.1} x {height:.1} mm, {:.3} waves RMS and {:.2} from valley to peak over the disc \
         in it. The scale is for the disc, and the corners are extrapolated",
        wavefront.rms_waves,
        wavefront.range_waves[1] - wavefront.range_waves[0]
    );
    html! {
        (mapped(&wavefront.map, wavefront.range_waves, "Wavefront of the relay", &about, "waves"))
        (figure(&aberrations(wavefront), "Aberrations", "Zernike polynomials (ANSI index), waves RMS, with standard errors as whiskers"))
    }
}

/// Draws a bar for each polynomial, with its standard error.
fn aberrations(wavefront: &Wavefront) -> Plot {
    let names = Axis::rows(wavefront.terms.iter().map(|t| format!("{} {}", t.index, t.name)));
    let x = Axis::linear("waves RMS").covering([0.0]);
    let mut plot = Plot::new("Zernike polynomials of the relay's wavefront", x, names).sized(370.0, 16.0);
    for (i, term) in wavefront.terms.iter().enumerate() {
        let (row, error) = (i as f64, term.error.unwrap_or(0.0));
        let hover = format!("{} {}: {:.4} ± {error:.4} waves", term.index, term.name, term.waves);
        plot.rect("m0 bar", [term.waves.min(0.0), row + 0.15], [term.waves.max(0.0), row + 0.85], &hover);
        let ends = [term.waves - error, term.waves + error];
        plot.line("m1 line", vec![[ends[0], row + 0.5], [ends[1], row + 0.5]]);
        for end in ends {
            plot.line("m1 line", vec![[end, row + 0.25], [end, row + 0.75]]);
        }
    }
    plot
}

fn profile(beam: &Map) -> Markup {
    let [height, width] = beam.size_mm;
    let about = format!("intensity over the SLM of {width:.2} x {height:.2} mm, the mean being 1");
    let mut cuts = Plot::new("Profile of the beam", Axis::linear("mm"), Axis::linear("intensity").covering([0.0]));
    cuts.line("m0 line", beam.cut(1));
    cuts.line("m1 line", beam.cut(0));
    html! {
        (mapped(beam, beam.range(), "Beam", &about, "times the mean"))
        (lines(&cuts, "Beam, cut", "through the middle of the SLM", &[("m0", "along x"), ("m1", "along y")]))
    }
}

fn curve(table: &Table) -> Markup {
    let mut plot = Plot::new("Phase against drive", Axis::linear("drive, 1 is full"), Axis::linear("phase, turns"));
    let of = |which: usize| table.drives.iter().zip(&table.turns).map(|(d, t)| [*d, t[which]]).collect();
    plot.line("root line", vec![[0.0, 0.0], [1.0, 1.0]]);
    plot.line("m0 alone line", of(0));
    plot.line("m0 alone line", of(2));
    plot.line("m0 line", of(1));
    let [least, _, highest] = table.turns.last().copied().unwrap_or_default();
    let [b1, b2] = table.bend;
    let about = format!("full drive gives {least:.3} to {highest:.3} turns over the SLM, bend {b1:.3} and {b2:.3} rad");
    let series = [("root", "ideal"), ("m0", "fitted, at the middle of the SLM (pale: least and highest)")];
    lines(&plot, "Table of the SLM", &about, &series)
}

fn levels(of: &Table) -> Markup {
    let rows = of.level.iter().zip(["top", "middle", "bottom"]);
    let rows = rows.map(|(level, name)| row(name, level.map(|l| format!("{l:.4}"))));
    table("Phase at full drive over the SLM, turns", &["", "left", "middle", "right"], rows)
}

/// Returns the points of a circle about a place.
fn circle([x, y]: [f64; 2], diameter: f64) -> Vec<[f64; 2]> {
    let at = |i: usize| {
        let (sin, cos) = (TAU * i as f64 / 64.0).sin_cos();
        [x + diameter / 2.0 * cos, -(y + diameter / 2.0 * sin)]
    };
    (0..=64).map(at).collect()
}

/// Draws the pupil plane with eyebox, zero order and iris. Down is positive there and negative on the axis of the plot.
fn pupil(eyebox: f64, zeros: &[ZeroOrder], iris: Option<&IrisFound>) -> Markup {
    let down = Axis::linear("y, mm").text(|v| format!("{}", (-v * 1e6).round() / 1e6 + 0.0));
    let mut plot = Plot::new("The pupil plane", Axis::linear("x, mm"), down).sized(370.0, 310.0);
    let half = eyebox / 2.0;
    plot.rect("shade", [-half, -half], [half, half], "the eyebox");
    let (mut said, mut series) = (Vec::new(), Vec::new());
    if let Some(iris) = iris {
        let [asked, found] = iris.diameters_mm.last().copied().unwrap_or([half, half * iris.scale]);
        plot.line("root line", circle([0.0; 2], asked));
        plot.line("m0 line", circle(iris.at_mm, found));
        let [x, y] = iris.at_mm;
        let error = iris.error_mm.map_or(String::new(), |[x, y]| format!(" (± {x:.3}, {y:.3})"));
        let about = iris.scale_error.map_or(String::new(), |e| format!(" (± {e:.4})"));
        said.push(format!(
            "the iris that is requested on the axis is at {x:.3}, {y:.3} mm{error}, its scale is {:.4}{about}",
            iris.scale
        ));
        series.extend([("root", "iris as requested"), ("m0", "iris as found")]);
    }
    for (i, zero) in zeros.iter().enumerate() {
        let name = if i == 0 { "zero order" } else { "another reflection" };
        let ([x, y], [wide, tall]) = (zero.at_mm, zero.wide_mm);
        let share = format!("{:.2} %", 100.0 * zero.share);
        plot.rect("m1 box", [x - wide / 2.0, -(y - tall / 2.0)], [x + wide / 2.0, -(y + tall / 2.0)], name);
        plot.dot("m1 dot", [x, -y], 3.0, &format!("{name}: {share} at {x:.2}, {y:.2} mm"));
        let error = zero.error_mm.map_or(String::new(), |[x, y]| format!(" (± {x:.3}, {y:.3})"));
        let about = zero.share_error.map_or(String::new(), |e| format!(" (± {:.2})", 100.0 * e));
        let the = if i == 0 { "the zero order" } else { name };
        said.push(format!("{the} has {share}{about} of the light, at {x:.3}, {y:.3} mm{error}"));
    }
    series.extend((!zeros.is_empty()).then_some(("m1", "zero order")));
    lines(&plot, "Pupil plane", &format!("the eyebox is gray, {}", said.join(", ")), &series)
}

fn diameters(iris: &IrisFound) -> Markup {
    let asked: Vec<String> = iris.diameters_mm.iter().map(|[asked, _]| format!("{asked:.3}")).collect();
    let columns: Vec<&str> = std::iter::once("Requested").chain(asked.iter().map(String::as_str)).collect();
    table(
        "Diameters of the iris, mm",
        &columns,
        [row("Found", iris.diameters_mm.iter().map(|[_, found]| format!("{found:.3}")))],
    )
}

fn neighbors(kernel: &Kernel) -> Markup {
    let mut plot =
        Plot::new("Kernel of crosstalk", Axis::linear("pixels"), Axis::linear("share of the drive").floor(0.0));
    for (class, shares) in [("m0", &kernel.along_x), ("m1", &kernel.along_y)] {
        let points: Vec<[f64; 2]> =
            kernel.offsets_px.iter().zip(shares).map(|(d, share)| [*d as f64, *share]).collect();
        plot.series(class, "share", &points);
    }
    let about = format!("it leaves {:.1} % of the variance of random drives", 100.0 * kernel.variance_left);
    lines(&plot, "Crosstalk between pixels", &about, &[("m0", "along x"), ("m1", "along y")])
}
