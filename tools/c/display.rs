//! Displays.

use crate::arrays::{given, hand_over, text};
use crate::failure::{Failure, answer, free};
use crate::{EYEBOX_BLUE, EYEBOX_GREEN, EYEBOX_RED, EyeboxStatus};
use eyebox::optics::{Color, Display};
use std::ffi::c_char;
use std::mem::MaybeUninit;

/// A display: the SLM, its optics and how it takes its phases. It never changes.
pub struct EyeboxDisplay(pub(crate) Display);

/// The bit of a colour.
pub(crate) fn bit(color: Color) -> u32 {
    match color {
        Color::Red => EYEBOX_RED,
        Color::Green => EYEBOX_GREEN,
        Color::Blue => EYEBOX_BLUE,
    }
}

/// Colours of a display by their bits; none for all that it has.
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

/// A display by the name of a preset, such as "paper", "small" or "planes8", or from a TOML file.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_display_load(
    name: *const c_char,
    display: Option<&mut MaybeUninit<*mut EyeboxDisplay>>,
) -> EyeboxStatus {
    // SAFETY: the header asks callers for texts that end with zero.
    answer(|| hand_over(display, || Ok(EyeboxDisplay(Display::load(unsafe { text(name, "name") }?)?))))
}

/// A display from the text of a display file (docs/displays.md). Files that it names lie in the working folder.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn eyebox_display_from_toml(
    toml: *const c_char,
    display: Option<&mut MaybeUninit<*mut EyeboxDisplay>>,
) -> EyeboxStatus {
    answer(|| {
        hand_over(display, || {
            // SAFETY: the header asks callers for texts that end with zero.
            Ok(EyeboxDisplay(Display::from_toml(unsafe { text(toml, "toml") }?, "display")?))
        })
    })
}

/// The same display with so many rows and columns of pixels.
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
            // Every colour has the optics of that size, or none can be.
            colors(&display, 0)?.into_iter().try_for_each(|color| display.optics(color).map(drop))?;
            Ok(EyeboxDisplay(display))
        })
    })
}

/// Frees a display; null is nothing to free.
#[unsafe(no_mangle)]
pub extern "C" fn eyebox_display_free(display: Option<Box<EyeboxDisplay>>) {
    free(display);
}
