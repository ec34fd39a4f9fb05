//! The published association and its rivals: kernels, the life of tracks, the published experiment.

mod belief;
mod decide;
mod filter;
mod gate;
mod geometry;
mod life;
mod scene;
mod study;
