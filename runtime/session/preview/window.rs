//! Shows pictures in an ordinary window and never waits.

use super::picture::Picture;
use super::place::Rect;
use super::{Overlay, PreviewError, draw_overlay};
use crate::gpu::Gpu;
use crate::present::{Desktop, OrdinaryWindow, Policy, Swapchain, WindowEvent};

/// A window on the same desktop as playback. The owner that pumps the desktop calls [`refresh`](Self::refresh)
/// repeatedly.
pub struct PreviewWindow {
    // The swapchain is declared before its window because fields are dropped in this order.
    swapchain: Swapchain,
    window: OrdinaryWindow,
    frame: Picture,
    fresh: bool,
}

impl PreviewWindow {
    /// Opens a window with `size` rows and columns inside, if the desktop agrees. It shows from this device, or from
    /// the device of its instance that can show there.
    ///
    /// # Errors
    /// Returns [`PreviewError::Desktop`], or [`PreviewError::Engine`] if Vulkan cannot show pictures in the window.
    pub fn open(gpu: &Gpu, desktop: &mut Desktop, title: &str, size: [usize; 2]) -> Result<Self, PreviewError> {
        let window = desktop.window(title, size)?;
        let handle = window.handle()?;
        // SAFETY: the window lives as long as this, and the swapchain is dropped before it.
        #[allow(unsafe_code)]
        let swapchain = unsafe { Swapchain::open(gpu, handle, Policy::Newest) }?;
        let frame = Picture::black(window.size());
        Ok(Self { swapchain, window, frame, fresh: true })
    }

    /// Returns the rows and columns of its inside, which are zero while it is minimized.
    pub fn size(&self) -> [usize; 2] {
        self.window.size()
    }

    /// Returns the device that shows the pictures.
    pub fn gpu(&self) -> &Gpu {
        self.swapchain.gpu()
    }

    /// Sets the title of the window.
    pub fn title(&self, title: &str) {
        self.window.title(title);
    }

    /// Returns the next event that the desktop has pumped.
    pub fn event(&mut self) -> Option<WindowEvent> {
        let event = self.window.event()?;
        if matches!(event, WindowEvent::Exposed | WindowEvent::Resized(_)) {
            self.fresh = true;
        }
        Some(event)
    }

    /// Sets the pictures at their places on black, with this overlay. A picture whose size differs from its place,
    /// because it was made before a resize, is stretched without filtering. The next picture fits.
    pub fn show(&mut self, pictures: &[(Rect, &Picture)], overlay: &Overlay) {
        self.frame = compose(self.size(), pictures, overlay);
        self.fresh = true;
    }

    /// Hands new content to the screen if this needs no waiting. Returns true if the screen has all of it.
    ///
    /// # Errors
    /// Returns [`PreviewError::Engine`] if the window or the device is lost.
    pub fn refresh(&mut self) -> Result<bool, PreviewError> {
        if self.fresh && self.window.size() != [0, 0] && self.swapchain.show_newest(&self.frame.rgb, self.frame.size)? {
            self.fresh = false;
        }
        Ok(!self.fresh)
    }
}

/// Composes the picture of a window of `size` rows and columns.
fn compose(size: [usize; 2], pictures: &[(Rect, &Picture)], overlay: &Overlay) -> Picture {
    let mut frame = Picture::black(size);
    for (place, picture) in pictures {
        let [rows, columns] = picture.size;
        if rows == 0 || columns == 0 {
            continue;
        }
        let (bottom, right) = ((place.top + place.height).min(size[0]), (place.left + place.width).min(size[1]));
        for row in place.top..bottom {
            let from = &picture.rgb[3 * columns * ((row - place.top) * rows / place.height)..][..3 * columns];
            let to = &mut frame.rgb[3 * row * size[1]..3 * (row + 1) * size[1]];
            if columns == place.width && right == place.left + place.width {
                to[3 * place.left..3 * right].copy_from_slice(from);
                continue;
            }
            for column in place.left..right {
                let at = 3 * ((column - place.left) * columns / place.width);
                to[3 * column..3 * column + 3].copy_from_slice(&from[at..at + 3]);
            }
        }
    }
    draw_overlay(&mut frame, overlay);
    frame
}

#[cfg(test)]
mod tests {
    use super::super::places;
    use super::*;

    #[test]
    fn pictures_lie_at_their_places_on_black() {
        let picture = |size: [usize; 2], value: u8| {
            let rgb = (0..3 * size[0] * size[1]).map(|i| value.wrapping_add(i as u8)).collect();
            Picture { size, rgb }
        };
        let (a, b) = (picture([4, 6], 1), picture([4, 6], 90));
        let at = places([4, 18], [4, 6], 2);
        let frame = compose([4, 18], &[(at[0], &a), (at[1], &b)], &Overlay::default());
        let row = |y: usize| &frame.rgb[54 * y..54 * (y + 1)];
        assert_eq!((at[0].left, at[1].left, at[0].width), (1, 11, 6));
        for y in 0..4 {
            let line = |p: &Picture| p.rgb[18 * y..18 * (y + 1)].to_vec();
            let expected = [vec![0; 3], line(&a), vec![0; 12], line(&b), vec![0; 3]].concat();
            assert_eq!(row(y), expected);
        }
        // An old picture in a new place is stretched, and no access is out of bounds.
        let large = compose([12, 36], &[(places([12, 36], [4, 6], 1)[0], &a)], &Overlay::default());
        assert_eq!(large.rgb[3 * 9..3 * 9 + 6], [1, 2, 3, 1, 2, 3]);
        compose([2, 2], &[(Rect { top: 1, left: 1, height: 9, width: 9 }, &a)], &Overlay::default());
        compose([0, 0], &[(at[0], &a)], &Overlay::default());
    }
}
