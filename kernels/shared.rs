//! Lists the constants that shaders share with Rust. Each constant is defined once, in Rust. `cargo run -p
//! eyebox-spirv-tool -- build` writes them to `constants.glsl` for the shaders.

use crate::{
    BATCH, SUM_WIDTH, TILE, TILE_THREADS, WIDTH, binary_angle, compare, compose_layer, decode_views, draw_splats,
    encode, energy, equalise_eyebox, exposure, fft_plan, finish_layers, mark_splats, photograph, project_splats,
    relief, relief_close, relief_decode, relief_draw, relief_jump, relief_levels, splat_colors, table_start, trig,
};
use std::fmt::Write;

/// The constants that are numbers with a fraction.
const FLOATS: &[(&str, f32)] = &[
    ("COMPOSE_SOLID", compose_layer::SOLID),
    ("COMPOSE_NEAREST", compose_layer::NEAREST),
    ("COMPOSE_BRIGHTEST", finish_layers::BRIGHTEST),
    ("COMPOSE_PI", std::f32::consts::PI),
    ("COMPOSE_ATAN_LOW", compose_layer::ATAN_EDGES[0]),
    ("COMPOSE_ATAN_HIGH", compose_layer::ATAN_EDGES[1]),
    ("COMPOSE_ATAN_3", compose_layer::ATAN[0]),
    ("COMPOSE_ATAN_5", compose_layer::ATAN[1]),
    ("COMPOSE_ATAN_7", compose_layer::ATAN[2]),
    ("COMPOSE_ATAN_9", compose_layer::ATAN[3]),
    ("DECODE_BRIGHTEST", decode_views::BRIGHTEST),
    ("SPLAT_FAINTEST", draw_splats::FAINTEST),
    ("SPLAT_OPAQUE", draw_splats::OPAQUE),
    ("SPLAT_CLOSED", draw_splats::CLOSED),
    ("SPLAT_PIXEL", project_splats::PIXEL[0]),
    ("SPLAT_PIXEL_ANTIALIASED", project_splats::PIXEL[1]),
    ("SPLAT_LEAST", project_splats::LEAST),
    ("SPLAT_BEYOND", project_splats::BEYOND),
    ("SPLAT_C1", splat_colors::C1),
    ("SPLAT_C2_0", splat_colors::C2[0]),
    ("SPLAT_C2_1", splat_colors::C2[1]),
    ("SPLAT_C2_2", splat_colors::C2[2]),
    ("SPLAT_C2_3", splat_colors::C2[3]),
    ("SPLAT_C2_4", splat_colors::C2[4]),
    ("SPLAT_C3_0", splat_colors::C3[0]),
    ("SPLAT_C3_1", splat_colors::C3[1]),
    ("SPLAT_C3_2", splat_colors::C3[2]),
    ("SPLAT_C3_3", splat_colors::C3[3]),
    ("SPLAT_C3_4", splat_colors::C3[4]),
    ("SPLAT_C3_5", splat_colors::C3[5]),
    ("SPLAT_C3_6", splat_colors::C3[6]),
    ("SPLAT_ROUND", draw_splats::ROUND),
    ("SPLAT_EXP_1", draw_splats::EXP[0]),
    ("SPLAT_EXP_2", draw_splats::EXP[1]),
    ("SPLAT_EXP_3", draw_splats::EXP[2]),
    ("SPLAT_EXP_4", draw_splats::EXP[3]),
    ("SPLAT_EXP_5", draw_splats::EXP[4]),
    ("SPLAT_EXP_6", draw_splats::EXP[5]),
    ("RELIEF_ABSENT", relief::ABSENT),
    ("RELIEF_DEEPEST", relief_decode::DEEPEST),
    ("RELIEF_KNOWN", relief_close::KNOWN),
    ("RELIEF_LARGER", relief_draw::LARGER),
    ("RELIEF_NEAR", relief_draw::NEAR),
    ("LOG2_E", std::f32::consts::LOG2_E),
    ("ENCODE_PARTS", encode::PARTS),
    ("ANGLE_UNIT", binary_angle::UNIT),
    ("ANGLE_PART", binary_angle::PART),
    ("HALF_PI_1", trig::HALF_PI[0]),
    ("HALF_PI_2", trig::HALF_PI[1]),
    ("HALF_PI_3", trig::HALF_PI[2]),
    ("TWO_OVER_PI", std::f32::consts::FRAC_2_PI),
    ("SIN_3", trig::SIN[0]),
    ("SIN_5", trig::SIN[1]),
    ("SIN_7", trig::SIN[2]),
    ("COS_4", trig::COS[0]),
    ("COS_6", trig::COS[1]),
    ("COS_8", trig::COS[2]),
    ("TURN", std::f32::consts::TAU),
    ("TURN_1", trig::TURN[0]),
    ("TURN_2", trig::TURN[1]),
    ("PER_TURN", trig::PER_TURN),
    ("SMALLEST", f32::MIN_POSITIVE),
];

