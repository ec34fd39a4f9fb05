//! Dwells that are played: of a simulated radar, or of a recording.

use std::collections::VecDeque;
use std::fs::File;

use proto::ids::NodeId;
use proto::plots::{Damage, Input, InputError, Naming, Scan};
use proto::wire::Dwell;
use thiserror::Error;

use super::config::{GmtiConfig, GmtiSource};
use super::simulate::{SimulatedGmti, SimulationError};

/// Why dwells cannot be played, or not further.
#[derive(Debug, Error)]
pub enum PlayedError {
    /// The scene makes no sense.
    #[error("gmti.simulated: {0}")]
    Scene(#[from] SimulationError),
    /// Somebody or something has left the earth.
    #[error("gmti.simulated: {0}")]
    Place(#[from] proto::geodesy::GeodesyError),
    /// The recording cannot be opened.
    #[error("opening gmti.path {path}: {source}")]
    Open {
        /// The file.
        path: String,
        /// What the system said.
        source: std::io::Error,
    },
    /// The recording cannot be read.
    #[error("gmti.path: {0}")]
    Input(#[from] InputError),
    /// A live source is not played.
    #[error("gmti.source is live: it is not played")]
    Live,
}

/// What comes next.
#[derive(Debug)]
pub enum Next {
    /// A dwell.
    Dwell(Box<Dwell>),
    /// Something that could not be used: a label, and the reason in full.
    Damage(&'static str, String),
    /// Nothing more.
    End,
}

/// Gives dwells one by one.
pub struct Played {
    kind: Kind,
}

enum Kind {
    Simulated(Box<SimulatedGmti>),
    Recorded { input: Box<Input<'static>>, waiting: VecDeque<Result<Scan, Damage>> },
}

impl Played {
    /// Opens the configured source; all dwells are of `node`.
    ///
    /// # Errors
    /// If it cannot be opened, or is live.
    pub fn open(config: &GmtiConfig, node: &NodeId) -> Result<Self, PlayedError> {
        let kind = match config.source {
            GmtiSource::Simulated => {
                let simulated = SimulatedGmti::new(&config.simulated, node.clone())?;
                Kind::Simulated(Box::new(simulated))
            }
            GmtiSource::File => {
                let path = config.path.display().to_string();
                let file = File::open(&config.path)
                    .map_err(|source| PlayedError::Open { path: path.clone(), source })?;
                let naming = Naming::Fixed(node.clone());
                let input = Input::open(file, &path, config.format, naming)?;
                Kind::Recorded { input: Box::new(input), waiting: VecDeque::new() }
            }
            GmtiSource::Udp | GmtiSource::Tcp => return Err(PlayedError::Live),
        };
        Ok(Self { kind })
    }

    /// The next dwell, or what could not be used.
    ///
    /// # Errors
    /// If the source cannot go on.
    pub fn advance(&mut self) -> Result<Next, PlayedError> {
        match &mut self.kind {
            Kind::Simulated(simulated) => {
                Ok(simulated.next_dwell()?.map_or(Next::End, |dwell| Next::Dwell(Box::new(dwell))))
            }
            Kind::Recorded { input, waiting } => {
                let mut found = Vec::new();
                let mut goes_on = true;
                while waiting.is_empty() && goes_on {
                    goes_on = input.advance(&mut found)?;
                    waiting.extend(found.drain(..));
                }
                Ok(waiting.pop_front().map_or(Next::End, taken))
            }
        }
    }
}

/// A scan as an agent sends it: plots on a plane have no place on the map.
pub fn taken(found: Result<Scan, Damage>) -> Next {
    match found {
        Ok(Scan::Geographic(dwell)) => Next::Dwell(dwell),
        Ok(Scan::Local(scan)) => Next::Damage(
            "local",
            format!(
                "the plots of {} s have x and y: an agent needs latitude and longitude, \
                 fusion-center track takes both",
                scan.time_s
            ),
        ),
        Err(damage) => Next::Damage(damage.label(), damage.to_string()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn node() -> NodeId {
        "eye".parse().unwrap()
    }

    fn all(config: &GmtiConfig) -> (Vec<Dwell>, Vec<&'static str>) {
        let mut played = Played::open(config, &node()).unwrap();
        let (mut dwells, mut labels) = (Vec::new(), Vec::new());
        loop {
            match played.advance().unwrap() {
                Next::Dwell(dwell) => dwells.push(*dwell),
                Next::Damage(label, _) => labels.push(label),
                Next::End => return (dwells, labels),
            }
        }
    }

    #[test]
    fn a_simulated_radar_plays_its_scans_and_ends() {
        let (dwells, labels) = all(&GmtiConfig::default());
        assert!(labels.is_empty() && 30 < dwells.len(), "{}", dwells.len());
        assert!(dwells.iter().all(|dwell| dwell.node == node() && dwell.is_simulated));
        assert!(dwells.windows(2).all(|pair| pair[0].time_unix_s <= pair[1].time_unix_s));
    }

    #[test]
    fn a_recording_plays_under_the_agents_name_and_bad_lines_are_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("plots.csv");
        let text = "time_s,sensor,lat_deg,lon_deg,sensor_lat_deg,sensor_lon_deg,sensor_height_m\n\
                    1,other,40,110,41,110,9000\nx,other,40,110,41,110,9000\n\
                    2,other,40,110,41,110,9000\n";
        std::fs::write(&path, text).unwrap();
        let file = GmtiConfig { source: GmtiSource::File, path, ..GmtiConfig::default() };
        let (dwells, labels) = all(&file);
        assert_eq!((dwells.len(), labels), (2, vec!["cell"]));
        assert_eq!(dwells[1].node, node());
        std::fs::write(&file.path, "time_s,x_m,y_m\n1,2,3\n").unwrap();
        assert_eq!(all(&file).1, ["local"]);
    }

    #[test]
    fn sources_that_cannot_be_played_say_why() {
        let said = |config: &GmtiConfig| match Played::open(config, &node()) {
            Ok(_) => String::new(),
            Err(error) => error.to_string(),
        };
        let absent = GmtiConfig {
            source: GmtiSource::File,
            path: "no-such.4607".into(),
            ..GmtiConfig::default()
        };
        assert!(said(&absent).starts_with("opening gmti.path no-such.4607"));
        let live = GmtiConfig { source: GmtiSource::Udp, ..GmtiConfig::default() };
        assert!(said(&live).contains("not played"));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("tale");
        std::fs::write(&path, "once upon a time\n").unwrap();
        assert!(said(&GmtiConfig { path, ..absent }).contains("name the format"));
        let mut nowhere = GmtiConfig::default();
        nowhere.simulated.origin.lat_deg = 95.0;
        assert!(said(&nowhere).starts_with("gmti.simulated: "));
    }
}
