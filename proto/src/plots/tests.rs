//! Rows of both kinds in pieces of any size, and every fault by its line.

use super::*;
use crate::wire::{GeoRecord, Invalid};

const SENSOR: &str = "sensor_lat_deg,sensor_lon_deg,sensor_height_m";

fn node() -> NodeId {
    "n1".parse().unwrap()
}

/// Everything that `text` gives, fed in pieces of `piece` bytes.
fn read(kind: LineKind, text: &[u8], piece: usize) -> Vec<Result<Scan, BadLine>> {
    let (mut lines, mut found) = (RowLines::new(kind, node()), Vec::new());
    text.chunks(piece).for_each(|bytes| lines.feed(bytes, &mut found));
    lines.finish(&mut found);
    found
}

fn scans(kind: LineKind, text: &str) -> Vec<Scan> {
    read(kind, text.as_bytes(), usize::MAX).into_iter().map(Result::unwrap).collect()
}

fn fault(kind: LineKind, text: &[u8]) -> (u64, RowFault) {
    let found = read(kind, text, usize::MAX);
    let bad = found.into_iter().find_map(Result::err).expect("a bad line");
    (bad.line, bad.fault)
}

#[test]
fn a_row_gives_the_dwell_that_it_describes() {
    let text = format!(
        "time_unix_s,{SENSOR},lat_deg,lon_deg,slant_sigma_m,cross_sigma_m,radial_m_per_s,truth,\
         sensor_course_deg,sensor_speed_m_per_s,wrap_m_per_s,detection_probability\n\
         100.5,40,-110.25,9000,40.5,-110,10,,-4.5,7,90,120,30,0.9\n"
    );
    let found = scans(LineKind::Csv, &text);
    let [Scan::Geographic(dwell)] = found.as_slice() else { panic!("{found:?}") };
    assert_eq!(dwell.node, node());
    assert_eq!(dwell.sensor, GeoRecord { lat_deg: 40.0, lon_deg: -110.25, height_m: 9000.0 });
    let flight = dwell.flight.unwrap();
    assert!((flight.course_deg - 90.0).abs() + (flight.speed_m_per_s - 120.0).abs() < 1e-12);
    assert_eq!(dwell.detection_probability, Some(0.9));
    let report = dwell.reports[0];
    assert_eq!(report.place, GeoRecord { lat_deg: 40.5, lon_deg: -110.0, height_m: 0.0 });
    assert_eq!((report.slant_sigma_m, report.cross_sigma_m), (Some(10.0), None));
    assert_eq!((report.radial_m_per_s, report.wrap_m_per_s), (Some(-4.5), Some(30.0)));
    assert_eq!((report.truth, report.snr_db), (Some(7), None));
    assert!((dwell.time_unix_s - 100.5).abs() < 1e-12);
}

#[test]
fn rows_of_one_dwell_are_joined_and_empty_dwells_count() {
    let text = format!(
        "time_s,{SENSOR},revisit,dwell,lat_deg,lon_deg\n\
         1,40,10,9000,3,0,40.1,10.1\n1,40,10,9000,3,0,40.2,10.2\n\
         1,40,10,9000,3,1,,\n\
         2,40,10,9000,4,0,40.3,10.3\n"
    );
    let found = scans(LineKind::Csv, &text);
    let counts: Vec<usize> = found.iter().map(Scan::plot_count).collect();
    assert_eq!(counts, [2, 0, 1]);
    let of = |index: usize| match &found[index] {
        Scan::Geographic(dwell) => (dwell.revisit_index, dwell.dwell_index),
        Scan::Local(_) => panic!("not local"),
    };
    assert_eq!((of(0), of(1), of(2)), ((3, 0), (3, 1), (4, 0)));
}

/// Two files joined end to end, the columns of the second in another order.
#[test]
fn columns_may_be_named_again() {
    let text = "time_s,x_m,y_m\n1,2,3\ny_m,x_m,time_s\n30,20,2\nx_m,y_m,nonsense\n30,20,3\n";
    let found = read(LineKind::Csv, text.as_bytes(), usize::MAX);
    let places: Vec<[f64; 2]> = (found.iter().flatten())
        .map(|scan| match scan {
            Scan::Local(local) => local.plots[0].at_m,
            Scan::Geographic(_) => panic!("not on the earth"),
        })
        .collect();
    assert_eq!(places, [[2.0, 3.0], [20.0, 30.0], [20.0, 30.0]]);
    let bad: Vec<u64> = found.iter().filter_map(|one| one.as_ref().err()).map(|b| b.line).collect();
    assert_eq!(bad, [5], "a line with a column that is unknown is a bad row");
}

