//! Situations with numbers on the command line, paths of results, and displays of holograms.

use crate::common::done;
use crate::frame::{Case, Chapter, Outcome, Remedy, Situation, case, change, mended};
use crate::ground::{Ground, open};
use crate::judge::Judge;
use crate::write::file;
use eyebox::low_level::files::read_npy;
use std::path::Path;
use std::sync::OnceLock;

const SOLVE: &str = "solve builtin:still-life --views 3 --size 24x32 --color green --frames 1 --steps 1 --engine cpu";

fn run(at: &Path, words: &str) {
    done(at, &words.split_whitespace().collect::<Vec<_>>());
}

fn hologram(at: &Path) {
    run(at, &format!("{SOLVE} -o h.zarr"));
}

/// Checks that the view shows the hologram through the right pupil.
const VIEW: Judge = Judge::By(|outcome| {
    static RIGHT: OnceLock<Vec<f32>> = OnceLock::new();
    let right = RIGHT.get_or_init(|| {
        let temp = crate::common::folder();
        hologram(temp.path());
        run(temp.path(), "render h.zarr --pupil=2,-1,4,1.5 --engine cpu -o v.npy");
        read_npy(&temp.path().join("v.npy")).expect("a view").values
    });
    let places = ["v.npy", "out/v.npy"].map(|name| outcome.folder.join(name));
    let place = places.iter().find(|place| place.exists()).ok_or("no view was written")?;
    let found = read_npy(place).map_err(|e| e.to_string())?.values;
    if &found == right { Ok(()) } else { Err("the view differs".into()) }
});

/// Checks that the command wrote one video frame of the hologram's size.
const FRAMES: Judge = Judge::By(|outcome| {
    let frames = ["frames", "out/frames"].map(|name| outcome.folder.join(name).join("frame-00000.png"));
    let place = frames.iter().find(|place| place.exists()).ok_or("no video frame was written")?;
    let size = image::image_dimensions(place).map_err(|e| e.to_string())?;
    if size == (32, 24) { Ok(()) } else { Err(format!("a video frame of {size:?}")) }
});

/// Checks that the command wrote a hologram of the usual size with this number of sub-frames.
fn solved(outcome: &Outcome, frames: usize) -> Result<(), String> {
    run(outcome.folder, "convert y.zarr y.npy");
    let values = read_npy(&outcome.folder.join("y.npy")).map_err(|e| e.to_string())?.values.len();
    if values == frames * 24 * 32 { Ok(()) } else { Err(format!("{values} phases")) }
}

const SOLVED: Judge = Judge::By(|outcome| solved(outcome, 1));

fn view(have: &str, words: &str) -> Case {
    case(have, format!("render h.zarr {words} --engine cpu"), hologram)
}

fn encode(have: &str, words: &str) -> Case {
    case(have, format!("encode h.zarr {words} --engine cpu"), |at| {
        hologram(at);
        file(&at.join("f"), "text");
        file(&at.join("mine/thesis.tex"), "text");
    })
}

fn solve(have: &str, words: &str) -> Case {
    case(have, format!("{SOLVE} {words} -o y.zarr"), |_| ())
}

pub fn chapter() -> Chapter {
    let mut situations = numbers();
    situations.extend(denied());
    situations.extend(places());
    situations.extend(displays());
    Chapter {
        title: "Numbers, places and displays",
        about: "The hologram `h.zarr` has one sub-frame of 24 x 32 phases for the display `paper`.",
        situations,
    }
}

