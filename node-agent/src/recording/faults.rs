//! Every fault of a recording is found and named.

use std::fs;

use serde_json::json;
use zip::CompressionMethod;

use super::tests::{Npy, arrays, fault_of, hand_data, meta_fields, npz, opened, pair, write_meta};
use super::*;

/// An array to put in, and whether the fault is the expected one.
type Case = (&'static str, Option<Npy>, fn(&RecordingFault) -> bool);

#[test]
fn every_fault_of_an_archive_is_named() {
    use RecordingFault as F;
    let real = |shape: &str, numbers: &[f64]| Some(Npy::real(shape, numbers));
    let zeros =
        |descr: &str, shape: &str, count: usize| Some(Npy::new(descr, shape, vec![0; count]));
    let nested = format!("{}3{}", "(".repeat(1000), ",)".repeat(1000));
    let cases: Vec<Case> = vec![
        ("echoes", None, |f| matches!(f, F::MissingArray { array, .. } if array == "echoes")),
        (
            "backgroud",
            zeros("<c8", "(1, 2, 4)", 64),
            |f| matches!(f, F::UnknownArray { array, .. } if array == "backgroud"),
        ),
        ("tx_m", None, |f| matches!(f, F::MissingArray { array, .. } if array == "tx_m")),
        ("echoes", zeros("<f8", "(3, 1, 2, 4)", 192), |f| matches!(f, F::NumberType { .. })),
        ("freq_hz", zeros("|O", "(4,)", 32), |f| matches!(f, F::NumberType { .. })),
        ("echoes", zeros("<c8", "(3, 2, 4)", 192), |f| matches!(f, F::Shape { .. })),
        ("echoes", zeros("<c8", "(3, 2, 1, 4)", 192), |f| matches!(f, F::Shape { .. })),
        ("echoes", zeros("<c8", "(0, 1, 2, 4)", 0), |f| matches!(f, F::NoPeriods)),
        ("echoes", zeros("<c8", "(3, 1, 2, 4)", 100), |f| matches!(f, F::Truncated { .. })),
        ("echoes", zeros("<c8", "(3, 1, 2, 4)", 200), |f| matches!(f, F::Damaged { .. })),
        ("freq_hz", zeros("<f8", "(10000000,)", 32), |f| matches!(f, F::TooLarge { .. })),
        ("node", zeros("<U1000", "()", 4000), |f| matches!(f, F::TooLarge { .. })),
        ("node", zeros("<U1", "(3,)", 12), |f| matches!(f, F::NumberType { .. })),
        (
            "echoes",
            zeros("<c8", "(1000000000000, 1000000000000, 2)", 8),
            |f| matches!(f, F::ArrayHeader { reason, .. } if reason.contains("axes")),
        ),
        (
            "echoes",
            zeros("<c8", &nested, 8),
            |f| matches!(f, F::ArrayHeader { reason, .. } if reason.contains("brackets")),
        ),
        ("echoes", zeros("<c8", "three", 8), |f| matches!(f, F::ArrayHeader { .. })),
        ("freq_hz", real("(4,)", &[4e9, 3e9, 2e9, 1e9]), |f| {
            matches!(f, F::FrequenciesNotAscending { .. })
        }),
        ("period_time_s", real("(3,)", &[0.0, 1.0, 1.0]), |f| {
            matches!(f, F::TimesNotAscending { index: 2, .. })
        }),
        ("period_time_s", real("(2,)", &[0.0, 1.0]), |f| matches!(f, F::Shape { .. })),
        ("rx_m", real("(2, 2)", &[0.0, 0.0, f64::NAN, 0.0]), |f| {
            matches!(f, F::NotFinite { index: 2, .. })
        }),
        ("rx_m", real("(2, 2)", &[0.0; 4]), |f| matches!(f, F::Radar(_))),
        ("background", zeros("<c8", "(1, 2, 3)", 48), |f| matches!(f, F::Shape { .. })),
        ("background", zeros("<c8", "(1, 2, 4)", 64).map(Npy::fortran), |f| {
            matches!(f, F::FortranOrder { .. })
        }),
        ("echoes", zeros("<c8", "(3, 1, 2, 4)", 192).map(Npy::fortran), |f| {
            matches!(f, F::FortranOrder { .. })
        }),
    ];
    for (index, (name, array, is_expected)) in cases.into_iter().enumerate() {
        let found = fault_of(opened(vec![(name, array)]));
        assert!(is_expected(&found), "{index}, {name}: {found}");
    }
}

#[test]
fn a_sample_that_is_no_number_is_placed_after_the_sweeps_before_it() {
    let mut all = arrays();
    all[0].1.1[(8 + 4 + 2) * 8..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    let mut recording = opened(vec![("echoes", Some(all.remove(0).1))]).unwrap();
    assert!(recording.next_sweep().unwrap().is_some());
    let found = fault_of(recording.next_sweep());
    let place = Place { period_index: 1, tx_index: 0, rx_index: 1, frequency_index: 2 };
    assert!(matches!(found, RecordingFault::SampleNotFinite { place: p, .. } if p == place));
    assert!(recording.next_sweep().unwrap().is_none());
}

#[test]
fn every_fault_of_metadata_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let (meta, data) = pair(folder.path());
    fs::write(&data, hand_data()).unwrap();
    let digits = "0".repeat(128);
    let far = json!([{"name": "transmural", "version": "2.0.0"}]);
    let foreign = json!([{"name": "other", "version": "1.0.0", "optional": false}]);
    for (key, value, is_named_by_field) in [
        ("core:version", json!("2.0.0"), true),
        ("core:datatype", json!("ci16_le"), true),
        ("core:num_channels", json!(3), true),
        ("core:extensions", far, true),
        ("core:extensions", foreign, false),
        ("core:metadata_only", json!(true), true),
        ("core:dataset", json!("../other.bin"), true),
        ("core:trailing_bytes", json!(4), true),
        ("core:sha512", json!(12), true),
        ("transmural:start_hz", json!("1e9"), true),
        ("transmural:step_hz", json!(-1.0), false),
        ("transmural:step_count", json!(4.5), true),
        ("transmural:step_count", json!(1_000_000_000_000_000_000_u64), false),
        ("transmural:tx_m", json!([[0, 0, 0]]), true),
        ("transmural:period_s", json!(0), true),
        ("transmural:period_time_s", json!([1.0, null, 3.0]), true),
        ("transmural:background_sweep_count", json!(1_u64 << 40), false),
        ("transmural:background_sweep_count", json!(5), false),
        ("transmural:node", json!(7), true),
        ("transmural:strat_hz", json!(1e9), true),
    ] {
        let mut global = meta_fields();
        global[key] = value;
        write_meta(&meta, &global);
        let found = fault_of(Recording::open(&meta));
        let named = matches!(&found, RecordingFault::Field { field, .. } if field == key);
        assert_eq!(named, is_named_by_field, "{key}: {found}");
    }
    let mut global = meta_fields();
    global["transmural:period_time_s"] = json!([1.0, 2.0]);
    write_meta(&meta, &global);
    assert!(matches!(fault_of(Recording::open(&meta)), RecordingFault::Shape { .. }));
    global["transmural:period_time_s"] = json!([1.0, 2.0, 3.0, 4.0]);
    global["core:sha512"] = json!(digits);
    write_meta(&meta, &global);
    let outcomes: Vec<_> = Recording::open(&meta).unwrap().collect();
    assert!(outcomes.len() == 4 && outcomes[..3].iter().all(Result::is_ok));
    assert!(
        outcomes[3].as_ref().is_err_and(|e| matches!(*e.fault, RecordingFault::Truncated { .. }))
    );
    global["transmural:period_time_s"] = json!([1.0, 2.0, 3.0]);
    write_meta(&meta, &global);
    let whole: Vec<_> = Recording::open(&meta).unwrap().collect();
    assert!(whole[3].as_ref().is_err_and(|e| matches!(*e.fault, RecordingFault::Damaged { .. })));
}

#[test]
fn files_that_are_no_recording_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    for name in ["text.npz", "text.csv", "text.sigmf", "text.sigmf-meta", "text.sigmf-data", "none"]
    {
        fs::write(path(name), "t_s,x_m\n0,1\n").unwrap();
    }
    fs::create_dir(path("folder.npz")).unwrap();
    let of = |name: &str| fault_of(Recording::open(&path(name)));
    assert!(matches!(of("text.npz"), RecordingFault::Archive { .. }));
    for name in ["text.csv", "text.sigmf", "none"] {
        assert!(matches!(of(name), RecordingFault::UnknownKind), "{name}");
    }
    assert!(matches!(of("text.sigmf-data"), RecordingFault::Json { .. }));
    assert!(matches!(of("folder.npz"), RecordingFault::NotAFile));
    assert!(matches!(of("absent.npz"), RecordingFault::Open { .. }));
    fs::remove_file(path("text.sigmf-data")).unwrap();
    assert!(matches!(of("text.sigmf-meta"), RecordingFault::Open { .. }));
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink(path("loop.npz"), path("loop.npz")).unwrap();
        assert!(matches!(of("loop.npz"), RecordingFault::Open { .. }));
        std::os::unix::fs::symlink(path("r\u{e9}el \u{1f4e1}"), path("link.npz")).unwrap();
        npz(&path("r\u{e9}el \u{1f4e1}"), &arrays(), CompressionMethod::Stored);
        assert_eq!(Recording::open(&path("link.npz")).unwrap().period_count(), 3);
        assert_eq!(Recording::open(&path("r\u{e9}el \u{1f4e1}")).unwrap().period_count(), 3);
    }
}

