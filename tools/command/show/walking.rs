//! Moves the camera in front of splats by the keys and the mouse of the window of `--view`.

use eyebox::low_level::present::{WindowEvent, WindowKey};
use eyebox::low_level::session::WalkHandle;

/// Displacement of the camera by a key, in proportion to the distance of the middle of the scene, and turn (radians).
const STEP: f64 = 0.03;
const TURN: f64 = 0.04;
/// Turn of the camera per pixel of a mouse that is dragged (radians).
const DRAG: f64 = 0.003;

/// The camera, and the mouse that moves it.
pub(super) struct Walker {
    camera: WalkHandle,
    /// The last place of the mouse (row, column).
    pointer: Option<[f64; 2]>,
    /// True while the left button is pressed.
    dragging: bool,
}

impl Walker {
    pub(super) fn new(camera: WalkHandle) -> Self {
        Self { camera, pointer: None, dragging: false }
    }

    /// Moves the camera by an event of the window. Returns false if the event has another meaning.
    pub(super) fn take(&mut self, event: WindowEvent) -> bool {
        let camera = &self.camera;
        match event {
            WindowEvent::Key(WindowKey::Arrow([right, down])) => {
                camera.turn([f64::from(right) * TURN, 0.0]);
                camera.step([0.0, 0.0, -f64::from(down) * STEP]);
            }
            WindowEvent::Key(WindowKey::Character('a')) => camera.step([-STEP, 0.0, 0.0]),
            WindowEvent::Key(WindowKey::Character('d')) => camera.step([STEP, 0.0, 0.0]),
            WindowEvent::Wheel(notches) => camera.step([0.0, 0.0, notches * STEP]),
            WindowEvent::Key(WindowKey::Home) => camera.home(),
            WindowEvent::Button(pressed) => self.dragging = pressed,
            WindowEvent::Pointer([row, column]) => {
                let before = self.pointer.replace([row, column]);
                // The scene follows the mouse, so the camera turns the other way.
                if let (true, Some(before)) = (self.dragging, before) {
                    camera.turn([(before[1] - column) * DRAG, (before[0] - row) * DRAG]);
                }
                return self.dragging;
            }
            _ => return false,
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::optics::{Color, Display};
    use eyebox::low_level::scene::{MovingSplats, Request};
    use eyebox::low_level::session::SplatWalk;

    fn walker() -> Walker {
        let display = Display { height: 16, width: 16, ..Display::load("small").unwrap() };
        let request = Request::new(&display, &[Color::Green]);
        let splats = MovingSplats::new("builtin:still-life-splats", &request).unwrap();
        Walker::new(SplatWalk::new(splats, &display, &[Color::Green], None).handle())
    }

    #[test]
    fn the_scene_follows_a_mouse_that_is_dragged() {
        let mut walker = walker();
        let (camera, start) = (walker.camera.clone(), walker.camera.camera());
        // Without the button, the mouse may be the tracker.
        assert!(!walker.take(WindowEvent::Pointer([10.0, 10.0])) && camera.camera() == start);
        assert!(walker.take(WindowEvent::Button(true)) && camera.camera() == start);
        assert!(walker.take(WindowEvent::Pointer([10.0, 30.0])));
        // Content moves to the right, so the camera looks to the left. Its axes are right, downwards and forward.
        let to_the_left = camera.camera();
        assert!((to_the_left.axes[2][0] - start.axes[2][0] + (20.0 * DRAG).sin()).abs() < 1e-9);
        assert_eq!(to_the_left.place, start.place);
        walker.take(WindowEvent::Pointer([0.0, 30.0]));
        assert!((camera.camera().axes[2][1] - (10.0 * DRAG).sin()).abs() < 1e-9, "{:?}", camera.camera());
        assert!(walker.take(WindowEvent::Button(false)));
        let turned = camera.camera();
        assert!(!walker.take(WindowEvent::Pointer([50.0, 50.0])) && camera.camera() == turned);
        assert!(walker.take(WindowEvent::Key(WindowKey::Home)) && camera.camera() == start);
    }

    #[test]
    fn keys_and_the_wheel_move_the_camera() {
        let mut walker = walker();
        let (camera, start) = (walker.camera.clone(), walker.camera.camera());
        let mut moved = |event| {
            assert!(walker.take(event));
            let now = camera.camera();
            camera.home();
            [0, 1, 2].map(|i| now.place[i] - start.place[i])
        };
        let forward = moved(WindowEvent::Wheel(2.0));
        let up = moved(WindowEvent::Key(WindowKey::Arrow([0, -1])));
        assert!(forward[2] > 0.0 && (forward[2] - 2.0 * up[2]).abs() < 1e-9, "{forward:?} {up:?}");
        let [left, right] = ['a', 'd'].map(|key| moved(WindowEvent::Key(WindowKey::Character(key))));
        assert!(right[0] > 0.0 && (left[0] + right[0]).abs() < 1e-9, "{left:?} {right:?}");
        assert!(!walker.take(WindowEvent::Key(WindowKey::Character('s'))));
    }
}