/// Returns the text of `kernels/constants.glsl`.
pub fn glsl() -> String {
    let integers = [
        ("WIDTH", WIDTH),
        ("SUM_WIDTH", SUM_WIDTH),
        ("BATCH", BATCH as u32),
        ("TILE", TILE),
        ("TILE_THREADS", TILE_THREADS),
        ("COMPOSE_VIEW", compose_layer::VIEW),
        ("COMPOSE_QUAD", compose_layer::QUAD),
        ("COMPOSE_BGRA8", compose_layer::BGRA8),
        ("COMPOSE_RGB10A2", compose_layer::RGB10A2),
        ("COMPOSE_RGBA16", compose_layer::RGBA16),
        ("COMPOSE_D16", compose_layer::D16),
        ("COMPOSE_D24", compose_layer::D24),
        ("COMPOSE_D32", compose_layer::D32),
        ("COMPOSE_BLENDS", compose_layer::BLENDS),
        ("COMPOSE_UNPREMULTIPLIED", compose_layer::UNPREMULTIPLIED),
        ("COMPOSE_INVERTED", compose_layer::INVERTED),
        ("COMPOSE_SRGB", compose_layer::SRGB),
        ("COMPOSE_KIND", compose_layer::KIND as u32),
        ("COMPOSE_FLAGS", compose_layer::FLAGS as u32),
        ("COMPOSE_COLOR", compose_layer::COLOR as u32),
        ("COMPOSE_DEPTH", compose_layer::DEPTH as u32),
        ("COMPOSE_RANGE", compose_layer::RANGE as u32),
        ("COMPOSE_DIOPTRES", compose_layer::DIOPTRES as u32),
        ("COMPOSE_TABLES", compose_layer::TABLES as u32),
        ("COMPOSE_SURFACE", compose_layer::SURFACE as u32),
        ("COMPOSE_TAP", compose_layer::TAP as u32),
        ("COMPOSE_OUTSIDE", compose_layer::OUTSIDE),
        ("DECODE_U8", decode_views::U8),
        ("DECODE_F16", decode_views::F16),
        ("DECODE_F32", decode_views::F32),
        ("DECODE_SUMS", decode_views::SUMS as u32),
        ("SPLAT_SIDE", draw_splats::SIDE),
        ("SPLAT_LANES", draw_splats::LANES as u32),
        ("SPLAT_WORDS", draw_splats::WORDS as u32),
        ("SPLAT_BIN", mark_splats::BIN),
        ("SPLAT_TOGETHER", mark_splats::TOGETHER),
        ("SPLAT_PLAIN", project_splats::PLAIN as u32),
        ("SPLAT_DEGREE", project_splats::DEGREE),
        ("SPLAT_ANTIALIASED", project_splats::ANTIALIASED),
        ("SPLAT_ORDERED", project_splats::ORDERED),
        ("RELIEF_NOWHERE", relief_jump::NOWHERE),
        ("RELIEF_PIECES", relief_draw::PIECES),
        ("RELIEF_LEVELS", relief_levels::LEVELS),
        ("RELIEF_SIDE", relief_levels::SIDE),
        ("COMPARE_PROJECTION", compare::PROJECTION),
        ("COMPARE_INTENSITY", compare::INTENSITY),
        ("COMPARE_SHARE", compare::SHARE as u32),
        ("EQUALISE_PROJECTION", equalise_eyebox::PROJECTION),
        ("ENERGY_MOST", energy::MOST),
        ("EXPOSURE_SHARE", exposure::SHARE as u32),
        ("EXPOSURE_PART", exposure::PART as u32),
        ("PHOTOGRAPH_STRIP", photograph::STRIP),
        ("FFT_LARGEST_RADIX", fft_plan::LARGEST_RADIX),
        ("FFT_FREE_SLOT", fft_plan::FREE_SLOT),
        ("CHIRP_WIDTH", fft_plan::CHIRP_WORKGROUP[0]),
        ("CHIRP_HEIGHT", fft_plan::CHIRP_WORKGROUP[1]),
        ("CHIRP_BEGIN", fft_plan::CHIRP_BEGIN),
        ("CHIRP_FILTER", fft_plan::CHIRP_FILTER),
        ("CHIRP_END", fft_plan::CHIRP_END),
        ("START_LEVELS", table_start::LEVELS as u32),
        ("START_BEND", table_start::BEND as u32),
        ("START_COARSER", table_start::COARSER as u32),
        ("ENCODE_POWER", encode::POWER),
        ("ENCODE_EVEN", encode::EVEN),
        ("ENCODE_FINE", encode::FINE),
        ("ENCODE_FINE_TABLED", encode::FINE_TABLED),
        ("ENCODE_ROWS", encode::ROWS),
        ("ENCODE_WIDE", encode::WIDE),
        ("ENCODE_ENTRIES", encode::ENTRIES as u32),
        ("ENCODE_RADIAN", encode::RADIAN[0] as u32),
        ("ENCODE_RADIAN_256TH", encode::RADIAN[1] as u32),
        ("ENCODE_PART", encode::PART[0] as u32),
        ("ENCODE_PART_128TH", encode::PART[1] as u32),
    ];
    let mut text =
        "// Written by `cargo run -p eyebox-spirv-tool -- build` from shared.rs: change nothing here.\n".to_owned();
    // Larger numbers have no sign in GLSL.
    let suffix = |value: u32| if i32::try_from(value).is_ok() { "" } else { "u" };
    let integers = integers.map(|(name, value)| (name, format!("{value}{}", suffix(value))));
    let floats = FLOATS.iter().map(|(name, value)| (*name, format!("({value:?})")));
    for (name, value) in integers.into_iter().chain(floats) {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "#define {name} {value}");
    }
    text
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_header_holds_what_rust_has() {
        assert_eq!(include_str!("constants.glsl"), super::glsl(), "cargo run -p eyebox-spirv-tool -- build");
    }
}
