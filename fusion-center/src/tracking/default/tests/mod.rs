//! The tracker on scenes of which everything is known.

mod four;
mod load;
mod scenes;
mod score;
mod ten;
mod turning;
