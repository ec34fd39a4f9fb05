//! Reading a configuration file, and the part of it that every process shares: the bus.

use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Largest configuration file that is read, bytes.
const MAX_FILE_BYTES: u64 = 1 << 20;

/// Why a configuration was not taken.
#[derive(Debug, Error)]
pub enum ConfigError {
    /// The file is not there or may not be read.
    #[error(
        "reading configuration {path}: {source}; give an existing file or leave it out for the defaults"
    )]
    Unreadable {
        /// Which file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is larger than any configuration.
    #[error(
        "configuration {path} has {bytes} bytes, more than {MAX_FILE_BYTES}: is it the right file?"
    )]
    TooLarge {
        /// Which file.
        path: PathBuf,
        /// Its size.
        bytes: u64,
    },
    /// Not TOML, an unknown key, or a value of the wrong type.
    #[error("configuration {path}: {detail}")]
    Malformed {
        /// Which file.
        path: PathBuf,
        /// Line, key and reason.
        detail: String,
    },
    /// A value that makes no sense.
    #[error("configuration {path}: {detail}")]
    Senseless {
        /// Which file.
        path: PathBuf,
        /// Key, value and remedy.
        detail: String,
    },
}

/// Reads a TOML file; unknown keys are refused by `T`.
///
/// # Errors
/// Names the file, and the line and key where that is known.
pub fn load<T: DeserializeOwned>(path: &Path) -> Result<T, ConfigError> {
    let unreadable = |source| ConfigError::Unreadable { path: path.to_owned(), source };
    let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
    if MAX_FILE_BYTES < bytes {
        return Err(ConfigError::TooLarge { path: path.to_owned(), bytes });
    }
    let text = std::fs::read_to_string(path).map_err(unreadable)?;
    toml::from_str(&text).map_err(|error| ConfigError::Malformed {
        path: path.to_owned(),
        detail: error.to_string().trim_end().to_owned(),
    })
}

/// Why a `KEY=VALUE` on the command line was not taken.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("setting {setting:?}: {detail}")]
pub struct InvalidSetting {
    /// As given.
    setting: String,
    /// What is wrong with it.
    detail: String,
}

/// `config` with single keys changed: `chain.fft_length=4096`, `node=\"n2\"` or `node=n2`. A value
/// that is not TOML is taken as text.
///
/// # Errors
/// Names the first setting that is not of this form, names no key, or has a value of the wrong
/// type.
pub fn with_settings<T>(config: T, settings: &[String]) -> Result<T, InvalidSetting>
where
    T: Serialize + DeserializeOwned,
{
    settings.iter().try_fold(config, |config, setting| {
        changed(&config, setting)
            .map_err(|detail| InvalidSetting { setting: setting.clone(), detail })
    })
}

fn changed<T: Serialize + DeserializeOwned>(config: &T, setting: &str) -> Result<T, String> {
    let (path, text) = setting.split_once('=').ok_or("write KEY=VALUE")?;
    let value = format!("value = {text}").parse::<toml::Table>();
    let value = value.ok().and_then(|mut table| table.remove("value"));
    let value = value.unwrap_or_else(|| toml::Value::String(text.to_owned()));
    let mut root = toml::Table::try_from(config).map_err(|error| error.to_string())?;
    let (parents, key) = path.rsplit_once('.').map_or((None, path), |(p, last)| (Some(p), last));
    let mut table = &mut root;
    for parent in parents.iter().flat_map(|parents| parents.split('.')) {
        let inner = table.entry(parent).or_insert_with(|| toml::Table::new().into());
        // A choice without settings of its own, such as wall = "none", gives way to one with.
        if inner.is_str() {
            *inner = toml::Table::new().into();
        }
        table = inner.as_table_mut().ok_or_else(|| format!("{parent} is not a table"))?;
    }
    table.insert(key.to_owned(), value);
    root.try_into().map_err(|error: toml::de::Error| error.message().to_owned())
}

