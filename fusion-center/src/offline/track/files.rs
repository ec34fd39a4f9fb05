//! Files of tracks and the map, written at the end.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{Context, bail, ensure};
use chart::{GREY, Sheet, color};
use nalgebra::Vector2;
use proto::geodesy::{EnuFrame, GeoPosition};
use proto::plots::Scan;
use proto::wire::MapTrack;

use super::step::Step;
use crate::export::cat062::{Cat062Settings, Entry, Message, TrackNumbers, blocks};
use crate::export::cot::event;
use crate::export::figure::Map;
use crate::export::{GeoTrack, Origin, csv, geojson, kml};
use crate::map::{Ground, OutputConfig, Past, fix, geo_track};
use crate::offline::{Layer, Site, Way};
use crate::replace;

/// Plots kept for the map; those beyond are left out of it.
const MAX_PLOT_COUNT: usize = 200_000;
/// Stands for a run in the names of its tracks.
const SESSION: &str = "offline";

/// Files to write, each if it is named.
#[derive(Clone, Debug, Default)]
pub struct Files {
    /// Every track with its way, GeoJSON.
    pub geojson: Option<PathBuf>,
    /// Every track with its way, KML.
    pub kml: Option<PathBuf>,
    /// Every step of every track, CSV.
    pub csv: Option<PathBuf>,
    /// Every step of every track, data blocks of ASTERIX CAT062.
    pub cat062: Option<PathBuf>,
    /// Every step of every track, one Cursor-on-Target event per line.
    pub cot: Option<PathBuf>,
    /// A folder for the map, SVG.
    pub figures: Option<PathBuf>,
}

impl Files {
    fn of_the_earth(&self) -> [(&'static str, Option<&PathBuf>); 5] {
        [
            ("--geojson", self.geojson.as_ref()),
            ("--kml", self.kml.as_ref()),
            ("--csv", self.csv.as_ref()),
            ("--cat062", self.cat062.as_ref()),
            ("--cot", self.cot.as_ref()),
        ]
    }

    pub(super) fn is_any(&self) -> bool {
        self.figures.is_some() || self.of_the_earth().iter().any(|(_, path)| path.is_some())
    }

    /// Makes sure before the work that its result can be written, and not over the `input` or over one
    /// another.
    ///
    /// # Errors
    /// If it cannot.
    pub(super) fn prepare(&self, input: &Path) -> anyhow::Result<()> {
        if let Some(folder) = &self.figures {
            std::fs::create_dir_all(folder)
                .with_context(|| format!("creating --figures {}", folder.display()))?;
        }
        let mut named: Vec<(&str, PathBuf)> = Vec::new();
        for (flag, path) in self.of_the_earth() {
            let Some(path) = path else { continue };
            replace::check_writable(flag, path)?;
            let Ok(place) = place_of(path) else { continue };
            let is_input = place_of(input).is_ok_and(|input| input == place && input.is_file());
            ensure!(!is_input, "{flag} {} is the input: name another file", path.display());
            if let Some((other, _)) = named.iter().find(|(_, known)| *known == place) {
                bail!("{flag} and {other} are both {}: name two files", path.display());
            }
            named.push((flag, place));
        }
        Ok(())
    }
}

/// Steps kept for the files, if any are asked for.
pub(super) struct Kept {
    is_wanted: bool,
    /// Above the map.
    title: String,
    steps: BTreeMap<u64, Vec<Step>>,
    /// How messages are written.
    output: OutputConfig,
    /// Every scan is of a simulation, as far as there are any.
    is_simulated: bool,
    plots: Vec<GeoPosition>,
    local_plots_m: Vec<[f64; 2]>,
}

impl Kept {
    /// For the tracks of the input `name`.
    pub(super) fn new(files: &Files, name: &str, output: OutputConfig) -> Self {
        let is_wanted = files.is_any();
        let (steps, plots, local_plots_m) = (BTreeMap::new(), Vec::new(), Vec::new());
        let (title, is_simulated) = (format!("{name}: tracks"), true);
        Self { is_wanted, title, steps, output, is_simulated, plots, local_plots_m }
    }

    pub(super) fn take(&mut self, step: Step) {
        if self.is_wanted {
            self.steps.entry(step.id()).or_default().push(step);
        }
    }

