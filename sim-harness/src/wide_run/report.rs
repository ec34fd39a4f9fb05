//! What a run leaves: the map scored against the truth, a table, `report.json`, a picture.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::Context;
use fusion_center::export::figure::Map;
use fusion_center::export::{GeoFix, GeoTrack};
use fusion_center::map::{Past, fix, geo_track};
use nalgebra::Matrix2;
use node_agent::gmti::simulate::SimulatedGmti;
use proto::geodesy::{EnuPoint, GeoPosition};
use proto::wire::{MapCounts, MapTrack, MapTracks};
use serde::Serialize;

use super::scenario::WidePlan;
use crate::launch::Incident;
use crate::metrics::{Estimate, OspaScale, Scorer, Settings, Truth};
use crate::resources::Usage;

/// An estimate farther from a true place than this does not belong to it; also the cut-off of GOSPA,
/// metres. Four times the distance of the two that drive side by side.
const GATE_M: f64 = 200.0;
/// A target need not be found sooner: three plots confirm a track, and the centre waits at first.
const ALLOWANCE_S: f64 = 20.0;

/// Watches the map of one run.
pub(super) struct Scored {
    scene: SimulatedGmti,
    scorer: Scorer<u32, u64>,
    last: Option<MapTracks>,
    map_count: u64,
    ids: BTreeSet<u64>,
    ways: BTreeMap<u64, (MapTrack, Vec<GeoFix>)>,
    true_places: Vec<GeoPosition>,
}

impl Scored {
    pub(super) fn new(scene: SimulatedGmti) -> anyhow::Result<Self> {
        let settings = Settings {
            gate_m: GATE_M,
            allowance_s: ALLOWANCE_S,
            gospa_cutoff_m: GATE_M,
            ospa: OspaScale { order: 2.0, cutoff_m: GATE_M },
        };
        Ok(Self {
            scene,
            scorer: Scorer::new(settings)?,
            last: None,
            map_count: 0,
            ids: BTreeSet::new(),
            ways: BTreeMap::new(),
            true_places: Vec::new(),
        })
    }

    /// Holds a map against the truth of its time. A map that is said again, or one of another life of
    /// the centre that begins earlier, is passed over.
    pub(super) fn take(&mut self, map: &MapTracks) {
        let time_unix_s = map.time_unix_s;
        if self.last.as_ref().is_some_and(|last| time_unix_s <= last.time_unix_s) {
            return;
        }
        let truths: Vec<Truth<u32>> = (self.scene.truths(time_unix_s).iter())
            .map(|state| Truth { id: state.index, at_m: state.motion.position_m.into() })
            .collect();
        for truth in &truths {
            let height_m = self.scene.frame().origin().height_m();
            let [east_m, north_m] = truth.at_m;
            self.true_places.extend(self.scene.frame().on_surface(east_m, north_m, height_m).ok());
        }
        let estimates: Vec<Estimate<u64>> =
            map.tracks.iter().filter_map(|track| self.estimate(track, time_unix_s)).collect();
        self.scorer.add(time_unix_s, &truths, &estimates);
        self.map_count += 1;
        for track in &map.tracks {
            self.ids.insert(track.id);
            let way = self.ways.entry(track.id).or_insert_with(|| (track.clone(), Vec::new()));
            way.0 = track.clone();
            way.1.extend(fix(track).ok());
        }
        self.last = Some(map.clone());
    }

    /// A track in the scene's plane, carried on to `time_unix_s`.
    fn estimate(&self, track: &MapTrack, time_unix_s: f64) -> Option<Estimate<u64>> {
        let place = &track.place;
        let place = GeoPosition::new(place.lat_deg, place.lon_deg, place.height_m).ok()?;
        let EnuPoint { east_m, north_m, .. } = self.scene.frame().to_enu(&place);
        let ahead_s = time_unix_s - track.time_unix_s;
        let [east_m_per_s, north_m_per_s] = track.velocity_m_per_s;
        let covariance = track.covariance_matrix();
        let covariance_m2: Matrix2<f64> = covariance.fixed_view::<2, 2>(0, 0).into_owned();
        Some(Estimate {
            id: track.id,
            at_m: [east_m + ahead_s * east_m_per_s, north_m + ahead_s * north_m_per_s],
            covariance_m2: Some(covariance_m2),
        })
    }

