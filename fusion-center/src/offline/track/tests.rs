//! Whole inputs to tracks and files.

use std::fmt::Write as _;

use super::*;

/// Two cars on a plane, seen by a sensor 20 km south of them, every 4 s; rows of CSV.
fn two_cars(scan_count: u32) -> String {
    let mut text =
        "time_s,x_m,y_m,sigma_m,truth,sensor_x_m,sensor_y_m,sensor_height_m\n".to_owned();
    for scan in 0..scan_count {
        let time_s = 4.0 * f64::from(scan);
        // Errors of a few metres, without randomness.
        let off_m = 3.0 * (1.7 * f64::from(scan)).sin();
        for (truth, x_m, y_m) in
            [(1, 12.0 * time_s, 500.0 + off_m), (2, 3000.0 - 9.0 * time_s + off_m, -500.0)]
        {
            writeln!(text, "{time_s},{x_m},{y_m},10,{truth},0,-20000,6000").unwrap();
        }
    }
    text
}

/// The same cars on the earth.
fn two_cars_on_the_earth(scan_count: u32) -> String {
    let mut text = "time_unix_s,lat_deg,lon_deg,slant_sigma_m,cross_sigma_m,\
                    sensor_lat_deg,sensor_lon_deg,sensor_height_m\n"
        .to_owned();
    for scan in 0..scan_count {
        let time_s = 1.7e9 + 4.0 * f64::from(scan);
        let step_deg = 5e-4 * f64::from(scan);
        for (lat_deg, lon_deg) in [(40.8, 111.7 + step_deg), (40.81, 111.75 - step_deg)] {
            writeln!(text, "{time_s},{lat_deg},{lon_deg},10,10,40.6,111.7,7000").unwrap();
        }
    }
    text
}

async fn run(folder: &Path, text: &str, options: TrackOptions) -> anyhow::Result<()> {
    let input = folder.join("plots.csv");
    std::fs::write(&input, text)?;
    let stop = CancellationToken::new();
    track(TrackOptions { input, ..options }, MapConfig::default(), &stop).await
}

/// The summary and the lines of a run over `text`.
fn followed(text: &str) -> (String, Vec<serde_json::Value>) {
    let options = TrackOptions { tentative: true, ..TrackOptions::default() };
    let mut run = Run::new(&options, &MapConfig::default(), "x".to_owned()).unwrap();
    run.kept.keep_all();
    let naming = Naming::Own("eye".parse().unwrap());
    let mut input = Input::open(text.as_bytes(), "x.csv", None, naming).unwrap();
    let mut found = Vec::new();
    while input.advance(&mut found).unwrap() {
        run.take(&mut found).unwrap();
    }
    run.take(&mut found).unwrap();
    let rest = run.order.finish();
    run.follow(&rest).unwrap();
    run.follower.finish();
    run.settle().unwrap();
    let lines = run.kept.steps().map(|step| serde_json::to_value(&step.line).unwrap()).collect();
    (run.summary.table(), lines)
}

#[test]
fn two_cars_make_two_pure_tracks_and_every_step_is_a_line() {
    let (table, lines) = followed(&two_cars(20));
    let said = "2 tracks of 20 dwells with 40 plots; purity 1.000";
    assert!(table.contains(said), "{table}");
    assert_eq!(lines.len(), 40);
    let first_car: Vec<_> = lines.iter().filter(|line| line["report"]["truth"] == 1).collect();
    assert_eq!(first_car.len(), 20);
    assert!(first_car.iter().all(|line| line["track"] == first_car[0]["track"]));
    let last = first_car.last().unwrap();
    assert_eq!((&last["time_s"], &last["status"]), (&76.0.into(), &"confirmed".into()));
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    assert!((number(&last["x_m"]) - 912.0).abs() < 15.0, "{last}");
    assert!((number(&last["vx_m_per_s"]) - 12.0).abs() < 1.5, "{last}");
    assert!((number(&last["smoothed"]["y_m"]) - 500.0).abs() < 15.0, "{last}");
    assert_eq!(last["cov_m2"].as_array().unwrap().len(), 3);
    assert_eq!(last["report"]["sensor"], "eye");
    assert!(last.get("lat_deg").is_none());
}

#[test]
fn lines_on_the_earth_have_latitude_and_longitude() {
    let (table, lines) = followed(&two_cars_on_the_earth(15));
    assert!(table.starts_with('\u{2500}') && table.contains("2 tracks"), "{table}");
    assert!(!table.contains("purity"), "nobody said the truth: {table}");
    let last = lines.last().unwrap();
    assert!((last["lat_deg"].as_f64().unwrap() - 40.805).abs() < 0.01, "{last}");
    assert!(last.get("x_m").is_none());
}

