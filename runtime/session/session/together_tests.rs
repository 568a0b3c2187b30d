//! Tests a refiner for simultaneous color.

use crate::encode::Encoder;
use crate::optics::Color;
use crate::optics::wrap_phase;
use crate::session::stage::*;
use crate::session::tests::aim;
use crate::session::*;
use crate::solve::random_phases;
use eyebox_base::error::ErrorData;

fn phases(refiner: &mut LiveRefiner) -> Vec<Vec<f32>> {
    refiner.phases().unwrap().iter().map(|of_color| of_color.to_vec()).collect()
}

/// A step covers all colors, whose phases stay phases of one drive. A jump starts again from the drive for the whole
/// eyebox.
#[test]
fn colours_are_stepped_together_and_begin_again_together() {
    let whole = joint_colors(&joint_display());
    let mut refiner = LiveRefiner::new(whole.clone(), Policy::default(), cpu).unwrap();
    let begun = phases(&mut refiner);
    for (color, phases) in whole.iter().zip(&begun) {
        let off = color.phases.iter().zip(phases).map(|(a, b)| 1.0 - (a - b).cos()).fold(0.0, f32::max);
        assert!(off < 1e-6, "{off}");
    }
    assert!(refiner.phases_on_device().is_none());
    refiner.aim(aim(0.0)).unwrap();
    let mut asked = Vec::new();
    let mut losses = Vec::new();
    for _ in 0..4 {
        let taken = refiner.round_while(|steps, _| {
            asked.push(steps);
            true
        });
        assert_eq!(taken.unwrap(), 3);
        losses.push(refiner.estimated_db().expect("steps were taken"));
    }
    assert_eq!(asked, [3; 4]);
    assert!(losses[3] > losses[0] + 0.5, "{losses:?}");
    assert_eq!(refiner.round_while(|_, expected| expected.is_zero()).unwrap(), 0);
    let refined = phases(&mut refiner);
    let sent = refiner.sent().unwrap();
    assert!(sent.len() == 1 && sent[0] == refined[0] && refined[0] != begun[0], "red is what drives are meant at");
    for (color, phases) in whole.iter().zip(&refined) {
        assert_eq!(color.laser.as_ref().unwrap().phases(&refined[0]), *phases);
    }
    assert!(!refiner.aim(aim(1e-3)).unwrap() && phases(&mut refiner) == refined);
    assert!(refiner.aim(aim(-8e-3)).unwrap());
    assert!(phases(&mut refiner) == begun);
    assert_eq!(refiner.counts(), [1, 12]);
}

/// If every color covers more than a turn over all drives, the drives are sent instead of the phases of a color.
#[test]
fn an_slm_of_two_turns_receives_its_drives() {
    let mut display = joint_display();
    display.dispersion.insert(Color::Red, 2.0);
    let whole = joint_colors(&display);
    let drives = random_phases(3 * SIZE[0] * SIZE[1], 4);
    let mut refiner = LiveRefiner::new(whole.clone(), Policy::default(), cpu).unwrap();
    let apart = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| wrap_phase(a - b).abs()).fold(0.0, f32::max);
    assert!(apart(refiner.sent().unwrap()[0], &drives) < 1e-5);
    refiner.aim(aim(0.0)).unwrap();
    assert_eq!(refiner.round_while(|_, _| true).unwrap(), 3);
    let sent = refiner.sent().unwrap()[0].to_vec();
    assert!(apart(&sent, &drives) > 0.1);
    for (color, phases) in whole.iter().zip(phases(&mut refiner)) {
        let laser = color.laser.as_ref().unwrap();
        assert!(laser.slope >= 2.0 && apart(&laser.phases(&sent), &phases) < 1e-5);
    }
}

/// Moving content shifts the drives with wraparound, and all colors with them. If the losses are compared and the shift
/// has the higher loss, the drives stay.
#[test]
fn drives_go_with_the_content() {
    let whole = joint_colors(&joint_display());
    let lighting = Encoder::new(&joint_display(), &ALL[..1], 3).unwrap().lighting(false).shared_by(3);
    let mut refiner = LiveRefiner::new(whole.clone(), Policy::default(), cpu).unwrap();
    refiner.aim(aim(0.0)).unwrap();
    (0..6).for_each(|_| assert_eq!(refiner.round_while(|_, _| true).unwrap(), 3));
    let before = phases(&mut refiner);
    // The scene is still, so shifted phases have a higher loss.
    assert_eq!(refiner.shift_phases(&[[5, 2]], &lighting, true).unwrap(), (false, 6));
    assert!(phases(&mut refiner) == before);
    assert_eq!(refiner.shift_phases(&[[5, 2]], &lighting, false).unwrap(), (true, 0));
    let [height, width] = SIZE;
    for (color, (before, after)) in before.iter().zip(phases(&mut refiner)).enumerate() {
        for (at, is) in after.iter().enumerate() {
            let (frame, row, column) = (at / (height * width), at / width % height, at % width);
            let from = (row + height - 2) % height * width + (column + width - 5) % width;
            assert_eq!(*is, before[frame * height * width + from], "colour {color}, value {at}");
        }
    }
    // Another view of the scene with the same lasers keeps the drives. Other lasers are refused.
    let moved: Vec<LiveColor> =
        whole.iter().map(|color| LiveColor { phases: Vec::new(), ..shifted_color(color, 5) }).collect();
    let kept = phases(&mut refiner);
    assert_eq!(refiner.follow(&moved).unwrap(), Followed::default());
    assert!(phases(&mut refiner) == kept && !refiner.needs_reinit());
    let mut other = moved;
    other[1].laser.as_mut().unwrap().powers = vec![1.0; 3];
    assert_eq!(ErrorData::of(&refiner.follow(&other).unwrap_err()).code, "setting/other-lasers");
    // For the scene's own hologram, the phases with the lower loss are used.
    let followed = refiner.follow(&whole).unwrap();
    assert_eq!((followed.own + followed.kept, followed.looks), (3, 6));
}

#[test]
fn colours_share_their_sub_frames_all_or_none() {
    let mut some = joint_colors(&joint_display());
    some[2].laser = None;
    let said = LiveRefiner::new(some, Policy::default(), cpu).err().expect("a refusal");
    assert_eq!(ErrorData::of(&said).code, "setting/together", "{said}");
    let mut steep = joint_colors(&joint_display());
    steep[0].laser.as_mut().unwrap().slope = 1.1;
    let said = LiveRefiner::new(steep, Policy::default(), cpu).err().expect("a refusal");
    assert_eq!(ErrorData::of(&said).code, "solve/setting", "{said}");
}
