//! Where tracks of wide-area targets go besides the network: settings, and what is sent and written.

use std::net::SocketAddr;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::export::Origin;
use crate::export::cat062::Cat062Settings;
use crate::export::cot::CotSettings;

/// Where tracks go besides the network; nowhere by default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OutputConfig {
    /// Cursor-on-Target events over UDP to this address, such as `udp/239.2.3.1:6969`; empty for
    /// none. Multicast addresses are sent to on this machine's default interface.
    pub cot: String,
    /// ASTERIX CAT062 blocks over UDP to this address; empty for none.
    pub cat062: String,
    /// System area code of CAT062.
    pub sac: u8,
    /// System identification code of CAT062.
    pub sic: u8,
    /// File of GeoJSON, replaced as a whole; none if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub geojson: Option<PathBuf>,
    /// File of KML, replaced as a whole; none if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kml: Option<PathBuf>,
    /// File of CSV, replaced as a whole; none if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub csv: Option<PathBuf>,
    /// Outputs are renewed at most this often, seconds.
    pub interval_s: f64,
    /// A track that is not renewed for this long is out of date for whoever shows it, seconds.
    pub stale_after_s: f64,
    /// Places kept of each track's way.
    pub history_count: usize,
}

impl Default for OutputConfig {
    fn default() -> Self {
        Self {
            cot: String::new(),
            cat062: String::new(),
            sac: 0,
            sic: 1,
            geojson: None,
            kml: None,
            csv: None,
            interval_s: 5.0,
            stale_after_s: 60.0,
            history_count: 200,
        }
    }
}

impl OutputConfig {
    /// The first setting that makes no sense, its value and what would do.
    #[must_use]
    pub fn complaint(&self) -> Option<String> {
        for (name, value, least, most) in [
            ("interval_s", self.interval_s, 0.1, 3600.0),
            ("stale_after_s", self.stale_after_s, 0.1, 1e5),
            ("history_count", self.history_count as f64, 0.0, 100_000.0),
        ] {
            if !(least..=most).contains(&value) {
                return Some(format!("wide.output.{name} is {value}: use {least} to {most}"));
            }
        }
        for (name, text) in [("cot", &self.cot), ("cat062", &self.cat062)] {
            if !text.is_empty() && udp_address(text).is_none() {
                let remedy = "use udp/ADDRESS:PORT with a numeric address, or leave it empty";
                return Some(format!("wide.output.{name} is {text:?}: {remedy}"));
            }
        }
        let files = [("geojson", &self.geojson), ("kml", &self.kml), ("csv", &self.csv)];
        for (index, (name, path)) in files.iter().enumerate() {
            let same = |(_, other): &&(_, _)| path.is_some() && path == other;
            if let Some((other, _)) = files[..index].iter().find(same) {
                return Some(format!("wide.output.{name} is that of {other}: name two files"));
            }
        }
        None
    }

    /// How Cursor-on-Target events are written.
    #[must_use]
    pub fn cot_settings(&self, origin: Origin) -> CotSettings {
        CotSettings {
            origin,
            revisit_s: self.stale_after_s,
            stale_after_revisits: 1.0,
            ..CotSettings::default()
        }
    }

    /// How data blocks of CAT062 are written.
    #[must_use]
    pub fn cat062_settings(&self, origin: Origin) -> Cat062Settings {
        Cat062Settings { sac: self.sac, sic: self.sic, origin, frame: None }
    }

    /// Whether tracks go anywhere.
    #[must_use]
    pub fn is_used(&self) -> bool {
        let files = [&self.geojson, &self.kml, &self.csv];
        !self.cot.is_empty() || !self.cat062.is_empty() || files.iter().any(|file| file.is_some())
    }
}

/// The address in `udp/ADDRESS:PORT`.
#[must_use]
pub fn udp_address(text: &str) -> Option<SocketAddr> {
    text.strip_prefix("udp/")?.parse().ok()
}