    fn picture(&self, title: &str) -> anyhow::Result<String> {
        let track = |(last, fixes): &(MapTrack, Vec<GeoFix>)| {
            let first_seen_unix_s = fixes.first().map_or(last.time_unix_s, |fix| fix.time_unix_s);
            let past = Past { first_seen_unix_s, sensors: Vec::new(), fixes: fixes.clone() };
            geo_track(last, &past, "run")
        };
        let tracks: Vec<GeoTrack> = self.ways.values().map(track).collect::<Result<_, _>>()?;
        let frame = self.scene.frame();
        let (dots, dots_are) = (&self.true_places[..], "where vehicles truly were");
        Ok(Map { title, frame, tracks: &tracks, dots, dots_are }.checked_svg()?)
    }
}

/// Everything a run has shown.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Report {
    scenario: String,
    seed: u64,
    /// All bounds are kept.
    pub(crate) success: bool,
    target_count: usize,
    found_count: usize,
    /// Tracks that were ever shown.
    track_count: usize,
    purity: Option<f64>,
    completeness: Option<f64>,
    switch_count: usize,
    missed_share: Option<f64>,
    rmse_m: Option<f64>,
    gospa_m: Option<f64>,
    nees: Option<f64>,
    /// Maps that were scored.
    map_count: u64,
    /// What the centre said last of its dwells.
    counts: MapCounts,
    /// Processes that ended on the way.
    incidents: Vec<Incident>,
    resources: BTreeMap<String, Usage>,
    folder: PathBuf,
}

impl Report {
    pub(super) fn new(
        plan: &WidePlan,
        scored: Scored,
        resources: BTreeMap<String, Usage>,
        incidents: Vec<Incident>,
        folder: &Path,
    ) -> anyhow::Result<Self> {
        let score = scored.scorer.score();
        let bounds = plan.scenario.bounds;
        let found_share = score.found_count as f64 / (score.person_count as f64).max(1.0);
        let success = 0 < score.person_count
            && bounds.found_share <= found_share
            && score.purity().is_some_and(|purity| bounds.purity <= purity)
            && score.gospa_m().is_some_and(|gospa_m| gospa_m <= bounds.gospa_m);
        let report = Self {
            scenario: plan.scenario.name.clone(),
            seed: plan.scenario.seed,
            success,
            target_count: score.person_count,
            found_count: score.found_count,
            track_count: scored.ids.len(),
            purity: score.purity(),
            completeness: score.completeness(),
            switch_count: score.switch_count,
            missed_share: score.missed_share(),
            rmse_m: score.rmse_m(),
            gospa_m: score.gospa_m(),
            nees: score.nees(),
            map_count: scored.map_count,
            counts: scored.last.as_ref().map_or_else(MapCounts::default, |last| last.counts),
            incidents,
            resources,
            folder: folder.to_owned(),
        };
        let write = |name: &str, text: String| {
            let path = folder.join(name);
            std::fs::write(&path, text).with_context(|| format!("writing {}", path.display()))
        };
        write("map.svg", scored.picture(&format!("{}: tracks, and the truth", report.scenario))?)?;
        write("report.json", serde_json::to_string_pretty(&report)?)?;
        Ok(report)
    }

    /// The figures, line by line.
    pub(crate) fn table(&self) -> String {
        let shown = |value: Option<f64>| value.map_or("none".to_owned(), |v| format!("{v:.3}"));
        let verdict = if self.success { "within bounds" } else { "NOT within bounds" };
        let Self { scenario, seed, found_count, target_count, track_count, .. } = self;
        let Self { switch_count, map_count, counts, folder, .. } = self;
        format!(
            "{scenario}, seed {seed}: {verdict}\n\
             {found_count} of {target_count} targets found, {track_count} tracks, {switch_count} \
             switches\npurity {}, completeness {}, missed {}, RMSE {} m, GOSPA {} m, NEES {}\n\
             {map_count} maps of {} dwells with {} reports, {} late, {} refused\nfiles in {}\n",
            shown(self.purity),
            shown(self.completeness),
            shown(self.missed_share),
            shown(self.rmse_m),
            shown(self.gospa_m),
            shown(self.nees),
            counts.dwell_count,
            counts.report_count,
            counts.late_count,
            counts.refused_count,
            folder.display()
        )
    }
}