#[test]
fn an_array_packed_another_way_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.npz");
    npz(&path, &arrays(), CompressionMethod::Deflated);
    let mut bytes = fs::read(&path).unwrap();
    // In a central header the method stands ten bytes after the signature; 12 is bzip2.
    let heads: Vec<usize> =
        (0..bytes.len() - 4).filter(|at| bytes[*at..].starts_with(b"PK\x01\x02")).collect();
    assert_eq!(heads.len(), 4);
    heads.iter().for_each(|at| bytes[at + 10] = 12);
    fs::write(&path, bytes).unwrap();
    let found = fault_of(Recording::open(&path));
    assert!(
        matches!(&found, RecordingFault::Packing { array, .. } if array == "echoes"),
        "{found}"
    );
}

#[test]
fn a_needed_extension_that_is_not_known_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let (meta, data) = pair(folder.path());
    fs::write(&data, hand_data()).unwrap();
    let mut global = meta_fields();
    global["core:extensions"] = json!([{"name": "other", "version": "1.0.0", "optional": false}]);
    write_meta(&meta, &global);
    let found = fault_of(Recording::open(&meta));
    assert!(matches!(found, RecordingFault::Extension { name } if name == "other"));
}

#[test]
fn a_data_file_that_ends_within_a_sweep_is_read_up_to_there() {
    let folder = tempfile::tempdir().unwrap();
    let (meta, data) = pair(folder.path());
    write_meta(&meta, &meta_fields());
    let bytes = hand_data();
    fs::write(&data, &bytes[..bytes.len() - 4]).unwrap();
    let outcomes: Vec<_> = Recording::open(&meta).unwrap().collect();
    assert!(outcomes.len() == 3 && outcomes[1].is_ok());
    let fault = outcomes.into_iter().next_back().and_then(Result::err).unwrap().fault;
    assert!(
        matches!(*fault, RecordingFault::Truncated { found: 316, expected: 320, .. }),
        "{fault}"
    );
}