#[test]
fn revisits_that_are_not_stated_are_counted_by_sensor() {
    let text = "time_s,sensor,x_m,y_m\n1,a,1,2\n1,b,1,2\n2,a,1,2\n3,a,1,2\n";
    let indices: Vec<(String, u32)> = scans(LineKind::Csv, text)
        .into_iter()
        .map(|scan| match scan {
            Scan::Local(local) => (local.node.to_string(), local.revisit_index),
            Scan::Geographic(_) => panic!("not on the earth"),
        })
        .collect();
    let expected = [("a", 0), ("b", 0), ("a", 1), ("a", 2)];
    assert_eq!(indices, expected.map(|(name, index)| (name.to_owned(), index)));
}

#[test]
fn both_kinds_give_the_same_whatever_the_pieces() {
    let csv = "time_s,x_m,y_m,sigma_m,sensor_x_m,sensor_y_m\n\
               1,10,20,5,0,-100\n1,11,21,5,0,-100\n\n# a remark\n2,12,22,,0,-100\n";
    let json = "{\"time_s\":1,\"x_m\":10,\"y_m\":20,\"sigma_m\":5,\"sensor_x_m\":0,\"sensor_y_m\":-100}\n\
                {\"time_s\":1,\"x_m\":11,\"y_m\":21,\"sigma_m\":5,\"sensor_x_m\":0,\"sensor_y_m\":-100}\n\
                {\"time_s\":2,\"x_m\":12,\"y_m\":22,\"sensor_x_m\":0,\"sensor_y_m\":-100}";
    let whole = read(LineKind::Csv, csv.as_bytes(), usize::MAX);
    assert_eq!(whole.len(), 2);
    for piece in [1, 2, 7, 64] {
        assert_eq!(read(LineKind::Csv, csv.as_bytes(), piece), whole);
        assert_eq!(read(LineKind::Json, json.as_bytes(), piece), whole);
    }
    let Ok(Scan::Local(first)) = &whole[0] else { panic!("{whole:?}") };
    assert_eq!(first.sensor_m, Some([0.0, -100.0, 0.0]));
    let [x_m, y_m] = first.plots[1].at_m;
    assert!((x_m - 11.0).abs() < 1e-12 && (y_m - 21.0).abs() < 1e-12);
    assert_eq!(first.plots[1].slant_sigma_m, Some(5.0));
    assert_eq!(first.plots[1].cross_sigma_m, Some(5.0));
}

#[test]
fn a_dwell_written_as_json_is_read_as_it_was() {
    let text = format!("time_s,{SENSOR},lat_deg,lon_deg\n1,40,10,9000,40.1,10.1\n");
    let written = scans(LineKind::Csv, &text);
    let Scan::Geographic(dwell) = &written[0] else { panic!("{written:?}") };
    let line = serde_json::to_string(dwell).unwrap();
    assert_eq!(scans(LineKind::Json, &line), written);
    let senseless = line.replace("\"lat_deg\":40.1", "\"lat_deg\":140.1");
    assert_eq!(fault(LineKind::Json, senseless.as_bytes()).1.label(), "invalid");
}

#[test]
fn a_bad_line_costs_that_line_only() {
    let text = "time_s,x_m,y_m\n1,1,1\n1,one,1\n1,2,2\n2,3\n3,3,3\n";
    let found = read(LineKind::Csv, text.as_bytes(), usize::MAX);
    let bad: Vec<u64> =
        found.iter().filter_map(|one| one.as_ref().err().map(|bad| bad.line)).collect();
    assert_eq!(bad, [3, 5]);
    let counts: Vec<usize> =
        found.iter().filter_map(|one| one.as_ref().ok().map(Scan::plot_count)).collect();
    assert_eq!(counts, [2, 1]);
}

#[test]
fn every_fault_names_its_line_and_column() {
    let csv = |text: &str| fault(LineKind::Csv, text.as_bytes());
    let (line, unknown) = csv("time_s,x,y_m\n");
    assert_eq!((line, unknown.label()), (1, "header"));
    assert!(
        unknown.to_string().contains("\"x\" is unknown") && unknown.to_string().contains("x_m")
    );
    assert!(csv("time_s,x_m,x_m\n").1.to_string().contains("named twice"));
    assert_eq!(csv("time_s,x_m,y_m\n1,2\n").1, RowFault::CellCount { got: 2, want: 3 });
    let (bad_line, cell) = csv("time_s,x_m,y_m\n1,2,3\n1,two,3\n");
    assert_eq!((bad_line, cell.label()), (3, "cell"));
    assert!(cell.to_string().starts_with("x_m is \"two\""), "{cell}");
    let name = csv("time_s,sensor,x_m,y_m\n1,Bad Name,3,4\n").1;
    assert!(name.to_string().starts_with("sensor is \"Bad Name\""), "{name}");
    assert_eq!(fault(LineKind::Csv, b"\xff\xfe\n"), (1, RowFault::NotText));
    let json = fault(LineKind::Json, b"{\"time_s\":1}\n{\"time\":1}\n");
    assert!(json.0 == 2 && json.1.to_string().contains("`time`"), "{json:?}");
    let long = vec![b'x'; (4 << 20) + 1];
    assert_eq!(fault(LineKind::Json, &long).1.label(), "too_long");
}

