//! The tracker on scenes of which everything is known.

mod scenes;
mod score;
mod four;