/// How a process takes part in the star: the router listens, everybody else dials.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct BusConfig {
    /// Endpoints to dial, such as `tcp/192.0.2.7:7447`.
    pub connect: Vec<String>,
    /// Endpoints to listen on. With any, this process is the router; without, it only dials.
    pub listen: Vec<String>,
    /// Sets kept for a centre that was away: at least the rate of sets times the longest outage.
    pub history_count: usize,
    /// Deliveries that may wait to be handled; beyond that the newest are dropped and counted.
    pub inbox_count: usize,
}

/// Where the centre listens and agents dial unless told otherwise: this machine only.
pub const DEFAULT_ENDPOINT: &str = "tcp/127.0.0.1:7447";

impl Default for BusConfig {
    fn default() -> Self {
        let connect = vec![DEFAULT_ENDPOINT.to_owned()];
        Self { connect, listen: Vec::new(), history_count: 300, inbox_count: 16_384 }
    }
}

impl BusConfig {
    /// The defaults of the centre: it is the router, on this machine only.
    #[must_use]
    pub fn router() -> Self {
        let listen = vec![DEFAULT_ENDPOINT.to_owned()];
        Self { connect: Vec::new(), listen, ..Self::default() }
    }

    /// Checks every field; `None` if all make sense, else what does not and the remedy.
    #[must_use]
    pub fn complaint(&self) -> Option<String> {
        if self.connect.is_empty() && self.listen.is_empty() {
            return Some("bus.connect and bus.listen are both empty: name an endpoint".to_owned());
        }
        if !(1..=100_000).contains(&self.history_count) {
            return Some(format!("bus.history_count is {}: use 1 to 100000", self.history_count));
        }
        if self.inbox_count < self.history_count || 1 << 20 < self.inbox_count {
            let count = self.inbox_count;
            return Some(format!("bus.inbox_count is {count}: use bus.history_count to 1048576"));
        }
        let strange = |endpoint: &&String| !endpoint.starts_with("tcp/");
        let endpoint = self.connect.iter().chain(&self.listen).find(strange)?;
        Some(format!("bus endpoint {endpoint:?} is not of the form tcp/HOST:PORT"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(name: &str, text: &str) -> PathBuf {
        let path = std::env::temp_dir().join(format!("transmural-{}-{name}", std::process::id()));
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn errors_name_the_file_and_the_key() {
        let missing = load::<BusConfig>(Path::new("no-such.toml")).unwrap_err().to_string();
        assert!(missing.contains("no-such.toml"), "{missing}");
        let path = file("key.toml", "conect = []\n");
        let unknown = load::<BusConfig>(&path).unwrap_err().to_string();
        assert!(unknown.contains("conect") && unknown.contains("key.toml"), "{unknown}");
        let large_path = file("large.toml", &"#".repeat(1 << 20 | 1));
        let large = load::<BusConfig>(&large_path).unwrap_err().to_string();
        assert!(large.contains("1048577"), "{large}");
    }

    #[test]
    fn single_keys_can_be_changed() {
        let set = |settings: &[&str]| {
            let settings: Vec<String> = settings.iter().map(|text| (*text).to_owned()).collect();
            with_settings(BusConfig::default(), &settings)
        };
        let changed = set(&["history_count=7", "connect=[\"tcp/192.0.2.7:1\"]"]).unwrap();
        assert_eq!((changed.history_count, changed.connect.len()), (7, 1));
        for (bad, names) in [("history_count", "KEY=VALUE"), ("histry=1", "histry")] {
            let error = set(&[bad]).unwrap_err().to_string();
            assert!(error.contains(names) && error.contains(bad), "{error}");
        }
        assert!(set(&["history_count=many"]).unwrap_err().to_string().contains("many"));
        assert!(set(&["history_count.x=1"]).unwrap_err().to_string().contains("not a table"));
    }

    #[test]
    fn senseless_endpoints_are_named() {
        assert_eq!(BusConfig::default().complaint(), None);
        assert_eq!(BusConfig::router().complaint(), None);
        let nowhere = BusConfig { connect: vec![], ..BusConfig::default() };
        assert!(nowhere.complaint().unwrap().contains("bus.connect"));
        let web = BusConfig { connect: vec!["http://x".to_owned()], ..BusConfig::default() };
        assert!(web.complaint().unwrap().contains("tcp/HOST:PORT"));
    }
}
