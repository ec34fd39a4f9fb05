//! The flags of `track`.

use std::path::PathBuf;

use clap::ValueEnum;
use proto::plots::Format;
use tokio_util::sync::CancellationToken;

use crate::map::MapConfig;
use crate::offline::{Files, TrackOptions, track};
use crate::tracking::TrackerKind;

/// What is followed, how, and where it goes.
#[derive(Clone, Debug, clap::Args)]
pub(super) struct TrackFlags {
    /// STANAG 4607, a capture of it (pcap, pcapng), CSV or JSON Lines; - for standard input.
    #[arg(value_name = "INPUT")]
    input: PathBuf,
    /// What the input is, if its content does not say it.
    #[arg(long, value_enum)]
    format: Option<FormatFlag>,
    /// Which tracker; that of wide.tracking.kind if left out.
    #[arg(long, value_enum)]
    mode: Option<ModeFlag>,
    /// Print JSON Lines: one line for each track and time at which it could have been seen.
    #[arg(long)]
    json: bool,
    /// Tentative tracks too.
    #[arg(long)]
    tentative: bool,
    /// Write every track with its way as GeoJSON.
    #[arg(long, value_name = "FILE")]
    geojson: Option<PathBuf>,
    /// Write every track with its way as KML.
    #[arg(long, value_name = "FILE")]
    kml: Option<PathBuf>,
    /// Write every step of every track as CSV.
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Write every step of every track as data blocks of ASTERIX CAT062.
    #[arg(long, value_name = "FILE")]
    cat062: Option<PathBuf>,
    /// Write every step of every track as a Cursor-on-Target event, one per line.
    #[arg(long, value_name = "FILE")]
    cot: Option<PathBuf>,
    /// Draw the map as SVG into this folder.
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum FormatFlag {
    /// STANAG 4607.
    #[value(name = "4607")]
    Stanag4607,
    /// Comma-separated values.
    Csv,
    /// JSON Lines.
    Jsonl,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum ModeFlag {
    /// The best one.
    Default,
    /// The association of the paper.
    Paper,
    /// Nearest neighbours.
    Nn,
    /// Belief functions.
    Belief,
}

impl TrackFlags {
    /// Follows the plots of the input.
    ///
    /// # Errors
    /// See [`track`].
    pub(super) async fn run(
        &self,
        mut config: MapConfig,
        stop: &CancellationToken,
    ) -> anyhow::Result<()> {
        config.tracking.kind = match self.mode {
            None => config.tracking.kind,
            Some(ModeFlag::Default) => TrackerKind::Default,
            Some(ModeFlag::Paper) => TrackerKind::Paper,
            Some(ModeFlag::Nn) => TrackerKind::Nn,
            Some(ModeFlag::Belief) => TrackerKind::Belief,
        };
        let format = self.format.map(|format| match format {
            FormatFlag::Stanag4607 => Format::Stanag4607,
            FormatFlag::Csv => Format::Csv,
            FormatFlag::Jsonl => Format::JsonLines,
        });
        let files = Files {
            geojson: self.geojson.clone(),
            kml: self.kml.clone(),
            csv: self.csv.clone(),
            cat062: self.cat062.clone(),
            cot: self.cot.clone(),
            figures: self.figures.clone(),
        };
        let Self { input, json, tentative, .. } = self.clone();
        track(TrackOptions { input, format, json, tentative, files }, config, stop).await
    }
}