#[tokio::test(flavor = "multi_thread")]
async fn every_file_is_written_on_the_earth() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| Some(folder.path().join(name));
    let files = Files {
        geojson: path("t.geojson"),
        kml: path("t.kml"),
        csv: path("t.csv"),
        cat062: path("t.cat062"),
        cot: path("t.cot"),
        figures: path("figures"),
    };
    let options = TrackOptions { json: true, files, ..TrackOptions::default() };
    run(folder.path(), &two_cars_on_the_earth(15), options).await.unwrap();
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    let geojson: serde_json::Value = serde_json::from_slice(&read("t.geojson")).unwrap();
    let features = geojson["features"].as_array().unwrap();
    let positions = features.iter().filter(|one| one["properties"]["kind"] == "position");
    assert_eq!(positions.count(), 2);
    let text = |name: &str| String::from_utf8(read(name)).unwrap();
    assert_eq!(text("t.kml").matches("<gx:Track>").count(), 2);
    assert!(text("t.csv").lines().count() > 20);
    assert!(
        text("t.cot").lines().all(|line| line.starts_with("<?xml") || line.starts_with("<event"))
    );
    assert!(text("figures/map.svg").starts_with("<svg"));
    // Data blocks that follow one another: category 62 and a length.
    let blocks = read("t.cat062");
    let (mut at, mut count) = (0, 0);
    while at < blocks.len() {
        assert_eq!(blocks[at], 62);
        at += usize::from(blocks[at + 1]) * 256 + usize::from(blocks[at + 2]);
        count += 1;
    }
    assert!(at == blocks.len() && 10 < count, "{count}");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_goes_wrong_is_named_with_its_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let said = async |text: &str, options: TrackOptions| {
        format!("{:#}", run(folder.path(), text, options).await.unwrap_err())
    };
    let json = || TrackOptions { json: true, ..TrackOptions::default() };
    let bad = two_cars(10) + "41,one,2,3,,0,0,0\n";
    let line = said(&bad, json()).await;
    assert!(line.contains("line 22: x_m is \"one\"") && line.contains(": 1 part could"), "{line}");
    let late = two_cars(10) + "1,2,3,4,,0,0,0\n";
    assert!(said(&late, json()).await.contains("sort the input by time"));
    assert!(said("hello\n", TrackOptions::default()).await.contains("one of them: line 1"));
    let files = Files { kml: Some(folder.path().join("none/t.kml")), ..Files::default() };
    let missing = said(&two_cars(3), TrackOptions { files, ..json() }).await;
    assert!(missing.contains("--kml") && missing.contains("create it"), "{missing}");
    let with_cot = Files { cot: Some(folder.path().join("t.cot")), ..Files::default() };
    let nowhere = said(&two_cars(10), TrackOptions { files: with_cot, ..json() }).await;
    assert!(nowhere.contains("--cot: plots on a plane"), "{nowhere}");
    let over = Files { csv: Some(folder.path().join("plots.csv")), ..Files::default() };
    let input = said(&two_cars(3), TrackOptions { files: over, ..json() }).await;
    assert!(input.contains("--csv") && input.contains("is the input"), "{input}");
    let same = Some(folder.path().join("t.out"));
    let twice = Files { kml: same.clone(), cot: same, ..Files::default() };
    let both = said(&two_cars(3), TrackOptions { files: twice, ..json() }).await;
    assert!(both.contains("--cot and --kml are both"), "{both}");
    let kml = Files { kml: Some(folder.path().join("t.kml")), ..Files::default() };
    let nothing = said("time_s,x_m,y_m\nx,y,z\n", TrackOptions { files: kml, ..json() }).await;
    assert!(nothing.contains("line 2: time_s is \"x\""), "what is wrong, not a plane: {nothing}");
    let stop = CancellationToken::new();
    let options = TrackOptions { input: "no-such.4607".into(), ..TrackOptions::default() };
    let absent = track(options, MapConfig::default(), &stop).await.unwrap_err();
    assert!(format!("{absent:#}").contains("no-such.4607"));
}

/// A year between two looks: whatever a tracker makes of it, files are written.
#[tokio::test(flavor = "multi_thread")]
async fn a_pause_of_a_year_costs_no_file() {
    use crate::tracking::{TrackerKind, TrackingConfig};
    let rows = two_cars_on_the_earth(12);
    let late = two_cars_on_the_earth(12).replace("17000000", "17320000");
    let text = rows + late.split_once('\n').unwrap().1;
    for kind in [TrackerKind::Default, TrackerKind::Paper, TrackerKind::Nn, TrackerKind::Belief] {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| Some(folder.path().join(name));
        let [geojson, kml, csv] = ["t.geojson", "t.kml", "t.csv"].map(path);
        let [cat062, cot] = ["t.cat062", "t.cot"].map(path);
        let files = Files { geojson, kml, csv, cat062, cot, figures: path("figures") };
        let input = folder.path().join("plots.csv");
        std::fs::write(&input, &text).unwrap();
        let tracking = TrackingConfig { kind, ..TrackingConfig::default() };
        let config = MapConfig { tracking, ..MapConfig::default() };
        let options = TrackOptions { input, json: true, files, ..TrackOptions::default() };
        track(options, config, &CancellationToken::new()).await.unwrap();
        assert!(folder.path().join("t.cot").is_file() && folder.path().join("t.cat062").is_file());
    }
}
