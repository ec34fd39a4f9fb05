//! The plane in which targets are followed: on the earth, or one of the data's own.

use nalgebra::{Matrix4, Vector4};
use proto::geodesy::GeodesyError;
use proto::plots::Scan;
use proto::wire::Dwell;

use crate::wide::{LocalFrame, LookName, OwnedLook, PlacedTrack, WideConfig, local_look, own_look};

/// Where the plane of the targets lies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ground {
    /// Local east and north about a place on the earth.
    Earth(LocalFrame),
    /// The data's own plane, nowhere on the earth.
    Plane,
}

impl Ground {
    /// The plane for a scan and those after it.
    ///
    /// # Errors
    /// If the scan says a place that is none.
    pub fn of(scan: &Scan) -> Result<Self, GeodesyError> {
        match scan {
            Scan::Geographic(dwell) => Ok(Self::Earth(LocalFrame::of_dwell(dwell)?)),
            Scan::Local(_) => Ok(Self::Plane),
        }
    }

    /// `scan` as a look in this plane; `None` if the one is on the earth and the other is not.
    ///
    /// # Errors
    /// If the scan says a place that is none.
    pub(super) fn look(
        &self,
        scan: &Scan,
        assumed: &WideConfig,
        name: LookName,
    ) -> Result<Option<OwnedLook>, GeodesyError> {
        match (self, scan) {
            (Self::Earth(frame), Scan::Geographic(dwell)) => {
                Ok(Some(own_look(dwell, frame, assumed, name)?))
            }
            (Self::Plane, Scan::Local(local)) => Ok(Some(local_look(local, assumed, name))),
            _ => Ok(None),
        }
    }

    /// How far from the frame's origin a dwell's sensor or the area that it looks at lies, whichever is
    /// farther, metres; 0 on a plane.
    ///
    /// # Errors
    /// If one of them is no place.
    pub(super) fn off_m(&self, scan: &Scan) -> Result<f64, GeodesyError> {
        let (Self::Earth(frame), Scan::Geographic(dwell)) = (self, scan) else { return Ok(0.0) };
        let Dwell { sensor, area, .. } = dwell.as_ref();
        Ok(frame.off_m(sensor)?.max(frame.off_m(&area.center)?))
    }

    /// A state of the plane on the earth, for a target at this height above the ellipsoid; `None` on
    /// a plane of its own, or where the state is nowhere near the earth.
    #[must_use]
    pub fn placed(
        &self,
        state: &Vector4<f64>,
        covariance: &Matrix4<f64>,
        height_m: f64,
    ) -> Option<PlacedTrack> {
        let Self::Earth(frame) = self else { return None };
        frame.placed(state, covariance, height_m).ok()
    }

    /// Height of the plane above the ellipsoid, metres; 0 on a plane of its own.
    #[must_use]
    pub fn height_m(&self) -> f64 {
        match self {
            Self::Earth(frame) => frame.height_m(),
            Self::Plane => 0.0,
        }
    }
}
