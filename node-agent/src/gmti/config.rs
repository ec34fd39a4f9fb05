//! Settings of an agent of a wide-area radar.

use std::net::SocketAddr;
use std::path::PathBuf;

use proto::plots::Format;
use serde::{Deserialize, Serialize};

use super::simulate::SimulatedGmtiConfig;

/// An agent of a wide-area radar: where dwells come from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GmtiConfig {
    /// Where dwells come from.
    pub source: GmtiSource,
    /// Of the source `file`: STANAG 4607, a capture of it (pcap, pcapng), CSV or JSON Lines.
    pub path: PathBuf,
    /// What file or network carries, if its content does not say it; STANAG 4607 on the network.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub format: Option<Format>,
    /// Of the sources `udp` and `tcp`: the address to listen at, or to dial.
    pub address: String,
    /// The source `tcp` dials the address instead of listening there.
    pub dial: bool,
    /// Settings of the source `simulated`.
    pub simulated: SimulatedGmtiConfig,
}

/// Where dwells come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum GmtiSource {
    /// A radar over known targets.
    #[default]
    Simulated,
    /// A recording.
    File,
    /// Datagrams.
    Udp,
    /// A stream.
    Tcp,
}

impl Default for GmtiConfig {
    fn default() -> Self {
        Self {
            source: GmtiSource::default(),
            path: PathBuf::new(),
            format: None,
            address: "127.0.0.1:4607".to_owned(),
            dial: false,
            simulated: SimulatedGmtiConfig::default(),
        }
    }
}

impl GmtiConfig {
    /// The first setting that makes no sense, its value and what would do.
    #[must_use]
    pub fn complaint(&self) -> Option<String> {
        let scene = self.simulated.check().and_then(|()| self.simulated.scene().check_message());
        if let Err(error) = scene {
            return Some(format!("gmti.{error}"));
        }
        if self.source == GmtiSource::File && self.path.as_os_str().is_empty() {
            return Some(
                "gmti.path is empty: name a file of STANAG 4607, CSV or JSON Lines".into(),
            );
        }
        if self.socket_address().is_none() {
            let remedy = "use ADDRESS:PORT with a numeric address";
            return Some(format!("gmti.address is {:?}: {remedy}", self.address));
        }
        None
    }

    /// The address to listen at, or to dial.
    #[must_use]
    pub fn socket_address(&self) -> Option<SocketAddr> {
        self.address.parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonsense_names_key_value_and_remedy() {
        assert_eq!(GmtiConfig::default().complaint(), None);
        let said = |change: fn(&mut GmtiConfig)| {
            let mut config = GmtiConfig::default();
            change(&mut config);
            config.complaint().unwrap_or_default()
        };
        assert!(said(|one| one.source = GmtiSource::File).starts_with("gmti.path is empty"));
        assert!(said(|one| one.address = "here".into()).starts_with("gmti.address is \"here\""));
        let scene = said(|one| one.simulated.origin.lat_deg = 95.0);
        assert!(scene.starts_with("gmti.") && scene.contains("origin.lat_deg"), "{scene}");
    }

    #[test]
    fn the_format_is_written_as_on_the_command_line() {
        let read = |text: &str| toml::from_str::<GmtiConfig>(text);
        assert_eq!(read("format = \"4607\"").unwrap().format, Some(Format::Stanag4607));
        assert_eq!(read("format = \"jsonl\"").unwrap().format, Some(Format::JsonLines));
        assert!(read("format = \"xml\"").is_err());
        assert_eq!(read("source = \"tcp\"\ndial = true").unwrap().source, GmtiSource::Tcp);
    }
}
