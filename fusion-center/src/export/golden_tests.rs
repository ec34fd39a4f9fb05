//! The files that other programs have read and validated, kept; `golden/README.md` says how.

use super::cat062::{Cat062Settings, Entry, Message, blocks};
use super::cot::{CotSettings, event};
use super::{ExportError, Origin, csv, geojson, kml, sample};

const HOW_TO_RENEW: &str = "if the change is meant: write the golden files again, read them with \
    golden/check.py, and commit both";

fn collection() -> Result<String, ExportError> {
    geojson::collection(&sample::all())
}

fn document() -> Result<String, ExportError> {
    kml::document("Hohhot & <elsewhere>", &sample::all())
}

fn table() -> Result<String, ExportError> {
    Ok(csv::header() + &csv::rows(&sample::all())?)
}

/// One event on each line, alternately live and simulated.
fn events() -> Result<String, ExportError> {
    let tracks = sample::all();
    let origins = [Origin::Live, Origin::Simulated].into_iter().cycle();
    let written = tracks.iter().zip(origins).map(|(track, origin)| {
        let settings = CotSettings { origin, revisit_s: sample::REVISIT_S, ..Default::default() };
        Ok(event(track, sample::NOON_UNIX_S + 40.25, &settings)?.replace("?>\n", "?>") + "\n")
    });
    written.collect()
}

fn track_blocks() -> Result<String, ExportError> {
    let tracks = sample::all();
    let messages = [Message::First, Message::Update, Message::Update, Message::Last];
    let entry = |((number, track), message)| Entry { track, number, message };
    let entries: Vec<Entry<'_>> = (1_000..).zip(&tracks).zip(messages).map(entry).collect();
    let frame = Some(sample::frame());
    let settings = Cat062Settings { sac: 25, sic: 201, origin: Origin::Simulated, frame };
    let octets = blocks(&entries, &settings)?.concat();
    Ok(octets.iter().map(|octet| format!("{octet:02x}")).collect::<String>() + "\n")
}

type Written = Result<String, ExportError>;

/// Name, what is written now, what was read elsewhere.
fn files() -> [(&'static str, Written, &'static str); 5] {
    [
        ("tracks.geojson", collection(), include_str!("golden/tracks.geojson")),
        ("tracks.kml", document(), include_str!("golden/tracks.kml")),
        ("tracks.csv", table(), include_str!("golden/tracks.csv")),
        ("events.cot", events(), include_str!("golden/events.cot")),
        ("tracks.cat062.hex", track_blocks(), include_str!("golden/tracks.cat062.hex")),
    ]
}

#[test]
fn what_is_written_is_what_was_read_elsewhere() {
    for (name, now, golden) in files() {
        assert_eq!(now.unwrap(), golden, "golden/{name} differs; {HOW_TO_RENEW}");
    }
}

#[test]
#[ignore = "writes golden/ in the source folder"]
fn write_the_golden_files() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/export/golden");
    for (name, now, _) in files() {
        std::fs::write(folder.join(name), now.unwrap()).unwrap();
    }
}