    pub(super) fn note_plots(&mut self, scan: &Scan) {
        self.is_simulated &= matches!(scan, Scan::Geographic(dwell) if dwell.is_simulated);
        let known = self.plots.len() + self.local_plots_m.len();
        if !self.is_wanted || MAX_PLOT_COUNT < known + scan.plot_count() {
            return;
        }
        match scan {
            Scan::Local(local) => self.local_plots_m.extend(local.plots.iter().map(|p| p.at_m)),
            Scan::Geographic(dwell) => {
                self.plots.extend(dwell.reports.iter().filter_map(|report| {
                    let place = report.place;
                    GeoPosition::new(place.lat_deg, place.lon_deg, place.height_m).ok()
                }))
            }
        }
    }

    /// Keeps steps also where no file is named.
    #[cfg(test)]
    pub(super) fn keep_all(&mut self) {
        self.is_wanted = true;
    }

    /// All steps, track by track.
    #[cfg(test)]
    pub(super) fn steps(&self) -> impl Iterator<Item = &Step> {
        self.steps.values().flatten()
    }

    /// Writes every file that is named.
    pub(super) fn write(&self, files: &Files, ground: Option<&Ground>) -> anyhow::Result<()> {
        if !self.is_wanted {
            return Ok(());
        }
        let frame = match ground {
            Some(Ground::Earth(frame)) => frame,
            Some(Ground::Plane) => return self.write_plane(files),
            // Nothing was followed, for reasons that are told elsewhere.
            None => return Ok(()),
        };
        let tracks: Vec<GeoTrack> = self
            .steps
            .values()
            .filter_map(|steps| whole(steps).transpose())
            .collect::<Result<_, _>>()?;
        if let Some(path) = &files.geojson {
            write(path, geojson::collection(&tracks)?.as_bytes())?;
        }
        if let Some(path) = &files.kml {
            write(path, kml::document("Transmural", &tracks)?.as_bytes())?;
        }
        if files.csv.is_some() || files.cot.is_some() || files.cat062.is_some() {
            self.write_steps(files)?;
        }
        if let Some(folder) = &files.figures {
            let middle = frame.place(&Vector2::zeros(), frame.height_m())?;
            let middle = GeoPosition::new(middle.lat_deg, middle.lon_deg, middle.height_m)?;
            let enu = EnuFrame::new(middle);
            let (title, dots, dots_are) = (self.title.as_str(), &self.plots[..], "plot");
            let map = Map { title, frame: &enu, tracks: &tracks, dots, dots_are };
            write(&folder.join("map.svg"), map.checked_svg()?.as_bytes())?;
        }
        Ok(())
    }

    /// Every step as a track of its own, in order of time.
    fn write_steps(&self, files: &Files) -> anyhow::Result<()> {
        let mut all: Vec<(&Step, &MapTrack, Message)> = Vec::new();
        for steps in self.steps.values() {
            let last = steps.len().saturating_sub(1);
            all.extend(steps.iter().enumerate().filter_map(|(index, step)| {
                let message = match index {
                    0 => Message::First,
                    index if index == last => Message::Last,
                    _ => Message::Update,
                };
                Some((step, step.on_map.as_ref()?, message))
            }));
        }
        all.sort_by(|one, other| one.0.time_s().total_cmp(&other.0.time_s()));
        let states =
            all.iter().map(|(step, state, _)| Ok(geo_track(state, &past_of(step)?, SESSION)?));
        let states: Vec<GeoTrack> = states.collect::<anyhow::Result<_>>()?;
        if let Some(path) = &files.csv {
            write(path, (csv::header() + &csv::rows(&states)?).as_bytes())?;
        }
        if let Some(path) = &files.cot {
            let settings = self.output.cot_settings(self.origin());
            let events = states.iter().map(|state| event(state, state.time_unix_s, &settings));
            let lines = events.map(|event| Ok(event?.replace('\n', "") + "\n"));
            let lines: String = lines.collect::<Result<String, crate::export::ExportError>>()?;
            write(path, lines.as_bytes())?;
        }
        if let Some(path) = &files.cat062 {
            let messages: Vec<Message> = all.iter().map(|(_, _, message)| *message).collect();
            write(
                path,
                &asterix(&states, &messages, &self.output.cat062_settings(self.origin()))?,
            )?;
        }
        Ok(())
    }

