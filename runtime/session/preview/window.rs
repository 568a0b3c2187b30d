//! An ordinary window that shows pictures and never waits.

use super::picture::Picture;
use super::place::Rect;
use super::{Overlay, PreviewError, draw_overlay};
use crate::gpu::Gpu;
use crate::present::{Desktop, OrdinaryWindow, Policy, Swapchain, WindowEvent};

/// A window on the same desktop as playback's. Whoever pumps the desktop calls [`refresh`](Self::refresh) now and then.
pub struct PreviewWindow {
    // Before the window that it shows in.
    swapchain: Swapchain,
    window: OrdinaryWindow,
    frame: Picture,
    fresh: bool,
}

impl PreviewWindow {
    /// Opens it, shown from this device or from the one of its instance that can show there; its inside has `size` rows and columns, if the desktop agrees.
    ///
    /// # Errors
    /// [`PreviewError::Desktop`]; [`PreviewError::Engine`] where Vulkan cannot show pictures in it.
    pub fn open(gpu: &Gpu, desktop: &mut Desktop, title: &str, size: [usize; 2]) -> Result<Self, PreviewError> {
        let window = desktop.window(title, size)?;
        let handle = window.handle()?;
        // SAFETY: the window lives as long as this, and the swapchain is dropped before it.
        #[allow(unsafe_code)]
        let swapchain = unsafe { Swapchain::open(gpu, handle, Policy::Newest) }?;
        let frame = Picture::black(window.size());
        Ok(Self { swapchain, window, frame, fresh: true })
    }

    /// Rows and columns of its inside; zero while it is minimised.
    pub fn size(&self) -> [usize; 2] {
        self.window.size()
    }

    /// The device that it shows from.
    pub fn gpu(&self) -> &Gpu {
        self.swapchain.gpu()
    }

    /// Writes another title.
    pub fn title(&self, title: &str) {
        self.window.title(title);
    }

    /// The next thing that happened, as far as the desktop was pumped.
    pub fn event(&mut self) -> Option<WindowEvent> {
        let event = self.window.event()?;
        if matches!(event, WindowEvent::Exposed | WindowEvent::Resized(_)) {
            self.fresh = true;
        }
        Some(event)
    }

    /// From now on it shows these pictures at their places, on black, and this over them. A picture of another size than
    /// its place, made before the window was resized, is stretched without care: the next one fits.
    pub fn show(&mut self, pictures: &[(Rect, &Picture)], overlay: &Overlay) {
        self.frame = compose(self.size(), pictures, overlay);
        self.fresh = true;
    }

    /// Hands what is new to the screen, if that takes it without waiting; whether it is all there now.
    ///
    /// # Errors
    /// [`PreviewError::Engine`] for a window that is gone, or a device lost.
    pub fn refresh(&mut self) -> Result<bool, PreviewError> {
        if self.fresh && self.window.size() != [0, 0] && self.swapchain.show_newest(&self.frame.rgb, self.frame.size)? {
            self.fresh = false;
        }
        Ok(!self.fresh)
    }
}

/// What a window of `size` rows and columns shows.
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
        // An old picture in a new place is stretched; nothing is read or written outside.
        let large = compose([12, 36], &[(places([12, 36], [4, 6], 1)[0], &a)], &Overlay::default());
        assert_eq!(large.rgb[3 * 9..3 * 9 + 6], [1, 2, 3, 1, 2, 3]);
        compose([2, 2], &[(Rect { top: 1, left: 1, height: 9, width: 9 }, &a)], &Overlay::default());
        compose([0, 0], &[(at[0], &a)], &Overlay::default());
    }
}
