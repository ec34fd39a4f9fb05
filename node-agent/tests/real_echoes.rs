//! The examples on real recordings keep their figures; without the recordings nothing is tested.
//!
//! They are looked for in `shared/data` beside every folder above this package.

#![expect(clippy::duplicate_mod, reason = "both examples bring their support")]

use std::path::{Path, PathBuf};

#[expect(dead_code, reason = "the example's own main and command line are not called here")]
#[path = "../examples/et4173_four_uwb.rs"]
mod et4173_four_uwb;
#[expect(dead_code, reason = "the example's own main and command line are not called here")]
#[path = "../examples/p440_rail_sar.rs"]
mod p440_rail_sar;

/// Pictures are committed with the documentation, which must stay small.
const MAX_PICTURE_BYTES: usize = 150_000;

/// The folder of a recording: `shared/data` beside any folder above this package.
#[expect(clippy::print_stderr, reason = "a skipped test has no other way to say so")]
fn data_folder(name: &str) -> Option<PathBuf> {
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors();
    let found = above.map(|folder| folder.join("shared/data").join(name)).find(|f| f.is_dir());
    if found.is_none() {
        eprintln!("skipped: there is no recording {name} in shared/data");
    }
    found
}

#[test]
fn the_rail_radar_puts_the_reflector_where_the_cameras_see_it() {
    let Some(folder) = data_folder("p440-rail-sar") else { return };
    let (figures, picture) = p440_rail_sar::run(&folder).unwrap();
    assert!(figures.reflector_error_m < 0.02, "{figures:?}");
    let second = |peak: &p440_rail_sar::Found| (peak.x_m + 2.5).hypot(peak.z_m + 2.3) < 0.1;
    assert!(figures.peaks.iter().skip(1).any(second), "{figures:?}");
    assert!(picture.len() < MAX_PICTURE_BYTES, "{} bytes", picture.len());
}

#[test]
fn four_rings_follow_the_walker() {
    let Some(folder) = data_folder("et4173-4uwb") else { return };
    let (figures, picture) = et4173_four_uwb::run(&folder).unwrap();
    assert!(figures.median_error_m < 0.08, "{figures:?}");
    assert!(figures.p90_error_m < 0.16 && 0.9 < figures.seen_share, "{figures:?}");
    // The triangle is 6.8 m long: he walked all of it, and the track does not wander.
    assert!((5.8..8.0).contains(&figures.track_length_m), "{figures:?}");
    assert!(picture.len() < MAX_PICTURE_BYTES, "{} bytes", picture.len());
}

#[test]
fn an_absent_recording_is_named() {
    let nowhere = Path::new("nowhere");
    let errors =
        [et4173_four_uwb::run(nowhere).unwrap_err(), p440_rail_sar::run(nowhere).unwrap_err()];
    for error in errors {
        assert!(error.to_string().contains("no such recording"), "{error}");
    }
}