    /// Receivers must not take an exercise for the real thing.
    fn origin(&self) -> Origin {
        if self.is_simulated { Origin::Simulated } else { Origin::Live }
    }

    fn write_plane(&self, files: &Files) -> anyhow::Result<()> {
        if let Some((flag, _)) = files.of_the_earth().iter().find(|(_, path)| path.is_some()) {
            bail!("{flag}: plots on a plane have no place on the earth: leave it out");
        }
        let Some(folder) = &files.figures else { return Ok(()) };
        let way = |(index, (id, steps)): (usize, (&u64, &Vec<Step>))| Way {
            label: id.to_string(),
            color: color(index),
            places_m: steps.iter().map(|step| step.at_m).collect(),
        };
        let layer = Layer {
            label: "plot".to_owned(),
            color: GREY,
            points_m: self.local_plots_m.clone(),
            estimated: None,
            truth: None,
            ways: self.steps.iter().enumerate().map(way).collect(),
        };
        let site = Site { title: self.title.clone(), layers: vec![layer] };
        let svg = site.svg().map_err(|error| anyhow::anyhow!("drawing the map: {error}"))?;
        write(&folder.join("map.svg"), svg.as_bytes())
    }
}

/// A track as it was last, with its whole way; `None` if it has no place on the earth.
fn whole(steps: &[Step]) -> anyhow::Result<Option<GeoTrack>> {
    let states: Vec<&MapTrack> = steps.iter().filter_map(|step| step.on_map.as_ref()).collect();
    let (Some(first), Some(last)) = (states.first(), states.last()) else { return Ok(None) };
    let sensors: BTreeSet<String> =
        steps.iter().filter_map(Step::sensor).map(ToString::to_string).collect();
    let fixes = states.iter().map(|state| fix(state));
    let past = Past {
        first_seen_unix_s: first.time_unix_s,
        sensors: sensors.into_iter().collect(),
        fixes: fixes.collect::<Result<_, _>>()?,
    };
    let seen = steps.iter().filter(|step| step.truth().is_some()).map(Step::time_s);
    let seen_unix_s = seen.reduce(f64::max).unwrap_or(last.time_unix_s);
    let state = MapTrack { seen_unix_s, ..(*last).clone() };
    Ok(Some(geo_track(&state, &past, SESSION)?))
}

fn past_of(step: &Step) -> anyhow::Result<Past> {
    let sensors = step.sensor().map(ToString::to_string).into_iter().collect();
    Ok(Past { first_seen_unix_s: step.time_s(), sensors, fixes: Vec::new() })
}

/// The blocks of all states, those of one time together.
fn asterix(
    states: &[GeoTrack],
    messages: &[Message],
    settings: &Cat062Settings,
) -> anyhow::Result<Vec<u8>> {
    let (mut numbers, mut bytes) = (TrackNumbers::default(), Vec::new());
    let mut start = 0;
    for same in states.chunk_by(|a, b| (a.time_unix_s - b.time_unix_s).abs() <= 0.0) {
        let mut entries = Vec::with_capacity(same.len());
        for (track, message) in same.iter().zip(&messages[start..]) {
            entries.push(Entry { track, number: numbers.of(track.id)?, message: *message });
        }
        bytes.extend(blocks(&entries, settings)?.concat());
        for (track, message) in same.iter().zip(&messages[start..]) {
            if *message == Message::Last {
                numbers.release(track.id);
            }
        }
        start += same.len();
    }
    Ok(bytes)
}

/// Where a file is or will be, whatever it is called; a device is nowhere.
fn place_of(path: &Path) -> std::io::Result<PathBuf> {
    if path.exists() {
        let found = path.canonicalize()?;
        return if found.is_file() { Ok(found) } else { Err(std::io::ErrorKind::NotFound.into()) };
    }
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new(".")).canonicalize()?;
    Ok(folder.join(path.file_name().unwrap_or_default()))
}

fn write(path: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    replace::write(path, bytes).with_context(|| format!("writing {}", path.display()))
}
