//! The functions for displays.

use crate::arrays::{given, hand_over, text};
use crate::failure::{Failure, answer, free};
use crate::{EYEBOX_BLUE, EYEBOX_GREEN, EYEBOX_RED, EyeboxStatus};
use eyebox::optics::{Color, Display};
use std::ffi::c_char;
use std::mem::MaybeUninit;

/// A display, with its SLM, its optics and its encoding of phases. It never changes.
pub struct EyeboxDisplay(pub(crate) Display);

/// Returns the bit of a color for C.
pub(crate) fn bit(color: Color) -> u32 {
    match color {
        Color::Red => EYEBOX_RED,
        Color::Green => EYEBOX_GREEN,
        Color::Blue => EYEBOX_BLUE,
    }
}

/// Returns the colors of a display for a set of bits. Without any bit it returns all colors of the display.
pub(crate) fn colors(display: &Display, bits: u32) -> Result<Vec<Color>, Failure> {
    if bits > 7 {
        return Err(Failure::argument("colors", bits, "EYEBOX_RED, EYEBOX_GREEN and EYEBOX_BLUE, or 0 for all"));
    }
    let has = display.wavelengths.iter().map(|w| w.color);
    if bits == 0 {
        return Ok(has.collect());
    }
    let asked = [Color::Red, Color::Green, Color::Blue].into_iter().filter(|c| bits & bit(*c) != 0);
    asked.map(|color| Ok(display.optics(color).map(|_| color)?)).collect()
}

/// Makes a display from the name of a preset, such as "paper", "small" or "planes8", or from the path of a display file
/// (TOML, docs/displays.md). Free it with `eyebox_display_free`. Fails with EYEBOX_STATUS_DISPLAY if there is no such
/// preset or file, or if the file is wrong.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_display_load(
    name: *const c_char,
    display: Option<&mut MaybeUninit<*mut EyeboxDisplay>>,
) -> EyeboxStatus {
    // SAFETY: The header requires texts that end with a zero byte.
    answer(|| hand_over(display, || Ok(EyeboxDisplay(Display::load(unsafe { text(name, "name") }?)?))))
}

/// Makes a display from the text of a display file (TOML, docs/displays.md). Paths in the text are relative to the
/// working folder. Free it with `eyebox_display_free`. Fails with EYEBOX_STATUS_DISPLAY if the text is wrong.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_display_from_toml(
    toml: *const c_char,
    display: Option<&mut MaybeUninit<*mut EyeboxDisplay>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(display, || {
            // SAFETY: The header requires texts that end with a zero byte.
            Ok(EyeboxDisplay(Display::from_toml(unsafe { text(toml, "toml") }?, "display")?))
        })
    })
}

/// Makes a copy of a display with another number of rows and columns (pixels). Free it with `eyebox_display_free`.
/// Fails with EYEBOX_STATUS_DISPLAY if a color of the display cannot have this size.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_display_resized(
    display: Option<&EyeboxDisplay>,
    rows: usize,
    columns: usize,
    resized: Option<&mut MaybeUninit<*mut EyeboxDisplay>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(resized, || {
            let display = Display { height: rows, width: columns, ..given(display, "display")?.0.clone() };
            // This refuses a size that the optics of any color cannot have.
            colors(&display, 0)?.into_iter().try_for_each(|color| display.optics(color).map(drop))?;
            Ok(EyeboxDisplay(display))
        })
    })
}

/// Frees a display. Null is allowed and has no effect.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_display_free(display: Option<Box<EyeboxDisplay>>) {
    free(display);
}