#[test]
fn rows_that_lack_something_say_what() {
    let missing = |text: &str| match fault(LineKind::Csv, text.as_bytes()).1 {
        RowFault::Missing { field, .. } => field,
        other => panic!("{other}"),
    };
    assert_eq!(missing("x_m,y_m\n1,2\n"), "time_unix_s");
    assert_eq!(missing("time_s,x_m,y_m\n1,2,\n"), "y_m");
    assert_eq!(missing("time_s,x_m,y_m\n1,,2\n"), "x_m");
    assert_eq!(missing("time_s,lat_deg,lon_deg\n1,2,3\n"), "sensor_lat_deg");
    assert_eq!(missing("time_s,sensor_x_m,x_m,y_m\n1,2,3,4\n"), "sensor_y_m");
    assert_eq!(missing(&format!("time_s,{SENSOR},lat_deg\n1,40,10,9,40\n")), "lon_deg");
    assert_eq!(missing(&format!("time_s,{SENSOR},lon_deg\n1,40,10,9,40\n")), "lat_deg");
    let area = format!("time_s,{SENSOR},area_lat_deg\n1,40,10,9,40\n");
    assert_eq!(missing(&area), "area_lon_deg");
    let crowd: String = (0..257).map(|index| format!("1,s{index},1,2\n")).collect();
    assert_eq!(missing(&format!("time_s,sensor,x_m,y_m\n{crowd}")), "sensor");
}

#[test]
fn rows_that_make_no_sense_say_which_value() {
    let invalid = |text: &str| match fault(LineKind::Csv, text.as_bytes()).1 {
        RowFault::Invalid(Invalid { field, .. }) => field,
        other => panic!("{other}"),
    };
    assert_eq!(invalid("time_s,x_m,y_m\nnan,1,2\n"), "time_s");
    assert_eq!(invalid("time_s,x_m,y_m\n1,inf,2\n"), "x_m or y_m");
    assert_eq!(invalid("time_s,x_m,y_m,sigma_m\n1,1,2,0\n"), "sigma_m");
    assert_eq!(invalid("time_s,x_m,y_m,snr_db\n1,1,2,nan\n"), "snr_db");
    assert_eq!(invalid("time_s,x_m,y_m,detection_probability\n1,1,2,3\n"), "detection_probability");
    let slow = "time_s,x_m,y_m,minimum_detectable_m_per_s\n1,1,2,-1\n";
    assert_eq!(invalid(slow), "minimum_detectable_m_per_s");
    let high = "time_s,sensor_x_m,sensor_y_m,sensor_height_m\n1,1,2,nan\n";
    assert!(invalid(high).contains("sensor_height_m"));
    assert_eq!(invalid(&format!("time_s,{SENSOR}\n1,95,10,9\n")), "lat_deg");
    assert_eq!(invalid(&format!("time_s,{SENSOR}\n-1,45,10,9\n")), "time_unix_s");
    for (text, second) in [
        ("time_s,time_unix_s,x_m,y_m\n1,1,1,2\n", "time_s"),
        ("time_s,lat_deg,x_m\n1,1,1\n", "x_m"),
        ("time_s,x_m,y_m,sigma_m,cross_sigma_m\n1,1,2,3,4\n", "slant_sigma_m"),
    ] {
        let found = fault(LineKind::Csv, text.as_bytes()).1;
        let is_named = matches!(&found, RowFault::Both { second: named, .. } if *named == second);
        assert!(is_named, "{found}");
    }
}

#[test]
fn a_crowded_dwell_is_cut_into_messages() {
    let rows: String = (0..5000).map(|index| format!("1,{index},2\n")).collect();
    let found = scans(LineKind::Csv, &format!("time_s,x_m,y_m\n{rows}"));
    let counts: Vec<usize> = found.iter().map(Scan::plot_count).collect();
    assert_eq!(counts, [4096, 904]);
}
