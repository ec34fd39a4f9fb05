//! The tracker on scenes of which everything is known.

mod filter;
mod four;
mod life;
mod load;
mod scenes;
mod score;
mod ten;
mod turning;
