//! What is sent and written of tracks elsewhere than to the network, as text and bytes.

use std::collections::BTreeMap;

use super::centre::Shown;
use super::output::OutputConfig;
use crate::export::cat062::{Entry, Message, TrackNumbers, blocks};
use crate::export::cot::event;
use crate::export::{ExportError, GeoTrack, Origin, csv, geojson, kml};

/// Turns what is shown into messages and files; remembers who knows which track.
#[derive(Clone, Debug)]
pub struct Messages {
    config: OutputConfig,
    numbers: TrackNumbers,
    /// As they were told last, for their last message.
    told: BTreeMap<u64, GeoTrack>,
}

impl Messages {
    /// Nothing was told yet.
    #[must_use]
    pub fn new(config: OutputConfig) -> Self {
        Self { config, numbers: TrackNumbers::default(), told: BTreeMap::new() }
    }

    /// Cursor-on-Target events, one datagram for each track.
    ///
    /// # Errors
    /// If a track says something that is not possible.
    pub fn cot(&self, shown: &Shown) -> Result<Vec<Vec<u8>>, ExportError> {
        let settings = self.config.cot_settings(origin(shown));
        let events = shown.tracks.iter().map(|track| event(track, shown.time_unix_s, &settings));
        events.map(|event| event.map(String::into_bytes)).collect()
    }

    /// Data blocks of ASTERIX CAT062; what has ended since the last call is told for the last time.
    ///
    /// # Errors
    /// If a track says something that is not possible, or all numbers are in use.
    pub fn cat062(&mut self, shown: &Shown) -> Result<Vec<Vec<u8>>, ExportError> {
        let settings = self.config.cat062_settings(origin(shown));
        let is_shown = |id: u64| shown.tracks.iter().any(|track| track.id == id);
        let ended = self.numbers.retain(is_shown);
        let mut entries = Vec::new();
        for (id, number) in &ended {
            if let Some(track) = self.told.get(id) {
                entries.push(Entry { track, number: *number, message: Message::Last });
            }
        }
        for track in &shown.tracks {
            let is_known = self.numbers.knows(track.id);
            let message = if is_known { Message::Update } else { Message::First };
            entries.push(Entry { track, number: self.numbers.of(track.id)?, message });
        }
        let found = blocks(&entries, &settings)?;
        self.told = shown.tracks.iter().map(|track| (track.id, track.clone())).collect();
        Ok(found)
    }

    /// The text of each configured file, with its path.
    ///
    /// # Errors
    /// If a track says something that is not possible.
    pub fn files(&self, shown: &Shown) -> Result<Vec<(std::path::PathBuf, String)>, ExportError> {
        let mut files = Vec::new();
        if let Some(path) = &self.config.geojson {
            files.push((path.clone(), geojson::collection(&shown.tracks)?));
        }
        if let Some(path) = &self.config.kml {
            files.push((path.clone(), kml::document("Transmural", &shown.tracks)?));
        }
        if let Some(path) = &self.config.csv {
            files.push((path.clone(), csv::header() + &csv::rows(&shown.tracks)?));
        }
        Ok(files)
    }
}

fn origin(shown: &Shown) -> Origin {
    if shown.is_simulated { Origin::Simulated } else { Origin::Live }
}
