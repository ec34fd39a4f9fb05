//! A wide-area radar: moving targets on the ground, seen from an aircraft, dwell by dwell.

pub mod simulate;
