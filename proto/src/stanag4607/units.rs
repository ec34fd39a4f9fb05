//! How many of a field's units make a metre.

pub(super) const DM_PER_M: f64 = 10.0;
pub(super) const CM_PER_M: f64 = 100.0;
pub(super) const MM_PER_M: f64 = 1000.0;
pub(super) const M_PER_KM: f64 = 1000.0;
