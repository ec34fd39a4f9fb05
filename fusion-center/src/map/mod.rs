//! Targets of wide-area radars on the map: dwells of all sensors in order, followed, told.

pub mod reorder;