fn numbers() -> Vec<Situation> {
    let pupil = |have, pupil: &str, cause, form, from, to| {
        view(have, &format!("--pupil={pupil} -o v.npy")).refused(cause, Remedy::As(form, from, to), VIEW)
    };
    let form = "2,-1,4,1.5";
    vec![
        pupil("A pupil lacks its focus.", "2,-1,4", "usage/value-validation", form, "2,-1,4", "2,-1,4,1.5"),
        pupil("A pupil has a fifth number.", "2,-1,4,1.5,0", "usage/value-validation", form, "1.5,0", "1.5"),
        pupil("A pupil has semicolons.", "'2;-1;4;1.5'", "usage/value-validation", form, "'2;-1;4;1.5'", "2,-1,4,1.5"),
        pupil("A pupil contains a word.", "two,-1,4,1.5", "usage/value-validation", form, "two", "2"),
        pupil("A pupil is in meters.", "2,-1,0.004,1.5", "arguments/unusual 0.004", "4", "0.004", "4"),
        pupil("A pupil is outside of the eyebox.", "200,-1,4,1.5", "arguments/outside-eyebox", "13.00", "200", "2"),
        case("A negative number of steps.", SOLVE.replace("--steps 1", "--steps -2") + " -o y.zarr", |_| ()).refused(
            "usage/value-validation '-2'",
            Remedy::By("a whole number, 0 or more", "--steps -2", "--steps 2"),
            SOLVED,
        ),
        solve("The range of diameters is the wrong way around.", "--pupil-diameter 8..2").refused(
            "usage/value-validation '8..2'",
            Remedy::By("smallest first", "8..2", "2..8"),
            SOLVED,
        ),
        solve("The efficiency is in percent.", "--set efficiency=40").refused(
            "solve/setting 40",
            Remedy::By("at most 1", "40", "0.4"),
            SOLVED,
        ),
        solve("The pitch of views is in meters.", "--view-pitch 0.002").refused(
            "optics/unusual 0.002",
            Remedy::By("probably 2 mm is meant", "0.002", "2"),
            SOLVED,
        ),
        solve("A time is in millimeters.", "--duration 60mm").refused(
            "usage/value-validation/other-dimension '60mm'",
            Remedy::By("ms, s, min", "60mm", "60s"),
            SOLVED,
        ),
        solve("The name of a display is misspelled.", "--display papr").refused(
            "optics/unknown-display 'papr'",
            Remedy::As("paper", "papr", "paper"),
            SOLVED,
        ),
    ]
}

fn places() -> Vec<Situation> {
    vec![
        view("A view goes to a JPEG file.", "--pupil=2,-1,4,1.5 -o v.jpg").refused(
            "arguments/ending v.jpg",
            Remedy::As(".png .npy", "v.jpg", "v.npy"),
            VIEW,
        ),
        view("The name of a view has no ending.", "--pupil=2,-1,4,1.5 -o v").refused(
            "arguments/ending",
            Remedy::As(".png .npy", "-o v", "-o v.npy"),
            VIEW,
        ),
        view("A view goes to a folder that does not exist.", "--pupil=2,-1,4,1.5 -o out/v.npy").refused(
            "arguments/no-such-folder",
            mended("make it", |at| std::fs::create_dir(at.join("out")).expect("a folder")),
            VIEW,
        ),
        case(
            "The path of a view has a file instead of a folder.",
            "render h.zarr --pupil=2,-1,4,1.5 -o f/v.npy",
            |at| {
                hologram(at);
                file(&at.join("f"), "text");
            },
        )
        .refused("arguments/no-such-folder", Remedy::By("give another place", "f/v.npy", "v.npy"), VIEW),
        encode("Video frames go to a folder inside a folder that does not exist.", "-o out/frames").refused(
            "file/taken/no-such-folder",
            mended("make it", |at| std::fs::create_dir(at.join("out")).expect("a folder")),
            FRAMES,
        ),
        encode("Video frames go to the path of a file.", "-o f").refused(
            "file/taken/is-a-file",
            Remedy::By("give another place", "-o f", "-o frames"),
            FRAMES,
        ),
        encode("Video frames go to a folder of other files.", "-o mine").refused(
            "file/taken/holds-something-else",
            Remedy::By("give another place", "-o mine", "-o frames"),
            FRAMES,
        ),
        encode("The path of video frames has a file instead of a folder.", "-o f/frames").refused(
            "file/taken/no-such-folder",
            Remedy::By("give another place", "f/frames", "frames"),
            FRAMES,
        ),
        case("A hologram goes to a picture file.", format!("{SOLVE} -o y.png"), |_| ()).refused(
            "arguments/ending y.png",
            Remedy::As(".zarr", "y.png", "y.zarr"),
            SOLVED,
        ),
        case("The path of a hologram is given as an output of `show`.", format!("{SOLVE} --output y.zarr"), |_| ())
            .refused("usage/value-validation 'y.zarr'", Remedy::As("--out", "--output", "--out"), SOLVED),
    ]
}

