//! The tracker on scenes of which everything is known.

mod scenes;
mod score;
mod four;
mod load;
mod ten;
mod turning;
