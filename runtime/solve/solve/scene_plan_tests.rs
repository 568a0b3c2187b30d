use super::*;
use crate::scene::{Request, load};

fn plan(
    source: &str,
    change: impl Fn(&mut LightField, &Display),
    change_request: impl Fn(&mut PlanRequest),
) -> ScenePlan {
    padded(PaddingRule::Need, source, change, change_request)
}

fn padded(
    padding: PaddingRule,
    source: &str,
    change: impl Fn(&mut LightField, &Display),
    change_request: impl Fn(&mut PlanRequest),
) -> ScenePlan {
    let display = Display { height: 96, width: 120, ..Display::preset("small").unwrap() };
    let colors = [Color::Red, Color::Green, Color::Blue];
    let mut field = load(source, &Request::new(&display, &colors)).unwrap();
    change(&mut field, &display);
    let settings = Settings { diameter: [2e-3, 18e-3], padding, ..Settings::default() };
    let mut request = PlanRequest { settings: &settings, depth: None, full: Full::default(), contrast: None };
    change_request(&mut request);
    ScenePlan::new(&field, &display, &request).unwrap()
}

fn black_out(color: usize) -> impl Fn(&mut LightField, &Display) {
    move |field, _| field.planes[color].iter_mut().flatten().for_each(|v| *v = 0.0)
}

#[test]
fn a_deep_scene_needs_everything() {
    let all = plan("builtin:still-life?span=2", |_, _| (), |_| ());
    assert_eq!((all.colors.len(), all.merge, all.outer), (3, 1, [0, 0]));
    assert_ne!(all.padding, Padding::default());
    assert!(all.settings.depth[0] < 0.0 && all.settings.depth[1] > 0.0);
    assert_eq!(all.settings.window, WindowFactor::One);
}

#[test]
fn a_flat_scene_is_one_view_and_one_plane() {
    let flat = plan("builtin:plane", |_, _| (), |_| ());
    assert_eq!((flat.merge, flat.settings.depth, flat.padding), (9, [0.0, 0.0], Padding::default()));
    // An eye that focuses elsewhere sees it blurred, which requires all views.
    let blurred = plan("builtin:plane", |_, _| (), |w| w.depth = Some([-1e-3, 1e-3]));
    assert_eq!((blurred.merge, blurred.settings.depth), (1, [-1e-3, 1e-3]));
    let kept = plan("builtin:plane", |_, _| (), |w| w.full = Full::ALL);
    assert_eq!((kept.merge, kept.settings.window), (1, WindowFactor::Full));
}

/// Target images decide merging, not the depth that the scene states.
#[test]
fn a_scene_that_calls_itself_flat_and_is_not_keeps_its_views() {
    let lies = |field: &mut LightField, _: &Display| (field.depth, field.disparity) = (Some([0.0, 0.0]), None);
    let plan = plan("builtin:still-life", lies, |_| ());
    assert_eq!(plan.merge, 1);
    assert!(plan.choices.iter().any(|c| c.what == "views" && c.why.contains(" dB")), "{:?}", plan.choices);
}

#[test]
fn colours_without_light_are_not_solved() {
    let one = plan("builtin:plane", black_out(0), |_| ());
    assert_eq!((one.colors, one.dark), (vec![Color::Green, Color::Blue], vec![Color::Red]));
    assert_eq!(plan("builtin:plane", black_out(0), |w| w.full.colors = true).colors.len(), 3);
    let none = plan("builtin:plane", |f, _| f.planes.iter_mut().flatten().flatten().for_each(|v| *v = 0.0), |_| ());
    assert_eq!((none.colors, none.dark.len()), (vec![Color::Red], 2));
}

#[test]
fn padding_goes_where_the_margins_are_black() {
    let margins = |field: &mut LightField, _: &Display| {
        let (h, w) = (field.height, field.width);
        for view in field.planes.iter_mut().flatten() {
            let edge = |i: usize| (i / w).min(h - 1 - i / w) < 16 || (i % w).min(w - 1 - i % w) < 16;
            view.iter_mut().enumerate().filter(|(i, _)| edge(*i)).for_each(|(_, v)| *v = 0.0);
        }
    };
    let padding = |change: &dyn Fn(&mut LightField, &Display), rule| {
        let plan = padded(rule, "builtin:still-life?span=2", change, |_| ());
        assert_eq!(plan.settings.padding == PaddingRule::Always, plan.padding != Padding::default());
        plan.padding
    };
    assert_ne!(padding(&|_, _| (), PaddingRule::Need), Padding::default());
    assert_eq!(padding(&margins, PaddingRule::Need), Padding::default());
    assert_ne!(padding(&margins, PaddingRule::Always), Padding::default());
    assert_eq!(padding(&|_, _| (), PaddingRule::Never), Padding::default());
}

#[test]
fn sub_frames_follow_the_contrast() {
    let frames = |c| plan("builtin:plane", |_, _| (), |w| w.contrast = Some(c)).settings.frames;
    assert_eq!([1.0, 0.5, 0.354, 0.35, 0.25].map(frames), [1, 4, 8, 9, 16]);
}