/// Returns situations with disks, folders and files that allow no access.
fn denied() -> Vec<Situation> {
    vec![
        view("The disk for a view is full.", "--pupil=2,-1,4,1.5 -o full/v.npy")
            .refused("file/full", Remedy::By("write elsewhere", "full/v.npy", "v.npy"), VIEW)
            .on(Ground::Disk("size=4k,nr_inodes=1")),
        view("A view goes to a read-only disk.", "--pupil=2,-1,4,1.5 -o full/v.npy")
            .refused("file/denied", Remedy::By("give another place", "full/v.npy", "v.npy"), VIEW)
            .on(Ground::Disk("ro")),
        case(
            "A view goes to a folder of another user.",
            "render h.zarr --pupil=2,-1,4,1.5 --engine cpu -o theirs/v.npy",
            |at| {
                hologram(at);
                for (name, mode) in [("theirs", 0o555), ("out", 0o777)] {
                    std::fs::create_dir(at.join(name)).expect("a folder");
                    open(&at.join(name), mode);
                }
            },
        )
        .refused("file/denied", Remedy::By("give another place", "theirs/v.npy", "out/v.npy"), VIEW)
        .on(Ground::Stranger),
        case("A hologram is not readable.", "render h.zarr --pupil=2,-1,4,1.5 --engine cpu -o out/v.npy", |at| {
            hologram(at);
            std::fs::create_dir(at.join("out")).expect("a folder");
            open(&at.join("out"), 0o777);
            open(&at.join("h.zarr"), 0);
        })
        .refused("file/read", change("chmod", |at| open(&at.join("h.zarr"), 0o755)), VIEW)
        .on(Ground::Stranger),
    ]
}

fn displays() -> Vec<Situation> {
    vec![
        encode("A hologram is encoded without a size in the command.", "-o frames").right(FRAMES),
        encode("A hologram is encoded for another size.", "--size 48x64 -o frames").refused(
            "arguments/size 24x32",
            Remedy::Replace("--size 48x64", "--size 24x32"),
            FRAMES,
        ),
        encode("A hologram of 8 bits is encoded for 8 bit-planes.", "--display planes8 --size 24x32 -o frames")
            .refused(
                "encode/mismatch/sub-frames",
                mended("use 8 sub-frames", |at| {
                    run(at, &format!("{} -o h.zarr", SOLVE.replace("--frames 1", "--frames 8")));
                }),
                FRAMES,
            ),
        case(
            "A hologram is played on a display of another size.",
            "show h.zarr --size 48x64 --clock simulated --duration 0.1 --record frames --engine cpu",
            hologram,
        )
        .refused(
            "session/setting/size 24x32",
            Remedy::Replace("--size 48x64", "--size 24x32"),
            Judge::By(|_| Ok(())),
        ),
        case(
            "A recording goes to the path of a file.",
            "show h.zarr --clock simulated --duration 0.1 --record f --engine cpu",
            |at| {
                hologram(at);
                file(&at.join("f"), "text");
            },
        )
        .refused(
            "file/taken/is-a-file",
            Remedy::By("give another place", "--record f", "--record g"),
            Judge::By(recorded),
        ),
    ]
}

/// Checks that the recording lists the pictures on the display.
fn recorded(outcome: &Outcome) -> Result<(), String> {
    let shown = std::fs::read_to_string(outcome.folder.join("g/shown.csv")).map_err(|e| e.to_string())?;
    if shown.lines().count() > 2 { Ok(()) } else { Err(format!("recorded: {shown}")) }
}
