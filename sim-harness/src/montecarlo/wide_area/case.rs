//! One simulated flight: the looks that every tracker gets, and the truth.

use anyhow::Context;
use fusion_center::tracking::ReportId;
use fusion_center::wide::{LocalFrame, LookName, OwnedLook, WideConfig, own_look};
use nalgebra::Vector2;
use node_agent::gmti::simulate::{SimulatedGmti, SimulatedGmtiConfig};
use proto::ids::NodeId;
use proto::wire::{Dwell, GeoRecord};

use crate::metrics::Truth;

/// False plots per square kilometre that trackers are told of where there are none: they divide by it.
const NO_CLUTTER_PER_KM2: f64 = 0.01;
/// Square metres of a square kilometre.
const M2_PER_KM2: f64 = 1e6;

/// Looks in order of time, with what is true of them.
pub(super) struct Case {
    pub(super) looks: Vec<OwnedLook>,
    radar: SimulatedGmti,
    /// Of which target each report is, look by look, report by report.
    tags: Vec<Vec<Option<u32>>>,
}

impl Case {
    /// Flies past the scene once.
    ///
    /// # Errors
    /// If a setting makes no sense or a place is none.
    pub(super) fn new(config: &SimulatedGmtiConfig) -> anyhow::Result<Self> {
        let node: NodeId = "g1".parse().context("naming the radar")?;
        let mut radar = SimulatedGmti::new(config, node)?;
        let origin = radar.frame().origin();
        let frame = LocalFrame::new(&GeoRecord {
            lat_deg: origin.lat_deg(),
            lon_deg: origin.lon_deg(),
            height_m: origin.height_m(),
        })?;
        let clutter_per_km2 = radar.scene().clutter.map_or(NO_CLUTTER_PER_KM2, |clutter| {
            let area_m2 = 4.0 * clutter.east_half_m * clutter.north_half_m;
            (clutter.per_scan / area_m2 * M2_PER_KM2).max(NO_CLUTTER_PER_KM2)
        });
        let wide = WideConfig { clutter_per_km2, ..WideConfig::default() };
        let (mut looks, mut tags) = (Vec::new(), Vec::new());
        while let Some(dwell) = radar.next_dwell()? {
            let name = LookName { sensor_index: 0, look_index: looks.len() as u64 };
            looks.push(own_look(&dwell, &frame, &wide, name)?);
            tags.push(tags_of(&dwell));
        }
        Ok(Self { looks, radar, tags })
    }

    /// Of which target a report is; `None` for clutter.
    pub(super) fn target_of(&self, report: ReportId) -> Option<u32> {
        let look = self.tags.get(usize::try_from(report.look_index).ok()?)?;
        *look.get(usize::try_from(report.report_index).ok()?)?
    }

    /// Where a target is at the time of a look, metres, if it is there.
    pub(super) fn place_m(&self, target: u32, time_s: f64) -> Option<Vector2<f64>> {
        Some(self.radar.truth(target, time_s)?.position_m)
    }

    /// Everybody who is there.
    pub(super) fn truths(&self, time_s: f64) -> Vec<Truth<u32>> {
        let states = self.radar.truths(time_s).into_iter();
        states
            .map(|state| Truth { id: state.index, at_m: state.motion.position_m.into() })
            .collect()
    }

    /// How many targets the scene has.
    pub(super) fn target_count(&self) -> usize {
        self.radar.scene().targets.len()
    }
}

fn tags_of(dwell: &Dwell) -> Vec<Option<u32>> {
    dwell.reports.iter().map(|report| report.truth).collect()
}
