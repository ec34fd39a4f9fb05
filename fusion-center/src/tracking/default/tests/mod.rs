//! The tracker on scenes of which everything is known.

mod filter;
mod four;
mod life;
mod load_tests;
mod memory;
mod scenes;
mod score;
mod stop;
mod ten_tests;
mod turning;
