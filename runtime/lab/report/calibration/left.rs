//! Shows the camera's pictures next to the predictions of the model, and the residuals.

use super::super::page::{row, section, table};
use super::super::pictures::img;
use crate::comparison::{Picture, light_exact, map as picture_of};
use eyebox::low_level::calibrate::{HoldoutPicture, Report, ResidualMap};
use eyebox::low_level::optics::Color;
use maud::{Markup, html};

/// Shows pictures that were not fitted, next to their predictions.
pub(super) fn pictures(all: &[HoldoutPicture], color: Color) -> Markup {
    let shot = |picture: Picture, name: &str, under: String| {
        html! { figure { (img(&picture, name, None)) figcaption { b { (name) } br; span.note { (under) } } } }
    };
    let body = html! {
        p { "Shares are of the variance of pictures that were not fitted." }
        @for shown in all {
            @let [height, width] = shown.size;
            @let most = shown.picture.iter().copied().fold(f32::MIN_POSITIVE, f32::max);
            @let scaled = |values: &[f32]| values.iter().map(|v| (v / most).max(0.0)).collect::<Vec<f32>>();
            @let errors: Vec<f64> = shown.difference.iter().map(|d| f64::from(*d)).collect();
            @let worst = errors.iter().copied().fold(f64::MIN_POSITIVE, f64::max);
            @let shares: Vec<f64> = errors.iter().map(|e| e / worst).collect();
            div.shots style="--n:3" {
                (shot(light_exact(&[(color, &scaled(&shown.picture))], height, width), "Seen", shown.file.clone()))
                (shot(light_exact(&[(color, &scaled(&shown.prediction))], height, width), "Predicted", "the same exposure".into()))
                (shot(picture_of(&shares, height, width), "Difference", format!("black is 0, white {:.3} of the brightest", worst / f64::from(most))))
            }
        }
    };
    section("pictures", "Pictures that were not fitted", body)
}

/// Shows the places in the camera's picture at which a residual remains.
pub(super) fn map(map_of: &ResidualMap) -> Markup {
    let most = map_of.squares.iter().flatten().copied().fold(2.0, f64::max);
    let values: Vec<f64> = map_of.squares.iter().map(|s| s.map_or(0.0, |s| s / most)).collect();
    let body = html! {
        div.shots style="--n:3" {
            figure {
                (img(&picture_of(&values, map_of.rows, map_of.columns), "residual over the camera's picture", None))
                figcaption { span.note { (format!("All pictures together, in tiles of {0} × {0} camera pixels. The \
                    scale is the squared residual, from 0 to {most:.1} times the squared noise. A good fit is even, at \
                    1.", map_of.tile_px)) } }
            }
        }
    };
    section("left", "Map of the residual", body)
}

/// Lists the residual of each picture.
pub(super) fn by_picture(report: &Report) -> Markup {
    let rows = report.pictures.iter().map(|p| {
        let [x, y, d] = p.iris_mm;
        row(
            &p.file,
            [
                format!("{x:.2}, {y:.2}, {d:.2}"),
                p.role.into(),
                format!("{:.4} %", 100.0 * p.left),
                format!("{:.2}", p.squares),
            ],
        )
    });
    let columns = ["", "Iris x, y, diameter (mm)", "Used", "Residual share", "Squared residual over noise"];
    section("each", "Picture by picture", table("Residual of each picture, including noise", &columns, rows))
}
